//! The collapses in the order of their cost: one heap entry for each vertex, brought up to date when it surfaces.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::DVec3;

use super::anchor::{FullMesh, Level, vertex_normals};
use super::complex::{Complex, NONE, others};
use super::groups::{Components, PartSets};
use super::input::{Collapse, Costs, Input};
use super::quadric::Quadric;
use translux::geometry::nearest::closest_weights;
use translux::progress::Progress;

/// A sequence of collapses, cut into nested levels.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Hierarchy {
    /// The collapses in order, all levels together.
    pub(crate) collapses: Vec<Collapse>,
    /// From fine to coarse: the references of each level are among those of the one before, and are predicted from it.
    pub(crate) levels: Vec<Level>,
}

impl Hierarchy {
    /// Simplifies to each of `levels` vertices in turn, which should fall.
    ///
    /// A level keeps more vertices than asked where the mesh has more components (at least one vertex of each stays),
    /// and none where it has no triangle. Vertices without a triangle are never references and have no place.
    pub(crate) fn new(input: &Input, costs: &Costs, levels: &[usize], progress: &dyn Progress) -> Self {
        run(input, costs, &[], levels, progress)
    }

    /// Simplifies to the given references alone, by geometry: what a reader who knows the mesh and the references can
    /// do again. A component that holds no reference keeps one vertex, which becomes a reference too.
    pub(crate) fn keeping(input: &Input, references: &[u32], progress: &dyn Progress) -> Self {
        run(input, &Costs::default(), references, &[0], progress)
    }
}

/// Cosine of the largest turn of a triangle's normal in one collapse.
const LEAST_COSINE: f64 = 0.2;
/// A component of so few vertices may fold: its last triangles lie back to back anyway.
const TINY: u32 = 4;
/// Neighbours tried as targets of a vertex, cheapest first; bounds the work at vertices with very many triangles.
const MOST_TARGETS: usize = 16;
/// A vertex that no collapse removes is tried again when this share of its neighbourhood has changed.
const RETRY_SHARE: u32 = 16;
/// Collapses between two reports of progress.
const REPORT: u64 = 4096;

/// What a collapse must not do; later stages are for meshes on which the strict one gets stuck.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    /// Keeps the topology and turns no triangle over.
    Strict,
    /// May pinch the surface.
    Pinching,
    /// Anything goes.
    Free,
}

/// Best collapse of a vertex, as it was when it was looked for.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    onto: u32,
    /// States of the vertex and of its target then.
    states: [u32; 2],
}

const BLOCKED: Candidate = Candidate { onto: NONE, states: [0; 2] };

struct Simplifier<'a> {
    input: Input<'a>,
    costs: Costs<'a>,
    complex: Complex,
    sets: PartSets,
    components: Components,
    quadric: Vec<Quadric>,
    /// Area that a vertex stands for, its own third of each triangle and that of all who collapsed onto it, in mm^2.
    area_mm2: Vec<f64>,
    /// Squared prediction error times area of all who collapsed onto a vertex; empty without a signal.
    carried: Vec<f64>,
    /// On an edge that does not have two triangles.
    border: Vec<bool>,
    /// Unit normal of each vertex of the full mesh.
    normal: Vec<DVec3>,
    /// References that must stay.
    fixed: Vec<bool>,
    /// Grows with every change of a vertex or of its neighbourhood.
    state: Vec<u32>,
    candidate: Vec<Candidate>,
    /// State at which a blocked vertex is tried again.
    retry: Vec<u32>,
    parent: Vec<u32>,
    /// Vertices left.
    left: usize,
    stage: Stage,
    marks: Marks,
    targets: Vec<(f64, u32)>,
    ring: Vec<u32>,
}

/// Two sets of vertices that empty in constant time.
struct Marks {
    ring: Vec<u64>,
    seen: Vec<u64>,
    epoch: u64,
}

impl Marks {
    fn next(&mut self) -> u64 {
        self.epoch += 1;
        self.epoch
    }
}

/// Runs the collapses down to each level; `fixed` vertices stay.
pub(super) fn run(input: &Input, costs: &Costs, fixed: &[u32], levels: &[usize], progress: &dyn Progress) -> Hierarchy {
    let mut simplifier = Simplifier::new(input, costs, fixed);
    let last = levels.iter().copied().min().unwrap_or(usize::MAX);
    progress.start("simplify", simplifier.left.saturating_sub(last) as u64);
    let mut hierarchy = Hierarchy::default();
    let mut heap = simplifier.heap();
    let mut finer: Option<Vec<u32>> = None;
    for &target in levels {
        let first = hierarchy.collapses.len();
        simplifier.reduce(target, &mut heap, &mut hierarchy.collapses, progress);
        let level = Level::new(
            &simplifier.full_mesh(),
            &simplifier.complex,
            &simplifier.parent,
            &hierarchy.collapses[first..],
            finer.as_deref(),
        );
        finer = Some(level.references.clone());
        hierarchy.levels.push(level);
    }
    progress.finish();
    hierarchy
}

