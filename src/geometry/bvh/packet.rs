//! Many rays through the tree: neighbours in the slice that are alike walk it as one bundle.
//!
//! A node is tested once for the whole bundle, with intervals for origins and reciprocal directions; only at leaves does
//! each ray look at the box, then at the triangles, on its own. Boxes decide nothing but effort (see the parent module),
//! so the answers are those of single rays.

use super::build::{Children, LEAF, Node, Tree, WIDTH};
use super::lanes::{Lanes, Path, Portable, Slot, on_lanes};
use super::ray::{Query, Ray};
use super::traverse::{self, Except, Nearest, SMALL_STACK};
use super::triangle::Hit;

/// Most rays in a bundle.
const BUNDLE: usize = 2 * WIDTH;
/// Fewer rays than this are faster one by one.
const FEWEST: usize = 4;
/// Least cosine of the angle to the first ray of the bundle.
const LEAST_COSINE: f32 = 0.9;
/// Largest distance from the first ray's origin, over the extent of the scene.
const LARGEST_STEP: f32 = 0.1;
/// Nodes for each ray after which a bundle is given up: single rays visit about this many.
const PATIENCE: usize = 6;

/// See [`super::Bvh::occluded_many`].
pub(super) fn occluded_many(path: Path, tree: &Tree, rays: &[Ray], skip: &[u32], out: &mut [bool]) {
    let count = rays.len().min(skip.len()).min(out.len());
    let (rays, skip, out) = (&rays[..count], &skip[..count], &mut out[..count]);
    let mut at = 0;
    while at < count {
        let length = alike(tree, &rays[at..count.min(at + BUNDLE)]);
        let range = at..at + length;
        bundle_or_single(path, tree, &rays[range.clone()], &skip[range.clone()], &mut out[range]);
        at += length;
    }
}

/// Number of rays, from the first on, that can share a bundle; at least one unless there are none.
fn alike(tree: &Tree, rays: &[Ray]) -> usize {
    let Some(first) = rays.first() else { return 0 };
    let least = LEAST_COSINE * first.direction.length_squared();
    let reach = LARGEST_STEP * tree.extent;
    let same = |ray: &&Ray| {
        first.direction.is_negative_bitmask() == ray.direction.is_negative_bitmask()
            && ray.direction.dot(first.direction) >= least
            && (ray.origin - first.origin).abs().max_element() <= reach
    };
    1 + rays[1..].iter().take_while(same).count()
}

fn bundle_or_single(path: Path, tree: &Tree, rays: &[Ray], skip: &[u32], out: &mut [bool]) {
    if rays.len() >= FEWEST && tree.stack <= SMALL_STACK {
        let mut queries = [const { None }; BUNDLE];
        for (query, ray) in queries.iter_mut().zip(rays) {
            *query = Query::new(ray, tree);
        }
        let (hit, undecided) = walk(path, tree, &queries, skip);
        for (i, out) in out.iter_mut().enumerate() {
            *out = hit >> i & 1 == 1;
            if undecided >> i & 1 == 1
                && let Some(query) = &queries[i % BUNDLE]
            {
                *out = traverse::occluded(path, tree, query, skip[i]);
            }
        }
        return;
    }
    for ((ray, &skip), out) in rays.iter().zip(skip).zip(out) {
        *out = Query::new(ray, tree).is_some_and(|query| traverse::occluded(path, tree, &query, skip));
    }
}

/// See [`super::Bvh::closest_many`].
pub(super) fn closest_many(path: Path, tree: &Tree, rays: &[Ray], out: &mut [Option<Hit>]) {
    let count = rays.len().min(out.len());
    let mut at = 0;
    while at < count {
        let length = alike(tree, &rays[at..count.min(at + BUNDLE)]);
        closest_of_some(path, tree, &rays[at..at + length], &mut out[at..at + length]);
        at += length;
    }
}

fn closest_of_some(path: Path, tree: &Tree, rays: &[Ray], out: &mut [Option<Hit>]) {
    let mut queries = [const { None }; BUNDLE];
    for (query, ray) in queries.iter_mut().zip(rays) {
        *query = Query::new(ray, tree);
    }
    let mut best = [Nearest::NONE; BUNDLE];
    let found = rays.len() >= FEWEST && tree.stack <= SMALL_STACK && nearest(path, tree, &queries, &mut best);
    for ((query, best), out) in queries.iter().zip(&best).zip(out) {
        *out = if found { best.rounded() } else { query.as_ref().and_then(|q| traverse::closest(path, tree, q)) };
    }
}

on_lanes! {
    fn nearest(tree: &Tree, queries: &[Option<Query>; BUNDLE], best: &mut [Nearest; BUNDLE]) -> bool => nearest_with
}

