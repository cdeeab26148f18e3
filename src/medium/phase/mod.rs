//! The phase function of Henyey and Greenstein (1941), its density and sampling, and forms that separate the direction
//! of the light from that of the eye.
//!
//! Directions are outward on both sides: `w_i'` from a point inside towards the light, `w_o'` towards the eye. The
//! cosine of the scattering angle is `-w_i'.w_o'`, so that g > 0 is forward.

mod legendre;
mod maps;

use std::f64::consts::{FRAC_1_PI, PI};

use glam::DVec3;

pub use self::legendre::{LegendrePhase, MOST_TERMS};
pub use self::maps::{DirectionMaps, SIDE};

/// The phase function with mean cosine `g`; `g > 0` is forward.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HenyeyGreenstein {
    g: f64,
}

impl HenyeyGreenstein {
    /// The function for a mean cosine in (-1, 1); values outside are clamped, NaN counts as 0.
    pub fn new(g: f64) -> Self {
        let limit = 1.0 - 1e-9;
        Self { g: if g.is_nan() { 0.0 } else { g.clamp(-limit, limit) } }
    }

    /// The mean cosine.
    pub fn g(self) -> f64 {
        self.g
    }

    /// Density over solid angle, 1/sr, at the cosine between the directions before and after.
    pub fn density(self, cosine: f64) -> f64 {
        let g = self.g;
        let square = 1.0 + g * g - 2.0 * g * cosine.clamp(-1.0, 1.0);
        (1.0 - g) * (1.0 + g) / (4.0 * PI * square * square.sqrt())
    }

    /// The cosine below which the fraction `xi` of the distribution lies.
    ///
    /// The usual form divides a difference by g; here g is divided out, so that every g is exact, 0 included.
    #[inline(always)]
    pub fn sample_cosine(self, xi: f64) -> f64 {
        let (g, t) = (self.g, 2.0 * xi - 1.0);
        let root = 1.0 + g * t;
        let numerator = t + g * (0.5 * (t * t + 3.0) + g * (t + 0.5 * g * (t * t - 1.0)));
        (numerator / (root * root)).clamp(-1.0, 1.0)
    }
}

/// The light side of a phase function of few terms: `p(w_i', w_o') ~ Sum_k g_k(w_i') h_k(w_o')` (Wang, Tran and Luebke
/// 2005, equation 9). An asset holds one vector for each `g_k`.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum LightTerms {
    /// One term, `g = 1 / (4 pi)`, `h = 1`.
    #[default]
    Isotropic,
    /// The first real spherical harmonics, this many, whatever the g of the medium (see [`LegendrePhase`]).
    Harmonics(usize),
    /// Any functions, such as those of a singular value decomposition.
    Maps(DirectionMaps),
}

impl LightTerms {
    /// Number of terms, at least one.
    pub fn count(&self) -> usize {
        match self {
            Self::Isotropic => 1,
            Self::Harmonics(terms) => (*terms).clamp(1, MOST_TERMS),
            Self::Maps(maps) => maps.terms(),
        }
    }

    /// `g_k` of a unit vector towards the light; fills as much of `out` as there are terms.
    pub fn evaluate(&self, towards_light: DVec3, out: &mut [f64]) {
        match self {
            Self::Isotropic => out.iter_mut().take(1).for_each(|g| *g = 0.25 * FRAC_1_PI),
            Self::Harmonics(_) => LegendrePhase::light(self.count(), towards_light, out),
            Self::Maps(maps) => maps.evaluate(towards_light, out),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::quadrature::integrate;

    const MEAN_COSINES: [f64; 9] = [-0.95, -0.5, -1e-3, 0.0, 1e-9, 1e-3, 0.3, 0.8, 0.95];

    #[test]
    fn the_density_integrates_to_one_and_its_mean_cosine_is_g() {
        for g in MEAN_COSINES {
            let phase = HenyeyGreenstein::new(g);
            let total = integrate(|c| 2.0 * PI * phase.density(c), -1.0, 1.0, 1e-13);
            let mean = integrate(|c| 2.0 * PI * c * phase.density(c), -1.0, 1.0, 1e-13);
            assert!((total - 1.0).abs() < 1e-10 && (mean - g).abs() < 1e-10, "{g}: {total} {mean}");
        }
    }

    #[test]
    fn sampled_cosines_invert_the_distribution() {
        for g in MEAN_COSINES {
            let phase = HenyeyGreenstein::new(g);
            for i in 0..=40 {
                let xi = f64::from(i) / 40.0;
                let cosine = phase.sample_cosine(xi);
                let below = integrate(|c| 2.0 * PI * phase.density(c), -1.0, cosine, 1e-13);
                assert!((below - xi).abs() < 1e-9, "{g} {xi}: {cosine} {below}");
            }
        }
    }

    #[test]
    fn every_number_gives_a_cosine() {
        for g in [-2.0, -1.0, 1.0, f64::NAN, f64::INFINITY] {
            for xi in [0.0, 0.5, 1.0] {
                assert!((-1.0..=1.0).contains(&HenyeyGreenstein::new(g).sample_cosine(xi)));
            }
        }
    }
}
