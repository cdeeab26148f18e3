//! Cuts polygons into triangles: the shorter valid diagonal of a quad, ear clipping for more corners.
//!
//! Ear clipping after Meisters 1975, "Polygons have ears"; orientation signs after Shewchuk 1997, "Adaptive precision
//! floating-point arithmetic and fast robust geometric predicates" (error bound of the filter, expansion sums).

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::{DVec2, DVec3};

#[cfg(test)]
mod tests;

/// Largest number of corners that readers may pass on: the cost grows with corners times reflex corners, so that a
/// hostile polygon of this size still takes about a second.
pub const MAX_POLYGON_CORNERS: usize = 16_384;

/// Corners flatter than this (sine of the angle), and points nearer to an edge than this (relative to the extent),
/// count as lying on a line: slivers of rounding error are not made where a better cut exists.
const FLAT: f64 = 1e-12;

/// A diagonal of a quad must be shorter than the other by this much (relative, squared) to win, so that squares whose
/// coordinates were rounded are all cut the same way.
const DIAGONAL_TIE: f64 = 1e-6;

/// Cuts a polygon into triangles that keep its winding.
///
/// Returns `corners.len() - 2` triangles of indices into `corners` (none for fewer than three corners). The polygon is
/// projected along its Newell normal. Simple polygons, also concave ones, ones whose holes are joined to the outline
/// by a doubled edge and slightly non-planar ones, keep their area. A polygon that crosses itself, has no area or has
/// coordinates that are not finite becomes a fan around its first corner.
///
/// The result depends on the input alone. Time is proportional to corners times reflex corners; see
/// [`MAX_POLYGON_CORNERS`].
pub fn triangulate(corners: &[DVec3]) -> Vec<[usize; 3]> {
    let n = corners.len();
    if n < 3 {
        return Vec::new();
    }
    if n == 3 {
        return vec![[0, 1, 2]];
    }
    let Some(local) = normalised(corners) else { return fan(n) };
    let Some(points) = project(&local) else { return fan(n) };
    if n == 4 { quad(&local, &points) } else { clip_ears(&points).unwrap_or_else(|| fan(n)) }
}

fn fan(n: usize) -> Vec<[usize; 3]> {
    (1..n - 1).map(|i| [0, i, i + 1]).collect()
}

/// The power of two that brings `largest` near 1; multiplying by it loses nothing.
fn power_of_two_scale(largest: f64) -> f64 {
    (-largest.log2().floor()).clamp(-1000.0, 1000.0).exp2()
}

/// The corners relative to the first one with an extent near 1, so that no product below over- or underflows.
fn normalised(corners: &[DVec3]) -> Option<Vec<DVec3>> {
    let largest = corners.iter().fold(0.0, |m: f64, c| m.max(c.abs().max_element()));
    if !corners.iter().all(|c| c.is_finite()) || largest == 0.0 {
        return None;
    }
    let scale = power_of_two_scale(largest);
    let first = corners[0] * scale;
    let mut local: Vec<DVec3> = corners.iter().map(|&c| c * scale - first).collect();
    let extent = local.iter().fold(0.0, |m: f64, c| m.max(c.abs().max_element()));
    if extent == 0.0 {
        return None;
    }
    let scale = power_of_two_scale(extent);
    for corner in &mut local {
        *corner *= scale;
    }
    Some(local)
}

/// Coordinates in the plane across the Newell normal, counter-clockwise; none where the polygon has no area.
fn project(local: &[DVec3]) -> Option<Vec<DVec2>> {
    let mut normal = DVec3::ZERO;
    let mut magnitude = 0.0;
    for (i, &a) in local.iter().enumerate() {
        let b = local[(i + 1) % local.len()];
        normal += a.cross(b);
        magnitude += a.length() * b.length();
    }
    let noise = f64::EPSILON * local.len() as f64 * magnitude;
    if normal.length() <= noise {
        return None;
    }
    let normal = normal.normalize();
    // Across the smallest component: for a polygon in a coordinate plane both directions are then exact axes.
    let smallest = normal.abs().min_position();
    let u = DVec3::AXES[smallest].cross(normal).normalize();
    let v = normal.cross(u);
    Some(local.iter().map(|c| DVec2::new(c.dot(u), c.dot(v))).collect())
}

