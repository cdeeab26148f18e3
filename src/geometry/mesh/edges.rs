//! Edges of a welded mesh and the loops that some of them form.

use super::Mesh;
use crate::geometry::buckets::Buckets;

/// Every edge of a mesh with the triangles at it, as one sorted array: buckets by the smaller welded vertex.
pub(crate) struct EdgeTable {
    /// Larger vertex << 32 | triangle << 1 | direction (1: the triangle runs from the larger to the smaller vertex).
    half_edges: Buckets<u64>,
}

/// One undirected edge.
#[derive(Clone, Copy)]
pub(crate) struct Edge<'a> {
    /// Smaller and larger welded vertex.
    pub vertices: [u32; 2],
    half_edges: &'a [u64],
}

impl Edge<'_> {
    /// Number of triangles at the edge.
    pub(crate) fn valence(&self) -> usize {
        self.half_edges.len()
    }

    /// Triangles at the edge in ascending order, each with +1 if it runs from the smaller to the larger vertex, else -1.
    pub(crate) fn triangles(&self) -> impl Iterator<Item = (u32, i32)> + '_ {
        self.half_edges.iter().map(|h| ((*h as u32) >> 1, 1 - 2 * (*h & 1) as i32))
    }
}

impl EdgeTable {
    /// Collects the edges of a mesh without collapsed triangles.
    pub(crate) fn new(mesh: &Mesh) -> Self {
        let of_triangle = |t: u32| {
            let [a, b, c] = mesh.welded(t);
            [(a, b), (b, c), (c, a)]
                .map(|(u, v)| (u.min(v), u64::from(u.max(v)) << 32 | u64::from(t) << 1 | u64::from(u > v)))
        };
        let all = || (0..mesh.triangles.len() as u32).flat_map(of_triangle);
        Self { half_edges: Buckets::new(mesh.weld.len(), all).sorted() }
    }

    /// Every edge once, ordered by its vertices.
    pub(crate) fn edges(&self) -> impl Iterator<Item = Edge<'_>> + '_ {
        self.half_edges.all().enumerate().flat_map(|(v, bucket)| {
            let runs = bucket.chunk_by(|a, b| a >> 32 == b >> 32);
            runs.map(move |run| Edge { vertices: [v as u32, (run[0] >> 32) as u32], half_edges: run })
        })
    }
}

/// A path along edges that visits no vertex twice.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Chain {
    /// Vertices in order; the last one joins the first unless the chain is open.
    pub vertices: Vec<u32>,
    /// True if the last vertex joins the first.
    pub closed: bool,
}

/// Cuts a graph into simple loops, and open paths where vertices have odd degree. The result depends on the edges and
/// their order only.
pub(crate) fn simple_chains(edges: &[[u32; 2]]) -> Vec<Chain> {
    // Vertices are renumbered densely so that all tables have the size of the input.
    let mut vertices: Vec<u32> = edges.iter().flatten().copied().collect();
    vertices.sort_unstable();
    vertices.dedup();
    let dense = |v: u32| vertices.partition_point(|&w| w < v);
    let ends: Vec<[usize; 2]> = edges.iter().map(|e| e.map(dense)).collect();
    let of_edge = |(e, pair): (usize, &[usize; 2])| pair.map(|v| (v as u32, e));
    let incident = Buckets::new(vertices.len(), || ends.iter().enumerate().flat_map(of_edge));
    let mut walk = Walk {
        cursor: vec![0; vertices.len()],
        incident,
        ends: &ends,
        used: vec![false; edges.len()],
        position: vec![usize::MAX; vertices.len()],
        path: Vec::new(),
        chains: Vec::new(),
    };
    // Open paths first, from vertices of odd degree: what is left then has even degree everywhere.
    for v in 0..vertices.len() {
        if walk.incident.bucket(v).len() % 2 == 1 {
            walk.run(v);
        }
    }
    for v in 0..vertices.len() {
        while walk.run(v) {}
    }
    let name = |(path, closed): (Vec<usize>, bool)| Chain {
        vertices: path.into_iter().map(|v| vertices[v]).collect(),
        closed,
    };
    walk.chains.into_iter().map(name).collect()
}

struct Walk<'a> {
    /// Edges at each vertex, and how many of them have been looked at.
    incident: Buckets<usize>,
    cursor: Vec<usize>,
    ends: &'a [[usize; 2]],
    used: Vec<bool>,
    /// Place of a vertex on the current path.
    position: Vec<usize>,
    path: Vec<usize>,
    chains: Vec<(Vec<usize>, bool)>,
}

impl Walk<'_> {
    /// Follows unused edges from `v` until there are none; returns whether there was one.
    fn run(&mut self, v: usize) -> bool {
        let mut current = v;
        self.position[v] = 0;
        self.path.push(v);
        let mut moved = false;
        while let Some(e) = self.unused_edge(current) {
            moved = true;
            self.used[e] = true;
            let [a, b] = self.ends[e];
            current = if a == current { b } else { a };
            let seen = self.position[current];
            if seen == usize::MAX {
                self.position[current] = self.path.len();
                self.path.push(current);
            } else {
                let ring = self.path[seen..].to_vec();
                for &w in &ring[1..] {
                    self.position[w] = usize::MAX;
                }
                self.path.truncate(seen + 1);
                self.chains.push((ring, true));
            }
        }
        for &w in &self.path {
            self.position[w] = usize::MAX;
        }
        if self.path.len() > 1 {
            self.chains.push((std::mem::take(&mut self.path), false));
        }
        self.path.clear();
        moved
    }

    fn unused_edge(&mut self, v: usize) -> Option<usize> {
        while let Some(&e) = self.incident.bucket(v).get(self.cursor[v]) {
            if !self.used[e] {
                return Some(e);
            }
            self.cursor[v] += 1;
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_figure_of_eight_and_a_tail_become_two_loops_and_a_path() {
        let edges = [[0, 1], [1, 2], [2, 0], [2, 3], [3, 4], [4, 2], [7, 8], [8, 9]];
        let chains = simple_chains(&edges);
        let mut shapes: Vec<(usize, bool)> = chains.iter().map(|c| (c.vertices.len(), c.closed)).collect();
        shapes.sort_unstable();
        assert_eq!(shapes, [(3, false), (3, true), (3, true)]);
        assert!(simple_chains(&[]).is_empty());
    }

    #[test]
    fn two_edges_between_the_same_vertices_are_a_loop() {
        assert_eq!(simple_chains(&[[0, 1], [0, 1]]), [Chain { vertices: vec![0, 1], closed: true }]);
    }
}
