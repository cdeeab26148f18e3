//! What the light of each texel of a cube map adds to the irradiance of a sample, before any basis: `V F_t(mu) mu`, the mean over
//! 2 x 2 sub-texels, for the medium that the sample belongs to.

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use crate::light::harmonics::to_harmonics;
use crate::math::cube_map::{FACES, FRAMES, centre, direction, solid_angles_sr, texel_of};
use crate::math::sh::real_sh;
use crate::medium::entrance_basis::{DEGREE, polynomial};
use crate::progress::Progress;
use crate::transport::many_lights::IrradianceRows;
use crate::transport::scene::Surface;
use crate::transport::simd::{Level, multiversion};
use crate::transport::visibility::{GROUP, Observer, Occluders, Resolution, Visible, visit};

/// Samples whose rows are multiplied together.
const BATCH: usize = 4;

/// Functions of a block of the product.
const COLUMNS: usize = 16;

/// Where the sub-texels of a face are.
pub(super) struct Grid {
    /// Texels along an edge.
    pub(super) side: usize,
    /// For even and for odd columns, `s` of the sub-texels.
    columns: [Vec<f32>; 2],
    /// One over the length of the direction: `[sub-row][parity][column / 2]`.
    inverse_length: Vec<f32>,
}

impl Grid {
    pub(super) fn new(side: usize) -> Self {
        let at = |i: usize| centre(2 * side, i);
        let inverse = |row: usize, parity: usize, x: usize| {
            let (s, t) = (at(2 * x + parity), at(row));
            1.0 / (1.0 + s * s + t * t).sqrt()
        };
        let inverse_length = (0..2 * side)
            .flat_map(|row| (0..2).flat_map(move |parity| (0..side).map(move |x| inverse(row, parity, x) as f32)))
            .collect();
        let columns = [0, 1].map(|parity| (0..side).map(|x| at(2 * x + parity) as f32).collect());
        Self { side, columns, inverse_length }
    }
}

multiversion! {
    /// Means over texels of `V p(mu)` for some polynomials p without a constant term, on one face: `out` is
    /// `[polynomial][row][column]`; `normal` is in the axes of the face.
    pub(super) fn mean_of_texels(
        grid: &Grid,
        polynomials: &[[f32; DEGREE]],
        normal: [f32; 3],
        bits: &[u64],
        out: &mut [f32],
    ) => mean_of_texels_body
}

#[inline(always)]
fn mean_of_texels_body(grid: &Grid, polynomials: &[[f32; DEGREE]], normal: [f32; 3], bits: &[u64], out: &mut [f32]) {
    const HALF: usize = 32;
    let (side, face) = (grid.side, grid.side * grid.side);
    let words = 2 * side / 64;
    out.fill(0.0);
    for row in 0..2 * side {
        let line = &bits[row * words..(row + 1) * words];
        if line.iter().all(|word| *word == 0) {
            continue;
        }
        let t = (row as f32 + 0.5) / side as f32 - 1.0;
        let base = normal[0] + t * normal[2];
        for parity in 0..2 {
            let inverse = &grid.inverse_length[(2 * row + parity) * side..][..side];
            for (half, &word) in line.iter().enumerate() {
                let mut cosines = [0.0f32; HALF];
                let columns = &grid.columns[parity][half * HALF..(half + 1) * HALF];
                let inverse = &inverse[half * HALF..(half + 1) * HALF];
                for i in 0..HALF {
                    // Hidden sub-texels get the cosine 0, where every function is 0.
                    let bit = (word >> (2 * i + parity) & 1) as u32 as f32;
                    cosines[i] = (base + columns[i] * normal[1]) * inverse[i] * bit;
                }
                for (term, polynomial) in polynomials.iter().enumerate() {
                    let target = &mut out[term * face + row / 2 * side + half * HALF..][..HALF];
                    for i in 0..HALF {
                        let mut value = 0.0;
                        for c in polynomial.iter().rev() {
                            value = value * cosines[i] + c;
                        }
                        target[i] += 0.25 * (value * cosines[i]);
                    }
                }
            }
        }
    }
}

