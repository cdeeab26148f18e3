//! Exit radiance towards the eye, from radiosity.

use std::f64::consts::FRAC_1_PI;

use crate::medium::fresnel::{diffuse_transmittance, transmittance};

/// Normalisation of the exit Fresnel factor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, clap::ValueEnum)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum ExitFresnel {
    /// `L = F_t(eta, mu) B / (pi C)` with `C = 2 Int_0^1 F_t mu dmu`, so that `Int L mu dw = B`.
    #[default]
    #[value(help = "All that leaves adds up to the radiosity")]
    Normalised,
    /// `L = F_t(eta, mu) B / pi`, as in the papers: their pictures are darker by C.
    #[value(help = "As in the papers (C = 1): darker")]
    Paper,
}

/// Exit radiance of one medium for a radiosity of 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExitRadiance {
    eta: f64,
    /// `1 / (pi C)` in 1/sr.
    scale_per_sr: f64,
}

impl ExitRadiance {
    /// The exit from a medium with this index of refraction, inside over outside.
    pub fn new(eta_inside_over_outside: f64, normalisation: ExitFresnel) -> Self {
        let c = match normalisation {
            ExitFresnel::Normalised => diffuse_transmittance(eta_inside_over_outside),
            ExitFresnel::Paper => 1.0,
        };
        // No light leaves where none can, whatever a vanishing C would make of rounding errors.
        let scale_per_sr = if c > 0.0 { FRAC_1_PI / c } else { 0.0 };
        Self { eta: eta_inside_over_outside, scale_per_sr: if scale_per_sr.is_finite() { scale_per_sr } else { 0.0 } }
    }

    /// Radiance in 1/sr towards a direction at this cosine to the shading normal, outside.
    #[inline]
    pub fn per_radiosity(&self, cos_outside: f64) -> f64 {
        transmittance(self.eta, cos_outside) * self.scale_per_sr
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::quadrature::integrate;

    #[test]
    fn all_that_leaves_is_the_radiosity() {
        for eta in [1.0, 1.000_001, 1.1, 1.3, 1.5, 2.4, 0.75] {
            let flux = |exit: ExitRadiance| {
                let integrand = |mu: f64| std::f64::consts::TAU * exit.per_radiosity(mu) * mu;
                integrate(integrand, 0.0, 1.0, 1e-9)
            };
            let normalised = flux(ExitRadiance::new(eta, ExitFresnel::Normalised));
            assert!((normalised - 1.0).abs() < 1e-6, "eta {eta}: {normalised}");
            let paper = flux(ExitRadiance::new(eta, ExitFresnel::Paper));
            assert!((paper - diffuse_transmittance(eta)).abs() < 1e-6, "eta {eta}: {paper}");
        }
    }

    #[test]
    fn impossible_media_are_dark_and_finite() {
        for eta in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-300, 1e300] {
            for mu in [-1.0, 0.0, 0.5, 1.0, f64::NAN] {
                let value = ExitRadiance::new(eta, ExitFresnel::Normalised).per_radiosity(mu);
                assert!(value.is_finite() && value >= 0.0, "eta {eta}, mu {mu}: {value}");
            }
        }
    }
}
