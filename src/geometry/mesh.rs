//! The triangle mesh that every stage works on: millimetres, source vertex order, welded topology.

use glam::{DVec3, Vec2, Vec3};

use super::source::CornerAttribute;

/// A triangle mesh in mm.
///
/// Positions are kept as 32-bit offsets from a 64-bit origin (the centre of the bounding box), the precision that the
/// asset stores: a mesh taken from a file and the same mesh taken from its asset are the same to the bit.
/// Vertices keep the order of the source; `weld` joins vertices at the same place.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// World position of the local origin, in mm.
    pub origin_mm: DVec3,
    /// Source vertices relative to `origin_mm`, in mm; zero for vertices that no triangle uses and that are not finite.
    pub local_mm: Vec<Vec3>,
    /// Corner indices into `local_mm`; degenerate and duplicate triangles of the source are gone.
    pub triangles: Vec<[u32; 3]>,
    /// For each triangle, an index into `materials`.
    pub triangle_material: Vec<u32>,
    /// Names of the source's materials.
    pub materials: Vec<String>,
    /// Shading normals.
    pub normals: Option<CornerAttribute<Vec3>>,
    /// Texture coordinates.
    pub uvs: Option<CornerAttribute<Vec2>>,
    /// For each source vertex, the index of the first source vertex at the same place (itself, mostly).
    pub weld: Vec<u32>,
}

impl Mesh {
    /// World position of a source vertex, in mm.
    #[inline]
    pub fn position_mm(&self, vertex: u32) -> DVec3 {
        self.origin_mm + self.local_mm[vertex as usize].as_dvec3()
    }

    /// Corners of a triangle relative to `origin_mm`, in mm, in double precision.
    #[inline]
    pub fn corners_local_mm(&self, triangle: u32) -> [DVec3; 3] {
        self.triangles[triangle as usize].map(|v| self.local_mm[v as usize].as_dvec3())
    }

    /// Twice the area times the geometric unit normal of a triangle, in mm^2.
    #[inline]
    pub fn cross_mm2(&self, triangle: u32) -> DVec3 {
        let [a, b, c] = self.corners_local_mm(triangle);
        (b - a).cross(c - a)
    }
}
