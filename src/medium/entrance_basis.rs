//! `F_t(eta, mu) mu` as a sum of few functions of the angle, so that irradiance rows serve every index of refraction.
//!
//! The functions are polynomials in `mu` without a constant term: the leading singular vectors of `F_t(eta, mu) mu`
//! over `mu` in [0, 1] (uniform in solid angle) and the etas of [`ETA_RANGE`], each scaled so that its coefficient is
//! of size 1. Coefficients are projections, corrected so that the hemispherical integral `Int F_t mu dmu` is exact:
//! constant light loses nothing. Polynomials rather than tables, because many directions are evaluated side by side.
//!
//! `||sum - F_t mu|| / ||F_t mu||`, largest over eta in 1..2, and in 1.2..1.6: see the test, which prints and pins it.

use std::ops::RangeInclusive;

use super::fresnel;
use crate::error::{Error, Result};
use crate::math::quadrature::gauss_legendre_cached;

/// Indices of refraction that the basis serves.
pub const ETA_RANGE: RangeInclusive<f64> = 1.0..=2.0;

/// Largest number of terms.
pub const MOST_TERMS: usize = 4;

/// Coefficients of each polynomial: of `mu`, `mu^2`, ...
pub const DEGREE: usize = 9;

/// Nodes in each interval of the scalar products' quadrature, and number of intervals.
const ORDER: usize = 16;
const PIECES: usize = 12;

/// Number of etas that the functions are made for; denser towards 1, where the angle dependence changes fastest.
const ETAS: usize = 49;

/// Largest number of sweeps of the Jacobi iteration; it converges in less than ten.
const SWEEPS: usize = 30;

/// Accepted lengths `sqrt(Int f_j^2)` of stored functions; functions made here have 0.55 to 0.0005.
const SIZES: RangeInclusive<f64> = 1e-6..=1e6;

/// Largest cosine of the angle between stored functions.
const MOST_OVERLAP: f64 = 1e-6;

/// Least share of the constant 1 that stored functions must hold; functions made here hold 0.7 and more.
const LEAST_CONSTANT: f64 = 0.01;

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

/// Coefficients for one eta, with their errors.
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