/// Everything that the rows of all samples share.
pub struct TexelBaker<'a> {
    surface: &'a Surface<'a>,
    resolution: Resolution,
    occluders: Occluders,
    grid: Grid,
    /// F_t times the cosine for the medium of each part.
    of_part: Vec<[f32; DEGREE]>,
    level: Level,
}

/// What one sample receives from each texel.
pub struct TexelRow {
    /// Means over texels, not yet times their solid angles, `[face][row][column]`; 0 on faces that are not lit.
    pub values: Vec<f32>,
    /// Faces from which any light arrives.
    pub lit: [bool; FACES],
}

impl<'a> TexelBaker<'a> {
    /// Prepares the occluders and tables.
    pub fn new(surface: &'a Surface<'a>, resolution: Resolution) -> Self {
        let scene = surface.scene;
        let of_medium: Vec<[f32; DEGREE]> =
            scene.media.iter().map(|m| polynomial(m.properties.eta_inside_over_outside).map(|c| c as f32)).collect();
        let of_part = scene
            .parts
            .parts
            .iter()
            .map(|part| part.medium.and_then(|m| of_medium.get(m as usize)).copied().unwrap_or_default());
        let of_part = of_part.collect();
        let grid = Grid::new(resolution.side() / 2);
        let occluders = Occluders::new(&scene.mesh);
        Self { surface, resolution, occluders, grid, of_part, level: Level::detect() }
    }

    /// Texels along an edge of a face.
    pub fn side(&self) -> usize {
        self.grid.side
    }

    /// Hands over the rows of some samples in their order, on one thread; a row does not depend on how ranges are cut.
    pub fn visit(&self, samples: Range<usize>, mut each: impl FnMut(usize, &TexelRow)) {
        let (mesh, all) = (&self.surface.scene.mesh, self.surface.samples);
        let first = samples.start;
        let observers: Vec<Observer> = samples.map(|i| Observer::of(mesh, all.patch(i))).collect();
        let face = self.grid.side * self.grid.side;
        let mut row = TexelRow { values: vec![0.0; FACES * face], lit: [false; FACES] };
        visit(&self.occluders, self.surface.bvh, &observers, self.resolution, |i, visible| {
            let part = all.part_offsets.partition_point(|&p| p as usize <= first + i).saturating_sub(1);
            let Some(polynomial) = self.of_part.get(part) else { return };
            self.fill(&observers[i], visible, polynomial, &mut row);
            each(first + i, &row);
        });
    }

    fn fill(&self, observer: &Observer, visible: &Visible, polynomial: &[f32; DEGREE], row: &mut TexelRow) {
        let face = self.grid.side * self.grid.side;
        let words = visible.seen.len() / FACES;
        for (index, frame) in FRAMES.iter().enumerate() {
            let bits = &visible.seen[index * words..(index + 1) * words];
            let out = &mut row.values[index * face..(index + 1) * face];
            row.lit[index] = bits.iter().any(|word| *word != 0);
            if row.lit[index] {
                let normal = [frame.forward, frame.right, frame.down].map(|axis| observer.normal.dot(axis) as f32);
                mean_of_texels(self.level, &self.grid, std::slice::from_ref(polynomial), normal, bits, out);
            } else {
                out.fill(0.0);
            }
        }
    }

