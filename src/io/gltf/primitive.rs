//! Primitives: from accessors to triangles in the mesh's own coordinates.

use glam::{Vec2, Vec3};
use gltf::json::mesh::{Mode, Primitive, Semantic};
use gltf::json::validation::Checked;

use super::accessor::{Accessors, Elements, Role};
use super::extensions::{self, DRACO};
use super::warnings::Warnings;
use crate::error::{Error, Result};

/// Largest distance of a normal's length from 1 that rounding to 8 bits explains.
const NORMAL_TOLERANCE: f32 = 0.02;

/// What is said of primitives whose morph targets are not applied.
pub(super) const UNMORPHED: &str = "morph targets are not applied: the base shape is read";

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Topology {
    Triangles,
    Strip,
    Fan,
}

/// A primitive whose accessors are located and checked, and whose size is known before anything is allocated.
pub(super) struct CheckedPrimitive<'a> {
    positions: Elements<'a>,
    normals: Option<Elements<'a>>,
    uvs: Option<Elements<'a>>,
    indices: Option<Elements<'a>>,
    topology: Topology,
    corners: usize,
    /// Number of vertices, used or not.
    pub(super) vertices: usize,
    /// Index in its mesh.
    pub(super) index: usize,
    /// Index of the document's material.
    pub(super) material: Option<usize>,
    /// Place of the primitive, for messages.
    pub(super) place: String,
}

/// A primitive in its mesh's coordinates.
pub(super) struct Decoded {
    /// Positions as stored, finite or not.
    pub(super) positions: Vec<[f32; 3]>,
    /// Indices into `positions`, in range.
    pub(super) triangles: Vec<[u32; 3]>,
    /// Normals, of unit length or zero.
    pub(super) normals: Option<Vec<Vec3>>,
    /// Texture coordinates, v up, finite.
    pub(super) uvs: Option<Vec<Vec2>>,
}

impl<'a> CheckedPrimitive<'a> {
    /// Checks a primitive; `None` for one without surface (points, lines, no positions), which a warning names.
    pub(super) fn new(
        data: &'a Accessors<'_>,
        (index, place): (usize, String),
        primitive: &Primitive,
        warnings: &mut Warnings,
    ) -> Result<Option<Self>> {
        Self::check(data, (index, &place), primitive, warnings).map_err(|e| e.at(place))
    }

    fn check(
        data: &'a Accessors<'_>,
        (index, place): (usize, &str),
        primitive: &Primitive,
        warnings: &mut Warnings,
    ) -> Result<Option<Self>> {
        let topology = match primitive.mode {
            Checked::Valid(Mode::Triangles) => Topology::Triangles,
            Checked::Valid(Mode::TriangleStrip) => Topology::Strip,
            Checked::Valid(Mode::TriangleFan) => Topology::Fan,
            Checked::Valid(_) => {
                warnings.add_at(place, "points and lines are left out");
                return Ok(None);
            }
            Checked::Invalid => return Err(Error::input("its mode is not one of 0 to 6")),
        };
        let attribute = |semantic| primitive.attributes.get(&Checked::Valid(semantic)).map(|accessor| accessor.value());
        let Some(positions) = attribute(Semantic::Positions) else {
            warnings.add_at(place, "left out: it has no POSITION");
            return Ok(None);
        };
        let vertices = data.count(positions)?;
        for (semantic, accessor) in &primitive.attributes {
            let count = data.count(accessor.value())?;
            if count != vertices {
                let name = semantic.to_string();
                return Err(Error::input(format!("{name} has {count} elements, POSITION has {vertices}")));
            }
        }
        let compressed = primitive.extensions.as_ref().is_some_and(|extensions| extensions.others.contains_key(DRACO));
        if compressed && !data.has_data(positions) {
            return Err(extensions::refusal(DRACO));
        }
        if primitive.targets.as_ref().is_some_and(|targets| !targets.is_empty()) {
            warnings.add_at(place, UNMORPHED);
        }
        let indices = primitive.indices.map(|index| data.elements(index.value(), Role::Indices)).transpose()?;
        let corners = match primitive.indices {
            Some(index) => data.count(index.value())?,
            None => vertices,
        };
        let unused = if topology == Topology::Triangles { corners % 3 } else { 0 };
        if unused != 0 || (corners != 0 && corners < 3) {
            warnings.add_at(place, "its number of corners is not that of whole triangles: the last ones are left out");
        }
        let optional = |semantic, role| attribute(semantic).map(|accessor| data.elements(accessor, role)).transpose();
        let uvs = optional(Semantic::TexCoords(0), Role::TexCoord)?;
        if uvs.as_ref().is_some_and(Elements::is_unscaled_integer) {
            warnings
                .add_at(place, "texture coordinates are integers, and KHR_texture_transform is not applied to them");
        }
        Ok(Some(Self {
            positions: data.elements(positions, Role::Position)?,
            normals: optional(Semantic::Normals, Role::Normal)?,
            uvs,
            indices,
            topology,
            corners,
            vertices,
            index,
            material: primitive.material.map(|material| material.value()),
            place: place.to_owned(),
        }))
    }
}

