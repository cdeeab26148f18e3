//! Integrals over planar triangles for any profile with a known tail.

use glam::DVec3;

use crate::math::quadrature::integrate;
use crate::medium::dipole::{Radial, radial_triangle};
use crate::medium::profile::Profile;

/// Target for the error of an edge, relative to `tail(0)`.
const EDGE_ERROR: f64 = 1e-11;

/// Parameter beyond which the weight `1 / cosh v` of an edge is below rounding.
const LARGEST_PARAMETER: f64 = 40.0;

/// A profile as a kernel for edges, by its tail alone.
struct ByTail<'a, P: ?Sized>(&'a P);

impl<P: Profile + ?Sized> Radial for ByTail<'_, P> {
    fn rate_per_mm(&self, r_mm: f64) -> f64 {
        // R r / tail is the decay rate where the profile falls exponentially, p / r where it falls as a power.
        let rate = 1.0 / r_mm + self.0.reflectance(r_mm) * r_mm / self.0.tail(r_mm);
        if rate.is_finite() { rate } else { f64::INFINITY }
    }

    fn at_square(&self, r2_mm2: f64) -> f64 {
        self.0.reflectance(r2_mm2.sqrt())
    }

    /// With `s = offset sinh v` along the edge `d theta = dv / cosh v`: a profile of any length is a step of order 1 in
    /// v.
    fn edge(&self, height_mm: f64, offset_mm: f64, from_mm: f64, to_mm: f64) -> f64 {
        let bound = |s: f64| (s / offset_mm.abs()).asinh().clamp(-LARGEST_PARAMETER, LARGEST_PARAMETER);
        let (from, to) = (bound(from_mm), bound(to_mm));
        // An edge through the foot point has no wedge; written so that NaN ends here too.
        if !(offset_mm.abs() > 0.0 && from != to && (to - from).is_finite()) {
            return 0.0;
        }
        let top = self.0.tail(height_mm);
        let tolerance = EDGE_ERROR * self.0.tail(0.0);
        let wedge = |v: f64| {
            let cosh = v.cosh();
            (top - self.0.tail(height_mm.hypot(offset_mm * cosh))) / cosh
        };
        // The integrand is even: from 0 outwards its peak sits at an end.
        let half = |v: f64| if v == 0.0 { 0.0 } else { v.signum() * integrate(wedge, 0.0, v.abs(), tolerance) };
        offset_mm.signum() * (half(to) - half(from))
    }
}

/// `Int_triangle R_d(|x - y|) dA(y)`, the receiver anywhere in space; accurate to 1e-10 of the total reflectance.
pub(super) fn triangle(profile: &(impl Profile + ?Sized), receiver_mm: DVec3, corners_mm: [DVec3; 3]) -> f64 {
    radial_triangle(&[ByTail(profile)], receiver_mm, corners_mm)
}
