//! One ray through the tree.

use super::build::{LEAF, Tree, WIDTH};
use super::lanes::{Lanes, Path, Portable};
use super::ray::Query;
use super::triangle::{ExactHit, candidates, exact};
use super::{Hit, NO_TRIANGLE};

/// Entries of a stack that needs no allocation; deeper trees take a `Vec`.
const SMALL_STACK: usize = 256;

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
        let pick = |positive: [usize; 3], negative: [usize; 3]| {
            [0, 1, 2].map(|a| if query.negative[a] { negative[a] } else { positive[a] })
        };
        Self {
            inverse: query.inverse.map(|x| L::splat(x)),
            near_offset: query.near_offset.map(|x| L::splat(x)),
            far_offset: query.far_offset.map(|x| L::splat(x)),
            near_planes: pick([0, 1, 2], [3, 4, 5]),
            far_planes: pick([3, 4, 5], [0, 1, 2]),
        }
    }

    /// Which of the eight boxes the ray may meet between `t_min` and `t_max`, and where it enters them.
    #[inline(always)]
    fn boxes(&self, planes: &[[f32; WIDTH]; 6], t_min: L::V, t_max: L::V) -> (u32, L::V) {
        let plane =
            |axis: usize, which: usize, offset: L::V| L::mul_sub(L::load(&planes[which]), self.inverse[axis], offset);
        let near = |axis: usize| plane(axis, self.near_planes[axis], self.near_offset[axis]);
        let far = |axis: usize| plane(axis, self.far_planes[axis], self.far_offset[axis]);
        let enter = L::max(near(0), L::max(near(1), L::max(near(2), t_min)));
        let leave = L::min(far(0), L::min(far(1), L::min(far(2), t_max)));
        (L::less_equal(enter, leave), enter)
    }
}

/// Hands `visit` every hit of the ray until it says that this is enough; whether it did.
pub(super) fn any<F: FnMut(ExactHit, u32) -> bool>(path: Path, tree: &Tree, query: &Query, visit: &mut F) -> bool {
    match path {
        Path::Portable => any_with::<Portable, F>(tree, query, visit),
        #[cfg(target_arch = "x86_64")]
        // SAFETY: `Path::detect` returns this path only on a CPU that has both features.
        Path::Avx2 => unsafe { any_avx2(tree, query, visit) },
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn any_avx2<F: FnMut(ExactHit, u32) -> bool>(tree: &Tree, query: &Query, visit: &mut F) -> bool {
    any_with::<super::lanes::Avx2, F>(tree, query, visit)
}

/// Whether the ray meets a triangle other than `skip`.
pub(super) fn occluded(path: Path, tree: &Tree, query: &Query, skip: u32) -> bool {
    any(path, tree, query, &mut |_, id| id != skip)
}

#[inline(always)]
fn any_with<L: Lanes, F: FnMut(ExactHit, u32) -> bool>(tree: &Tree, query: &Query, visit: &mut F) -> bool {
    let mut small = [0u32; SMALL_STACK];
    if tree.stack <= SMALL_STACK {
        return any_on_stack::<L, F>(tree, query, &mut small, visit);
    }
    any_on_stack::<L, F>(tree, query, &mut vec![0; tree.stack], visit)
}

#[inline(always)]
fn any_on_stack<L: Lanes, F: FnMut(ExactHit, u32) -> bool>(
    tree: &Tree,
    query: &Query,
    stack: &mut [u32],
    visit: &mut F,
) -> bool {
    let wide = Wide::<L>::new(query);
    let (t_min, t_max) = (L::splat(query.box_range[0]), L::splat(query.box_range[1]));
    let mut len = 1;
    while len > 0 {
        len -= 1;
        let top = stack[len];
        if top & LEAF == 0 {
            let node = &tree.nodes[top as usize];
            let (mask, _) = wide.boxes(&node.planes, t_min, t_max);
            len = L::push(stack, len, &node.children, mask);
        } else if block::<L, F>(tree, query, top, visit) {
            return true;
        }
    }
    false
}

#[inline(always)]
fn block<L: Lanes, F: FnMut(ExactHit, u32) -> bool>(tree: &Tree, query: &Query, leaf: u32, visit: &mut F) -> bool {
    let block = &tree.blocks[((leaf & !LEAF) >> 3) as usize];
    let mut mask = candidates::<L>(block, query, (leaf & 7) + 1);
    while mask != 0 {
        let lane = mask.trailing_zeros() as usize % WIDTH;
        mask &= mask - 1;
        if let Some(hit) = exact(block, lane, query)
            && visit(hit, block.triangles[lane])
        {
            return true;
        }
    }
    false
}

/// The nearest hit; of equal ones, the lowest triangle.
pub(super) fn closest(path: Path, tree: &Tree, query: &Query) -> Option<Hit> {
    match path {
        Path::Portable => closest_with::<Portable>(tree, query),
        #[cfg(target_arch = "x86_64")]
        // SAFETY: `Path::detect` returns this path only on a CPU that has both features.
        Path::Avx2 => unsafe { closest_avx2(tree, query) },
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn closest_avx2(tree: &Tree, query: &Query) -> Option<Hit> {
    closest_with::<super::lanes::Avx2>(tree, query)
}

#[inline(always)]
fn closest_with<L: Lanes>(tree: &Tree, query: &Query) -> Option<Hit> {
    let mut small = [(0.0f32, 0u32); SMALL_STACK];
    if tree.stack <= SMALL_STACK {
        return closest_on_stack::<L>(tree, query, &mut small);
    }
    closest_on_stack::<L>(tree, query, &mut vec![(0.0, 0); tree.stack])
}

#[inline(always)]
fn closest_on_stack<L: Lanes>(tree: &Tree, query: &Query, stack: &mut [(f32, u32)]) -> Option<Hit> {
    let wide = Wide::<L>::new(query);
    let t_min = L::splat(query.box_range[0]);
    let mut t_max = query.box_range[1];
    let mut best = (ExactHit { t: f64::INFINITY, u: 0.0, v: 0.0 }, NO_TRIANGLE);
    stack[0] = (f32::NEG_INFINITY, 0);
    let mut len = 1;
    while len > 0 {
        len -= 1;
        let (enter, top) = stack[len];
        if enter > t_max {
            continue;
        }
        if top & LEAF != 0 {
            block::<L, _>(tree, query, top, &mut |hit, id| {
                if (hit.t, id) < (best.0.t, best.1) {
                    best = (hit, id);
                    t_max = (hit.t - query.start) as f32;
                }
                false
            });
            continue;
        }
        let node = &tree.nodes[top as usize];
        let (mut mask, enter) = wide.boxes(&node.planes, t_min, L::splat(t_max));
        let enter = L::to_array(enter);
        let floor = len;
        while mask != 0 {
            let child = mask.trailing_zeros() as usize % WIDTH;
            mask &= mask - 1;
            let item = (enter[child], node.children.0[child]);
            let mut at = len;
            while at > floor && stack[at - 1].0 < item.0 {
                stack[at] = stack[at - 1];
                at -= 1;
            }
            stack[at] = item;
            len += 1;
        }
    }
    (best.1 != NO_TRIANGLE).then(|| best.0.rounded(best.1))
}
