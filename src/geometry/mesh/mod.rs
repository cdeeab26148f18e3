//! The triangle mesh that every stage works on: millimetres, source vertex order, welded topology.

mod build;
mod edges;
mod pose;
mod scale;

use glam::{DVec3, Vec2, Vec3};

pub use build::{RepairReport, material_indices, skip_materials};
pub(crate) use edges::{Chain, EdgeTable, simple_chains};
pub use pose::Positions;
pub use scale::{Placement, Scale, UpAxis, diagonal_in_units, resolve_scale};

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
    /// Area of a triangle in mm^2.
    #[inline]
    pub fn area_mm2(&self, triangle: u32) -> f64 {
        0.5 * self.cross_mm2(triangle).length()
    }

    /// Geometric unit normal of a triangle, outward by its winding; zero for a triangle without area.
    #[inline]
    pub fn normal(&self, triangle: u32) -> DVec3 {
        self.cross_mm2(triangle).normalize_or_zero()
    }

    /// Sum of the areas of all triangles in mm^2, added in the order of the triangles.
    pub fn total_area_mm2(&self) -> f64 {
        (0..self.triangles.len() as u32).map(|t| self.area_mm2(t)).sum()
    }

    /// Corners of a triangle as welded vertices: neighbours share them even across seams.
    #[inline]
    pub fn welded(&self, triangle: u32) -> [u32; 3] {
        self.triangles[triangle as usize].map(|v| self.weld[v as usize])
    }

    /// Smallest and largest corner of the bounding box of all triangles, relative to `origin_mm`, in mm.
    /// Both are zero for a mesh without triangles.
    pub fn bounds_local_mm(&self) -> [DVec3; 2] {
        let mut min = Vec3::INFINITY;
        let mut max = Vec3::NEG_INFINITY;
        for p in self.triangles.iter().flatten().map(|&v| self.local_mm[v as usize]) {
            min = min.min(p);
            max = max.max(p);
        }
        if min.is_finite() { [min.as_dvec3(), max.as_dvec3()] } else { [DVec3::ZERO; 2] }
    }

    /// Diagonal of the bounding box of all triangles, in mm.
    pub fn diagonal_mm(&self) -> f64 {
        let [min, max] = self.bounds_local_mm();
        (max - min).length()
    }
}

/// The share of the bounding-box diagonal by which rounding to single precision can move a vertex along one axis.
///
/// A coordinate is at most half the diagonal, so the rounding error is at most 2^-25 of the diagonal; twice that is
/// the resolution that the mesh claims.
pub(crate) const POSITION_RESOLUTION: f64 = 1.0 / 16_777_216.0;

#[cfg(test)]
mod tests;
