//! Scalar products of functions over a cube map with spherical harmonics.

use glam::DVec3;

use crate::light::harmonics::to_harmonics;
use crate::math::cube_map::{FACES, direction, solid_angles_sr, texel_of};
use crate::math::sh::real_sh;
use crate::math::simd::{InstructionSet, add_scaled, multiversion};
use crate::parallel::*;

/// Rows that are multiplied together: as many as keep their sums in the 16 registers of AVX2.
const BATCH: usize = 6;

/// Functions of a block of the product.
const COLUMNS: usize = 16;

/// Spherical harmonics at the centres of texels times their solid angles, stored on one octant. A harmonic is even or
/// odd in each of the three axes, so that it meets only the part of a function with the same parities, which one octant
/// gives: an eighth of the products.
pub struct CubeHarmonics {
    functions: usize,
    /// For each parity, the indices of the harmonics that have it.
    members: [Vec<usize>; PARITIES],
    /// For each parity: `[block of members][texel of the octant][member of the block]`, padded with zeros.
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

impl CubeHarmonics {
    /// `order^2` harmonics times the solid angles of the texels, for products with rows of means over texels; faces
    /// have `side` texels along an edge, an even number.
    pub fn new(side: usize, order: usize) -> Self {
        Self::weighted(side, order, &solid_angles_sr(side))
    }

    /// `order^2` harmonics for products with rows of integrals over texels.
    pub fn of_integrals(side: usize, order: usize) -> Self {
        Self::weighted(side, order, &vec![1.0; side * side])
    }

    /// Number of harmonics.
    pub fn functions(&self) -> usize {
        self.functions
    }

    fn weighted(side: usize, order: usize, weights: &[f64]) -> Self {
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
        let rows: Vec<Vec<f64>> = first
            .par_iter()
            .map(|w| {
                let mut harmonics = vec![0.0; functions];
                real_sh(order, to_harmonics(*w), &mut harmonics);
                let weight = weights[texel_of(side, *w) % face];
                harmonics.iter_mut().for_each(|y| *y *= weight);
                harmonics
            })
            .collect();
        let matrix = |members: &Vec<usize>| {
            let width = padded(members);
            let mut values = vec![0.0f32; first.len() * width];
            let blocks = members.chunks(COLUMNS).zip(values.chunks_exact_mut((first.len() * COLUMNS).max(1)));
            for (members, block) in blocks {
                for (out, row) in block.chunks_exact_mut(COLUMNS).zip(&rows) {
                    out.iter_mut().zip(members).for_each(|(out, k)| *out = row[*k] as f32);
                }
            }
            values
        };
        let matrices = members.each_ref().map(matrix);
        Self { functions, members, matrices, mirrored }
    }
}

/// Products of rows `[face][row][column]` with the harmonics, a few at a time, written one after the other.
pub struct Product<'a> {
    harmonics: &'a CubeHarmonics,
    level: InstructionSet,
    /// Number of rows at hand, and of rows already written.
    rows: usize,
    done: usize,
    /// For each octant, then for each parity: `[texel of the octant][row]`.
    values: [Vec<[f32; BATCH]>; PARITIES],
    /// Sums of one parity, `[row][padded member]`.
    sums: Vec<f32>,
}

impl<'a> Product<'a> {
    /// A product without rows.
    pub fn new(harmonics: &'a CubeHarmonics) -> Self {
        let values = harmonics.mirrored.each_ref().map(|texels| vec![[0.0; BATCH]; texels.len()]);
        Self { harmonics, level: InstructionSet::detect(), rows: 0, done: 0, values, sums: Vec::new() }
    }

    /// Takes the next row; `out` holds `[row][harmonic]` of all of them and is complete after [`Self::finish`].
    pub fn push(&mut self, row: &[f32], out: &mut [f32]) {
        for (cells, texels) in self.values.iter_mut().zip(&self.harmonics.mirrored) {
            for (cell, texel) in cells.iter_mut().zip(texels) {
                cell[self.rows] = row.get(usize::from(*texel)).copied().unwrap_or(0.0);
            }
        }
        self.rows += 1;
        if self.rows == BATCH {
            self.finish(out);
        }
    }

