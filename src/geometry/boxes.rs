//! Axis-aligned boxes in space order with a complete binary tree above them: finds near boxes, boxes along a ray and those nearest to a point.

use std::ops::ControlFlow;

use glam::DVec3;

/// Boxes in one leaf.
const LEAF: usize = 4;

/// An axis-aligned box; `EMPTY` holds nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Aabb {
    pub min: DVec3,
    pub max: DVec3,
}

impl Aabb {
    pub(crate) const EMPTY: Self = Self { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };

    pub(crate) fn of(points: &[DVec3]) -> Self {
        points.iter().fold(Self::EMPTY, |b, &p| b.union(Self { min: p, max: p }))
    }

    pub(crate) fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    pub(crate) fn grown(self, by: f64) -> Self {
        Self { min: self.min - DVec3::splat(by), max: self.max + DVec3::splat(by) }
    }

    pub(crate) fn overlaps(&self, other: &Self) -> bool {
        self.min.cmple(other.max).all() && other.min.cmple(self.max).all()
    }

    pub(crate) fn contains(&self, other: &Self) -> bool {
        self.min.cmple(other.min).all() && other.max.cmple(self.max).all()
    }

    fn distance2(&self, p: DVec3) -> f64 {
        (p - p.clamp(self.min, self.max)).length_squared()
    }

    /// True if the ray `origin + t direction`, 0 <= t <= `t_max`, meets the box; `inverse` is 1 / direction.
    fn meets_ray(&self, origin: DVec3, inverse: DVec3, t_max: f64) -> bool {
        // The slabs of the empty box would span everything.
        if self.min.x > self.max.x {
            return false;
        }
        let a = (self.min - origin) * inverse;
        let b = (self.max - origin) * inverse;
        // A NaN (0 * infinity: the origin lies in a face's plane) counts as inside that slab.
        let near = |a: f64, b: f64| if a.is_nan() || b.is_nan() { f64::NEG_INFINITY } else { a.min(b) };
        let far = |a: f64, b: f64| if a.is_nan() || b.is_nan() { f64::INFINITY } else { a.max(b) };
        let enter = near(a.x, b.x).max(near(a.y, b.y)).max(near(a.z, b.z)).max(0.0);
        let leave = far(a.x, b.x).min(far(a.y, b.y)).min(far(a.z, b.z)).min(t_max);
        // Slabs are computed with rounding: a little slack keeps a ray from slipping between two boxes.
        enter <= leave * (1.0 + 4.0 * f64::EPSILON) + f64::MIN_POSITIVE
    }
}

/// Boxes sorted along a Morton curve under a complete binary tree in heap order.
pub(crate) struct BoxTree {
    items: Vec<(u32, Aabb)>,
    /// Node i has children 2i and 2i + 1; node 0 is unused; leaf l is node `leaves + l`.
    nodes: Vec<Aabb>,
    leaves: usize,
}

impl BoxTree {
    /// A tree over boxes with finite corners; item i of every query is `boxes[i]`.
    pub(crate) fn new(boxes: &[Aabb]) -> Self {
        let whole = boxes.iter().fold(Aabb::EMPTY, |a, &b| a.union(b));
        let size = (whole.max - whole.min).max(DVec3::splat(f64::MIN_POSITIVE));
        let key = |(i, b): (usize, &Aabb)| {
            let unit = (0.5 * (b.min + b.max) - whole.min) / size;
            // A saturating cast: what rounding puts outside lands on the rim.
            let cell = (unit * 1023.0).clamp(DVec3::ZERO, DVec3::splat(1023.0));
            let code = spread(cell.x as u32) | spread(cell.y as u32) << 1 | spread(cell.z as u32) << 2;
            u64::from(code) << 32 | i as u64
        };
        let mut keys: Vec<u64> = boxes.iter().enumerate().map(key).collect();
        keys.sort_unstable();
        let items: Vec<(u32, Aabb)> = keys.into_iter().map(|k| (k as u32, boxes[k as u32 as usize])).collect();
        let leaves = items.len().div_ceil(LEAF).next_power_of_two();
        let mut nodes = vec![Aabb::EMPTY; 2 * leaves];
        for (node, chunk) in nodes[leaves..].iter_mut().zip(items.chunks(LEAF)) {
            *node = chunk.iter().fold(Aabb::EMPTY, |a, (_, b)| a.union(*b));
        }
        for i in (1..leaves).rev() {
            nodes[i] = nodes[2 * i].union(nodes[2 * i + 1]);
        }
        Self { items, nodes, leaves }
    }

    fn leaf_items(&self, node: usize) -> &[(u32, Aabb)] {
        let first = ((node - self.leaves) * LEAF).min(self.items.len());
        &self.items[first..(first + LEAF).min(self.items.len())]
    }

    /// Calls `visit` with each item whose box overlaps `query`, until it breaks.
    pub(crate) fn overlapping(&self, query: &Aabb, mut visit: impl FnMut(u32) -> ControlFlow<()>) -> ControlFlow<()> {
        let mut stack = vec![1usize];
        while let Some(node) = stack.pop() {
            if !self.nodes[node].overlaps(query) {
                continue;
            }
            if node < self.leaves {
                stack.extend([2 * node + 1, 2 * node]);
                continue;
            }
            for (item, bounds) in self.leaf_items(node) {
                if bounds.overlaps(query) {
                    visit(*item)?;
                }
            }
        }
        ControlFlow::Continue(())
    }

