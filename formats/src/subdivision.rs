//! The rule by which samples are made from a mesh: largest patches are cut until there are as many as asked for.
//!
//! Samples that follow it need no sections of their own: a number says them. All that decides is exact (integers, halves and comparisons) or
//! rounded once by an IEEE operation in a stated order, so that the same mesh gives the same samples on every machine.

use std::cmp::{Ordering, Reverse};
use std::collections::BinaryHeap;
use std::ops::Range;

use crate::mesh::Mesh;
use crate::parts::{NO_PART, Parts};
use crate::samples::{Samples, WHOLE_TRIANGLE};

/// Longest path: 30 bisections.
const MAX_DEPTH: u32 = 30;

/// The sum of all areas in the integer unit of areas.
const UNITS: f64 = (1u64 << 52) as f64;

type Point = [f64; 3];

/// What the rule knows of a mesh.
#[derive(Clone, Copy, Debug)]
pub struct Surface<'a> {
    /// Positions without the origin, mm, finite.
    pub positions_mm: &'a [[f32; 3]],
    /// Corners, each below the number of positions.
    pub triangles: &'a [[u32; 3]],
    /// Part of each triangle.
    pub triangle_part: &'a [u32],
}

impl<'a> Surface<'a> {
    /// The surface of a valid mesh with valid parts.
    pub fn new(mesh: &'a Mesh, parts: &'a Parts) -> Self {
        Self { positions_mm: &mesh.positions_mm, triangles: &mesh.triangles, triangle_part: &parts.triangle_part }
    }

    fn corners(&self, triangle: u32) -> [Point; 3] {
        self.triangles[triangle as usize].map(|v| self.positions_mm[v as usize].map(f64::from))
    }

    fn facet_corners(&self, [triangle, path]: [u32; 2]) -> [Point; 3] {
        let mut corners = self.corners(triangle);
        for level in (0..path.checked_ilog2().unwrap_or(0)).rev() {
            corners = halves(corners)[(path >> level & 1) as usize];
        }
        corners
    }
}

fn difference(a: Point, b: Point) -> Point {
    std::array::from_fn(|k| a[k] - b[k])
}

fn square(a: Point) -> f64 {
    a[0] * a[0] + a[1] * a[1] + a[2] * a[2]
}

fn sum([a, b, c]: [Point; 3]) -> Point {
    std::array::from_fn(|k| a[k] + b[k] + c[k])
}

fn area([a, b, c]: [Point; 3]) -> f64 {
    let (u, v) = (difference(b, a), difference(c, a));
    let cross = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    0.5 * square(cross).sqrt()
}

/// The two halves of a triangle, cut at the middle of its longest edge (the first of equals).
fn halves([a, b, c]: [Point; 3]) -> [[Point; 3]; 2] {
    let lengths = [square(difference(b, a)), square(difference(c, b)), square(difference(a, c))];
    let [p, q, r] = if lengths[0] >= lengths[1] && lengths[0] >= lengths[2] {
        [a, b, c]
    } else if lengths[1] >= lengths[2] {
        [b, c, a]
    } else {
        [c, a, b]
    };
    let middle = std::array::from_fn(|k| 0.5 * (p[k] + q[k]));
    [[p, middle, r], [middle, q, r]]
}

/// The samples of the rule: `transfers` tells which parts have any. There are `count`, or one for each part that has
/// triangles where these are more, or fewer where no piece can be cut any more.
pub fn subdivide(surface: &Surface<'_>, transfers: &[bool], count: usize) -> Samples {
    let mut subdivision = Subdivision::new(surface, transfers);
    subdivision.split_until(count);
    subdivision.collect(transfers.len())
}

/// A triangle as clusters see it.
#[derive(Clone, Copy)]
struct Item {
    centroid: Point,
    units: u64,
    triangle: u32,
}

/// A cluster of triangles, or a piece of one.
struct Node {
    /// In units; the halves of a piece have halves of them.
    area: f64,
    content: Content,
    /// The first of two consecutive children, once it is split.
    children: Option<u32>,
}

enum Content {
    /// Some of the items.
    Cluster(Range<u32>),
    Facet([u32; 2]),
}

struct Subdivision {
    items: Vec<Item>,
    nodes: Vec<Node>,
    /// Part of each of the first nodes, which are whole parts.
    roots: Vec<u32>,
}

