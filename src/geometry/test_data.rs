//! What tests share: files of the shared test data, meshes and checks of models in mm.
#![allow(clippy::unwrap_used)]

use std::path::{Path, PathBuf};

use glam::DVec3;

use super::check::{MeanFreePath, MeshCheck, check};
use super::mesh::{Mesh, Placement, RepairReport};
use super::parts::{Analysis, MaterialRoles, PartsRule};
use super::source::SourceModel;

/// A file or folder of the shared test data, or none (which it says) where there is none.
pub(crate) fn shared(name: &str) -> Option<PathBuf> {
    let root = std::env::var_os("TRANSLUX_SHARED")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared"), PathBuf::from);
    let path = root.join("data").join(name);
    if !path.exists() {
        println!("WITHOUT ../shared: {} is not there", path.display());
        return None;
    }
    Some(path)
}

/// Vertices and faces of an OBJ of the shared test data, faces cut as fans.
pub(crate) fn obj(name: &str) -> Option<SourceModel> {
    let text = std::fs::read_to_string(shared(name)?).unwrap();
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for line in text.lines() {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                let p: Vec<f64> = words.take(3).map(|w| w.parse().unwrap()).collect();
                positions.push(DVec3::from_slice(&p));
            }
            Some("f") => {
                let face: Vec<u32> = words.map(|w| w.split('/').next().unwrap().parse::<u32>().unwrap() - 1).collect();
                triangles.extend((1..face.len() - 1).map(|k| [face[0], face[k], face[k + 1]]));
            }
            _ => {}
        }
    }
    Some(SourceModel::new(positions, triangles))
}

/// Mesh of a model in mm.
pub(crate) fn mesh_of(source: SourceModel) -> (Mesh, RepairReport) {
    Mesh::from_source(source, &Placement { mm_per_unit: 1.0 }).unwrap()
}

/// Check of a model of one medium.
pub(crate) fn checked(source: SourceModel, placement: Placement, paths: Option<&[MeanFreePath]>) -> MeshCheck {
    let (mut mesh, mut report) = Mesh::from_source(source, &placement).unwrap();
    let roles = MaterialRoles::single(mesh.materials.len());
    let analysis = Analysis::new(&mut mesh, &roles, PartsRule::Auto, &mut report);
    check(&mesh, &analysis, &report, paths)
}
