//! Single scattering: light that a medium scatters once (equation 4 of Wang, Tran and Luebke 2005).
//!
//! `L1(x_o, w_o) = F_t(w_o) sigma_s Int F_t(w_i) G p(w_i', w_o') Int_0^dm exp(-(s + s_i') sigma_t) L(w_i) ds dw_i`, with
//! `G = |w_i.n_i| / (eta^2 |w_i'.n_i|)` in the physical form and 1 as printed, s along the refracted way from the eye (or the inverse
//! normal), `d_m` its length, `s_i' = s_i |w_i.n_i| / |w_i'.n_i|` (equation 5) from the straight way towards the light.
//!
//! Everywhere the light's way is straight from the point inside to the light: refraction enters by the direction inside, by
//! the length `s_i'` and by G, which is exact for a flat surface and distant light, and no truth about glass marbles.
//!
//! - [`radiance`]: under lights, towards an eye or along the inverse normal, by random or by the paper's deterministic samples.
//! - [`vectors`]: the radiance that light of each texel of a cube map adds, which the all-frequency method compresses.
//! - [`plane`]: closed forms.
//!
//! The quantity per vertex, in the unit of radiosity, is `s = pi C L1 / F_t(w_o)`, so that `F_t(w_o) s / (pi C)` is the
//! radiance towards an eye, as it is for radiosity.

pub mod depths;
pub mod interface;
mod interior;
pub mod plane;
pub mod radiance;
pub mod vectors;

use std::f64::consts::PI;

use crate::medium::fresnel::diffuse_transmittance;

pub use self::depths::Density;
pub use self::interface::Form;
pub use self::interior::{Coefficients, Crossings, ExitPoint, Optics, inside_towards, vertex_points};

/// The factor `pi C` from `L1 / F_t(w_o)` to the quantity per vertex.
pub fn radiosity_factor(eta_inside_over_outside: f64) -> f64 {
    PI * diffuse_transmittance(eta_inside_over_outside)
}

#[cfg(test)]
mod tests;
