//! The dipole diffusion approximation of Jensen et al. (2001), with closed forms for discs and planar triangles.

use glam::DVec3;

use super::profile::Profile;
use crate::math::quadrature::{gauss_legendre_cached, integrate_with};

use std::f64::consts::{LOG2_E, TAU};

/// Reduced extinctions beyond these bounds (1/mm) saturate, so that every power of a distance in the profile stays
/// a normal number in f32 as well. The albedo, and with it the total reflectance, is kept.
const EXTINCTION_BOUNDS_PER_MM: (f64, f64) = (1e-12, 1e12);

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

    /// The integral over the wedge between a receiver and an edge in a plane `height_mm` from it:
    /// `Int (tail(H) - tail(sqrt(H^2 + rho^2))) d theta`.
    ///
    /// The edge lies on a line at the signed distance `offset_mm` from the receiver's foot point and spans the
    /// coordinates `from_mm..to_mm` along that line, 0 at the foot of the perpendicular. Positive offset: the foot
    /// point is to the left of the edge. An edge whose line meets the foot point contributes exactly 0.
    ///
    /// With `D^2 = H^2 + z^2 + offset^2` and the coordinate `s = D sinh u`, the distance is `d = D cosh u` and the
    /// integrand `(tail(H) - tail) offset / rho^2 ds` has no pole at rho = 0: it is analytic for |Im u| < pi / 2, so
    /// Gauss-Legendre converges geometrically at a known rate.
    pub fn edge(&self, height_mm: f64, offset_mm: f64, from_mm: f64, to_mm: f64) -> f64 {
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

/// Triangles whose extent is below this fraction of the length over which the kernel changes are integrated directly,
/// which keeps the result accurate relative to itself at any distance.
const FAR_RATIO: f64 = 0.25;

/// A radial kernel with its integral over the wedge between a receiver and an edge; triangles follow from it.
pub(super) trait Radial {
    /// Rate of change of the kernel with distance, relative to itself, at the distance `r_mm`, in 1/mm; infinity is
    /// always correct.
    fn rate_per_mm(&self, r_mm: f64) -> f64;

    /// The kernel at a squared distance, in 1/mm^2.
    fn at_square(&self, r2_mm2: f64) -> f64;

    /// `Int (tail(H) - tail(sqrt(H^2 + rho^2))) d theta` of an edge, placed as in [`Pole::edge`].
    fn edge(&self, height_mm: f64, offset_mm: f64, from_mm: f64, to_mm: f64) -> f64;
}

impl Radial for Pole {
    fn rate_per_mm(&self, r_mm: f64) -> f64 {
        1.0 / r_mm.hypot(self.z_mm) + self.sigma_per_mm
    }

    fn at_square(&self, r2_mm2: f64) -> f64 {
        self.kernel((r2_mm2 + self.z_mm * self.z_mm).sqrt())
    }

    fn edge(&self, height_mm: f64, offset_mm: f64, from_mm: f64, to_mm: f64) -> f64 {
        Self::edge(self, height_mm, offset_mm, from_mm, to_mm)
    }
}

/// `Int_triangle R_d(|x - y|) dA(y)` for a profile that is a sum of `poles`, the receiver anywhere in space.
///
/// Accurate to 1e-10 of the total reflectance of the poles; far triangles to 1e-8 of their own value. Independent of
/// the triangle's orientation. A triangle without area, or with coordinates that are not finite, gives 0.
pub fn triangle(poles: &[Pole], receiver_mm: DVec3, corners_mm: [DVec3; 3]) -> f64 {
    radial_triangle(poles, receiver_mm, corners_mm)
}

/// [`triangle`] for a sum of any radial kernels.
pub(super) fn radial_triangle(kernels: &[impl Radial], receiver_mm: DVec3, corners_mm: [DVec3; 3]) -> f64 {
    let corners = corners_mm.map(|corner| corner - receiver_mm);
    let cross = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
    let doubled_area = cross.length();
    let normal = cross / doubled_area;
    if !(normal.is_finite() && doubled_area > 0.0) {
        return 0.0;
    }
    let centre = (corners[0] + corners[1] + corners[2]) / 3.0;
    let radius = corners.map(|corner| corner.distance(centre)).into_iter().fold(0.0, f64::max);
    let nearest = (centre.length() - radius).max(0.0);
    let value: f64 = kernels
        .iter()
        .map(|kernel| {
            let ratio = radius * kernel.rate_per_mm(nearest);
            if ratio < FAR_RATIO {
                far_triangle(kernel, corners, doubled_area, ratio)
            } else {
                near_triangle(kernel, corners, normal)
            }
        })
        .sum();
    // Rounding of the cancelling edges of a near, but dark triangle.
    if value.is_finite() { value.max(0.0) } else { 0.0 }
}

/// The sum over the edges of the wedges that they span with the receiver's foot point.
fn near_triangle(kernel: &impl Radial, corners: [DVec3; 3], normal: DVec3) -> f64 {
    let height = corners[0].dot(normal).abs();
    let mut sum = 0.0;
    for i in 0..3 {
        let (from, to) = (corners[i], corners[(i + 1) % 3]);
        let along = (to - from).normalize_or_zero();
        let offset = normal.dot(from.cross(along));
        sum += kernel.edge(height, offset, from.dot(along), to.dot(along));
    }
    sum
}

/// Gauss-Legendre over the triangle as a collapsed square; `ratio` is its extent over the length of change of the
/// kernel.
fn far_triangle(kernel: &impl Radial, corners: [DVec3; 3], doubled_area: f64, ratio: f64) -> f64 {
    let rule = gauss_legendre_cached(if ratio < 0.02 {
        3
    } else if ratio < 0.08 {
        4
    } else {
        6
    });
    let mut sum = 0.0;
    for outer in rule {
        let across = 0.5 * (1.0 + outer.position);
        let (left, right) = (corners[0].lerp(corners[1], across), corners[0].lerp(corners[2], across));
        let row: f64 = rule
            .iter()
            .map(|inner| {
                let point = left.lerp(right, 0.5 * (1.0 + inner.position));
                inner.weight * kernel.at_square(point.length_squared())
            })
            .sum();
        sum += outer.weight * across * row;
    }
    0.25 * doubled_area * sum
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
        let usable = |sigma: f64| if sigma.is_finite() && sigma > 0.0 { sigma } else { 0.0 };
        let (scattering, absorption) = (usable(sigma_s_reduced_per_mm), usable(sigma_a_per_mm));
        let larger = scattering.max(absorption);
        let (lowest, highest) = EXTINCTION_BOUNDS_PER_MM;
        if larger == 0.0 {
            return Self { albedo: 0.0, sigma_tr_per_mm: 0.0, z_real_mm: 1.0, z_virtual_mm: 1.0 };
        }
        // Fractions first: neither the sum of two huge coefficients nor the product of two tiny ones is representable.
        let sum = scattering / larger + absorption / larger;
        let extinction = (larger * sum).clamp(lowest, highest);
        let absorbed = absorption / larger / sum;
        let a = if a.is_finite() { a.max(1.0) } else { 1.0 };
        let z_real_mm = 1.0 / extinction;
        Self {
            albedo: scattering / larger / sum,
            sigma_tr_per_mm: extinction * (3.0 * absorbed).sqrt(),
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
        triangle(&self.poles(), receiver_mm, corners_mm)
    }

    fn expansion(&self, s_mm2: f64) -> [f64; 3] {
        let [real, image] = self.poles().map(|pole| pole.derivatives(s_mm2));
        [real[0] + image[0], real[1] + image[1], 0.5 * (real[2] + image[2])]
    }
}

#[cfg(test)]
mod tests;
