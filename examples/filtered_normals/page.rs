//! What the page says around what was measured.

use crate::common::runner::Words;

const HEAD: &str = "\
# Filtered normals: Patro 2007, measured

`cargo run --release --example filtered_normals -- ../shared/data docs` measures everything on this page and writes it
(`examples/filtered_normals/`; `--quick` tries it, `--only PART` measures one part again). Models have a diagonal of 30 mm. Times are
those of the machine that wrote the page and of what else it did; everything else is the same anywhere.

The method stores no transport. Normals are low-passed over the surface, and take the place of the normals in local lighting:
`B = R F_t(mu) max(0, mu) V L` with the filtered normal of each channel. It is an approximation by design, and its ledger says by how much.

- **`length=spread`** (ours, the default): a filtered normal is short where the normals around it differ. Light falls on normals that spread
  about it until their mean has its length, as heat spreads on the sphere: harmonics of band l of `F_t(mu) max(0, mu)` fall by
  `length^(l (l + 1) / 2)`. No light is lost; it comes from the side, and from behind where the body is small. `length=kept` multiplies the
  light by the length instead, `length=unit` renormalises, as the paper does.

- **What is stored** is neither a basis nor one filtered normal: normals under eight low passes `1 / (1 + t lambda)`, quantised to 1/128 and
  predicted from the vertices before, and how open each vertex is. Any filter of the surface is a sum over these eight and the normals
  themselves, so it changes with the material, for each channel, at the cost of that sum: RGB takes the same bytes. The filter that a
  material implies is the Hankel transform of its R_d, normalised: `(e^(-z_r s) + e^(-z_v s)) / (e^(-z_r sigma_tr) + e^(-z_v sigma_tr))` with
  `s = sqrt(sigma_tr^2 + lambda)`. Published materials are met to 2 % of the response, Gaussians and exponentials to 6 %.
- **`filter=heat`**: the low passes are solutions of `(M + t S) x = M n` by conjugate gradients on a multigrid cycle, nothing
  factorised: some twenty cycles each, however many vertices there are.
- **`filter=spectral`**: the paper's manifold harmonics up to wavelengths of 10 mean edges, by shift and invert in bands whose number of pairs
  is that of the inertia; the remainder goes through the mean response of its frequencies (gamma of equation 11).
- **`filter=geometric`**: the paper's equation 3; weights by area unless `weights=count`.
- **Light from all around** is three bands of harmonics times the openness of the vertex; an area light is 16 places, each with its shadow ray.
  Highlights are those of every method, by the normals as they are: GGX, or with `--highlights blinn-phong:EXPONENT` (`render`, `relight`) the
  paper's Blinn-Phong. The paper means OpenGL's, `(n.h)^EXPONENT` times a constant and the light, and lights the whole of it by the filtered normal.
  Ours is `F (EXPONENT + 2) / (8 pi) (n.h)^EXPONENT` times irradiance, with the Fresnel reflectance F of the medium: it never returns more than comes in,
  and what is reflected at the surface does not see a normal that was filtered for what is scattered below it.
- **Shadows** are rays from the vertices. Towards the horizon of a vertex they fade into how open it is (the share of the sky that it sees),
  which is all that counts below: light enters where the surface around faces it. `shadows=off` is the paper's.
- **Its nearest rival** wraps the cosine around the terminator and costs less. The tables have it with its best wrap. What filtered normals
  miss is light from beyond the vertex's own neighbourhood, which no normal has.
- **`bleeding=irradiance`** is the paper's future work: the same filter on the shadowed irradiance, for each light.
- **alpha** and **width** are fitted on probe lights unless given: the share of the unfiltered normal, and a factor of the filter's width.

## Errors

RMS over the vertices against exact sums, in %, worst channel; *all six* is the root of the mean square. *Wrapped Lambert* is
`R C V L max(0, mu + w) / (1 + w)^2`, which returns as much as a cosine over all normals, with the best w under these very lights.

The second table has a square light of half the size, the built-in sky and light that is the same from all around, and *off the volume*: RMS
against a random walk through the volume under the sun from the side, which holds the dipole's own error as well. Errors do not add up:
the exact sums are 15, 32 and 23 % off the volume (marble, skin1, skimmilk), filtered normals 22, 38 and 24 %.

";

const FIGURE2: &str = "
## Figure 2: uneven meshes

The same surface with its longest edges cut to three times as many vertices. A filter of the surface gives the same values at the vertices that
were there before; sums that count vertices do not. No shadows, nothing fitted, filtered normals renormalised as the paper does.

";

const SPEED: &str = "
## Speed

A change of the filter is a new material: the coefficients of each channel, and the radiosity of every vertex.

";

const TAIL: &str = "
## What it gives up

Light that enters on one side and leaves on the other, thin parts that glow, shadows softened from inside: local lighting has none of these,
whatever its normal. With `bleeding=irradiance` shadow boundaries soften, and light still does not cross a thin part, which is
far over the surface and near through it.

Boundaries of cast shadows are as coarse as the vertices.
";

pub(crate) const WORDS: Words =
    Words { head: HEAD, before: &[("figure2", FIGURE2), ("speed", SPEED)], places: &[], tail: TAIL };
