//! The texels of the atlas as patches of the surface, and the mip-map over them.

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use crate::error::Result;
use crate::geometry::atlas::texels::{Texel, Texels};
use crate::geometry::atlas::{Atlas, Outline};
use crate::geometry::cluster;
use crate::scene::Scene;

/// The piece of one triangle inside one texel: flat, lit evenly.
#[derive(Clone, Copy, Debug)]
pub(super) struct Patch {
    /// Centroid relative to the mesh's origin, mm.
    pub(super) centre_mm: DVec3,
    /// Area, mm^2.
    pub(super) area_mm2: f64,
    /// Distance of the farthest corner from the centroid, mm.
    pub(super) radius_mm: f64,
    /// Mean squared distance from the centroid, mm^2.
    pub(super) spread_mm2: f64,
    /// Unit normal.
    pub(super) normal: DVec3,
    /// Triangle of the mesh.
    pub(super) triangle: u32,
    /// Column and row of the texel.
    pub(super) texel: [u32; 2],
}

/// What lies below one node of the hierarchy over the texels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Order {
    /// Squares of the texture: its mip-map, the paper's.
    Texture,
    /// Boxes in space, split in the middle: charts of an atlas that lie side by side are far from each other on the surface.
    Space,
}

/// A texel, or a node of the hierarchy over texels.
#[derive(Clone, Debug)]
pub(super) struct Node {
    /// Nodes below, or patches of a texel.
    pub(super) children: Range<u32>,
    /// Middle of the box around its surface, mm.
    pub(super) centre_mm: DVec3,
    /// Distance of its farthest point from there, mm.
    pub(super) radius_mm: f64,
    /// The children are patches.
    pub(super) is_texel: bool,
}

/// The surface as the texels cut it. All that a change of light or material leaves alone.
pub(super) struct TexelMap {
    pub(super) resolution: u32,
    /// Patches, texel after texel in the order of the texture, part after part.
    pub(super) patches: Vec<Patch>,
    /// Nodes of all parts, children before parents.
    pub(super) nodes: Vec<Node>,
    /// The node of each part that is all of it; none for opaque parts.
    pub(super) roots: Vec<Option<u32>>,
    /// Number of texels.
    pub(super) texels: usize,
    atlas: Atlas,
}

/// Triangles of welded vertices, as the atlas in a file has them.
pub(super) fn welded(scene: &Scene) -> Vec<[u32; 3]> {
    (0..scene.mesh.triangles.len() as u32).map(|t| scene.mesh.welded(t)).collect()
}

/// Patches that are measured in one task.
const TASK: usize = 1024;

impl TexelMap {
    pub(super) fn new(scene: &Scene, atlas: Atlas, resolution: u32, order: Order) -> Result<Self> {
        let cut = Texels::new(&scene.mesh, &scene.parts, &atlas, resolution)?;
        let mut patches = Vec::with_capacity(cut.fragments.len());
        for texel in &cut.texels {
            let fragments = texel.fragments.start as usize..texel.fragments.end as usize;
            patches.extend(cut.fragments[fragments].iter().map(|fragment| Patch {
                centre_mm: fragment.centre_mm,
                area_mm2: fragment.area_mm2,
                radius_mm: 0.0,
                spread_mm2: 0.0,
                normal: scene.mesh.normal(fragment.triangle),
                triangle: fragment.triangle,
                texel: [texel.x, texel.y],
            }));
        }
        let mut map =
            Self { resolution, patches, nodes: Vec::new(), roots: Vec::new(), texels: cut.texels.len(), atlas };
        let measured: Vec<(f64, f64)> =
            map.patches.par_iter().with_min_len(TASK).map(|patch| measure(patch, &map.outline(scene, patch))).collect();
        map.patches.iter_mut().zip(measured).for_each(|(patch, measured)| {
            (patch.radius_mm, patch.spread_mm2) = measured;
        });
        for part in cut.part_offsets.windows(2) {
            let texels = &cut.texels[part[0] as usize..part[1] as usize];
            let leaves: Vec<(u64, Range<u32>)> = match order {
                Order::Texture => {
                    texels.iter().map(|texel| (morton(texel.x, texel.y), texel.fragments.clone())).collect()
                }
                Order::Space => {
                    let centre = |texel: &Texel| cut.fragments[texel.fragments.start as usize].centre_mm;
                    let centres: Vec<DVec3> = texels.iter().map(centre).collect();
                    let mut sorted: Vec<u32> = (0..texels.len() as u32).collect();
                    in_space(&mut sorted, &centres);
                    (0u64..).zip(sorted.iter().map(|i| texels[*i as usize].fragments.clone())).collect()
                }
            };
            let root = map.stack(leaves, if order == Order::Texture { 2 } else { 1 });
            map.roots.push(root);
        }
        Ok(map)
    }

