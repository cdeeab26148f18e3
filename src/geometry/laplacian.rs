//! The Laplacian of a triangle mesh: cotangent weights, and a third of the area around a vertex as its mass (linear finite elements with
//! a lumped mass; equation 4 of Patro 2007 up to its sign and its mean of two masses).
//!
//! The stiffness `S` is positive semi-definite, `M` the diagonal of the masses: `M^-1 S` is minus the Laplace-Beltrami operator, and
//! `M^-1/2 S M^-1/2` has the same eigenvalues and orthogonal eigenvectors.
//!
//! - Obtuse triangles give negative weights, which stay. The energy is a sum of that of flat triangles all the same, so
//!   that `S` has no negative eigenvalue, linear functions of a plane stay exact, and eigenvalues converge; clamped
//!   weights give up both, and intrinsic flips change the surface that functions are interpolated on. The maximum
//!   principle is lost: filtered values may leave the range of the values by a little.
//! - A triangle belongs to all its edges, however many others do: edges of three triangles need nothing else.
//! - At an open boundary nothing flows out (Neumann's condition).
//! - Triangles whose height is below 1e-6 of their longest edge have no weights; their corners may be connected through others.
//! - Vertices without area are no nodes.

use std::sync::OnceLock;

use glam::DVec3;

use crate::math::sparse::SymmetricMatrix;
use crate::math::sparse::multigrid::Grids;
use crate::math::sparse::resolvent::{self, Solved};

/// No node.
pub const NONE: u32 = u32::MAX;

/// Height over the longest edge below which a triangle has no weights.
const FLATTEST: f64 = 1e-6;

/// The Laplacian of a mesh.
#[derive(Clone, Debug, Default)]
pub struct Laplacian {
    /// For each vertex its node; [`NONE`] for vertices without area.
    pub node: Vec<u32>,
    /// Vertex of each node, ascending.
    pub vertex: Vec<u32>,
    /// A third of the area around each node, mm^2.
    pub mass_mm2: Vec<f64>,
    /// The stiffness over the nodes, without a unit.
    pub stiffness: SymmetricMatrix,
    /// Mean length of the edges of the triangles, those of two triangles twice, mm.
    pub mean_edge_mm: f64,
    /// Triangles that are left out.
    pub flat_triangles: usize,
    grids: OnceLock<Grids>,
}

impl Laplacian {
    /// The Laplacian of triangles over `vertices` vertices, each with the positions of its corners, mm. Triangles that
    /// name a vertex twice or one that is not there are left out.
    pub fn new(vertices: usize, triangles: impl Iterator<Item = ([u32; 3], [DVec3; 3])>) -> Self {
        let mut mass = vec![0.0; vertices];
        let mut pairs = Vec::new();
        let (mut length, mut edges, mut flat_triangles) = (0.0, 0usize, 0);
        for (names, corners) in triangles {
            let [a, b, c] = names;
            let doubled_area = (corners[1] - corners[0]).cross(corners[2] - corners[0]).length();
            let sides: [f64; 3] = std::array::from_fn(|i| corners[(i + 1) % 3].distance(corners[(i + 2) % 3]));
            let longest = sides.iter().copied().fold(0.0, f64::max);
            let sound = a != b && b != c && c != a && names.iter().all(|v| (*v as usize) < vertices);
            if !sound || doubled_area.is_nan() || doubled_area <= FLATTEST * longest * longest {
                flat_triangles += 1;
                continue;
            }
            names.iter().for_each(|v| mass[*v as usize] += doubled_area / 6.0);
            length += sides.iter().sum::<f64>();
            edges += 3;
            for i in 0..3 {
                let (left, right) = ((i + 1) % 3, (i + 2) % 3);
                let cotangent = (corners[left] - corners[i]).dot(corners[right] - corners[i]) / doubled_area;
                pairs.push((names[left], names[right], -0.5 * cotangent));
            }
        }
        let vertex: Vec<u32> = (0..vertices as u32).filter(|v| mass[*v as usize] > 0.0).collect();
        let mut node = vec![NONE; vertices];
        vertex.iter().enumerate().for_each(|(n, v)| node[*v as usize] = n as u32);
        let mut diagonal = vec![0.0; vertex.len()];
        for (i, j, value) in &mut pairs {
            (*i, *j) = (node[*i as usize], node[*j as usize]);
            diagonal[*i as usize] -= *value;
            diagonal[*j as usize] -= *value;
        }
        let mass_mm2 = vertex.iter().map(|v| mass[*v as usize]).collect();
        let mean_edge_mm = if edges > 0 { length / edges as f64 } else { 0.0 };
        let stiffness = SymmetricMatrix::new(diagonal, &pairs);
        Self { node, vertex, mass_mm2, stiffness, mean_edge_mm, flat_triangles, grids: OnceLock::new() }
    }

    /// Number of nodes.
    pub fn len(&self) -> usize {
        self.vertex.len()
    }

    /// True if there are no nodes.
    pub fn is_empty(&self) -> bool {
        self.vertex.is_empty()
    }

    /// `M^-1/2 S M^-1/2`, 1/mm^2.
    pub fn symmetrised(&self) -> SymmetricMatrix {
        self.stiffness.scaled(&self.mass_mm2.iter().map(|m| 1.0 / m.sqrt()).collect::<Vec<f64>>())
    }

    /// Values of the nodes among those of the vertices.
    pub fn at_nodes<T: Copy>(&self, of_vertices: &[T]) -> Vec<T> {
        self.vertex.iter().map(|v| of_vertices[*v as usize]).collect()
    }

    /// Values of the vertices; of those that are no nodes, `other`.
    pub fn at_vertices<T: Copy>(&self, of_nodes: &[T], other: T) -> Vec<T> {
        self.node.iter().map(|n| of_nodes.get(*n as usize).copied().unwrap_or(other)).collect()
    }

    /// Writes `(1 - t Laplace)^-1` of values `of` the nodes to `values`, `t` in mm^2: a low pass whose response at the
    /// eigenvalue lambda is `1 / (1 + t lambda)`. The iteration starts from the content of `values`.
    pub fn diffused(&self, t_mm2: f64, of: &[[f64; 3]], values: &mut [[f64; 3]], tolerance: f64) -> Solved {
        let grids = self.grids.get_or_init(|| Grids::new(&self.mass_mm2, &self.stiffness));
        resolvent::solve((&self.mass_mm2, &self.stiffness, grids), t_mm2, of, values, tolerance)
    }
}

#[cfg(test)]
#[path = "laplacian_tests.rs"]
mod tests;
