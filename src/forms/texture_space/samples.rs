//! Samples that all receivers of a part share.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::DVec3;

use super::light::Flux;
use super::map::TexelMap;

/// A place on the surface and the flux that it stands for, RGB.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sample {
    pub(super) at_mm: DVec3,
    pub(super) flux: DVec3,
}

/// N samples of a part at the quantiles (i + 1/2) / N of its flux in the order of the mip-map, each found by a descent from the top (section 3 of
/// the paper). A texel stands at the mean place of its flux; each sample carries the same sum over the channels, in the colour of its texel.
pub(super) fn drawn(map: &TexelMap, lit: &[Flux], part: usize, count: usize) -> Vec<Sample> {
    let Some(root) = map.roots.get(part).copied().flatten() else { return Vec::new() };
    let total = lit[root as usize].weight();
    if total <= 0.0 {
        return Vec::new();
    }
    let share = total / count as f64;
    (0..count).map(|i| descend(map, lit, root, (i as f64 + 0.5) * share, share)).collect()
}

fn descend(map: &TexelMap, lit: &[Flux], root: u32, mut wanted: f64, share: f64) -> Sample {
    let mut index = root as usize;
    while !map.nodes[index].is_texel() {
        // Rounding may leave a little beyond the last of them that is lit.
        let mut last = index as u32 + 1;
        for child in map.children(index as u32).filter(|child| lit[*child as usize].weight() > 0.0) {
            last = child;
            let weight = lit[child as usize].weight();
            if wanted < weight {
                break;
            }
            wanted -= weight;
        }
        if wanted >= lit[last as usize].weight() {
            wanted = 0.5 * lit[last as usize].weight();
        }
        index = last as usize;
    }
    let texel = &lit[index];
    let scale = if texel.weight() > 0.0 { share / texel.weight() } else { 0.0 };
    Sample { at_mm: texel.at_mm, flux: scale * texel.rgb }
}

/// At most `count` nodes of a part that hold all of its light: the one whose flux has the largest second moment is opened until there are as many.
pub(super) fn clusters(map: &TexelMap, lit: &[Flux], part: usize, count: usize) -> Vec<Sample> {
    let Some(root) = map.roots.get(part).copied().flatten() else { return Vec::new() };
    // Moments are not negative, so that their bits are in their order.
    let entry = |node: u32| (lit[node as usize].moment.to_bits(), Reverse(node));
    let (mut open, mut closed) = (BinaryHeap::from([entry(root)]), Vec::new());
    while let Some((_, Reverse(node))) = open.pop() {
        let lit_children = map.children(node).filter(|c| lit[*c as usize].weight() > 0.0);
        if map.nodes[node as usize].is_texel() || open.len() + closed.len() + lit_children.clone().count() > count {
            closed.push(node);
        } else {
            open.extend(lit_children.map(entry));
        }
    }
    // In the order of the nodes, whatever the order of opening.
    closed.sort_unstable();
    let of = |node: &u32| Sample { at_mm: lit[*node as usize].at_mm, flux: lit[*node as usize].rgb };
    closed.iter().map(of).filter(|s| s.flux != DVec3::ZERO).collect()
}