/// The polynomial nearest to `F_t(eta, mu) mu`, coefficients of `mu`, `mu^2`, ...; its integral is exact. Relative RMS
/// 1e-3 at most for eta from 1 to 2; below 1, where light is reflected totally from an angle on, up to a few percent.
pub fn polynomial(eta_inside_over_outside: f64) -> [f64; DEGREE] {
    let mut result = [0.0; DEGREE];
    for p in orthonormal() {
        let length = inner(|mu| evaluate(&p, mu), |mu| arriving(eta_inside_over_outside, mu));
        result.iter_mut().zip(&p).for_each(|(sum, c)| *sum += length * c);
    }
    let wanted = inner(|mu| arriving(eta_inside_over_outside, mu), |_| 1.0);
    let found = inner(|mu| evaluate(&result, mu), |_| 1.0);
    if found != 0.0 { result.map(|c| c * wanted / found) } else { result }
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
        let mut functions = [[0.0; DEGREE]; MOST_TERMS];
        let leading = leading_eigenvectors(gram, terms);
        for (function, (value, vector)) in functions.iter_mut().zip(leading) {
            for (weight, polynomial) in vector.iter().zip(&polynomials) {
                function.iter_mut().zip(polynomial).for_each(|(f, c)| *f += weight * value.sqrt() * c);
            }
        }
        Self::of(terms, functions)
    }

    /// The functions that rows were stored with: the coefficients of `mu`, `mu^2`, ... of each.
    ///
    /// # Errors
    /// No functions or more than [`MOST_TERMS`], functions that are not orthogonal, too small or too large, or so far
    /// from a constant that no integral can be made exact (exit 3). Accepted functions give finite coefficients.
    pub fn from_polynomials(polynomials: &[[f64; DEGREE]]) -> Result<Self> {
        let terms = polynomials.len();
        if !(1..=MOST_TERMS).contains(&terms) {
            let message = format!("{terms} functions of the angle for irradiance rows: 1 to {MOST_TERMS} are possible");
            return Err(Error::input(message));
        }
        let mut functions = [[0.0; DEGREE]; MOST_TERMS];
        functions.iter_mut().zip(polynomials).for_each(|(function, polynomial)| *function = *polynomial);
        let result = Self::of(terms, functions);
        let fail =
            |what: String| Err(Error::input(format!("the functions of the angle of the irradiance rows: {what}")));
        for (j, square) in result.squares.iter().take(terms).enumerate() {
            // NaN anywhere makes this NaN, which is no size.
            if !SIZES.contains(&square.sqrt()) {
                return fail(format!(
                    "number {j} has the size {:e}, not {:e} to {:e}",
                    square.sqrt(),
                    SIZES.start(),
                    SIZES.end()
                ));
            }
            for (k, other) in result.squares.iter().take(j).enumerate() {
                let product = inner(|mu| evaluate(&functions[j], mu), |mu| evaluate(&functions[k], mu));
                if product.abs() > MOST_OVERLAP * (square * other).sqrt() {
                    return fail(format!("numbers {k} and {j} are not orthogonal"));
                }
            }
        }
        let constant = result.share_of_constant();
        if constant < LEAST_CONSTANT {
            return fail(format!("they hold a share of {constant:e} of a constant, less than {LEAST_CONSTANT}"));
        }
        Ok(result)
    }

    /// A basis of these functions, with their squares and integrals.
    fn of(terms: usize, polynomials: [[f64; DEGREE]; MOST_TERMS]) -> Self {
        let square = |p: &[f64; DEGREE]| inner(|mu| evaluate(p, mu), |mu| evaluate(p, mu));
        let integral = |p: &[f64; DEGREE]| inner(|mu| evaluate(p, mu), |_| 1.0);
        let (squares, integrals) = (polynomials.each_ref().map(square), polynomials.each_ref().map(integral));
        Self { terms, polynomials, squares, integrals }
    }

    /// Squared length of the projection of the constant 1 on the functions, at most 1.
    fn share_of_constant(&self) -> f64 {
        (0..self.terms).map(|j| self.integrals[j] * self.integrals[j] / self.squares[j]).sum()
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
        let missing = (0.5 * fresnel::diffuse_transmittance(eta) - integral) / self.share_of_constant();
        (0..self.terms).for_each(|j| coefficients[j] += missing * self.integrals[j] / self.squares[j]);
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

/// The largest eigenvalues of a symmetric matrix, not below 0, and their unit vectors, by cyclic Jacobi rotations.
/// Signs: the component sum of each vector is not negative.
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
            let worst = etas().map(|eta| basis.project(eta).unwrap().relative_rms).fold(0.0, f64::max);
            assert!(worst < limits[terms - 1], "{terms} {worst}");
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
    fn stored_functions_give_the_same_coefficients() {
        for terms in 1..=MOST_TERMS {
            let basis = EntranceBasis::new(terms);
            let stored = EntranceBasis::from_polynomials(&basis.polynomials()[..terms]).unwrap();
            assert_eq!(stored, basis);
        }
        // The example of the format's page.
        let mut page = [[0.0; DEGREE]; 2];
        (page[0][0], page[1][0], page[1][1]) = (1.0, -0.75, 1.0);
        let found = EntranceBasis::from_polynomials(&page).unwrap().project(1.5).unwrap().coefficients;
        let text = found.map(|c| format!("{c:.6}"));
        assert_eq!(text, ["0.927613", "0.232692", "0.000000", "0.000000"]);
    }

    #[test]
    fn useless_functions_are_refused_and_others_are_harmless() {
        let of = |scale: f64, first: usize, second: usize| {
            let mut polynomials = [[0.0; DEGREE]; 2];
            (polynomials[0][first], polynomials[1][second]) = (scale, 1.0);
            polynomials
        };
        let refused = |polynomials: &[[f64; DEGREE]]| EntranceBasis::from_polynomials(polynomials).unwrap_err();
        assert!(refused(&[]).message().contains("1 to 4"));
        assert!(refused(&[[1.0; DEGREE]; 5]).message().contains("1 to 4"));
        for scale in [f64::NAN, f64::INFINITY, f64::MAX, 0.0, 1e-200, f64::MIN_POSITIVE] {
            assert!(refused(&of(scale, 0, 1)).message().contains("number 0 has the size"), "{scale}");
        }
        assert!(refused(&of(1.0, 0, 1)).message().contains("not orthogonal"));
        assert!(refused(&[[1.0, -1.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]]).message().contains("of a constant"));
        let numbers = [0.0, 1.0, -1.0, 1e-300, 1e-6, 1e6, 1e300, -1e-9, 0.3];
        let mut accepted = 0;
        for (i, a) in numbers.iter().enumerate() {
            for b in &numbers[i..] {
                for c in numbers {
                    let polynomial = [*a, *b, c, c, *a, 0.0, 0.0, *b, 0.0];
                    let Ok(basis) = EntranceBasis::from_polynomials(&[polynomial]) else { continue };
                    accepted += 1;
                    let found = basis.project(1.3).unwrap();
                    assert!(found.coefficients.iter().all(|c| (*c as f32).is_finite()), "{polynomial:?}");
                }
            }
        }
        assert!(accepted > 20, "{accepted}");
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
