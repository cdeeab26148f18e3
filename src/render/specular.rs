//! Specular reflection at a rough dielectric boundary: the factors of the GGX microfacet model.
//!
//! `f_r = F D G2 / (4 cos_i cos_o)` (Walter et al. 2007, "Microfacet models for refraction through rough surfaces",
//! eq. 20) with their distribution D (eq. 33), the exact unpolarised Fresnel reflectance of the medium, and Smith's
//! masking and shadowing correlated by height (Heitz 2014, "Understanding the masking-shadowing function", eq. 99).
//! Only single reflections are counted: light that bounces between facets is missing, so a rough surface loses some.
//!
//! Cosines are with the normal of the surface, including those named `cos_half`; `cos_difference` is between the half
//! vector and either direction. All should be in (0, 1]; elsewhere the functions are 0 or finite.

use std::f64::consts::{FRAC_1_PI, TAU};

use glam::{DVec2, DVec3};

use crate::error::{Error, Result};
use crate::medium::fresnel::transmittance;

/// Default perceptual roughness: skin, wax and polished stone.
pub const DEFAULT_ROUGHNESS: f64 = 0.3;
/// Least width of the lobe: a mirror would show directional and point lights as points that no eye ray meets.
pub const MIN_ALPHA: f64 = 1e-3;

/// Perceptual roughness in [0, 1], the square root of the width `alpha` of the lobe.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd, serde::Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(transparent)]
pub struct Roughness(f64);

impl Roughness {
    /// A perceptual roughness.
    ///
    /// # Errors
    /// A value outside [0, 1] (exit 1).
    pub fn new(roughness: f64) -> Result<Self> {
        // Written so that NaN fails as well; adding zero turns -0 into 0.
        if (0.0..=1.0).contains(&roughness) {
            return Ok(Self(roughness + 0.0));
        }
        Err(Error::command_line(format!(
            "roughness {roughness}: a number from 0 (polished) to 1 (matt) is needed, for example {DEFAULT_ROUGHNESS}"
        )))
    }

    /// The perceptual roughness as a number.
    pub fn value(self) -> f64 {
        self.0
    }

    /// Width of the lobe: the square, at least [`MIN_ALPHA`].
    pub fn alpha(self) -> f64 {
        (self.0 * self.0).max(MIN_ALPHA)
    }
}

impl Default for Roughness {
    fn default() -> Self {
        Self(DEFAULT_ROUGHNESS)
    }
}

impl std::str::FromStr for Roughness {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        match text.trim().parse() {
            Ok(roughness) => Self::new(roughness),
            Err(_) => Err(Error::command_line(format!(
                "roughness `{text}` is no number; type one from 0 (polished) to 1 (matt), for example {DEFAULT_ROUGHNESS}"
            ))),
        }
    }
}

impl std::fmt::Display for Roughness {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", self.0)
    }
}

/// Fraction of unpolarised light that a smooth facet reflects at this cosine outside.
#[inline]
pub fn fresnel_reflectance(eta_inside_over_outside: f64, cos_difference: f64) -> f64 {
    1.0 - transmittance(eta_inside_over_outside, cos_difference)
}

/// The distribution D of facet normals in 1/sr (Walter et al. 2007, eq. 33); `Int D cos_half dw = 1`.
#[inline]
pub fn distribution(alpha: f64, cos_half: f64) -> f64 {
    if cos_half <= 0.0 {
        return 0.0;
    }
    let (a2, c2) = (alpha * alpha, cos_half * cos_half);
    let t = (1.0 - c2).max(0.0) + a2 * c2;
    FRAC_1_PI * a2 / (t * t)
}

/// `G2 / (4 cos_i cos_o)`, height-correlated, in a form without a division by small cosines.
#[inline]
pub fn visibility(alpha: f64, cos_i: f64, cos_o: f64) -> f64 {
    0.5 / (cos_o * slope_root(alpha, cos_i) + cos_i * slope_root(alpha, cos_o)).max(f64::MIN_POSITIVE)
}

#[inline]
fn slope_root(alpha: f64, cos: f64) -> f64 {
    let a2 = alpha * alpha;
    (a2 + (1.0 - a2) * cos * cos).sqrt()
}

/// A rough dielectric boundary.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ggx {
    /// Width of the lobe.
    pub alpha: f64,
    /// Index of refraction, inside over outside.
    pub eta_inside_over_outside: f64,
}