    /// Irradiance of every sample under each spherical harmonic of an order as the light (radiance `y_l^m` in the axes of
    /// [`crate::light::harmonics`]): one column each.
    pub fn harmonics(&self, order: usize, progress: &dyn Progress) -> IrradianceRows {
        let functions = order * order;
        let matrix = Harmonics::new(self.grid.side, order);
        let count = self.surface.samples.len();
        let mut values = vec![0.0f32; count * functions];
        progress.start("irradiance rows", count as u64);
        values.par_chunks_mut((GROUP * functions).max(1)).enumerate().for_each(|(chunk, out)| {
            let first = chunk * GROUP;
            let mut product = Product::new(&matrix);
            let range = first..(first + GROUP).min(count);
            let mut done = 0;
            self.visit(range.clone(), |_, row| {
                product.push(&matrix, row);
                if product.rows == BATCH {
                    product.take(self.level, &matrix, &mut out[done * functions..]);
                    done += BATCH;
                }
            });
            product.take(self.level, &matrix, &mut out[done * functions..]);
            progress.advance(range.len() as u64);
        });
        progress.finish();
        IrradianceRows { lights: functions, values }
    }
}

/// Spherical harmonics at the centres of texels times their solid angles, where a direction and its mirror images are one: a
/// harmonic is even or odd in each of the three axes, so that it needs one octant of what is even and odd in the same ones, an
/// eighth of the products.
struct Harmonics {
    functions: usize,
    /// For each parity: functions of it.
    members: [Vec<usize>; PARITIES],
    /// For each parity: `[texel of the octant][padded member]`.
    matrices: [Vec<f32>; PARITIES],
    /// For each octant: the texels of the cube map, in the order of those of the first octant.
    mirrored: [Vec<u16>; PARITIES],
}

/// Octants, and combinations of even and odd in x, y and z.
const PARITIES: usize = 8;

/// Number of functions of a parity, padded.
fn padded(members: &[usize]) -> usize {
    members.len().next_multiple_of(COLUMNS)
}

impl Harmonics {
    fn new(side: usize, order: usize) -> Self {
        let (functions, face) = (order * order, side * side);
        let at = |texel: usize| direction(side, texel / face, texel % side, texel / side % side);
        let signs = |octant: usize| DVec3::from([0, 1, 2].map(|axis| if octant >> axis & 1 == 0 { 1.0 } else { -1.0 }));
        let first: Vec<DVec3> = (0..FACES * face).map(at).filter(|w| w.cmpgt(DVec3::ZERO).all()).collect();
        let image = |octant: usize| first.iter().map(|w| texel_of(side, *w * signs(octant)) as u16).collect();
        let mirrored: [Vec<u16>; PARITIES] = std::array::from_fn(image);
        // A direction where no harmonic is 0.
        let (generic, mut here, mut there) = (DVec3::new(0.31, 0.47, 0.83), vec![0.0; functions], vec![0.0; functions]);
        real_sh(order, to_harmonics(generic.normalize()), &mut here);
        let mut parity = vec![0usize; functions];
        for axis in 0..3 {
            real_sh(order, to_harmonics((generic * signs(1 << axis)).normalize()), &mut there);
            for (parity, (a, b)) in parity.iter_mut().zip(here.iter().zip(&there)) {
                *parity |= usize::from(a * b < 0.0) << axis;
            }
        }
        let members: [Vec<usize>; PARITIES] =
            std::array::from_fn(|p| (0..functions).filter(|k| parity[*k] == p).collect());
        let angles = solid_angles_sr(side);
        let rows: Vec<Vec<f64>> = first
            .par_iter()
            .map(|w| {
                let mut harmonics = vec![0.0; functions];
                real_sh(order, to_harmonics(*w), &mut harmonics);
                let angle = angles[texel_of(side, *w) % face];
                harmonics.iter_mut().for_each(|y| *y *= angle);
                harmonics
            })
            .collect();
        let matrix = |members: &Vec<usize>| {
            let width = padded(members);
            let mut values = vec![0.0f32; first.len() * width];
            for (out, row) in values.chunks_exact_mut(width.max(1)).zip(&rows) {
                out.iter_mut().zip(members).for_each(|(out, k)| *out = row[*k] as f32);
            }
            values
        };
        let matrices = members.each_ref().map(matrix);
        Self { functions, members, matrices, mirrored }
    }
}

