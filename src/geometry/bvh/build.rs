//! The tree: obvhs builds a binary one from boxes (PLOC with reinsertion), and a dynamic programme over surface areas
//! (Ylitie, Karras, Laine 2017, section 3.1) cuts it into nodes of eight children and leaves of eight triangles.

use std::time::Duration;

use glam::{DVec3, Vec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2;
use obvhs::ploc::{PlocSearchDistance, SortPrecision};
use obvhs::{Boundable, BvhBuildParams};

/// Children of a node and triangles of a leaf.
pub(super) const WIDTH: usize = 8;

/// Flag of a reference (stack entry or child): if set, the rest is a block and its number of triangles less one; else
/// the index of an inner node.
pub(super) const LEAF: u32 = 1 << 31;

/// Cost of testing a block of triangles against that of testing the boxes of a node.
const BLOCK_COST: f32 = 1.0;

/// References of the children of a node.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
pub(super) struct Children(pub [u32; WIDTH]);

/// An inner node.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
pub(super) struct Node {
    /// Low x, y, z, then high x, y, z of the children's boxes; an empty box where there is no child.
    pub planes: [[f32; WIDTH]; 6],
    /// References to the children.
    pub children: Children,
}

/// Up to eight triangles; unused lanes repeat the first.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
pub(super) struct Block {
    /// Coordinates of the corners, `[corner][axis][lane]`.
    pub corners: [[[f32; WIDTH]; 3]; 3],
    /// Indices of the triangles as they were given.
    pub triangles: [u32; WIDTH],
}

/// Nodes, the root first, and blocks in the order in which nodes refer to them.
#[derive(Clone, Debug)]
pub(super) struct Tree {
    pub nodes: Vec<Node>,
    pub blocks: Vec<Block>,
    /// Box of all triangles.
    pub low: Vec3,
    /// Box of all triangles.
    pub high: Vec3,
    /// Longest side of that box.
    pub extent: f32,
    /// Largest absolute coordinate.
    pub magnitude: f32,
    /// Room that a stack of references needs.
    pub stack: usize,
}

/// A box for obvhs, in units in which the scene is about 1 large, so that no area over- or underflows.
struct UnitBox(Aabb);

impl Boundable for UnitBox {
    fn aabb(&self) -> Aabb {
        self.0
    }
}

fn parameters() -> BvhBuildParams {
    BvhBuildParams {
        pre_split: false,
        ploc_search_distance: PlocSearchDistance::Medium,
        search_depth_threshold: 3,
        reinsertion_batch_ratio: 0.05,
        post_collapse_reinsertion_batch_ratio_multiplier: 0.0,
        sort_precision: SortPrecision::U64,
        max_prims_per_leaf: 1,
        collapse_traversal_cost: 1.0,
    }
}

fn has_area(&[a, b, c]: &[Vec3; 3]) -> bool {
    let [a, b, c] = [a, b, c].map(|p| p.as_dvec3());
    let finite = a.is_finite() && b.is_finite() && c.is_finite();
    finite && (b - a).cross(c - a) != DVec3::ZERO
}

impl Tree {
    pub(super) fn new(corners: &[[Vec3; 3]]) -> Self {
        let kept: Vec<u32> = (0u32..).zip(corners).filter(|(_, t)| has_area(t)).map(|(i, _)| i).collect();
        let points = || kept.iter().flat_map(|&i| corners[i as usize]);
        let low = points().fold(Vec3::INFINITY, Vec3::min);
        let high = points().fold(Vec3::NEG_INFINITY, Vec3::max);
        let mut tree =
            Self { nodes: Vec::new(), blocks: Vec::new(), low, high, extent: 0.0, magnitude: 0.0, stack: WIDTH };
        if kept.is_empty() {
            return tree;
        }
        tree.extent = (high - low).max_element();
        tree.magnitude = low.abs().max(high.abs()).max_element();
        let (centre, scale) = unit_frame(low, high);
        let boxes: Vec<UnitBox> = kept
            .iter()
            .map(|&i| {
                let unit = corners[i as usize].map(|p| Vec3A::from(((p.as_dvec3() - centre) * scale).as_vec3()));
                UnitBox(Aabb::from_points(&unit))
            })
            .collect();
        let binary = build_bvh2(&boxes, parameters(), &mut Duration::default());
        let order = children_first(&binary);
        let cut = Cut::new(&binary, &order);
        let mut emitter = Emitter { binary: &binary, cut, bounds: Vec::new(), corners, kept: &kept, tree: &mut tree };
        emitter.measure(&order);
        emitter.emit();
        tree
    }
}

fn unit_frame(low: Vec3, high: Vec3) -> (DVec3, f64) {
    let (low, high) = (low.as_dvec3(), high.as_dvec3());
    ((low + high) * 0.5, 1.0 / (high - low).max_element())
}

/// Choice of the subtrees that become one node's children: `cost[n][i]` is the least cost of the binary node `n` as at
/// most `i + 1` wide children, `split[n][i]` how many of them the left side gets (0: one fewer in all is as good, or it
/// is one), `count[n]` its number of triangles.
struct Cut {
    cost: Vec<[f32; WIDTH]>,
    split: Vec<[u8; WIDTH]>,
    count: Vec<u32>,
}

impl Cut {
    fn new(binary: &Bvh2, children_first: &[u32]) -> Self {
        let n = binary.nodes.len();
        let mut cut = Self { cost: vec![[0.0; WIDTH]; n], split: vec![[0; WIDTH]; n], count: vec![0; n] };
        for &node in children_first {
            cut.decide(binary, node as usize);
        }
        cut
    }

    fn decide(&mut self, binary: &Bvh2, n: usize) {
        let node = &binary.nodes[n];
        let area = node.aabb().half_area();
        if node.is_leaf() {
            self.cost[n] = [area * BLOCK_COST; WIDTH];
            self.count[n] = node.prim_count;
            return;
        }
        let (left, right) = (node.first_index as usize, node.first_index as usize + 1);
        self.count[n] = self.count[left] + self.count[right];
        let mut best = [f32::INFINITY; WIDTH];
        let mut split = [0u8; WIDTH];
        for i in 1..WIDTH {
            for k in 0..i {
                let cost = self.cost[left][k] + self.cost[right][i - 1 - k];
                if cost < best[i] {
                    best[i] = cost;
                    split[i] = k as u8 + 1;
                }
            }
        }
        // As a single child: a leaf if it fits in a block, else a node, whose own split is kept in slot 0.
        let leaf = if self.count[n] as usize <= WIDTH { area * BLOCK_COST } else { f32::INFINITY };
        let inner = area + best[WIDTH - 1];
        best[0] = leaf.min(inner);
        split[0] = if leaf <= inner { 0 } else { split[WIDTH - 1] };
        for i in 1..WIDTH {
            if best[i - 1] <= best[i] {
                best[i] = best[i - 1];
                split[i] = 0;
            }
        }
        self.cost[n] = best;
        self.split[n] = split;
    }
}

/// All nodes, every one after its children.
fn children_first(binary: &Bvh2) -> Vec<u32> {
    let mut order = Vec::with_capacity(binary.nodes.len());
    let mut stack = vec![0u32];
    while let Some(n) = stack.pop() {
        order.push(n);
        let node = &binary.nodes[n as usize];
        if !node.is_leaf() {
            stack.extend([node.first_index, node.first_index + 1]);
        }
    }
    order.reverse();
    order
}

struct Emitter<'a> {
    binary: &'a Bvh2,
    cut: Cut,
    /// Box of each binary node in the coordinates of the scene.
    bounds: Vec<(Vec3, Vec3)>,
    corners: &'a [[Vec3; 3]],
    kept: &'a [u32],
    tree: &'a mut Tree,
}