type Heap = BinaryHeap<Reverse<(u64, u32)>>;

/// A key whose order is that of the costs.
fn key(cost: f64) -> u64 {
    let cost = if cost.is_finite() { cost.max(0.0) } else { f64::MAX };
    (cost + 0.0).to_bits()
}

impl<'a> Simplifier<'a> {
    fn new(input: &Input<'a>, costs: &Costs<'a>, fixed: &[u32]) -> Self {
        let vertices = input.positions.len();
        let complex = Complex::new(input);
        let mut is_fixed = vec![false; vertices];
        for &v in fixed {
            if let Some(slot) = is_fixed.get_mut(v as usize) {
                *slot = true;
            }
        }
        let signal = costs.signal.filter(|s| {
            s.dimension > 0 && s.weight_mm2 > 0.0 && s.values.len() >= vertices.saturating_mul(s.dimension)
        });
        let mut simplifier = Self {
            input: *input,
            costs: Costs { signal, ..*costs },
            sets: PartSets::new(input, &complex),
            components: Components::new(vertices, &complex),
            left: (0..vertices as u32).filter(|&v| complex.used(v)).count(),
            quadric: vec![Quadric::default(); vertices],
            area_mm2: vec![0.0; vertices],
            carried: if signal.is_some() { vec![0.0; vertices] } else { Vec::new() },
            border: vec![false; vertices],
            normal: vertex_normals(input, &complex),
            fixed: is_fixed,
            state: vec![0; vertices],
            candidate: vec![BLOCKED; vertices],
            retry: vec![0; vertices],
            parent: vec![NONE; vertices],
            stage: Stage::Strict,
            marks: Marks { ring: vec![0; vertices], seen: vec![0; vertices], epoch: 0 },
            targets: Vec::new(),
            ring: Vec::new(),
            complex,
        };
        simplifier.add_triangles();
        simplifier.add_borders();
        simplifier
    }

