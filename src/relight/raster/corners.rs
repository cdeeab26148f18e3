//! The mesh as vertex and index buffers: a corner for each source vertex, medium, material, shading
//! normal and texture coordinate.

use std::collections::HashMap;

use glam::Vec3;

use crate::render::normals::ShadingNormals;
use crate::render::texture::uv;
use crate::scene::Scene;

/// Index that stands for none.
pub(super) const NONE: u32 = u32::MAX;

/// A corner of triangles as the shaders read it.
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(super) struct Corner {
    pub(super) local_mm: [f32; 3],
    pub(super) normal: [f32; 3],
    pub(super) receiver: u32,
    pub(super) vertex: u32,
    pub(super) medium: u32,
    pub(super) material: u32,
    pub(super) uv: [f32; 2],
}

impl Corner {
    pub(super) const ATTRIBUTES: [wgpu::VertexAttribute; 4] =
        wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32x3, 2 => Uint32x4, 3 => Float32x2];
}

/// The corners of all triangles, each one once, and three indices for each triangle.
pub(super) fn corners(scene: &Scene, receiver_of_vertex: &[u32]) -> (Vec<Corner>, Vec<u32>) {
    let mesh = &scene.mesh;
    let normals = ShadingNormals::new(scene);
    let (mut corners, mut indices) = (Vec::new(), Vec::with_capacity(3 * mesh.triangles.len()));
    let mut known = HashMap::new();
    for (triangle, vertices) in mesh.triangles.iter().enumerate() {
        let part = scene.parts.triangle_part.get(triangle).and_then(|p| scene.parts.parts.get(*p as usize));
        let medium = part.and_then(|p| p.medium).filter(|m| (*m as usize) < scene.media.len()).unwrap_or(NONE);
        let material = mesh.triangle_material.get(triangle).copied().unwrap_or(0);
        for (corner, &vertex) in vertices.iter().enumerate() {
            let weights = std::array::from_fn(|i| f64::from(u8::from(i == corner)));
            let normal = normals.at(triangle as u32, weights).as_vec3().to_array();
            // 0 where there are none.
            let uv = uv(mesh, triangle as u32, weights).map_or([0.0; 2], |uv| uv.as_vec2().to_array());
            let key = (vertex, medium, material, normal.map(f32::to_bits), uv.map(f32::to_bits));
            let index = *known.entry(key).or_insert_with(|| {
                corners.push(Corner {
                    local_mm: mesh.local_mm.get(vertex as usize).copied().unwrap_or(Vec3::ZERO).to_array(),
                    normal,
                    receiver: receiver_of_vertex.get(vertex as usize).copied().unwrap_or(NONE),
                    vertex,
                    medium,
                    material,
                    uv,
                });
                corners.len() as u32 - 1
            });
            indices.push(index);
        }
    }
    (corners, indices)
}

/// End points of the three edges of each triangle.
pub(super) fn wires(indices: &[u32]) -> Vec<u32> {
    indices.as_chunks::<3>().0.iter().flat_map(|[a, b, c]| [*a, *b, *b, *c, *c, *a]).collect()
}
