//! Any profile without its peak: a polynomial in the squared distance inside a radius a, the profile itself beyond.
//!
//! With `s = r^2` the polynomial is the Taylor polynomial of degree 2 around `s = a^2`, as multilevel summation softens
//! 1/r (Hardy, Stone and Schulten 2009, equation 8): the softened profile varies on the scale of a, and the difference
//! is compact. For a dipole the derivatives are exact ([`Profile::expansion`]), and [`super::far_profile::FarProfile`]
//! knows its totals.

use super::profile::Profile;

/// The polynomial that replaces a profile inside a radius.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Softened {
    radius2_mm2: f64,
    /// Coefficients of the polynomial in `u = r^2 - a^2`.
    polynomial: [f64; 3],
}

impl Softened {
    /// Softens a profile inside `radius_mm`, which is finite; a radius that is not positive leaves the whole profile.
    pub fn new(profile: &dyn Profile, radius_mm: f64) -> Self {
        let radius2_mm2 = radius_mm.max(0.0).powi(2);
        Self { radius2_mm2, polynomial: profile.expansion(radius2_mm2) }
    }

    /// c of the polynomial `c[0] + c[1] u + c[2] u^2`, `u = r^2 - a^2` in mm^2; 1/mm^2, 1/mm^4, 1/mm^6.
    pub fn polynomial(&self) -> [f64; 3] {
        self.polynomial
    }

    /// The polynomial at a squared distance in mm^2, in 1/mm^2; `None` beyond the radius.
    pub fn inside(&self, r2_mm2: f64) -> Option<f64> {
        let u = r2_mm2 - self.radius2_mm2;
        let [value, first, second] = self.polynomial;
        (u < 0.0).then_some(value + u * (first + u * second))
    }

    /// The profile minus its softened form at a squared distance in mm^2, in 1/mm^2: 0 beyond the radius.
    pub fn less(&self, profile: &dyn Profile, r2_mm2: f64) -> f64 {
        self.inside(r2_mm2).map_or(0.0, |softened| profile.reflectance(r2_mm2.sqrt()) - softened)
    }

    /// The softened profile at a squared distance in mm^2, in 1/mm^2.
    pub fn reflectance_at_square(&self, profile: &dyn Profile, r2_mm2: f64) -> f64 {
        self.inside(r2_mm2).unwrap_or_else(|| profile.reflectance(r2_mm2.sqrt()))
    }

    /// `Int_r^a f(s) s ds` of the polynomial f from a squared distance in mm^2 to the radius, without unit.
    pub fn tail_inside(&self, r2_mm2: f64) -> f64 {
        let u = (r2_mm2 - self.radius2_mm2).min(0.0);
        let [value, first, second] = self.polynomial;
        -0.5 * u * (value + u * (first / 2.0 + u * (second / 3.0)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::quadrature::integrate;
    use crate::medium::dipole::Dipole;
    use crate::medium::far_profile::FarProfile;
    use crate::medium::fresnel::BoundaryFit;
    use crate::medium::material::PRESETS;

    /// A dipole with derivatives from finite differences.
    struct Any(Dipole);

    impl Profile for Any {
        fn reflectance(&self, r_mm: f64) -> f64 {
            self.0.reflectance(r_mm)
        }
        fn tail(&self, r_mm: f64) -> f64 {
            self.0.tail(r_mm)
        }
    }

    #[test]
    fn finite_differences_soften_as_the_closed_form() {
        for preset in &PRESETS {
            for dipole in preset.properties().dipoles(BoundaryFit::Published) {
                for radius in [0.1, 1.0, 10.0] {
                    let (soft, exact) = (Softened::new(&Any(dipole), radius), FarProfile::new(&dipole, radius));
                    for share in [0.0, 0.3, 0.7, 0.99, 1.0, 1.5, 4.0] {
                        let r2 = share * radius * radius;
                        let (found, expected) =
                            (soft.reflectance_at_square(&dipole, r2), exact.reflectance_at_square(r2));
                        let whole = dipole.reflectance(r2.sqrt());
                        assert!(
                            (found - expected).abs() <= 3e-3 * exact.reflectance(0.0),
                            "{} {radius} {share}",
                            preset.name
                        );
                        assert!(found > 0.0 && found <= 1.003 * whole, "{} {radius} {share}", preset.name);
                    }
                }
            }
        }
    }

    #[test]
    fn the_tail_is_the_integral_of_the_polynomial() {
        for preset in &PRESETS {
            let [dipole, ..] = preset.properties().dipoles(BoundaryFit::Published);
            let soft = Softened::new(&dipole, 2.0);
            for r in [0.0, 0.5, 1.9, 2.0, 3.0] {
                let value = |s: f64| soft.inside(s * s).unwrap_or(0.0) * s;
                let expected = if r < 2.0 { integrate(value, r, 2.0, 1e-14) } else { 0.0 };
                assert!((soft.tail_inside(r * r) - expected).abs() < 1e-9, "{}: {r}", preset.name);
            }
        }
    }

    #[test]
    fn a_profile_without_values_or_derivatives_stays_finite() {
        struct Odd;
        impl Profile for Odd {
            fn reflectance(&self, r_mm: f64) -> f64 {
                if r_mm < 1.0 { f64::INFINITY } else { f64::NAN }
            }
            fn tail(&self, _: f64) -> f64 {
                0.0
            }
        }
        for radius in [1e-3, 1.0, 1e3] {
            assert_eq!(Softened::new(&Odd, radius).inside(0.0), Some(0.0));
        }
    }
}
