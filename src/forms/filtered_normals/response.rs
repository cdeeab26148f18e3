//! Responses of filters, and the ladder that stands for all of them.
//!
//! Stored are normals under a few low passes, `1 / (1 + t lambda)` at rungs t. The response that a material implies, Gaussians and
//! exponentials are sums of such over t or near them, so that a sum over the rungs stands for any of them, and the filter changes without
//! a new bake.

use super::settings::Response;
use crate::medium::dipole::Dipole;
use crate::medium::fresnel::BoundaryFit;
use crate::medium::material::Medium;

/// Places where responses are compared.
const PLACES: usize = 192;

/// Decades of lambda beyond the rungs at either end.
const BEYOND: f64 = 1.0;

/// Weight of lambda = 0, where the response is 1: constants stay.
const AT_ZERO: f64 = 100.0;

/// Weight of the squares of the coefficients: the quantiser's noise grows with them.
const RIDGE: f64 = 2e-3;

/// Response of a channel's filter at an eigenvalue `lambda`, 1/mm^2; 1 at 0.
pub(super) fn response(kind: Response, dipole: &Dipole, lambda: f64) -> f64 {
    match kind {
        Response::Material => {
            // The Hankel transform of (1 + sigma d) exp(-sigma d) z / (2 pi d^3) is exp(-z sqrt(sigma^2 + omega^2)).
            let sigma2 = dipole.sigma_tr_per_mm * dipole.sigma_tr_per_mm;
            let beyond = lambda / ((sigma2 + lambda).sqrt() + sigma2.sqrt()).max(f64::MIN_POSITIVE);
            let pole = |z: f64| (-dipole.sigma_tr_per_mm * z).exp();
            let (real, virtual_) = (dipole.z_real_mm, dipole.z_virtual_mm);
            let total = pole(real) + pole(virtual_);
            let at = pole(real) * (-real * beyond).exp() + pole(virtual_) * (-virtual_ * beyond).exp();
            // Where nothing returns, it does not matter which.
            if total > 0.0 { at / total } else { (-real * beyond).exp() }
        }
        Response::Gaussian(mm) => (-0.5 * lambda * mm * mm).exp(),
        Response::Exponential(sigma) => {
            let sigma = sigma.unwrap_or(dipole.sigma_tr_per_mm);
            if lambda == 0.0 { 1.0 } else { (1.0 + lambda / (sigma * sigma)).powf(-1.5) }
        }
    }
}

/// The dipoles of a medium's channels.
pub(super) fn dipoles(medium: &Medium) -> [Dipole; 3] {
    medium.properties.dipoles(BoundaryFit::Published)
}

/// A ladder of low passes.
#[derive(Clone, Debug)]
pub(super) struct Ladder {
    /// t of each rung, mm^2.
    t_mm2: Vec<f64>,
    /// Places on the axis of lambda, 1/mm^2, the first of them 0.
    lambda: Vec<f64>,
    /// Weights of the response at each place in each coefficient, that of the unfiltered normal first.
    inverse: Vec<Vec<f64>>,
}

impl Ladder {
    /// A ladder of rungs with widths `sqrt(t)`, mm.
    pub(super) fn new(widths_mm: &[f64]) -> Self {
        let t_mm2: Vec<f64> = widths_mm.iter().map(|w| w * w).collect();
        let most = t_mm2.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
        let least = t_mm2.iter().copied().fold(most, f64::min);
        let (low, high) = (-most.log10() - BEYOND, -least.log10() + BEYOND);
        let step = (high - low) / (PLACES - 2) as f64;
        let places = (0..PLACES - 1).map(|i| 10f64.powf(low + step * i as f64));
        let lambda: Vec<f64> = std::iter::once(0.0).chain(places).collect();
        let weight = |i: usize| if i == 0 { AT_ZERO } else { 1.0 };
        let of_rung = |rung: usize, lambda: f64| if rung == 0 { 1.0 } else { 1.0 / (1.0 + t_mm2[rung - 1] * lambda) };
        let rungs = t_mm2.len() + 1;
        let ridge = RIDGE * RIDGE * PLACES as f64;
        let mut normal = vec![vec![0.0; rungs + PLACES]; rungs];
        for (i, row) in normal.iter_mut().enumerate() {
            for (j, value) in row.iter_mut().enumerate().take(rungs) {
                let sum = lambda.iter().enumerate().map(|(k, l)| weight(k) * of_rung(i, *l) * of_rung(j, *l));
                *value = sum.sum::<f64>() + if i == j { ridge } else { 0.0 };
            }
            for (k, l) in lambda.iter().enumerate() {
                row[rungs + k] = weight(k) * of_rung(i, *l);
            }
        }
        eliminate(&mut normal);
        let inverse = normal.into_iter().map(|row| row[rungs..].to_vec()).collect();
        Self { t_mm2, lambda, inverse }
    }

