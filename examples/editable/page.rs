//! The page: what the paper says, what was measured, what does not hold.

use crate::common::runner::Words;

const HEAD: &str = "\
# editable: the figures of Wang et al. 2008 remade

`scripts/figures editable-page` measures everything on this page and writes it (`examples/editable/`; `--quick` tries it in a few
minutes, `--only PART` measures one part again). Models have a diagonal of 30 mm. Measured on 2 cores of an AMD EPYC (Zen 5: family 26, model 2),
2026-11-23; figures 3 and 4 and the environments on Zen 3 (family 25, model 1), half as fast. The machine was shared: the same program
took up to a third longer from one minute to the next. All but times is the same to the digit anywhere. How the method works stands at the end.

**RMS**: relative to the truth's RMS over the area, worst channel, under one directional light; the truth is `reference` with
262,144 samples of its own, so that sampling is part of every error.

## In short

| figure | the paper | wanted | measured |
| --- | --- | --- | --- |
";

const TABLES: &str = "
## Tables 1 and 2: bakes, bytes, rates

Beethoven and the gargoyle have their longest edges cut until they have the paper's 16K and 64K vertices. The environment's rows are left out (`--for-lights directional`), as in the paper's sizes. *Stored* asks for 1 %, which is
what a bake aims at by default, *nothing stored* (the default form) for 0.5 %; both with `--set points=1`. Edits turn skin1 into skin2 and back; a new refractive index costs what a new light does. They are
prepared, as in the window: the stored form keeps light around the vertices ring by ring, which takes 0.4 s and 48 MB on the closed bunny (`cargo bench --bench
editable`), and its errors are those of edits so prepared. The paper states no errors against a
truth, but that 95 to 98 % of the energy is kept, which is an error of 14 to 22 %.

**Nothing stored** beats the stored form in bytes (6 to 16 times fewer) and bakes in a third to a fifth of the time. The stored form is 1.5 to 2 times as fast for a
new light, and 19 to 25 times as fast for a new material. Each rate is the median of seven lights or edits of one run; another run within the hour had 55 new lights and 983 new materials a second
for the stored gargoyle, fewer than the 60 lights that are wanted.

What is wanted of nothing stored is <= 40 bytes/vertex at <= 0.1 %. The table asks for 0.5 %: 11 bytes, 0.33 % off. At 0.1 % asked the gargoyle takes 17 bytes/vertex; its bake
states 0.052 % for the transfer and 0.008 % for sampling, under the probe lights and in marble (`bake --method editable --size-mm 30 --material marble --samples 196608
--max-rms 0.1% --for-lights directional`, 9 s). That is the bake's own figure, and not one against the truth in four materials as the table's.

";

const TOGETHER: &str = "
### Light and material at once, nothing stored

What a visible change of everything costs with the default form. The error is what `evaluate --measure` states: samples and transport, under one directional light.
Dense media (spectralon) read more of what is near. The table has medians of three runs on 2026-11-24 with nothing beside them (`scripts/figures editable-page --only together`), in
which the median material had 46 to 48 a second at 0.5 % and 18 to 19 at 0.1 %. Seven runs of the day before, beside other work, had 32 to 44 and 13 to 17, spectralon 17 to 27 and 7 to 11.

";

const FIGURE3: &str = "
## Figure 3: more and more basis functions

";

const FIGURE4: &str = "
## Figure 4: the basis

The bases here are made for the same task with 12 functions each. The least T1 is that of principal components (`basis=transported`). The default, a ladder of Gaussians, is not below the 0.2 % that are wanted at
12 functions; it is the default because it takes fewer bytes at the same error of radiosity (*The transfer side*), and a bake takes as many functions as its asked error needs.

";

const FIGURE5: &str = "
## Figure 5: compression in space

The paper transforms each column of its transport by CDF 9/7 over a geometry image. Here the far part of a function, which is smooth inside the
split radius, is stored at points that are some sample spacings apart, of any mesh, and interpolated; the near part is never stored.

";

const TRANSFER: &str = "
## The transfer side: basis and packing

Stored forms of Beethoven with 16,384 vertices and 65,536 samples, the worst of ketchup and chicken1. *Ladder*: the far parts of
Gaussians whose widths are a geometric sequence, combined without negative coefficients. Each function is stored at points of its own spacing
(`--set far-levels`): the narrowest at all of them, others at points twice, four or eight times as far apart, as the error allows; *one spacing*
has every function at all points. The spot is a point light 1 mm from the surface. *T1*: the transported error of the basis, worst of the 36
channels of the measured materials and of 200 others, for this object and its own split radius (figure 4 has another object and split).

