//! Does anything stand between a point and a light: a box tree by surface areas and Moeller-Trumbore's test.

use super::mesh::OracleMesh;
use super::vector::{V3, cross, dot, sub};

#[derive(Clone, Copy)]
struct Bounds {
    lo: V3,
    hi: V3,
}

impl Bounds {
    const NOTHING: Self = Self { lo: [f64::INFINITY; 3], hi: [f64::NEG_INFINITY; 3] };

    fn with(self, p: V3) -> Self {
        Self { lo: std::array::from_fn(|k| self.lo[k].min(p[k])), hi: std::array::from_fn(|k| self.hi[k].max(p[k])) }
    }

    fn around(self, other: Self) -> Self {
        self.with(other.lo).with(other.hi)
    }

    fn of(corners: [V3; 3]) -> Self {
        corners.into_iter().fold(Self::NOTHING, Self::with)
    }

    /// Half the area of its surface.
    fn area(self) -> f64 {
        let [x, y, z] = sub(self.hi, self.lo);
        x * y + y * z + z * x
    }
}

struct BoxNode {
    bounds: Bounds,
    /// Leaf: first entry of `order`; inner node: the second child (the first follows its parent).
    link: u32,
    /// Triangles of a leaf; 0 in an inner node.
    count: u32,
}

/// From `origin`, a point of a triangle, along `direction` up to the parameter `reach` (in lengths of `direction`; infinite for a
/// direction).
#[derive(Clone, Copy)]
pub struct Ray {
    pub origin: V3,
    pub direction: V3,
    pub reach: f64,
}

/// Bounds of some rays: at the parameter t they are between `lo + t slowest` and `hi + t fastest`, axis by axis.
struct Beam {
    origins: Bounds,
    directions: Bounds,
    /// One over each bound of the directions.
    inverse: Bounds,
    reach: f64,
}

impl Beam {
    fn of(rays: &[Ray]) -> Self {
        let around = |f: &dyn Fn(&Ray) -> V3| rays.iter().map(f).fold(Bounds::NOTHING, Bounds::with);
        let (origins, directions) = (around(&|ray| ray.origin), around(&|ray| ray.direction));
        let inverse = Bounds { lo: directions.lo.map(|d| 1.0 / d), hi: directions.hi.map(|d| 1.0 / d) };
        Self { origins, directions, inverse, reach: rays.iter().map(|ray| ray.reach).fold(0.0, f64::max) }
    }

    /// Whether one of the rays may meet the box. Where a slope is 0, what is compared is infinite, or NaN on the box's own face, which
    /// excludes nothing.
    fn may_meet(&self, bounds: &Bounds) -> bool {
        let (mut enter, mut leave) = (0.0, self.reach);
        for k in 0..3 {
            let below = (bounds.hi[k] - self.origins.lo[k]) * self.inverse.lo[k];
            let above = (bounds.lo[k] - self.origins.hi[k]) * self.inverse.hi[k];
            for (t, is_end) in [(below, self.inverse.lo[k] > 0.0), (above, self.inverse.hi[k] < 0.0)] {
                if is_end && t < leave {
                    leave = t;
                } else if !is_end && t > enter {
                    enter = t;
                }
            }
        }
        enter <= leave
    }
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

/// Beyond this the tree is halved by number, so that its depth is bounded whatever the triangles are.
const DEPTH_BY_AREA: usize = 30;

impl Blockers {
    pub fn new(mesh: &OracleMesh) -> Self {
        let corners: Vec<[V3; 3]> = (0..mesh.triangles.len()).map(|t| mesh.corners(t)).collect();
        let order = (0..corners.len() as u32).collect();
        let mut tree = Self { nodes: Vec::new(), order, corners, nearest_mm: 0.0 };
        if !tree.corners.is_empty() {
            tree.build(0, tree.corners.len(), 0);
            let diagonal = super::vector::distance(tree.nodes[0].bounds.lo, tree.nodes[0].bounds.hi);
            tree.nearest_mm = 1e-10 * diagonal;
            // A slab of no thickness must not be missed through rounding.
            let margin = 1e-9 * diagonal;
            for node in &mut tree.nodes {
                node.bounds.lo = node.bounds.lo.map(|c| c - margin);
                node.bounds.hi = node.bounds.hi.map(|c| c + margin);
            }
            let by_leaf = tree.order.iter().map(|&t| tree.corners[t as usize]).collect();
            tree.corners = by_leaf;
        }
        tree
    }

