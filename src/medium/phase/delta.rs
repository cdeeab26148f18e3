//! Strongly forward phase functions as an unscattered peak and a smooth rest (Wiscombe 1977).

use glam::DVec3;

use super::legendre::LegendrePhase;
use crate::medium::material::OpticalProperties;

/// The delta-M split of Henyey and Greenstein's function: `p ~ f delta + (1 - f) p*` with `f = g^(L+1)` and
/// `chi_l* = (chi_l - f) / (1 - f)` for the bands up to L. L = 1 is the delta-Eddington approximation.
///
/// Light scattered into the peak counts as unscattered: `sigma_s* = (1 - f) sigma_s`, `sigma_t* = sigma_t - f sigma_s`.
///
/// # Errors of the approximation
///
/// Moments up to L are exact. Single scattering in the changed medium is *not* single scattering in the original one:
/// it includes all light that was scattered into the peak any number of times besides once out of it. That suits a
/// diffusion term with reduced coefficients, but is no truth for the term of first order alone. For a half space under
/// constant light (eta 1.3, sigma_a = 0) the albedo of first order is, from the tests, in units of that of the exact
/// function:
///
/// | g | exact | L = 1 | L = 2 | L = 3 |
/// | --- | --- | --- | --- | --- |
/// | 0.7 | 0.0108 | 1.03 | 1.56 | 1.34 |
/// | 0.9 | 0.0029 | 0.34 | 4.02 | 3.12 |
///
/// so where the first order itself is wanted at |g| >= 0.7, it is to be evaluated directly, for the few lights there
/// are (`transport::single_scattering::radiance` does). p* goes below zero by less than the plain series does: at g =
/// 0.9 and L = 1 (`chi_1* = g / (1 + g)`) it falls to -0.42 / (4 pi), where the plain series falls to -1.7 / (4 pi).
#[derive(Clone, Debug, PartialEq)]
pub struct DeltaM {
    unscattered: f64,
    phase: LegendrePhase,
}

impl DeltaM {
    /// The split for bands up to `highest_band` and g in [-1, 1]. Negative g has no forward peak: f is 0 wherever it
    /// would be negative, and the plain series remains.
    pub fn henyey_greenstein(g: f64, highest_band: usize) -> Self {
        let g = if g.is_nan() { 0.0 } else { g.clamp(-1.0, 1.0 - 1e-9) };
        let highest_band = highest_band.min(super::legendre::MOST_TERMS.isqrt() - 1);
        let unscattered = if g > 0.0 { g.powi(highest_band as i32 + 1) } else { 0.0 };
        let moments = (0..=highest_band).map(|l| (g.powi(l as i32) - unscattered) / (1.0 - unscattered)).collect();
        Self { unscattered, phase: LegendrePhase::from_moments(moments) }
    }

    /// f, the fraction of scattered light that counts as unscattered.
    pub fn unscattered(&self) -> f64 {
        self.unscattered
    }

    /// p*, the smooth rest.
    pub fn phase(&self) -> &LegendrePhase {
        &self.phase
    }

    /// `sigma_s*` and `sigma_t*` of a medium, 1/mm.
    pub fn scaled_per_mm(&self, properties: &OpticalProperties) -> (DVec3, DVec3) {
        let scattering = (1.0 - self.unscattered) * properties.sigma_s_per_mm();
        (scattering, scattering + properties.sigma_a_per_mm)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::quadrature::integrate;

    #[test]
    fn peak_and_rest_have_the_moments_of_the_whole() {
        for g in [0.0, 0.3, 0.7, 0.9, 0.99] {
            for band in 1..=4 {
                let split = DeltaM::henyey_greenstein(g, band);
                let f = split.unscattered();
                for (l, chi) in split.phase().moments().iter().enumerate() {
                    assert!((f + (1.0 - f) * chi - g.powi(l as i32)).abs() < 1e-12, "{g} {band} {l}");
                }
                let total = integrate(|c| std::f64::consts::TAU * split.phase().density(c), -1.0, 1.0, 1e-12);
                assert!((total - 1.0).abs() < 1e-11);
            }
            // The Eddington case.
            let eddington = DeltaM::henyey_greenstein(g, 1);
            assert!((eddington.unscattered() - g * g).abs() < 1e-15);
            assert!((eddington.phase().moments()[1] - g / (1.0 + g)).abs() < 1e-9);
        }
    }

    #[test]
    fn reduced_scattering_is_kept_and_backward_scattering_has_no_peak() {
        let medium = OpticalProperties {
            sigma_s_reduced_per_mm: DVec3::new(1.0, 2.0, 3.0),
            sigma_a_per_mm: DVec3::splat(0.1),
            g: 0.8,
            eta_inside_over_outside: 1.3,
        };
        for band in 1..4 {
            let split = DeltaM::henyey_greenstein(medium.g, band);
            let (scattering, extinction) = split.scaled_per_mm(&medium);
            let reduced = scattering * (1.0 - split.phase().moments()[1]);
            assert!((reduced - medium.sigma_s_reduced_per_mm).length() < 1e-12);
            assert!((extinction - scattering - medium.sigma_a_per_mm).length() < 1e-12);
        }
        let backward = DeltaM::henyey_greenstein(-0.7, 3);
        assert_eq!(backward.unscattered(), 0.0);
        assert_eq!(backward.phase(), &LegendrePhase::henyey_greenstein(-0.7, 16));
        for g in [f64::NAN, 1.0, -1.0, 5.0] {
            let split = DeltaM::henyey_greenstein(g, 1000);
            assert!(split.phase().moments().iter().all(|chi| chi.is_finite()));
        }
    }
}
