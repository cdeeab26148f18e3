//! The input of a bake: a mesh, its parts and the medium of each.

use std::f64::consts::TAU;

use glam::DVec3;

use crate::geometry::check::{WARNING_SHARE, long_edge_areas_mm2};
use crate::geometry::mesh::Mesh;
use crate::geometry::part_table::PartTable;
use crate::math::cube_map::{self, FACES};
use crate::medium::material::Medium;
use crate::transport::domain::Domain;

/// Cells of a face of the cube on which normals are counted.
const CELLS: usize = 8;

/// Height of grazing directions above the plane of the flat area, as a sine.
const GRAZING: f64 = 0.05;

/// A mesh in mm with its parts and media.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Geometry.
    pub mesh: Mesh,
    /// Grouping of the triangles into bodies.
    pub parts: PartTable,
    /// Media that parts refer to.
    pub media: Vec<Medium>,
}

impl Scene {
    /// The parts of the scene that transport uses.
    pub fn domain(&self) -> Domain<'_> {
        Domain { mesh: &self.mesh, parts: &self.parts, media: &self.media }
    }

    /// A third of the transferring area around each source vertex, mm^2.
    pub fn vertex_areas_mm2(&self) -> Vec<f64> {
        self.domain().vertex_areas_mm2()
    }

    /// Whether light may vary within triangles: a share of a translucent part is in triangles longer than a mean free path of its
    /// medium. On most models it does not vary much, which is to be measured.
    pub fn may_be_coarse(&self) -> bool {
        let Self { mesh, parts, media } = self;
        let free_path = |medium: u32| Some(media.get(medium as usize)?.properties.mean_free_path_mm().min_element());
        let resolved: Vec<Option<f64>> = parts.parts.iter().map(|part| part.medium.and_then(free_path)).collect();
        let long = long_edge_areas_mm2(mesh, &parts.triangle_part, &resolved);
        parts.parts.iter().zip(long).any(|(part, long)| long > WARNING_SHARE * part.area_mm2)
    }

    /// A direction that grazes the largest flat area of the translucent parts, 3 degrees above it, turned about its normal by a share of
    /// a full turn: what light from there does is the hardest to tell from samples of directions.
    pub fn grazing(&self, turn: f64) -> DVec3 {
        let flat = self.largest_flat_normal();
        let along = flat.any_orthonormal_vector();
        let (sin, cos) = f64::sin_cos(turn * TAU);
        (along * cos + flat.cross(along) * sin + GRAZING * flat).normalize()
    }

    /// Normal of the largest flat area of the translucent parts: the mean over the cell of directions that most area faces.
    fn largest_flat_normal(&self) -> DVec3 {
        let Self { mesh, parts, .. } = self;
        let mut sums = vec![DVec3::ZERO; FACES * CELLS * CELLS];
        for (triangle, &part) in parts.triangle_part.iter().enumerate().take(mesh.triangles.len()) {
            if parts.parts.get(part as usize).is_some_and(|part| part.transfers()) {
                let cross = mesh.cross_mm2(triangle as u32);
                if cross != DVec3::ZERO {
                    sums[cube_map::texel_of(CELLS, cross.normalize_or(DVec3::Y))] += cross;
                }
            }
        }
        let largest = sums.into_iter().max_by(|a, b| a.length_squared().total_cmp(&b.length_squared()));
        largest.unwrap_or_default().normalize_or(DVec3::Y)
    }
}