/// The nearest hit of each ray; false where the rays part so much that they are better asked one by one.
#[inline(always)]
fn nearest_with<L: Lanes>(tree: &Tree, queries: &[Option<Query>; BUNDLE], best: &mut [Nearest; BUNDLE]) -> bool {
    let Some(mut bundle) = Bundle::new(queries) else { return false };
    let mut budget = PATIENCE * bundle.valid.count_ones() as usize;
    let mut stack = [(0.0f32, 0u32); SMALL_STACK];
    stack[0] = (f32::NEG_INFINITY, 0);
    let mut len = 1;
    while len > 0 {
        len -= 1;
        let (enter, at) = stack[len];
        if enter > bundle.whole_range[1] {
            continue;
        }
        let node = &tree.nodes[at as usize];
        if budget == 0 {
            return false;
        }
        budget -= 1;
        let (mut mask, enter) = bundle.children::<L>(node);
        let enter = L::to_array(enter);
        // Leaves first, the near ones before the far ones; nodes onto the stack, the nearest on top.
        let leaves = mask & leaves_of(&node.children);
        mask &= !leaves;
        if leaves != 0 {
            visit_leaves::<L>(tree, &mut bundle, node, leaves, &enter, queries, best);
        }
        let floor = len;
        while mask != 0 {
            let child = mask.trailing_zeros() as usize % WIDTH;
            mask &= mask - 1;
            if enter[child] > bundle.whole_range[1] {
                continue;
            }
            traverse::push(&mut stack, floor, &mut len, (enter[child], node.children.0[child]));
        }
    }
    true
}

/// Looks for nearer hits in some leaves of a node, the near ones first.
#[inline(always)]
fn visit_leaves<L: Lanes>(
    tree: &Tree,
    bundle: &mut Bundle,
    node: &Node,
    mut leaves: u32,
    enter: &[f32; WIDTH],
    queries: &[Option<Query>; BUNDLE],
    best: &mut [Nearest; BUNDLE],
) {
    while leaves != 0 {
        let mut child = leaves.trailing_zeros() as usize % WIDTH;
        let mut others = leaves & (leaves - 1);
        while others != 0 {
            let other = others.trailing_zeros() as usize % WIDTH;
            others &= others - 1;
            if enter[other] < enter[child] {
                child = other;
            }
        }
        leaves &= !(1 << child);
        let mut rays = bundle.rays::<L>(node, child);
        if rays == 0 {
            continue;
        }
        while rays != 0 {
            let i = rays.trailing_zeros() as usize % BUNDLE;
            rays &= rays - 1;
            if let Some(query) = &queries[i] {
                traverse::block::<L, _>(tree, query, node.children.0[child] | LEAF, &mut best[i]);
                let limit = &mut bundle.range[1][i / WIDTH][i % WIDTH];
                *limit = limit.min((best[i].t() - query.start) as f32);
            }
        }
        let [low, high] = bundle.range[1];
        bundle.whole_range[1] = low.into_iter().chain(high).fold(f32::NEG_INFINITY, f32::max);
    }
}

/// Rays side by side, and the intervals that hold them all. Unused lanes have an empty range.
struct Bundle {
    inverse: [[[f32; WIDTH]; 2]; 3],
    near_offset: [[[f32; WIDTH]; 2]; 3],
    far_offset: [[[f32; WIDTH]; 2]; 3],
    range: [[[f32; WIDTH]; 2]; 2],
    /// Least and largest reciprocal direction.
    slowest: [f32; 3],
    fastest: [f32; 3],
    /// Grown origin that gives the earliest entry, and the one that gives the latest exit.
    near_origin: [f32; 3],
    far_origin: [f32; 3],
    whole_range: [f32; 2],
    near_planes: [usize; 3],
    far_planes: [usize; 3],
    /// Bits of the rays that can meet anything.
    valid: u32,
}

impl Bundle {
    #[inline(always)]
    fn new(queries: &[Option<Query>; BUNDLE]) -> Option<Self> {
        let lead = queries.iter().flatten().next()?;
        let (near_planes, far_planes) = lead.planes();
        let zero = [[[0.0; WIDTH]; 2]; 3];
        let mut bundle = Self {
            inverse: zero,
            near_offset: zero,
            far_offset: zero,
            range: [[[f32::INFINITY; WIDTH]; 2], [[f32::NEG_INFINITY; WIDTH]; 2]],
            slowest: lead.inverse,
            fastest: lead.inverse,
            near_origin: lead.near_origin,
            far_origin: lead.far_origin,
            whole_range: lead.box_range,
            near_planes,
            far_planes,
            valid: 0,
        };
        for (i, query) in queries.iter().enumerate() {
            let Some(query) = query else { continue };
            if query.negative != lead.negative {
                return None;
            }
            let (half, lane) = (i / WIDTH, i % WIDTH);
            bundle.valid |= 1 << i;
            for axis in 0..3 {
                bundle.inverse[axis][half][lane] = query.inverse[axis];
                bundle.near_offset[axis][half][lane] = query.near_offset[axis];
                bundle.far_offset[axis][half][lane] = query.far_offset[axis];
                bundle.slowest[axis] = bundle.slowest[axis].min(query.inverse[axis]);
                bundle.fastest[axis] = bundle.fastest[axis].max(query.inverse[axis]);
                let (near, far) = (&mut bundle.near_origin[axis], &mut bundle.far_origin[axis]);
                if lead.negative[axis] {
                    (*near, *far) = (near.min(query.near_origin[axis]), far.max(query.far_origin[axis]));
                } else {
                    (*near, *far) = (near.max(query.near_origin[axis]), far.min(query.far_origin[axis]));
                }
            }
            bundle.range[0][half][lane] = query.box_range[0];
            bundle.range[1][half][lane] = query.box_range[1];
            bundle.whole_range[0] = bundle.whole_range[0].min(query.box_range[0]);
            bundle.whole_range[1] = bundle.whole_range[1].max(query.box_range[1]);
        }
        Some(bundle)
    }

