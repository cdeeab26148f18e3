//! What the middles of pixels see, for data that is no light.

use glam::DVec2;

use super::camera::{Camera, Resolution};
use crate::evaluate::Evaluator;
use crate::evaluate::exitance::MeshPoint;
use crate::geometry::bvh::{Bvh, Ray};
use crate::parallel::*;
use crate::scene::Scene;

/// The point of the mesh that the ray through the middle of a pixel meets first, by column and row from the top left; none beside the mesh.
pub fn centre(
    (scene, bvh): (&Scene, &Bvh),
    (camera, resolution): (&Camera, Resolution),
    [x, y]: [usize; 2],
) -> Option<MeshPoint> {
    let mesh = &scene.mesh;
    let [min, max] = mesh.bounds_local_mm();
    let eye = camera.at_mm() - mesh.origin_mm;
    let direction = camera.direction(DVec2::new(x as f64 + 0.5, y as f64 + 0.5), resolution);
    // Far eyes start beside the scene, as those of pictures do: in 32 bits, the position of a far origin would move the ray.
    let free_mm = (0.5 * (min + max) - eye).dot(direction) - 0.5 * (max - min).length() * (1.0 + 1e-6);
    let origin = eye + direction * free_mm.max(0.0);
    let hit = bvh.closest(&Ray::new(origin.as_vec3(), direction.as_vec3()))?;
    let [u, v] = [hit.u, hit.v].map(f64::from);
    MeshPoint::new(mesh, hit.triangle, [1.0 - u - v, u, v])
}

/// [`centre`] of every pixel, row by row; none on opaque parts either.
pub fn centres(evaluator: &dyn Evaluator, (camera, resolution): (&Camera, Resolution)) -> Vec<Option<MeshPoint>> {
    let (scene, bvh) = (evaluator.scene(), evaluator.bvh());
    let of = |index: usize| {
        let place = [index % resolution.width, index / resolution.width];
        let point = centre((scene, bvh), (camera, resolution), place)?;
        scene.parts.transfers(point.triangle).then_some(point)
    };
    (0..resolution.pixels()).into_par_iter().map(of).collect()
}
