//! Total reflectance of a half space by transport theory, without diffusion: what walks through a thick flat body give.
//!
//! Scattering is isotropic, with the reduced coefficients. Below the boundary the medium reflects by Chandrasekhar's H
//! function ("Radiative Transfer", 1950, section 38), whose logarithm is an integral over one variable (Fock 1944); the
//! boundary sends a share of what rises back down, which makes a linear equation for the radiance that rises.

use std::f64::consts::{FRAC_1_PI, FRAC_PI_2};

use super::fresnel::{diffuse_transmittance, reflectance_inside};
use super::material::OpticalProperties;
use crate::math::quadrature::{gauss_legendre_cached, integrate_with};

/// Directions on each side of the critical angle, and points of the integral of H: with these the total is exact to 4e-6.
const DIRECTIONS: usize = 24;
const POINTS: usize = 64;

/// Change of the radiance, relative to what enters, at which the iteration ends, and the most rounds.
const SETTLED: f64 = 1e-13;
const MOST_ROUNDS: usize = 4000;

/// A direction inside, of the quadrature over the upper or the lower hemisphere.
struct Direction {
    cosine: f64,
    /// Weight of `Int_0^1 f(mu) dmu`.
    weight: f64,
    /// Share of what rises here that the boundary sends down.
    reflected: f64,
}

/// Directions with nodes dense at the horizon and at the critical angle, where the boundary's reflectance has its kinks.
fn directions(eta: f64) -> Vec<Direction> {
    let critical = if eta > 1.0 { ((eta - 1.0) * (eta + 1.0)).sqrt() / eta } else { 0.0 };
    let mut all = Vec::with_capacity(2 * DIRECTIONS);
    for (from, to) in [(0.0, critical), (critical, 1.0)] {
        for node in gauss_legendre_cached(DIRECTIONS).iter().filter(|_| to > from) {
            let (at, width) = (0.5 * (1.0 + node.position), to - from);
            let cosine = from + width * at * at;
            all.push(Direction {
                cosine,
                weight: node.weight * width * at,
                reflected: reflectance_inside(eta, cosine),
            });
        }
    }
    all
}

/// ln(1 - albedo atan(t) / t) for t >= 0, with `absorbed` = 1 - albedo, which keeps its digits where both are small.
fn ln_of_dispersion(absorbed: f64, t: f64) -> f64 {
    let square = t * t;
    let less = if t < 1e-2 { square * (1.0 / 3.0 - square * (0.2 - square / 7.0)) } else { 1.0 - t.atan() / t };
    (absorbed + (1.0 - absorbed) * less).max(f64::MIN_POSITIVE).ln()
}

/// Chandrasekhar's H of isotropic scattering at a cosine in (0, 1].
fn h_function(absorbed: f64, cosine: f64) -> f64 {
    // psi = (pi / 2) v^3: the logarithm of a medium that absorbs nothing is dense at psi = 0.
    let rule = gauss_legendre_cached(POINTS);
    let integrand = |v: f64| {
        let t = (FRAC_PI_2 * v * v * v).tan() / cosine;
        3.0 * FRAC_PI_2 * v * v * ln_of_dispersion(absorbed, t)
    };
    (-FRAC_1_PI * integrate_with(rule, 0.0, 1.0, integrand)).exp()
}

/// The share of constant light of the whole hemisphere, once it has entered, that leaves again; 0 without extinction.
/// `absorbed` is sigma_a / sigma_t', in [0, 1].
fn total(absorbed: f64, eta: f64) -> f64 {
    let all = directions(eta);
    let h: Vec<f64> = all.iter().map(|d| h_function(absorbed, d.cosine)).collect();
    let half_albedo = 0.5 * (1.0 - absorbed);
    let risen = |falling: &[f64]| -> Vec<f64> {
        let of = |(d, h_there): (&Direction, &f64)| {
            let terms = all.iter().zip(&h).zip(falling);
            let sum: f64 = terms.map(|((s, h), f)| s.weight * s.cosine / (d.cosine + s.cosine) * h * f).sum();
            half_albedo * h_there * sum
        };
        all.iter().zip(&h).map(of).collect()
    };
    // By reciprocity of the boundary.
    let entering: Vec<f64> = all.iter().map(|d| eta * eta * (1.0 - d.reflected)).collect();
    let mut rising = risen(&entering);
    for _ in 0..MOST_ROUNDS {
        let falling: Vec<f64> =
            all.iter().zip(&rising).zip(&entering).map(|((d, up), down)| down + d.reflected * up).collect();
        let next = risen(&falling);
        let change = next.iter().zip(&rising).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        rising = next;
        if change <= SETTLED * eta * eta {
            break;
        }
    }
    let leaving: f64 = all.iter().zip(&rising).map(|(d, up)| d.weight * d.cosine * (1.0 - d.reflected) * up).sum();
    (2.0 * leaving / diffuse_transmittance(eta)).clamp(0.0, 1.0)
}

