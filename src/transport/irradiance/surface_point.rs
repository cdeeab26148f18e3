//! Points of the surface that are lit.

use glam::DVec3;

use crate::geometry::bvh::{Ray, offset_origin};

/// A point of the surface.
#[derive(Clone, Copy, Debug, Default)]
pub struct SurfacePoint {
    /// Position relative to the mesh's origin, mm.
    pub at: DVec3,
    /// Unit normal; zero where there is none, and nothing arrives.
    pub normal: DVec3,
    /// The triangle that casts no shadow on it, or [`crate::geometry::bvh::NO_TRIANGLE`].
    pub triangle: u32,
}

impl SurfacePoint {
    /// The ray towards a light.
    pub(super) fn shadow_ray(&self, direction: DVec3, distance: f64) -> Ray {
        Ray {
            origin: offset_origin(self.at.as_vec3(), self.normal.as_vec3()),
            direction: direction.as_vec3(),
            t_min: 0.0,
            t_max: distance as f32,
        }
    }
}
