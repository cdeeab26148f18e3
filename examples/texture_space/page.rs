//! What the page says around what was measured.

use crate::common::runner::Words;

const HEAD: &str = "\
# Texture space: Chang et al. 2008, measured

`cargo run --release --example texture_space -- ../shared/data docs` measures everything on this page and writes it
(`examples/texture_space/`; `--quick` tries it, `--only PART` measures one part again). Times are those of the machine that wrote
the page and of what else it did; everything else is the same anywhere.

The asset holds a texture atlas and nothing else: no transport, no material, no light. At run time light falls on the surface as the texels
cut it, the mip-map of the texture sums it up, and few samples of it bring radiosity to each place: `B = Sum flux R_d(r)`.

- **The cut is exact.** Each triangle is cut by the texels that it touches, and each piece has its own area and irradiance: the map holds what falls on
  the surface, however small the triangles are, and the Jacobian of the map is exact for each piece.
- **`sampling=shared`** is the paper's: N samples by irradiance at equal steps of its sum in the order of the mip-map, shared by all places. What
  it gets wrong is structured: a sample that stands for too much is a bright spot on the surface.
- **`sampling=clusters`** shares N points as well, but they stand for all of the light: boxes of texels of about the same second moment of
  flux, each at the mean place of its light.
- **`sampling=product`** (the default) is what the paper left to do: samples by the product of irradiance and R_d. Each group of up to 64 neighbouring places descends
  the boxes to those that are right as points to a limit, which is set so that there are N in the mean; 16 such groups look at the top together. Patches nearby are polygons, over which R_d is integrated.
  The boxes are in space: squares of the texture hold charts that are far from each other on the surface, and at 400 samples they are three times as wrong.
- **`sampling=hybrid`** is the paper's second method: R_d is divided in two, the far part goes through shared samples, the near one through an image of the
  irradiance as the light sees it, at 20 circles of 20 samples and one in the middle. The far part's samples are clusters, or with `--set far=drawn` the
  paper's. A pixel of the image is a piece of the plane of its triangle, not a point. Directional and point lights alone.
