//! `F_t(eta, mu) mu` as a sum of few functions of the angle, so that irradiance rows serve every index of refraction.
//!
//! The functions are polynomials in `mu` without a constant term: the leading singular vectors of `F_t(eta, mu) mu` over
//! `mu` in [0, 1] (uniform in solid angle) and the etas of [`ETA_RANGE`], each scaled so that its coefficient is of size 1.
//! Coefficients are projections, corrected so that the hemispherical integral `Int F_t mu dmu` is exact: constant
//! light loses nothing. Polynomials rather than tables, because many directions are evaluated side by side.
//!
//! `||sum - F_t mu|| / ||F_t mu||`, largest over eta in 1..2, and in 1.2..1.6: see the test, which prints and pins it.

use std::ops::RangeInclusive;

use super::fresnel;
use crate::error::{Error, Result};
use crate::math::quadrature::gauss_legendre_cached;

/// Indices of refraction that the basis serves.
pub const ETA_RANGE: RangeInclusive<f64> = 1.0..=2.0;

/// Terms at most.
pub const MOST_TERMS: usize = 4;

/// Coefficients of each polynomial: of `mu`, `mu^2`, ...
pub const DEGREE: usize = 9;

/// Nodes in each of the intervals that the scalar products are integrated over, and their number.
const ORDER: usize = 16;
const PIECES: usize = 12;

/// Etas that the functions are made for; denser towards 1, where the angle dependence changes fastest.
const ETAS: usize = 49;

/// Sweeps of the Jacobi iteration at most; it converges in less than ten.
const SWEEPS: usize = 30;

/// Orthogonal functions f_j(mu).
#[derive(Clone, Debug, PartialEq)]
pub struct EntranceBasis {
    terms: usize,
    /// f_j(mu) = `Sum_i polynomials[j][i] mu^(i + 1)`.
    polynomials: [[f64; DEGREE]; MOST_TERMS],
    /// `Int_0^1 f_j^2 dmu`.
    squares: [f64; MOST_TERMS],
    /// `Int_0^1 f_j dmu`.
    integrals: [f64; MOST_TERMS],
}

/// Coefficients of one eta, and how well they serve it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projection {
    /// c_j; zero beyond the number of terms.
    pub coefficients: [f64; MOST_TERMS],
    /// `||Sum c_j f_j - F_t mu|| / ||F_t mu||` over `mu` in [0, 1].
    pub relative_rms: f64,
    /// Largest difference to `F_t mu` (which is at most 1) over `mu` in [0, 1].
    pub worst: f64,
}

/// Cosines and weights of a quadrature over [0, 1].
fn nodes() -> impl Iterator<Item = (f64, f64)> {
    // Squares of even steps: short intervals at grazing angles, where eta near 1 has a thin layer.
    (0..PIECES).flat_map(|i| {
        let at = |k: usize| (k as f64 / PIECES as f64).powi(2);
        let (a, b) = (at(i), at(i + 1));
        gauss_legendre_cached(ORDER)
            .iter()
            .map(move |n| (a + 0.5 * (b - a) * (n.position + 1.0), 0.5 * (b - a) * n.weight))
    })
}

fn arriving(eta: f64, mu: f64) -> f64 {
    fresnel::transmittance(eta, mu) * mu
}

fn evaluate(polynomial: &[f64; DEGREE], mu: f64) -> f64 {
    polynomial.iter().rev().fold(0.0, |sum, c| sum * mu + c) * mu
}

fn inner(a: impl Fn(f64) -> f64, b: impl Fn(f64) -> f64) -> f64 {
    nodes().map(|(mu, weight)| weight * a(mu) * b(mu)).sum()
}

/// Orthonormal polynomials of degree 1, 2, ... without a constant term.
fn orthonormal() -> Vec<[f64; DEGREE]> {
    let mut basis: Vec<[f64; DEGREE]> = Vec::new();
    for degree in 0..DEGREE {
        let mut next = [0.0; DEGREE];
        next[degree] = 1.0;
        // The second pass removes what rounding left in the first.
        for _ in 0..2 {
            for earlier in &basis {
                let overlap = inner(|mu| evaluate(&next, mu), |mu| evaluate(earlier, mu));
                next.iter_mut().zip(earlier).for_each(|(n, e)| *n -= overlap * e);
            }
        }
        let length = inner(|mu| evaluate(&next, mu), |mu| evaluate(&next, mu)).sqrt();
        basis.push(next.map(|c| c / length));
    }
    basis
}

