//! Blinn-Phong highlights: a power of the cosine between the normal and the half vector.
//!
//! `f_r = F (n + 2) / (8 pi) cos_half^n` with the half vector of Blinn (1977, "Models of light reflection for computer
//! synthesized pictures") and the exponent n: a microfacet model `F D G / (4 cos_i cos_o)` with the power as the
//! distribution of facets, `D = (n + 2) / (2 pi) cos_half^n` (Walter et al. 2007, "Microfacet models for refraction
//! through rough surfaces", eq. 30), and `G = cos_i cos_o`, which cancels the denominator (Hoffman 2010, "Physics and
//! math of shading", a SIGGRAPH course). F is the exact unpolarised Fresnel reflectance of the medium at the half
//! vector. The model is reciprocal and never reflects more than comes in; a narrow highlight reflects `F cos_o^2`, so that
//! it is darker at a slant than that of [`super::specular::Ggx`].
//!
//! OpenGL's fixed pipeline has the power alone, `k_s I cos_half^n`, without normalisation, Fresnel's factor and cos_i,
//! so that a highlight gains energy with its width.
//!
//! Cosines are with the normal of the surface, including those named `cos_half`; `cos_difference` is between the half
//! vector and either direction.

use std::f64::consts::{FRAC_1_PI, TAU};

use glam::{DVec2, DVec3};

use super::specular::{Reflected, fresnel_reflectance};
use crate::error::{Error, Result};

/// Least and largest exponent: a highlight as wide as the hemisphere, and one of a degree.
pub const EXPONENTS: std::ops::RangeInclusive<f64> = 1.0..=10_000.0;
/// The exponent that a window starts with: a highlight about as wide as the default of GGX.
pub const DEFAULT_EXPONENT: f64 = 200.0;

/// Exponent of the power, in [`EXPONENTS`].
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub struct Exponent(f64);

impl Exponent {
    /// An exponent.
    ///
    /// # Errors
    /// A value outside [`EXPONENTS`] (exit 1).
    pub fn new(exponent: f64) -> Result<Self> {
        // Written so that NaN fails as well.
        if EXPONENTS.contains(&exponent) {
            return Ok(Self(exponent));
        }
        Err(Error::command_line(format!(
            "Blinn-Phong exponent {exponent}: a number from {} (matt) to {} (polished) is needed, for example {DEFAULT_EXPONENT}",
            EXPONENTS.start(),
            EXPONENTS.end()
        )))
    }

    /// The exponent as a number.
    pub fn value(self) -> f64 {
        self.0
    }
}

impl Default for Exponent {
    fn default() -> Self {
        Self(DEFAULT_EXPONENT)
    }
}

impl std::str::FromStr for Exponent {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        match text.trim().parse() {
            Ok(exponent) => Self::new(exponent),
            Err(_) => Err(Error::command_line(format!(
                "Blinn-Phong exponent `{text}` is no number; type one from {} (matt) to {} (polished), for example \
                 {DEFAULT_EXPONENT}",
                EXPONENTS.start(),
                EXPONENTS.end()
            ))),
        }
    }
}

impl std::fmt::Display for Exponent {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", self.0)
    }
}

/// The distribution D of facet normals in 1/sr; `Int D cos_half dw = 1`.
#[inline]
pub fn distribution(exponent: f64, cos_half: f64) -> f64 {
    if cos_half <= 0.0 {
        return 0.0;
    }
    0.5 * FRAC_1_PI * (exponent + 2.0) * cos_half.min(1.0).powf(exponent)
}

/// Cosine of a half vector whose density is `D cos_half`, for a number in [0, 1).
#[inline]
pub fn sampled_cosine(exponent: f64, u: f64) -> f64 {
    (1.0 - u).powf(1.0 / (exponent + 2.0))
}

/// A boundary with a Blinn-Phong highlight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlinnPhong {
    /// Exponent of the power.
    pub exponent: f64,
    /// Index of refraction, inside over outside.
    pub eta_inside_over_outside: f64,
}

impl BlinnPhong {
    /// The boundary of a medium.
    pub fn new(exponent: Exponent, eta_inside_over_outside: f64) -> Self {
        Self { exponent: exponent.value(), eta_inside_over_outside }
    }

    /// Reflected radiance over irradiance, in 1/sr; 0 where either unit direction is not above the surface.
    #[inline]
    pub fn brdf(&self, normal: DVec3, to_light: DVec3, to_eye: DVec3) -> f64 {
        if normal.dot(to_light) <= 0.0 || normal.dot(to_eye) <= 0.0 {
            return 0.0;
        }
        let half = (to_light + to_eye).normalize_or_zero();
        let fresnel = fresnel_reflectance(self.eta_inside_over_outside, half.dot(to_eye));
        0.25 * fresnel * distribution(self.exponent, normal.dot(half))
    }

