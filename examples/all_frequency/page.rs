//! The page: what the paper says, what was measured, what does not hold.

use crate::common::runner::Words;

const HEAD: &str = "\
# All-frequency relighting: the figures of Wang, Tran & Luebke 2005 remade

`scripts/figures all-frequency` measures everything on this page and writes it (`examples/all_frequency/`; `--quick` tries it in a
minute or two, `--only PART` measures one part again). Models have a diagonal of 30 mm. Measured on 2 cores of an AMD EPYC on 2026-11-22 and 2026-11-23, by the
programs of those days; bakes were timed once, and a turned environment 200 times, of which the median counts. All but times and rates is the same to the digit anywhere.

**RMS** of radiosity: relative, area-weighted over the vertices, worst channel. The truth is `two_pass` with rays at every
light, twice, with samples and random numbers of their own: errors are means of `(x - a)(x - b)` over the two truths a and b, in which the noise
of either cancels (98,304 and 81,920 samples, 48 and 40 rays each towards an environment); where noise is stated, it is half of their
difference. *Mean* is the root of the mean square over lights. **Image
RMS**: linear RGB, scaled so that the 99.5th percentile of max(R, G, B) over the covered pixels of the truth is 1, clamped to [0, 1],
over covered pixels; in 1e-3.

## In short

| figure | the paper | wanted | measured |
| --- | --- | --- | --- |
";

const TABLE: &str = "
## Table 1: what a bake takes, what an asset weighs

Default assets (1 % asked), and the paper's own form: 128 Haar coefficients of largest magnitude on the texels of a 6 x 32 x 32 cube map.
With single scattering as well: *isotropic* beside the radiosity, *folded* into it, and *four terms* of a phase function; what is lit
up then is all of it.

";

const PAPER_TABLE: &str = "\
The paper, on a Pentium 4 of 2.53 GHz with a GeForce 6800 that renders visibility (megabytes over its vertices):

| | bird | buddha | bunny | dragon |
| --- | --- | --- | --- | --- |
| vertices, samples | 31,000, 150,000 | 56,000, 250,000 | 72,000, 300,000 | 78,000, 300,000 |
| pass 1 + pass 2, min | 6 + 5 | 20 + 13 | 14 + 12 | 26 + 16 |
| single scattering, isotropic / 4 terms, min | 14 / 17 | 67 / 73 | 42 / 48 | 102 / 108 |
| bytes/vertex | 645 | 661 | 653 | 654 |
| new environments a second | 25 | 14 | 12 | 10 |
| with 4 terms | 6.5 | 3.5 | 3 | 2.5 |

Passes are all runs of their stages, those that choose the order of the harmonics among them. What is *read* is what the asset holds in
memory and the result (24 bytes a vertex), each counted once, over the median time; the same environment is turned, so that its projection on
the harmonics is made once.

Two cores of an AMD EPYC with AVX2 (family 25, model 1, 2.45 GHz), where a copy is as fast as on the machine that this table was first made on and
everything else takes 2.5 to 3 times as long: the program of that day, which took 42 s for the first bake there and turned an environment in 0.30 ms,
takes 103 s and 0.91 ms here, and the present one 28 s and 0.77 ms.";

const LIGHTS: &str = "
## Every environment, turned, and suns

Default assets. Half of the energy in a sun: constant light and parallel light of the same energy, 32 directions that no choice of
the bake saw.

";

const BASES: &str = "
## Wavelets and harmonics

The paper: \"keep 128 (about 2 %) wavelet coefficients\"; \"by keeping an appropriate number of wavelet coefficients at each level, the
artifacts are unnoticeable\". Marble; each map of the data at one turn, and half of the energy in each of 12 suns. Haar rows keep the
coefficients of largest *magnitude*, of largest magnitude times *expected light*, or those above one threshold for all vertices (*rate*);
the transform is orthonormal on the texels, as the paper's, or under their solid angles. Harmonics are coded over reference points.

";

const CODING: &str = "
## What each step of the coding saves

