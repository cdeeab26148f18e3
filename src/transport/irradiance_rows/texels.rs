//! The share of each texel of a cube map in the irradiance of a sample, before any basis: `V F_t(mu) mu`, the mean over
//! 2 x 2 sub-texels, for the medium that the sample belongs to.

use std::ops::Range;

use crate::math::cube_map::{FACES, FRAMES, centre};
use crate::math::simd::{InstructionSet, multiversion};
use crate::medium::entrance_basis::{DEGREE, polynomial};
use crate::parallel::*;
use crate::progress::Progress;
use crate::transport::cube_harmonics::{CubeHarmonics, Product};
use crate::transport::many_lights::IrradianceRows;
use crate::transport::surface::Surface;
use crate::transport::visibility::{GROUP, Observer, Occluders, Resolution, Visible, visit};

/// The places of the sub-texels of a face.
pub(super) struct Grid {
    /// Texels along an edge.
    pub(super) side: usize,
    /// Coordinate `s` of the sub-texels, of even and of odd columns.
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

/// Surface and tables shared by the rows of all samples.
pub struct TexelBaker<'a> {
    surface: &'a Surface<'a>,
    resolution: Resolution,
    occluders: Occluders,
    grid: Grid,
    /// Polynomial of `F_t mu` for the medium of each part.
    of_part: Vec<[f32; DEGREE]>,
    level: InstructionSet,
}

/// The irradiance that one sample receives from each texel.
pub struct TexelRow {
    /// Means over texels, not yet times their solid angles, `[face][row][column]`; 0 on faces that are not lit.
    pub values: Vec<f32>,
    /// Faces from which any light arrives.
    pub lit: [bool; FACES],
}

impl<'a> TexelBaker<'a> {
    /// Prepares the occluders and tables.
    pub fn new(surface: &'a Surface<'a>, resolution: Resolution) -> Self {
        let domain = surface.domain;
        let of_medium: Vec<[f32; DEGREE]> =
            domain.media.iter().map(|m| polynomial(m.properties.eta_inside_over_outside).map(|c| c as f32)).collect();
        let of_part = domain
            .parts
            .parts
            .iter()
            .map(|part| part.medium.and_then(|m| of_medium.get(m as usize)).copied().unwrap_or_default());
        let of_part = of_part.collect();
        let grid = Grid::new(resolution.side() / 2);
        let occluders = Occluders::new(domain.mesh);
        Self { surface, resolution, occluders, grid, of_part, level: InstructionSet::detect() }
    }

    /// Texels along an edge of a face.
    pub fn side(&self) -> usize {
        self.grid.side
    }

    /// Calls `each` with the rows of some samples in their order, on one thread; a row does not depend on the range.
    pub fn visit(&self, samples: Range<usize>, mut each: impl FnMut(usize, &TexelRow)) {
        let (mesh, all) = (self.surface.domain.mesh, self.surface.samples);
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
        let matrix = CubeHarmonics::new(self.grid.side, order);
        let count = self.surface.samples.len();
        let mut values = vec![0.0f32; count * functions];
        progress.start("irradiance rows", count as u64);
        values.par_chunks_mut((GROUP * functions).max(1)).enumerate().for_each(|(chunk, out)| {
            let first = chunk * GROUP;
            let mut product = Product::new(&matrix);
            let range = first..(first + GROUP).min(count);
            self.visit(range.clone(), |_, row| product.push(&row.values, out));
            product.finish(out);
            progress.advance(range.len() as u64);
        });
        progress.finish();
        IrradianceRows { lights: functions, by_channel: false, values }
    }
}

#[cfg(test)]
#[path = "texels_tests.rs"]
mod tests;