    fn build(&mut self, begin: usize, end: usize, depth: usize) -> u32 {
        let bounds = |t: &u32| Bounds::of(self.corners[*t as usize]);
        let all = self.order[begin..end].iter().map(bounds).fold(Bounds::NOTHING, Bounds::around);
        let index = self.nodes.len();
        self.nodes.push(BoxNode { bounds: all, link: begin as u32, count: (end - begin) as u32 });
        if end - begin > 3 {
            // The axis and the place with the smallest sum over both sides of their triangles times their area.
            let mut best = (f64::INFINITY, 0, 0);
            for axis in 0..3 {
                self.sort(begin, end, axis);
                let run = &self.order[begin..end];
                let areas = |run: &mut dyn Iterator<Item = &u32>| -> Vec<f64> {
                    run.scan(Bounds::NOTHING, |sum, t| {
                        *sum = sum.around(Bounds::of(self.corners[*t as usize]));
                        Some(sum.area())
                    })
                    .collect()
                };
                let (first, second) = (areas(&mut run.iter()), areas(&mut run.iter().rev()));
                for count in 1..run.len() {
                    let others = run.len() - count;
                    let cost = first[count - 1] * count as f64 + second[others - 1] * others as f64;
                    if depth < DEPTH_BY_AREA && cost < best.0 || count == run.len() / 2 && best.0 == f64::INFINITY {
                        best = (cost, axis, begin + count);
                    }
                }
            }
            let (_, axis, middle) = best;
            self.sort(begin, end, axis);
            self.build(begin, middle, depth + 1);
            let second = self.build(middle, end, depth + 1);
            self.nodes[index].link = second;
            self.nodes[index].count = 0;
        }
        index as u32
    }

    /// Sorts a run of triangles along an axis.
    fn sort(&mut self, begin: usize, end: usize, axis: usize) {
        let corners = &self.corners;
        let key = |t: &u32| corners[*t as usize].iter().map(|p| p[axis]).sum::<f64>();
        self.order[begin..end].sort_unstable_by(|a, b| key(a).total_cmp(&key(b)).then(a.cmp(b)));
    }

    /// Calls `visit` with each leaf that a beam may meet until it says that nothing is left to ask.
    fn for_each_leaf(&self, beam: &Beam, mut visit: impl FnMut(std::ops::Range<usize>) -> bool) {
        let mut stack = [0u32; 128];
        let mut depth = usize::from(!self.nodes.is_empty());
        while depth > 0 {
            depth -= 1;
            let index = stack[depth];
            let node = &self.nodes[index as usize];
            if !beam.may_meet(&node.bounds) {
                continue;
            }
            if node.count == 0 {
                stack[depth] = node.link;
                stack[depth + 1] = index + 1;
                depth += 2;
            } else if !visit(node.link as usize..(node.link + node.count) as usize) {
                return;
            }
        }
    }

    /// Whether a ray from the triangle `own` is free.
    pub fn sees(&self, own: u32, ray: Ray) -> bool {
        self.count_free(own, [ray]) == 1
    }

    /// How many of some rays from the triangle `own` are free. Boxes are tested once for all of them: few leaves are visited in vain
    /// where the rays are near each other.
    pub fn count_free<const N: usize>(&self, own: u32, rays: [Ray; N]) -> usize {
        let nearest = rays.map(|ray| self.nearest_mm / dot(ray.direction, ray.direction).sqrt());
        let mut free: [usize; N] = std::array::from_fn(|i| i);
        let mut count = N;
        self.for_each_leaf(&Beam::of(&rays), |slots| {
            for slot in slots.filter(|slot| self.order[*slot] != own) {
                let mut place = 0;
                while place < count {
                    let i = free[place];
                    if hit(self.corners[slot], rays[i]).is_some_and(|t| t > nearest[i] && t < rays[i].reach) {
                        count -= 1;
                        free.swap(place, count);
                    } else {
                        place += 1;
                    }
                }
            }
            count > 0
        });
        count
    }

    /// The same answer as [`Self::sees`] without the tree.
    pub fn sees_by_loop(&self, own: u32, ray: Ray) -> bool {
        let nearest = self.nearest_mm / dot(ray.direction, ray.direction).sqrt();
        let mut others = (0..self.order.len()).filter(|slot| self.order[*slot] != own);
        !others.any(|slot| hit(self.corners[slot], ray).is_some_and(|t| t > nearest && t < ray.reach))
    }
}

/// Parameter along the ray's direction at which its line meets the triangle.
#[inline]
fn hit(corners: [V3; 3], Ray { origin, direction, .. }: Ray) -> Option<f64> {
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
