//! What tests of the readers share: files where this machine has them, and what every model promises.

use std::path::{Path, PathBuf};

use crate::geometry::source::SourceModel;

/// A folder of the shared test data, or `None` with a line that says so.
pub(super) fn shared_data(folder: &str) -> Option<PathBuf> {
    let root = std::env::var_os("TRANSLUX_SHARED")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared"), PathBuf::from);
    let path = root.join("data").join(folder);
    if path.is_dir() {
        return Some(path);
    }
    println!("WITHOUT ../shared: no test data at {}", path.display());
    None
}

/// Checks the promises of a model: every index in range, used vertices and texture coordinates finite, normals of unit
/// length up to `tolerance` or zero.
pub(super) fn check_promises(model: &SourceModel, tolerance: f32) {
    let triangles = model.triangles.len();
    let in_range = |corners: &[[u32; 3]], count: usize| corners.iter().flatten().all(|&i| (i as usize) < count);
    assert!(triangles > 0 && in_range(&model.triangles, model.positions.len()));
    assert!(model.triangles.iter().flatten().all(|&i| model.positions[i as usize].is_finite()));
    assert_eq!(model.triangle_material.len(), triangles);
    assert!(model.triangle_material.iter().all(|&m| (m as usize) < model.materials.len()));
    if let Some(normals) = &model.normals {
        assert!(normals.corners.len() == triangles && in_range(&normals.corners, normals.values.len()));
        let is_unit = |n: &glam::Vec3| *n == glam::Vec3::ZERO || (n.length() - 1.0).abs() < tolerance;
        assert!(normals.values.iter().all(is_unit));
    }
    if let Some(uvs) = &model.uvs {
        assert!(uvs.corners.len() == triangles && in_range(&uvs.corners, uvs.values.len()));
        assert!(uvs.values.iter().all(|uv| uv.is_finite()));
    }
}
