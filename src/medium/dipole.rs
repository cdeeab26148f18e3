//! The dipole diffusion approximation of Jensen et al. (2001), with closed forms for discs and planar triangles.

use glam::DVec3;

use super::planar::{self, Radial};
use super::profile::Profile;
use super::profiles::boundary::Coefficients;
use crate::math::quadrature::{gauss_legendre_cached, integrate_with};

use std::f64::consts::{LOG2_E, TAU};

/// `exp(-x)` for x >= 0 to 3e-16 of itself, 0 beyond 700; by additions and multiplications only, so that
/// every processor and every system library gives the same bits.
pub(super) fn decay(x: f64) -> f64 {
    // Upper 32 bits of ln 2, whose products with the exponents are exact, and the rest.
    const LN_2_HIGH: f64 = 0.693_147_180_369_123_816_490;
    const LN_2_LOW: f64 = 1.908_214_929_270_587_700_02e-10;
    if x.is_nan() || x >= 700.0 {
        return 0.0;
    }
    let halvings = (x * LOG2_E + 0.5).floor();
    let rest = (halvings * LN_2_HIGH - x) + halvings * LN_2_LOW;
    // Taylor series on [-ln 2 / 2, ln 2 / 2].
    let mut sum = 1.0;
    for k in (1..=14).rev() {
        sum = 1.0 + sum * (rest / f64::from(k));
    }
    sum * f64::from_bits((1023 - halvings as u64) << 52)
}

/// One source below or above the surface: it contributes `weight (1 + sigma d) exp(-sigma d) / d^3` to R_d,
/// with `d = sqrt(r^2 + z^2)`.
///
/// Any profile that is a sum of such terms (dipole, multipole, a fit) shares the functions of this module.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pole {
    /// Factor in mm; `alpha' z / (4 pi)` for the dipole.
    pub weight: f64,
    /// Distance of the source from the surface in mm, positive.
    pub z_mm: f64,
    /// Effective transport coefficient sigma_tr in 1/mm.
    pub sigma_per_mm: f64,
}

impl Pole {
    /// Contribution to R_d at `r_mm`, in 1/mm^2.
    pub fn reflectance(&self, r_mm: f64) -> f64 {
        self.kernel(r_mm.hypot(self.z_mm))
    }

    /// Contribution to R_d at a squared distance in mm^2, in 1/mm^2, by [`decay`].
    pub(super) fn reflectance_at_square(&self, s_mm2: f64) -> f64 {
        let d2 = s_mm2 + self.z_mm * self.z_mm;
        let d = d2.sqrt();
        let x = self.sigma_per_mm * d;
        self.weight * ((1.0 + x) * decay(x)) / (d * d2)
    }

    /// Contribution to R_d and its first two derivatives in `s = r^2`.
    ///
    /// `(-2 d/ds)^n exp(-x) / d = exp(-x) theta_n(x) / d^(2n + 1)` with the reverse Bessel polynomials theta_n.
    fn derivatives(&self, s_mm2: f64) -> [f64; 3] {
        let d2 = s_mm2 + self.z_mm * self.z_mm;
        let d = d2.sqrt();
        let x = self.sigma_per_mm * d;
        let scale = self.weight * decay(x) / (d * d2);
        if scale == 0.0 {
            return [0.0; 3];
        }
        let theta_2 = 3.0 + x * (3.0 + x);
        let theta_3 = 15.0 + x * (15.0 + x * (6.0 + x));
        [scale * (1.0 + x), -0.5 * scale * theta_2 / d2, 0.25 * scale * theta_3 / d2 / d2]
    }

    /// `weight (1 + sigma d) exp(-sigma d) / d^3`.
    fn kernel(&self, d: f64) -> f64 {
        let x = self.sigma_per_mm * d;
        // The largest finite distances overflow x or d^3.
        if x < 1e300 && d < 1e300 { self.weight * (1.0 + x) * (-x).exp() / d / d / d } else { 0.0 }
    }

    /// `Int_r^inf` of the contribution times `r dr`: `weight exp(-sigma d) / d`, without unit.
    pub fn tail(&self, r_mm: f64) -> f64 {
        let d = r_mm.hypot(self.z_mm);
        if d.is_finite() { self.weight * (-self.sigma_per_mm * d).exp() / d } else { 0.0 }
    }

    /// `tail(0) - tail(r)` without the cancellation at small r.
    fn near(&self, r_mm: f64) -> f64 {
        let d = r_mm.hypot(self.z_mm);
        if !d.is_finite() {
            return self.tail(0.0);
        }
        let beyond = r_mm * (r_mm / (d + self.z_mm));
        let rise = 1.0 + self.sigma_per_mm * self.z_mm * decay_mean(self.sigma_per_mm * beyond);
        self.weight * (-self.sigma_per_mm * self.z_mm).exp() / self.z_mm * (beyond / d) * rise
    }
}

