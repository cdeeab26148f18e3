//! A model as its file states it: the plain data that importers return and generated shapes build.

use glam::{DVec3, Vec2, Vec3};

use crate::medium::volume::Inside;

/// Values stored once and referred to by each corner of each triangle.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CornerAttribute<T> {
    /// Distinct values in the order of the source.
    pub values: Vec<T>,
    /// For each triangle, the index of the value at each of its corners.
    pub corners: Vec<[u32; 3]>,
}

/// A model in the units and the vertex order of its source, polygons already cut into triangles.
///
/// Importers guarantee: every index is in range, every position that a triangle uses is finite,
/// `triangle_material` (and the corners of every attribute) are as long as `triangles`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SourceModel {
    /// Vertex positions in source units, in source order. A vertex that no triangle uses may be anything.
    pub positions: Vec<DVec3>,
    /// Corner indices into `positions`, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// For each triangle, an index into `materials`.
    pub triangle_material: Vec<u32>,
    /// Names of the source's materials; faces without one use an entry named `default`.
    pub materials: Vec<String>,
    /// What the file says of the inside of each material; materials beyond the end have a surface only.
    pub insides: Vec<Inside>,
    /// Shading normals (unit length where valid, zero where the source has none).
    pub normals: Option<CornerAttribute<Vec3>>,
    /// Texture coordinates, v up.
    pub uvs: Option<CornerAttribute<Vec2>>,
    /// Metres in one source unit, where the format defines it (glTF: 1).
    pub metres_per_unit: Option<f64>,
    /// Warnings to the user about repairs and omissions, one line each.
    pub warnings: Vec<String>,
}

impl SourceModel {
    /// A model of one material named `default`, without shading normals, texture coordinates or a unit.
    pub fn new(positions: Vec<DVec3>, triangles: Vec<[u32; 3]>) -> Self {
        Self {
            triangle_material: vec![0; triangles.len()],
            positions,
            triangles,
            materials: vec!["default".to_owned()],
            ..Self::default()
        }
    }

    /// The model with one material of this name.
    #[must_use]
    pub fn of_material(self, name: &str) -> Self {
        Self { materials: vec![name.to_owned()], ..self }
    }
}
