//! Many rays through the tree.

use super::build::Tree;
use super::lanes::Path;
use super::ray::{Query, Ray};
use super::traverse;

/// See [`super::Bvh::occluded_many`].
pub(super) fn occluded_many(path: Path, tree: &Tree, rays: &[Ray], skip: &[u32], out: &mut [bool]) {
    for ((ray, &skip), out) in rays.iter().zip(skip).zip(out) {
        *out = Query::new(ray, tree).is_some_and(|query| traverse::occluded(path, tree, &query, skip));
    }
}
