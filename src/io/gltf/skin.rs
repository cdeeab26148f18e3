//! Linear-blend skinning and morph targets.

use glam::{DAffine3, DMat3, DMat4, DVec3, DVec4};
use gltf::json::Root;
use gltf::json::mesh::{Primitive, Semantic};
use gltf::json::validation::Checked;

use super::accessor::{Accessors, Role};
use super::warnings::Warnings;
use crate::error::{Error, Result};

/// Largest deviation of an inverse bind matrix's last row from 0 0 0 1 that rounding explains.
const AFFINE_TOLERANCE: f64 = 1e-4;

/// Sets of four joints of a vertex at most.
const MOST_SETS: u32 = 8;

/// Joints of a skin and what takes the mesh into the coordinates of each.
pub(super) struct Skin {
    joints: Vec<usize>,
    inverse_bind: Vec<DAffine3>,
}

impl Skin {
    pub(super) fn read(root: &Root, data: &Accessors<'_>, index: usize) -> Result<Self> {
        Self::checked(root, data, index).map_err(|e| e.at(format_args!("skin {index}")))
    }

    fn checked(root: &Root, data: &Accessors<'_>, index: usize) -> Result<Self> {
        let skin = root.skins.get(index).ok_or_else(|| Error::input("it does not exist"))?;
        let joints: Vec<usize> = skin.joints.iter().map(|joint| joint.value()).collect();
        if let Some(joint) = joints.iter().find(|joint| **joint >= root.nodes.len()) {
            return Err(Error::input(format!("its joint, node {joint}, does not exist")));
        }
        let inverse_bind = match skin.inverse_bind_matrices {
            None => vec![DAffine3::IDENTITY; joints.len()],
            Some(accessor) => {
                let matrices = data.elements(accessor.value(), Role::InverseBind)?.floats::<16>();
                matrices.into_iter().map(affine).collect::<Result<Vec<_>>>()?
            }
        };
        if joints.is_empty() || inverse_bind.len() < joints.len() {
            let (matrices, joints) = (inverse_bind.len(), joints.len());
            return Err(Error::input(format!("{matrices} inverse bind matrices for {joints} joints")));
        }
        Ok(Self { joints, inverse_bind })
    }

    /// What takes the mesh from its bind pose to the scene with each joint, where the nodes are; `to_scene` as in
    /// [`super::nodes::Tree`].
    pub(super) fn matrices(&self, to_scene: &[Option<DAffine3>]) -> Result<Vec<DAffine3>> {
        let of = |(joint, inverse): (&usize, &DAffine3)| {
            let there = to_scene.get(*joint).copied().flatten();
            let there = there.ok_or_else(|| Error::input(format!("the joint, node {joint}, is not in the scene")))?;
            let matrix = there * *inverse;
            if matrix.is_finite() {
                Ok(matrix)
            } else {
                Err(Error::input(format!("the joint, node {joint}, is not finite")))
            }
        };
        self.joints.iter().zip(&self.inverse_bind).map(of).collect()
    }

    /// Number of joints.
    pub(super) fn len(&self) -> usize {
        self.joints.len()
    }
}

fn affine(matrix: [f32; 16]) -> Result<DAffine3> {
    let matrix = DMat4::from_cols_array(&matrix.map(f64::from));
    if !(matrix.is_finite() && matrix.row(3).abs_diff_eq(DVec4::W, AFFINE_TOLERANCE)) {
        return Err(Error::input("an inverse bind matrix is not affine, or not finite"));
    }
    Ok(DAffine3::from_mat3_translation(DMat3::from_mat4(matrix), matrix.w_axis.truncate()))
}

/// Which joints the vertices of a primitive follow.
pub(super) struct Followed {
    /// Ends of the runs of `joints`, one for each vertex.
    ends: Vec<u32>,
    /// Joint of the skin, and its share; shares of a vertex add up to 1.
    joints: Vec<(u32, f64)>,
}

impl Followed {
    /// Reads the joints and weights of a primitive of so many vertices, for a skin of so many joints.
    pub(super) fn read(
        data: &Accessors<'_>,
        (primitive, place): (&Primitive, &str),
        (vertices, joints): (usize, usize),
        warnings: &mut Warnings,
    ) -> Result<Self> {
        Self::checked(data, (primitive, place), (vertices, joints), warnings).map_err(|e| e.at(place))
    }

