//! The interface of all radial diffuse reflectance profiles.

use glam::DVec3;

use super::planar::{self, Radial};
use crate::math::quadrature::integrate;

/// Step of the finite differences over a^2.
const STEP: f64 = 0.02;

/// Largest derivatives over the value at a, since derivatives of measured profiles are noisy.
const HIGHEST: [f64; 2] = [100.0, 1e4];

/// The orders of scattering that a kernel holds. Light that passes without scattering, order 0, is in none.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum Orders {
    /// One event and more.
    FromOne,
    /// Two events and more, where the first has a stage of its own.
    FromTwo,
}

impl Orders {
    /// Those of a kernel beside which the first order has a stage of its own, or has none.
    pub fn beside_first(is_apart: bool) -> Self {
        if is_apart { Self::FromTwo } else { Self::FromOne }
    }
}

/// A radial diffuse reflectance profile R_d(r) of one channel, r in mm, R_d in 1/mm^2.
///
/// Everything about a radial profile on planar pieces follows from its tail integral
/// `tail(t) = Int_t^inf R_d(r) r dr`: a disc of radius R around the receiver reflects `2 pi (tail(0) - tail(R))`,
/// and a planar triangle is a sum over its edges of `Int (tail(H) - tail(|x - e(theta)|)) d theta`.
pub trait Profile: Send + Sync {
    /// R_d at distance `r_mm`, in 1/mm^2.
    fn reflectance(&self, r_mm: f64) -> f64;

    /// `Int_r^inf R_d(s) s ds`, without unit.
    fn tail(&self, r_mm: f64) -> f64;

    /// Total diffuse reflectance of a half space, `2 pi tail(0)`.
    fn total(&self) -> f64 {
        std::f64::consts::TAU * self.tail(0.0)
    }

    /// Reflectance that a flat disc of radius `r_mm` around the receiver returns to its centre.
    fn disc(&self, r_mm: f64) -> f64 {
        std::f64::consts::TAU * (self.tail(0.0) - self.tail(r_mm))
    }

    /// The smallest radius (mm) around a receiver whose disc holds `fraction` of the total, to 1e-12 of itself.
    ///
    /// 0 for a fraction of 0 or less and for a profile that returns nothing; infinite for 1 or more.
    fn radius_containing_mm(&self, fraction: f64) -> f64 {
        self.range_mm(1.0 - fraction)
    }

    /// The smallest distance (mm) beyond which lies at most `share` of the total, to 1e-12 of itself; unlike
    /// [`Profile::radius_containing_mm`] it keeps the digits of shares near 0.
    ///
    /// 0 for a share of 1 or more and for a profile that returns nothing; infinite for 0 or less.
    fn range_mm(&self, share: f64) -> f64 {
        let whole = self.tail(0.0);
        // Written so that NaN ends here as well.
        if !(whole > 0.0 && share < 1.0) {
            return 0.0;
        }
        if share <= 0.0 {
            return f64::INFINITY;
        }
        let outside = share * whole;
        let (mut low, mut high) = (0.0, 1.0);
        while self.tail(high) > outside && high < 1e150 {
            (low, high) = (high, 4.0 * high);
        }
        while high - low > 1e-12 * high && high > 1e-150 {
            let middle = 0.5 * (low + high);
            if self.tail(middle) > outside { low = middle } else { high = middle }
        }
        high
    }

    /// `Int_triangle R_d(|x - y|) dA(y)`, the receiver anywhere in space; accurate to 1e-10 of the total reflectance.
    fn triangle(&self, receiver_mm: DVec3, corners_mm: [DVec3; 3]) -> f64 {
        triangle_by_tail(self, receiver_mm, corners_mm)
    }

    /// R_d, its derivative in `s = r^2` and half the second one at a squared distance in mm^2: 1/mm^2, 1/mm^4, 1/mm^6.
    /// By default from finite differences over a fiftieth of the square.
    fn expansion(&self, s_mm2: f64) -> [f64; 3] {
        let at = |u: f64| self.reflectance((s_mm2 * (1.0 + u)).sqrt());
        let [a, b, c, d, e] = [-2.0 * STEP, -STEP, 0.0, STEP, 2.0 * STEP].map(at);
        let first = (8.0 * (d - b) - (e - a)) / (12.0 * STEP);
        let second = (16.0 * (b + d) - (a + e) - 30.0 * c) / (12.0 * STEP * STEP);
        // Profiles decrease, and more slowly the farther they are.
        let first = if first.is_finite() { first.clamp(-HIGHEST[0] * c, 0.0) } else { 0.0 };
        let second = if second.is_finite() { second.clamp(0.0, HIGHEST[1] * c) } else { 0.0 };
        let s = s_mm2.max(f64::MIN_POSITIVE);
        [if c.is_finite() { c } else { 0.0 }, first / s, 0.5 * second / s / s]
    }
}

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

/// [`Profile::triangle`] by the profile's tail.
pub(super) fn triangle_by_tail(profile: &(impl Profile + ?Sized), receiver_mm: DVec3, corners_mm: [DVec3; 3]) -> f64 {
    planar::triangle(&[ByTail(profile)], receiver_mm, corners_mm)
}
