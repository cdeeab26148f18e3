//! What the middles of pixels see, for data that is no light.

use glam::DVec2;
use rayon::prelude::*;

use super::settings::RenderSettings;
use crate::evaluate::Evaluator;
use crate::evaluate::exitance::MeshPoint;
use crate::geometry::bvh::Ray;

/// The point of the mesh that the ray through the middle of each pixel meets first, row by row; none beside the mesh and on opaque parts.
pub fn centres(evaluator: &dyn Evaluator, settings: &RenderSettings) -> Vec<Option<MeshPoint>> {
    let (scene, bvh, resolution) = (evaluator.scene(), evaluator.bvh(), settings.resolution);
    let eye = (settings.camera.at_mm() - scene.mesh.origin_mm).as_vec3();
    let of = |index: usize| {
        let (x, y) = (index % resolution.width, index / resolution.width);
        let direction = settings.camera.direction(DVec2::new(x as f64 + 0.5, y as f64 + 0.5), resolution);
        let hit = bvh.closest(&Ray::new(eye, direction.as_vec3()))?;
        let part = *scene.parts.triangle_part.get(hit.triangle as usize)?;
        let [u, v] = [hit.u, hit.v].map(f64::from);
        let point = MeshPoint::new(&scene.mesh, hit.triangle, [1.0 - u - v, u, v])?;
        scene.parts.parts.get(part as usize)?.transfers().then_some(point)
    };
    (0..resolution.pixels()).into_par_iter().map(of).collect()
}
