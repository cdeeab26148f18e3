//! Triangles turned over, with their corners in every attribute.

use glam::Vec3;

use crate::geometry::mesh::Mesh;
use crate::geometry::source::CornerAttribute;

/// Turns the flagged triangles over, with their corners in every attribute. Shading normals are negated in those of
/// the `groups` groups where most of them would point into the surface.
pub(super) fn turn_over(mesh: &mut Mesh, turned: &[bool], group: impl Fn(usize) -> usize, groups: usize) {
    let normals = mesh.normals.take().map(|normals| turned_normals(mesh, normals, turned, group, groups));
    mesh.normals = normals;
    for t in (0..turned.len()).filter(|&t| turned[t]) {
        mesh.triangles[t].swap(1, 2);
        if let Some(normals) = &mut mesh.normals {
            normals.corners[t].swap(1, 2);
        }
        if let Some(uvs) = &mut mesh.uvs {
            uvs.corners[t].swap(1, 2);
        }
    }
}

fn turned_normals(
    mesh: &Mesh,
    mut normals: CornerAttribute<Vec3>,
    turned: &[bool],
    group: impl Fn(usize) -> usize,
    groups: usize,
) -> CornerAttribute<Vec3> {
    let mut agreement = vec![0.0; groups];
    for t in (0..turned.len()).filter(|&t| turned[t]) {
        let face = -mesh.cross_mm2(t as u32);
        for &n in &normals.corners[t] {
            agreement[group(t)] += face.dot(normals.values[n as usize].as_dvec3());
        }
    }
    let mut negated = vec![u32::MAX; normals.values.len()];
    for t in (0..turned.len()).filter(|&t| turned[t] && agreement[group(t)] < 0.0) {
        for n in &mut normals.corners[t] {
            if negated[*n as usize] == u32::MAX {
                negated[*n as usize] = normals.values.len() as u32;
                let value = -normals.values[*n as usize];
                normals.values.push(value);
            }
            *n = negated[*n as usize];
        }
    }
    normals
}
