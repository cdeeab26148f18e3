//! What holds of every model that a reader accepts.

use translux::geometry::mesh::{Mesh, Placement};
use translux::geometry::source::SourceModel;

/// Panics if the mesh of a model holds numbers that are not finite or names that are not there.
pub fn check(model: SourceModel) {
    let materials = model.materials.len();
    let Ok((mesh, _)) = Mesh::from_source(model, &Placement { mm_per_unit: 1.0 }) else { return };
    assert!(mesh.local_mm.iter().all(|at| at.is_finite()), "a position");
    assert!(mesh.triangles.iter().flatten().all(|&vertex| (vertex as usize) < mesh.local_mm.len()), "a vertex");
    assert!(mesh.total_area_mm2().is_finite(), "an area");
    assert!(materials < 1 << 16, "materials");
}
