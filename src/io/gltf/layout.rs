//! Where the vertices of a model come from in its file.

use gltf::json::Root;

use super::accessor::Accessors;
use super::assemble::check_meshes;
use super::nodes::placements;
use super::warnings::Warnings;
use crate::error::Result;

/// One appearance of a mesh in the scene.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PlacedMesh {
    /// Index of the mesh.
    pub mesh: usize,
    /// The node that places it; none in a document without nodes.
    pub node: Option<usize>,
    /// How often this node places it (`EXT_mesh_gpu_instancing`).
    pub instances: usize,
    /// Whether its transform mirrors, so that triangles are read the other way round.
    pub mirrors: bool,
    /// Its primitives that have a surface.
    pub primitives: Vec<PlacedPrimitive>,
}

/// A primitive of a placed mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PlacedPrimitive {
    /// Index in its mesh.
    pub index: usize,
    /// First of its vertices in the model.
    pub first_vertex: usize,
    /// Number of its vertices, used or not.
    pub vertices: usize,
}

/// Every appearance of a mesh in the order of the model's vertices.
pub(super) fn placed(root: &Root, data: &Accessors<'_>) -> Result<Vec<PlacedMesh>> {
    let mut warnings = Warnings::default();
    let placements = placements(root, data, &mut warnings)?;
    let checked = check_meshes(root, data, &placements, &mut warnings)?;
    let mut next = 0;
    let mut result = Vec::with_capacity(placements.len());
    for placement in &placements {
        let primitives = checked.get(placement.mesh).into_iter().flatten().flatten().map(|primitive| {
            let first_vertex = next;
            next += primitive.vertices;
            PlacedPrimitive { index: primitive.index, first_vertex, vertices: primitive.vertices }
        });
        let primitives = primitives.collect();
        let mirrors = placement.to_scene.matrix3.determinant() < 0.0;
        let (mesh, node, instances) = (placement.mesh, placement.node, placement.instances);
        result.push(PlacedMesh { mesh, node, instances, mirrors, primitives });
    }
    Ok(result)
}
