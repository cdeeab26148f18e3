//! The hit of a ray on a triangle.

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