/// Cuts a quad along the shorter diagonal where both lie inside; otherwise along the one whose smaller triangle is
/// larger (the only one inside, for a concave quad).
fn quad(local: &[DVec3], points: &[DVec2]) -> Vec<[usize; 3]> {
    let area = |i: usize, j: usize, k: usize| orient(points[i], points[j], points[k]);
    let worst_02 = area(0, 1, 2).min(area(2, 3, 0));
    let worst_13 = area(1, 2, 3).min(area(3, 0, 1));
    let cut_13 = if worst_02 > FLAT && worst_13 > FLAT {
        let length_02 = local[0].distance_squared(local[2]);
        let length_13 = local[1].distance_squared(local[3]);
        length_13 < length_02 * (1.0 - DIAGONAL_TIE)
    } else {
        worst_13 > worst_02
    };
    if cut_13 { vec![[0, 1, 3], [1, 2, 3]] } else { vec![[0, 1, 2], [0, 2, 3]] }
}

/// Rules for an ear. A polygon starts with the first rule and takes the next one where no ear is left.
#[derive(Clone, Copy, PartialEq)]
enum Rule {
    /// Clearly convex, no other corner in it or near its border.
    Clear,
    /// Convex by the exact sign, no other corner in it or on its border.
    Exact,
    /// Convex or flat, no other corner strictly inside.
    Touching,
}

/// The part of a polygon that is not yet cut, as a doubly linked loop of corners.
struct EarClipper<'a> {
    points: &'a [DVec2],
    rule: Rule,
    next: Vec<usize>,
    previous: Vec<usize>,
    left: usize,
    /// A corner that is surely in the loop.
    entry: usize,
    /// Corners that are flat or reflex, the only ones that can prevent an ear.
    blockers: Vec<usize>,
    is_blocker: Vec<bool>,
    /// Number of each corner's latest entry in `ears`; heap entries with an older stamp are void.
    stamp: Vec<u32>,
    /// Heap of (squared length of the new edge as ordered bits, corner, stamp): short edges first make better
    /// triangles.
    ears: BinaryHeap<Reverse<(u64, usize, u32)>>,
}

/// Triangles of a polygon in the plane; none where it crosses itself.
fn clip_ears(points: &[DVec2]) -> Option<Vec<[usize; 3]>> {
    let n = points.len();
    let mut clipper = EarClipper {
        points,
        rule: Rule::Clear,
        next: (0..n).map(|i| (i + 1) % n).collect(),
        previous: (0..n).map(|i| (i + n - 1) % n).collect(),
        left: n,
        entry: 0,
        blockers: Vec::new(),
        is_blocker: vec![false; n],
        stamp: vec![0; n],
        ears: BinaryHeap::new(),
    };
    let mut triangles = Vec::with_capacity(n - 2);
    for rule in [Rule::Clear, Rule::Exact, Rule::Touching] {
        clipper.start(rule);
        while clipper.left > 3 {
            let Some(ear) = clipper.pop_ear() else { break };
            triangles.push(clipper.clip(ear));
        }
        if clipper.left == 3 {
            let last = clipper.triangle(clipper.entry);
            let [a, b, c] = last.map(|i| points[i]);
            triangles.push(last);
            return (orient(a, b, c) >= -FLAT).then_some(triangles);
        }
    }
    None
}