/// Rows of some samples times the harmonics.
struct Product {
    rows: usize,
    /// For each octant, then for each parity: `[texel of the octant][row]`.
    values: [Vec<[f32; BATCH]>; PARITIES],
    /// `[row][padded member]` of one parity.
    sums: Vec<f32>,
}

impl Product {
    fn new(harmonics: &Harmonics) -> Self {
        let values = harmonics.mirrored.each_ref().map(|texels| vec![[0.0; BATCH]; texels.len()]);
        Self { rows: 0, values, sums: Vec::new() }
    }

    fn push(&mut self, harmonics: &Harmonics, row: &TexelRow) {
        for (cells, texels) in self.values.iter_mut().zip(&harmonics.mirrored) {
            for (cell, texel) in cells.iter_mut().zip(texels) {
                cell[self.rows] = row.values.get(usize::from(*texel)).copied().unwrap_or(0.0);
            }
        }
        self.rows += 1;
    }

    /// Writes the sums of the rows at hand and forgets them.
    fn take(&mut self, level: Level, harmonics: &Harmonics, out: &mut [f32]) {
        unmix(level, &mut self.values);
        for (parity, members) in harmonics.members.iter().enumerate() {
            let width = padded(members);
            self.sums.clear();
            self.sums.resize(BATCH * width, 0.0);
            multiply(level, &self.values[parity], &harmonics.matrices[parity], &mut self.sums);
            let rows = out.chunks_exact_mut(harmonics.functions.max(1)).zip(self.sums.chunks_exact(width.max(1)));
            for (out, sums) in rows.take(self.rows) {
                members.iter().zip(sums).for_each(|(k, sum)| out[*k] = *sum);
            }
        }
        self.values.iter_mut().for_each(|cells| cells.fill([0.0; BATCH]));
        self.rows = 0;
    }
}

multiversion! {
    /// From octants to parities: sums and differences along each axis.
    fn unmix(values: &mut [Vec<[f32; BATCH]>; PARITIES]) => unmix_body
}

#[inline(always)]
fn unmix_body(values: &mut [Vec<[f32; BATCH]>; PARITIES]) {
    for axis in 0..3 {
        for octant in (0..PARITIES).filter(|o| o >> axis & 1 == 0) {
            let (low, high) = values.split_at_mut(octant + 1);
            let (Some(even), Some(odd)) = (low.last_mut(), high.get_mut((1 << axis) - 1)) else { return };
            for (even, odd) in even.iter_mut().zip(odd) {
                for i in 0..BATCH {
                    (even[i], odd[i]) = (even[i] + odd[i], even[i] - odd[i]);
                }
            }
        }
    }
}

multiversion! {
    /// Adds the products of all rows to the sums `[row][column]`.
    fn multiply(values: &[[f32; BATCH]], matrix: &[f32], sums: &mut [f32]) => multiply_body
}

#[inline(always)]
fn multiply_body(values: &[[f32; BATCH]], matrix: &[f32], sums: &mut [f32]) {
    let width = sums.len() / BATCH;
    for column in (0..width).step_by(COLUMNS) {
        // One variable each, so that they stay in registers.
        let [mut s0, mut s1, mut s2, mut s3] = [[0.0f32; COLUMNS]; BATCH];
        for (cell, row) in values.iter().zip(matrix.chunks_exact(width)) {
            let Some(row) = row.get(column..).and_then(|row| row.first_chunk::<COLUMNS>()) else { return };
            let [a, b, c, d] = *cell;
            for i in 0..COLUMNS {
                s0[i] += a * row[i];
                s1[i] += b * row[i];
                s2[i] += c * row[i];
                s3[i] += d * row[i];
            }
        }
        for (row, partial) in [s0, s1, s2, s3].iter().enumerate() {
            let Some(sums) = sums.get_mut(row * width + column..) else { return };
            sums.iter_mut().zip(partial).for_each(|(sum, value)| *sum = *value);
        }
    }
}

#[cfg(test)]
#[path = "texels_tests.rs"]
mod tests;
