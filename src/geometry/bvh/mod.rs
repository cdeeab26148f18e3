//! Ray casting over triangles: watertight, conservative at every coordinate scale, the same answer on every CPU.
//!
//! # What a hit is
//!
//! The answer to a ray depends on the ray and the triangles only, never on the tree or the instruction set.
//! Vertices are sheared into the frame of the ray in 32-bit arithmetic (Woop, Benthin, Wald 2013, "Watertight
//! Ray/Triangle Intersection"), so a vertex lands on the same point for every triangle around it; on those points the
//! three edge functions are decided exactly. A ray that starts well inside a closed surface therefore cannot leave it
//! between triangles.
//!
//! # Why the boxes never lose a hit
//!
//! With `u = 2^-24`, `m` the largest coordinate of the scene and of the ray's origin: the shear moves a vertex by less
//! than `8u * 2m`; the slab test is off by less than `5u * 2m` (planes and origin times a rounded reciprocal); and a
//! direction component is raised to at least `2^-30` of the largest one, which moves the ray by less than
//! `2^-30 * 2m` inside the scene. Every box is grown by `32u * m` on each side at the moment of its test
//! (it costs nothing there: two origins in place of one). Weights and distances of a hit are good to 15 digits, so the
//! point of a hit is within that growth of its box, and a box is skipped only if nothing in it is hit within the range.
//! Rays from far away start over beside the scene, so that `m` stays of its size.
//!
//! # What was tried
//!
//! On the bunny (70k triangles), one core, Mrays/s: intrinsics inside closures (which lose the features of their
//! caller) 2; the same inlined 5; skipping the own triangle before the exact test and the next node in a register
//! instead of on the stack 7. Costs of a leaf from 0.6 to 2.5 nodes, four times the reinsertion and a shorter search
//! while building all stay within the noise. Bundles of 16 give 1.5 to 1.8 times the single rays where rays are alike,
//! nothing where they are not. The portable path answers the same at 0.4 of the speed.

mod build;
mod lanes;
mod packet;
mod ray;
#[cfg(test)]
mod tests;
mod traverse;
mod triangle;

use glam::Vec3;

use self::build::{Block, Node, Tree};
use self::ray::Query;
use super::mesh::Mesh;

pub use self::ray::{Ray, offset_along, offset_origin};
pub use self::triangle::{Hit, NO_TRIANGLE};

/// Triangles arranged for ray casting. The tree is a function of the triangles alone.
#[derive(Clone, Debug)]
pub struct Bvh {
    tree: Tree,
    path: lanes::Path,
}

impl Bvh {
    /// Arranges the triangles of a mesh, in its local coordinates (mm); hits carry the mesh's triangle indices.
    pub fn new(mesh: &Mesh) -> Self {
        let at = |v: u32| mesh.local_mm.get(v as usize).copied().unwrap_or(Vec3::NAN);
        let corners: Vec<[Vec3; 3]> = mesh.triangles.iter().map(|t| t.map(at)).collect();
        Self::from_triangles(&corners)
    }

    /// Arranges triangles given by their corners; hits carry positions in this slice. No triangle is fine.
    ///
    /// Triangles without area or with a coordinate that is not finite are never hit.
    pub fn from_triangles(corners: &[[Vec3; 3]]) -> Self {
        Self { tree: Tree::new(corners), path: lanes::Path::detect() }
    }

    /// True if any triangle but `skip` ([`NO_TRIANGLE`]: nothing is skipped) meets the ray, ends excluded.
    ///
    /// A ray that is not finite meets nothing.
    pub fn occluded(&self, ray: &Ray, skip: u32) -> bool {
        let Some(query) = Query::new(ray, &self.tree) else { return false };
        traverse::occluded(self.path, &self.tree, &query, skip)
    }

    /// [`Self::occluded`] for each ray, with the same answers; faster where neighbours in the slice are alike (one
    /// direction and near origins, or one origin and near directions).
    ///
    /// Answers as many rays as the shortest of the three slices holds.
    pub fn occluded_many(&self, rays: &[Ray], skip: &[u32], out: &mut [bool]) {
        packet::occluded_many(self.path, &self.tree, rays, skip, out);
    }

    /// The hit with the smallest distance in the open range of the ray; of equal ones, the lowest triangle index.
    pub fn closest(&self, ray: &Ray) -> Option<Hit> {
        let query = Query::new(ray, &self.tree)?;
        traverse::closest(self.path, &self.tree, &query)
    }

    /// [`Self::closest`] for each ray, to the bit; faster where neighbours in the slice are alike (eye rays of a
    /// pixel).
    ///
    /// Answers as many rays as the shorter of the two slices holds.
    pub fn closest_many(&self, rays: &[Ray], out: &mut [Option<Hit>]) {
        packet::closest_many(self.path, &self.tree, rays, out);
    }

    /// Calls `visit` with every hit in the open range of the ray, in no particular but a fixed order.
    ///
    /// A ray through an edge or a vertex meets each of the triangles around it.
    pub fn crossings(&self, ray: &Ray, visit: impl FnMut(Hit)) {
        let Some(query) = Query::new(ray, &self.tree) else { return };
        traverse::crossings(self.path, &self.tree, &query, visit);
    }

    /// The tree as words, for shaders.
    #[cfg(feature = "gpu")]
    pub(crate) fn words(&self) -> Words {
        let Tree { nodes, blocks, low, high, extent, magnitude, stack } = &self.tree;
        let bits = |rows: &[[f32; build::WIDTH]]| rows.as_flattened().iter().map(|x| x.to_bits()).collect::<Vec<u32>>();
        let node = |node: &Node| [bits(&node.planes), node.children.0.to_vec()].concat();
        let block = |block: &Block| [bits(block.corners.as_flattened()), block.triangles.to_vec()].concat();
        // A box of no triangle is not finite.
        let bounds = [*low, *high].map(|corner| if corner.is_finite() { corner } else { Vec3::ZERO });
        Words {
            nodes: nodes.iter().flat_map(node).collect(),
            blocks: blocks.iter().flat_map(block).collect(),
            bounds,
            extent: *extent,
            magnitude: *magnitude,
            // All children of a node wait on the stack, where on a processor one is in a register.
            stack: stack + build::WIDTH,
        }
    }

    /// Bytes held in memory.
    pub fn bytes(&self) -> usize {
        self.tree.nodes.len() * size_of::<Node>() + self.tree.blocks.len() * size_of::<Block>()
    }
}

/// A [`Bvh`] as words: numbers of 32 bits, or their bits.
#[cfg(feature = "gpu")]
#[derive(Clone, Debug)]
pub(crate) struct Words {
    /// Of each node: low x, y, z, high x, y, z of eight children, their references.
    pub(crate) nodes: Vec<u32>,
    /// Of each block: corners of eight triangles by corner and axis, the indices of the triangles.
    pub(crate) blocks: Vec<u32>,
    /// Corners of the box of all triangles.
    pub(crate) bounds: [Vec3; 2],
    /// Longest side of that box.
    pub(crate) extent: f32,
    /// Largest absolute coordinate.
    pub(crate) magnitude: f32,
    /// References that wait at once, at most.
    pub(crate) stack: usize,
}
