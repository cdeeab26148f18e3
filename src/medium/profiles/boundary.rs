//! Moments of the internal Fresnel reflectance, and coefficients of a channel that the models start from.

use crate::math::quadrature::integrate;
use crate::medium::fresnel::{BoundaryFit, internal_diffuse_reflectance, transmittance};

/// Absolute tolerance of the second moment.
const MOMENT_TOLERANCE: f64 = 1e-14;

/// Reduced extinctions beyond these bounds (1/mm) saturate, so that every power of a distance in a profile stays a
/// normal number in f32 as well. The albedo, and with it the total reflectance, is kept.
const EXTINCTION_BOUNDS_PER_MM: (f64, f64) = (1e-12, 1e12);

/// The boundary of a half space to the second order in the angle (d'Eon and Irving 2011, section 3).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Boundary {
    /// `A = (1 + 3 C_2) / (1 - 2 C_1)` of the extrapolated boundary.
    pub a: f64,
    /// Exitance for each unit of fluence, `(1 - 2 C_1) / 4`.
    pub fluence: f64,
    /// Exitance for each unit of net flux, `(1 - 3 C_2) / 2`.
    pub flux: f64,
}

impl Boundary {
    /// Exact moments of unpolarised Fresnel reflection for light inside the medium.
    pub(super) fn new(eta_inside_over_outside: f64) -> Self {
        let through_1 = 1.0 - internal_diffuse_reflectance(eta_inside_over_outside, BoundaryFit::Exact);
        let through_2 = second_moment_of_transmittance(eta_inside_over_outside);
        // 3 C_2 = 1 - through_2.
        Self { a: (2.0 - through_2) / through_1.max(f64::EPSILON), fluence: 0.25 * through_1, flux: 0.5 * through_2 }
    }
}

/// `3 Int_0^1 F_t mu^2 dmu` over the cosine inside.
fn second_moment_of_transmittance(eta: f64) -> f64 {
    let dense = if eta < 1.0 { 1.0 / eta } else { eta };
    let k = ((dense - 1.0) * (dense + 1.0)).sqrt();
    if k == 0.0 {
        return 1.0;
    }
    // As for the first moment: the cosine in the thinner medium is k sinh u, the other one k cosh u / dense.
    let span = (1.0 / k).asinh();
    let integrand = |u: f64| {
        let (thin, thick) = (k * u.sinh(), k * u.cosh() / dense);
        let inside = if eta < 1.0 { thin } else { thick / dense / dense };
        transmittance(dense, thin) * inside * thin * k * u.cosh()
    };
    (3.0 * integrate(integrand, 0.0, span, MOMENT_TOLERANCE)).clamp(0.0, 1.0)
}

/// Coefficients of one channel in the form that the models use.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::medium) struct Coefficients {
    /// Reduced albedo alpha' in [0, 1]; 0 without extinction.
    pub albedo: f64,
    /// `1 - alpha'` without cancellation.
    pub absorbed: f64,
    /// Reduced extinction in 1/mm, within bounds and positive.
    pub extinction_per_mm: f64,
}

impl Coefficients {
    /// Coefficients from sigma_s' and sigma_a; negative and non-finite values count as 0. None without extinction.
    pub(in crate::medium) fn of(sigma_s_reduced_per_mm: f64, sigma_a_per_mm: f64) -> Option<Self> {
        let usable = |sigma: f64| if sigma.is_finite() && sigma > 0.0 { sigma } else { 0.0 };
        let (scattering, absorption) = (usable(sigma_s_reduced_per_mm), usable(sigma_a_per_mm));
        let larger = scattering.max(absorption);
        if larger == 0.0 {
            return None;
        }
        // Fractions first: neither the sum of two huge coefficients nor the product of two tiny ones is representable.
        let sum = scattering / larger + absorption / larger;
        let (lowest, highest) = EXTINCTION_BOUNDS_PER_MM;
        Some(Self {
            albedo: scattering / larger / sum,
            absorbed: absorption / larger / sum,
            extinction_per_mm: (larger * sum).clamp(lowest, highest),
        })
    }

    /// [`Self::of`], black without extinction.
    pub(super) fn new(sigma_s_reduced_per_mm: f64, sigma_a_per_mm: f64) -> Self {
        let black = Self { albedo: 0.0, absorbed: 1.0, extinction_per_mm: 1.0 };
        Self::of(sigma_s_reduced_per_mm, sigma_a_per_mm).unwrap_or(black)
    }
}

/// The modified diffusion of Grosjean (1956), introduced to graphics by d'Eon and Irving (2011).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Grosjean {
    /// `D = (2 sigma_a + sigma_s') / (3 sigma_t'^2)` in mm.
    pub diffusion_mm: f64,
    /// `sqrt(sigma_a / D)` in 1/mm.
    pub sigma_tr_per_mm: f64,
}

impl Grosjean {
    /// The diffusion of a medium.
    pub(super) fn new(medium: &Coefficients) -> Self {
        let share = (1.0 + medium.absorbed) / 3.0;
        Self {
            diffusion_mm: share / medium.extinction_per_mm,
            sigma_tr_per_mm: medium.extinction_per_mm * (medium.absorbed / share).sqrt(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::medium::fresnel::reflectance_inside;

    #[test]
    fn moments_are_the_integrals_of_the_internal_reflectance() {
        for eta in [0.5_f64, 0.8, 0.999, 1.0, 1.001, 1.3, 1.5, 2.4] {
            let critical = if eta > 1.0 { (1.0 - 1.0 / (eta * eta)).sqrt() } else { 0.0 };
            let moment = |power: i32| {
                let weight = |mu: f64| mu.powi(power) * reflectance_inside(eta, mu);
                integrate(weight, 0.0, critical, 1e-13) + integrate(weight, critical, 1.0, 1e-13)
            };
            let (two_c1, three_c2) = (2.0 * moment(1), 3.0 * moment(2));
            let boundary = Boundary::new(eta);
            let expected = [(1.0 + three_c2) / (1.0 - two_c1), 0.25 * (1.0 - two_c1), 0.5 * (1.0 - three_c2)];
            for (got, want) in [boundary.a, boundary.fluence, boundary.flux].into_iter().zip(expected) {
                assert!((got - want).abs() < 1e-8 * want, "{eta} {got} {want}");
            }
            // What leaves is the net flux wherever the boundary condition holds.
            assert!((boundary.fluence * 2.0 * boundary.a + boundary.flux - 1.0).abs() < 1e-12, "{eta}");
        }
    }
}
