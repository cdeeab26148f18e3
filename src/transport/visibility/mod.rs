//! Visibility from a point of the surface: one bit, as by one ray, for each sub-texel of a cube map above its horizon.
//!
//! The number of triangles in a direction changes only across edges, by the sum of what the edge's triangles change: 2
//! or 0 where two triangles meet (0 unless they face the point differently), 1 at a boundary, anything where more meet.
//! So the edges that matter are found (silhouettes, a few hundred of 100,000) and entered where they cross the column
//! lines of the cube map; running sums from a pole above the horizon then give the number of triangles in every sub-texel
//! up to one constant for each of the two sets of columns. Where the number is least it is either zero everywhere or
//! nowhere, which one ray decides. No closed surface, orientation or manifold edge is assumed; surfaces may intersect.
//!
//! Silhouettes are found for groups of neighbouring points at once, each list from that of a larger group, by testing
//! edges many at a time: whether the triangles may face differently from anywhere in the box of the group, and whether
//! an end is above any of the horizons. The answer of a point does not depend on its group.
//!
//! # What was tried
//!
//! On a closed bunny of 69,666 triangles with 131,072 samples, M sub-texels/s and core: bundles of one ray each 16; this 195
//! (595 with four times as many sub-texels). Marking the sub-texels that silhouettes touch, with one ray for each of them
//! and one for each connected rest, needs hundreds of rays for a point, where counting needs two. A tree of edges with
//! cones of normals was not needed: lists from lists of larger groups take 5 % of the time.

mod count;
mod edges;

use glam::{DVec3, Vec3};

use self::count::{Counts, RINGS, Ring, View};
use self::edges::{Candidates, Group};
use crate::geometry::bvh::{Bvh, Ray, offset_origin};
use crate::geometry::mesh::Mesh;
use crate::geometry::samples::{Facet, area};
use crate::math::cube_map::FACES;
use crate::math::simd::InstructionSet;

pub use self::edges::Occluders;

/// A point of the surface that looks around.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Observer {
    /// Origin of rays: off the surface (see [`offset_origin`]), relative to the mesh's origin, mm.
    pub eye: Vec3,
    /// Geometric unit normal.
    pub normal: DVec3,
    /// The triangle it lies on, which its rays skip.
    pub triangle: u32,
}

impl Observer {
    /// The centroid of the facet in the middle of a patch's area.
    pub fn of(mesh: &Mesh, facets: &[Facet]) -> Self {
        let area = |facet: &Facet| area(facet.corners_local_mm(mesh));
        let half = 0.5 * facets.iter().map(area).sum::<f64>();
        let mut passed = 0.0;
        let middle = facets.iter().find(|facet| {
            passed += area(facet);
            passed >= half
        });
        let Some(facet) = middle.or(facets.last()) else { return Self::default() };
        let normal = mesh.normal(facet.triangle);
        let at = facet.corners_local_mm(mesh).iter().sum::<DVec3>() / 3.0;
        Self { eye: offset_origin(at.as_vec3(), normal.as_vec3()), normal, triangle: facet.triangle }
    }

    /// The shadow ray in a direction.
    pub fn ray(&self, direction: DVec3) -> Ray {
        Ray::new(self.eye, direction.as_vec3())
    }
}

/// Sub-texels along each edge of a face.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Resolution {
    /// 64, for faces of 32 texels.
    Sub64,
    /// 128, for faces of 64 texels.
    Sub128,
}

impl Resolution {
    /// Sub-texels along an edge of a face.
    pub const fn side(self) -> usize {
        match self {
            Self::Sub64 => 64,
            Self::Sub128 => 128,
        }
    }

    /// 64-bit words of a row.
    pub const fn words(self) -> usize {
        self.side() / 64
    }
}

/// The visibility of one point.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Visible {
    /// Resolution of the cube map.
    pub resolution: Resolution,
    /// Sub-texels above the horizon (`n.w > 0` at the centre), row by row, faces in order: column `x` of a row is bit
    /// `x % 64` of its word `x / 64`.
    pub above: Vec<u64>,
    /// Sub-texels above the horizon that nothing hides.
    pub seen: Vec<u64>,
}

