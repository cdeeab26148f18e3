//! The mesh as a vertex buffer: three corners for each triangle, with shading and geometric normals.

use glam::Vec3;

use crate::render::normals::ShadingNormals;
use crate::transport::scene::Scene;

/// An index that stands for nothing.
pub(super) const NONE: u32 = u32::MAX;

/// A corner of a triangle as the shaders read it.
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(super) struct Corner {
    pub(super) local_mm: [f32; 3],
    pub(super) normal: [f32; 3],
    pub(super) face: [f32; 3],
    pub(super) receiver: u32,
    pub(super) vertex: u32,
    pub(super) medium: u32,
}

impl Corner {
    pub(super) const ATTRIBUTES: [wgpu::VertexAttribute; 4] =
        wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32x3, 2 => Float32x3, 3 => Uint32x3];
}

/// The corners of all triangles.
pub(super) fn corners(scene: &Scene, receiver_of_vertex: &[u32]) -> Vec<Corner> {
    let mesh = &scene.mesh;
    let normals = ShadingNormals::new(scene);
    let mut out = Vec::with_capacity(3 * mesh.triangles.len());
    for (triangle, vertices) in mesh.triangles.iter().enumerate() {
        let part = scene.parts.triangle_part.get(triangle).and_then(|p| scene.parts.parts.get(*p as usize));
        let medium = part.and_then(|p| p.medium).filter(|m| (*m as usize) < scene.media.len()).unwrap_or(NONE);
        let face = mesh.normal(triangle as u32).as_vec3().to_array();
        for (corner, &vertex) in vertices.iter().enumerate() {
            let weights = std::array::from_fn(|i| f64::from(u8::from(i == corner)));
            out.push(Corner {
                local_mm: mesh.local_mm.get(vertex as usize).copied().unwrap_or(Vec3::ZERO).to_array(),
                normal: normals.at(triangle as u32, weights).as_vec3().to_array(),
                face,
                receiver: receiver_of_vertex.get(vertex as usize).copied().unwrap_or(NONE),
                vertex,
                medium,
            });
        }
    }
    out
}

/// Ends of the three edges of each triangle, as indices of corners.
pub(super) fn wires(triangles: usize) -> Vec<u32> {
    (0..triangles as u32).flat_map(|t| [0, 1, 1, 2, 2, 0].map(|corner| 3 * t + corner)).collect()
}