/// Total diffuse reflectance of a half space by transport theory, RGB: of what constant light brings below the surface
/// the share that leaves, all orders of scattering.
///
/// The boundary is smooth, as in walks. Exact to 4e-6 for isotropic scattering; g enters by the reduced coefficients alone.
pub fn total_reflectance(properties: &OpticalProperties) -> [f64; 3] {
    let extinction = properties.sigma_t_reduced_per_mm().to_array();
    let absorption = properties.sigma_a_per_mm.to_array();
    [0, 1, 2].map(|c| match extinction[c] > 0.0 {
        true => total((absorption[c] / extinction[c]).clamp(0.0, 1.0), properties.eta_inside_over_outside),
        false => 0.0,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::uniform;
    use crate::medium::fresnel::CosineTransmittance;

    #[test]
    fn h_is_the_tabulated_function() {
        // Chandrasekhar's table XI, albedo 1: mu, H.
        for (cosine, known) in [(1.0, 2.907_81), (0.5, 2.012_78)] {
            let h = h_function(0.0, cosine);
            assert!((h - known).abs() < 2e-5, "{cosine}: {h}");
        }
        // Its integral equation, and the mean that follows: alpha / 2 Int H = 1 - sqrt(1 - alpha).
        for absorbed in [0.0, 1e-6, 0.01, 0.3, 0.9] {
            let all = directions(1.0);
            let mean: f64 = all.iter().map(|d| d.weight * h_function(absorbed, d.cosine)).sum();
            let expected = 1.0 - f64::sqrt(absorbed);
            assert!((0.5 * (1.0 - absorbed) * mean - expected).abs() < 3e-6, "{absorbed}: {mean}");
        }
    }

    #[test]
    fn what_absorbs_nothing_sends_all_back_and_what_scatters_nothing_none() {
        for eta in [0.7, 1.0, 1.000_001, 1.3, 1.5, 2.0, 3.0] {
            assert!((total(0.0, eta) - 1.0).abs() < 4e-6, "{eta}: {}", total(0.0, eta));
            assert_eq!(total(1.0, eta), 0.0);
            let rising: Vec<f64> = (0..20).map(|i| total(1.0 - f64::from(i) / 20.0, eta)).collect();
            assert!(rising.windows(2).all(|pair| pair[0] < pair[1]), "{eta}: {rising:?}");
        }
    }

    /// Walks of photons below a plane, apart from those of the program: weight at the depth, no boundary but by chance.
    fn walked(absorbed: f64, eta: f64, photons: u64) -> f64 {
        let entrance = CosineTransmittance::new(eta);
        let mut sum = 0.0;
        for photon in 0..photons {
            let mut drawn = 0;
            let mut random = || {
                drawn += 1;
                uniform(7, photon, drawn)
            };
            let outside = entrance.sample_entrance_cosine(random());
            let mut mu = -(1.0 - (1.0 - outside * outside) / (eta * eta)).max(0.0).sqrt();
            let (mut depth, mut weight) = (0.0, 1.0);
            while weight > 1e-6 {
                let next = depth - mu * -(1.0 - random()).ln();
                if next < 0.0 {
                    // What is sent back starts anew at the surface: free paths have no memory.
                    if random() >= reflectance_inside(eta, mu) {
                        sum += weight;
                        break;
                    }
                    (depth, mu) = (0.0, -mu);
                    continue;
                }
                depth = next;
                weight *= 1.0 - absorbed;
                mu = 2.0 * random() - 1.0;
            }
        }
        sum / photons as f64
    }

    #[test]
    fn walks_below_a_plane_agree() {
        let photons = 40_000;
        for (absorbed, eta) in [(0.02, 1.3), (0.2, 1.5), (0.6, 1.0), (0.1, 0.8)] {
            let (theory, walk) = (total(absorbed, eta), walked(absorbed, eta, photons));
            let sigma = (walk * (1.0 - walk) / photons as f64).sqrt();
            assert!((theory - walk).abs() < 4.0 * sigma, "{absorbed} {eta}: {theory} {walk} +- {sigma}");
        }
    }
}
