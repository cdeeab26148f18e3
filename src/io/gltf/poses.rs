//! Poses of a model: the shapes that it takes over an animation, skins and morph targets applied.

use std::path::Path;

use glam::DVec3;
use gltf::json::Root;

use super::accessor::Accessors;
use super::animation::{self, Animation};
use super::assemble::{assemble, check_meshes};
use super::buffers::Buffers;
use super::document::node_label;
use super::nodes::{Placement, UNSKINNED, tree};
use super::primitive::{CheckedPrimitive, UNMORPHED};
use super::skin::{Followed, Skin, morphs};
use super::warnings::Warnings;
use crate::error::{Error, Result};
use crate::geometry::source::SourceModel;

/// Largest number of vertices of all poses together.
const MAX_POSED: usize = 1 << 27;

/// Which poses of a file are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PoseSampling<'a> {
    /// Poses of an animation, evenly from its first key to its last.
    pub frames: usize,
    /// Name of the animation, or its number from 0; without it the first.
    pub animation: Option<&'a str>,
}

/// A pose: where the vertices of the model are.
#[derive(Clone, Debug, PartialEq)]
pub struct Pose {
    /// Time in the animation, s; none without one.
    pub seconds: Option<f64>,
    /// Every vertex, in the order and the unit of the model.
    pub positions: Vec<DVec3>,
}

/// A model and its poses.
#[derive(Clone, Debug, PartialEq)]
pub struct Animated {
    /// The model as [`super::read_gltf`] reads it, without skin and animation; its warnings are those of the poses.
    pub model: SourceModel,
    /// Name of the animation that was sampled.
    pub animation: Option<String>,
    /// Its poses.
    pub poses: Vec<Pose>,
}

/// Reads a glTF 2.0 file in metres, and the poses of its animation: step, linear and cubic keys of the transforms of nodes and of the
/// weights of morph targets, with skins as linear blends. Without an animation, or with one that lasts no time, there is one pose: that
/// of the nodes as they stand.
///
/// # Errors
/// As [`super::read_gltf`]; command line: no animation of that name; invalid input: keys, joints, weights or matrices that the
/// specification forbids; more vertices in all poses together than fit.
pub fn read_poses(path: &Path, sampling: PoseSampling<'_>) -> Result<Animated> {
    let bytes = std::fs::read(path).map_err(|e| Error::io(path, &e))?;
    of_bytes(&bytes, path, sampling).map_err(|e| e.in_file(path))
}

pub(super) fn of_bytes(bytes: &[u8], path: &Path, sampling: PoseSampling<'_>) -> Result<Animated> {
    let mut warnings = Warnings::default();
    let (container, root) = super::checked(bytes, path, &mut warnings)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let data = Accessors::new(&root, Buffers::new(&root, container.binary, folder));
    let stored = animation::chosen(&root, sampling.animation)?;
    let placements = tree(&root, &data, &|_| None, &mut warnings)?.placements;
    let meshes = {
        let checked = check_meshes(&root, &data, &placements, &mut Warnings::default())?;
        placements
            .iter()
            .map(|placement| Posed::read((&root, &data), placement, checked.get(placement.mesh), &mut warnings))
            .collect::<Result<Vec<_>>>()?
    };
    warnings.retract(UNSKINNED);
    let mut model = assemble(&root, &data, &placements, warnings)?;
    model.warnings.retain(|line| !line.ends_with(UNMORPHED));
    let targets = |node: usize| {
        let mesh = root.nodes.get(node).and_then(|node| root.meshes.get(node.mesh?.value()));
        mesh.map_or(0, |mesh| mesh.primitives.iter().map(|p| p.targets.as_ref().map_or(0, Vec::len)).max().unwrap_or(0))
    };
    let animation = match &stored {
        Some((_, stored)) => Some(Animation::read(&root, &data, stored, targets)?),
        None => None,
    };
    let [first, last] = animation.as_ref().map_or([0.0; 2], |animation| animation.range);
    let count = if last > first { sampling.frames.max(1) } else { 1 };
    if model.positions.len().saturating_mul(count) > MAX_POSED {
        let vertices = model.positions.len();
        return Err(Error::command_line(format!(
            "--frames {count}: poses of {vertices} vertices each are too many; {} would fit",
            MAX_POSED / vertices.max(1)
        )));
    }
    let mut poses = Vec::with_capacity(count);
    for frame in 0..count {
        let share = if count > 1 { frame as f64 / (count - 1) as f64 } else { 0.0 };
        let seconds = first + share * (last - first);
        let animated = animation.as_ref().map(|animation| animation.at(seconds)).transpose()?.unwrap_or_default();
        let nodes = tree(&root, &data, &|node| animated.local.get(&node).copied(), &mut Warnings::default())?;
        let mut positions = Vec::with_capacity(model.positions.len());
        for (posed, placement) in meshes.iter().zip(&nodes.placements) {
            let weights = placement.node.and_then(|node| animated.weights.get(&node));
            posed.place(placement, weights.map(Vec::as_slice), &nodes.to_scene, &mut positions)?;
        }
        poses.push(Pose { seconds: animation.as_ref().map(|_| seconds), positions });
    }
    Ok(Animated { model, animation: stored.map(|(name, _)| name), poses })
}

