//! Spherical harmonics of functions that are known at some directions: fits, and windows against ringing.

use std::f64::consts::PI;

use glam::DVec3;
use rayon::prelude::*;
use translux::error::{Error, Result};
use translux::math::sh::{MOST_ORDER, real_sh};

/// Condition number of the normal equations above which a fit is refused: what is left of 16 digits is then less than 6.
const MOST_CONDITION: f64 = 1e10;

/// Band of the coefficient at this index.
pub(crate) fn band(index: usize) -> usize {
    index.isqrt()
}

/// Coefficients of functions that are known at some directions.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Fit {
    order: usize,
    samples: usize,
    /// `[coefficient][direction]`.
    matrix: Vec<f64>,
    condition: f64,
}

impl Fit {
    /// Weighted least squares: `Sum_i w_i (v_i - Sum_k c_k y_k(direction_i))^2` is least, by Cholesky's factors of the normal
    /// equations. Exact for functions of this order. Without weights all are 1; only their ratios matter.
    ///
    /// # Errors
    /// An order of 0 or above [`MOST_ORDER`], directions that are no unit vectors, weights that are not positive or of
    /// another number, or directions that do not determine so many coefficients (exit 3).
    pub(crate) fn new(directions: &[DVec3], order: usize, weights: Option<&[f64]>) -> Result<Self> {
        check(directions, order)?;
        let (count, samples) = (order * order, directions.len());
        let weights = weights.map_or_else(|| vec![1.0; samples], <[f64]>::to_vec);
        if weights.len() != samples {
            return Err(Error::input(format!("{} weights for {samples} directions", weights.len())));
        }
        if let Some(at) = weights.iter().position(|w| !(*w > 0.0 && w.is_finite())) {
            return Err(Error::input(format!(
                "the weight of direction {at} is {}: not a positive number",
                weights[at]
            )));
        }
        if samples < count {
            return Err(undetermined(samples, order));
        }
        let largest = weights.iter().fold(0.0_f64, |most, w| most.max(*w));
        let roots: Vec<f64> = weights.iter().map(|w| (w / largest).sqrt()).collect();
        // Harmonics times the root of the weight, [coefficient][direction].
        let mut matrix = transposed_harmonics(directions, order);
        matrix.par_chunks_exact_mut(samples).for_each(|row| row.iter_mut().zip(&roots).for_each(|(y, r)| *y *= r));
        let row = |k: usize| &matrix[k * samples..(k + 1) * samples];
        let normal: Vec<f64> =
            (0..count * count).into_par_iter().map(|at| dot(row(at / count), row(at % count))).collect();
        let factor = cholesky(&normal, count).ok_or_else(|| undetermined(samples, order))?;
        let mut inverse: Vec<f64> =
            (0..count * count).map(|at| f64::from(u8::from(at / count == at % count))).collect();
        solve(&factor, count, &mut inverse, count);
        let condition = norm(&normal, count) * norm(&inverse, count);
        if condition.is_nan() || condition > MOST_CONDITION {
            return Err(undetermined(samples, order));
        }
        solve(&factor, count, &mut matrix, samples);
        matrix.par_chunks_exact_mut(samples).for_each(|row| row.iter_mut().zip(&roots).for_each(|(y, r)| *y *= r));
        Ok(Self { order, samples, matrix, condition })
    }

    /// The matrix that makes coefficients of values, `[coefficient][direction]`.
    pub(crate) fn matrix(&self) -> &[f64] {
        &self.matrix
    }
}

/// Factors by band that trade sharpness against ringing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
pub(crate) enum Window {
    /// All factors are 1.
    None,
    /// `sin(pi l / n) / (pi l / n)`.
    Lanczos,
    /// `(1 + cos(pi l / n)) / 2`.
    Hanning,
}

impl Window {
    /// The factor of band `l` in order `n`: 1 for band 0, towards 0 at band `n`.
    pub(crate) fn factor(self, l: usize, n: usize) -> f64 {
        let x = PI * l as f64 / n.max(1) as f64;
        match self {
            _ if l == 0 => 1.0,
            Self::None => 1.0,
            Self::Lanczos => x.sin() / x,
            Self::Hanning => 0.5 + 0.5 * x.cos(),
        }
    }
}

/// How far values fall below 0, relative to the largest of them: 0 if none does, infinite if none is positive.
pub(crate) fn undershoot(values: impl IntoIterator<Item = f64>) -> f64 {
    let (least, most) = values.into_iter().fold((0.0_f64, 0.0_f64), |(least, most), v| (least.min(v), most.max(v)));
    if least == 0.0 { 0.0 } else { -least / most }
}

