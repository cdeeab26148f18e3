//! Cholesky factors of a dense matrix, with the same bits on any number of threads.

use crate::math::simd::{InstructionSet, multiversion};
use crate::math::svd::dot;
use crate::parallel::*;

/// The lower triangular factor L of A = L L^T.
pub(crate) struct Cholesky {
    size: usize,
    /// The factor row by row, zeros above the diagonal.
    factor: Vec<f64>,
}

impl Cholesky {
    /// Factorises a symmetric matrix of `size` rows; only its lower half is read. None unless it is positive definite.
    pub(crate) fn new(mut matrix: Vec<f64>, size: usize) -> Option<Self> {
        let level = InstructionSet::detect();
        for first in (0..size).step_by(TOGETHER) {
            let (above, rows) = matrix.split_at_mut(first * size);
            let rows = &mut rows[..size.min(first + TOGETHER) * size - first * size];
            factor_rows(level, above, rows, size);
            for (row, i) in rows.chunks_exact_mut(size).zip(first..) {
                // A NaN is not positive either.
                if !(row[i] > 0.0 && row[i].is_finite()) {
                    return None;
                }
                row[i + 1..size].fill(0.0);
            }
        }
        Some(Self { size, factor: matrix })
    }

    /// Replaces b by the solution of A x = b.
    pub(crate) fn solve(&self, b: &mut [f64]) {
        if self.size > 0 {
            solve(InstructionSet::detect(), &self.factor, b, self.size, 0);
        }
    }

    /// The inverse of A, row by row.
    pub(crate) fn inverse(&self) -> Vec<f64> {
        let level = InstructionSet::detect();
        let mut inverse = vec![0.0; self.size * self.size];
        inverse.par_chunks_mut(self.size.max(1) * TOGETHER).enumerate().for_each(|(block, rows)| {
            let first = block * TOGETHER;
            rows.chunks_exact_mut(self.size).zip(first..).for_each(|(row, i)| row[i] = 1.0);
            solve(level, &self.factor, rows, self.size, first);
        });
        inverse
    }
}

/// Rows that pass over the factor at a time, which is larger than a cache.
const TOGETHER: usize = 8;

/// The next rows of the factor, from those above.
#[inline(always)]
fn factor_rows_body(above: &[f64], rows: &mut [f64], size: usize) {
    let first = above.len() / size;
    for (j, other) in above.chunks_exact(size).enumerate() {
        for row in rows.chunks_exact_mut(size) {
            row[j] = (row[j] - dot::<8>(&row[..j], &other[..j])) / other[j];
        }
    }
    for k in 0..rows.len() / size {
        let (before, row) = rows.split_at_mut(k * size);
        let row = &mut row[..size];
        for (other, j) in before.chunks_exact(size).zip(first..) {
            row[j] = (row[j] - dot::<8>(&row[..j], &other[..j])) / other[j];
        }
        let i = first + k;
        row[i] = (row[i] - dot::<8>(&row[..i], &row[..i])).sqrt();
    }
}

/// Replaces each b by the solution of A x = b; entries of the k-th before `first + k` are zero.
#[inline(always)]
fn solve_body(factor: &[f64], bs: &mut [f64], size: usize, first: usize) {
    for (i, row) in factor.chunks_exact(size).enumerate().skip(first) {
        for (b, first) in bs.chunks_exact_mut(size).zip(first..=i) {
            b[i] = (b[i] - dot::<8>(&row[first..i], &b[first..i])) / row[i];
        }
    }
    for (i, row) in factor.chunks_exact(size).enumerate().rev() {
        for b in bs.chunks_exact_mut(size) {
            let value = b[i] / row[i];
            b[i] = value;
            b[..i].iter_mut().zip(row).for_each(|(x, l)| *x -= value * l);
        }
    }
}

multiversion! {
    /// [`factor_rows_body`].
    fn factor_rows(above: &[f64], rows: &mut [f64], size: usize) => factor_rows_body;
    /// [`solve_body`].
    fn solve(factor: &[f64], bs: &mut [f64], size: usize, first: usize) => solve_body
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::math::random::uniform;

    #[test]
    fn the_inverse_times_the_matrix_is_the_identity() {
        for size in [1, 2, 7, 9, 21, 40] {
            let b: Vec<f64> = (0..size * size).map(|i| uniform(3, i as u64, 0) - 0.5).collect();
            let row = |i: usize| &b[i * size..(i + 1) * size];
            let a: Vec<f64> = (0..size * size)
                .map(|k| dot::<8>(row(k / size), row(k % size)) + if k / size == k % size { 0.1 } else { 0.0 })
                .collect();
            let factors = Cholesky::new(a.clone(), size).unwrap();
            let inverse = factors.inverse();
            for i in 0..size {
                for j in 0..size {
                    // Both are symmetric.
                    let product = dot::<8>(&a[i * size..(i + 1) * size], &inverse[j * size..(j + 1) * size]);
                    assert!((product - f64::from(u8::from(i == j))).abs() < 1e-10, "{size} {i} {j}: {product}");
                }
            }
        }
    }

    #[test]
    fn what_is_not_positive_definite_is_refused() {
        assert!(Cholesky::new(vec![1.0, 2.0, 2.0, 1.0], 2).is_none());
        assert!(Cholesky::new(vec![0.0], 1).is_none());
        assert!(Cholesky::new(vec![f64::NAN], 1).is_none());
        assert!(Cholesky::new(vec![f64::INFINITY], 1).is_none());
        assert!(Cholesky::new(Vec::new(), 0).is_some_and(|c| c.inverse().is_empty()));
    }
}
