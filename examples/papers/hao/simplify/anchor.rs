//! What a simplification leaves, and the place of each vertex on it.

use glam::DVec3;
use rayon::prelude::*;

use super::complex::{Complex, NONE};
use super::groups::PartSets;
use super::input::{Collapse, Input};
use translux::geometry::nearest::closest_weights;

/// Faces away from where the search started before it ends.
const MOST_STEPS: usize = 8;

/// A vertex as a weighted sum of references.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Anchor {
    /// Indices into the references of the level. Where fewer than three have a weight, the last one is repeated.
    pub(crate) corners: [u32; 3],
    /// Barycentric weights, none negative, that add up to 1; for a vertex without a triangle all are 0.
    pub(crate) weights: [f64; 3],
}

impl Anchor {
    /// The place of a vertex that has no triangle.
    pub(crate) const NOWHERE: Self = Self { corners: [u32::MAX; 3], weights: [0.0; 3] };

    /// The place of a reference.
    pub(crate) fn at(reference: u32) -> Self {
        Self { corners: [reference; 3], weights: [1.0, 0.0, 0.0] }
    }

    /// Whether the vertex has a triangle in the mesh.
    pub(crate) fn is_somewhere(&self) -> bool {
        self.corners[0] != u32::MAX
    }
}

/// A simplified mesh and the vertices of the finer one on it.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Level {
    /// Vertices that are left, ascending.
    pub(crate) references: Vec<u32>,
    /// Triangles that are left, as indices into `references`. An edge that is all that is left of some triangles
    /// repeats its second end.
    pub(crate) faces: Vec<[u32; 3]>,
    /// Part of each face.
    pub(crate) face_part: Vec<u32>,
    /// Place of each vertex of the mesh; on a level after the first, of each reference of the level before.
    pub(crate) anchors: Vec<Anchor>,
    /// Where the faces of each reference start in `star_faces`.
    star_starts: Vec<u32>,
    star_faces: Vec<u32>,
}

/// What the search knows of the mesh that was simplified.
pub(super) struct FullMesh<'a> {
    pub(super) input: Input<'a>,
    /// Unit normal of each vertex.
    pub(super) normals: &'a [DVec3],
    pub(super) sets: &'a PartSets,
}

impl FullMesh<'_> {
    fn position(&self, vertex: u32) -> DVec3 {
        self.input.positions[vertex as usize].as_dvec3()
    }
}

/// Unit normals of the vertices, weighted by area; zero where triangles cancel out.
pub(super) fn vertex_normals(input: &Input, complex: &Complex) -> Vec<DVec3> {
    let mut normals = vec![DVec3::ZERO; input.positions.len()];
    for corners in complex.simplices.iter().filter(|s| s[0] != NONE) {
        let [a, b, c] = corners.map(|v| input.positions[v as usize].as_dvec3());
        let cross = (b - a).cross(c - a);
        for v in corners {
            normals[*v as usize] += cross;
        }
    }
    normals.iter_mut().for_each(|n| *n = n.normalize_or_zero());
    normals
}

impl Level {
    /// Faces around a reference, ascending.
    pub(crate) fn star(&self, reference: u32) -> &[u32] {
        let ends = self.star_starts.get(reference as usize..reference as usize + 2);
        ends.and_then(|ends| self.star_faces.get(ends[0] as usize..ends[1] as usize)).unwrap_or(&[])
    }

    /// Snapshot of the complex; `collapses` are those since the finer level, whose vertices are `finer` (all of the
    /// mesh if none).
    pub(super) fn new(
        mesh: &FullMesh,
        complex: &Complex,
        parent: &[u32],
        collapses: &[Collapse],
        finer: Option<&[u32]>,
    ) -> Self {
        let all = parent.len();
        let mut index = vec![NONE; all];
        let mut level = Self::default();
        let kept = |v: u32| parent[v as usize] == NONE && !mesh.sets.of(v).is_empty();
        for v in (0..all as u32).filter(|&v| kept(v)) {
            index[v as usize] = level.references.len() as u32;
            level.references.push(v);
        }
        for (t, simplex) in complex.simplices.iter().enumerate() {
            let real: Vec<u32> = simplex.iter().filter(|&&v| v != NONE).map(|&v| index[v as usize]).collect();
            let face = match real[..] {
                [a, b, c] => [a, b, c],
                [a, b] => [a, b, b],
                _ => continue,
            };
            level.faces.push(face);
            level.face_part.push(mesh.input.part(t));
        }
        level.build_stars();
        // Backwards, the target of each collapse already knows where it ended.
        for collapse in collapses.iter().rev() {
            index[collapse.removed as usize] = index[collapse.onto as usize];
        }
        let place = |v: u32| level.place(v, index[v as usize], mesh);
        level.anchors = match finer {
            Some(finer) => finer.par_iter().map(|&v| place(v)).collect(),
            None => (0..all as u32).into_par_iter().map(place).collect(),
        };
        level
    }

    fn build_stars(&mut self) {
        let mut starts = vec![0u32; self.references.len() + 1];
        let distinct = |face: [u32; 3]| face.into_iter().take(if face[1] == face[2] { 2 } else { 3 });
        for &face in &self.faces {
            for r in distinct(face) {
                starts[r as usize + 1] += 1;
            }
        }
        for i in 1..starts.len() {
            starts[i] += starts[i - 1];
        }
        let mut at = starts.clone();
        self.star_faces = vec![0; starts.last().map_or(0, |&end| end as usize)];
        for (f, &face) in self.faces.iter().enumerate() {
            for r in distinct(face) {
                self.star_faces[at[r as usize] as usize] = f as u32;
                at[r as usize] += 1;
            }
        }
        self.star_starts = starts;
    }

    /// The nearest point to a vertex on the faces around `root`, and from there on to neighbouring faces while they are
    /// nearer. A face that looks away from the vertex's normal counts as further by about the length of its edges: light
    /// on the other side of a thin wall is another.
    fn place(&self, vertex: u32, root: u32, mesh: &FullMesh) -> Anchor {
        if root == NONE {
            return Anchor::NOWHERE;
        }
        if self.references[root as usize] == vertex {
            return Anchor::at(root);
        }
        let (p, normal, parts) = (mesh.position(vertex), mesh.normals[vertex as usize], mesh.sets.of(vertex));
        let mut best = (f64::INFINITY, u32::MAX);
        let mut anchor = Anchor::at(root);
        let mut visit = |around: u32, best: &mut (f64, u32)| {
            for &f in self.star(around) {
                if parts.binary_search(&self.face_part[f as usize]).is_err() {
                    continue;
                }
                let face = self.faces[f as usize];
                let corners = face.map(|r| mesh.position(self.references[r as usize]));
                let [ab, ac] = [corners[1] - corners[0], corners[2] - corners[0]];
                let (weights, mut distance2) = closest_weights(p, corners);
                if ab.cross(ac).dot(normal) < 0.0 {
                    distance2 += 0.5 * (ab.length_squared() + ac.length_squared());
                }
                if (distance2, f) < *best {
                    *best = (distance2, f);
                    anchor = Anchor { corners: face, weights };
                }
            }
        };
        visit(root, &mut best);
        for _ in 0..MOST_STEPS {
            let from = best.1;
            let Some(&face) = self.faces.get(from as usize) else { break };
            for around in face {
                visit(around, &mut best);
            }
            if best.1 == from {
                break;
            }
        }
        anchor
    }
}