impl EarClipper<'_> {
    fn triangle(&self, corner: usize) -> [usize; 3] {
        [self.previous[corner], corner, self.next[corner]]
    }

    /// Judges all remaining corners by a new rule.
    fn start(&mut self, rule: Rule) {
        self.rule = rule;
        self.blockers.clear();
        self.ears.clear();
        self.is_blocker.fill(false);
        let mut corners = Vec::with_capacity(self.left);
        let mut corner = self.entry;
        for _ in 0..self.left {
            corners.push(corner);
            corner = self.next[corner];
        }
        for &corner in &corners {
            self.classify(corner);
        }
        for &corner in &corners {
            self.offer(corner);
        }
    }

    /// Twice the signed area at a corner, zero where the rule takes it as flat.
    fn turn(&self, corner: usize) -> f64 {
        let [a, b, c] = self.triangle(corner).map(|i| self.points[i]);
        let turn = orient(a, b, c);
        let flat = self.rule == Rule::Clear && turn.abs() <= FLAT * a.distance(b) * b.distance(c);
        if flat { 0.0 } else { turn }
    }

    fn classify(&mut self, corner: usize) {
        let blocks = self.turn(corner) <= 0.0;
        if blocks != self.is_blocker[corner] {
            self.is_blocker[corner] = blocks;
            if blocks {
                self.blockers.push(corner);
            } else {
                self.blockers.retain(|&b| b != corner);
            }
        }
    }

    /// Enters a corner among the ears if it is one.
    fn offer(&mut self, corner: usize) {
        if self.is_ear(corner) {
            let [a, _, c] = self.triangle(corner);
            let length = self.points[a].distance_squared(self.points[c]);
            self.ears.push(Reverse((length.to_bits(), corner, self.stamp[corner])));
        }
    }

    fn is_ear(&self, corner: usize) -> bool {
        let turn = self.turn(corner);
        let convex = turn > 0.0 || (self.rule == Rule::Touching && turn == 0.0);
        if !convex {
            return false;
        }
        let [a, b, c] = self.triangle(corner).map(|i| self.points[i]);
        let margin = if self.rule == Rule::Clear { FLAT } else { 0.0 };
        let low = a.min(b).min(c) - margin;
        let high = a.max(b).max(c) + margin;
        !self.blockers.iter().any(|&blocker| {
            let p = self.points[blocker];
            // Corners at the same place belong to a doubled edge; what hangs on them is tested on its own.
            let outside = p.x < low.x || p.x > high.x || p.y < low.y || p.y > high.y || p == a || p == b || p == c;
            !outside && self.spoils(p, [a, b, c])
        })
    }

    fn spoils(&self, p: DVec2, [a, b, c]: [DVec2; 3]) -> bool {
        let sides = [(a, b), (b, c), (c, a)].map(|(from, to)| (orient(from, to, p), from.distance(to)));
        match self.rule {
            Rule::Clear => sides.iter().all(|&(side, length)| side >= -FLAT * length),
            Rule::Exact => sides.iter().all(|&(side, _)| side >= 0.0),
            Rule::Touching => sides.iter().all(|&(side, _)| side > 0.0),
        }
    }

    fn pop_ear(&mut self) -> Option<usize> {
        while let Some(Reverse((_, corner, stamp))) = self.ears.pop() {
            if stamp == self.stamp[corner] {
                return Some(corner);
            }
        }
        None
    }

    /// Cuts an ear off. Only its two neighbours can change: a line that was no diagonal of the polygon is none of a
    /// part of it.
    fn clip(&mut self, ear: usize) -> [usize; 3] {
        let triangle = self.triangle(ear);
        let [a, _, c] = triangle;
        self.next[a] = c;
        self.previous[c] = a;
        self.left -= 1;
        self.entry = a;
        self.stamp[ear] += 1;
        if self.is_blocker[ear] {
            self.is_blocker[ear] = false;
            self.blockers.retain(|&b| b != ear);
        }
        for corner in [a, c] {
            self.stamp[corner] += 1;
            self.classify(corner);
        }
        for corner in [a, c] {
            self.offer(corner);
        }
        triangle
    }
}

/// Twice the signed area of a triangle, positive counter-clockwise; its sign is exact (barring underflow).
fn orient(a: DVec2, b: DVec2, c: DVec2) -> f64 {
    // Shewchuk 1997, ccwerrboundA = (3 + 16 u) u with u = 2^-53.
    const ERROR_BOUND: f64 = (3.0 + 16.0 * (f64::EPSILON / 2.0)) * (f64::EPSILON / 2.0);
    let left = (a.x - c.x) * (b.y - c.y);
    let right = (a.y - c.y) * (b.x - c.x);
    let estimate = left - right;
    if estimate.abs() > ERROR_BOUND * (left.abs() + right.abs()) { estimate } else { orient_exact(a, b, c) }
}

/// The leading component of the exact determinant, summed as a non-overlapping expansion.
fn orient_exact(a: DVec2, b: DVec2, c: DVec2) -> f64 {
    let products = [(a.x, b.y), (-a.y, b.x), (b.x, c.y), (-b.y, c.x), (c.x, a.y), (-c.y, a.x)];
    let mut expansion = [0.0f64; 12];
    let mut len = 0;
    for (x, y) in products {
        let high = x * y;
        let low = x.mul_add(y, -high);
        for term in [low, high] {
            let mut carry = term;
            for component in &mut expansion[..len] {
                let sum = carry + *component;
                let virtual_part = sum - carry;
                *component = (carry - (sum - virtual_part)) + (*component - virtual_part);
                carry = sum;
            }
            expansion[len] = carry;
            len += 1;
        }
    }
    expansion.iter().rev().copied().find(|&component| component != 0.0).unwrap_or(0.0)
}