- **On an adapter** (`--device gpu`) all of it runs in shaders: rays for the shadows of every kind of light, the mip-map level by level, draws, descents, and both parts of
  the hybrid method with its image. Clusters alone are chosen on the processor, from the light of the nodes, which is read back. Radiosity is the processor's to 2e-7 RMS,
  the hybrid method's to 5e-5, where rays through the middle of a pixel meet an edge (`cargo test --release --lib texture_space::device -- --nocapture`, on lavapipe;
  times on another adapter are among the [figures](figures.md#on-a-graphics-adapter)).
- **The atlas** is the model's own texture coordinates where nothing overlaps, else charts of our own (`--set map`).

| figure | the paper | wanted | measured |
| --- | --- | --- | --- |
";

const SAMPLES: &str = "
## Samples

RMS of the covered pixels (diffuse light, from the default eye, 512 x 512; see *image error* in the [glossary](glossary.md)) against exact sums, and over the vertices in
parentheses; the worse of two lights, from the front above and from behind. The paper compares with two-pass pictures, tone-mapped, of its own eye and light.

";

const HYBRID: &str = "
## The hybrid method

";

const MAPS: &str = "
## Maps

1,600 samples. *Area ratio* is a triangle's area in the map over that on the surface, over the mean. The worst vertex is that of the light from the front.

";

const SPEED: &str = "
## Speed

Marble; medians of 5. A new light is shadows, the mip-map, samples and sums; a new material the samples that depend on it and the sums. Pairs are samples times
vertices. On two cores that nothing else used, but for the last row, beside which a build began; they were about half as fast as those of other pages: the ratios between rows say more than the times.

- `shared` and `clusters` with 25,600 samples are nothing but pairs, 296 and 309 million a second, and the limit here. `product` makes 206 to 250 million, 1.2 to 1.5 times
  below (1.5 was wanted), and needs a sixteenth of the samples of `clusters`.
- At equal time a new light by `product` is better than by `two_pass` where 0.3 % is enough (0.27 % in 106 ms beside 0.38 % in 177 ms), and as good at 0.09 % (287 and 272 ms).
  The truth is `two_pass` as well, at 0.5 %: that row is all but the truth itself, and what is below 0.15 % is hardly told apart.
- Exact sums are those of `two_pass` over all pairs, integrals over whatever is near included.
- The software adapter makes 0.22 frames a second with 400 shared samples, 0.17 with `product`, where the processor makes 10 and 9: there `--device auto` keeps
  transport on the processor. Times on a graphics adapter are among the [figures](figures.md#on-a-graphics-adapter).

";

const REUSE: &str = "
## Between frames

`relight --reuse` keeps what lights that move leave. Of each 64 patches side by side in the texture 8 are looked at in a frame, and all where one of these has changed or where
patches in light and in shadow are side by side; what a patch gets without shadows is computed anew. `product` tries its limit of before first. `shared` keeps its draws for up to 8 frames:
their texels alone are lit, and weighted by their light over the probability of their draw, in which a tenth is by area; where few come to stand for much, all is
drawn anew. Views that rest keep what the last frame had; a light that is set, not moved, is always all anew. On an adapter shadows and limits are kept, draws are not.

Processor time of a frame, the mean of 16 (adapter 3), marble, a parallel light; errors against sums over 6,400 sources. Draws cost a tenth of the error and save all light but
theirs. Kept shadows save little on a processor, where rays are a small part of the light in the texels; on the software adapter a seventh to a quarter of the frame.

";

const PICTURES: &str = "
## Pictures

";

const TAIL: &str = "
## Bakes on defaults

A bake makes the atlas, doubles the number of samples until the error under a few suns and a constant light is half of what is asked for, and measures both errors under lights that it did not choose by: the texels'
against exact sums over as many samples as triangles at least, the samples' against all texels. Under skies an area of texels needs as many rays as it has samples in other methods, not as many as it has texels: 64 of each piece of a texel, down to 8
where there are millions of pieces.

`translux bake MODEL --material skin1 --size-mm 50 --method texture_space` (the cube: 30 mm); measured: the worst RMS against `reference --samples 150000` under a sun from (-0.7, -0.1, 0.7), constant light, the
built-in sky, `debevec_grace_1k.exr` and `noon_grass_1k.hdr`. Processor seconds, beside other work; igea_full against `two_pass --max-rms 0.1% --samples 268686`.

| model | vertices | samples | ledger: texels | samples | measured | bytes/vertex | processor seconds |
| --- | --- | --- | --- | --- | --- | --- | --- |
| cube | 8 | 1,024 | 0.46 % | 0.23 % | 0.77 % | 158 | 2.1 |
| suzanne | 507 | 2,048 | 0.62 % | 0.10 % | 0.77 % | 8.9 | 8.1 |
| bunny_closed | 34,835 | 1,024 | 0.24 % | 0.29 % | 0.38 % | 2.5 | 19.1 |
| igea_full | 134,345 | 1,024 | 0.33 % | 0.28 % | 0.50 % | 2.3 | 28.8 |

## What it gives up

A place sees the light of a texel as one irradiance: shadow boundaries are as sharp as the texels. The error of shared samples is largest where they are
sparse and the material lets little light through: there each of them is a spot. `product` has no spots, because what is near to a place is
always resolved for it. (Below 64 samples the groups are of 16 places: groups of 64 saw little but themselves, 32 % off in skin2 on santa with 49 samples, where those of 16 are 4 % off.)

R_d and F_t are computed where they are used, not looked up, and have no error of interpolation; the one table is that of the near part of the hybrid method, linear between 4,097
distances: at most 5e-5 of its flux, and 1e-3 in spectralon (`cargo test --release --lib the_table_of_the_local_part -- --nocapture`).
";

pub(crate) const WORDS: Words = Words {
    head: HEAD,
    before: &[
        ("samples", SAMPLES),
        ("hybrid", HYBRID),
        ("maps", MAPS),
        ("speed", SPEED),
        ("reuse", REUSE),
        ("pictures", PICTURES),
    ],
    places: &[],
    tail: TAIL,
};
