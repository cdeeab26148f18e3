//! What the page says around what was measured.

use crate::common::runner::Words;

const HEAD: &str = "\
# The calibrated kernel: the volume's answer as a sum over the surface

`cargo run --release --example model -- ../shared/data docs` measures everything on this page and writes it (`examples/model/`;
`--quick` tries it, `--only PART` measures one part again). Times are those of the machine that wrote the page and of what else it did;
everything else is the same anywhere.

The dipole is a half space's answer. A body is no half space: against walks through the volume the dipole is 13 % (marble) to 30 %
(skin1) off, and no other radial profile is much better, because what is wrong is the shape. `--model calibrated` of `reference`, and of `bake` with
`editable`, `two_pass`, `quantized_lights` and `all_frequency`, takes some seconds of walks through the body itself, and sums

`B(x_o) = s_o Int R_d(r) (a(r) + b(r) h) s_i E'(x_i) dA`, `h = f(r) ((x_i - x_o).n_o + (x_o - x_i).n_i)`.

- **a and b** are two functions of the distance for each part and channel, cubic B-splines of ln r. Walks that start with diffuse entry give
  pairs of entry and exit; a least-squares fit over all pairs of the surface, weighted by `1 / R_d` (which is what the noise of the walks asks
  for), gives the functions. `R_d a` is a single layer, `R_d b f` times the heights a double layer, as in a boundary
  integral: h is negative across the body, zero on a plane, positive across a hollow. f is 1 / r, and fades within a mean free path, where heights are
  small: a fade of two changes no error of orders from 2 on by more than 0.1 %, and a layer that varies slowly is summed over few points.
- **s** is one factor a point and channel, solved for so that light that is the same everywhere leaves as it does in the walks
  (`s <- s (t / row sum)^(2/3)`). The kernel stays symmetric, as the volume is. What the walks add to the layers is smoothed over the surface
  before; the length of the smoothing is that with which one half of the walks predicts the other best. Factors stand at the vertices, and where edges are
  longer than three mean free paths at points between.
- **E'** is irradiance moved to where light first scatters: the tangential part of a free path along the refracted ray, under directional and point lights.
  Each sample fetches the light of the places that steps of six lengths come from, the means of six equal shares of all free paths; what
  the same steps bring the neighbourhood, counted over cells of three mean free paths, is how much of it there is. Light of many directions enters as the walks did.
- **Orders.** The kernel holds the orders of scattering that were asked for: from 1 on, or from 2 on where order 1 has a stage of its own. Order
  0, which passes straight through, is in neither.
- **Openings.** A part that lets light out is no volume: it keeps its dipole, and the command says so.

| figure | before | wanted | few walks / many walks |
| --- | --- | --- | --- |
";

const TRUTH: &str = "
## Against an independent program

Walks of a separate program through bunny_3k (30 mm), all vertices, the noise taken out by two independent halves. RMS in % of the light of orders
from 1 on; *few walks* are the default (200,000 photons a channel, 20 million scattering events at most), *many* are twenty times as many. Seconds are
those of the calibration.

";

const UNSEEN: &str = "
## Models and materials that nothing was tuned on

RMS in % (R G B) of orders from 1 on against the program's own walks of 5 % noise, which is taken out; the default number of walks for the calibration,
with other random numbers.

";

const PICTURES: &str = "
## Pictures

";

const TAIL: &str = "
## What it gives up

What is left at low albedo is the depth of the first collision, and where the moved step finds no surface: horns and sharp edges. Order 1 is not
diffuse; where the reduced albedo is low it deserves its own stage. Light that leaves and enters again is in no row of this page.
`editable` with stored transport, `texture_space`, `filtered_normals` and Haar rows still hold the dipole, which is the default: planning without a method (`--method auto`) takes many times as long with calibrated kernels. `quantized_lights` and `all_frequency` move light by the mean of the steps of the three channels, since their irradiance is one for all.

Sharp corners are its hardest places: at those of a cube of 12 triangles (11 mm, marble) it is 8 to 13 % dark against hat means of walks on the same cube of
27,648 triangles, the dipole 35 %. They also take many samples: of a piece of surface nearby the single layer is integrated, but the height is its centroid's, and at a corner heights grow with the distance. At the
corners of a cube of 30 mm in skin1 1,024 samples are 171 % off 131,072 under the worst of the planner's lights, 16,384 28 % and 65,536 1.8 % (`bake cube.obj --model calibrated --report plan.json`), where dipoles need 1,024; that is why planning with calibrated
kernels fails on it.

Steps that are drawn, and their light thrown, are grain: the kernel is steep where light enters, and under a lone sun the drawing left 0.8 % (marble) to 1.7 % (skin1)
between 65,536 and 131,072 samples of bunny_3k. Fetching leaves 0.2 to 0.3 % and 0.1 to 0.4 %, and is nearer to the walks as well.

`editable` sums single layers over its nets as it sums dipoles, and double ones over nets of their own with four fields in place of one. Where those cannot resolve the
layer (samples more than two thirds of a mean free path apart) the hierarchy of `two_pass` sums in their place, which takes longer for each light.

`bake` adds a line `model` to the ledger: the error under a sun and under constant light, the worse of them, against walks that the calibration never used, over 256 places of
the surface. It is no part of the transport's total, which `--max-rms` is held against.

A new material, or another size, is calibrated when its light is first asked for, which takes some seconds; materials seen before are remembered. The window of `relight` shows the
dipole at once, says so, and calibrates in the background.
";

pub(crate) const WORDS: Words = Words {
    head: HEAD,
    before: &[("truth", TRUTH), ("unseen", UNSEEN), ("pictures", PICTURES)],
    places: &[],
    tail: TAIL,
};