    /// Density, per steradian of reflected direction, of [`BlinnPhong::sample`].
    #[inline]
    pub fn density_per_sr(&self, cos_half: f64, cos_difference: f64) -> f64 {
        if cos_difference <= 0.0 {
            return 0.0;
        }
        distribution(self.exponent, cos_half) * cos_half / (4.0 * cos_difference)
    }

    /// A direction reflected towards the eye by a facet, for two numbers in [0, 1); none where the facet faces away or
    /// sends it below the surface.
    ///
    /// `to_eye` is above the surface with this unit normal.
    #[inline]
    pub fn sample(&self, normal: DVec3, to_eye: DVec3, u: DVec2) -> Option<Reflected> {
        let ((x, y), z) = (normal.any_orthonormal_pair(), normal);
        let eye = DVec3::new(to_eye.dot(x), to_eye.dot(y), to_eye.dot(z));
        let cos_half = sampled_cosine(self.exponent, u.x);
        let sin_half = (1.0 - cos_half * cos_half).max(0.0).sqrt();
        let (sin, cos) = (TAU * u.y).sin_cos();
        let facet = DVec3::new(sin_half * cos, sin_half * sin, cos_half);
        let cos_difference = facet.dot(eye);
        let light = facet * (2.0 * cos_difference) - eye;
        if light.z <= 0.0 || cos_difference <= 0.0 {
            return None;
        }
        let fresnel = fresnel_reflectance(self.eta_inside_over_outside, cos_difference);
        // The power and its factor cancel; at most 2, as the light's cosine is below 2 cos_difference cos_half.
        let weight = fresnel * light.z * cos_difference / cos_half;
        let density_per_sr = self.density_per_sr(cos_half, cos_difference);
        Some(Reflected { to_light: x * light.x + y * light.y + z * light.z, weight, density_per_sr })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::math::quadrature::{gauss_legendre, integrate_with};
    use crate::math::random::uniform;
    use crate::medium::fresnel::diffuse_transmittance;

    const TESTED: [f64; 6] = [1.0, 2.5, 20.0, 200.0, 3000.0, 1e4];

    fn of(exponent: f64, eta: f64) -> BlinnPhong {
        BlinnPhong::new(Exponent::new(exponent).unwrap(), eta)
    }

    fn at(cos: f64, turn: f64) -> DVec3 {
        let sin = (1.0 - cos * cos).max(0.0).sqrt();
        DVec3::new(sin * (TAU * turn).cos(), sin * (TAU * turn).sin(), cos)
    }

    /// `Int f_r cos_i dw_i` over half vectors in polar coordinates about the normal; `s` is `cos_half^(n + 2)`, which
    /// resolves every width. F by `fresnel`.
    fn albedo(lobe: &BlinnPhong, cos_o: f64, fresnel: impl Fn(f64) -> f64) -> f64 {
        let rule = gauss_legendre(96);
        let eye = at(cos_o, 0.0);
        integrate_with(&rule, 0.0, 1.0, |s| {
            let cos_half = s.powf(1.0 / (lobe.exponent + 2.0));
            integrate_with(&rule, 0.0, 0.5, |turn| {
                let half = at(cos_half, turn);
                let d = half.dot(eye);
                let light = half * (2.0 * d) - eye;
                if d <= 0.0 || light.z <= 0.0 {
                    return 0.0;
                }
                // D cos_half dw_half = ds dphi / (2 pi), dw_i = 4 d dw_half, f_r = F D / 4.
                2.0 * fresnel(d) * light.z * d / cos_half
            })
        })
    }

    #[test]
    fn facets_project_to_the_surface() {
        let rule = gauss_legendre(64);
        for n in TESTED {
            // In the variable s = 1 - cos: the power falls over 1 / n.
            let most = (60.0 / n).min(1.0);
            let total = integrate_with(&rule, 0.0, most, |s| TAU * distribution(n, 1.0 - s) * (1.0 - s));
            assert!((total - 1.0).abs() < 1e-9, "{n}: {total}");
        }
    }

    /// Without Fresnel's factor and seen from above, in closed form (after Giesen 2009, "Phong and Blinn-Phong
    /// normalization factors").
    #[test]
    fn the_share_reflected_from_above_is_that_of_the_closed_form() {
        for n in TESTED {
            let expected = (n + 0.5f64.powf(0.5 * n)) / (n + 4.0);
            let found = albedo(&of(n, 1.5), 1.0, |_| 1.0);
            assert!((found / expected - 1.0).abs() < 1e-3, "{n}: {found} instead of {expected}");
        }
    }

    #[test]
    fn samples_have_the_density_and_the_weight_of_the_model() {
        for (n, eta) in [(1.0, 1.3), (20.0, 1.5), (200.0, 1.5), (1e4, 0.8)] {
            let lobe = of(n, eta);
            for cos_o in [0.08, 0.4, 0.9, 1.0] {
                let eye = at(cos_o, 0.3);
                let count = 60_000;
                let (mut sum, mut kept, mut inverse) = (0.0, 0.0, 0.0);
                for i in 0..count {
                    let u = DVec2::new(uniform(7, i, 0), uniform(7, i, 1));
                    let Some(sample) = lobe.sample(DVec3::Z, eye, u) else { continue };
                    let exact = lobe.brdf(DVec3::Z, sample.to_light, eye) * sample.to_light.z / sample.density_per_sr;
                    assert!((sample.weight - exact).abs() < 1e-6 * exact, "{n} {cos_o}: {sample:?} {exact}");
                    // What the density says of the direction alone.
                    let half = (sample.to_light + eye).normalize();
                    let density = lobe.density_per_sr(half.z, half.dot(eye));
                    assert!((density / sample.density_per_sr - 1.0).abs() < 1e-6, "{n} {cos_o}: {sample:?} {density}");
                    (sum, kept) = (sum + sample.weight, kept + 1.0);
                    inverse += sample.to_light.z / density;
                }
                let count = count as f64;
                let expected = albedo(&lobe, cos_o, |d| fresnel_reflectance(eta, d));
                assert!((sum / count / expected - 1.0).abs() < 0.02, "{n} {eta} {cos_o}: {} {expected}", sum / count);
                // Samples of a wide lobe measure the hemisphere: Int cos_i dw_i = pi.
                if n == 1.0 && cos_o == 1.0 {
                    assert!((inverse / count / std::f64::consts::PI - 1.0).abs() < 0.03, "{}", inverse / count);
                }
                assert!(kept > 0.3 * count, "{n} {cos_o}: {kept}");
            }
        }
    }

    #[test]
    fn brdf_is_reciprocal() {
        for i in 0..500 {
            let u = |d| uniform(3, i, d);
            let lobe = of(10f64.powf(4.0 * u(0)), 1.0 + u(1));
            let (a, b) = (at(u(2), u(3)), at(u(4), u(5)));
            let (there, back) = (lobe.brdf(DVec3::Z, a, b), lobe.brdf(DVec3::Z, b, a));
            assert!((there - back).abs() <= 1e-9 * there.max(1e-12), "{there} {back}");
        }
    }

    /// Under constant light of radiance 1 at most `pi C` enters; the test adds it, as diffuse exitance, to the reflected
    /// light. No direction reflects more than F of the half vector, either.
    #[test]
    fn reflected_and_transmitted_light_never_exceed_what_comes_in() {
        let rule = gauss_legendre(24);
        for n in TESTED {
            for eta in [1.0, 1.1, 1.3, 1.5, 2.0] {
                let lobe = of(n, eta);
                let reflected =
                    integrate_with(&rule, 0.0, 1.0, |mu| 2.0 * mu * albedo(&lobe, mu, |d| fresnel_reflectance(eta, d)));
                let total = reflected + diffuse_transmittance(eta);
                assert!(total <= 1.0 + 1e-4 && total > 0.8, "{n} {eta}: {total}");
            }
            for mu in [0.02, 0.3, 0.7, 1.0] {
                assert!(albedo(&of(n, 1.5), mu, |_| 1.0) <= 1.0, "{n} {mu}");
            }
        }
    }

    #[test]
    fn odd_directions_are_dark_and_finite() {
        for n in TESTED {
            for eta in [0.4, 1.0, 1.5, 3.0] {
                let lobe = of(n, eta);
                for (a, b) in [(1e-12, 1e-12), (1.0, 1e-300), (1.0, 1.0), (-0.5, 1.0), (0.5, -0.1), (0.0, 0.0)] {
                    let value = lobe.brdf(DVec3::Z, at(a, 0.1), at(b, 0.6));
                    assert!(value.is_finite() && value >= 0.0, "{n} {eta} {a} {b}: {value}");
                    assert!((a > 0.0 && b > 0.0) || value == 0.0);
                    let half = (at(a, 0.1) + at(b, 0.6)).normalize_or_zero();
                    assert!(lobe.density_per_sr(half.z, half.dot(at(b, 0.6))).is_finite());
                }
                for cos_o in [1e-9, 0.5, 1.0] {
                    for u in [DVec2::ZERO, DVec2::splat(1.0 - 1e-16), DVec2::new(0.999, 0.25), DVec2::new(0.5, 0.75)] {
                        if let Some(r) = lobe.sample(DVec3::Z, at(cos_o, 0.7), u) {
                            assert!(r.weight.is_finite() && r.density_per_sr.is_finite() && r.to_light.is_finite());
                            assert!((-1e-12..=2.0).contains(&r.weight) && r.density_per_sr > 0.0, "{r:?}");
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn exponents_are_read_and_refused() {
        assert_eq!("20".parse::<Exponent>().unwrap().value(), 20.0);
        for good in ["1", "1e4", " 33.5 "] {
            assert!(good.parse::<Exponent>().is_ok(), "{good}");
        }
        for bad in ["", "shiny", "0", "-0", "-20", "0.99", "10001", "nan", "inf", "-inf"] {
            let error = bad.parse::<Exponent>().unwrap_err();
            assert!(error.message().contains("for example 200"), "{bad}: {error}");
        }
    }
}