    /// Calls `visit` with each pair of items, one of each tree, whose boxes come within `distance`, until it breaks.
    pub(crate) fn near_pairs(
        &self,
        other: &Self,
        distance: f64,
        mut visit: impl FnMut(u32, u32) -> ControlFlow<()>,
    ) -> ControlFlow<()> {
        let mut stack = vec![(1usize, 1usize)];
        while let Some((a, b)) = stack.pop() {
            if !self.nodes[a].grown(distance).overlaps(&other.nodes[b]) {
                continue;
            }
            match (a < self.leaves, b < other.leaves) {
                (true, true) => {
                    for i in [2 * a, 2 * a + 1] {
                        stack.extend([(i, 2 * b), (i, 2 * b + 1)]);
                    }
                }
                (true, false) => stack.extend([(2 * a, b), (2 * a + 1, b)]),
                (false, true) => stack.extend([(a, 2 * b), (a, 2 * b + 1)]),
                (false, false) => {
                    for (i, box_i) in self.leaf_items(a) {
                        let grown = box_i.grown(distance);
                        for (j, box_j) in other.leaf_items(b) {
                            if grown.overlaps(box_j) {
                                visit(*i, *j)?;
                            }
                        }
                    }
                }
            }
        }
        ControlFlow::Continue(())
    }

    /// Calls `visit` with the items of boxes that may be within the squared distance that it returned last, near boxes
    /// first.
    pub(crate) fn towards(&self, p: DVec3, mut visit: impl FnMut(u32) -> f64) {
        let mut limit2 = f64::INFINITY;
        let mut stack = vec![1usize];
        while let Some(node) = stack.pop() {
            if self.nodes[node].distance2(p) > limit2 {
                continue;
            }
            if node < self.leaves {
                let [a, b] = [2 * node, 2 * node + 1];
                let is_first_nearer = self.nodes[a].distance2(p) < self.nodes[b].distance2(p);
                stack.extend(if is_first_nearer { [b, a] } else { [a, b] });
                continue;
            }
            for (item, _) in self.leaf_items(node) {
                limit2 = visit(*item);
            }
        }
    }

    /// Calls `visit` with each item whose box the ray may meet before `t_max`; it returns the `t_max` from there on.
    pub(crate) fn along_ray(
        &self,
        origin: DVec3,
        direction: DVec3,
        mut t_max: f64,
        mut visit: impl FnMut(u32, f64) -> f64,
    ) {
        let inverse = direction.recip();
        let mut stack = [0usize; 64];
        stack[0] = 1;
        let mut size = 1;
        while size > 0 {
            size -= 1;
            let node = stack[size];
            if !self.nodes[node].meets_ray(origin, inverse, t_max) {
                continue;
            }
            if node < self.leaves {
                // At most one entry more for each of the tree's levels, of which there are fewer than 32.
                stack[size] = 2 * node + 1;
                stack[size + 1] = 2 * node;
                size += 2;
                continue;
            }
            for (item, bounds) in self.leaf_items(node) {
                if bounds.meets_ray(origin, inverse, t_max) {
                    t_max = visit(*item, t_max);
                }
            }
        }
    }
}

/// Moves the lowest ten bits to every third place.
fn spread(v: u32) -> u32 {
    let v = (v | v << 16) & 0x0300_00ff;
    let v = (v | v << 8) & 0x0300_f00f;
    let v = (v | v << 4) & 0x030c_30c3;
    (v | v << 2) & 0x0924_9249
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::uniform;

    fn boxes(n: u64, size: f64) -> Vec<Aabb> {
        let coordinate = |i, d| uniform(3, i, d);
        (0..n)
            .map(|i| {
                let min = DVec3::new(coordinate(i, 0), coordinate(i, 1), coordinate(i, 2));
                Aabb { min, max: min + size * coordinate(i, 3) }
            })
            .collect()
    }

    #[test]
    fn queries_find_exactly_what_all_pairs_find() {
        for n in [0, 1, 4, 5, 300] {
            let (a, b) = (boxes(n, 0.2), boxes(n / 2, 0.4));
            let (ta, tb) = (BoxTree::new(&a), BoxTree::new(&b));
            let mut pairs = Vec::new();
            let _ = ta.near_pairs(&tb, 0.05, |i, j| {
                pairs.push((i, j));
                ControlFlow::Continue(())
            });
            pairs.sort_unstable();
            let mut expected = Vec::new();
            for (i, x) in a.iter().enumerate() {
                for (j, y) in b.iter().enumerate() {
                    if x.grown(0.05).overlaps(y) {
                        expected.push((i as u32, j as u32));
                    }
                }
                let mut found = Vec::new();
                let _ = tb.overlapping(&x.grown(0.05), |j| {
                    found.push((i as u32, j));
                    ControlFlow::Continue(())
                });
                found.sort_unstable();
                let row: Vec<_> = expected.iter().copied().filter(|p| p.0 == i as u32).collect();
                assert_eq!(found, row);
            }
            assert_eq!(pairs, expected);
        }
    }

    #[test]
    fn a_ray_visits_every_box_that_it_meets() {
        let boxes = boxes(500, 0.1);
        let tree = BoxTree::new(&boxes);
        for i in 0..50 {
            let direction =
                DVec3::new(uniform(5, i, 0) - 0.5, uniform(5, i, 1) - 0.5, if i % 2 == 0 { 0.0 } else { 1.0 });
            let origin = DVec3::splat(0.5);
            let mut seen = vec![false; boxes.len()];
            tree.along_ray(origin, direction, 10.0, |item, t| {
                seen[item as usize] = true;
                t
            });
            for (b, seen) in boxes.iter().zip(seen) {
                let sampled = (0..2000).any(|k| {
                    let p = origin + direction * (f64::from(k) * 0.005);
                    p.cmpge(b.min).all() && p.cmple(b.max).all()
                });
                assert!(seen || !sampled);
            }
        }
    }
}
