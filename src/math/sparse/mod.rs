//! Sparse symmetric matrices: products, solutions by conjugate gradients, factorisations and eigenpairs. The same bits at any number
//! of threads and on every instruction set.

pub mod bands;
pub(in crate::math) mod blocks;
pub mod factorisation;
pub mod multigrid;
pub mod resolvent;

use crate::parallel::*;

/// Rows of one task. Sums over all rows add the sums of such runs in their order.
pub(crate) const ROWS: usize = 4096;

/// Number of vectors that are solved for at once.
pub const TOGETHER: usize = 3;

/// One number of each of these vectors.
pub type Row = [f64; TOGETHER];

/// A symmetric matrix, both triangles stored: compressed rows without the diagonal, and the diagonal.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SymmetricMatrix {
    diagonal: Vec<f64>,
    offsets: Vec<u32>,
    columns: Vec<u32>,
    values: Vec<f64>,
}

impl SymmetricMatrix {
    /// The matrix with this diagonal and the entries `(i, j, value)` beside it, each given on one side of the diagonal
    /// only; values of one pair add up in their order. Pairs beyond the diagonal's length and pairs of a row with
    /// itself are left out.
    pub fn new(diagonal: Vec<f64>, pairs: &[(u32, u32, f64)]) -> Self {
        let rows = diagonal.len();
        let inside = |&&(i, j, _): &&(u32, u32, f64)| i != j && (i.max(j) as usize) < rows;
        let mut counts = vec![0u32; rows + 1];
        for &(i, j, _) in pairs.iter().filter(inside) {
            counts[i as usize + 1] += 1;
            counts[j as usize + 1] += 1;
        }
        for row in 0..rows {
            counts[row + 1] += counts[row];
        }
        let mut next = counts.clone();
        let mut entries = vec![(0u32, 0.0); counts[rows] as usize];
        for &(i, j, value) in pairs.iter().filter(inside) {
            for (row, column) in [(i, j), (j, i)] {
                let at = &mut next[row as usize];
                entries[*at as usize] = (column, value);
                *at += 1;
            }
        }
        let mut matrix = Self { diagonal, offsets: vec![0], columns: Vec::new(), values: Vec::new() };
        for row in 0..rows {
            let own = &mut entries[counts[row] as usize..counts[row + 1] as usize];
            own.sort_by_key(|(column, _)| *column);
            for same in own.chunk_by(|a, b| a.0 == b.0) {
                matrix.columns.push(same[0].0);
                matrix.values.push(same.iter().map(|(_, value)| value).sum());
            }
            matrix.offsets.push(matrix.columns.len() as u32);
        }
        matrix
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.diagonal.len()
    }

    /// The diagonal.
    pub fn diagonal(&self) -> &[f64] {
        &self.diagonal
    }