    fn full_mesh(&self) -> FullMesh<'_> {
        FullMesh { input: self.input, normals: &self.normal, sets: &self.sets }
    }

    fn position(&self, vertex: u32) -> DVec3 {
        self.input.positions[vertex as usize].as_dvec3()
    }

    fn add_triangles(&mut self) {
        for t in 0..self.complex.simplices.len() {
            let corners = self.complex.simplices[t];
            if corners[0] == NONE {
                continue;
            }
            let [a, b, c] = corners.map(|v| self.position(v));
            let cross = (b - a).cross(c - a);
            let area_mm2 = 0.5 * cross.length();
            let plane = Quadric::plane(cross.normalize_or_zero(), a, area_mm2);
            for v in corners {
                self.quadric[v as usize] += plane;
                self.area_mm2[v as usize] += area_mm2 / 3.0;
            }
        }
    }

    /// Holds each edge that does not have two triangles in place by a plane through it, upright on its triangle.
    fn add_borders(&mut self) {
        for v in 0..self.input.positions.len() as u32 {
            // How many triangles each edge from v to a later vertex has.
            let first = self.marks.next() << 32;
            for (_, simplex, slot) in self.complex.around(v) {
                for w in others(simplex, slot) {
                    let count = &mut self.marks.ring[w as usize];
                    *count = if *count > first { *count + 1 } else { first + 1 };
                }
            }
            for (_, simplex, slot) in self.complex.around(v) {
                let [b, c] = others(simplex, slot);
                for (w, far) in [(b, c), (c, b)] {
                    if w < v || self.marks.ring[w as usize] == first + 2 {
                        continue;
                    }
                    let (p, q, r) = (self.position(v), self.position(w), self.position(far));
                    let edge = q - p;
                    let along = edge.normalize_or_zero();
                    let upright = ((r - p) - along * along.dot(r - p)).normalize_or_zero();
                    let plane = Quadric::plane(upright, p, self.costs.border * edge.length_squared());
                    for end in [v, w] {
                        self.quadric[end as usize] += plane;
                        self.border[end as usize] = true;
                    }
                }
            }
        }
        // The counts above use the high half of the numbers.
        self.marks.ring.fill(0);
        self.marks.epoch = 0;
    }

    /// Every vertex that may go, with the cost of its best collapse.
    fn heap(&mut self) -> Heap {
        let mut entries = Vec::new();
        for v in 0..self.input.positions.len() as u32 {
            if self.parent[v as usize] == NONE && self.complex.used(v) && !self.fixed[v as usize] {
                entries.extend(self.evaluate(v).map(|cost| Reverse((key(cost), v))));
            }
        }
        BinaryHeap::from(entries)
    }

    /// Collapses until `target` vertices are left, or nothing can go.
    fn reduce(&mut self, target: usize, heap: &mut Heap, done: &mut Vec<Collapse>, progress: &dyn Progress) {
        let mut unreported = 0;
        while self.left > target {
            let Some(Reverse((_, v))) = heap.pop() else {
                self.stage = match self.stage {
                    Stage::Strict => Stage::Pinching,
                    Stage::Pinching => Stage::Free,
                    Stage::Free => break,
                };
                *heap = self.heap();
                continue;
            };
            if !self.fresh(v) {
                let Some(cost) = self.evaluate(v) else { continue };
                let entry = Reverse((key(cost), v));
                if heap.peek().is_some_and(|next| entry < *next) {
                    heap.push(entry);
                    continue;
                }
            }
            let onto = self.candidate[v as usize].onto;
            self.collapse(v, onto, heap);
            done.push(Collapse { removed: v, onto });
            unreported += 1;
            if unreported == REPORT {
                progress.advance(unreported);
                unreported = 0;
            }
        }
        progress.advance(unreported);
    }

    /// Whether the best collapse of a vertex is what it was when it was looked for.
    fn fresh(&self, v: u32) -> bool {
        let Candidate { onto, states } = self.candidate[v as usize];
        onto != NONE && states == [self.state[v as usize], self.state[onto as usize]]
    }

    /// Finds the best allowed collapse of a vertex and returns its cost.
    fn evaluate(&mut self, v: u32) -> Option<f64> {
        self.complex.clean(v);
        let epoch = self.marks.next();
        let mut targets = std::mem::take(&mut self.targets);
        targets.clear();
        for (_, simplex, slot) in self.complex.around(v) {
            for w in others(simplex, slot) {
                if w != NONE && self.marks.ring[w as usize] != epoch {
                    self.marks.ring[w as usize] = epoch;
                    targets.push((0.0, w));
                }
            }
        }
        for target in &mut targets {
            target.0 = self.cost(v, target.1);
        }
        targets.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let best = targets.iter().take(MOST_TARGETS).copied().find(|&(_, u)| self.allowed(v, u, &targets, epoch));
        self.targets = targets;
        match best {
            Some((cost, onto)) => {
                let states = [self.state[v as usize], self.state[onto as usize]];
                self.candidate[v as usize] = Candidate { onto, states };
                Some(cost)
            }
            None => {
                self.candidate[v as usize] = BLOCKED;
                self.retry[v as usize] = self.state[v as usize] + 1 + self.complex.length(v) / RETRY_SHARE;
                None
            }
        }
    }

    fn cost(&self, v: u32, u: u32) -> f64 {
        let (p, q) = (self.position(v), self.position(u));
        let mut cost = self.quadric[v as usize].at(q) + self.quadric[u as usize].at(q);
        cost += self.costs.spacing * self.area_mm2[v as usize] * p.distance_squared(q);
        if let Some(signal) = &self.costs.signal {
            cost += signal.weight_mm2 * (self.signal_error(v, u) + self.carried[v as usize]);
        }
        cost
    }

    /// Squared difference between the signal of v and its interpolation at the nearest point of the surface that is
    /// left when v has collapsed onto u, times the area that v stands for.
    fn signal_error(&self, v: u32, u: u32) -> f64 {
        let Some(signal) = &self.costs.signal else { return 0.0 };
        let p = self.position(v);
        let mut nearest = (f64::INFINITY, [u; 3], [1.0, 0.0, 0.0]);
        for (_, simplex, slot) in self.complex.around(v) {
            let [b, c] = others(simplex, slot).map(|w| if w == NONE { u } else { w });
            let corners = [u, b, c];
            let places = corners.map(|w| self.position(w));
            let (weights, distance2) = closest_weights(p, places);
            if distance2 < nearest.0 {
                nearest = (distance2, corners, weights);
            }
        }
        let row = |w: u32| &signal.values[w as usize * signal.dimension..][..signal.dimension];
        let (_, [a, b, c], weights) = nearest;
        let rows = row(a).iter().zip(row(b)).zip(row(c)).zip(row(v));
        let square: f64 = rows
            .map(|(((a, b), c), own)| {
                let predicted = weights[0] * f64::from(*a) + weights[1] * f64::from(*b) + weights[2] * f64::from(*c);
                let difference = f64::from(*own) - predicted;
                difference * difference
            })
            .sum();
        square * self.area_mm2[v as usize]
    }

    /// Whether v may collapse onto its neighbour u; `ring` are all neighbours of v, which `epoch` marks.
    fn allowed(&mut self, v: u32, u: u32, ring: &[(f64, u32)], epoch: u64) -> bool {
        self.sets.within(v, u)
            && (self.stage != Stage::Strict || self.keeps_topology(v, u, ring, epoch))
            && (self.stage == Stage::Free || self.components.left(v) <= TINY || self.keeps_orientation(v, u))
    }

    /// The link condition (Dey et al. 1999), with every edge that does not have two triangles taken as a boundary: all
    /// common neighbours are joined to the edge by a triangle, and the edge is no bridge between two boundaries.
    fn keeps_topology(&mut self, v: u32, u: u32, ring: &[(f64, u32)], epoch: u64) -> bool {
        let seen = self.marks.next();
        let (mut triangles, mut opposite) = (0, 0);
        for (_, simplex, slot) in self.complex.around(v) {
            let [b, c] = others(simplex, slot);
            if b != u && c != u {
                continue;
            }
            let far = if b == u { c } else { b };
            if far != NONE {
                triangles += 1;
                if self.marks.seen[far as usize] != seen {
                    self.marks.seen[far as usize] = seen;
                    opposite += 1;
                }
            }
        }
        if triangles == 2 && self.border[v as usize] && self.border[u as usize] {
            return false;
        }
        let mut common = 0;
        if self.complex.length(u) > 4 * self.complex.length(v) + 64 {
            common = ring.iter().filter(|&&(_, w)| w != u && self.complex.joined(w, u, NONE)).count();
        } else {
            let seen = self.marks.next();
            for (_, simplex, slot) in self.complex.around(u) {
                for w in others(simplex, slot) {
                    if w != NONE && self.marks.ring[w as usize] == epoch && self.marks.seen[w as usize] != seen {
                        self.marks.seen[w as usize] = seen;
                        common += 1;
                    }
                }
            }
        }
        common == opposite
    }

    /// Whether no triangle that stays turns over, against where it looked or against the full mesh, or loses its area.
    fn keeps_orientation(&self, v: u32, u: u32) -> bool {
        let (from, to) = (self.position(v), self.position(u));
        self.complex.around(v).all(|(_, simplex, slot)| {
            let [b, c] = others(simplex, slot);
            if b == u || c == u || b == NONE || c == NONE {
                return true;
            }
            let far = self.normal[b as usize] + self.normal[c as usize];
            let (b, c) = (self.position(b), self.position(c));
            let before = (b - from).cross(c - from);
            let after = (b - to).cross(c - to);
            let square = before.length_squared();
            square == 0.0
                || before.dot(after) > LEAST_COSINE * (square * after.length_squared()).sqrt()
                    && (after.dot(far + self.normal[u as usize]) > 0.0
                        || before.dot(far + self.normal[v as usize]) <= 0.0)
        })
    }

    fn collapse(&mut self, v: u32, u: u32, heap: &mut Heap) {
        let error = if self.costs.signal.is_some() { self.signal_error(v, u) + self.carried[v as usize] } else { 0.0 };
        let mut ring = std::mem::take(&mut self.ring);
        ring.clear();
        let epoch = self.marks.next();
        for (_, simplex, slot) in self.complex.around(v) {
            for w in others(simplex, slot) {
                if w != NONE && self.marks.ring[w as usize] != epoch {
                    self.marks.ring[w as usize] = epoch;
                    ring.push(w);
                }
            }
        }
        self.complex.collapse(v, u);
        let (quadric, area_mm2) = (self.quadric[v as usize], self.area_mm2[v as usize]);
        self.quadric[u as usize] += quadric;
        self.area_mm2[u as usize] += area_mm2;
        if let Some(carried) = self.carried.get_mut(u as usize) {
            *carried += error;
        }
        self.border[u as usize] |= self.border[v as usize];
        self.components.remove(v);
        self.parent[v as usize] = u;
        self.left -= 1;
        for &w in &ring {
            self.state[w as usize] += 1;
        }
        for &w in &ring {
            let blocked = self.candidate[w as usize].onto == NONE && !self.fixed[w as usize];
            if blocked && self.state[w as usize] >= self.retry[w as usize] {
                heap.extend(self.evaluate(w).map(|cost| Reverse((key(cost), w))));
            }
        }
        self.ring = ring;
    }
}