impl Radial for Pole {
    fn rate_per_mm(&self, r_mm: f64) -> f64 {
        1.0 / r_mm.hypot(self.z_mm) + self.sigma_per_mm
    }

    fn at_square(&self, r2_mm2: f64) -> f64 {
        self.kernel((r2_mm2 + self.z_mm * self.z_mm).sqrt())
    }

    /// With `D^2 = H^2 + z^2 + offset^2` and the coordinate `s = D sinh u`, the distance is `d = D cosh u` and the
    /// integrand `(tail(H) - tail) offset / rho^2 ds` has no pole at rho = 0: it is analytic for |Im u| < pi / 2, so
    /// Gauss-Legendre converges geometrically at a known rate.
    fn edge(&self, height_mm: f64, offset_mm: f64, from_mm: f64, to_mm: f64) -> f64 {
        let d0 = height_mm.hypot(self.z_mm);
        let scale = d0.hypot(offset_mm);
        let (from, to) = ((from_mm / scale).asinh(), (to_mm / scale).asinh());
        let factor = self.weight * (-self.sigma_per_mm * d0).exp() / d0 * offset_mm;
        // Written so that an edge without length, an underflow and NaN all end here.
        if !(factor != 0.0 && from != to && (factor * (to - from)).is_finite()) {
            return 0.0;
        }
        let panels = ((to - from).abs() / LONGEST_PANEL).ceil().max(1.0);
        let width = (to - from) / panels;
        let rule = gauss_legendre_cached(panel_order(0.5 * width.abs()));
        let sigma_d0 = self.sigma_per_mm * d0;
        let mut sum = 0.0;
        for panel in 0..panels as usize {
            let left = from + width * panel as f64;
            sum += integrate_with(rule, left, left + width, |u| {
                // Half the cost of cosh, and u = 0 needs no digits that this loses.
                let grown = u.exp();
                let d = 0.5 * scale * (grown + 1.0 / grown);
                let rise = 1.0 + sigma_d0 * decay_mean(self.sigma_per_mm * (d - d0).max(0.0));
                rise / (d + d0)
            });
        }
        factor * sum
    }
}

/// `(1 - exp(-x)) / x`: the mean of a decay over [0, x], 1 at x = 0; x >= 0.
fn decay_mean(x: f64) -> f64 {
    if x > 0.5 {
        // No cancellation here, and exp is the cheaper function.
        (1.0 - (-x).exp()) / x
    } else if x > 1e-8 {
        -(-x).exp_m1() / x
    } else {
        1.0 - 0.5 * x
    }
}

/// Longest panel of an edge integral in the coordinate u.
const LONGEST_PANEL: f64 = 1.5;

/// Half-width of the strip around the real u axis in which the edge integrand is bounded by a small multiple of the
/// total.
const STRIP: f64 = 1.2;

/// Error aimed at by a rule, relative to the total reflectance.
const PANEL_ERROR: f64 = 2e-11;

/// Gauss points that reach [`PANEL_ERROR`] on a panel of the given half-width: the error falls as `rho^(-2 n)`, with
/// rho the sum of the semi-axes of the largest ellipse around the panel inside the strip.
fn panel_order(half_width: f64) -> usize {
    let semi_axis = STRIP / half_width.max(1e-12);
    let rho = semi_axis + (semi_axis * semi_axis + 1.0).sqrt();
    ((-PANEL_ERROR.ln() / (2.0 * rho.ln())).ceil() as usize).max(2)
}

/// The dipole of one channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dipole {
    /// Reduced albedo alpha' = sigma_s' / sigma_t', in [0, 1]; 0 makes the whole profile 0.
    pub albedo: f64,
    /// Effective transport coefficient sigma_tr = sqrt(3 sigma_a sigma_t') in 1/mm; 0 without absorption.
    pub sigma_tr_per_mm: f64,
    /// Depth of the real source, 1 / sigma_t', in mm.
    pub z_real_mm: f64,
    /// Height of the virtual source, z_real (1 + 4 A / 3), in mm.
    pub z_virtual_mm: f64,
}

