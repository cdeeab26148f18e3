//! The JSON document: parsing, and the check of its references.

use gltf::json::{Accessor, Index, Mesh, Node, Root};

use super::container::unsupported_version;
use crate::error::{Error, Result};

/// Parses the JSON of a glTF 2.x document. References are not checked yet.
pub(super) fn parse(json: &[u8]) -> Result<Root> {
    let root: Root = gltf::json::deserialize::from_slice(json).map_err(|e| {
        // Version 1 stores maps where version 2 has arrays: its type errors would mislead.
        let version = serde_json::from_slice::<serde_json::Value>(json)
            .ok()
            .and_then(|value| Some(value.get("asset")?.get("version")?.as_str()?.to_owned()));
        match version {
            Some(version) if !version.starts_with("2.") => unsupported_version(&format!("glTF version {version:?}")),
            _ => Error::input(format!("not a valid glTF document: {e}")),
        }
    })?;
    if !root.asset.version.starts_with("2.") {
        return Err(unsupported_version(&format!("glTF version {:?}", root.asset.version)));
    }
    match root.asset.min_version.as_deref() {
        None | Some("2.0") => Ok(root),
        Some(version) => Err(unsupported_version(&format!("the file needs glTF version {version:?}"))),
    }
}

/// Checks every index of the document that reading geometry may follow, and that no node has two parents.
pub(super) fn check_references(root: &Root) -> Result<()> {
    for (i, view) in root.buffer_views.iter().enumerate() {
        check(view.buffer, root.buffers.len(), "buffer", || format!("bufferView {i}"))?;
    }
    for (i, accessor) in root.accessors.iter().enumerate() {
        check_accessor(root, i, accessor)?;
    }
    for (i, mesh) in root.meshes.iter().enumerate() {
        check_mesh(root, i, mesh)?;
    }
    if let Some(scene) = root.scene {
        check(scene, root.scenes.len(), "scene", || "the document".to_owned())?;
    }
    for (i, scene) in root.scenes.iter().enumerate() {
        for &node in &scene.nodes {
            check(node, root.nodes.len(), "node", || format!("scene {i}"))?;
        }
    }
    check_nodes(root)
}

fn check_accessor(root: &Root, i: usize, accessor: &Accessor) -> Result<()> {
    let sparse = accessor.sparse.as_ref();
    let views = [accessor.buffer_view, sparse.map(|s| s.indices.buffer_view), sparse.map(|s| s.values.buffer_view)];
    for view in views.into_iter().flatten() {
        check(view, root.buffer_views.len(), "bufferView", || format!("accessor {i}"))?;
    }
    Ok(())
}

fn check_mesh(root: &Root, i: usize, mesh: &Mesh) -> Result<()> {
    for (p, primitive) in mesh.primitives.iter().enumerate() {
        let place = || format!("{}, primitive {p}", mesh_label(i, mesh));
        for &accessor in primitive.attributes.values().chain(&primitive.indices) {
            check(accessor, root.accessors.len(), "accessor", place)?;
        }
        if let Some(material) = primitive.material {
            check(material, root.materials.len(), "material", place)?;
        }
    }
    Ok(())
}

fn check_nodes(root: &Root) -> Result<()> {
    let mut parent_of: Vec<Option<usize>> = vec![None; root.nodes.len()];
    for (i, node) in root.nodes.iter().enumerate() {
        let place = || node_label(i, node);
        if let Some(mesh) = node.mesh {
            check(mesh, root.meshes.len(), "mesh", place)?;
        }
        for &child in node.children.iter().flatten() {
            check(child, root.nodes.len(), "node", place)?;
            if let Some(other) = parent_of.get(child.value()).copied().flatten() {
                let child = child.value();
                return Err(Error::input(format!("node {child} is a child of node {other} and again of node {i}")));
            }
            if let Some(parent) = parent_of.get_mut(child.value()) {
                *parent = Some(i);
            }
        }
    }
    Ok(())
}

fn check<T>(index: Index<T>, count: usize, kind: &str, place: impl Fn() -> String) -> Result<()> {
    if index.value() < count {
        return Ok(());
    }
    let index = index.value();
    Err(Error::input(format!("{} names {kind} {index}, which does not exist (the file has {count})", place())))
}

/// Name of a material, made up where it has none.
pub(super) fn material_name(index: usize, name: Option<&str>) -> String {
    match name {
        None | Some("") => format!("material_{index}"),
        Some(name) => name.to_owned(),
    }
}

/// Name of a mesh for messages, as `mesh 3 "body"`.
pub(super) fn mesh_label(index: usize, mesh: &Mesh) -> String {
    label("mesh", index, mesh.name.as_deref())
}

/// Name of a node for messages, as `node 3 "body"`.
pub(super) fn node_label(index: usize, node: &Node) -> String {
    label("node", index, node.name.as_deref())
}

fn label(kind: &str, index: usize, name: Option<&str>) -> String {
    match name {
        Some(name) if !name.is_empty() => format!("{kind} {index} {name:?}"),
        _ => format!("{kind} {index}"),
    }
}