The ladder is the smallest at the same error and the default: most of its functions are wide and need few points, and at one spacing its functions are
alike at every node, so that each says much about the next. Principal components oscillate down to the shortest lengths, so that few of them can do
with fewer points. The ladder keeps totals exactly. It does not do away with negative radiosity: what is left of it comes from dropped coefficients and
from interpolation, not from the basis.

";

const SPATIAL: &str = "
## Transforms of the columns

A column is what one Haar coefficient of the samples adds to each vertex, for one basis function. It is stored as it is, transformed
over the vertices, or stored at fewer points and interpolated: CDF 9/7 (`examples/editable/cdf97.rs`) over a geometry image as in the paper, for shapes that have
one; lifting on nested points (`examples/editable/surface_wavelet.rs`: prediction by kriging, an update that keeps the integral) and points with kriging on any mesh.
What is above one threshold is kept and rounded to steps of it. Errors are relative RMS over the vertices, of the worst of three lights.
Bytes are 4 for each coefficient, as the paper counts, and in brackets the entropy of the rounded numbers, by levels of the tree over the samples. 4,608
samples; the geometry images have 48 x 48 vertices, 1.4 sample spacings apart as those of the gargoyle above are.

**In short.** For all functions of the far part, at 1 % of the far radiosity, CDF 9/7 takes 0.2 to 0.35 of the bytes of every vertex, and lifting 0.2 to 0.25,
on any mesh. Points with kriging take about what lifting takes (by entropy 87 bytes at 1.8 % on beethoven and 80 there; 86 at 1.8 % on the bunny and 78 at 1.4 %), down
to an error that more coefficients do not lower; it is one of the far part, a share of the whole, and `editable` chooses the distance by it. Points stay the
stored form's default on any mesh because they save more than bytes: their columns are baked, kept in memory and multiplied with the light at a fraction of the
vertices (figure 5, 1 % asked, 4 spacings apart: an eighth of the bytes, a new light 18 ms in place of 50), where lifting has those of every vertex to transform, and its sums to transform back for each
light. Lifting the points as well saves for kernels of eight vertex spacings and more alone. Kernels of one vertex spacing and less lose by any
transform, and marble's whole dipole gains a fifth at most: their columns are best left as they are. The paper's 95 % of the energy is an error of 4 to 10 %, 98 % one
of 3 to 7 %, with negative radiosity; 1 % takes 99.9 %.

";

const ENVIRONMENT: &str = "
## Environments

Rows of Haar coefficients give the irradiance of every sample under a cube map of 6 x 32 x 32 texels. The paper transforms these over the surface
too. *Of their own*: each sample keeps its largest coefficients. *In blocks*: the rows of 64 neighbours are Haar transformed over their tree
(`compress/row_blocks.rs`), under one threshold whose squared error is that of the number of coefficients named. Errors are relative RMS against all
coefficients: of the irradiance of all samples, and of the radiosity that follows at 192 vertices in two materials, the worst map.

At equal numbers blocks err more in irradiance and less in radiosity: what is dropped has no mean over a block, and scattering takes means. So blocks are what
`editable` stores.

";

const PROFILES: &str = "
## Profiles against a random walk

The truth here is a random walk through the volume (`reference --model monte-carlo`; g = 0, eta 1.3, 60 free paths across, noise
taken out), which knows the shape and every order of scattering. Of each profile the RMS of what it differs by, and the mean of the
difference: positive where it is too bright. Any of them is put in force by `--profile` on the same asset. The total of the dipole is near
that of all orders. The others state multiple scattering alone and want single scattering beside them: on a ball the better dipole and Burley's profiles are 4 to 10 % off it at any
albedo, photon beams 4 to 5 % from an albedo of 0.8 on but 12 % at 0.6 and 24 % at 0.3; the dipole is 5 to 351 % off. What is left on the bunny is its shape: none of them knows that it is not a half space.

";

const FIELDS: &str = "
## Area lights through source radiance fields

An area light with `field=32` casts no rays. What it sends is precomputed in cube maps at points of spheres around it (Zhou et al. 2005, as
the paper has it), and the irradiance of a sample is the product of its row, which is there for environments, with what the eight maps
around it in the field hold. Rows in blocks are decoded first, which is in the times. Errors are RMS, of the irradiance of the samples and, after the comma, of the radiosity: of each step
against the next more exact one, and of everything against shadow rays (256 strata, 16 points of a sample).

