//! Edges of the occluders, and the few of them that can be silhouettes for a group of neighbouring points.

use glam::{DVec3, Vec3};

use crate::geometry::mesh::{EdgeTable, Mesh};
use crate::math::simd::{InstructionSet, multiversion};

/// Edges side by side.
const LANES: usize = 16;

/// Rounding of the 32-bit tests, over the largest coordinate: more than forty roundings.
const SLACK: f32 = 4e-6;

/// Edges in the form that is tested many at a time, positions relative to the mesh's origin in mm.
#[derive(Clone)]
struct Block {
    ends: [[[f32; LANES]; 3]; 2],
    /// Planes (unit normal, distance) of the two triangles, signed so that the edge is none where they agree.
    /// Zero where the edge has not two triangles.
    planes: [[[f32; LANES]; 4]; 2],
    /// Indices of the edges; `u32::MAX` in unused lanes.
    edge: [u32; LANES],
}

impl Block {
    const EMPTY: Self = Self { ends: [[[0.0; LANES]; 3]; 2], planes: [[[0.0; LANES]; 4]; 2], edge: [u32::MAX; LANES] };
}

/// Some edges, in blocks.
#[derive(Clone, Default)]
pub(super) struct Candidates {
    blocks: Vec<Block>,
    count: usize,
}

impl Candidates {
    pub(super) fn clear(&mut self) {
        self.blocks.clear();
        self.count = 0;
    }

    fn push(&mut self, from: &Block, lane: usize) {
        let to = self.count % LANES;
        if to == 0 {
            self.blocks.push(Block::EMPTY);
        }
        if let Some(block) = self.blocks.last_mut() {
            for end in 0..2 {
                for axis in 0..3 {
                    block.ends[end][axis][to] = from.ends[end][axis][lane];
                }
                for k in 0..4 {
                    block.planes[end][k][to] = from.planes[end][k][lane];
                }
            }
            block.edge[to] = from.edge[lane];
        }
        self.count += 1;
    }
}

/// Unit normal and distance from the mesh's origin, mm.
type Plane = (DVec3, f64);

/// An undirected edge: its ends, and a range of [`Occluders::sides`].
#[derive(Clone, Copy)]
pub(super) struct Edge {
    pub(super) ends: [Vec3; 2],
    sides: [u32; 2],
    /// Planes and directions of the sides if there are two, so that they lie beside the ends in memory.
    two: Option<[(Plane, i32); 2]>,
}

/// A triangle at an edge.
#[derive(Clone, Copy)]
struct Side {
    triangle: u32,
    /// +1 if the triangle runs from the first to the second end, else -1.
    direction: i32,
}

/// Triangles of a mesh arranged for [`super::visit`].
pub struct Occluders {
    pub(super) edges: Vec<Edge>,
    sides: Vec<Side>,
    planes: Vec<Plane>,
    pub(super) all: Candidates,
    /// Largest absolute coordinate.
    extent_mm: f32,
    level: InstructionSet,
}

impl Occluders {
    /// Arranges all triangles of a mesh.
    pub fn new(mesh: &Mesh) -> Self {
        let plane = |t: u32| {
            let normal = mesh.normal(t);
            (normal, normal.dot(mesh.corners_local_mm(t)[0]))
        };
        let planes: Vec<Plane> = (0..mesh.triangles.len() as u32).map(plane).collect();
        let extent_mm = mesh.bounds_local_mm().iter().map(|c| c.abs().max_element()).fold(0.0, f64::max) as f32;
        let mut result = Self {
            edges: Vec::new(),
            sides: Vec::new(),
            planes,
            all: Candidates::default(),
            extent_mm,
            level: InstructionSet::detect(),
        };
        for edge in EdgeTable::new(mesh).edges() {
            let first = result.sides.len() as u32;
            result.sides.extend(edge.triangles().map(|(triangle, direction)| Side { triangle, direction }));
            let two = match result.sides[first as usize..] {
                [a, b] => Some([a, b].map(|side| (result.planes[side.triangle as usize], side.direction))),
                _ => None,
            };
            let sides = [first, result.sides.len() as u32];
            result.edges.push(Edge { ends: edge.vertices.map(|v| mesh.local_mm[v as usize]), sides, two });
        }
        for index in 0..result.edges.len() {
            let block = result.block_of(index);
            result.all.push(&block, 0);
        }
        result
    }

    /// The edge in lane 0.
    fn block_of(&self, index: usize) -> Block {
        let mut block = Block::EMPTY;
        let edge = &self.edges[index];
        for (end, at) in edge.ends.iter().enumerate() {
            (0..3).for_each(|axis| block.ends[end][axis][0] = at[axis]);
        }
        if let [a, b] = self.sides_of(edge) {
            for (slot, side, sign) in [(0, a, 1.0), (1, b, -1.0)] {
                let (normal, distance) = self.planes[side.triangle as usize];
                let sign = sign * f64::from(side.direction);
                (0..3).for_each(|axis| block.planes[slot][axis][0] = (sign * normal[axis]) as f32);
                block.planes[slot][3][0] = (sign * distance) as f32;
            }
        }
        block.edge[0] = index as u32;
        block
    }

    fn sides_of(&self, edge: &Edge) -> &[Side] {
        &self.sides[edge.sides[0] as usize..edge.sides[1] as usize]
    }

