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
        for i in 0..size {
            let (above, row) = matrix.split_at_mut(i * size);
            factor_row(level, above, row, i);
            let square = row[i];
            // A NaN is not positive either.
            if !(square > 0.0 && square.is_finite()) {
                return None;
            }
            row[i] = square.sqrt();
            row[i + 1..size].fill(0.0);
        }
        Some(Self { size, factor: matrix })
    }

    /// Replaces b by the solution of A x = b.
    pub(crate) fn solve(&self, b: &mut [f64]) {
        solve_from(InstructionSet::detect(), &self.factor, b, 0);
    }

    /// The inverse of A, row by row.
    pub(crate) fn inverse(&self) -> Vec<f64> {
        let level = InstructionSet::detect();
        let mut inverse = vec![0.0; self.size * self.size];
        inverse.par_chunks_mut(self.size.max(1)).enumerate().for_each(|(i, row)| {
            row[i] = 1.0;
            solve_from(level, &self.factor, row, i);
        });
        inverse
    }
}

/// Row `i` of the factor, its last entry squared, from the rows above.
#[inline(always)]
fn factor_row_body(above: &[f64], row: &mut [f64], i: usize) {
    let size = above.len() / i.max(1);
    for j in 0..i {
        let other = &above[j * size..j * size + size];
        row[j] = (row[j] - dot::<8>(&row[..j], &other[..j])) / other[j];
    }
    row[i] -= dot::<8>(&row[..i], &row[..i]);
}

/// Replaces b by the solution of A x = b; entries of b before `first` are zero.
#[inline(always)]
fn solve_from_body(factor: &[f64], b: &mut [f64], first: usize) {
    let size = b.len();
    let row = |i: usize| &factor[i * size..(i + 1) * size];
    for i in first..size {
        b[i] = (b[i] - dot::<8>(&row(i)[first..i], &b[first..i])) / row(i)[i];
    }
    for i in (0..size).rev() {
        let value = b[i] / row(i)[i];
        b[i] = value;
        b[..i].iter_mut().zip(row(i)).for_each(|(x, l)| *x -= value * l);
    }
}

multiversion! {
    /// [`factor_row_body`].
    fn factor_row(above: &[f64], row: &mut [f64], i: usize) => factor_row_body;
    /// [`solve_from_body`].
    fn solve_from(factor: &[f64], b: &mut [f64], first: usize) => solve_from_body
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::math::random::uniform;

    #[test]
    fn the_inverse_times_the_matrix_is_the_identity() {
        for size in [1, 2, 7, 40] {
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