Interpolation costs less than the rows nearly everywhere. Rows smear what is smaller than a texel: a light of 2 mm 100 mm away is a sun to
them, and finer rows mend that (last column). That a row is seen from one point of its sample costs most in irradiance, and little in
radiosity, because scattering averages it.

";

const PLACES: &[(&str, &str)] = &[
    ("@fields-walls@", FIELDS_WALLS),
    ("@fields-times@", FIELDS_TIMES),
    (
        "@figure3@",
        "Above marble, below potato; from the left 1, 2, 4, 8 and 12 functions, and the truth. Grey: refused, because the material could be \
         more than 10 % off. The near field does not go through the basis here, so that few functions do better than in the paper.",
    ),
    (
        "@figure4@",
        "Maps over sigma_a (to the right) and sigma_s' (upwards), both 1e-6 to 5 per mm; blue is an error of 1e-8, white 1e-4, red 1. From \
         the left: the paper's basis of whole profiles with 12 terms, L2, and L-infinity, both relative to each profile; \
         T1 of the far parts for an object of 50 mm with the paper's weights; the same with `basis=transported`.",
    ),
    (
        "@figure5@",
        "From the left: every vertex, points 2, 3, 4 and 6 sample spacings apart, each asked for 1 %; the truth.",
    ),
];

const FIELDS_WALLS: &str = "\
Rows know which directions are open, not how far: what stands behind the light shadows it as if it stood before it. The same light, with a
wall of 40 x 40 mm behind it:";

const FIELDS_TIMES: &str = "\
Times on two cores, medians, a light of 6 mm 10 mm away. A turned light is another field, because maps are in world axes as rows are; moving,
growing and dimming it are free. Within 1.4 half diagonals of the light a sample has a map of its own. Where those are many, and the light fills much of them,
that takes twice the time of shadow rays (last rows): leave `field=` out there.";

const LIMITS: &str = "
## What limits the rates

Two cores with AVX-512 (AMD EPYC, Zen 5: family 26, model 2). A processor with AVX2 (family 25, model 1, 2.45 GHz), before the steps that name the gargoyle below, had 19 new lights and 359 edits a
second of the stored gargoyle, and 14 (71 ms) and 6 (159 ms) changes of everything with nothing stored. A new light of the stored gargoyle takes 15 ms here (`cargo bench --bench editable`):
a third for a ray from each of the samples that face it, a third for the light on the rings, 8 million samples near some vertex, a sixth for the far field; the rest is what an
edit does and the transform of the light. It is of one colour, as is that of one light: a red and a blue sun together, of three channels and with twice the rays, take 22 ms. Tried:

- one ray for a sample (`--set points=1`) in place of four, or 36 where these see light and dark: 106 ms became 37 (closed bunny, AVX2). The gargoyle takes 58 ms with four, which is the default, and 15 with one.
- R_d of near points by tables of quadratic polynomials, and the triangles of 16 neighbouring vertices side by side: an edit of the closed bunny took 19 to 32 ms, in cream, whose
  free path is short against the samples, 52 (AVX2), and is what `evaluate` still does.
- the light around each vertex on 20 hat functions of r^2: an edit is a product, 1.0 to 1.5 ms in any medium (AVX2), 3e-4 to 5e-4 of the light off. Rings between which light was
  constant, near triangles split down to the innermost one, took 98 s to prepare for 2,562 vertices; triangles that meet them in closed form 0.5 s for 34,835.
  Near triangles as points from three radii on, in place of 4.2, are 1.9e-3 off.
- light gathered on the hats sample by sample, each with as many as it meets: 24 ms of a new light. Eight hats side by side, with nothing to decide: 9 (AVX2). Windows of hats that overlap, so that
  most samples are in one, keep less and are slower (gargoyle: 4.8 ms became 5.8).
- gargoyle: normals and centroids beside the samples in place of triangles of the mesh, and one channel for light of one colour: 27 ms became 21.
- gargoyle: values of the far field one function after the other, rows of rings asked for before they are read, four samples to a call in the transform of the light: 21 became 17. Two sums taken in turns help
  the far field, and not the rings; both at once are no faster than one after the other.
- gargoyle: what enters at many samples side by side: 16 became 14.
- the stored gargoyle's bake with rows for environments and four rays a sample (`bake --method editable --set transport=stored --size-mm 30 --material marble --samples 131072`): 45 s
  became 33, and 0.8 GB 0.6; 67 s on Zen 4 (family 25, model 17) before that, where it was not repeated. Of the 33, 10 are the rows, 6 the errors of environments, 5 the transport, 4 the ledger, 3 the
  choice of points and 2 that of the threshold. What helped: sums over all pairs for choices and for the basis's error from four neighbours merged into one source (24 s became 16
  without rows; the errors found differ by a twentieth at most), every light at once, the near field that errors are relative to from rings, coefficients that nobody misses dropped
  without being sorted. The norm of errors from the first few groups of points alone made bytes depend on which those were.
