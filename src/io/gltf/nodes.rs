//! The node tree: placements of meshes, in f64.

use glam::{DAffine3, DMat3, DMat4, DQuat, DVec3, DVec4};
use gltf::json::scene::Node;
use gltf::json::{Index, Root};

use super::accessor::{Accessors, Role};
use super::document::node_label;
use super::extensions::INSTANCING;
use super::warnings::Warnings;
use crate::error::{Error, Result};

/// Largest number of placements of meshes by nodes and their instances together.
pub const MAX_INSTANCES: usize = 1 << 20;

/// Largest distance of a rotation's length from 1 that rounding explains.
const UNIT_TOLERANCE: f64 = 1e-3;

/// Largest deviation of a matrix's last row from 0 0 0 1 that rounding explains.
const AFFINE_TOLERANCE: f64 = 1e-6;

/// One appearance of a mesh in the scene.
pub(super) struct Placement {
    pub(super) mesh: usize,
    /// Transform from the mesh's own coordinates to the scene's; finite.
    pub(super) to_scene: DAffine3,
    /// The node that places the mesh; `None` in a document without nodes.
    pub(super) node: Option<usize>,
    /// How often the node places it.
    pub(super) instances: usize,
}

/// What is said of meshes whose skins are not applied.
pub(super) const UNSKINNED: &str = "the mesh is read as stored: its skin is not applied";

/// The nodes of the scene, each with its place.
pub(super) struct Tree {
    /// Every placement of a mesh, in the order of the model's vertices.
    pub(super) placements: Vec<Placement>,
    /// The transform of each node from its own coordinates to the scene's; none of nodes that the scene does not have.
    pub(super) to_scene: Vec<Option<DAffine3>>,
}

/// Every placement of the scene, in the order of the model's vertices.
pub(super) fn placements(root: &Root, data: &Accessors<'_>, warnings: &mut Warnings) -> Result<Vec<Placement>> {
    Ok(tree(root, data, &|_| None, warnings)?.placements)
}

/// The nodes of the scene; `animated` gives the local transforms of those that do not have their own.
pub(super) fn tree(
    root: &Root,
    data: &Accessors<'_>,
    animated: &dyn Fn(usize) -> Option<DAffine3>,
    warnings: &mut Warnings,
) -> Result<Tree> {
    let mut transforms = vec![None; root.nodes.len()];
    if root.nodes.is_empty() {
        if !root.meshes.is_empty() {
            warnings.add("the file has no nodes: every mesh is read once as it is");
        }
        let place = |mesh| Placement { mesh, to_scene: DAffine3::IDENTITY, node: None, instances: 1 };
        return Ok(Tree { placements: (0..root.meshes.len()).map(place).collect(), to_scene: transforms });
    }
    let mut pending: Vec<(usize, DAffine3)> =
        roots(root, warnings).into_iter().map(|n| (n, DAffine3::IDENTITY)).collect();
    pending.reverse();
    let mut visited = vec![false; root.nodes.len()];
    let mut placements = Vec::new();
    while let Some((index, parent_to_scene)) = pending.pop() {
        let (Some(node), Some(visited)) = (root.nodes.get(index), visited.get_mut(index)) else {
            return Err(Error::input(format!("node {index} does not exist")));
        };
        if std::mem::replace(visited, true) {
            let place = node_label(index, node);
            return Err(Error::input(format!("{place} is reached twice: nodes must form trees without cycles")));
        }
        let place = || node_label(index, node);
        let to_parent = match animated(index) {
            Some(transform) => transform,
            None => local_transform(node, place, warnings).map_err(|e| e.at(place()))?,
        };
        let to_scene = parent_to_scene * to_parent;
        check_finite(&to_scene).map_err(|e| e.at(place()))?;
        if let Some(slot) = transforms.get_mut(index) {
            *slot = Some(to_scene);
        }
        if let Some(mesh) = node.mesh {
            if node.skin.is_some() {
                warnings.add_at(&place(), UNSKINNED);
            }
            let instances = instances(node, data).map_err(|e| e.at(INSTANCING).at(place()))?;
            if placements.len() + instances.len() > MAX_INSTANCES {
                return Err(Error::input(format!("more than {MAX_INSTANCES} placements of meshes in the scene")));
            }
            let count = instances.len();
            for instance in instances {
                let to_scene = to_scene * instance;
                check_finite(&to_scene).map_err(|e| e.at(place()))?;
                placements.push(Placement { mesh: mesh.value(), to_scene, node: Some(index), instances: count });
            }
        }
        pending.extend(node.children.iter().flatten().rev().map(|child| (child.value(), to_scene)));
    }
    Ok(Tree { placements, to_scene: transforms })
}

/// The root nodes that are read.
fn roots(root: &Root, warnings: &mut Warnings) -> Vec<usize> {
    let chosen = root.scene.map_or(0, |scene| scene.value());
    if let Some(scene) = root.scenes.get(chosen) {
        if root.scenes.len() > 1 {
            warnings.add(format!("the file has {} scenes: only scene {chosen} is read", root.scenes.len()));
        }
        return scene.nodes.iter().map(Index::value).collect();
    }
    warnings.add("the file has no scene: all its root nodes are read");
    let mut is_root = vec![true; root.nodes.len()];
    for child in root.nodes.iter().flat_map(|node| node.children.iter().flatten()) {
        if let Some(flag) = is_root.get_mut(child.value()) {
            *flag = false;
        }
    }
    (0..root.nodes.len()).filter(|&node| is_root.get(node) == Some(&true)).collect()
}