impl EntranceBasis {
    /// The first `terms` functions, 1 to [`MOST_TERMS`] (others count as the nearest of these).
    pub fn new(terms: usize) -> Self {
        let terms = terms.clamp(1, MOST_TERMS);
        let (low, high) = (*ETA_RANGE.start(), *ETA_RANGE.end());
        let polynomials = orthonormal();
        let mut gram = vec![vec![0.0; DEGREE]; DEGREE];
        for i in 0..ETAS {
            let eta = low + (high - low) * (i as f64 / (ETAS - 1) as f64).powi(2);
            let seen: Vec<f64> =
                polynomials.iter().map(|p| inner(|mu| evaluate(p, mu), |mu| arriving(eta, mu))).collect();
            for (row, a) in gram.iter_mut().zip(&seen) {
                row.iter_mut().zip(&seen).for_each(|(g, b)| *g += a * b / ETAS as f64);
            }
        }
        let mut result = Self {
            terms,
            polynomials: [[0.0; DEGREE]; MOST_TERMS],
            squares: [0.0; MOST_TERMS],
            integrals: [0.0; MOST_TERMS],
        };
        for (j, (value, vector)) in leading_eigenvectors(gram, terms).into_iter().enumerate() {
            for (weight, polynomial) in vector.iter().zip(&polynomials) {
                let sum = result.polynomials[j].iter_mut().zip(polynomial);
                sum.for_each(|(s, c)| *s += weight * value.sqrt() * c);
            }
            let f = |mu: f64| evaluate(&result.polynomials[j], mu);
            (result.squares[j], result.integrals[j]) = (inner(f, f), inner(f, |_| 1.0));
        }
        result
    }

    /// Number of functions.
    pub fn terms(&self) -> usize {
        self.terms
    }

    /// Coefficients of `mu`, `mu^2`, ... of each function; zero beyond the number of terms.
    pub fn polynomials(&self) -> &[[f64; DEGREE]; MOST_TERMS] {
        &self.polynomials
    }

    /// f_j at a cosine.
    pub fn functions(&self, mu: f64) -> [f64; MOST_TERMS] {
        self.polynomials.map(|p| evaluate(&p, mu))
    }

    /// `Sum_j c_j f_j(mu)`.
    pub fn sum(&self, coefficients: &[f64; MOST_TERMS], mu: f64) -> f64 {
        self.functions(mu).iter().zip(coefficients).map(|(f, c)| f * c).sum()
    }

    /// Coefficients for one eta.
    ///
    /// # Errors
    /// An eta outside [`ETA_RANGE`] (exit 5): irradiance must then be sampled by rays.
    pub fn project(&self, eta_inside_over_outside: f64) -> Result<Projection> {
        let eta = eta_inside_over_outside;
        if !ETA_RANGE.contains(&eta) {
            return Err(Error::unsupported(format!(
                "the stored irradiance rows serve indices of refraction from {} to {}, and this one is {eta}; \
                 sample the light by rays instead",
                ETA_RANGE.start(),
                ETA_RANGE.end()
            )));
        }
        let mut coefficients = [0.0; MOST_TERMS];
        for (mu, weight) in nodes() {
            let (f, value) = (self.functions(mu), arriving(eta, mu));
            (0..self.terms).for_each(|j| coefficients[j] += weight * value * f[j] / self.squares[j]);
        }
        // The smallest change that makes the integral exact.
        let integral: f64 = coefficients.iter().zip(&self.integrals).map(|(c, g)| c * g).sum();
        let terms = 0..self.terms;
        let square: f64 = terms.clone().map(|j| self.integrals[j] * self.integrals[j] / self.squares[j]).sum();
        let missing = (0.5 * fresnel::diffuse_transmittance(eta) - integral) / square;
        terms.for_each(|j| coefficients[j] += missing * self.integrals[j] / self.squares[j]);
        let (mut error, mut total, mut worst) = (0.0, 0.0, 0.0f64);
        for (mu, weight) in nodes() {
            let (exact, difference) = (arriving(eta, mu), self.sum(&coefficients, mu) - arriving(eta, mu));
            error += weight * difference * difference;
            total += weight * exact * exact;
            worst = worst.max(difference.abs());
        }
        Ok(Projection { coefficients, relative_rms: (error / total).sqrt(), worst })
    }
}

