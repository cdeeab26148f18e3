//! Integrals of radial kernels over planar triangles: edge after edge, or by points where the kernel hardly changes.

use glam::DVec3;

use crate::math::quadrature::gauss_legendre_cached;

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

    /// `Int (tail(H) - tail(sqrt(H^2 + rho^2))) d theta` of an edge in a plane `height_mm` from the receiver.
    ///
    /// The edge lies on a line at the signed distance `offset_mm` from the receiver's foot point and spans the
    /// coordinates `from_mm..to_mm` along that line, 0 at the foot of the perpendicular. Positive offset: the foot
    /// point is to the left of the edge. An edge whose line meets the foot point contributes exactly 0.
    fn edge(&self, height_mm: f64, offset_mm: f64, from_mm: f64, to_mm: f64) -> f64;
}

/// `Int_triangle R_d(|x - y|) dA(y)` for a profile that is a sum of `kernels`, the receiver anywhere in space.
///
/// Accurate to 1e-10 of the total reflectance of poles; far triangles to 1e-8 of their own value. Independent of the
/// triangle's orientation. A triangle without area, or with coordinates that are not finite, gives 0.
pub(super) fn triangle(kernels: &[impl Radial], receiver_mm: DVec3, corners_mm: [DVec3; 3]) -> f64 {
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
pub(super) fn near_triangle(kernel: &impl Radial, corners: [DVec3; 3], normal: DVec3) -> f64 {
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
pub(super) fn far_triangle(kernel: &impl Radial, corners: [DVec3; 3], doubled_area: f64, ratio: f64) -> f64 {
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
