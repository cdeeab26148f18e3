//! Simplification of a mesh to a subset of its vertices, and the place of every vertex on what is left.
//!
//! Vertices are removed one by one, each collapsed onto a neighbour that stays (half-edge collapse), in the order of
//! the quadric error of Garland and Heckbert 1997 ("Surface simplification using quadric error metrics"), to which
//! terms for even spacing and for the prediction error of a signal on the vertices can be added. What remains are the
//! reference points of Hao and Varshney 2004, section 4.2; every vertex between them is a weighted sum of three.
//!
//! All arithmetic is addition, multiplication, division and square roots in one fixed order: the same mesh gives the
//! same hierarchy to the bit on every machine, so that it can be recomputed instead of stored.

mod anchor;
mod collapse;
mod complex;
mod groups;
mod quadric;

use glam::Vec3;

use crate::progress::Progress;

pub use anchor::{Anchor, Level};

/// The mesh to simplify.
///
/// Triangles that name a vertex beyond `positions`, a vertex that is not finite or one vertex twice are left out.
/// Everything else is taken as it is: boundaries, edges with more than two triangles, touching fans, duplicates.
#[derive(Clone, Copy, Debug)]
pub struct Input<'a> {
    /// Vertex positions in mm, near the origin.
    pub positions: &'a [Vec3],
    /// Corners, welded: triangles that hang together name the same vertices.
    pub triangles: &'a [[u32; 3]],
    /// Part of each triangle; no collapse joins two. Triangles beyond its end are of part 0.
    pub triangle_part: &'a [u32],
}

impl Input<'_> {
    fn part(&self, triangle: usize) -> u32 {
        self.triangle_part.get(triangle).copied().unwrap_or(0)
    }
}

/// Values on the vertices whose prediction error counts in the cost of a collapse.
#[derive(Clone, Copy, Debug)]
pub struct Signal<'a> {
    /// `dimension` values for each vertex, one vertex after the other.
    pub values: &'a [f32],
    /// Values of a vertex.
    pub dimension: usize,
    /// The squared distance in mm^2 that counts as much as a squared difference of 1 between values. With values from 0
    /// to 1, a sixth of the mesh's diagonal, squared, was best on a head with a shadow edge; a tenth of that gave 5 %
    /// more error, ten times 15 to 40 % more.
    pub weight_mm2: f64,
}

/// What a collapse costs, all terms weighted by area.
#[derive(Clone, Copy, Debug)]
pub struct Costs<'a> {
    /// Share of the squared length of a collapse that is added to its squared geometric error: keeps the references
    /// apart where the surface is flat. On scanned meshes, 0 to 1e-2 give the same deviation within a tenth, 1e-1 a
    /// quarter to a half more. At 0, large flat regions gather vertices with very many triangles, which takes long.
    pub spacing: f64,
    /// Weight of the planes that hold boundaries in place, relative to that of triangles.
    pub border: f64,
    /// Values whose prediction error counts as well.
    pub signal: Option<Signal<'a>>,
}

impl Default for Costs<'_> {
    fn default() -> Self {
        Self { spacing: 1e-2, border: 10.0, signal: None }
    }
}

/// One step of a simplification.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Collapse {
    /// The vertex that went.
    pub removed: u32,
    /// The neighbour that took its place.
    pub onto: u32,
}

/// A sequence of collapses, cut into nested levels.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Hierarchy {
    /// The collapses in order, all levels together.
    pub collapses: Vec<Collapse>,
    /// From fine to coarse: the references of each level are among those of the one before, and are predicted from it.
    pub levels: Vec<Level>,
}

impl Hierarchy {
    /// Simplifies to each of `levels` vertices in turn, which should fall.
    ///
    /// A level keeps more vertices than asked where the mesh has more components (at least one vertex of each stays),
    /// and none where it has no triangle. Vertices without a triangle are never references and have no place.
    pub fn new(input: &Input, costs: &Costs, levels: &[usize], progress: &dyn Progress) -> Self {
        collapse::run(input, costs, &[], levels, progress)
    }

    /// Simplifies to the given references alone, by geometry: what a reader who knows the mesh and the references can
    /// do again. A component that holds no reference keeps one vertex, which becomes a reference too.
    pub fn keeping(input: &Input, references: &[u32], progress: &dyn Progress) -> Self {
        collapse::run(input, &Costs::default(), references, &[0], progress)
    }
}

#[cfg(test)]
mod tests;
