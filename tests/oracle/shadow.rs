//! Which share of a patch each sharp light sees, and the tree of halves of the triangles that a shadow edge crosses.

use super::lights::Sharp;
use super::patch::{Patch, sixteen_points};
use super::rays::{Blockers, Ray};
use super::vector::{V3, add, mul};

/// Halves of one triangle; the root is node 0.
pub struct ShadowTree {
    pub nodes: Vec<ShadowNode>,
    /// Int E dA over the triangle, colour times mm^2, and where it is centred.
    pub flux: V3,
    pub centre: V3,
}

pub struct ShadowNode {
    /// Index of the first of two children that follow each other; 0 for none.
    pub first_child: u32,
    /// Share of the patch that each light sees.
    pub lit: Box<[f64]>,
}

/// What decides on visibility.
pub struct Shadows<'a> {
    pub lights: &'a [Sharp],
    pub blockers: &'a Blockers,
    pub eta: f64,
}

impl Shadows<'_> {
    /// Unshadowed irradiance at the middle of the patch from each light.
    pub fn unshadowed(&self, patch: &Patch) -> impl Iterator<Item = V3> {
        self.lights.iter().map(|l| l.unshadowed(self.eta, patch.centroid, patch.normal))
    }

    /// Share of sixteen points of the patch that the light sees.
    pub fn lit_share(&self, light: &Sharp, triangle: u32, patch: &Patch) -> f64 {
        if light.unshadowed(self.eta, patch.centroid, patch.normal) == [0.0; 3] {
            return 0.0;
        }
        let rays = sixteen_points(patch.key()).map(|b| {
            let origin = patch.point(b);
            let (direction, reach) = light.shadow_ray(origin);
            Ray { origin, direction, reach }
        });
        self.blockers.count_free(triangle, rays) as f64 / 16.0
    }

    /// Shares of a child: those of the parent where it was all lit or all dark and `trusted`, sampled otherwise.
    pub fn child_shares(&self, triangle: u32, child: &Patch, parent: &[f64], trusted: &[bool]) -> Box<[f64]> {
        self.lights
            .iter()
            .enumerate()
            .map(|(k, light)| {
                if trusted[k] && (parent[k] == 0.0 || parent[k] == 1.0) {
                    parent[k]
                } else {
                    self.lit_share(light, triangle, child)
                }
            })
            .collect()
    }

    /// Bisects the triangle as long as `worth_splitting(patch, k)` for a light `k` whose shadow edge crosses it.
    pub fn tree(&self, triangle: u32, root: &Patch, worth_splitting: impl Fn(&Patch, usize) -> bool) -> ShadowTree {
        let lit = self.lights.iter().map(|l| self.lit_share(l, triangle, root)).collect();
        let mut tree =
            ShadowTree { nodes: vec![ShadowNode { first_child: 0, lit }], flux: [0.0; 3], centre: root.centroid };
        let mut moment = [0.0; 3];
        let mut weight = 0.0;
        let mut open = vec![(0usize, *root)];
        let trusted = vec![true; self.lights.len()];
        while let Some((index, patch)) = open.pop() {
            let lit = &tree.nodes[index].lit;
            let split = (0..self.lights.len()).any(|k| lit[k] > 0.0 && lit[k] < 1.0 && worth_splitting(&patch, k));
            if split {
                let halves = patch.bisected();
                let children = halves.map(|half| self.child_shares(triangle, &half, lit, &trusted));
                tree.nodes[index].first_child = tree.nodes.len() as u32;
                for (half, lit) in halves.into_iter().zip(children) {
                    open.push((tree.nodes.len(), half));
                    tree.nodes.push(ShadowNode { first_child: 0, lit });
                }
            } else {
                let mut e = [0.0; 3];
                for (unshadowed, share) in self.unshadowed(&patch).zip(lit) {
                    e = add(e, mul(unshadowed, *share));
                }
                tree.flux = add(tree.flux, mul(e, patch.area));
                let w = (e[0] + e[1] + e[2]) * patch.area;
                moment = add(moment, mul(patch.centroid, w));
                weight += w;
            }
        }
        if weight > 0.0 {
            tree.centre = mul(moment, 1.0 / weight);
        }
        tree
    }
}