The paper keeps every vertex's row by itself. Here each step is taken alone, on one set of rows, marble, with the harmonics up to order 16:
digits of one step, every column as wide as its widest digit (*fixed width*); the asset's entropy coder; decorrelated channels and principal
components of the light in place of harmonics; rows *predicted* from coarser points; *reference points* alone, the rest interpolated.
*Clusters and differences*: cells of a kd-tree, rows moved where another cell fits better; its mean (predicted from other means), its principal
directions, weights and what is left, all entropy-coded, steps and sizes as take the fewest bytes. *Clustered PCA* (Sloan et al. 2003) leaves the
differences out.

";

const CODED: &str = "\
Each cell: bytes/vertex, the RMS that coding adds (against the same rows uncoded at every vertex), and the RMS in all (against the truth), means
over the maps. The last columns: what a light is multiplied with at 1 % asked; bytes at the error that the default adds, between the points
on logarithmic axes, and over the default's. Reference points 0.7 as far apart with twice the step take fewer bytes than the default for the
same mean error, and more numbers for each light; but a bare sun needs the finer step: skin1 under noon_grass, 10.7 bytes and 1.24 % in
place of 16.8 and 1.05 %. So the default went the other way after this section was measured: shares of the error of 0.15 for coding and 0.44 for
reference points (0.19 and 0.42 here), 22 bytes and at most 0.97 % for skin1 (first section). Interpolation itself has little left: 16 points in
place of 10 lower its error under suns by 6 %, smoother kriging raises it.";

const FIGURE5: &str = "
## Figure 5: single scattering by four ways

";

const FOUR_WAYS: &str = "\
From the left: (a) by rays along the refracted way from the eye, 128 distances a pixel at random under a sun, 1,024 directions with
a distance each under an environment; (b) the same along the inverse normal; (c) the paper's 16 deterministic distances along the
inverse normal; (d) baked: cube-map vectors of every vertex with shared samples, whose light is the mean over texels. Rows as in the
table, which has image RMS; *(a) again* has other random numbers: what is noise. The paper: (c) \"qualitatively matches the true answer in (a)\".

Below the pictures, what sharing costs. Under a sun as large as a texel 1 % is not reached: along the path each of six Gauss points meets
another facet, fold or shadow, and the paper's 16 samples are themselves more than 1 % from 64. More depths, a finer tolerance, texels
cut in four and shadow boundaries found between depths were tried: 1.3 to 1.7 % at 7 to 12 times the cost.";

const FIGURE6: &str = "
## Figure 6: phase functions of few terms

";

const PHASE_FUNCTIONS: &str = "\
Henyey and Greenstein's function over all pairs of directions. *Legendre* are real spherical harmonics with the moments g^l, K terms;
*SVD* is the paper's decomposition of a table of 6 x 16 x 16 directions, here weighted by solid angles. Below 0 no phase function makes
sense; energy is the integral over the directions of the light, for 24 directions of the eye, and should be 1.";

const PHASE_PICTURES: &str = "\
Single scattering along the inverse normal of the paper's synthetic material (sigma_s 0.75 0.85 1.00, sigma_a 0.02 0.04 0.07 per mm, eta 1.3),
a sun from the right; rows g = 0.25, -0.25, -0.4, 0.7, 0.9, columns K = 1, 4, 8 (SVD), 9, 16 and the exact function by rays. Image RMS
against the latter; whole bands by their Legendre series, which the SVD reproduces. The last column is what the path along the
inverse normal costs by itself.";

const BETWEEN: &str = "\
The same suns moved within their texels. A texel's light is spread over the texel and meets transport that is its mean: a sun at the centre is
smeared, one between four centres is moved by half a texel (1.4 degrees at 6 x 32 x 32) as well, and with it every shadow. Scattering blurs
most of that; what 128 coefficients leave out of a single texel weighs more. Harmonics know no texels; what they lack is order.";

const CONTACT: &str = "\
Where occluder and receiver nearly touch, visibility turns within less than a texel, and its mean over the texel is all that is known. Yet
finer texels gain almost nothing: coefficients or order run out first, for the whole as for the contact.";

const FORWARD: &str = "\
Figure 6 has the pictures. Each further band takes 2 l + 1 more vectors for a factor g: 144 terms, 144 times the data of an isotropic
asset, still do not hold g = 0.9. Such a function is to be evaluated directly, by rays, for the few lights there are.";

