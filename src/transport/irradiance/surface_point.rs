//! Points of the surface that are lit, and directions from them.

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

/// Orders directions so that neighbours in the order are neighbours on the sphere: the Morton code of the octahedral map.
pub(in crate::transport) fn direction_key(d: DVec3) -> u32 {
    let sum = d.x.abs() + d.y.abs() + d.z.abs();
    let (x, z) = (d.x / sum, d.z / sum);
    let (u, v) = if d.y >= 0.0 { (x, z) } else { ((1.0 - z.abs()).copysign(x), (1.0 - x.abs()).copysign(z)) };
    let spread = |t: f64| {
        let cell = ((0.5 * t + 0.5).clamp(0.0, 1.0) * 1023.0) as u32;
        (0..10).fold(0, |code, bit| code | (cell >> bit & 1) << (2 * bit))
    };
    spread(u) | spread(v) << 1
}

/// The direction at cosine `mu` and azimuth around an axis.
pub(in crate::transport) fn around(axis: DVec3, mu: f64, azimuth: f64) -> DVec3 {
    let (t, b) = axis.any_orthonormal_pair();
    let radius = (1.0 - mu * mu).max(0.0).sqrt();
    axis * mu + t * (radius * azimuth.cos()) + b * (radius * azimuth.sin())
}
