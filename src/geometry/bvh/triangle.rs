//! The one definition of a hit (Woop, Benthin, Wald 2013), exact on sheared vertices.

use super::build::{Block, WIDTH};
use super::lanes::Lanes;
use super::ray::Query;

/// No triangle: the value of `skip` that skips nothing.
pub const NO_TRIANGLE: u32 = u32::MAX;

/// Intersection of a ray with a triangle.
///
/// The point is `(1 - u - v) * a + u * b + v * c` for the corners `a`, `b`, `c`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Index of the triangle as it was given.
    pub triangle: u32,
    /// Ray parameter: the distance in mm for a unit direction.
    pub t: f32,
    /// Weight of the second corner.
    pub u: f32,
    /// Weight of the third corner.
    pub v: f32,
}

/// A hit before rounding.
#[derive(Clone, Copy, Debug)]
pub(super) struct ExactHit {
    /// Distance from the ray's own origin.
    pub t: f64,
    /// Weight of the second corner.
    pub u: f64,
    /// Weight of the third corner.
    pub v: f64,
}

impl ExactHit {
    /// The hit in single precision.
    pub(super) fn rounded(self, triangle: u32) -> Hit {
        Hit { triangle, t: self.t as f32, u: self.u as f32, v: self.v as f32 }
    }
}

/// Lanes of a block whose triangle may be hit: exactly those in which no two edge functions have opposite signs in
/// 32-bit arithmetic. Rounding is monotonic, so a computed sign is right wherever it is not zero, and a lane that is
/// left out has no hit; nothing is said about distances. Contracting a product and a difference would break this.
#[inline(always)]
pub(super) fn candidates<L: Lanes>(block: &Block, query: &Query, count: u32) -> u32 {
    let (ax, ay) = shear::<L>(&block.corners[0], query);
    let (bx, by) = shear::<L>(&block.corners[1], query);
    let (cx, cy) = shear::<L>(&block.corners[2], query);
    let u = L::sub(L::mul(cx, by), L::mul(cy, bx));
    let v = L::sub(L::mul(ax, cy), L::mul(ay, cx));
    let w = L::sub(L::mul(bx, ay), L::mul(by, ax));
    let outside = L::opposite_signs(L::min(L::min(u, v), w), L::max(L::max(u, v), w));
    !outside & ((1 << count) - 1)
}

/// One corner of eight triangles in the frame of the ray. (A closure would not be compiled for the caller's features.)
#[inline(always)]
fn shear<L: Lanes>(rows: &[[f32; WIDTH]; 3], query: &Query) -> (L::V, L::V) {
    let [kx, ky, kz] = query.axes;
    let z = L::sub(L::load(&rows[kz]), L::splat(query.origin[kz]));
    let x = L::sub(L::load(&rows[kx]), L::splat(query.origin[kx]));
    let y = L::sub(L::load(&rows[ky]), L::splat(query.origin[ky]));
    (L::sub(x, L::mul(L::splat(query.shear[0]), z)), L::sub(y, L::mul(L::splat(query.shear[1]), z)))
}

/// The hit of one lane, if there is one within the range of the ray.
///
/// Products of two 24-bit numbers are exact in 64 bits and their difference is rounded once, so signs are exact, each
/// weight is good to 15 digits however thin the triangle, and the weights of a shared edge are opposite.
#[inline(always)]
pub(super) fn exact(block: &Block, lane: usize, query: &Query) -> Option<ExactHit> {
    let lane = lane % WIDTH;
    let [kx, ky, kz] = query.axes;
    let shear = |corner: usize| {
        let rows = &block.corners[corner];
        let z = rows[kz][lane] - query.origin[kz];
        let x = rows[kx][lane] - query.origin[kx] - query.shear[0] * z;
        let y = rows[ky][lane] - query.origin[ky] - query.shear[1] * z;
        [f64::from(x), f64::from(y), f64::from(rows[kz][lane]) - f64::from(query.origin[kz])]
    };
    let [a, b, c] = [shear(0), shear(1), shear(2)];
    let u = c[0] * b[1] - c[1] * b[0];
    let v = a[0] * c[1] - a[1] * c[0];
    let w = b[0] * a[1] - b[1] * a[0];
    let inside = (u >= 0.0 && v >= 0.0 && w >= 0.0) || (u <= 0.0 && v <= 0.0 && w <= 0.0);
    let total = u + v + w;
    if !inside || total == 0.0 {
        // Edge-on: the neighbours across its edges cover the same points of the ray's plane.
        return None;
    }
    let t = query.start + (u * a[2] + v * b[2] + w * c[2]) / (total * query.direction_z);
    (query.range[0] < t && t < query.range[1]).then(|| ExactHit { t, u: v / total, v: w / total })
}