    /// Children that any ray of the bundle may meet, and where the first of them could enter.
    #[inline(always)]
    fn children<L: Lanes>(&self, node: &Node) -> (u32, L::V) {
        let mut enter = L::splat(self.whole_range[0]);
        let mut leave = L::splat(self.whole_range[1]);
        for axis in 0..3 {
            let (slow, fast) = (L::splat(self.slowest[axis]), L::splat(self.fastest[axis]));
            let near = L::sub(L::load(&node.planes[self.near_planes[axis]]), L::splat(self.near_origin[axis]));
            let far = L::sub(L::load(&node.planes[self.far_planes[axis]]), L::splat(self.far_origin[axis]));
            enter = L::max(L::min(L::mul(near, slow), L::mul(near, fast)), enter);
            leave = L::min(L::max(L::mul(far, slow), L::mul(far, fast)), leave);
        }
        (L::less_equal(enter, leave), enter)
    }

    /// Rays that may meet one child.
    #[inline(always)]
    fn rays<L: Lanes>(&self, node: &Node, child: usize) -> u32 {
        let mut mask = 0;
        for half in 0..2 {
            let mut enter = L::load(&self.range[0][half]);
            let mut leave = L::load(&self.range[1][half]);
            for axis in 0..3 {
                let inverse = L::load(&self.inverse[axis][half]);
                let near = L::splat(node.planes[self.near_planes[axis]][child]);
                let far = L::splat(node.planes[self.far_planes[axis]][child]);
                enter = L::max(L::mul_sub(near, inverse, L::load(&self.near_offset[axis][half])), enter);
                leave = L::min(L::mul_sub(far, inverse, L::load(&self.far_offset[axis][half])), leave);
            }
            mask |= L::less_equal(enter, leave) << (half * WIDTH);
        }
        mask
    }
}

on_lanes! {
    fn walk(tree: &Tree, queries: &[Option<Query>; BUNDLE], skip: &[u32]) -> (u32, u32) => walk_with
}

/// Bits of the rays that are occluded, and of those that must be asked one by one.
#[inline(always)]
fn walk_with<L: Lanes>(tree: &Tree, queries: &[Option<Query>; BUNDLE], skip: &[u32]) -> (u32, u32) {
    let Some(bundle) = Bundle::new(queries) else { return (0, u32::MAX) };
    let mut open = bundle.valid;
    let mut budget = PATIENCE * open.count_ones() as usize;
    let mut stack = [const { Slot::uninit() }; SMALL_STACK];
    let (mut len, mut at) = (0, 0u32);
    loop {
        let node = &tree.nodes[at as usize];
        let (mut mask, _) = bundle.children::<L>(node);
        let leaves = mask & leaves_of(&node.children);
        mask &= !leaves;
        len = L::push(&mut stack, len, &node.children, mask);
        open &= !hits_in_leaves::<L>(tree, &bundle, node, leaves, open, queries, skip);
        if len == 0 || open == 0 {
            return (bundle.valid & !open, 0);
        }
        if budget == 0 {
            return (bundle.valid & !open, open);
        }
        budget -= 1;
        len -= 1;
        // SAFETY: `push` wrote every entry below the length that it returned.
        at = unsafe { stack[len].assume_init() };
    }
}

#[inline(always)]
fn leaves_of(children: &Children) -> u32 {
    let mut mask = 0;
    for (i, child) in children.0.iter().enumerate() {
        mask |= (child >> 31) << i;
    }
    mask
}

#[inline(always)]
fn hits_in_leaves<L: Lanes>(
    tree: &Tree,
    bundle: &Bundle,
    node: &Node,
    mut leaves: u32,
    mut open: u32,
    queries: &[Option<Query>; BUNDLE],
    skip: &[u32],
) -> u32 {
    let mut hit = 0;
    while leaves != 0 {
        let child = leaves.trailing_zeros() as usize % WIDTH;
        leaves &= leaves - 1;
        let mut rays = bundle.rays::<L>(node, child) & open;
        while rays != 0 {
            let i = rays.trailing_zeros() as usize % BUNDLE;
            rays &= rays - 1;
            if let (Some(query), Some(&skip)) = (&queries[i], skip.get(i))
                && traverse::block::<L, _>(tree, query, node.children.0[child] | LEAF, &mut Except(skip))
            {
                hit |= 1 << i;
                open &= !(1 << i);
            }
        }
    }
    hit
}
