//! Thickness of a body below its vertices, in mean free paths.

use glam::DVec3;

use crate::geometry::bvh::{Bvh, Ray, offset_along};
use crate::parallel::*;
use crate::scene::Scene;
use crate::transport::single_scattering::{ExitPoint, vertex_points};

/// Share of the diagonal below which a hit is the surface that the ray leaves: normals of vertices are not those of their triangles.
const LEAST_SHARE: f64 = 1e-5;

/// Distance through the body from every source vertex along its inverse normal, in mean free paths `1 / sigma_t'` of the channel where these
/// are longest. Where nothing ends the body, the diagonal of the mesh counts; 0 for vertices without transferring area.
pub(super) fn thickness(scene: &Scene, bvh: &Bvh) -> Vec<f64> {
    let diagonal = scene.mesh.diagonal_mm();
    let of = |point: &ExitPoint| {
        let medium = scene.parts.parts.get(point.part as usize).and_then(|part| part.medium);
        let medium = medium.and_then(|index| scene.media.get(index as usize));
        let (Some(medium), true) = (medium, point.normal != DVec3::ZERO) else { return 0.0 };
        let inward = -point.normal;
        let origin = offset_along(point.at_mm.as_vec3(), inward);
        let ray = Ray { t_min: (LEAST_SHARE * diagonal) as f32, ..Ray::new(origin, inward.as_vec3()) };
        let through_mm = bvh.closest(&ray).map_or(diagonal, |hit| f64::from(hit.t));
        let longest = medium.properties.mean_free_path_mm().max_element();
        if longest > 0.0 { through_mm / longest } else { f64::INFINITY }
    };
    vertex_points(scene.domain()).par_iter().map(of).collect()
}
