//! The tree over surface samples, and for one light the flux, its centroid and a bounding radius of each node.

use glam::DVec3;

use crate::geometry::cluster::{self, Run};
use crate::geometry::samples::{Patch, Samples};

/// Samples in a leaf at most.
const LEAF: usize = 4;

/// No child.
const NONE: u32 = u32::MAX;

/// A binary tree over the samples of every part; children follow their parent.
#[derive(Clone, Debug, Default)]
pub struct SampleTree {
    nodes: Vec<Node>,
    /// Samples, leaf after leaf.
    order: Vec<u32>,
    /// Root of each part.
    roots: Vec<Option<u32>>,
}

#[derive(Clone, Copy, Debug)]
struct Node {
    run: Run,
    children: [u32; 2],
}

/// A node under one light: flux, area and bounds of its samples.
#[derive(Clone, Copy, Debug, Default)]
pub struct Cluster {
    /// Flux-weighted centroid relative to the mesh's origin, mm.
    pub centre_mm: DVec3,
    /// Every sample's farthest corner lies within this distance of the centroid, mm.
    pub radius_mm: f64,
    /// Area, mm^2.
    pub area_mm2: f64,
    /// Irradiance times area, RGB.
    pub flux: DVec3,
}

/// Item that a walk through the tree passes to its visitor.
pub enum Visit<'a> {
    /// A node with its index among the clusters; the visitor answers true if the cluster will do.
    Node(u32, &'a Cluster),
    /// The samples of a leaf.
    Leaf(&'a [u32]),
}

impl SampleTree {
    /// Builds the tree of each part by median splits along the longest axis.
    pub fn new(samples: &Samples, patches: &[Patch]) -> Self {
        let centres: Vec<DVec3> = patches.iter().map(|p| p.centre_mm).collect();
        let mut order: Vec<u32> = (0..samples.len() as u32).collect();
        let mut tree = Self { nodes: Vec::new(), order: Vec::new(), roots: Vec::new() };
        for part in 0..samples.part_offsets.len().saturating_sub(1) {
            let range = samples.part(part);
            let first = range.start as u32;
            let runs = cluster::groups(&mut order[range], &centres, LEAF);
            let root = (!runs.is_empty()).then(|| tree.link(&runs, first));
            tree.roots.push(root);
        }
        tree.order = order;
        tree
    }

    /// Adds the node over `leaves` and everything below it.
    fn link(&mut self, leaves: &[Run], first: u32) -> u32 {
        let index = self.nodes.len() as u32;
        let run = Run { first: first + leaves[0].first, end: first + leaves[leaves.len() - 1].end };
        self.nodes.push(Node { run, children: [NONE; 2] });
        if leaves.len() > 1 {
            let (left, right) = leaves.split_at(leaves.len().div_ceil(2));
            let children = [self.link(left, first), self.link(right, first)];
            self.nodes[index as usize].children = children;
        }
        index
    }

    /// Sums the flux of every node; `irradiance` is per sample, RGB.
    pub fn light(&self, patches: &[Patch], irradiance: &[DVec3]) -> Vec<Cluster> {
        let mut clusters = vec![Cluster::default(); self.nodes.len()];
        for index in (0..self.nodes.len()).rev() {
            let node = self.nodes[index];
            clusters[index] = if node.children[0] == NONE {
                self.leaf_cluster(node.run, patches, irradiance)
            } else {
                join(node.children.map(|c| clusters[c as usize]))
            };
        }
        clusters
    }

    /// Flux times normal of every node, by channel; `irradiance` is per sample, RGB.
    pub fn moments(&self, patches: &[Patch], irradiance: &[DVec3]) -> Vec<[DVec3; 3]> {
        let mut moments = vec![[DVec3::ZERO; 3]; self.nodes.len()];
        for index in (0..self.nodes.len()).rev() {
            let node = self.nodes[index];
            let mut sum = [DVec3::ZERO; 3];
            let mut add = |of: [DVec3; 3]| sum.iter_mut().zip(of).for_each(|(sum, of)| *sum += of);
            if node.children[0] == NONE {
                for &i in &self.order[node.run.range()] {
                    let (cross, e) = (patches[i as usize].cross_mm2, irradiance[i as usize]);
                    add([0, 1, 2].map(|c| e[c] * cross));
                }
            } else {
                node.children.iter().for_each(|c| add(moments[*c as usize]));
            }
            moments[index] = sum;
        }
        moments
    }

    /// Flux of every node under each of `lights` lights, from the irradiance of every sample under each of them:
    /// `[node][light]`.
    pub fn flux_rows(&self, patches: &[Patch], irradiance: &[f32], lights: usize) -> Vec<f32> {
        let mut rows = vec![0.0; self.nodes.len() * lights];
        for (index, node) in self.nodes.iter().enumerate().rev() {
            // Children follow their parent.
            let (before, after) = rows.split_at_mut((index + 1) * lights);
            let row = &mut before[index * lights..];
            let mut add = |source: &[f32], factor: f32| {
                row.iter_mut().zip(source).for_each(|(sum, value)| *sum += factor * value);
            };
            if node.children[0] == NONE {
                for &i in &self.order[node.run.range()] {
                    add(
                        &irradiance[i as usize * lights..(i as usize + 1) * lights],
                        patches[i as usize].area_mm2 as f32,
                    );
                }
            } else {
                for child in node.children {
                    add(&after[(child as usize - index - 1) * lights..][..lights], 1.0);
                }
            }
        }
        rows
    }

    /// Root of a part; none without samples.
    pub(super) fn root(&self, part: usize) -> Option<u32> {
        self.roots.get(part).copied().flatten()
    }

    /// Number of nodes.
    pub(super) fn len(&self) -> usize {
        self.nodes.len()
    }

    /// The children of a node, which have larger indices; none of a leaf.
    pub fn children(&self, node: usize) -> Option<[usize; 2]> {
        let children = self.nodes.get(node)?.children;
        (children[0] != NONE).then(|| children.map(|c| c as usize))
    }

    /// Samples below a node.
    pub fn members(&self, node: usize) -> &[u32] {
        self.nodes.get(node).map_or(&[], |node| &self.order[node.run.range()])
    }

    /// Bytes in memory.
    pub fn bytes(&self) -> usize {
        size_of_val(self.nodes.as_slice()) + size_of_val(self.order.as_slice())
    }

    fn leaf_cluster(&self, run: Run, patches: &[Patch], irradiance: &[DVec3]) -> Cluster {
        let members = &self.order[run.range()];
        let (mut flux, mut moment, mut middle, mut weight, mut area) =
            (DVec3::ZERO, DVec3::ZERO, DVec3::ZERO, 0.0, 0.0);
        for &i in members {
            let (patch, e) = (&patches[i as usize], irradiance[i as usize]);
            let w = patch.area_mm2 * e.element_sum();
            flux += e * patch.area_mm2;
            moment += w * patch.centre_mm;
            middle += patch.area_mm2 * patch.centre_mm;
            weight += w;
            area += patch.area_mm2;
        }
        let centre = if weight > 0.0 { moment / weight } else { middle / area.max(f64::MIN_POSITIVE) };
        let radius = members
            .iter()
            .map(|&i| patches[i as usize].centre_mm.distance(centre) + patches[i as usize].radius_mm)
            .fold(0.0, f64::max);
        Cluster { centre_mm: centre, radius_mm: radius, area_mm2: area, flux }
    }

    /// Walks a part's tree: `visit` answers true for a node whose cluster will do in place of its children.
    pub fn walk(&self, part: usize, clusters: &[Cluster], mut visit: impl FnMut(Visit) -> bool) {
        let mut stack = Vec::with_capacity(64);
        stack.extend(self.root(part));
        while let Some(index) = stack.pop() {
            let node = &self.nodes[index as usize];
            if clusters[index as usize].flux == DVec3::ZERO {
                continue;
            }
            if visit(Visit::Node(index, &clusters[index as usize])) {
                continue;
            }
            if node.children[0] == NONE {
                visit(Visit::Leaf(&self.order[node.run.range()]));
            } else {
                stack.extend(node.children);
            }
        }
    }
}

fn join([a, b]: [Cluster; 2]) -> Cluster {
    let (wa, wb) = (a.flux.element_sum(), b.flux.element_sum());
    let (wa, wb) = if wa + wb > 0.0 { (wa, wb) } else { (a.area_mm2, b.area_mm2) };
    let centre = (wa * a.centre_mm + wb * b.centre_mm) / (wa + wb).max(f64::MIN_POSITIVE);
    let reach = |c: &Cluster| c.centre_mm.distance(centre) + c.radius_mm;
    Cluster {
        centre_mm: centre,
        radius_mm: reach(&a).max(reach(&b)),
        area_mm2: a.area_mm2 + b.area_mm2,
        flux: a.flux + b.flux,
    }
}
