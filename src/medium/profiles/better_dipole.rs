//! The better dipole: d'Eon, "A Better Dipole" (2012).
//!
//! Differences from the classical dipole: Grosjean's diffusion coefficient and source strength (the diffusion holds
//! light scattered at least twice, hence alpha'^2), the boundary `A = (1 + 3 C_2) / (1 - 2 C_1)` from the exact moments
//! of the Fresnel reflectance, and an exitance `C_phi phi + C_E E` from fluence and flux instead of the flux alone.

use super::boundary::{Boundary, Coefficients, Grosjean};
use crate::medium::dipole::Pole;
use crate::medium::profile::Profile;

use std::f64::consts::TAU;

/// The better dipole of one channel: a source below the surface and its mirror image, with the exitance by fluence and flux.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BetterDipole {
    /// Both sources' exitance by flux, weighted by C_E.
    flux: [Pole; 2],
    /// Factor of the fluence `(exp(-sigma d_r) / d_r - exp(-sigma d_v) / d_v)`, in mm^0 over mm: 1/mm times mm.
    fluence_per_mm: f64,
}

impl BetterDipole {
    /// The better dipole of a medium with the reduced scattering and the absorption coefficient (1/mm) and a refractive
    /// index.
    ///
    /// Without scattering nothing returns. Negative and non-finite coefficients count as 0; extinctions outside
    /// 1e-12..1e12 per mm saturate at constant albedo.
    pub fn new(sigma_s_reduced_per_mm: f64, sigma_a_per_mm: f64, eta_inside_over_outside: f64) -> Self {
        let medium = Coefficients::new(sigma_s_reduced_per_mm, sigma_a_per_mm);
        let boundary = Boundary::new(eta_inside_over_outside);
        let strength = medium.albedo * medium.albedo;
        Self::of_source(&boundary, &Grosjean::new(&medium), strength, 1.0 / medium.extinction_per_mm)
    }

    /// A source of `strength` at `z_mm` whose image is `2 z_b` farther from the surface.
    pub(super) fn of_source(boundary: &Boundary, diffusion: &Grosjean, strength: f64, z_mm: f64) -> Self {
        let image_mm = z_mm + 4.0 * boundary.a * diffusion.diffusion_mm;
        let pole = |z_mm: f64| Pole {
            weight: strength * boundary.flux * z_mm / (2.0 * TAU),
            z_mm,
            sigma_per_mm: diffusion.sigma_tr_per_mm,
        };
        Self {
            flux: [pole(z_mm), pole(image_mm)],
            fluence_per_mm: strength * boundary.fluence / (2.0 * TAU * diffusion.diffusion_mm),
        }
    }

    fn distances(&self, r_mm: f64) -> (f64, f64, f64) {
        let [near, far] = self.flux.map(|pole| pole.z_mm);
        let (d_near, d_far) = (r_mm.hypot(near), r_mm.hypot(far));
        // d_far - d_near without cancellation.
        (d_near, d_far, (far - near) * ((far + near) / (d_far + d_near)))
    }
}

impl Profile for BetterDipole {
    fn reflectance(&self, r_mm: f64) -> f64 {
        let (d_near, d_far, gap) = self.distances(r_mm);
        let sigma = self.flux[0].sigma_per_mm;
        if !(d_far < 1e150 && sigma * d_near < 1e300) {
            return 0.0;
        }
        let fade = (-sigma * d_near).exp();
        // exp(-s d_near) / d_near - exp(-s d_far) / d_far as a sum of positive terms.
        let fluence = fade * (gap / d_near - (-sigma * gap).exp_m1()) / d_far;
        self.fluence_per_mm * fluence + self.flux[0].reflectance(r_mm) + self.flux[1].reflectance(r_mm)
    }

    fn tail(&self, r_mm: f64) -> f64 {
        let (d_near, d_far, gap) = self.distances(r_mm);
        let sigma = self.flux[0].sigma_per_mm;
        if !(d_far < 1e150 && sigma * d_near < 1e300) {
            return 0.0;
        }
        // The fluence gives (exp(-sigma d_r) - exp(-sigma d_v)) / sigma.
        let x = sigma * gap;
        let mean = if x > 1e-8 { -(-x).exp_m1() / x } else { 1.0 - 0.5 * x };
        let fluence = self.fluence_per_mm * (-sigma * d_near).exp() * gap * mean;
        fluence + self.flux[0].tail(r_mm) + self.flux[1].tail(r_mm)
    }
}