    /// Writes the products of the rows at hand.
    pub fn finish(&mut self, out: &mut [f32]) {
        let functions = self.harmonics.functions.max(1);
        let Some(out) = out.get_mut(self.done * functions..) else { return };
        unmix(self.level, &mut self.values);
        for (parity, members) in self.harmonics.members.iter().enumerate() {
            let width = padded(members);
            self.sums.clear();
            self.sums.resize(BATCH * width, 0.0);
            multiply(self.level, &self.values[parity], &self.harmonics.matrices[parity], &mut self.sums);
            let rows = out.chunks_exact_mut(functions).zip(self.sums.chunks_exact(width.max(1)));
            for (out, sums) in rows.take(self.rows) {
                members.iter().zip(sums).for_each(|(k, sum)| out[*k] = *sum);
            }
        }
        self.values.iter_mut().for_each(|cells| cells.fill([0.0; BATCH]));
        self.done += self.rows;
        self.rows = 0;
    }
}

multiversion! {
    /// Turns values by octant into values by parity: sums and differences along each axis.
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
    let (blocks, _) = matrix.as_chunks::<COLUMNS>();
    for (block, rows) in blocks.chunks_exact(values.len().max(1)).enumerate() {
        // One variable each, so that they stay in registers.
        let [mut s0, mut s1, mut s2, mut s3, mut s4, mut s5] = [[0.0f32; COLUMNS]; BATCH];
        for (&[a, b, c, d, e, f], row) in values.iter().zip(rows) {
            add_scaled(&mut s0, a, row);
            add_scaled(&mut s1, b, row);
            add_scaled(&mut s2, c, row);
            add_scaled(&mut s3, d, row);
            add_scaled(&mut s4, e, row);
            add_scaled(&mut s5, f, row);
        }
        for (row, partial) in [s0, s1, s2, s3, s4, s5].iter().enumerate() {
            let Some(sums) = sums.get_mut(row * width + block * COLUMNS..) else { return };
            sums.iter_mut().zip(partial).for_each(|(sum, value)| *sum = *value);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::uniform;

    #[test]
    fn products_are_sums_over_texels_whatever_the_weights() {
        let (side, order, rows) = (8, 5, 8);
        let (texels, angles) = (FACES * side * side, solid_angles_sr(side));
        let value = |row: usize, texel: usize| uniform(9, row as u64, texel as u64) as f32;
        let at = |t: usize| direction(side, t / side / side, t % side, t / side % side);
        for (harmonics, weighted) in
            [(CubeHarmonics::new(side, order), true), (CubeHarmonics::of_integrals(side, order), false)]
        {
            let mut out = vec![0.0; rows * order * order];
            let mut product = Product::new(&harmonics);
            for row in 0..rows {
                let values: Vec<f32> = (0..texels).map(|t| value(row, t)).collect();
                product.push(&values, &mut out);
            }
            product.finish(&mut out);
            assert_eq!(harmonics.functions(), order * order);
            let mut y = vec![0.0; order * order];
            for (row, found) in out.chunks_exact(order * order).enumerate() {
                let mut expected = vec![0.0; order * order];
                for texel in 0..texels {
                    real_sh(order, to_harmonics(at(texel)), &mut y);
                    let weight = if weighted { angles[texel % (side * side)] } else { 1.0 };
                    let factor = weight * f64::from(value(row, texel));
                    expected.iter_mut().zip(&y).for_each(|(sum, y)| *sum += factor * y);
                }
                for (a, b) in found.iter().zip(&expected) {
                    assert!((f64::from(*a) - b).abs() < 2e-4 * (1.0 + b.abs()), "{weighted} {row}: {a} {b}");
                }
            }
        }
    }
}
