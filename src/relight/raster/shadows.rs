//! Visibility of directional, point and spot lights from the vertices, for their reflections: the shaders interpolate in
//! between.

use glam::{DVec3, Vec3};

use crate::geometry::bvh::{Bvh, NO_TRIANGLE, Ray, offset_origin};
use crate::light::Light;
use crate::parallel::*;
use crate::render::normals::welded_normals_mm2;
use crate::scene::Scene;

/// Number of lights with shadows, the first ones.
pub(crate) const SHADOWED: usize = 4;
/// Rays that are cast as one task.
const CHUNK: usize = 512;
/// Share of the diagonal by which rays start above the surface: between vertices a coarse mesh is flatter than it
/// looks.
const LIFT: f64 = 2e-3;

/// Origins of the shadow rays of the vertices.
pub(crate) struct Shadows {
    starts: Vec<(Vec3, Vec3)>,
    origin_mm: DVec3,
}

impl Shadows {
    /// Prepares the origins of the shadow rays of a scene's vertices.
    pub(crate) fn new(scene: &Scene) -> Self {
        let mesh = &scene.mesh;
        let normals = welded_normals_mm2(mesh);
        let lift = LIFT * mesh.diagonal_mm();
        let start = |vertex: usize| {
            let normal = normals[mesh.weld[vertex] as usize].normalize_or_zero();
            let point = mesh.local_mm[vertex].as_dvec3() + normal * lift;
            (offset_origin(point.as_vec3(), normal.as_vec3()), normal.as_vec3())
        };
        Self { starts: (0..mesh.local_mm.len()).map(start).collect(), origin_mm: mesh.origin_mm }
    }

    /// Origin of the rays, and normal, of each vertex, in the local coordinates of the mesh.
    #[cfg(feature = "gui")]
    pub(crate) fn starts(&self) -> &[(Vec3, Vec3)] {
        &self.starts
    }

    /// The visibility from each vertex, a byte for each of the shadowed lights: 255 where the light is visible, or
    /// where the surface faces away.
    pub(crate) fn visibility(&self, bvh: &Bvh, lights: &[Light]) -> Vec<u32> {
        let mut out = vec![u32::MAX; self.starts.len()];
        let sharp = lights.iter().filter(|light| light.is_sharp()).take(SHADOWED);
        for (slot, light) in sharp.enumerate() {
            out.par_chunks_mut(CHUNK).zip(self.starts.par_chunks(CHUNK)).for_each(|(out, starts)| {
                let rays: Vec<Ray> = starts.iter().map(|(start, _)| self.ray(*start, light)).collect();
                let mut occluded = vec![false; rays.len()];
                bvh.occluded_many(&rays, &vec![NO_TRIANGLE; rays.len()], &mut occluded);
                for (((out, occluded), ray), (_, normal)) in out.iter_mut().zip(occluded).zip(&rays).zip(starts) {
                    if occluded && ray.direction.dot(*normal) > 0.0 {
                        *out &= !(0xff << (8 * slot));
                    }
                }
            });
        }
        out
    }

    fn ray(&self, start: Vec3, light: &Light) -> Ray {
        match light {
            Light::Point { at_mm, .. } | Light::Spot { at_mm, .. } => {
                let offset = *at_mm - self.origin_mm - start.as_dvec3();
                let distance = offset.length() as f32;
                Ray { t_max: distance, ..Ray::new(start, offset.normalize_or_zero().as_vec3()) }
            }
            Light::Directional { from, .. } => Ray::new(start, from.as_vec3()),
            Light::Constant { .. } | Light::Area { .. } | Light::Environment { .. } => Ray::new(start, Vec3::ZERO),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::geometry::mesh::{Mesh, Placement};
    use crate::geometry::part_table::PartTable;
    use crate::geometry::shapes;

    #[test]
    fn a_convex_body_shadows_nothing_that_faces_the_light_and_a_lid_all_of_it() {
        let source = shapes::icosphere(10.0, 3);
        let vertices = source.positions.len();
        let scene = |source| {
            let (mesh, _) = Mesh::from_source(source, &Placement { mm_per_unit: 1.0 }).unwrap();
            let parts = PartTable::new(&mesh, vec![0; mesh.triangles.len()], vec![("ball".into(), Some(0))]);
            Scene { mesh, parts, media: Vec::new() }
        };
        let lights = [
            Light::constant(DVec3::ONE).unwrap(),
            Light::directional(DVec3::Y, DVec3::ONE).unwrap(),
            Light::point(DVec3::new(0.0, 15.0, 0.0), DVec3::ONE).unwrap(),
        ];
        let ball = scene(source.clone());
        let seen = Shadows::new(&ball).visibility(&Bvh::new(&ball.mesh), &lights);
        assert!(seen.iter().all(|v| *v == u32::MAX));
        // A roof above the ball, higher than the point light.
        let roof = shapes::plane(60.0, 60.0, 1);
        let covered = scene(shapes::compose(&[(source, DVec3::ZERO), (roof, DVec3::new(0.0, 20.0, 0.0))]));
        let seen = Shadows::new(&covered).visibility(&Bvh::new(&covered.mesh), &lights);
        let top = (0..vertices).max_by(|a, b| covered.mesh.local_mm[*a].y.total_cmp(&covered.mesh.local_mm[*b].y));
        assert_eq!(seen[top.unwrap()], 0xffff_ff00);
    }
}