const THIN: &str = "\
The way inside and the light's way end where the other part begins: d_m is the distance to the other block, not to the end of the medium,
and a second boundary is occlusion. Two cubes of 4 mm against one block of 8 mm, single scattering at points of the outside, 128 distances;
*in the mean*, what is too much or too little of the light. Short mean free paths lose little but at the joint; with long ones a third to
a half of the light is missing. Attenuation in the other block (`--set single-crossings=attenuated`) gets some of the light back, not the way inside:
parts that share a medium and touch belong in one (`--parts auto` joins them).";

const OPEN: &str = "\
Half a ball of radius 10 mm with the disc that closes it, and without; RMS at the shell's vertices against `two_pass` on the closed one. Light
enters and leaves on the front of what is there; what would enter through the missing disc is missing, and so is its boundary.";

const BEFORE: [(&str, &str); 12] = [
    ("table", TABLE),
    ("lights-marble", LIGHTS),
    (
        "lights-skin1",
        "
",
    ),
    ("bases", BASES),
    ("coding", CODING),
    ("figure5", FIGURE5),
    ("figure6", FIGURE6),
    (
        "suns",
        "
## Where it fails

### Suns between texels

",
    ),
    (
        "contact",
        "
### Contact shadows

",
    ),
    (
        "forward",
        "
### Strongly forward phase functions

",
    ),
    (
        "thin",
        "
### Thin media in parts that touch

",
    ),
    (
        "open",
        "
### Open meshes

",
    ),
];

const PLACES: [(&str, &str); 10] = [
    ("@paper-table@", PAPER_TABLE),
    ("@coding@", CODED),
    ("@figure5@", FOUR_WAYS),
    ("@phase-functions@", PHASE_FUNCTIONS),
    ("@phase-pictures@", PHASE_PICTURES),
    ("@between@", BETWEEN),
    ("@contact@", CONTACT),
    ("@forward@", FORWARD),
    ("@thin@", THIN),
    ("@open@", OPEN),
];

const HOW: &str = "
## How it works

**Serves** light from far away: environments, constant light and suns. Point and area lights are refused.

**Stored** by default (`basis=sh`): radiosity at reference points under the spherical harmonics of the light, up to order 32, coded as `quantized_lights` is (`forms/projected`): channels
decorrelated, harmonics replaced by the principal components of the transport, coefficients predicted from coarser reference points, one step, entropy-coded. With `basis=haar` a sparse row of Haar
coefficients for each vertex, the paper's form.

**The two passes.** Pass 1: what each texel of a cube map adds to the irradiance of each surface sample, the mean over 2 x 2 sub-texels, visibility from silhouettes. For harmonics these are projected, one
octant for each parity; for Haar transformed and cut. Pass 2: for harmonics a product of matrices through the hierarchy, at the reference points alone; for Haar the paper's tree, whose nodes hold sums of
rows with a bounded number of coefficients.

**Single scattering** (`single-scattering`): for each texel what its light adds at a point, along the inverse normal and in the physical form, with rays that depths and directions share. *isotropic* is `s`
beside the radiosity, at reference points of its own or in Haar rows (`single-basis=haar`); *folded* is added to the radiosity before it is coded; *phase* keeps K vectors, summed at run time with the view's
harmonics, so that g stays free (its directions, not the extinction that was baked). Where 16 terms are not enough (|g| from about 0.55 on) nothing is stored, and pictures trace it.

**Inter-reflection** (`inter-reflection=once`): the transport of the first 36 harmonics is sent out, gathered by 32 rays of each sample and transferred again.

**At run time** a light is projected on the harmonics once; a turn of an environment turns pairs of coefficients. What follows is a dot product for each reference point and a weighted sum for each vertex.
The material is baked in.

**What `--max-rms` means.** The error under environments; with half of the energy in a sun twice that, and under a sun alone four times. So a sun alone is off by 3 to 4 % at the defaults:
`quantized_lights` is made for such light. Refractive indices below 1 reflect totally from an angle on, which the polynomial of F_t holds to 15 %.
";

/// Everything that the page says by itself.
pub(crate) const WORDS: Words = Words { head: HEAD, before: &BEFORE, places: &PLACES, tail: HOW };
