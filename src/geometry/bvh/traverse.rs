//! One ray through the tree.

use super::build::{LEAF, Tree, WIDTH};
use super::lanes::{Lanes, Path, Portable, Slot, on_lanes};
use super::ray::Query;
use super::triangle::{ExactHit, Hit, NO_TRIANGLE, candidates, exact};

/// Entries of a stack that needs no allocation; deeper trees take a `Vec`.
pub(super) const SMALL_STACK: usize = 256;

/// Entries of the smaller stack of a search for the closest hit: it is cleared for every ray, which short rays feel.
const CLEARED_STACK: usize = 96;

/// No block has this number: there are fewer than 2^28.
const NOTHING: u32 = u32::MAX;

/// A query in registers.
struct Wide<L: Lanes> {
    inverse: [L::V; 3],
    near_offset: [L::V; 3],
    far_offset: [L::V; 3],
    near_planes: [usize; 3],
    far_planes: [usize; 3],
}

impl<L: Lanes> Wide<L> {
    #[inline(always)]
    fn new(query: &Query) -> Self {
        let (near_planes, far_planes) = query.planes();
        Self {
            inverse: splat3::<L>(query.inverse),
            near_offset: splat3::<L>(query.near_offset),
            far_offset: splat3::<L>(query.far_offset),
            near_planes,
            far_planes,
        }
    }

    /// Bits of the boxes, of eight, that the ray may meet between `t_min` and `t_max`, and the entry distances.
    #[inline(always)]
    fn boxes(&self, planes: &[[f32; WIDTH]; 6], t_min: L::V, t_max: L::V) -> (u32, L::V) {
        let enter = L::max(self.near(planes, 0), L::max(self.near(planes, 1), L::max(self.near(planes, 2), t_min)));
        let leave = L::min(self.far(planes, 0), L::min(self.far(planes, 1), L::min(self.far(planes, 2), t_max)));
        (L::less_equal(enter, leave), enter)
    }

    #[inline(always)]
    fn near(&self, planes: &[[f32; WIDTH]; 6], axis: usize) -> L::V {
        L::mul_sub(L::load(&planes[self.near_planes[axis]]), self.inverse[axis], self.near_offset[axis])
    }

    #[inline(always)]
    fn far(&self, planes: &[[f32; WIDTH]; 6], axis: usize) -> L::V {
        L::mul_sub(L::load(&planes[self.far_planes[axis]]), self.inverse[axis], self.far_offset[axis])
    }
}

#[inline(always)]
fn splat3<L: Lanes>([x, y, z]: [f32; 3]) -> [L::V; 3] {
    [L::splat(x), L::splat(y), L::splat(z)]
}

/// Visitor of the hits of a ray.
pub(super) trait Visit {
    /// True if a hit with this triangle is of interest; asked before the hit is worked out.
    fn wants(&self, triangle: u32) -> bool;
    /// Takes a hit; true ends the search.
    fn take(&mut self, hit: ExactHit, triangle: u32) -> bool;
}

/// Visitor that ends at the first hit with any triangle but one.
pub(super) struct Except(pub u32);

impl Visit for Except {
    #[inline(always)]
    fn wants(&self, triangle: u32) -> bool {
        triangle != self.0
    }
    #[inline(always)]
    fn take(&mut self, _: ExactHit, _: u32) -> bool {
        true
    }
}

/// Visitor that passes every hit to a function.
struct Every<F>(F);

impl<F: FnMut(Hit)> Visit for Every<F> {
    #[inline(always)]
    fn wants(&self, _: u32) -> bool {
        true
    }
    #[inline(always)]
    fn take(&mut self, hit: ExactHit, triangle: u32) -> bool {
        (self.0)(hit.rounded(triangle));
        false
    }
}

/// True if the ray meets a triangle other than `skip`.
pub(super) fn occluded(path: Path, tree: &Tree, query: &Query, skip: u32) -> bool {
    any(path, tree, query, &mut Except(skip))
}

/// Calls `visit` with every hit of the ray.
pub(super) fn crossings(path: Path, tree: &Tree, query: &Query, visit: impl FnMut(Hit)) {
    any(path, tree, query, &mut Every(visit));
}

on_lanes! { fn any<V>(tree: &Tree, query: &Query, visit: &mut V) -> bool => any_with }

#[inline(always)]
fn any_with<L: Lanes, V: Visit>(tree: &Tree, query: &Query, visit: &mut V) -> bool {
    if tree.stack <= SMALL_STACK {
        return any_on_stack::<L, V>(tree, query, &mut [const { Slot::uninit() }; SMALL_STACK], visit);
    }
    any_on_stack::<L, V>(tree, query, &mut vec![Slot::uninit(); tree.stack], visit)
}