impl Ggx {
    /// The boundary of a medium.
    pub fn new(roughness: Roughness, eta_inside_over_outside: f64) -> Self {
        Self { alpha: roughness.alpha(), eta_inside_over_outside }
    }

    /// Reflected radiance over irradiance, in 1/sr; 0 where either unit direction is not above the surface.
    #[inline]
    pub fn brdf(&self, normal: DVec3, to_light: DVec3, to_eye: DVec3) -> f64 {
        let (cos_i, cos_o) = (normal.dot(to_light), normal.dot(to_eye));
        if cos_i <= 0.0 || cos_o <= 0.0 {
            return 0.0;
        }
        let half = (to_light + to_eye).normalize_or_zero();
        let fresnel = fresnel_reflectance(self.eta_inside_over_outside, half.dot(to_eye));
        fresnel * distribution(self.alpha, normal.dot(half)) * visibility(self.alpha, cos_i, cos_o)
    }

    /// Density, per steradian of reflected direction, of [`Ggx::sample`].
    #[inline]
    pub fn density_per_sr(&self, cos_half: f64, cos_o: f64) -> f64 {
        // G1 D / (4 cos_o), with G1's own cosine cancelled.
        let cos_o = cos_o.max(0.0);
        distribution(self.alpha, cos_half) / (2.0 * (cos_o + slope_root(self.alpha, cos_o)))
    }

    /// A direction reflected towards the eye by a visible facet (Heitz 2018, "Sampling the GGX distribution of visible
    /// normals"), for two numbers in [0, 1); none where the facet sends it below the surface.
    ///
    /// `to_eye` is above the surface with this unit normal.
    #[inline]
    pub fn sample(&self, normal: DVec3, to_eye: DVec3, u: DVec2) -> Option<Reflected> {
        let ((x, y), z) = (normal.any_orthonormal_pair(), normal);
        let eye = DVec3::new(to_eye.dot(x), to_eye.dot(y), to_eye.dot(z));
        let facet = self.visible_normal(eye, u);
        let cos_difference = facet.dot(eye);
        let light = facet * (2.0 * cos_difference) - eye;
        if light.z <= 0.0 || cos_difference <= 0.0 {
            return None;
        }
        let fresnel = fresnel_reflectance(self.eta_inside_over_outside, cos_difference);
        // F G2 / G1.
        let (root_i, root_o) = (slope_root(self.alpha, light.z), slope_root(self.alpha, eye.z));
        let weight = fresnel * light.z * (eye.z + root_o) / (eye.z * root_i + light.z * root_o);
        let density_per_sr = self.density_per_sr(facet.z, eye.z);
        Some(Reflected { to_light: x * light.x + y * light.y + z * light.z, weight, density_per_sr })
    }

    /// A facet normal in the frame of the surface, distributed as the eye sees them.
    #[inline]
    fn visible_normal(&self, eye: DVec3, u: DVec2) -> DVec3 {
        let stretched = DVec3::new(self.alpha * eye.x, self.alpha * eye.y, eye.z).normalize();
        let across = stretched.x * stretched.x + stretched.y * stretched.y;
        let t1 = if across > 0.0 { DVec3::new(-stretched.y, stretched.x, 0.0) / across.sqrt() } else { DVec3::X };
        let t2 = stretched.cross(t1);
        let radius = u.x.sqrt();
        let (sin, cos) = (TAU * u.y).sin_cos();
        let p1 = radius * cos;
        let s = 0.5 * (1.0 + stretched.z);
        let p2 = (1.0 - s) * (1.0 - p1 * p1).max(0.0).sqrt() + s * radius * sin;
        let p3 = (1.0 - p1 * p1 - p2 * p2).max(0.0).sqrt();
        let n = t1 * p1 + t2 * p2 + stretched * p3;
        DVec3::new(self.alpha * n.x, self.alpha * n.y, n.z.max(0.0)).normalize_or(DVec3::Z)
    }
}

/// A sampled reflection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reflected {
    /// Unit direction towards the light.
    pub to_light: DVec3,
    /// `f_r cos_i` over the density, the factor on radiance from there.
    pub weight: f64,
    /// Density of this direction.
    pub density_per_sr: f64,
}

