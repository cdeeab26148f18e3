//! The triangle mesh as plain arrays.

use std::borrow::Cow;

use crate::checks::{addressable, bounded, finite_f32, indices_below, invalid, same_length, text};
use crate::error::{FormatError, Result};
use crate::reader::Reader;
use crate::types::{Codec, Element, Kind, Tag};
use crate::writer::Writer;

/// Tags of the mesh.
pub mod tags {
    use crate::types::Tag;

    /// World position of the local origin, f64 x 3, one row.
    pub const ORIGIN: Tag = Tag::from_static("mesh.org");
    /// Vertex positions, f32 x 3.
    pub const POSITIONS: Tag = Tag::from_static("mesh.pos");
    /// Triangles, u32 x 3.
    pub const TRIANGLES: Tag = Tag::from_static("mesh.tri");
    /// Values of the shading normals, f32 x 3.
    pub const NORMALS: Tag = Tag::from_static("mesh.nrm");
    /// Corners of the shading normals, u32 x 3.
    pub const NORMAL_CORNERS: Tag = Tag::from_static("mesh.nri");
    /// Values of the texture coordinates, f32 x 2.
    pub const UVS: Tag = Tag::from_static("mesh.uv");
    /// Corners of the texture coordinates, u32 x 3.
    pub const UV_CORNERS: Tag = Tag::from_static("mesh.uvi");
    /// Material of each triangle, u32.
    pub const TRIANGLE_MATERIAL: Tag = Tag::from_static("mesh.mat");
    /// Names of the materials, a record.
    pub const MATERIALS: Tag = Tag::from_static("mesh.mtn");
    /// `i - weld[i]` of each vertex, u32.
    pub const WELD: Tag = Tag::from_static("mesh.wld");
}

/// Largest coordinate of the local origin, mm: beyond it double precision no longer tells places on a body apart.
pub const MOST_ORIGIN_MM: f64 = 1e12;

/// Largest coordinate of a triangle's corner relative to the local origin, mm: beyond it squared distances leave single precision.
pub const MOST_LOCAL_MM: f32 = 1e9;

/// Values stored once, with the index of a value for each corner of each triangle.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CornerAttribute<const N: usize> {
    /// Distinct values, finite.
    pub values: Vec<[f32; N]>,
    /// Indices into `values`, as long as the mesh's triangles.
    pub corners: Vec<[u32; 3]>,
}

/// A triangle mesh in mm, vertices in the order of the source.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// World position of the local origin, in mm.
    pub origin_mm: [f64; 3],
    /// Vertex positions relative to `origin_mm`, in mm.
    pub positions_mm: Vec<[f32; 3]>,
    /// Corner indices into `positions_mm`, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// For each triangle, an index into `materials`.
    pub triangle_material: Vec<u32>,
    /// Names of the source's materials.
    pub materials: Vec<String>,
    /// For each vertex, the first vertex at the same place: `weld[i] <= i` and `weld[weld[i]] == weld[i]`.
    pub weld: Vec<u32>,
    /// Shading normals, zero where the source has none.
    pub normals: Option<CornerAttribute<3>>,
    /// Texture coordinates, v up.
    pub uvs: Option<CornerAttribute<2>>,
}

impl Mesh {
    /// Checks everything that [`Mesh::decode`] guarantees: finite numbers, indices in range, consistent lengths.
    ///
    /// # Errors
    /// [`FormatError::Invalid`] with the tag of the section at fault.
    pub fn validate(&self) -> Result<()> {
        let (vertices, triangles) = (self.positions_mm.len(), self.triangles.len());
        bounded(tags::ORIGIN, "the origin", &self.origin_mm, MOST_ORIGIN_MM)?;
        addressable(tags::POSITIONS, vertices)?;
        finite_f32(tags::POSITIONS, &self.positions_mm)?;
        addressable(tags::TRIANGLES, triangles)?;
        indices_below(tags::TRIANGLES, self.triangles.iter().flatten().copied(), vertices)?;
        let far = |v: &&u32| self.positions_mm[**v as usize].iter().any(|x| x.abs() > MOST_LOCAL_MM);
        if let Some(v) = self.triangles.iter().flatten().find(far) {
            return invalid(
                tags::POSITIONS,
                format!("vertex {v} of a triangle is more than {MOST_LOCAL_MM:e} mm away"),
            );
        }
        same_length(tags::TRIANGLE_MATERIAL, "triangles", self.triangle_material.len(), triangles)?;
        indices_below(tags::TRIANGLE_MATERIAL, self.triangle_material.iter().copied(), self.materials.len())?;
        self.materials.iter().try_for_each(|name| text(tags::MATERIALS, "the name of a material", name))?;
        self.validate_weld()?;
        if let Some(normals) = &self.normals {
            validate_attribute(normals, triangles, tags::NORMALS, tags::NORMAL_CORNERS)?;
        }
        if let Some(uvs) = &self.uvs {
            validate_attribute(uvs, triangles, tags::UVS, tags::UV_CORNERS)?;
        }
        Ok(())
    }

