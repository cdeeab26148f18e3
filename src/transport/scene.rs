//! What is baked: a mesh, its parts and the medium of each, and the surface as the transport stages see it.

use crate::geometry::bvh::Bvh;
use crate::geometry::mesh::Mesh;
use crate::geometry::part_table::PartTable;
use crate::geometry::samples::{self, Patch, Samples};
use crate::medium::material::OpticalProperties;

/// A named medium.
#[derive(Clone, Debug, PartialEq)]
pub struct Medium {
    /// Name of the material it came from.
    pub name: String,
    /// Its optical properties.
    pub properties: OpticalProperties,
}

/// A mesh in mm with its parts and media.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Geometry.
    pub mesh: Mesh,
    /// Which triangles form one body.
    pub parts: PartTable,
    /// Media that parts refer to.
    pub media: Vec<Medium>,
}

impl Scene {
    /// A third of the transferring area around each source vertex, mm^2.
    pub fn vertex_areas_mm2(&self) -> Vec<f64> {
        let mut areas = vec![0.0; self.mesh.local_mm.len()];
        for (triangle, vertices) in self.mesh.triangles.iter().enumerate() {
            let part = self.parts.triangle_part.get(triangle).and_then(|p| self.parts.parts.get(*p as usize));
            if part.is_some_and(|p| p.transfers()) {
                let third = self.mesh.area_mm2(triangle as u32) / 3.0;
                vertices.iter().for_each(|v| areas[*v as usize] += third);
            }
        }
        areas
    }
}

/// A scene's surface ready for transport: occluders and samples with their geometry.
#[derive(Clone, Copy)]
pub struct Surface<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// Occluders: all triangles, whatever their part.
    pub bvh: &'a Bvh,
    /// The partition into patches.
    pub samples: &'a Samples,
    /// Geometry of each patch.
    pub patches: &'a [Patch],
}

/// Geometry of the patches of a scene.
pub fn patches(scene: &Scene, samples: &Samples) -> Vec<Patch> {
    samples::patches(&scene.mesh, samples)
}