impl CheckedPrimitive<'_> {
    /// Upper bound on the number of triangles; strips may have fewer, because their joints have no area and are
    /// dropped.
    pub(super) fn triangles_at_most(&self) -> usize {
        match self.topology {
            Topology::Triangles => self.corners / 3,
            Topology::Strip | Topology::Fan => self.corners.saturating_sub(2),
        }
    }

    /// Positions as stored, finite or not.
    pub(super) fn positions(&self) -> Vec<[f32; 3]> {
        self.positions.floats()
    }

    /// Returns whether the primitive stores normals.
    pub(super) fn has_normals(&self) -> bool {
        self.normals.is_some()
    }

    /// Returns whether the primitive stores texture coordinates.
    pub(super) fn has_uvs(&self) -> bool {
        self.uvs.is_some()
    }

    /// Converts everything and checks the indices.
    pub(super) fn decode(&self, warnings: &mut Warnings) -> Result<Decoded> {
        let indices = match &self.indices {
            Some(elements) => self.checked_indices(elements).map_err(|e| e.at(&self.place))?,
            None => (0..u32::try_from(self.vertices).unwrap_or(0)).collect(),
        };
        Ok(Decoded {
            positions: self.positions.floats(),
            triangles: triangles(self.topology, &indices),
            normals: self.normals.as_ref().map(|elements| self.unit_normals(elements, warnings)),
            uvs: self.uvs.as_ref().map(|elements| self.uvs_v_up(elements, warnings)),
        })
    }

    fn checked_indices(&self, elements: &Elements<'_>) -> Result<Vec<u32>> {
        let indices = elements.integers();
        let restart = elements.restart_value();
        // One pass for the maximum is the common case; the search is for the message.
        if indices.iter().max().is_none_or(|&max| (max as usize) < self.vertices && max != restart) {
            return Ok(indices);
        }
        let bad = indices.iter().position(|&index| index == restart || index as usize >= self.vertices);
        let at = bad.unwrap_or_default();
        let value = indices.get(at).copied().unwrap_or_default();
        let vertices = self.vertices;
        if value == restart {
            return Err(Error::input(format!(
                "index {at} is {value}, the primitive restart value, which glTF forbids"
            )));
        }
        Err(Error::input(format!("index {at} is {value}, and there are only {vertices} vertices")))
    }

    fn unit_normals(&self, elements: &Elements<'_>, warnings: &mut Warnings) -> Vec<Vec3> {
        let problem = "stored normals are not of unit length and are not used";
        self.usable(elements, (problem, warnings), |normal| {
            let normal = Vec3::from_array(normal);
            let length = normal.length();
            ((length - 1.0).abs() <= NORMAL_TOLERANCE).then(|| normal / length)
        })
    }

    fn uvs_v_up(&self, elements: &Elements<'_>, warnings: &mut Warnings) -> Vec<Vec2> {
        let problem = "texture coordinates are not finite and become 0";
        self.usable(elements, (problem, warnings), |[u, v]| Some(Vec2::new(u, 1.0 - v)).filter(|uv| uv.is_finite()))
    }

    /// Values of elements; 0 where there is none, which a warning tells.
    fn usable<T: Default, const N: usize>(
        &self,
        elements: &Elements<'_>,
        (problem, warnings): (&str, &mut Warnings),
        value: impl Fn([f32; N]) -> Option<T>,
    ) -> Vec<T> {
        let mut invalid = 0usize;
        let of = |stored| {
            value(stored).unwrap_or_else(|| {
                invalid += 1;
                T::default()
            })
        };
        let values = elements.floats::<N>().into_iter().map(of).collect();
        if invalid > 0 {
            warnings.add_items(&self.place, invalid, problem);
        }
        values
    }
}

fn triangles(topology: Topology, indices: &[u32]) -> Vec<[u32; 3]> {
    match topology {
        Topology::Triangles => indices.as_chunks::<3>().0.to_vec(),
        Topology::Strip => {
            // Joints between strips repeat an index: they are no part of the surface.
            let surface = |&(_, [a, b, c]): &(usize, [u32; 3])| a != b && b != c && a != c;
            let turned = |(i, [a, b, c]): (usize, [u32; 3])| if i % 2 == 0 { [a, b, c] } else { [a, c, b] };
            indices.array_windows::<3>().copied().enumerate().filter(surface).map(turned).collect()
        }
        Topology::Fan => match indices.split_first() {
            Some((&hub, rim)) => rim.array_windows::<2>().map(|&[a, b]| [a, b, hub]).collect(),
            None => Vec::new(),
        },
    }
}
