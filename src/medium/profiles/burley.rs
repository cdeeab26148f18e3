//! Normalised diffusion: Christensen and Burley, "Approximate Reflectance Profiles for Efficient Subsurface Scattering"
//! (2015).
//!
//! `R(r) = A (exp(-r / d) + exp(-r / (3 d))) / (8 pi d r)` with `d = l / s(A)`; the total is A. R grows as 1/r towards
//! r = 0.

use super::better_dipole::BetterDipole;
use super::boundary::{Coefficients, Grosjean};
use crate::medium::profile::Profile;

use std::f64::consts::PI;

/// Least distance over d, so that R(0) is finite; `tail` is exact all the same.
const SMALLEST_RATIO: f64 = 1e-9;

/// Fit of the shape `s(A)`, which also decides the length l.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum BurleyFit {
    /// Light straight down (equation 5): `1.85 - A + 7 |A - 0.8|^3`, l the mean free path.
    #[default]
    Searchlight,
    /// Diffuse light on a rough surface (equation 6): `1.9 - A + 3.5 (A - 0.8)^2`, l the mean free path.
    Diffuse,
    /// Light straight down (equation 8): `3.5 + 100 (A - 0.33)^4`, l the diffuse mean free path 1 / sigma_tr.
    DiffuseMeanFreePath,
}

impl BurleyFit {
    /// s of an albedo in [0, 1].
    pub fn shape(self, albedo: f64) -> f64 {
        match self {
            Self::Searchlight => 1.85 - albedo + 7.0 * (albedo - 0.8).abs().powi(3),
            Self::Diffuse => 1.9 - albedo + 3.5 * (albedo - 0.8).powi(2),
            Self::DiffuseMeanFreePath => 3.5 + 100.0 * (albedo - 0.33).powi(4),
        }
    }
}

/// Normalised diffusion of one channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Burley {
    /// Total reflectance in [0, 1].
    pub albedo: f64,
    /// d = l / s in mm, positive.
    pub d_mm: f64,
}

impl Burley {
    /// The profile with a total reflectance and the length that `fit` scales by. An albedo outside [0, 1] is clamped,
    /// NaN is 0; a length that is not positive counts as 1e-12 mm, one above 1e12 mm as 1e12.
    pub fn new(albedo: f64, length_mm: f64, fit: BurleyFit) -> Self {
        let albedo = if albedo > 0.0 { albedo.min(1.0) } else { 0.0 };
        let length_mm = if length_mm > 1e-12 { length_mm.min(1e12) } else { 1e-12 };
        Self { albedo, d_mm: length_mm / fit.shape(albedo) }
    }

    /// The profile of a medium: A is the total of the better dipole, l its reduced mean free path 1 / sigma_t' or, for
    /// [`BurleyFit::DiffuseMeanFreePath`], 1 / sigma_tr by Grosjean's diffusion (1e12 mm without absorption).
    ///
    /// The published s(A) was fitted to light of all orders, A here leaves out single scattering as all profiles do.
    pub fn of_medium(sigma_s_reduced_per_mm: f64, sigma_a_per_mm: f64, eta: f64, fit: BurleyFit) -> Self {
        let medium = Coefficients::new(sigma_s_reduced_per_mm, sigma_a_per_mm);
        let length_mm = match fit {
            BurleyFit::Searchlight | BurleyFit::Diffuse => 1.0 / medium.extinction_per_mm,
            BurleyFit::DiffuseMeanFreePath => 1.0 / Grosjean::new(&medium).sigma_tr_per_mm,
        };
        Self::new(BetterDipole::new(sigma_s_reduced_per_mm, sigma_a_per_mm, eta).total(), length_mm, fit)
    }
}

impl Profile for Burley {
    fn reflectance(&self, r_mm: f64) -> f64 {
        let x = (r_mm / self.d_mm).max(SMALLEST_RATIO);
        self.albedo * ((-x).exp() + (-x / 3.0).exp()) / (8.0 * PI * self.d_mm) / self.d_mm / x
    }

    fn tail(&self, r_mm: f64) -> f64 {
        let x = r_mm / self.d_mm;
        self.albedo * ((-x).exp() + 3.0 * (-x / 3.0).exp()) / (8.0 * PI)
    }
}