impl Subdivision {
    fn new(surface: &Surface<'_>, transfers: &[bool]) -> Self {
        let part = |triangle: u32| surface.triangle_part.get(triangle as usize).copied().unwrap_or(NO_PART);
        let mut members = vec![Vec::new(); transfers.len()];
        let mut areas = Vec::new();
        let mut total = 0.0;
        for triangle in 0..surface.triangles.len() as u32 {
            let part = part(triangle) as usize;
            if transfers.get(part) == Some(&true) {
                let area = area(surface.corners(triangle));
                total += area;
                members[part].push((triangle, areas.len()));
                areas.push(area);
            }
        }
        let (mut items, mut nodes, mut roots) = (Vec::with_capacity(areas.len()), Vec::new(), Vec::new());
        for (part, members) in members.iter().enumerate().filter(|(_, members)| !members.is_empty()) {
            let first = items.len() as u32;
            items.extend(members.iter().map(|&(triangle, index)| Item {
                centroid: sum(surface.corners(triangle)).map(|x| x / 3.0),
                // What is not a number becomes 0.
                units: (areas[index] / total * UNITS) as u64,
                triangle,
            }));
            roots.push(part as u32);
            let units: u64 = items[first as usize..].iter().map(|item| item.units).sum();
            let content = Content::Cluster(first..items.len() as u32);
            nodes.push(Node { area: units as f64, content, children: None });
        }
        Self { items, nodes, roots }
    }

    fn split_until(&mut self, count: usize) {
        let own_triangles = count >= self.items.len();
        let candidate = |nodes: &[Node], index: u32| {
            let Node { area, content, .. } = &nodes[index as usize];
            let is_cluster = matches!(content, Content::Cluster(range) if range.len() > 1);
            // Areas are not negative: their bits are in the order of their values.
            (own_triangles && is_cluster, area.to_bits(), Reverse(index))
        };
        let mut heap: BinaryHeap<(bool, u64, Reverse<u32>)> =
            (0..self.nodes.len() as u32).map(|index| candidate(&self.nodes, index)).collect();
        let mut leaves = heap.len();
        while leaves < count {
            let Some((_, _, Reverse(index))) = heap.pop() else { break };
            if let Some(children) = self.split(index) {
                heap.extend(children.map(|child| candidate(&self.nodes, child)));
                leaves += 1;
            }
        }
    }

    fn split(&mut self, index: u32) -> Option<[u32; 2]> {
        let first = u32::try_from(self.nodes.len()).ok().filter(|&first| first < u32::MAX - 2)?;
        let Node { area, content, .. } = &self.nodes[index as usize];
        let children = match content {
            Content::Cluster(range) if range.len() > 1 => {
                let range = range.clone();
                let items = &mut self.items[range.start as usize..range.end as usize];
                let (first, units) = area_median(items, *area as u64);
                let middle = range.start + first;
                let node = |range, area| Node { area, content: Content::Cluster(range), children: None };
                [node(range.start..middle, units as f64), node(middle..range.end, area - units as f64)]
            }
            content => {
                let [triangle, path] = match content {
                    Content::Cluster(range) => [self.items[range.start as usize].triangle, WHOLE_TRIANGLE],
                    Content::Facet(facet) => *facet,
                };
                if path.checked_ilog2()? >= MAX_DEPTH {
                    return None;
                }
                let half = 0.5 * area;
                [0, 1].map(|bit| Node {
                    area: half,
                    content: Content::Facet([triangle, path << 1 | bit]),
                    children: None,
                })
            }
        };
        self.nodes[index as usize].children = Some(first);
        self.nodes.extend(children);
        Some([first, first + 1])
    }

    /// The leaves, depth first.
    fn collect(&self, parts: usize) -> Samples {
        let mut samples =
            Samples { facets: Vec::new(), patch_offsets: vec![0], part_offsets: Vec::with_capacity(parts + 1) };
        for (root, &part) in self.roots.iter().enumerate() {
            samples.part_offsets.resize(part as usize + 1, samples.patch_offsets.len() as u32 - 1);
            let mut stack = vec![root as u32];
            while let Some(index) = stack.pop() {
                let node = &self.nodes[index as usize];
                if let Some(first) = node.children {
                    stack.extend([first + 1, first]);
                    continue;
                }
                match &node.content {
                    Content::Cluster(range) => {
                        let first = samples.facets.len();
                        let items = &self.items[range.start as usize..range.end as usize];
                        samples.facets.extend(items.iter().map(|item| [item.triangle, WHOLE_TRIANGLE]));
                        samples.facets[first..].sort_unstable();
                    }
                    Content::Facet(facet) => samples.facets.push(*facet),
                }
                samples.patch_offsets.push(samples.facets.len() as u32);
            }
        }
        samples.part_offsets.resize(parts + 1, samples.patch_offsets.len() as u32 - 1);
        samples
    }
}