fn local_transform(node: &Node, place: impl Fn() -> String, warnings: &mut Warnings) -> Result<DAffine3> {
    if let Some(matrix) = node.matrix {
        if node.translation.is_some() || node.rotation.is_some() || node.scale.is_some() {
            warnings.add_at(&place(), "has a matrix and other transforms beside it: the matrix is used");
        }
        let matrix = DMat4::from_cols_array(&matrix.map(f64::from));
        if !matrix.is_finite() {
            return Err(Error::input("its matrix is not finite"));
        }
        if !matrix.row(3).abs_diff_eq(DVec4::W, AFFINE_TOLERANCE) {
            return Err(Error::input("its matrix is not affine: the last row must be 0 0 0 1"));
        }
        return Ok(DAffine3::from_mat3_translation(DMat3::from_mat4(matrix), matrix.w_axis.truncate()));
    }
    let (parts, off) = Parts::of(node)?;
    if off > UNIT_TOLERANCE {
        warnings.add_at(&place(), "has a rotation that is not of unit length: it is normalised");
    }
    Ok(parts.together())
}

/// Translation, rotation and scale of a node without a matrix.
#[derive(Clone, Copy)]
pub(super) struct Parts {
    pub(super) translation: DVec3,
    /// Of unit length.
    pub(super) rotation: DQuat,
    pub(super) scale: DVec3,
}

impl Parts {
    /// Those that a node states, and the difference of the length of its rotation from 1.
    pub(super) fn of(node: &Node) -> Result<(Self, f64)> {
        let vector =
            |value: Option<[f32; 3]>, fallback| value.map_or(fallback, |v| DVec3::from_array(v.map(f64::from)));
        let rotation = node.rotation.map_or([0.0, 0.0, 0.0, 1.0], |rotation| rotation.0);
        let (rotation, off) = unit_rotation(rotation)?;
        let (translation, scale) = (vector(node.translation, DVec3::ZERO), vector(node.scale, DVec3::ONE));
        Ok((Self { translation, rotation, scale }, off))
    }

    /// The transform that they are together.
    pub(super) fn together(self) -> DAffine3 {
        DAffine3::from_scale_rotation_translation(self.scale, self.rotation, self.translation)
    }
}

/// The normalised rotation, and the difference of its length from 1.
fn unit_rotation(stored: [f32; 4]) -> Result<(DQuat, f64)> {
    let rotation = DQuat::from_array(stored.map(f64::from));
    let length = rotation.length();
    // f32 components cannot overflow or underflow the squares of this length in f64.
    if !length.is_finite() || length == 0.0 {
        return Err(Error::input("its rotation is zero or not finite"));
    }
    Ok((rotation / length, (length - 1.0).abs()))
}

fn check_finite(transform: &DAffine3) -> Result<()> {
    if transform.is_finite() { Ok(()) } else { Err(Error::input("its transform is not finite")) }
}

/// The instances of a node's mesh, relative to the node: one identity without the instancing extension.
fn instances(node: &Node, data: &Accessors<'_>) -> Result<Vec<DAffine3>> {
    let Some(extension) = node.extensions.as_ref().and_then(|extensions| extensions.others.get(INSTANCING)) else {
        return Ok(vec![DAffine3::IDENTITY]);
    };
    let attributes = extension
        .get("attributes")
        .and_then(|attributes| attributes.as_object())
        .ok_or_else(|| Error::input("it has no attributes"))?;
    let mut count = None;
    for (name, accessor) in attributes {
        let accessor = index_of(accessor).map_err(|e| e.at(name))?;
        let this = data.count(accessor).map_err(|e| e.at(name))?;
        if count.is_some_and(|count| count != this) {
            return Err(Error::input(format!("{name} has {this} elements, other attributes have another number")));
        }
        count = Some(this);
    }
    let count = count.ok_or_else(|| Error::input("it has no attributes"))?;
    if count > MAX_INSTANCES {
        return Err(Error::input(format!("{count} instances; at most {MAX_INSTANCES} are read")));
    }
    let vectors = |name, fallback: [f32; 3]| match attributes.get(name) {
        Some(accessor) => Ok(data.elements(index_of(accessor)?, Role::InstanceVector)?.floats::<3>()),
        None => Ok(vec![fallback; count]),
    };
    let translations = vectors("TRANSLATION", [0.0; 3])?;
    let scales = vectors("SCALE", [1.0; 3])?;
    let rotations = match attributes.get("ROTATION") {
        Some(accessor) => data.elements(index_of(accessor)?, Role::InstanceRotation)?.floats::<4>(),
        None => vec![[0.0, 0.0, 0.0, 1.0]; count],
    };
    let transform = |((translation, scale), rotation): (([f32; 3], [f32; 3]), [f32; 4])| {
        let [translation, scale] = [translation, scale].map(|v| DVec3::from_array(v.map(f64::from)));
        Ok(DAffine3::from_scale_rotation_translation(scale, unit_rotation(rotation)?.0, translation))
    };
    translations.into_iter().zip(scales).zip(rotations).map(transform).collect()
}

fn index_of(value: &serde_json::Value) -> Result<usize> {
    let index = value.as_u64().and_then(|index| usize::try_from(index).ok());
    index.ok_or_else(|| Error::input("an attribute does not name an accessor"))
}