impl Visible {
    fn new(resolution: Resolution) -> Self {
        let words = FACES * resolution.side() * resolution.words();
        Self { resolution, above: vec![0; words], seen: vec![0; words] }
    }

    /// Words of one row.
    fn row(&self, face: usize, row: usize) -> std::ops::Range<usize> {
        let (side, words) = (self.resolution.side(), self.resolution.words());
        let first = (face * side + row) * words;
        first..first + words
    }

    /// True if a bit of `above` or `seen` is set.
    pub fn bit(&self, bits: &[u64], face: usize, x: usize, y: usize) -> bool {
        bits[self.row(face, y)][x / 64] >> (x % 64) & 1 == 1
    }

    /// Number of sub-texels above the horizon.
    pub fn decisions(&self) -> u64 {
        self.above.iter().map(|word| u64::from(word.count_ones())).sum()
    }
}

/// Points in the largest group: enough to look through all edges once for it.
pub const GROUP: usize = 1024;
/// Number of groups that a group is cut in.
const CUTS: usize = 8;
/// Size at most of the groups whose points are treated one by one.
const SMALLEST: usize = 16;

/// Calls `each` with the visibility of each observer, in their order. Neighbours in the slice should be neighbours in
/// space, and several multiples of [`GROUP`] are a good length; neither changes an answer.
pub fn visit(
    occluders: &Occluders,
    bvh: &Bvh,
    observers: &[Observer],
    resolution: Resolution,
    mut each: impl FnMut(usize, &Visible),
) {
    let mut walk = Walk {
        occluders,
        bvh,
        level: InstructionSet::detect(),
        lists: Vec::new(),
        marks: Vec::new(),
        edges: Vec::new(),
        changes: Vec::new(),
        counts: Counts::new(resolution.side()),
        visible: Visible::new(resolution),
    };
    for (index, group) in observers.chunks(GROUP).enumerate() {
        walk.group(&occluders.all, group, index * GROUP, &mut each);
    }
}

struct Walk<'a> {
    occluders: &'a Occluders,
    bvh: &'a Bvh,
    level: InstructionSet,
    /// Spare lists.
    lists: Vec<Candidates>,
    marks: Vec<u16>,
    edges: Vec<u32>,
    /// Ends of the silhouette edges, relative to the eye, and the change of the count across them.
    changes: Vec<([Vec3; 2], i32)>,
    counts: Counts,
    visible: Visible,
}

fn group_of(observers: &[Observer]) -> Option<Group> {
    Group::of(observers.iter().map(|o| (o.eye, o.normal.as_vec3())))
}