/// The axis along which points extend farthest, the first of equals.
fn longest_axis(points: impl Iterator<Item = Point>) -> usize {
    let none = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    let (low, high) = points.fold(none, |(low, high), p| {
        (std::array::from_fn(|k| low[k].min(p[k])), std::array::from_fn(|k| high[k].max(p[k])))
    });
    let extent = difference(high, low);
    let first = usize::from(extent[1] > extent[0]);
    if extent[2] > extent[first] { 2 } else { first }
}

/// Along an axis, then by index; zeros of both signs are equal.
fn along(axis: usize, (a, i): (&Point, u32), (b, j): (&Point, u32)) -> Ordering {
    // The sum makes a positive zero of a negative one.
    (a[axis] + 0.0).total_cmp(&(b[axis] + 0.0)).then(i.cmp(&j))
}

/// Puts items, of `total` units, along their longest axis, as far as needed, and returns how many of them come first, and
/// their units: those before the one with which half of the area is exceeded, and this one, but not all.
fn area_median(items: &mut [Item], total: u64) -> (u32, u64) {
    let axis = longest_axis(items.iter().map(|item| item.centroid));
    let (mut low, mut high, mut before) = (0, items.len(), 0);
    while high - low > 1 {
        let k = (high - low) / 2;
        items[low..high]
            .select_nth_unstable_by(k, |a, b| along(axis, (&a.centroid, a.triangle), (&b.centroid, b.triangle)));
        let left: u64 = items[low..low + k].iter().map(|item| item.units).sum();
        if 2 * (before + left) > total {
            high = low + k;
        } else {
            before += left;
            low += k;
        }
    }
    // The item at `low` is in its place.
    if low + 1 < items.len() { (low as u32 + 1, before + items[low].units) } else { (low as u32, before) }
}

/// The same samples with those of each part in the order of a balanced tree: halves by number along the longest axis of
/// their centres, the first half the larger one.
pub fn in_tree_order(surface: &Surface<'_>, samples: &Samples) -> Samples {
    let patch = |i: usize| &samples.facets[samples.patch_offsets[i] as usize..samples.patch_offsets[i + 1] as usize];
    let mut order: Vec<(Point, u32)> =
        (0..samples.patch_count()).map(|i| (centre(surface, patch(i)), i as u32)).collect();
    for part in samples.part_offsets.windows(2) {
        sort(&mut order[part[0] as usize..part[1] as usize]);
    }
    let mut result = Samples {
        facets: Vec::with_capacity(samples.facets.len()),
        patch_offsets: Vec::with_capacity(samples.patch_offsets.len()),
        part_offsets: samples.part_offsets.clone(),
    };
    result.patch_offsets.push(0);
    for (_, i) in order {
        result.facets.extend_from_slice(patch(i as usize));
        result.patch_offsets.push(result.facets.len() as u32);
    }
    result
}

/// Area-weighted centroid; the origin where there is no area.
fn centre(surface: &Surface<'_>, facets: &[[u32; 2]]) -> Point {
    let (mut moment, mut total) = ([0.0; 3], 0.0);
    for facet in facets {
        let corners = surface.facet_corners(*facet);
        let area = area(corners);
        let sum = sum(corners);
        moment = std::array::from_fn(|k| moment[k] + area / 3.0 * sum[k]);
        total += area;
    }
    if total > 0.0 { moment.map(|x| x / total) } else { [0.0; 3] }
}

fn sort(order: &mut [(Point, u32)]) {
    if order.len() <= 1 {
        return;
    }
    let half = order.len().div_ceil(2);
    let axis = longest_axis(order.iter().map(|(centre, _)| *centre));
    if half < order.len() {
        order.select_nth_unstable_by(half, |a, b| along(axis, (&a.0, a.1), (&b.0, b.1)));
    }
    let (first, second) = order.split_at_mut(half);
    sort(first);
    sort(second);
}
