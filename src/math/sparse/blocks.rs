//! Blocks of vectors stored row by row, and the products that keep them orthonormal. No lane of a sum mixes with another, so that all
//! instruction sets give the same bits.

use super::ROWS;
use crate::math::simd::{InstructionSet, multiversion};
use crate::parallel::*;

/// Number of vectors in a block.
pub(in crate::math) const WIDTH: usize = 8;

/// One row of a block: an entry of each vector.
pub(in crate::math) type Row = [f64; WIDTH];

/// A small matrix between two blocks.
pub(in crate::math) type Small = [Row; WIDTH];

/// Length of a vector after orthogonalisation, over that before, below which it is nothing but rounding.
const NEGLIGIBLE: f64 = 1e-10;

pub(in crate::math) const ZERO: Small = [[0.0; WIDTH]; WIDTH];

#[inline(always)]
fn dots(a: &[Row], b: &[Row], out: &mut Small) {
    const HALF: usize = WIDTH / 2;
    for half in 0..2 {
        let mut sums = [[0.0; WIDTH]; HALF];
        for (a, b) in a.iter().zip(b) {
            for i in 0..HALF {
                let factor = a[half * HALF + i];
                for j in 0..WIDTH {
                    sums[i][j] += factor * b[j];
                }
            }
        }
        out[half * HALF..(half + 1) * HALF].copy_from_slice(&sums);
    }
}

#[inline(always)]
fn add(a: &[Row], factors: &Small, sign: f64, b: &mut [Row]) {
    for (a, b) in a.iter().zip(b) {
        let mut sum = [0.0; WIDTH];
        for i in 0..WIDTH {
            for j in 0..WIDTH {
                sum[j] += a[i] * factors[i][j];
            }
        }
        for j in 0..WIDTH {
            b[j] += sign * sum[j];
        }
    }
}

multiversion! {
    /// `out = a^T b`.
    fn dots_on(a: &[Row], b: &[Row], out: &mut Small) => dots;

    /// `b += sign a factors`.
    fn add_on(a: &[Row], factors: &Small, sign: f64, b: &mut [Row]) => add
}

/// `a^T b` for each of several `a`, summed over runs of rows in their order.
pub(in crate::math) fn products(blocks: &[&[Row]], b: &[Row]) -> Vec<Small> {
    let level = InstructionSet::detect();
    let of_run = |(run, b): (usize, &[Row])| -> Vec<Small> {
        let rows = run * ROWS..run * ROWS + b.len();
        let of = |a: &&[Row]| {
            let mut out = ZERO;
            dots_on(level, &a[rows.clone()], b, &mut out);
            out
        };
        blocks.iter().map(of).collect()
    };
    let runs: Vec<Vec<Small>> = b.par_chunks(ROWS).enumerate().map(of_run).collect();
    let mut sums = vec![ZERO; blocks.len()];
    for run in &runs {
        for (sum, part) in sums.iter_mut().flatten().flatten().zip(run.iter().flatten().flatten()) {
            *sum += part;
        }
    }
    sums
}

/// The symmetric matrix of the products of a basis with its images, of which the columns up to the diagonal are there:
/// block by block, stored row by row.
pub(in crate::math) fn assembled(columns: &[Vec<Small>]) -> Vec<f64> {
    let order = columns.len() * WIDTH;
    let mut dense = vec![0.0; order * order];
    for (column, blocks) in columns.iter().enumerate() {
        for (row, small) in blocks.iter().enumerate() {
            for (i, values) in small.iter().enumerate() {
                for (j, value) in values.iter().enumerate() {
                    let (r, c) = (row * WIDTH + i, column * WIDTH + j);
                    if r <= c {
                        dense[r * order + c] = *value;
                        dense[c * order + r] = *value;
                    }
                }
            }
        }
    }
    dense
}

/// Combinations of a basis, in blocks.
pub(in crate::math) fn combined(basis: &[&[Row]], vectors: &[Vec<f64>]) -> Vec<Vec<Row>> {
    let rows = basis.first().map_or(0, |block| block.len());
    let of_block = |vectors: &[Vec<f64>]| {
        let factors: Vec<Small> = (0..basis.len())
            .map(|b| {
                let mut small = ZERO;
                for (j, vector) in vectors.iter().enumerate() {
                    (0..WIDTH).for_each(|i| small[i][j] = *vector.get(b * WIDTH + i).unwrap_or(&0.0));
                }
                small
            })
            .collect();
        let mut out = vec![[0.0; WIDTH]; rows];
        add_products(basis, &factors, 1.0, &mut out);
        out
    };
    vectors.chunks(WIDTH).map(of_block).collect()
}

/// `b += sign Sum_k a_k factors_k`.
pub(in crate::math) fn add_products(blocks: &[&[Row]], factors: &[Small], sign: f64, b: &mut [Row]) {
    let level = InstructionSet::detect();
    b.par_chunks_mut(ROWS).enumerate().for_each(|(run, b)| {
        let rows = run * ROWS..run * ROWS + b.len();
        for (a, factors) in blocks.iter().zip(factors) {
            add_on(level, &a[rows.clone()], factors, sign, b);
        }
    });
}

/// Projects `b` off the span of orthonormal blocks, twice against rounding; returns the sum of both times' shares.
pub(in crate::math) fn orthogonalise(blocks: &[&[Row]], b: &mut [Row]) -> Vec<Small> {
    let mut shares = products(blocks, b);
    add_products(blocks, &shares, -1.0, b);
    let again = products(blocks, b);
    add_products(blocks, &again, -1.0, b);
    for (share, again) in shares.iter_mut().flatten().flatten().zip(again.iter().flatten().flatten()) {
        *share += again;
    }
    shares
}

/// Makes a block orthonormal by Gram-Schmidt steps, each vector twice; returns the upper triangular r of `b = q r`. A
/// vector whose remainder is below [`NEGLIGIBLE`] of its length becomes zero, and so does its diagonal entry of r.
pub(in crate::math) fn orthonormalise(b: &mut [Row]) -> Small {
    let mut r = ZERO;
    for column in 0..WIDTH {
        let length = |b: &[Row]| products(&[b], b)[0][column][column].max(0.0).sqrt();
        let before = length(b);
        for _ in 0..2 {
            let all = products(&[b], b)[0];
            let mut take = [0.0; WIDTH];
            for (i, take) in take.iter_mut().enumerate().take(column) {
                *take = all[i][column];
                r[i][column] += *take;
            }
            b.par_iter_mut().with_min_len(ROWS).for_each(|b| {
                for i in 0..column {
                    b[column] -= take[i] * b[i];
                }
            });
        }
        let after = length(b);
        let kept = after > NEGLIGIBLE * before && after > 0.0;
        r[column][column] = if kept { after } else { 0.0 };
        b.par_iter_mut().with_min_len(ROWS).for_each(|b| b[column] = if kept { b[column] / after } else { 0.0 });
    }
    r
}
