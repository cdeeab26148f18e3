//! Solutions of (M + t S) x = M b for a diagonal M and a sparse positive semi-definite S: the implicit step of the heat equation, a
//! low pass whose response at the eigenvalue lambda of M^-1 S is 1 / (1 + t lambda).
//!
//! Conjugate gradients, preconditioned by a multigrid cycle. Its smoother takes tiny masses and large stiffnesses of slivers out of the
//! condition number, where a polynomial of the matrix (Chebyshev) would need as many products as the worst triangle asks for, and
//! nothing is factorised, so that memory and time grow with the number of rows. Sums have a fixed order.

use super::multigrid::Grids;
use super::{ROWS, Row, SymmetricMatrix, TOGETHER, for_rows, sum_over_rows};
use crate::parallel::*;

/// Iterations at most; the values then reached are the answer, and its residual tells.
const MOST: usize = 2_000;

/// Iterations and residual of a solution.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Solved {
    /// Products with the matrix beside those of the cycle.
    pub iterations: usize,
    /// Residual over the right-hand side in the norm of the preconditioner, the worst of the vectors.
    pub residual: f64,
}

/// Solves for three vectors at once from a first guess in `x` until the residual is below `tolerance` of the right-hand side. The mass
/// is positive, `t` at least 0; `grids` are those of this mass and stiffness.
pub fn solve(
    (mass, stiffness, grids): (&[f64], &SymmetricMatrix, &Grids),
    t: f64,
    b: &[Row],
    x: &mut [Row],
    tolerance: f64,
) -> Solved {
    let rows = stiffness.rows();
    let mut cycle = grids.cycle(mass, stiffness, t);
    let apply = |row: usize, x: &[Row]| -> Row {
        let product = stiffness.row_product(row, x);
        std::array::from_fn(|n| mass[row] * x[row][n] + t * product[n])
    };
    let dot = |a: &[Row], b: &[Row]| {
        sum_over_rows(rows, |run| {
            let mut sum = [0.0; TOGETHER];
            for row in run {
                for n in 0..TOGETHER {
                    sum[n] += a[row][n] * b[row][n];
                }
            }
            sum
        })
    };
    let mut r: Vec<Row> = (0..rows).map(|row| b[row].map(|b| mass[row] * b)).collect();
    let unit = dot(&r, cycle.apply(&r));
    for_rows(&mut r, |row, r| {
        let ax = apply(row, x);
        (0..TOGETHER).for_each(|n| r[n] -= ax[n]);
    });
    let mut p: Vec<Row> = cycle.apply(&r).to_vec();
    let mut rz = dot(&r, &p);
    let mut ap = vec![[0.0; TOGETHER]; rows];
    let residual = |rz: Row| {
        let relative = |n: usize| if rz[n] > 0.0 { (rz[n] / unit[n].max(f64::MIN_POSITIVE)).sqrt() } else { 0.0 };
        (0..TOGETHER).map(relative).fold(0.0, f64::max)
    };
    for iterations in 0..MOST {
        if residual(rz) <= tolerance {
            return Solved { iterations, residual: residual(rz) };
        }
        for_rows(&mut ap, |row, out| *out = apply(row, &p));
        let pap = dot(&p, &ap);
        let ratio = |a: Row, b: Row| -> Row { std::array::from_fn(|n| if b[n] > 0.0 { a[n] / b[n] } else { 0.0 }) };
        let alpha = ratio(rz, pap);
        x.par_iter_mut().zip(&mut r).zip(&p).zip(&ap).with_min_len(ROWS).for_each(|(((x, r), p), ap)| {
            for n in 0..TOGETHER {
                x[n] += alpha[n] * p[n];
                r[n] -= alpha[n] * ap[n];
            }
        });
        let z = cycle.apply(&r);
        let next = dot(&r, z);
        let beta = ratio(next, rz);
        rz = next;
        p.par_iter_mut().zip(z).with_min_len(ROWS).for_each(|(p, z)| {
            for n in 0..TOGETHER {
                p[n] = z[n] + beta[n] * p[n];
            }
        });
    }
    Solved { iterations: MOST, residual: residual(rz) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A ring of equal masses and springs: cosines are its eigenvectors.
    #[test]
    fn a_cosine_is_damped_by_its_eigenvalue() {
        let rows = 10_000usize;
        let pairs: Vec<_> = (0..rows as u32).map(|i| (i, (i + 1) % rows as u32, -1.0)).collect();
        let ring = SymmetricMatrix::new(vec![2.0; rows], &pairs);
        let wave = |k: usize, i: usize| (std::f64::consts::TAU * (k * i) as f64 / rows as f64).cos();
        let b: Vec<Row> = (0..rows).map(|i| [wave(1, i), wave(70, i), 0.0]).collect();
        let (t, mass) = (900.0, vec![0.5; rows]);
        let grids = Grids::new(&mass, &ring);
        let mut x = vec![[0.0; 3]; rows];
        let solved = solve((&mass, &ring, &grids), t, &b, &mut x, 1e-9);
        assert!(solved.residual <= 1e-9 && solved.iterations < 40, "{solved:?}");
        let damped = |k: usize| {
            let lambda = (2.0 - 2.0 * (std::f64::consts::TAU * k as f64 / rows as f64).cos()) / 0.5;
            1.0 / (1.0 + t * lambda)
        };
        for (i, x) in x.iter().enumerate() {
            assert!((x[0] - damped(1) * wave(1, i)).abs() < 1e-7, "{i}");
            assert!((x[1] - damped(70) * wave(70, i)).abs() < 1e-7 && x[2] == 0.0, "{i}");
        }
        let mut warm = x.clone();
        assert_eq!(solve((&mass, &ring, &grids), t, &b, &mut warm, 1e-8).iterations, 0);
    }

    #[test]
    fn threads_do_not_change_a_bit() {
        let rows = 3 * ROWS + 17;
        let pairs: Vec<_> = (1..rows as u32).map(|i| (i, i / 2, -1.0 - f64::from(i % 7))).collect();
        let mut diagonal = vec![0.0; rows];
        for &(i, j, value) in &pairs {
            diagonal[i as usize] -= value;
            diagonal[j as usize] -= value;
        }
        let tree = SymmetricMatrix::new(diagonal, &pairs);
        let b: Vec<Row> = (0..rows).map(|i| [(i % 5) as f64, (i % 11) as f64, 1.0]).collect();
        let mass = vec![1.0; rows];
        let grids = Grids::new(&mass, &tree);
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            let mut x = vec![[0.0; 3]; rows];
            pool.map(|pool| pool.install(|| solve((&mass, &tree, &grids), 3.0, &b, &mut x, 1e-6))).ok();
            x
        };
        assert!(run(1) == run(3));
    }
}