impl Walk<'_> {
    fn group(
        &mut self,
        from: &Candidates,
        observers: &[Observer],
        first: usize,
        each: &mut impl FnMut(usize, &Visible),
    ) {
        let Some(group) = group_of(observers) else { return };
        let mut list = self.lists.pop().unwrap_or_default();
        self.occluders.narrow(from, &group, &mut list, &mut self.marks);
        if observers.len() <= SMALLEST {
            for (i, observer) in observers.iter().enumerate() {
                self.point(&list, observer);
                each(first + i, &self.visible);
            }
        } else {
            let size = observers.len().div_ceil(CUTS).max(SMALLEST);
            for (i, part) in observers.chunks(size).enumerate() {
                self.group(&list, part, first + i * size, each);
            }
        }
        self.lists.push(list);
    }

    /// Fills `self.visible`.
    fn point(&mut self, from: &Candidates, observer: &Observer) {
        self.visible.above.fill(0);
        self.visible.seen.fill(0);
        let Some(group) = group_of(std::slice::from_ref(observer)) else { return };
        self.occluders.list(from, &group, &mut self.edges, &mut self.marks);
        let eye = observer.eye.as_dvec3();
        self.changes.clear();
        for &index in &self.edges {
            let edge = &self.occluders.edges[index as usize];
            let change = self.occluders.change(edge, eye);
            if change != 0 {
                self.changes.push((edge.ends.map(|end| end - observer.eye), change));
            }
        }
        for ring in &RINGS {
            let view = View::new(ring, observer.normal);
            for (ends, change) in &self.changes {
                self.counts.add(&view, *ends, *change);
            }
            let least = self.counts.sum(self.level, &view);
            self.bits(ring, &view, least, observer);
        }
    }

    /// Sets the bits of a ring: above the horizon, and seen (where the count is least, if a ray there meets nothing).
    fn bits(&mut self, ring: &Ring, view: &View, least: i16, observer: &Observer) {
        let (side, count) = (self.visible.resolution.side(), self.visible.resolution.words());
        let mut free = false;
        for (q, quarter) in ring.quarters.iter().enumerate().filter(|(q, _)| view.active[*q]) {
            let Some(quarter) = quarter else { continue };
            let mut best = (0, 0, 0);
            self.counts.take_equal(self.level, q, least);
            for (row, (bounds, words)) in self.counts.bounds(q).iter().zip(self.counts.words.chunks(count)).enumerate()
            {
                let above = range_bits(bounds.map(|column| column as usize));
                let mut seen = [0; 2];
                seen.iter_mut().zip(words).zip(above).for_each(|((seen, word), above)| *seen = word & above);
                let (length, column) = longest_run(&seen, best.0);
                if length > best.0 {
                    best = (length, row, column);
                }
                let row = if view.flipped == quarter.turned { row } else { side - 1 - row };
                let at = self.visible.row(quarter.face, row);
                self.visible.above[at.clone()].copy_from_slice(&turn(above, quarter.turned, count)[..count]);
                self.visible.seen[at].copy_from_slice(&turn(seen, quarter.turned, count)[..count]);
            }
            // The middle of the longest run is far from every edge, where no rounding matters.
            if !free && best.0 > 0 {
                let direction = view.direction(side, q, best.1, best.2);
                free = !self.bvh.occluded(&observer.ray(direction), observer.triangle);
            }
        }
        if free {
            return;
        }
        for quarter in ring.quarters.iter().flatten() {
            let (from, end) = (self.visible.row(quarter.face, 0).start, self.visible.row(quarter.face, side - 1).end);
            self.visible.seen[from..end].fill(0);
        }
    }
}

/// Bits of a range of columns.
fn range_bits([low, high]: [usize; 2]) -> [u64; 2] {
    let below = |end: usize| if end >= 64 { u64::MAX } else { (1 << end) - 1 };
    let word = |first: usize| below(high.saturating_sub(first)) & !below(low.saturating_sub(first));
    if low >= high { [0; 2] } else { [word(0), word(64)] }
}

/// The columns, in reverse order if turned.
fn turn(words: [u64; 2], turned: bool, count: usize) -> [u64; 2] {
    match (turned, count) {
        (false, _) => words,
        (true, 1) => [words[0].reverse_bits(), 0],
        (true, _) => [words[1].reverse_bits(), words[0].reverse_bits()],
    }
}

/// Length and middle of the longest run of ones inside a word, if it is longer than `least`.
fn longest_run(words: &[u64], least: usize) -> (usize, usize) {
    let mut best = (least, 0);
    for (index, &word) in words.iter().enumerate() {
        // What is left has a run of one more than the shifts.
        let mut rest = word;
        let mut have = 1;
        while have <= best.0 && rest != 0 {
            let shift = have.min(best.0 + 1 - have);
            rest &= rest >> shift;
            have += shift;
        }
        let (mut last, mut length) = (0, have - 1);
        while rest != 0 {
            (last, length) = (rest, length + 1);
            rest &= rest >> 1;
        }
        if last != 0 && length > best.0 {
            best = (length, 64 * index + last.trailing_zeros() as usize + length / 2);
        }
    }
    best
}

#[cfg(test)]
mod tests;
