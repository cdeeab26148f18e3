//! Real spherical harmonics: values, fits of samples, windows against ringing.
//!
//! `y_l^m` as in Sloan, Kautz & Snyder 2002 and Hao & Varshney 2004, section 4.1: `sqrt(2) K cos(m phi) P_l^m(cos theta)` for
//! m > 0, `sqrt(2) K sin(-m phi) P_l^-m(cos theta)` for m < 0, `K P_l^0(cos theta)` for m = 0, with
//! `(x, y, z) = (sin theta cos phi, sin theta sin phi, cos theta)` and the factor (-1)^m in `P_l^m`, so that
//! `y_1 = sqrt(3 / (4 pi)) (-y, z, -x)`. They are orthonormal over the sphere. Order `n` has the bands l = 0 to n - 1, and
//! coefficient `(l, m)` lies at `l l + l + m`.

use std::f64::consts::PI;

use glam::DVec3;
use rayon::prelude::*;

use crate::error::{Error, Result};

/// Largest order that is tested and that a [`Fit`] takes.
pub const MOST_ORDER: usize = 32;

/// Condition number of the normal equations above which a fit is refused: what is left of 16 digits is then less than 6.
const MOST_CONDITION: f64 = 1e10;

/// Band of the coefficient at this index.
pub fn band(index: usize) -> usize {
    index.isqrt()
}

/// `order^2` harmonics of a unit vector, index `l l + l + m`; of them as many as `out` holds.
///
/// Legendre functions are normalised from the start and divided by `sin^m theta`, whose part goes with `cos(m phi)` and
/// `sin(m phi)`: nothing overflows, and the poles need no care.
pub fn real_sh(order: usize, direction: DVec3, out: &mut [f64]) {
    let DVec3 { x, y, z } = direction;
    // K_m^m (2m - 1)!! with its sign, and sin^m theta times cos and sin of m phi.
    let (mut sectoral, mut cosine, mut sine) = ((0.25 / PI).sqrt(), 1.0, 0.0);
    let mut set = |index: usize, value: f64| {
        if let Some(out) = out.get_mut(index) {
            *out = value;
        }
    };
    for m in 0..order {
        let (mut before, mut legendre) = (0.0, sectoral);
        for l in m..order {
            if m == 0 {
                set(l * l + l, legendre);
            } else {
                set(l * l + l + m, std::f64::consts::SQRT_2 * cosine * legendre);
                set(l * l + l - m, std::f64::consts::SQRT_2 * sine * legendre);
            }
            let next = step(l + 1, m, z * legendre, before);
            (before, legendre) = (legendre, next);
        }
        let k = m as f64;
        sectoral *= -((2.0 * k + 3.0) / (2.0 * k + 2.0)).sqrt();
        (cosine, sine) = (x * cosine - y * sine, x * sine + y * cosine);
    }
}

/// The normalised `P_l^m` from `z P_(l-1)^m` and `P_(l-2)^m`.
fn step(l: usize, m: usize, z_times_last: f64, before: f64) -> f64 {
    let (l, m) = (l as f64, m as f64);
    let last = l - 1.0;
    let scale = ((4.0 * l * l - 1.0) / (l * l - m * m)).sqrt();
    let back = ((last * last - m * m) / (4.0 * last * last - 1.0)).max(0.0).sqrt();
    scale * (z_times_last - back * before)
}

/// `Sum c_i y_i` for `order^2` coefficients; further ones of an incomplete band are left out.
pub fn evaluate(coefficients: &[f64], direction: DVec3) -> f64 {
    let order = coefficients.len().isqrt();
    let mut harmonics = vec![0.0; order * order];
    real_sh(order, direction, &mut harmonics);
    coefficients.iter().zip(&harmonics).map(|(c, y)| c * y).sum()
}

/// Coefficients of functions that are known at some directions.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit {
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
    pub fn new(directions: &[DVec3], order: usize, weights: Option<&[f64]>) -> Result<Self> {
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

    /// Projection by plain quadrature, `c_k = 4 pi / N Sum_i v_i y_k(direction_i)`: what the paper does for its uniform set. Its
    /// error falls with the number of directions, where that of [`Fit::new`] is the part beyond the order only.
    ///
    /// # Errors
    /// As [`Fit::new`], but fewer directions will do; at least one.
    pub fn quadrature(directions: &[DVec3], order: usize) -> Result<Self> {
        check(directions, order)?;
        let samples = directions.len();
        let mut matrix = transposed_harmonics(directions, order);
        matrix.iter_mut().for_each(|y| *y *= 4.0 * PI / samples as f64);
        Ok(Self { order, samples, matrix, condition: 1.0 })
    }

    /// The order.
    pub fn order(&self) -> usize {
        self.order
    }

    /// Number of directions.
    pub fn samples(&self) -> usize {
        self.samples
    }

    /// Condition number of the normal equations in the norm of row sums; 1 for quadrature.
    pub fn condition(&self) -> f64 {
        self.condition
    }

    /// The matrix that makes coefficients of values, `[coefficient][direction]`.
    pub fn matrix(&self) -> &[f64] {
        &self.matrix
    }

    /// `order^2` coefficients of the function with these values at the directions.
    ///
    /// # Errors
    /// Another number of values than directions (exit 3).
    pub fn coefficients(&self, values: &[f64]) -> Result<Vec<f64>> {
        if values.len() != self.samples {
            return Err(Error::input(format!("{} values for {} directions", values.len(), self.samples)));
        }
        Ok(self.matrix.chunks_exact(self.samples).map(|row| dot(row, values)).collect())
    }
}

/// Factors by band that trade sharpness against ringing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
pub enum Window {
    /// All factors are 1.
    None,
    /// `sin(pi l / n) / (pi l / n)`.
    Lanczos,
    /// `(1 + cos(pi l / n)) / 2`.
    Hanning,
}

impl Window {
    /// Every window.
    pub const ALL: [Self; 3] = [Self::None, Self::Lanczos, Self::Hanning];

    /// The factor of band `l` in order `n`: 1 for band 0, towards 0 at band `n`.
    pub fn factor(self, l: usize, n: usize) -> f64 {
        let x = PI * l as f64 / n.max(1) as f64;
        match self {
            _ if l == 0 => 1.0,
            Self::None => 1.0,
            Self::Lanczos => x.sin() / x,
            Self::Hanning => 0.5 + 0.5 * x.cos(),
        }
    }

    /// Multiplies `order^2` coefficients.
    pub fn apply(self, coefficients: &mut [f64]) {
        let order = coefficients.len().isqrt();
        for (i, c) in coefficients.iter_mut().enumerate() {
            *c *= self.factor(band(i), order);
        }
    }
}

/// How far values fall below 0, relative to the largest of them: 0 if none does, infinite if none is positive.
pub fn undershoot(values: impl IntoIterator<Item = f64>) -> f64 {
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
#[path = "sh_tests.rs"]
mod tests;