/// One placement of a mesh with what moves its vertices.
struct Posed {
    skin: Option<Skin>,
    /// Weights of the morph targets without an animation.
    weights: Vec<f64>,
    primitives: Vec<PosedPrimitive>,
}

struct PosedPrimitive {
    positions: Vec<[f32; 3]>,
    morphs: Vec<Option<Vec<[f32; 3]>>>,
    followed: Option<Followed>,
}

impl Posed {
    fn read(
        (root, data): (&Root, &Accessors<'_>),
        placement: &Placement,
        checked: Option<&Option<Vec<CheckedPrimitive<'_>>>>,
        warnings: &mut Warnings,
    ) -> Result<Self> {
        let node = placement.node.and_then(|index| Some((index, root.nodes.get(index)?)));
        let mesh = root.meshes.get(placement.mesh);
        let skin = match node.and_then(|(index, node)| Some((index, node, node.skin?))) {
            Some((index, node, _)) if placement.instances > 1 => {
                let message = "a skin and several instances of the mesh (EXT_mesh_gpu_instancing) exclude each other";
                return Err(Error::unsupported(message).at(node_label(index, node)));
            }
            Some((.., skin)) => Some(Skin::read(root, data, skin.value())?),
            None => None,
        };
        let mut primitives = Vec::new();
        for primitive in checked.into_iter().flatten().flatten() {
            let stored = mesh.and_then(|mesh| mesh.primitives.get(primitive.index));
            let stored = stored.ok_or_else(|| Error::input("a primitive does not exist"))?;
            let (of, vertices) = ((stored, primitive.place.as_str()), primitive.vertices);
            let followed = skin.as_ref().map(|skin| Followed::read(data, of, (vertices, skin.len()), warnings));
            primitives.push(PosedPrimitive {
                positions: primitive.positions(),
                morphs: morphs(data, of, vertices)?,
                followed: followed.transpose()?,
            });
        }
        let own = node.and_then(|(_, node)| node.weights.as_ref()).or(mesh.and_then(|mesh| mesh.weights.as_ref()));
        let weights = own.map_or_else(Vec::new, |own| own.iter().map(|w| f64::from(*w)).collect());
        Ok(Self { skin, weights, primitives })
    }

    /// Adds the vertices where they stand: with the joints of a skin, otherwise with the node.
    fn place(
        &self,
        placement: &Placement,
        weights: Option<&[f64]>,
        to_scene: &[Option<glam::DAffine3>],
        positions: &mut Vec<DVec3>,
    ) -> Result<()> {
        let matrices = self.skin.as_ref().map(|skin| skin.matrices(to_scene)).transpose()?;
        let weights = weights.unwrap_or(&self.weights);
        for primitive in &self.primitives {
            for (vertex, stored) in primitive.positions.iter().enumerate() {
                let mut at = DVec3::from_array(stored.map(f64::from));
                for (weight, moved) in weights.iter().zip(&primitive.morphs).filter(|(weight, _)| **weight != 0.0) {
                    if let Some(moved) = moved.as_ref().and_then(|moved| moved.get(vertex)) {
                        at += *weight * DVec3::from_array(moved.map(f64::from));
                    }
                }
                positions.push(match (&primitive.followed, &matrices) {
                    (Some(followed), Some(matrices)) => followed.place(vertex, at, matrices),
                    _ => placement.to_scene.transform_point3(at),
                });
            }
        }
        Ok(())
    }
}
