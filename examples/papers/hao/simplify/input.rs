//! The mesh to simplify, the costs of a collapse, and its record.

use glam::Vec3;

/// The mesh to simplify.
///
/// Triangles that name a vertex beyond `positions`, a vertex that is not finite or one vertex twice are left out.
/// Everything else is taken as it is: boundaries, edges with more than two triangles, touching fans, duplicates.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Input<'a> {
    /// Vertex positions in mm, near the origin.
    pub(crate) positions: &'a [Vec3],
    /// Corners, welded: triangles that hang together name the same vertices.
    pub(crate) triangles: &'a [[u32; 3]],
    /// Part of each triangle; no collapse joins two. Triangles beyond its end are of part 0.
    pub(crate) triangle_part: &'a [u32],
}

impl Input<'_> {
    pub(super) fn part(&self, triangle: usize) -> u32 {
        self.triangle_part.get(triangle).copied().unwrap_or(0)
    }
}

/// Values on the vertices whose prediction error counts in the cost of a collapse.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Signal<'a> {
    /// `dimension` values for each vertex, one vertex after the other.
    pub(crate) values: &'a [f32],
    /// Values of a vertex.
    pub(crate) dimension: usize,
    /// The squared distance in mm^2 that counts as much as a squared difference of 1 between values. With values from 0
    /// to 1, a sixth of the mesh's diagonal, squared, was best on a head with a shadow edge; a tenth of that gave 5 %
    /// more error, ten times 15 to 40 % more.
    pub weight_mm2: f64,
}

/// What a collapse costs, all terms weighted by area.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Costs<'a> {
    /// Share of the squared length of a collapse that is added to its squared geometric error: keeps the references
    /// apart where the surface is flat. On scanned meshes, 0 to 1e-2 give the same deviation within a tenth, 1e-1 a
    /// quarter to a half more. At 0, large flat regions gather vertices with very many triangles, which takes long.
    pub(crate) spacing: f64,
    /// Weight of the planes that hold boundaries in place, relative to that of triangles.
    pub(crate) border: f64,
    /// Values whose prediction error counts as well.
    pub(crate) signal: Option<Signal<'a>>,
}

impl Default for Costs<'_> {
    fn default() -> Self {
        Self { spacing: 1e-2, border: 10.0, signal: None }
    }
}

/// One step of a simplification.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Collapse {
    /// The vertex that went.
    pub(crate) removed: u32,
    /// The neighbour that took its place.
    pub(crate) onto: u32,
}