    /// Columns and values of a row beside the diagonal, columns ascending.
    pub fn row(&self, row: usize) -> impl Iterator<Item = (u32, f64)> + '_ {
        let range = self.offsets[row] as usize..self.offsets[row + 1] as usize;
        self.columns[range.clone()].iter().copied().zip(self.values[range].iter().copied())
    }

    /// The product with `N` vectors, stored row by row; `out` is as long as `x`.
    pub fn product<const N: usize>(&self, x: &[[f64; N]], out: &mut [[f64; N]]) {
        for_rows(out, |row, out| *out = self.row_product(row, x));
    }

    /// One row of the product.
    #[inline(always)]
    pub(crate) fn row_product<const N: usize>(&self, row: usize, x: &[[f64; N]]) -> [f64; N] {
        let mut sum = x[row].map(|x| self.diagonal[row] * x);
        for (column, value) in self.row(row) {
            let other = &x[column as usize];
            for n in 0..N {
                sum[n] += value * other[n];
            }
        }
        sum
    }

    /// The matrix of the entries `s_i a_ij s_j`.
    #[must_use]
    pub fn scaled(&self, s: &[f64]) -> Self {
        let mut scaled = self.clone();
        for row in 0..self.rows() {
            scaled.diagonal[row] *= s[row] * s[row];
            for at in self.offsets[row] as usize..self.offsets[row + 1] as usize {
                scaled.values[at] *= s[row] * s[self.columns[at] as usize];
            }
        }
        scaled
    }

    /// The rows and columns of some indices, ascending, which are not connected with others.
    #[must_use]
    pub fn block(&self, indices: &[u32]) -> Self {
        let mut place = vec![u32::MAX; self.rows()];
        for (new, &old) in indices.iter().enumerate() {
            place[old as usize] = new as u32;
        }
        let mut block = Self { offsets: vec![0], ..Self::default() };
        for &old in indices {
            block.diagonal.push(self.diagonal[old as usize]);
            for (column, value) in self.row(old as usize) {
                if place[column as usize] != u32::MAX {
                    block.columns.push(place[column as usize]);
                    block.values.push(value);
                }
            }
            block.offsets.push(block.columns.len() as u32);
        }
        block
    }

    /// Sets of rows that no value connects, each ascending, in the order of their first rows.
    pub fn components(&self) -> Vec<Vec<u32>> {
        let mut seen = vec![false; self.rows()];
        let mut all = Vec::new();
        for first in 0..self.rows() {
            if std::mem::replace(&mut seen[first], true) {
                continue;
            }
            let mut component = vec![first as u32];
            let mut next = 0;
            while let Some(&row) = component.get(next) {
                next += 1;
                for (column, _) in self.row(row as usize) {
                    if !std::mem::replace(&mut seen[column as usize], true) {
                        component.push(column);
                    }
                }
            }
            component.sort_unstable();
            all.push(component);
        }
        all
    }
}

/// Changes every row, side by side where there are many.
fn for_rows<const N: usize>(out: &mut [[f64; N]], of: impl Fn(usize, &mut [f64; N]) + Sync) {
    if out.len() <= ROWS {
        out.iter_mut().enumerate().for_each(|(row, out)| of(row, out));
    } else {
        out.par_chunks_mut(ROWS).enumerate().for_each(|(chunk, out)| {
            out.iter_mut().enumerate().for_each(|(i, out)| of(chunk * ROWS + i, out));
        });
    }
}

/// A sum over runs of [`ROWS`] rows, added in their order.
pub(crate) fn sum_over_rows<const N: usize>(
    rows: usize,
    of_run: impl Fn(std::ops::Range<usize>) -> [f64; N] + Sync,
) -> [f64; N] {
    let runs: Vec<[f64; N]> =
        (0..rows.div_ceil(ROWS)).into_par_iter().map(|run| of_run(run * ROWS..((run + 1) * ROWS).min(rows))).collect();
    runs.iter().fold([0.0; N], |mut sum, run| {
        sum.iter_mut().zip(run).for_each(|(sum, run)| *sum += run);
        sum
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_of_a_pair_add_up_and_products_are_symmetric() {
        let pairs = [(0, 1, -1.0), (2, 1, -2.0), (1, 0, -0.5), (1, 1, 9.0), (7, 0, 9.0)];
        let a = SymmetricMatrix::new(vec![2.0, 3.0, 4.0, 5.0], &pairs);
        let mut out = vec![[0.0; 2]; 4];
        a.product(&[[1.0, 0.0], [0.0, 1.0], [1.0, 1.0], [0.0, 2.0]], &mut out);
        assert_eq!(out, [[2.0, -1.5], [-3.5, 1.0], [4.0, 2.0], [0.0, 10.0]]);
        assert_eq!(a.components(), [vec![0, 1, 2], vec![3]]);
        let block = a.block(&[0, 1, 2]);
        assert_eq!(block.row(1).collect::<Vec<_>>(), [(0, -1.5), (2, -2.0)]);
        let scaled = a.scaled(&[1.0, 2.0, 0.5, 1.0]);
        assert_eq!((scaled.diagonal()[1], scaled.row(1).collect::<Vec<_>>()), (12.0, vec![(0, -3.0), (2, -2.0)]));
    }
}
