//! What every radial diffuse reflectance profile offers, whatever its model.

use glam::DVec3;

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

    /// `Int_triangle R_d(|x - y|) dA(y)`, the receiver anywhere in space.
    fn triangle(&self, receiver_mm: DVec3, corners_mm: [DVec3; 3]) -> f64;
}