const HIGH: [f32; WIDTH] = [f32::INFINITY; WIDTH];
const LOW: [f32; WIDTH] = [f32::NEG_INFINITY; WIDTH];

/// A node without children.
const EMPTY: Node = Node { planes: [HIGH, HIGH, HIGH, LOW, LOW, LOW], children: Children([0; WIDTH]) };

impl Emitter<'_> {
    /// Boxes from the corners themselves: those of obvhs are rounded and in other units.
    fn measure(&mut self, children_first: &[u32]) {
        self.bounds = vec![(Vec3::INFINITY, Vec3::NEG_INFINITY); self.binary.nodes.len()];
        for &n in children_first {
            let node = &self.binary.nodes[n as usize];
            let first = node.first_index as usize;
            let mut sum = (Vec3::INFINITY, Vec3::NEG_INFINITY);
            if node.is_leaf() {
                for &i in &self.binary.primitive_indices[first..first + node.prim_count as usize] {
                    for p in self.corners[self.kept[i as usize] as usize] {
                        sum = (sum.0.min(p), sum.1.max(p));
                    }
                }
            } else {
                for child in [first, first + 1] {
                    sum = (sum.0.min(self.bounds[child].0), sum.1.max(self.bounds[child].1));
                }
            }
            self.bounds[n as usize] = sum;
        }
    }

    /// Writes nodes in the order of a depth-first walk, so that nodes visited together lie together.
    fn emit(&mut self) {
        // Root, its place in its parent, its depth; a scene of one block still gets a root node.
        let mut stack = vec![(0usize, None::<(usize, usize)>, 1usize)];
        while let Some((n, place, depth)) = stack.pop() {
            let at = self.tree.nodes.len();
            if let Some((parent, slot)) = place {
                self.tree.nodes[parent].children.0[slot] = at as u32;
            }
            self.tree.nodes.push(EMPTY);
            self.tree.stack = self.tree.stack.max(depth * WIDTH + WIDTH);
            let mut members = Vec::with_capacity(WIDTH);
            if self.is_block(n) {
                members.push(n);
            } else {
                self.gather(n, self.cut.split[n][0], WIDTH as u8, &mut members);
            }
            for (slot, &m) in members.iter().enumerate() {
                let (low, high) = self.bounds[m];
                for axis in 0..3 {
                    self.tree.nodes[at].planes[axis][slot] = low[axis];
                    self.tree.nodes[at].planes[axis + 3][slot] = high[axis];
                }
                if self.is_block(m) {
                    self.tree.nodes[at].children.0[slot] = self.emit_block(m);
                }
            }
            for (slot, &m) in members.iter().enumerate().rev() {
                if !self.is_block(m) {
                    stack.push((m, Some((at, slot)), depth + 1));
                }
            }
        }
    }

    fn is_block(&self, n: usize) -> bool {
        self.binary.nodes[n].is_leaf() || self.cut.split[n][0] == 0
    }

    /// The wide children below `n`, of which `left` are below its left child, of `room` in all.
    fn gather(&self, n: usize, left: u8, room: u8, members: &mut Vec<usize>) {
        let first = self.binary.nodes[n].first_index as usize;
        for (child, room) in [(first, left), (first + 1, room - left)] {
            let mut room = room.max(1);
            while room > 1 && !self.binary.nodes[child].is_leaf() && self.cut.split[child][room as usize - 1] == 0 {
                room -= 1;
            }
            if room == 1 || self.binary.nodes[child].is_leaf() {
                members.push(child);
            } else {
                self.gather(child, self.cut.split[child][room as usize - 1], room, members);
            }
        }
    }

    /// Triangles below a binary node, in the builder's order.
    fn below(&self, n: usize) -> Vec<u32> {
        let mut found = Vec::new();
        let mut stack = vec![n];
        while let Some(n) = stack.pop() {
            let node = &self.binary.nodes[n];
            if node.is_leaf() {
                let first = node.first_index as usize;
                let range = &self.binary.primitive_indices[first..first + node.prim_count as usize];
                found.extend(range.iter().map(|&i| self.kept[i as usize]));
            } else {
                stack.extend([node.first_index as usize + 1, node.first_index as usize]);
            }
        }
        found
    }

    fn emit_block(&mut self, n: usize) -> u32 {
        let below = self.below(n);
        let mut block = Block { corners: [[[0.0; WIDTH]; 3]; 3], triangles: [u32::MAX; WIDTH] };
        for lane in 0..WIDTH {
            let triangle = below.get(lane).copied().unwrap_or(below[0]);
            for (corner, point) in self.corners[triangle as usize].iter().enumerate() {
                for axis in 0..3 {
                    block.corners[corner][axis][lane] = point[axis];
                }
            }
            block.triangles[lane] = triangle;
        }
        let at = self.tree.blocks.len() as u32;
        self.tree.blocks.push(block);
        LEAF | (at << 3) | (below.len() as u32 - 1)
    }
}
