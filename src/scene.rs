//! The input of a bake: a mesh, its parts and the medium of each.

use crate::geometry::mesh::Mesh;
use crate::geometry::part_table::PartTable;
use crate::medium::material::Medium;
use crate::transport::domain::Domain;

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
}