    fn checked(
        data: &Accessors<'_>,
        (primitive, place): (&Primitive, &str),
        (vertices, joints): (usize, usize),
        warnings: &mut Warnings,
    ) -> Result<Self> {
        let attribute = |semantic: Semantic| primitive.attributes.get(&Checked::Valid(semantic)).map(|a| a.value());
        let mut sets = Vec::new();
        for set in 0..MOST_SETS {
            let (of_joints, of_weights) = (attribute(Semantic::Joints(set)), attribute(Semantic::Weights(set)));
            match (of_joints, of_weights) {
                (Some(joints), Some(weights)) => {
                    let joints = data.elements(joints, Role::Joints)?.floats::<4>();
                    let weights = data.elements(weights, Role::JointWeights)?.floats::<4>();
                    sets.push((joints, weights));
                }
                (None, None) => break,
                _ => return Err(Error::input(format!("it has one of JOINTS_{set} and WEIGHTS_{set} alone"))),
            }
        }
        if sets.is_empty() {
            return Err(Error::input("its mesh has a skin, and it has neither JOINTS_0 nor WEIGHTS_0"));
        }
        let mut result = Self { ends: Vec::with_capacity(vertices), joints: Vec::new() };
        let (mut without, mut off) = (0, 0);
        for vertex in 0..vertices {
            let first = result.joints.len();
            for (of_joints, of_weights) in &sets {
                let (Some(of_joints), Some(of_weights)) = (of_joints.get(vertex), of_weights.get(vertex)) else {
                    return Err(Error::input("its joints or weights are fewer than its vertices"));
                };
                for (joint, weight) in of_joints.iter().zip(of_weights).filter(|(_, weight)| **weight != 0.0) {
                    if !(weight.is_finite() && *weight > 0.0) {
                        return Err(Error::input(format!("vertex {vertex} has the weight {weight}")));
                    }
                    if *joint as usize >= joints {
                        let last = joints.saturating_sub(1);
                        return Err(Error::input(format!(
                            "vertex {vertex} follows joint {joint}, and the skin has the joints 0 to {last}"
                        )));
                    }
                    result.joints.push((*joint as u32, f64::from(*weight)));
                }
            }
            let own = &mut result.joints[first..];
            let sum: f64 = own.iter().map(|(_, weight)| weight).sum();
            if own.is_empty() {
                without += 1;
                result.joints.push((0, 1.0));
            } else {
                off += usize::from((sum - 1.0).abs() > 0.01);
                own.iter_mut().for_each(|(_, weight)| *weight /= sum);
            }
            result.ends.push(result.joints.len() as u32);
        }
        if without > 0 {
            warnings.add_items(place, without, "vertices have no weights: they follow the first joint of the skin");
        }
        if off > 0 {
            warnings.add_items(place, off, "vertices have weights that do not add up to 1: they are brought to it");
        }
        Ok(result)
    }

    /// A vertex where it stands with the joints' matrices.
    pub(super) fn place(&self, vertex: usize, at: DVec3, matrices: &[DAffine3]) -> DVec3 {
        let end = |vertex: usize| self.ends.get(vertex).map_or(0, |end| *end as usize);
        let run = if vertex == 0 { 0..end(0) } else { end(vertex - 1)..end(vertex) };
        let followed = self.joints.get(run).unwrap_or_default().iter();
        followed.filter_map(|(joint, weight)| Some(*weight * matrices.get(*joint as usize)?.transform_point3(at))).sum()
    }
}

/// Displacements of the vertices of a primitive by each of its morph targets; none for targets that leave positions alone.
pub(super) fn morphs(
    data: &Accessors<'_>,
    (primitive, place): (&Primitive, &str),
    vertices: usize,
) -> Result<Vec<Option<Vec<[f32; 3]>>>> {
    let of = |target: &gltf::json::mesh::MorphTarget| {
        let Some(accessor) = target.positions else { return Ok(None) };
        let moved = data.elements(accessor.value(), Role::Position).map_err(|e| e.at(place))?.floats::<3>();
        if moved.len() == vertices {
            return Ok(Some(moved));
        }
        Err(Error::input(format!("a morph target moves {} of {vertices} vertices", moved.len())).at(place))
    };
    primitive.targets.iter().flatten().map(of).collect()
}