    /// The corners of a patch in their order around it, mm.
    pub(super) fn outline(&self, scene: &Scene, patch: &Patch) -> Outline {
        let corners = scene.mesh.corners_local_mm(patch.triangle);
        Outline::new(corners, self.atlas.corners[patch.triangle as usize], patch.texel, self.resolution)
    }

    /// Stacks the levels of one part, each without the lowest `bits` of the keys below; returns the top.
    fn stack(&mut self, texels: Vec<(u64, Range<u32>)>, bits: u32) -> Option<u32> {
        let mut level: Vec<(u64, u32)> = Vec::with_capacity(texels.len());
        for (key, patches) in texels {
            let of = &self.patches[patches.start as usize..patches.end as usize];
            let (centre_mm, radius_mm) = sphere(of.iter().map(|p| (p.centre_mm, p.radius_mm)));
            level.push((key, self.nodes.len() as u32));
            self.nodes.push(Node { children: patches, centre_mm, radius_mm, is_texel: true });
        }
        while level.len() > 1 {
            let mut above: Vec<(u64, u32)> = Vec::with_capacity(level.len() / 2);
            for children in level.chunk_by(|a, b| a.0 >> bits == b.0 >> bits) {
                let range = children[0].1..children[children.len() - 1].1 + 1;
                let of = &self.nodes[range.start as usize..range.end as usize];
                let (centre_mm, radius_mm) = sphere(of.iter().map(|n| (n.centre_mm, n.radius_mm)));
                above.push((children[0].0 >> bits, self.nodes.len() as u32));
                self.nodes.push(Node { children: range, centre_mm, radius_mm, is_texel: false });
            }
            level = above;
        }
        level.first().map(|(_, root)| *root)
    }

    /// Bytes in memory.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(self.patches.as_slice())
            + size_of_val(self.nodes.as_slice())
            + size_of_val(self.atlas.corners.as_slice())
    }
}

/// Radius, mm, and mean squared distance from the centroid, mm^2.
fn measure(patch: &Patch, outline: &Outline) -> (f64, f64) {
    let radius = outline.corners().iter().map(|c| c.distance(patch.centre_mm)).fold(0.0, f64::max);
    let (mut moment, mut area) = (0.0, 0.0);
    for corners in outline.triangles() {
        let own = crate::geometry::samples::area(corners);
        let [a, b, c] = corners.map(|c| c - patch.centre_mm);
        // The mean square of a linear function over a triangle.
        moment +=
            own * (a.length_squared() + b.length_squared() + c.length_squared() + (a + b + c).length_squared()) / 12.0;
        area += own;
    }
    (radius, if area > 0.0 { moment / area } else { 0.0 })
}

/// A sphere around spheres: about the middle of the box of their centres.
fn sphere(spheres: impl Iterator<Item = (DVec3, f64)> + Clone) -> (DVec3, f64) {
    let grow = |(low, high): (DVec3, DVec3), (c, _): (DVec3, f64)| (low.min(c), high.max(c));
    let (low, high) = spheres.clone().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), grow);
    let centre = 0.5 * (low + high);
    (centre, spheres.map(|(c, r)| c.distance(centre) + r).fold(0.0, f64::max))
}

/// Ranges shorter than this are one task.
const SORTED: usize = 4096;

/// Sorts texels so that each run of a power of two from a multiple of it on is a box of a tree that is split along its longest axis.
fn in_space(order: &mut [u32], centres: &[DVec3]) {
    if order.len() <= 1 {
        return;
    }
    let half = order.len().next_power_of_two() / 2;
    cluster::partition(order, centres, half);
    let (left, right) = order.split_at_mut(half);
    if left.len() > SORTED {
        rayon::join(|| in_space(left, centres), || in_space(right, centres));
    } else {
        in_space(left, centres);
        in_space(right, centres);
    }
}

/// Interleaves the bits of column and row.
fn morton(x: u32, y: u32) -> u64 {
    let spread = |v: u32| (0..32).fold(0u64, |code, bit| code | u64::from(v >> bit & 1) << (2 * bit));
    spread(x) | spread(y) << 1
}
