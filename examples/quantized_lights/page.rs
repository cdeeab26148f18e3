//! The page: what the paper says, what was measured, what does not hold.

use crate::common::runner::Words;

const HEAD: &str = "\
# Quantised lights: the figures of Hao & Varshney 2004 remade

`scripts/figures quantized-lights` measures everything on this page and writes it (`examples/quantized_lights/`; `--quick` tries
it in a minute or two, `--only PART` measures one part again). Models have a diagonal of 30 mm. Measured on 2 cores of an AMD EPYC,
2026-11-22, with next to nothing beside it (load 2 to 3, its own 2 included), by the program of that day; bakes were timed once. All but times and rates is the same
to the digit anywhere. How the method works
stands at the end.

**Image RMS**: linear RGB of the diffuse radiance, 256 x 256 pixels, one ray each, scaled so that the 99.5th percentile of
max(R, G, B) over the covered pixels of the reference's picture is 1, clamped to [0, 1]; the worst of 100 random views, under each
of 8 random directions that are the same for all sets and models. All in 1e-3; two numbers are the median and the worst light.
*With background* is the mean over all pixels, as the paper has it; *covered* leaves the background out; *one exposure* is with
background again, but all views of a light share their scale: without that, a view of the dark side is brightened until its own
highlights are white, and its errors with it. The paper does not say which of them it means.

## In short

| figure | the paper | wanted | measured |
| --- | --- | --- | --- |
";

const FIGURE5: &str = "
**What does not hold:** 3e-3 at 200 lights. Shadow edges move with the light, and between two lights of the set the edge
is in neither place; no kernel puts it where it belongs. So the error falls slowly with the number of lights (the powers are fitted
below each chart), whatever the interpolation, and it is largest where one part of a body shades another, as the legs of the horse
do. Three things were tried: smoother kernels (a dozen are compared in
`src/light/quantised/interpolation.rs`; they gain on lobes and nothing on edges), local shading taken out before
and added at run time (no gain; not remade here), and the vector integral Q (below). More lights are what helps: the default
encoding takes as many as the asked error needs, in less room than the paper's 200 (last section but one).

**Rates below 200 Mvertices/s.** Rates are medians of 200 lights. At best what an asset holds is read at 77 to 139 % of the rate of a copy: memory is the
limit, and small models pay for waking threads. Three things were done about it, together 2.5 times as fast: digits of 8 in place of 16 bits with integer
sums, coarser shares of the asked error for reference points and coding, columns that hardly lessen the error left out. What is left is fewer lights (200: 298
and 375) or a coarser error (skin1 at 3 %: 283 to 298 at best).

**20 bytes at 4e-3** hold under the first of the 8 lights, against `reference`. Under the worst of the 8 the same assets have 3.7 to 11, and only the dragon in skin1 stays below 4.

## Figure 5: image error against the number of lights

The paper: scalar integrals, four nearest lights, \"3e-3 with a set of about 200 for all the four datasets\". Measured with
values that nothing rounds, so that the interpolation is alone.

";

const ENCODINGS: &str = "
## One byte, harmonics, vectors (sections 3.1, 4, 4.1)

";

const PLACES: [(&str, &str); 4] = [
    (
        "@one-byte@",
        "Section 4. *Added* is against the same 200 lights unrounded (`rbf`). Bytes are RGB, entropy-coded on disk; one byte for \
         each value (600) in memory. Lloyd's table gains little over equal steps; either is far below the error of the \
         interpolation.",
    ),
    (
        "@harmonics@",
        "Against the truth. The paper stops at n = 7, \"visual quality close to the one without compression\". There is no \
         interpolation between lights here; what is missing are the high frequencies, and they ring: radiosity falls below 0 by \
         the share in the last column, before it is clamped.",
    ),
    (
        "@vectors@",
        "Section 3.1, 200 lights, unrounded; the paper finds the difference insignificant (5.26e-3 on its horse).",
    ),
    (
        "@table-i@",
        "Assets of the default encoding, 2 % asked. The paper has 79 frames a second for its horse (14,521 vertices), 14.6 for \
         Santa (75,781) and 2.7 for the dragon (437,645), grey, on a Pentium 4 of 2 GHz, and 18 to 27 bytes a vertex: 7.4 to 11.1 \
         times less than 200. Times are of a new direction, from the light to the RGB of all vertices; a picture comes on top. \
         *Of the bandwidth*: what is held in memory and the result (24 bytes a vertex), each counted once, over the best time, \
         against a copy. Above 100 % they come from the cache.",
    ),
];

const FIGURE9: &str = "
## Figure 9: image error against the number of reference points

The paper's own scheme (chosen by geometry, barycentric weights, n = 3 and n = 6), ours with the same storage (chosen by
illumination too, best triangle nearby), and the default encoding with as many reference points (`components`, its step for 2 %
asked). 200 lights. *Added* is against 200 lights unrounded with the same interpolation. With as many points `components` takes a
tenth of the bytes or less; from 4 % on its step is what is left. The claim that 1,200 points (0.8 %) with n = 3 beat n = 7 alone
takes about 2 % of the vertices here.

";

const FIGURE11: &str = "
## Figure 11: close-ups

The paper: \"even with about 1,200 reference vertices and 9 basis functions, the result is better than the one using 49 basis
functions alone\"; 5,176 (3 %) are \"almost indistinguishable from the original\". Light from the left and above; the ear's and
the head's shadow falls on the back.