- what is near in 8 bits of a sample's area, but for the innermost hats, and samples by their number in the list of a group: the gargoyle takes 154 MB in memory in place of 232; a new light
  takes as long as before here.
- nothing stored, dense media: facets and pieces of the samples near a group of vertices made ready once for the whole group, and looked up four points at a time: 101 ms became 88
  at 0.1 % asked (closed bunny, spectralon); at 0.5 % nothing is gained. Ready side by side for vectors of eight, they were slower: each vertex needs few of them.
- nothing stored, light and material new at once: kriging of the nets from 32 points, and a softening that the bake measures: 289 ms became 134 at 0.1 % asked (AVX2). Fewer points or a coarser
  softening miss what was asked.
- rings for the nets, whose near field is all around a sample's own spacing: 0.06 to 0.34 % off, but light took three times as long to gather as to sum (8 to 11 ms in place of 3 for 2,562
  vertices). It is not part of the program.

## How it works

**Nothing stored** (the default) keeps the samples alone. At run time a kernel is softened inside a radius of a few sample spacings. The softened part is summed over nested nets of
surface points, whose weights (kriging from 32 of them) hold for every kernel; the rest is summed sample by sample (`transport/multilevel`). The bake measures against all pairs how wide
the radius has to be. Profile, size and receivers stay free; a new material costs the sums again.

**Stored** (`--set transport=stored`), as in the paper:

- *Split.* R_d is split at six sample spacings (`split`). Beyond, and continued to the centre as an even polynomial, it is the smooth far part, which goes through the basis. The rest is
  integrated at run time over the samples around each receiver with the actual profile. A sample that a shadow boundary crosses is cut in 16 pieces.
- *Basis.* Far parts of Gaussians whose widths are a geometric sequence; a material's coefficients come from non-negative least squares and keep its total. As many functions as the asked
  error needs, at most 16. `basis=transported` has principal components, `basis=plain` those of the paper.
- *Points.* The far part is stored at some of the vertices, about four sample spacings apart (`far-spacing`), wider functions at fewer of them (`far-levels`); the others take what kriging
  makes of the 32 points around them.
- *Transport.* The samples lie in the order of a balanced tree. For groups of 16 points each function's row is integrated hierarchically and expanded in Haar functions of the tree, whose details
  vanish under constant light. One threshold for all coefficients is the largest that keeps the asked error for every published material; what is kept is rounded to 8 or 16 bits and entropy-coded.
- *Edits.* A window asks for edits to be prepared: the near part becomes a sum of 20 hat functions of r^2, so that an edit is a product, 3e-4 to 5e-4 of the light off. `evaluate`, `render` and
  ledgers integrate the near field itself.

**Environments**, unless `--for-lights` leaves them out: irradiance of every sample over a cube map (`cube`), visibility from silhouette edges, in Haar coefficients of 8 bits, with F_t in two
functions of the angle so that eta stays free in 1 to 2. Directional and point lights always cast rays; area lights do, or take a source radiance field with `field=32`.

**Where it fails**

- A sun is smaller than a texel of the cube map. Bake with `--set cube=64 --set coefficients=512`, or leave environments out of `--for-lights` so that rays sample them, or use a directional light.
- An area light with a field has something behind it (above), or is smaller than a texel.
- A material is so far outside 0.02 to 25 per mm (sigma_s') and 0 to 2 per mm (sigma_a) that its projection could be more than 10 % off: the stored form refuses it.
- The object is larger than a thousand free paths: shadows are drawn at the samples' spacing.
- Radiosity may be slightly negative where hardly any light arrives; it is not clamped, so that lights add up.
";

pub(crate) const WORDS: Words = Words {
    head: HEAD,
    before: &[
        ("tables", TABLES),
        ("together", TOGETHER),
        ("figure3", FIGURE3),
        ("figure4", FIGURE4),
        ("figure5", FIGURE5),
        ("spatial", SPATIAL),
        ("transfer", TRANSFER),
        ("environment", ENVIRONMENT),
        ("profiles", PROFILES),
        ("fields", FIELDS),
    ],
    places: PLACES,
    tail: LIMITS,
};