/// Factor that takes reflected light smoothly to 0 where a light sinks below the triangle, 1 as soon as it stands
/// higher above it than above the smooth surface (Chiang, Li and Burley 2019, "Taming the shadow terminator").
#[inline]
pub fn terminator(cos_geometric: f64, cos_shading: f64, cos_between_normals: f64) -> f64 {
    if cos_geometric <= 0.0 || cos_shading <= 0.0 {
        return 0.0;
    }
    let between = cos_between_normals.max(0.0) * cos_shading;
    let x = if cos_geometric < between { cos_geometric / between } else { 1.0 };
    x * (1.0 + x * (1.0 - x))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::math::quadrature::{gauss_legendre, integrate_with};
    use crate::math::random::uniform;
    use crate::medium::fresnel::diffuse_transmittance;

    const ROUGHNESSES: [f64; 5] = [0.1, 0.3, 0.5, 0.8, 1.0];

    fn at(cos: f64, turn: f64) -> DVec3 {
        let sin = (1.0 - cos * cos).max(0.0).sqrt();
        DVec3::new(sin * (TAU * turn).cos(), sin * (TAU * turn).sin(), cos)
    }

    /// `Int f_r cos_i dw_i` over facets: half vectors in polar coordinates about the normal, with the tangent of the
    /// polar angle mapped so that every lobe width is resolved.
    fn albedo(ggx: &Ggx, cos_o: f64) -> f64 {
        let rule = gauss_legendre(96);
        let eye = at(cos_o, 0.0);
        let ring = |s: f64| {
            // tan^2 = alpha^2 s / (1 - s) makes D cos_half dw_half = ds dphi / (2 pi).
            let tan2 = ggx.alpha * ggx.alpha * s / (1.0 - s);
            let cos_half = (1.0 / (1.0 + tan2)).sqrt();
            integrate_with(&rule, 0.0, 0.5, |turn| {
                let half = at(cos_half, turn);
                let d = half.dot(eye);
                let light = half * (2.0 * d) - eye;
                if d <= 0.0 || light.z <= 0.0 {
                    return 0.0;
                }
                // dw_i = 4 d dw_half.
                let f = fresnel_reflectance(ggx.eta_inside_over_outside, d);
                2.0 * f * visibility(ggx.alpha, light.z, cos_o) * light.z * 4.0 * d / cos_half
            })
        };
        integrate_with(&rule, 0.0, 1.0, ring)
    }

    #[test]
    fn facets_project_to_the_surface() {
        let rule = gauss_legendre(64);
        for roughness in ROUGHNESSES {
            let alpha = Roughness::new(roughness).unwrap().alpha();
            // With c = cos_half, in the variable that makes the integrand of D itself smooth.
            let total = integrate_with(&rule, 0.0, 1.0, |s| {
                let tan2 = alpha * alpha * s / (1.0 - s);
                let c = (1.0 / (1.0 + tan2)).sqrt();
                let dtan2 = alpha * alpha / (1.0 - s).powi(2);
                // dw = TAU sin dtheta = PI c^4 dtan2 / c.
                distribution(alpha, c) * c * std::f64::consts::PI * c.powi(3) * dtan2
            });
            assert!((total - 1.0).abs() < 1e-9, "{roughness}: {total}");
        }
    }

    #[test]
    fn samples_have_the_density_and_the_weight_of_the_model() {
        for (roughness, eta) in [(0.3, 1.3), (0.6, 1.5), (1.0, 1.5), (0.5, 0.8)] {
            let ggx = Ggx::new(Roughness::new(roughness).unwrap(), eta);
            for cos_o in [0.08, 0.4, 0.9, 1.0] {
                let eye = at(cos_o, 0.3);
                let count = 60_000;
                let mut sum = 0.0;
                for i in 0..count {
                    let u = DVec2::new(uniform(7, i, 0), uniform(7, i, 1));
                    let Some(sample) = ggx.sample(DVec3::Z, eye, u) else { continue };
                    let exact = ggx.brdf(DVec3::Z, sample.to_light, eye) * sample.to_light.z / sample.density_per_sr;
                    assert!((sample.weight / exact - 1.0).abs() < 1e-6, "{roughness} {cos_o}: {sample:?} {exact}");
                    sum += sample.weight;
                }
                let (found, expected) = (sum / count as f64, albedo(&ggx, cos_o));
                assert!((found / expected - 1.0).abs() < 0.02, "{roughness} {eta} {cos_o}: {found} {expected}");
            }
        }
    }

    #[test]
    fn polished_surfaces_reflect_as_fresnel_says() {
        let ggx = Ggx::new(Roughness::new(0.05).unwrap(), 1.5);
        for cos_o in [0.3, 0.6, 1.0] {
            let (found, expected) = (albedo(&ggx, cos_o), fresnel_reflectance(1.5, cos_o));
            assert!((found / expected - 1.0).abs() < 2e-3, "{cos_o}: {found} {expected}");
        }
    }

    #[test]
    fn brdf_is_reciprocal() {
        for i in 0..500 {
            let u = |d| uniform(3, i, d);
            let ggx = Ggx::new(Roughness::new(u(0)).unwrap(), 1.0 + u(1));
            let (a, b) = (at(u(2), u(3)), at(u(4), u(5)));
            let (there, back) = (ggx.brdf(DVec3::Z, a, b), ggx.brdf(DVec3::Z, b, a));
            assert!((there - back).abs() <= 1e-9 * there.max(1e-12), "{there} {back}");
        }
    }

    /// Under constant light of radiance 1 at most `pi C` enters; the test adds it, as diffuse exitance, to the
    /// reflected light.
    #[test]
    fn reflected_and_transmitted_light_never_exceed_what_comes_in() {
        let rule = gauss_legendre(32);
        for roughness in ROUGHNESSES {
            for eta in [1.0, 1.1, 1.3, 1.5, 2.0] {
                let ggx = Ggx::new(Roughness::new(roughness).unwrap(), eta);
                let reflected = integrate_with(&rule, 0.0, 1.0, |mu| 2.0 * mu * albedo(&ggx, mu));
                let total = reflected + diffuse_transmittance(eta);
                assert!(total <= 1.0 + 1e-4 && total > 0.85, "{roughness} {eta}: {total}");
            }
        }
    }

    #[test]
    fn odd_directions_are_dark_and_finite() {
        for roughness in [0.0, 0.3, 1.0] {
            for eta in [0.4, 1.0, 1.5, 3.0] {
                let ggx = Ggx::new(Roughness::new(roughness).unwrap(), eta);
                for (a, b) in [(1e-12, 1e-12), (1.0, 1e-300), (1.0, 1.0), (-0.5, 1.0), (0.5, -0.1), (0.0, 0.0)] {
                    let value = ggx.brdf(DVec3::Z, at(a, 0.1), at(b, 0.6));
                    assert!(value.is_finite() && value >= 0.0, "{roughness} {eta} {a} {b}: {value}");
                    assert!((a > 0.0 && b > 0.0) || value == 0.0);
                }
                for cos_o in [1e-9, 0.5, 1.0] {
                    for u in [DVec2::ZERO, DVec2::splat(1.0 - 1e-16), DVec2::new(0.999, 0.25), DVec2::new(0.5, 0.75)] {
                        if let Some(r) = ggx.sample(DVec3::Z, at(cos_o, 0.7), u) {
                            assert!(r.weight.is_finite() && r.density_per_sr.is_finite() && r.to_light.is_finite());
                            assert!((-1e-12..1.0 + 1e-9).contains(&r.weight), "{r:?}");
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn the_terminator_is_smooth_and_leaves_lit_sides_alone() {
        assert_eq!(terminator(0.6, 0.5, 1.0), 1.0);
        assert_eq!((terminator(0.0, 0.5, 0.9), terminator(-0.1, 0.5, 0.9), terminator(0.5, 0.0, 0.9)), (0.0, 0.0, 0.0));
        assert!((terminator(0.44999999, 0.5, 0.9) - 1.0).abs() < 1e-6 && terminator(1e-9, 0.5, 0.9) < 1e-8);
    }

    #[test]
    fn roughness_is_read_and_refused() {
        assert_eq!("0.3".parse::<Roughness>().unwrap(), Roughness::default());
        assert_eq!("0".parse::<Roughness>().unwrap().alpha(), MIN_ALPHA);
        for bad in ["", "rough", "-0.1", "1.01", "nan", "inf"] {
            let error = bad.parse::<Roughness>().unwrap_err();
            assert!(error.message().contains("for example 0.3"), "{bad}: {error}");
        }
    }
}