    fn validate_weld(&self) -> Result<()> {
        same_length(tags::WELD, "vertices", self.weld.len(), self.positions_mm.len())?;
        for (i, &first) in self.weld.iter().enumerate() {
            if first as usize > i || self.weld[first as usize] != first {
                return invalid(
                    tags::WELD,
                    format!("vertex {i} is welded to {first}, which is not the first of its place"),
                );
            }
        }
        Ok(())
    }

    /// Adds the sections of a valid mesh.
    ///
    /// # Errors
    /// The mesh is not valid, or the writer already has one of its sections.
    pub fn encode<'a>(&'a self, writer: &mut Writer<'a>) -> Result<()> {
        self.validate()?;
        let zstd = Codec::Zstd;
        writer
            .add(tags::ORIGIN, Kind::Mesh, Codec::Raw, std::slice::from_ref(&self.origin_mm))?
            .add(tags::POSITIONS, Kind::Mesh, zstd, &self.positions_mm)?
            .add(tags::TRIANGLES, Kind::Mesh, zstd, &self.triangles)?;
        if let Some(normals) = &self.normals {
            writer.add(tags::NORMALS, Kind::Mesh, zstd, &normals.values)?.add(
                tags::NORMAL_CORNERS,
                Kind::Mesh,
                zstd,
                &normals.corners,
            )?;
        }
        if let Some(uvs) = &self.uvs {
            writer.add(tags::UVS, Kind::Mesh, zstd, &uvs.values)?.add(
                tags::UV_CORNERS,
                Kind::Mesh,
                zstd,
                &uvs.corners,
            )?;
        }
        // Stored as a difference, mostly zero, because zstd cannot shorten an ascending sequence.
        let backward: Vec<u32> = (0..).zip(&self.weld).map(|(i, first): (u32, _)| i - first).collect();
        writer
            .add(tags::TRIANGLE_MATERIAL, Kind::Metadata, zstd, &self.triangle_material)?
            .add_record(tags::MATERIALS, Kind::Metadata, zstd, &self.materials)?
            .add_bytes(
                tags::WELD,
                Kind::Metadata,
                (u32::TYPE, 1),
                zstd,
                Cow::Owned(bytemuck::cast_slice(&backward).to_vec()),
            )?;
        Ok(())
    }

    /// Reads the mesh and validates it.
    ///
    /// # Errors
    /// A section is missing, damaged, of another type, or its content is not valid.
    pub fn decode(reader: &Reader<'_>) -> Result<Self> {
        let origin: Vec<[f64; 3]> = reader.array_of(tags::ORIGIN, Kind::Mesh)?;
        let &[origin_mm] = origin.as_slice() else {
            return invalid(tags::ORIGIN, format!("{} rows, not 1", origin.len()));
        };
        let mut weld: Vec<u32> = reader.array_of(tags::WELD, Kind::Metadata)?;
        addressable(tags::WELD, weld.len())?;
        for (i, backward) in (0u32..).zip(&mut weld) {
            let Some(first) = i.checked_sub(*backward) else {
                return invalid(tags::WELD, format!("vertex {i} is welded {backward} vertices back"));
            };
            *backward = first;
        }
        let mesh = Self {
            origin_mm,
            positions_mm: reader.array_of(tags::POSITIONS, Kind::Mesh)?,
            triangles: reader.array_of(tags::TRIANGLES, Kind::Mesh)?,
            triangle_material: reader.array_of(tags::TRIANGLE_MATERIAL, Kind::Metadata)?,
            materials: reader.record_of(tags::MATERIALS, Kind::Metadata)?,
            weld,
            normals: decode_attribute(reader, tags::NORMALS, tags::NORMAL_CORNERS)?,
            uvs: decode_attribute(reader, tags::UVS, tags::UV_CORNERS)?,
        };
        mesh.validate()?;
        Ok(mesh)
    }
}

fn validate_attribute<const N: usize>(
    attribute: &CornerAttribute<N>,
    triangles: usize,
    values: Tag,
    corners: Tag,
) -> Result<()> {
    finite_f32(values, &attribute.values)?;
    same_length(corners, "triangles", attribute.corners.len(), triangles)?;
    indices_below(corners, attribute.corners.iter().flatten().copied(), attribute.values.len())
}

/// Reads an attribute; both of its sections exist or neither does.
fn decode_attribute<const N: usize>(
    reader: &Reader<'_>,
    values: Tag,
    corners: Tag,
) -> Result<Option<CornerAttribute<N>>>
where
    [f32; N]: Element,
{
    match (reader.find(values), reader.find(corners)) {
        (None, None) => Ok(None),
        (Some(_), Some(_)) => Ok(Some(CornerAttribute {
            values: reader.array_of(values, Kind::Mesh)?,
            corners: reader.array_of(corners, Kind::Mesh)?,
        })),
        (None, Some(_)) => Err(FormatError::MissingSection { tag: values }),
        (Some(_), None) => Err(FormatError::MissingSection { tag: corners }),
    }
}