    /// Coefficients of the unfiltered normal and of the rungs for `alpha + (1 - alpha) F(width^2 lambda)`, and the largest error of the
    /// response.
    pub(super) fn coefficients(&self, alpha: f64, width: f64, f: impl Fn(f64) -> f64) -> (Vec<f64>, f64) {
        let wanted: Vec<f64> = self.lambda.iter().map(|l| alpha + (1.0 - alpha) * f(width * width * l)).collect();
        let dot = |row: &Vec<f64>| row.iter().zip(&wanted).map(|(a, b)| a * b).sum::<f64>();
        let mut coefficients: Vec<f64> = self.inverse.iter().map(dot).collect();
        let sum: f64 = coefficients.iter().sum();
        if sum > 0.5 {
            coefficients.iter_mut().for_each(|c| *c /= sum);
        }
        let found = |l: f64| {
            let rungs = self.t_mm2.iter().zip(&coefficients[1..]);
            coefficients[0] + rungs.map(|(t, c)| c / (1.0 + t * l)).sum::<f64>()
        };
        let error = self.lambda.iter().zip(&wanted).map(|(l, w)| (found(*l) - w).abs()).fold(0.0, f64::max);
        (coefficients, error)
    }
}

/// Solves for every column behind the square of a small positive definite system, in place.
fn eliminate(rows: &mut [Vec<f64>]) {
    for pivot in 0..rows.len() {
        let factor = 1.0 / rows[pivot][pivot];
        rows[pivot].iter_mut().for_each(|v| *v *= factor);
        let own = rows[pivot].clone();
        for (_, row) in rows.iter_mut().enumerate().filter(|(i, _)| *i != pivot) {
            let factor = row[pivot];
            row.iter_mut().zip(&own).for_each(|(v, own)| *v -= factor * own);
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::math::quadrature::gauss_legendre;
    use crate::medium::material::{PRESETS, preset};
    use crate::medium::profile::Profile;

    /// J_0 by its integral.
    fn bessel(x: f64) -> f64 {
        let count = 200;
        let angle = |i: usize| std::f64::consts::PI * (i as f64 + 0.5) / f64::from(count);
        (0..count as usize).map(|i| (x * angle(i).sin()).cos()).sum::<f64>() / f64::from(count)
    }

    #[test]
    fn the_response_is_the_hankel_transform_of_the_profile() {
        for name in ["skin1", "marble", "ketchup"] {
            let medium = Medium { name: name.into(), properties: preset(name).unwrap().properties() };
            for dipole in &dipoles(&medium) {
                for omega in [0.0, 0.3, 2.0] {
                    let range = dipole.range_mm(1e-6).min(60.0);
                    let rule = gauss_legendre(64);
                    let pieces = 400;
                    let mut sum = 0.0;
                    for piece in 0..pieces {
                        let (from, step) = (f64::from(piece) * range / f64::from(pieces), range / f64::from(pieces));
                        for node in &rule {
                            let r = from + 0.5 * step * (node.position + 1.0);
                            let weight = 0.5 * step * node.weight * std::f64::consts::TAU * r;
                            sum += weight * dipole.reflectance(r) * bessel(omega * r);
                        }
                    }
                    let found = response(Response::Material, dipole, omega * omega) * dipole.total();
                    assert!((found - sum).abs() < 5e-3 * dipole.total(), "{name} {omega}: {found} {sum}");
                }
            }
        }
    }

    /// Any published material, on an object of 30 mm with edges of 0.3 mm.
    #[test]
    fn a_ladder_stands_for_every_material() {
        let rungs: Vec<f64> = (0..8).map(|i| 7.5 * (0.15f64 / 7.5).powf(f64::from(i) / 7.0)).collect();
        let ladder = Ladder::new(&rungs);
        for preset in &PRESETS {
            let medium = Medium { name: preset.name.into(), properties: preset.properties() };
            for dipole in &dipoles(&medium) {
                let (c, error) = ladder.coefficients(0.2, 1.0, |l| response(Response::Material, dipole, l));
                assert!(error < 0.02, "{}: {error}", preset.name);
                assert!((c.iter().sum::<f64>() - 1.0).abs() < 1e-9 && c.iter().all(|c| c.abs() < 5.0), "{c:?}");
            }
        }
        for mm in [0.4, 1.0, 4.0] {
            let dipole = Dipole::new(1.0, 0.1, 1.0);
            let (_, error) = ladder.coefficients(0.0, 1.0, |l| response(Response::Gaussian(mm), &dipole, l));
            assert!(error < 0.06, "Gaussian of {mm}: {error}");
            let exponential = Response::Exponential(Some(1.0 / mm));
            let (_, error) = ladder.coefficients(0.0, 1.0, |l| response(exponential, &dipole, l));
            assert!(error < 0.06, "exponential of {mm}: {error}");
        }
        let (c, error) = ladder.coefficients(1.0, 1.0, |_| 0.3);
        assert!(error < 1e-3 && (c[0] - 1.0).abs() < 0.1, "{c:?}");
    }
}
