//! Facets of samples as whole triangles of a finer mesh, cut the same way in every shape of the mesh.
//!
//! Facets are cut at longest edges, so that the same path names other pieces of a triangle where the mesh is bent. What is to be
//! compared piece by piece between two shapes is cut once, in one of them, and carried to the others by its weights.

use std::collections::HashMap;

use glam::DVec3;

use super::mesh::Mesh;
use super::part_table::PartTable;
use super::samples::{Facet, Samples, cut_at, longest_edge};

/// The facets of samples of a mesh, independent of where its vertices are.
#[derive(Clone, Debug)]
pub struct Refinement {
    /// Vertices of the mesh, which come first.
    vertices: usize,
    /// For each further vertex the two earlier ones that it lies in the middle of.
    middles: Vec<[u32; 2]>,
    /// A triangle for each facet, in their order, then those of the mesh that no facet is a piece of.
    triangles: Vec<[u32; 3]>,
    /// The triangle of the mesh that each is a piece of.
    of_triangle: Vec<u32>,
    /// Weights of the second and the third corner of that triangle at the centroid of each.
    centres: Vec<[f64; 2]>,
    /// The samples, whose facets are whole triangles.
    samples: Samples,
}

/// A corner of a piece: its vertex, its place, and its weights in the triangle.
#[derive(Clone, Copy)]
struct Corner {
    vertex: u32,
    at_mm: DVec3,
    weights: DVec3,
}

impl Refinement {
    /// Cuts a mesh as the facets of its samples say.
    pub fn new(mesh: &Mesh, samples: &Samples) -> Self {
        let count = samples.facets.len();
        let mut result = Self {
            vertices: mesh.local_mm.len(),
            middles: Vec::new(),
            triangles: Vec::with_capacity(count),
            of_triangle: Vec::with_capacity(count),
            centres: Vec::with_capacity(count),
            samples: Samples { facets: (0..count as u32).map(Facet::whole).collect(), ..samples.clone() },
        };
        // Neighbours that cut the same edge share its middle.
        let mut known: HashMap<[u32; 2], u32> = HashMap::new();
        let mut is_covered = vec![false; mesh.triangles.len()];
        for facet in &samples.facets {
            let mut corners = whole(mesh, facet.triangle);
            for level in (0..facet.path.checked_ilog2().unwrap_or(0)).rev() {
                let edge = longest_edge(corners.map(|corner| corner.at_mm));
                let halves = cut_at(corners, edge, |p, q| {
                    let pair = [p.vertex.min(q.vertex), p.vertex.max(q.vertex)];
                    let next = (result.vertices + result.middles.len()) as u32;
                    let vertex = *known.entry(pair).or_insert_with(|| {
                        result.middles.push(pair);
                        next
                    });
                    Corner { vertex, at_mm: 0.5 * (p.at_mm + q.at_mm), weights: 0.5 * (p.weights + q.weights) }
                });
                corners = halves[(facet.path >> level & 1) as usize];
            }
            is_covered[facet.triangle as usize] = true;
            result.push(facet.triangle, corners);
        }
        for triangle in (0..mesh.triangles.len() as u32).filter(|&t| !is_covered[t as usize]) {
            result.push(triangle, whole(mesh, triangle));
        }
        result
    }

    fn push(&mut self, triangle: u32, corners: [Corner; 3]) {
        let centre = corners.iter().map(|corner| corner.weights).sum::<DVec3>() / 3.0;
        self.triangles.push(corners.map(|corner| corner.vertex));
        self.of_triangle.push(triangle);
        self.centres.push([centre.y, centre.z]);
    }

    /// The finer mesh in a shape of the mesh: the same connectivity, with vertices anywhere.
    pub fn mesh(&self, shape: &Mesh) -> Mesh {
        let mut local_mm = shape.local_mm.clone();
        for &[p, q] in &self.middles {
            let [p, q] = [p, q].map(|v| local_mm[v as usize].as_dvec3());
            local_mm.push((0.5 * (p + q)).as_vec3());
        }
        let material = |&triangle: &u32| shape.triangle_material.get(triangle as usize).copied().unwrap_or_default();
        Mesh {
            origin_mm: shape.origin_mm,
            weld: shape.weld.iter().copied().chain(self.vertices as u32..local_mm.len() as u32).collect(),
            local_mm,
            triangles: self.triangles.clone(),
            triangle_material: self.of_triangle.iter().map(material).collect(),
            materials: shape.materials.clone(),
            normals: None,
            uvs: None,
        }
    }

