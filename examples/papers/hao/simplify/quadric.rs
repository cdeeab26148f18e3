//! Sums of squared distances to planes (Garland and Heckbert 1997), weighted by area.

use std::ops::AddAssign;

use glam::DVec3;

/// The quadratic function `p -> Sum_i w_i (n_i.p - d_i)^2`; mm^4 where the weights are areas.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Quadric {
    /// Diagonal of the symmetric matrix.
    diagonal: DVec3,
    /// Entries yz, xz and xy of the matrix.
    mixed: DVec3,
    /// Minus half of the linear term.
    linear: DVec3,
    constant: f64,
}

impl Quadric {
    /// One plane through `point`.
    pub(super) fn plane(normal: DVec3, point: DVec3, weight: f64) -> Self {
        let offset = normal.dot(point);
        let scaled = normal * weight;
        Self {
            diagonal: scaled * normal,
            mixed: DVec3::new(scaled.y * normal.z, scaled.x * normal.z, scaled.x * normal.y),
            linear: scaled * offset,
            constant: weight * offset * offset,
        }
    }

    /// Value at a point; rounding can make it negative by a little, which is cut off.
    pub(super) fn at(&self, p: DVec3) -> f64 {
        let square = self.diagonal.dot(p * p);
        let mixed = self.mixed.dot(DVec3::new(p.y * p.z, p.x * p.z, p.x * p.y));
        (square + 2.0 * (mixed - self.linear.dot(p)) + self.constant).max(0.0)
    }
}

impl AddAssign for Quadric {
    fn add_assign(&mut self, other: Self) {
        self.diagonal += other.diagonal;
        self.mixed += other.mixed;
        self.linear += other.linear;
        self.constant += other.constant;
    }
}