/// The largest eigenvalues of a symmetric matrix, not below 0, and their unit vectors, by cyclic Jacobi rotations. Signs:
/// the component sum of each vector is not negative.
fn leading_eigenvectors(mut matrix: Vec<Vec<f64>>, count: usize) -> Vec<(f64, Vec<f64>)> {
    let n = matrix.len();
    let mut vectors: Vec<Vec<f64>> = (0..n).map(|i| (0..n).map(|j| f64::from(u8::from(i == j))).collect()).collect();
    for _ in 0..SWEEPS {
        let mut rotated = false;
        for p in 0..n {
            for q in p + 1..n {
                let (a, d, b) = (matrix[p][p], matrix[q][q], matrix[p][q]);
                if b.abs() <= f64::EPSILON * (a * d).abs().sqrt() * 0.1 || b == 0.0 {
                    continue;
                }
                rotated = true;
                let theta = 0.5 * (d - a) / b;
                let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
                let t = if theta == 0.0 { 1.0 } else { t };
                let c = 1.0 / (t * t + 1.0).sqrt();
                let s = t * c;
                for row in &mut matrix {
                    (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
                }
                for rows in [&mut matrix, &mut vectors] {
                    let (upper, lower) = rows.split_at_mut(q);
                    for (x, y) in upper[p].iter_mut().zip(&mut lower[0]) {
                        (*x, *y) = (c * *x - s * *y, s * *x + c * *y);
                    }
                }
            }
        }
        if !rotated {
            break;
        }
    }
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&i, &j| matrix[j][j].total_cmp(&matrix[i][i]).then(i.cmp(&j)));
    order
        .into_iter()
        .take(count)
        .map(|i| {
            let sign = if vectors[i].iter().sum::<f64>() < 0.0 { -1.0 } else { 1.0 };
            (matrix[i][i].max(f64::MIN_POSITIVE), vectors[i].iter().map(|v| sign * v).collect())
        })
        .collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn etas() -> impl Iterator<Item = f64> {
        (0..=200).map(|i| 1.0 + f64::from(i) / 200.0)
    }

    #[test]
    fn the_error_falls_with_every_term() {
        let limits = [0.1, 0.02, 0.006, 0.003];
        for terms in 1..=MOST_TERMS {
            let basis = EntranceBasis::new(terms);
            let worst = |range: RangeInclusive<f64>| {
                let all = etas().filter(|eta| range.contains(eta)).map(|eta| basis.project(eta).unwrap());
                all.fold((0.0f64, 0.0f64), |w, p| (w.0.max(p.relative_rms), w.1.max(p.worst)))
            };
            println!("{terms} terms: 1..2 {:?}, 1.2..1.6 {:?}", worst(1.0..=2.0), worst(1.2..=1.6));
            assert!(worst(1.0..=2.0).0 < limits[terms - 1], "{terms}");
        }
    }

    #[test]
    fn functions_are_orthogonal_and_constant_light_is_exact() {
        let basis = EntranceBasis::new(3);
        for j in 0..3 {
            for k in 0..j {
                let product = inner(|mu| basis.functions(mu)[j], |mu| basis.functions(mu)[k]);
                assert!(product.abs() < 1e-9 * (basis.squares[j] * basis.squares[k]).sqrt(), "{j} {k} {product}");
            }
        }
        for eta in etas() {
            let coefficients = basis.project(eta).unwrap().coefficients;
            let integral: f64 = nodes().map(|(mu, weight)| weight * basis.sum(&coefficients, mu)).sum();
            assert!((2.0 * integral - fresnel::diffuse_transmittance(eta)).abs() < 1e-12);
        }
    }

    #[test]
    fn other_indices_are_refused() {
        let basis = EntranceBasis::new(2);
        for eta in [0.4, 0.999, 2.001, f64::NAN, f64::INFINITY] {
            assert!(basis.project(eta).unwrap_err().message().contains("sample the light"));
        }
        assert_eq!(EntranceBasis::new(0).terms(), 1);
    }
}
