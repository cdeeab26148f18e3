//! The surface on which growth is measured: one smooth closed shape with any number of vertices, and its file.

use crate::error::{Error, Result};
use crate::geometry::mesh::{Mesh, Scale, resolve_scale};
use crate::geometry::part_table::PartTable;
use crate::geometry::parts::{Analysis, MaterialRoles, PartsRule};
use crate::geometry::shapes::torus_knot;
use crate::geometry::source::SourceModel;
use crate::medium::material::{Material, Medium};
use crate::scene::Scene;

/// The surface in words.
pub const DESCRIPTION: &str =
    "a trefoil knot of round cross section, closed, its strands 0.12 of the diagonal thick and in each other's shadow";

/// Length of the knot over the circumference of its tube: triangles are then about as long as wide.
const ASPECT: f64 = 9.3;

/// The trefoil knot with about this many vertices, always on the same smooth surface; at least 16.
pub fn surface(vertices: usize) -> SourceModel {
    let around = (vertices as f64 / ASPECT).sqrt().round().clamp(4.0, 1e4);
    let along = (vertices as f64 / around).round().clamp(4.0, 1e6);
    torus_knot(2, 3, 10.0, 4.0, 2.5, along as u32, around as u32)
}

/// The scene of a bake of the model, for estimates.
///
/// # Errors
/// A size or a model that cannot be used.
pub fn scene(model: &SourceModel, size_mm: f64, material: &Material) -> Result<Scene> {
    let placement = resolve_scale(model, Some(Scale::DiagonalMm(size_mm)))?;
    let (mut mesh, mut repairs) = Mesh::from_source(model.clone(), &placement)?;
    let roles = MaterialRoles::single(model.materials.len());
    let analysis = Analysis::new(&mut mesh, &roles, PartsRule::Auto, &mut repairs);
    let parts = PartTable::of(&mesh, &analysis.parts);
    let medium = Medium { name: material.name.clone(), properties: material.properties };
    Ok(Scene { mesh, parts, media: vec![medium] })
}

/// A model as binary glTF: positions in 32 bits, triangles, nothing else; a unit of the model is a metre, as glTF has
/// it.
///
/// # Errors
/// More than the 4 GiB that the format holds.
pub fn glb(model: &SourceModel) -> Result<Vec<u8>> {
    let positions: Vec<[f32; 3]> = model.positions.iter().map(|p| p.as_vec3().to_array()).collect();
    let bounds = |pick: fn(f32, f32) -> f32, start: f32| {
        positions.iter().fold([start; 3], |m, p| std::array::from_fn(|k| pick(m[k], p[k])))
    };
    let (low, high) = (bounds(f32::min, f32::INFINITY), bounds(f32::max, f32::NEG_INFINITY));
    let (first, second) = (12 * positions.len(), 12 * model.triangles.len());
    let json = serde_json::json!({
        "asset": { "version": "2.0", "generator": concat!("translux ", env!("CARGO_PKG_VERSION")) },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1 }] }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": positions.len(), "type": "VEC3", "min": low, "max": high },
            { "bufferView": 1, "componentType": 5125, "count": 3 * model.triangles.len(), "type": "SCALAR" },
        ],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 0, "byteLength": first, "target": 34962 },
            { "buffer": 0, "byteOffset": first, "byteLength": second, "target": 34963 },
        ],
        "buffers": [{ "byteLength": first + second }],
    });
    let mut text = json.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let total = 12 + 8 + text.len() + 8 + first + second;
    let word = |v: usize| u32::try_from(v).map(u32::to_le_bytes).map_err(|_| Error::runtime("a model beyond 4 GiB"));
    let mut bytes = Vec::with_capacity(total);
    bytes.extend_from_slice(b"glTF");
    bytes.extend_from_slice(&word(2)?);
    bytes.extend_from_slice(&word(total)?);
    bytes.extend_from_slice(&word(text.len())?);
    bytes.extend_from_slice(b"JSON");
    bytes.extend_from_slice(&text);
    bytes.extend_from_slice(&word(first + second)?);
    bytes.extend_from_slice(b"BIN\0");
    bytes.extend(positions.iter().flatten().flat_map(|v| v.to_le_bytes()));
    bytes.extend(model.triangles.iter().flatten().flat_map(|v| v.to_le_bytes()));
    Ok(bytes)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::io::gltf::read_gltf;

    #[test]
    fn sizes_are_nearly_those_asked_for_and_the_shape_stays() {
        let volume = |m: &SourceModel| {
            let corner = |v: u32| m.positions[v as usize];
            m.triangles.iter().map(|t| corner(t[0]).dot(corner(t[1]).cross(corner(t[2]))) / 6.0).sum::<f64>()
        };
        let reference = volume(&surface(100_000));
        for vertices in [3_000, 10_000, 30_000] {
            let model = surface(vertices);
            let off = model.positions.len() as f64 / vertices as f64 - 1.0;
            assert!(off.abs() < 0.01, "{} for {vertices}", model.positions.len());
            assert!((volume(&model) / reference - 1.0).abs() < 0.03, "{vertices}");
            assert_eq!(model.triangles.len(), 2 * model.positions.len(), "closed, of genus 1");
        }
        assert!(surface(0).positions.len() >= 16);
    }

    #[test]
    fn triangles_are_nearly_as_long_as_wide() {
        let model = surface(10_000);
        let edge = |a: u32, b: u32| model.positions[a as usize].distance(model.positions[b as usize]);
        let stretched = model.triangles.iter().filter(|[a, b, c]| {
            let edges = [edge(*a, *b), edge(*b, *c), edge(*c, *a)];
            edges.iter().copied().fold(0.0, f64::max) > 3.0 * edges.iter().copied().fold(f64::INFINITY, f64::min)
        });
        assert_eq!(stretched.count(), 0);
    }

    #[test]
    fn the_file_is_read_as_it_was_written() {
        let model = surface(500);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("knot.glb");
        std::fs::write(&path, glb(&model).unwrap()).unwrap();
        let read = read_gltf(&path).unwrap();
        assert!(read.warnings.is_empty(), "{:?}", read.warnings);
        assert_eq!(read.triangles, model.triangles);
        let rounded: Vec<DVec3> = model.positions.iter().map(|p| p.as_vec3().as_dvec3()).collect();
        assert_eq!(read.positions, rounded);
    }
}
