//! The domain of transport: the bodies and the media inside them.

use crate::geometry::mesh::Mesh;
use crate::geometry::part_table::PartTable;
use crate::medium::material::Medium;

/// A borrowed mesh in mm with its parts and their media, independent of the sampling.
#[derive(Clone, Copy, Debug)]
pub struct Domain<'a> {
    /// Geometry.
    pub mesh: &'a Mesh,
    /// Assignment of triangles to bodies.
    pub parts: &'a PartTable,
    /// Media that parts refer to.
    pub media: &'a [Medium],
}

impl Domain<'_> {
    /// For each source vertex, a third of the area of the triangles around it in parts that light enters, mm^2.
    pub fn vertex_areas_mm2(&self) -> Vec<f64> {
        let mut areas = vec![0.0; self.mesh.local_mm.len()];
        for (triangle, vertices) in self.mesh.triangles.iter().enumerate() {
            if self.parts.transfers(triangle as u32) {
                let third = self.mesh.area_mm2(triangle as u32) / 3.0;
                vertices.iter().for_each(|v| areas[*v as usize] += third);
            }
        }
        areas
    }
}