#[inline(always)]
fn any_on_stack<L: Lanes, V: Visit>(tree: &Tree, query: &Query, stack: &mut [Slot], visit: &mut V) -> bool {
    let wide = Wide::<L>::new(query);
    let (t_min, t_max) = (L::splat(query.box_range[0]), L::splat(query.box_range[1]));
    let mut len = 0;
    let mut at = 0;
    loop {
        // The first child that is hit stays in a register; its way over the stack would be the longest wait here.
        while at & LEAF == 0 {
            let node = &tree.nodes[at as usize];
            let (mask, _) = wide.boxes(&node.planes, t_min, t_max);
            if mask == 0 {
                at = NOTHING;
                break;
            }
            at = node.children.0[mask.trailing_zeros() as usize % WIDTH];
            len = L::push(stack, len, &node.children, mask & (mask - 1));
        }
        if at != NOTHING && block::<L, V>(tree, query, at, visit) {
            return true;
        }
        if len == 0 {
            return false;
        }
        len -= 1;
        // SAFETY: `push` wrote every entry below the length that it returned.
        at = unsafe { stack[len].assume_init() };
    }
}

#[inline(always)]
pub(super) fn block<L: Lanes, V: Visit>(tree: &Tree, query: &Query, leaf: u32, visit: &mut V) -> bool {
    let block = &tree.blocks[((leaf & !LEAF) >> 3) as usize];
    let mut mask = candidates::<L>(block, query, (leaf & 7) + 1);
    while mask != 0 {
        let lane = mask.trailing_zeros() as usize % WIDTH;
        mask &= mask - 1;
        let triangle = block.triangles[lane];
        if visit.wants(triangle)
            && let Some(hit) = exact(block, lane, query)
            && visit.take(hit, triangle)
        {
            return true;
        }
    }
    false
}

/// The nearest hit so far.
#[derive(Clone, Copy)]
pub(super) struct Nearest {
    hit: ExactHit,
    triangle: u32,
}

impl Nearest {
    /// None so far.
    pub(super) const NONE: Self = Self { hit: ExactHit { t: f64::INFINITY, u: 0.0, v: 0.0 }, triangle: NO_TRIANGLE };

    /// Its distance from the ray's own origin; infinite for none.
    #[inline(always)]
    pub(super) fn t(&self) -> f64 {
        self.hit.t
    }

    /// The hit in single precision, `None` if there is none.
    #[inline]
    pub(super) fn rounded(&self) -> Option<Hit> {
        (self.triangle != NO_TRIANGLE).then(|| self.hit.rounded(self.triangle))
    }
}

impl Visit for Nearest {
    #[inline(always)]
    fn wants(&self, _: u32) -> bool {
        true
    }
    #[inline(always)]
    fn take(&mut self, hit: ExactHit, triangle: u32) -> bool {
        if (hit.t, triangle) < (self.hit.t, self.triangle) {
            (self.hit, self.triangle) = (hit, triangle);
        }
        false
    }
}

on_lanes! {
    /// The nearest hit; of equal ones, the lowest triangle.
    pub(super) fn closest(tree: &Tree, query: &Query) -> Option<Hit> => closest_with
}

#[inline(always)]
fn closest_with<L: Lanes>(tree: &Tree, query: &Query) -> Option<Hit> {
    if tree.stack <= CLEARED_STACK {
        return closest_on_stack::<L>(tree, query, &mut [(0.0, 0); CLEARED_STACK]);
    }
    if tree.stack <= SMALL_STACK {
        return closest_on_stack::<L>(tree, query, &mut [(0.0, 0); SMALL_STACK]);
    }
    closest_on_stack::<L>(tree, query, &mut vec![(0.0, 0); tree.stack])
}

#[inline(always)]
fn closest_on_stack<L: Lanes>(tree: &Tree, query: &Query, stack: &mut [(f32, u32)]) -> Option<Hit> {
    let wide = Wide::<L>::new(query);
    let t_min = L::splat(query.box_range[0]);
    let mut t_max = query.box_range[1];
    let mut best = Nearest::NONE;
    stack[0] = (f32::NEG_INFINITY, 0);
    let mut len = 1;
    while len > 0 {
        len -= 1;
        let (enter, top) = stack[len];
        if enter > t_max {
            continue;
        }
        if top & LEAF != 0 {
            block::<L, _>(tree, query, top, &mut best);
            t_max = t_max.min((best.hit.t - query.start) as f32);
            continue;
        }
        let node = &tree.nodes[top as usize];
        let (mut mask, enter) = wide.boxes(&node.planes, t_min, L::splat(t_max));
        let enter = L::to_array(enter);
        let floor = len;
        while mask != 0 {
            let child = mask.trailing_zeros() as usize % WIDTH;
            mask &= mask - 1;
            push(stack, floor, &mut len, (enter[child], node.children.0[child]));
        }
    }
    best.rounded()
}

/// Pushes a child so that those of one node, from `floor` on, lie with the nearest on top.
#[inline(always)]
pub(super) fn push(stack: &mut [(f32, u32)], floor: usize, len: &mut usize, item: (f32, u32)) {
    let mut at = *len;
    while at > floor && stack[at - 1].0 < item.0 {
        stack[at] = stack[at - 1];
        at -= 1;
    }
    stack[at] = item;
    *len += 1;
}