    /// The change of the number of triangles in a direction across an edge. Each of its triangles counts +1 if it
    /// shows its front and runs from the first end to the second, or neither of the two, else -1.
    ///
    /// The facing of a triangle is decided by one formula for all its edges, so that even where rounding decides it the
    /// boundary of what is covered stays closed.
    pub(super) fn change(&self, edge: &Edge, eye: DVec3) -> i32 {
        let facing =
            |(normal, distance): Plane, direction: i32| if normal.dot(eye) > distance { direction } else { -direction };
        if let Some(two) = edge.two {
            return two.iter().map(|&(plane, direction)| facing(plane, direction)).sum();
        }
        self.sides_of(edge).iter().map(|side| facing(self.planes[side.triangle as usize], side.direction)).sum()
    }

    /// Keeps the edges that may be silhouettes above the horizon of any of the points.
    pub(super) fn narrow(&self, from: &Candidates, group: &Group, into: &mut Candidates, marks: &mut Vec<u16>) {
        into.clear();
        self.for_kept(from, group, marks, |block, lane| into.push(block, lane));
    }

    /// [`Self::narrow`], as indices of the edges only.
    pub(super) fn list(&self, from: &Candidates, group: &Group, into: &mut Vec<u32>, marks: &mut Vec<u16>) {
        into.clear();
        self.for_kept(from, group, marks, |block, lane| into.push(block.edge[lane]));
    }

    fn for_kept(&self, from: &Candidates, group: &Group, marks: &mut Vec<u16>, mut keep: impl FnMut(&Block, usize)) {
        marks.clear();
        marks.resize(from.blocks.len(), 0);
        let slack = SLACK * (self.extent_mm + group.centre.abs().max_element() + group.half.max_element());
        mark(self.level, &from.blocks, group, slack, marks);
        for (block, mask) in from.blocks.iter().zip(marks) {
            while *mask != 0 {
                keep(block, mask.trailing_zeros() as usize % LANES);
                *mask &= *mask - 1;
            }
        }
    }

    /// Bytes held in memory.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.edges[..])
            + size_of_val(&self.sides[..])
            + size_of_val(&self.planes[..])
            + size_of_val(&self.all.blocks[..])
    }
}

/// Bounds of the positions and normals of a group of points.
#[derive(Clone, Copy, Debug)]
pub(super) struct Group {
    centre: Vec3,
    half: Vec3,
    low_normal: Vec3,
    high_normal: Vec3,
    /// Least height of a point's tangent plane over the centre, along its normal.
    least: f32,
}

impl Group {
    /// The group of these points and unit normals; none without points.
    pub(super) fn of(points: impl Iterator<Item = (Vec3, Vec3)> + Clone) -> Option<Self> {
        let first = points.clone().next()?;
        let (mut low, mut high, mut low_normal, mut high_normal) = (first.0, first.0, first.1, first.1);
        for (at, normal) in points.clone() {
            (low, high) = (low.min(at), high.max(at));
            (low_normal, high_normal) = (low_normal.min(normal), high_normal.max(normal));
        }
        let centre = low + 0.5 * (high - low);
        let half = (high - centre).max(centre - low);
        let least = points.map(|(at, normal)| normal.dot(at - centre)).fold(f32::INFINITY, f32::min);
        Some(Self { centre, half, low_normal, high_normal, least })
    }
}

multiversion! {
    /// Sets the bits of the edges to keep in each block.
    fn mark(blocks: &[Block], group: &Group, slack: f32, marks: &mut [u16]) => mark_body
}

#[inline(always)]
fn mark_body(blocks: &[Block], group: &Group, slack: f32, marks: &mut [u16]) {
    let (c, h) = (group.centre.to_array(), group.half.to_array());
    let (low, high) = (group.low_normal.to_array(), group.high_normal.to_array());
    let least = group.least - slack;
    for (block, mark) in blocks.iter().zip(marks) {
        let mut keep = [0u8; LANES];
        for (i, keep) in keep.iter_mut().enumerate() {
            let mut above = [0.0f32; 2];
            for (end, above) in above.iter_mut().enumerate() {
                for axis in 0..3 {
                    let v = block.ends[end][axis][i] - c[axis];
                    let (x, y) = (low[axis] * v, high[axis] * v);
                    *above += if x > y { x } else { y };
                }
            }
            let mut value = [0.0f32; 2];
            let mut spread = [slack; 2];
            for (side, (value, spread)) in value.iter_mut().zip(&mut spread).enumerate() {
                *value = -block.planes[side][3][i];
                for axis in 0..3 {
                    *value += block.planes[side][axis][i] * c[axis];
                    *spread += block.planes[side][axis][i].abs() * h[axis];
                }
            }
            let front = (value[0] > spread[0]) & (value[1] > spread[1]);
            let back = (value[0] < -spread[0]) & (value[1] < -spread[1]);
            let seen = (above[0] > least) | (above[1] > least);
            *keep = u8::from(seen & !front & !back & (block.edge[i] != u32::MAX));
        }
        let halves = [0, 8].map(|from| {
            let byte = |k: usize| u64::from(keep[from + k]) << (8 * k);
            let word = (0..8).fold(0, |word, k| word | byte(k));
            (word.wrapping_mul(0x0102_0408_1020_4080) >> 56) as u16
        });
        *mark = halves[0] | halves[1] << 8;
    }
}
