//! Does anything stand between a point and a light: a median-split box tree and Moeller-Trumbore's test.

use super::mesh::OracleMesh;
use super::vector::{V3, cross, dot, sub};

struct BoxNode {
    lo: V3,
    hi: V3,
    /// Leaf: first entry of `order`; inner node: the second child (the first follows its parent).
    link: u32,
    /// Triangles of a leaf; 0 in an inner node.
    count: u32,
}

/// All triangles, two-sided, as blockers.
pub struct Blockers {
    nodes: Vec<BoxNode>,
    order: Vec<u32>,
    /// In the order of the mesh while the tree is built, in the order of `order` afterwards.
    corners: Vec<[V3; 3]>,
    /// Hits nearer than this are the surface itself, mm.
    nearest_mm: f64,
}

impl Blockers {
    pub fn new(mesh: &OracleMesh) -> Self {
        let corners: Vec<[V3; 3]> = (0..mesh.triangles.len()).map(|t| mesh.corners(t)).collect();
        let order = (0..corners.len() as u32).collect();
        let mut tree = Self { nodes: Vec::new(), order, corners, nearest_mm: 0.0 };
        if !tree.corners.is_empty() {
            tree.build(0, tree.corners.len());
            let diagonal = super::vector::distance(tree.nodes[0].lo, tree.nodes[0].hi);
            tree.nearest_mm = 1e-10 * diagonal;
            // A slab of no thickness must not be missed through rounding.
            let margin = 1e-9 * diagonal;
            for node in &mut tree.nodes {
                node.lo = node.lo.map(|c| c - margin);
                node.hi = node.hi.map(|c| c + margin);
            }
            let by_leaf = tree.order.iter().map(|&t| tree.corners[t as usize]).collect();
            tree.corners = by_leaf;
        }
        tree
    }

    fn build(&mut self, begin: usize, end: usize) -> u32 {
        let (mut lo, mut hi) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for &t in &self.order[begin..end] {
            for p in self.corners[t as usize] {
                for k in 0..3 {
                    lo[k] = lo[k].min(p[k]);
                    hi[k] = hi[k].max(p[k]);
                }
            }
        }
        let index = self.nodes.len();
        self.nodes.push(BoxNode { lo, hi, link: begin as u32, count: (end - begin) as u32 });
        if end - begin > 4 {
            let mut axis = 0;
            for k in 1..3 {
                if hi[k] - lo[k] > hi[axis] - lo[axis] {
                    axis = k;
                }
            }
            let middle = usize::midpoint(begin, end);
            let corners = &self.corners;
            let key = |t: &u32| corners[*t as usize].iter().map(|p| p[axis]).sum::<f64>();
            self.order[begin..end]
                .select_nth_unstable_by(middle - begin, |a, b| key(a).total_cmp(&key(b)).then(a.cmp(b)));
            self.build(begin, middle);
            let second = self.build(middle, end);
            self.nodes[index].link = second;
            self.nodes[index].count = 0;
        }
        index as u32
    }

    /// Whether the segment from `origin` (a point of triangle `own`) along `direction` up to the parameter `reach`
    /// (in lengths of `direction`; infinite for a direction) is free.
    pub fn sees(&self, origin: V3, own: u32, direction: V3, reach: f64) -> bool {
        if self.nodes.is_empty() {
            return true;
        }
        let inverse = direction.map(|d| 1.0 / d);
        let nearest = self.nearest_mm / dot(direction, direction).sqrt();
        let mut stack = [0u32; 64];
        let mut depth = 1;
        while depth > 0 {
            depth -= 1;
            let index = stack[depth];
            let node = &self.nodes[index as usize];
            let (mut enter, mut leave) = (0.0_f64, reach);
            for k in 0..3 {
                let (a, b) = ((node.lo[k] - origin[k]) * inverse[k], (node.hi[k] - origin[k]) * inverse[k]);
                // NaN (0 * inf: the ray runs inside the slab's face) drops out of min and max.
                enter = enter.max(a.min(b));
                leave = leave.min(a.max(b));
            }
            if enter > leave {
                continue;
            }
            if node.count == 0 {
                stack[depth] = node.link;
                stack[depth + 1] = index + 1;
                depth += 2;
                continue;
            }
            for slot in node.link as usize..(node.link + node.count) as usize {
                if self.blocks(slot, origin, own, direction, nearest, reach) {
                    return false;
                }
            }
        }
        true
    }

    /// The same answer without the tree.
    pub fn sees_by_loop(&self, origin: V3, own: u32, direction: V3, reach: f64) -> bool {
        let nearest = self.nearest_mm / dot(direction, direction).sqrt();
        !(0..self.order.len()).any(|slot| self.blocks(slot, origin, own, direction, nearest, reach))
    }

    fn blocks(&self, slot: usize, origin: V3, own: u32, direction: V3, nearest: f64, reach: f64) -> bool {
        self.order[slot] != own && hit(self.corners[slot], origin, direction).is_some_and(|t| t > nearest && t < reach)
    }
}

/// Parameter along `direction` at which the line meets the triangle.
fn hit(corners: [V3; 3], origin: V3, direction: V3) -> Option<f64> {
    let (e1, e2) = (sub(corners[1], corners[0]), sub(corners[2], corners[0]));
    let p = cross(direction, e2);
    let determinant = dot(e1, p);
    if determinant == 0.0 {
        return None;
    }
    let inverse = 1.0 / determinant;
    let s = sub(origin, corners[0]);
    let u = dot(s, p) * inverse;
    if !(0.0..=1.0).contains(&u) {
        return None;
    }
    let q = cross(s, e1);
    let v = dot(direction, q) * inverse;
    if v < 0.0 || u + v > 1.0 {
        return None;
    }
    Some(dot(e2, q) * inverse)
}