impl Dipole {
    /// The dipole of a medium with the reduced scattering and the absorption coefficient (1/mm) and the boundary's
    /// `a = (1 + F_dr) / (1 - F_dr)` (Jensen et al. 2001, equation 4; A as in [`super::fresnel::boundary_a`]).
    ///
    /// Without extinction nothing returns: the profile is 0. Negative and non-finite coefficients count as 0, `a` below
    /// 1 as 1. Extinctions outside 1e-12..1e12 per mm saturate at constant albedo.
    pub fn new(sigma_s_reduced_per_mm: f64, sigma_a_per_mm: f64, a: f64) -> Self {
        let Some(medium) = Coefficients::of(sigma_s_reduced_per_mm, sigma_a_per_mm) else {
            return Self { albedo: 0.0, sigma_tr_per_mm: 0.0, z_real_mm: 1.0, z_virtual_mm: 1.0 };
        };
        let a = if a.is_finite() { a.max(1.0) } else { 1.0 };
        let z_real_mm = 1.0 / medium.extinction_per_mm;
        Self {
            albedo: medium.albedo,
            sigma_tr_per_mm: medium.extinction_per_mm * (3.0 * medium.absorbed).sqrt(),
            z_real_mm,
            z_virtual_mm: z_real_mm * (1.0 + 4.0 / 3.0 * a),
        }
    }

    /// The real and the virtual source.
    pub fn poles(&self) -> [Pole; 2] {
        [self.z_real_mm, self.z_virtual_mm].map(|z_mm| Pole {
            weight: self.albedo * z_mm / (2.0 * TAU),
            z_mm,
            sigma_per_mm: self.sigma_tr_per_mm,
        })
    }
}

/// The dipole without the light that scatters once, which single scattering stands for.
///
/// At a fixed extinction a profile is a series in the albedo whose n-th term is the light of n events. The first is the albedo times the
/// dipole's limit for small ones, where `sigma_tr = sqrt(3) sigma_t'`; this is the rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LaterDipole {
    /// The sources of the dipole, and those of its first term, of negative weight.
    poles: [Pole; 4],
}

impl Dipole {
    /// The same without light that scatters once.
    pub fn after_first(&self) -> LaterDipole {
        let [real, image] = self.poles();
        let sigma_per_mm = 3.0_f64.sqrt() / self.z_real_mm;
        let first = |pole: Pole| Pole { weight: -pole.weight, sigma_per_mm, ..pole };
        LaterDipole { poles: [real, image, first(real), first(image)] }
    }
}

impl Profile for LaterDipole {
    fn reflectance(&self, r_mm: f64) -> f64 {
        // Of equal terms rounding is left, which may be negative.
        self.poles.iter().map(|pole| pole.reflectance(r_mm)).sum::<f64>().max(0.0)
    }

    fn tail(&self, r_mm: f64) -> f64 {
        self.poles.iter().map(|pole| pole.tail(r_mm)).sum::<f64>().max(0.0)
    }

    fn disc(&self, r_mm: f64) -> f64 {
        TAU * self.poles.iter().map(|pole| pole.near(r_mm)).sum::<f64>().max(0.0)
    }

    fn triangle(&self, receiver_mm: DVec3, corners_mm: [DVec3; 3]) -> f64 {
        planar::triangle(&self.poles, receiver_mm, corners_mm)
    }

    fn expansion(&self, s_mm2: f64) -> [f64; 3] {
        let sum = self.poles.iter().map(|pole| pole.derivatives(s_mm2));
        let [value, first, second] = sum.fold([0.0; 3], |sum, of| std::array::from_fn(|k| sum[k] + of[k]));
        [value.max(0.0), first, 0.5 * second]
    }
}

impl Profile for Dipole {
    fn reflectance(&self, r_mm: f64) -> f64 {
        self.poles().iter().map(|pole| pole.reflectance(r_mm)).sum()
    }

    fn tail(&self, r_mm: f64) -> f64 {
        self.poles().iter().map(|pole| pole.tail(r_mm)).sum()
    }

    fn total(&self) -> f64 {
        let decay = |z: f64| (-self.sigma_tr_per_mm * z).exp();
        0.5 * self.albedo * (decay(self.z_real_mm) + decay(self.z_virtual_mm))
    }

    fn disc(&self, r_mm: f64) -> f64 {
        TAU * self.poles().iter().map(|pole| pole.near(r_mm)).sum::<f64>()
    }

    fn triangle(&self, receiver_mm: DVec3, corners_mm: [DVec3; 3]) -> f64 {
        planar::triangle(&self.poles(), receiver_mm, corners_mm)
    }

    fn expansion(&self, s_mm2: f64) -> [f64; 3] {
        let [real, image] = self.poles().map(|pole| pole.derivatives(s_mm2));
        [real[0] + image[0], real[1] + image[1], 0.5 * (real[2] + image[2])]
    }
}

#[cfg(test)]
pub(super) mod tests;
