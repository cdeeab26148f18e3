//! Sparse L D L^T of shifted matrices: solutions and inertia.
//!
//! faer orders by minimum degree and factorises dense supernodes. It is built without its run-time choice of instruction sets, which
//! costs nothing measurable here (0.12 s for 35,000 rows either way), so that every processor of a kind computes the same bits; it runs
//! on one thread for the same reason.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::prelude::default;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LdltRef, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
    factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Conj, MatMut, Par, Side};

use super::SymmetricMatrix;
use crate::error::{Error, Result};

/// Symbolic factorisation, shared by all shifts of a matrix: its entries, their pattern and the elimination order.
pub struct Symbolic {
    rows: usize,
    offsets: Vec<usize>,
    /// Rows of the entries on and below the diagonal, column by column.
    indices: Vec<usize>,
    values: Vec<f64>,
    symbolic: SymbolicCholesky<usize>,
}

/// L D L^T of a matrix less a multiple of the unit matrix.
pub struct Factors<'a> {
    symbolic: &'a Symbolic,
    values: Vec<f64>,
    /// Number of negative pivots: by Sylvester's law of inertia as many as the matrix has eigenvalues below the shift.
    pub below: usize,
}

impl Symbolic {
    /// The symbolic factorisation of a matrix.
    ///
    /// # Errors
    /// Run time: no memory for it.
    pub fn new(matrix: &SymmetricMatrix) -> Result<Self> {
        let rows = matrix.rows();
        let (mut offsets, mut indices, mut values) = (vec![0], Vec::new(), Vec::new());
        for column in 0..rows {
            indices.push(column);
            values.push(matrix.diagonal()[column]);
            for (row, value) in matrix.row(column).filter(|(row, _)| *row as usize > column) {
                indices.push(row as usize);
                values.push(value);
            }
            offsets.push(indices.len());
        }
        let pattern = SymbolicSparseColMatRef::new_checked(rows, rows, &offsets, None, &indices);
        let always = SupernodalThreshold::FORCE_SUPERNODAL;
        let params = CholeskySymbolicParams { supernodal_flop_ratio_threshold: always, ..default() };
        let symbolic = factorize_symbolic_cholesky(pattern, Side::Lower, SymmetricOrdering::Amd, params)
            .map_err(|e| Error::runtime(format!("the Laplacian cannot be factorised: {e}")))?;
        Ok(Self { rows, offsets, indices, values, symbolic })
    }

    /// L D L^T of the matrix less `shift` times the unit matrix; none where a pivot vanishes, which another shift avoids, and for
    /// a matrix of one row, which has no supernodes.
    pub fn shifted(&self, shift: f64) -> Option<Factors<'_>> {
        let mut shifted = self.values.clone();
        for column in 0..self.rows {
            shifted[self.offsets[column]] -= shift;
        }
        let pattern = SymbolicSparseColMatRef::new_checked(self.rows, self.rows, &self.offsets, None, &self.indices);
        let matrix = SparseColMatRef::new(pattern, &shifted);
        let mut values = vec![0.0; self.symbolic.len_val()];
        let scratch = self.symbolic.factorize_numeric_ldlt_scratch::<f64>(Par::Seq, default());
        let mut memory = MemBuffer::try_new(scratch).ok()?;
        let stack = MemStack::new(&mut memory);
        self.symbolic
            .factorize_numeric_ldlt(&mut values, matrix, Side::Lower, default(), Par::Seq, stack, default())
            .ok()?;
        let pivots = self.pivots(&values);
        let sound = pivots.len() == self.rows && pivots.iter().all(|pivot| pivot.is_finite() && *pivot != 0.0);
        let below = pivots.iter().filter(|pivot| **pivot < 0.0).count();
        sound.then_some(Factors { symbolic: self, values, below })
    }

    /// D: the diagonals of the dense supernodes.
    fn pivots(&self, values: &[f64]) -> Vec<f64> {
        let SymbolicCholeskyRaw::Supernodal(nodes) = self.symbolic.raw() else { return Vec::new() };
        let mut pivots = Vec::with_capacity(self.rows);
        for node in 0..nodes.n_supernodes() {
            let columns = nodes.supernode_end()[node] - nodes.supernode_begin()[node];
            let first = nodes.col_ptr_for_val()[node];
            let height = (nodes.col_ptr_for_val()[node + 1] - first) / columns.max(1);
            pivots.extend((0..columns).map(|column| values[first + column * (height + 1)]));
        }
        pivots
    }
}

impl Factors<'_> {
    /// Replaces right-hand sides, one after another, by their solutions.
    ///
    /// # Errors
    /// Run time: no memory.
    pub fn solve(&self, columns: &mut [f64]) -> Result<()> {
        let rows = self.symbolic.rows;
        let count = columns.len() / rows.max(1);
        let scratch = self.symbolic.symbolic.solve_in_place_scratch::<f64>(count, Par::Seq);
        let mut memory =
            MemBuffer::try_new(scratch).map_err(|_| Error::runtime("no memory to solve for eigenvectors"))?;
        let right = MatMut::from_column_major_slice_mut(&mut columns[..rows * count], rows, count);
        let factors = LdltRef::new(&self.symbolic.symbolic, &self.values);
        factors.solve_in_place_with_conj(Conj::No, right, Par::Seq, MemStack::new(&mut memory));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A path of unit springs, ends held: eigenvalues 2 - 2 cos(k pi / (n + 1)).
    fn path(rows: usize) -> SymmetricMatrix {
        let pairs: Vec<_> = (1..rows as u32).map(|i| (i - 1, i, -1.0)).collect();
        SymmetricMatrix::new(vec![2.0; rows], &pairs)
    }

    #[test]
    fn inertia_counts_the_eigenvalues_below() {
        let rows = 300;
        let symbolic = Symbolic::new(&path(rows)).unwrap();
        let eigenvalue = |k: usize| 2.0 - 2.0 * (k as f64 * std::f64::consts::PI / (rows + 1) as f64).cos();
        for k in [0, 1, 2, 57, 150, 299, 300] {
            let shift = 0.5 * (eigenvalue(k) + eigenvalue(k + 1));
            assert_eq!(symbolic.shifted(shift).unwrap().below, k);
        }
    }

    #[test]
    fn solutions_solve() {
        let (rows, shift) = (500, 0.37);
        let matrix = path(rows);
        let symbolic = Symbolic::new(&matrix).unwrap();
        let factors = symbolic.shifted(shift).unwrap();
        let right = |i: usize, column: usize| ((i * 7 + column * 3) % 13) as f64 - 6.0;
        let mut columns: Vec<f64> = (0..2 * rows).map(|at| right(at % rows, at / rows)).collect();
        factors.solve(&mut columns).unwrap();
        let x: Vec<[f64; 2]> = (0..rows).map(|i| [columns[i], columns[rows + i]]).collect();
        let mut product = vec![[0.0; 2]; rows];
        matrix.product(&x, &mut product);
        for i in 0..rows {
            for column in 0..2 {
                let left = product[i][column] - shift * x[i][column];
                assert!((left - right(i, column)).abs() < 1e-9, "{i} {left}");
            }
        }
    }

    /// The first pivot is exactly 0.
    #[test]
    fn a_vanishing_pivot_is_refused() {
        let symbolic = Symbolic::new(&path(3)).unwrap();
        assert!(symbolic.shifted(2.0).is_none());
        assert_eq!(symbolic.shifted(2.1).unwrap().below, 2);
    }
}