fn undetermined(samples: usize, order: usize) -> Error {
    Error::input(format!(
        "{samples} directions do not determine {} spherical harmonics: take a lower order than {order}, or more and more \
         evenly spread directions",
        order * order
    ))
}

fn check(directions: &[DVec3], order: usize) -> Result<()> {
    if !(1..=MOST_ORDER).contains(&order) {
        return Err(Error::input(format!("spherical harmonics of order {order}: 1 to {MOST_ORDER} are possible")));
    }
    if directions.is_empty() {
        return Err(Error::input("spherical harmonics need at least one direction"));
    }
    let unit = |d: &DVec3| (d.length_squared() - 1.0).abs() < 1e-6;
    match directions.iter().position(|d| !unit(d)) {
        Some(at) => Err(Error::input(format!("direction {at} is {}: not a unit vector", directions[at]))),
        None => Ok(()),
    }
}

/// `[coefficient][direction]`.
fn transposed_harmonics(directions: &[DVec3], order: usize) -> Vec<f64> {
    let (count, samples) = (order * order, directions.len());
    let mut matrix = vec![0.0; count * samples];
    let mut harmonics = vec![0.0; count];
    for (i, direction) in directions.iter().enumerate() {
        real_sh(order, *direction, &mut harmonics);
        matrix.iter_mut().skip(i).step_by(samples).zip(&harmonics).for_each(|(out, y)| *out = *y);
    }
    matrix
}

/// Sum of products in four interleaved partial sums.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut partial = [0.0; 4];
    let (a4, b4) = (a.as_chunks::<4>(), b.as_chunks::<4>());
    for (x, y) in a4.0.iter().zip(b4.0) {
        for lane in 0..4 {
            partial[lane] += x[lane] * y[lane];
        }
    }
    let rest: f64 = a4.1.iter().zip(b4.1).map(|(x, y)| x * y).sum();
    (partial[0] + partial[2]) + (partial[1] + partial[3]) + rest
}

/// The largest sum of magnitudes of a row.
fn norm(matrix: &[f64], order: usize) -> f64 {
    matrix.chunks_exact(order).map(|row| row.iter().map(|x| x.abs()).sum::<f64>()).fold(0.0, f64::max)
}

/// L with `L L^T` = the matrix; `None` if it is not positive definite.
fn cholesky(matrix: &[f64], order: usize) -> Option<Vec<f64>> {
    let mut factor = vec![0.0; order * order];
    for i in 0..order {
        for j in 0..=i {
            let (row, other) = (&factor[i * order..i * order + j], &factor[j * order..j * order + j]);
            let rest = matrix[i * order + j] - dot(row, other);
            factor[i * order + j] = if i > j {
                rest / factor[j * order + j]
            } else if rest > 0.0 {
                rest.sqrt()
            } else {
                return None;
            };
        }
    }
    Some(factor)
}

/// Replaces `right`, `order` rows of `columns`, by the solution of `L L^T X = right`; blocks of columns in parallel.
fn solve(factor: &[f64], order: usize, right: &mut [f64], columns: usize) {
    const BLOCK: usize = 32;
    let solved: Vec<Vec<[f64; BLOCK]>> = (0..columns.div_ceil(BLOCK))
        .into_par_iter()
        .map(|block| {
            let from = block * BLOCK;
            let width = BLOCK.min(columns - from);
            let mut x = vec![[0.0; BLOCK]; order];
            for (x, row) in x.iter_mut().zip(right.chunks_exact(columns)) {
                x[..width].copy_from_slice(&row[from..from + width]);
            }
            for i in 0..order {
                let (done, rest) = x.split_at_mut(i);
                eliminate(&mut rest[0], done, factor[i * order..].iter(), factor[i * order + i]);
            }
            for i in (0..order).rev() {
                let (head, done) = x.split_at_mut(i + 1);
                let column = factor.iter().skip((i + 1) * order + i).step_by(order);
                eliminate(&mut head[i], done, column, factor[i * order + i]);
            }
            x
        })
        .collect();
    for (i, row) in right.chunks_exact_mut(columns).enumerate() {
        row.chunks_mut(BLOCK).zip(&solved).for_each(|(out, block)| out.copy_from_slice(&block[i][..out.len()]));
    }
}

/// `row = (row - Sum factor_j done_j) / pivot`.
fn eliminate<'a, const N: usize>(
    row: &mut [f64; N],
    done: &[[f64; N]],
    factors: impl Iterator<Item = &'a f64>,
    pivot: f64,
) {
    for (other, factor) in done.iter().zip(factors) {
        row.iter_mut().zip(other).for_each(|(x, y)| *x -= factor * y);
    }
    row.iter_mut().for_each(|x| *x /= pivot);
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
#[path = "harmonic_fit_tests.rs"]
mod tests;