";

const SWEEP: &str = "
## A light that turns

";

const COMPONENTS: &str = "
## The default encoding from end to end

Directional light; everything between the model and the picture counts: sampling, hierarchy, interpolation between lights,
reference points, quantiser. Bytes are all of the method's sections on disk, RGB. `reference` is brute force, under the first of the
lights; the other columns are under all 8 against `two_pass` with 262,144 samples.

The dragon in marble is the dearest, since its folds shade each other: at 2 % its radiosity takes 491 functions of the light
and 568 columns at 8,597 reference points, that of the bunny at 1.8 % 332 and 367 at 7,791. Coding is most of its error: 2.5 to 4.0
alone under the 8 lights (reference points 1.5 to 1.9, between lights 0.9 to 3.2, samples 0.9 to 2.0, all together 2.8 to
4.8, in 1e-3 with background). Sizes that are coded by what column and row lead to expect take 5 % of its bytes away, and 2.3 % asked is
enough. Other shares of the coding error (functions left out, their rounding, columns left out, a wider zero) save 1 % at the same
error at most; predictions shrunk by column and level would save 2 %, and are not done.

";

const POINTS: &str = "
## Point lights

Section 3.3 quantises the distance as well. From `tests/physics/quantized_point_lights.rs` (run with `TRANSLUX_LONG=1 -- --nocapture`): a
head of 20 mm in marble, 100 directions, 1 % asked, relative vertex RMS against `two_pass`; the light in a direction of the set, far
between them. Not remade by the command above.

| distance, bounding radii | 1e5 | 100 | 10 | 4 | 3 | 2 | 1.75 | 1.5 |
| --- | --- | --- | --- | --- | --- | --- | --- | --- |
| 3 shells (default) | 0.4, 1.2 % | 0.5, 1.1 % | 0.5, 1.1 % | 1.0, 1.0 % | 1.1, 1.0 % | 0.4, 0.9 % | 0.5, 1.1 % | 0.6, 2.0 % |

| shells, worst of 1.6 to 20 radii | 1 | 2 | 3 | 4 |
| --- | --- | --- | --- | --- |
| default (`rbf`, `polynomial`) | 13, 15 % | 2.1, 2.3 % | 1.1, 1.4 % | 0.6, 1.4 % |
| the paper's eight neighbours (`nearest4`, `linear`) | 13, 10 % | | 2.0, 11 % | |

Nearer than the nearest shell a light is refused. Shells nearer than 1.5 radii fail: 23 % and 70 % for lights 1.3 mm and 0.3 mm
above the surface, since directions from the centre do not describe them any more.

## How it works

**Stored:** radiosity at reference points under a set of lights: directions of a Fibonacci lattice and, where asked for, a few distances of point lights. Reference points are vertices with a
spacing, as wide as the error allows; nothing says which, since a reader chooses the same. The channels (of lights near the scene, channels and distances) are decorrelated, the directions replaced
by their principal components, the coefficients predicted from coarser reference points and coarser directions, quantised with one step and entropy-coded. Parallel light is a set of its own.

**At run time** a light becomes a few functions of its direction (a smooth kernel by default), these a vector over the columns. A reference point is a dot product with it, in integers; a vertex is a
weighted sum of ten reference points (local kriging). No rays, no tree: the material is baked in. Area lights are points that emit towards each reference point.

**In the bake** the transfer is computed once for 128 neighbouring lights and applied as a product of matrices (`transport/many_lights.rs`), at the reference points only. Visibility of all lights
comes from the silhouettes that a sample sees (`transport/visibility`). How many directions the error needs is measured with 200 at 768 vertices, under point lights too where they are asked for; where these are too few, with up to 400 more, which say how fast the error falls. What 1,600 cannot reach is said with the number that would, and the other stages are then as coarse as that lets them.

**The paper's encodings**, for comparison, are a program of their own, with all commands: `cargo run --release --example papers -- bake MODEL --method hao_varshney --set encoding=...`.
`encoding` is `raw`, `uniform8`, `lloyd8` (section 4; with `integral=vector` its Q, section 3.1), `sh` (4.1), `reference-points` (4.2).

**`encoding=bleeding`** (the same program) is the paper's two passes at run time (section 2.3): irradiance at every vertex, then a sum over the vertices within a range. The asset stores one range a medium, beyond which
a share of the total returns (`range-share`). The vertex itself counts as a disc of a third of its triangles' area, which the paper's pseudo code leaves out: 27 % of the radiosity of a head of 642
vertices. The lists are the price: all but 1 % of what returns takes 2.9 mean free paths in ketchup, 32 to 43 in marble, 273 in spectralon, so that a list of 10 % of the vertices leaves out a fifth of the
light of marble at 30 mm, and one that does not is the whole mesh. Vertices as samples lose light where normals change from vertex to vertex, and fail on graded meshes.

**Where it fails:** where shadows turn fast with the light, the interpolation between lights dominates (above).
";

/// What stands before each part.
const BEFORE: [(&str, &str); 6] = [
    ("figure5", FIGURE5),
    ("encodings", ENCODINGS),
    ("figure9", FIGURE9),
    ("figure11", FIGURE11),
    ("sweep", SWEEP),
    ("components", COMPONENTS),
];

/// Everything that the page says by itself.
pub(crate) const WORDS: Words = Words { head: HEAD, before: &BEFORE, places: &PLACES, tail: POINTS };