    /// The parts of the finer mesh, `mesh`, of those of the mesh.
    pub fn parts(&self, mesh: &Mesh, parts: &PartTable) -> PartTable {
        let of = |&triangle: &u32| parts.triangle_part.get(triangle as usize).copied().unwrap_or(u32::MAX);
        let entries = parts.parts.iter().map(|part| (part.name.clone(), part.medium)).collect();
        PartTable::new(mesh, self.of_triangle.iter().map(of).collect(), entries)
    }

    /// The samples of the finer mesh; their facets are its triangles, one by one.
    pub fn samples(&self) -> &Samples {
        &self.samples
    }

    /// The triangle of the mesh that a triangle of the finer one is a piece of, and the weights of its second and third corner at the
    /// centroid of the piece.
    pub fn centre(&self, piece: u32) -> Option<(u32, [f64; 2])> {
        Some((*self.of_triangle.get(piece as usize)?, *self.centres.get(piece as usize)?))
    }
}

fn whole(mesh: &Mesh, triangle: u32) -> [Corner; 3] {
    let (corners, places) = (mesh.triangles[triangle as usize], mesh.corners_local_mm(triangle));
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    [0, 1, 2].map(|k| Corner { vertex: corners[k], at_mm: places[k], weights: axes[k] })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::geometry::samples::patches;
    use crate::geometry::shapes;
    use crate::geometry::test_data::mesh_of;

    #[test]
    fn pieces_are_the_facets_and_follow_the_mesh_into_another_shape() {
        let (mesh, _) = mesh_of(shapes::icosphere(3.0, 1));
        let parts = PartTable::new(&mesh, vec![0; mesh.triangles.len()], vec![("ball".to_owned(), Some(0))]);
        let samples = Samples::new(&mesh, &parts, 500);
        let refinement = Refinement::new(&mesh, &samples);
        let fine = refinement.mesh(&mesh);
        let finer = refinement.parts(&fine, &parts);
        assert_eq!(fine.triangles.len(), samples.facets.len());
        let (expected, there) = (patches(&mesh, &samples), patches(&fine, refinement.samples()));
        for (a, b) in expected.iter().zip(&there) {
            assert!(a.centre_mm.distance(b.centre_mm) < 1e-6 && (a.area_mm2 - b.area_mm2).abs() < 1e-6);
        }
        assert!((finer.parts[0].area_mm2 / parts.parts[0].area_mm2 - 1.0).abs() < 1e-6);
        // Stretched, the longest edges are others, and every piece is the image of what it was.
        let stretch = DVec3::new(1.0, 3.0, 0.5);
        let mut shape = mesh.clone();
        shape.local_mm.iter_mut().for_each(|p| *p = (p.as_dvec3() * stretch).as_vec3());
        let stretched = refinement.mesh(&shape);
        for piece in 0..fine.triangles.len() as u32 {
            let (before, after) = (fine.corners_local_mm(piece), stretched.corners_local_mm(piece));
            for (a, b) in before.iter().zip(after) {
                assert!((*a * stretch).distance(b) < 1e-5);
            }
            let (triangle, [u, v]) = refinement.centre(piece).unwrap();
            let [a, b, c] = mesh.corners_local_mm(triangle);
            let centre = before.iter().sum::<DVec3>() / 3.0;
            assert!((a + u * (b - a) + v * (c - a)).distance(centre) < 1e-6);
        }
        let (one, other) = (patches(&shape, &samples), patches(&stretched, refinement.samples()));
        assert!(one.iter().zip(&other).any(|(a, b)| a.centre_mm.distance(b.centre_mm) > 0.01));
    }
}
