//! The texels of the atlas as patches of the surface, and the mip-map over them.

use std::ops::Range;

use glam::DVec3;

use crate::error::Result;
use crate::geometry::atlas::texels::{Texel, Texels};
use crate::geometry::atlas::{Atlas, Outline};
use crate::geometry::cluster;
use crate::parallel::*;
use crate::scene::Scene;
use crate::transport::irradiance::SurfacePoint;

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

/// A texel, or a node of the hierarchy over texels. Nodes are in the order of a walk from the top: first a node, then all that is below
/// it, child after child.
#[derive(Clone, Debug)]
pub(super) struct Node {
    /// The node after all that is below this one.
    pub(super) next: u32,
    /// Patches of a texel; none of other nodes.
    pub(super) patches: Range<u32>,
}

impl Node {
    /// True where patches are below, not nodes.
    pub(super) fn is_texel(&self) -> bool {
        !self.patches.is_empty()
    }
}

/// The surface as the texels cut it. All that a change of light or material leaves alone.
pub(super) struct TexelMap {
    pub(super) resolution: u32,
    /// Patches, texel after texel in the order of the texture, part after part.
    pub(super) patches: Vec<Patch>,
    /// The patches as points that see the lights, and their media.
    pub(super) points: Vec<(SurfacePoint, u32)>,
    /// Nodes of all parts, parents before children.
    pub(super) nodes: Vec<Node>,
    /// Area of the surface at and below each node, mm^2.
    pub(super) areas_mm2: Vec<f64>,
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

/// Medium of a triangle; none of opaque parts.
pub(super) fn medium_of(scene: &Scene, triangle: u32) -> Option<u32> {
    let part = *scene.parts.triangle_part.get(triangle as usize)?;
    scene.parts.parts.get(part as usize)?.medium
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
        let mut map = Self {
            resolution,
            patches,
            points: Vec::new(),
            nodes: Vec::new(),
            areas_mm2: Vec::new(),
            roots: Vec::new(),
            texels: cut.texels.len(),
            atlas,
        };
        let measured: Vec<(f64, f64)> =
            map.patches.par_iter().with_min_len(TASK).map(|patch| measure(patch, &map.outline(scene, patch))).collect();
        map.patches.iter_mut().zip(measured).for_each(|(patch, measured)| {
            (patch.radius_mm, patch.spread_mm2) = measured;
        });
        let point = |patch: &Patch| {
            let point = SurfacePoint { at: patch.centre_mm, normal: patch.normal, triangle: patch.triangle };
            (point, medium_of(scene, patch.triangle).unwrap_or(u32::MAX))
        };
        map.points = map.patches.par_iter().with_min_len(TASK).map(point).collect();
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
            map.roots.push((!leaves.is_empty()).then_some(map.nodes.len() as u32));
            map.stack(&leaves, if order == Order::Texture { 2 } else { 1 });
        }
        map.areas_mm2 = vec![0.0; map.nodes.len()];
        for (index, node) in map.nodes.iter().enumerate().rev() {
            let of_patches: f64 = node.patches.clone().map(|patch| map.patches[patch as usize].area_mm2).sum();
            let of_nodes: f64 = map.children(index as u32).map(|child| map.areas_mm2[child as usize]).sum();
            map.areas_mm2[index] = of_patches + of_nodes;
        }
        Ok(map)
    }

    /// The corners of a patch in their order around it, mm.
    pub(super) fn outline(&self, scene: &Scene, patch: &Patch) -> Outline {
        let corners = scene.mesh.corners_local_mm(patch.triangle);
        Outline::new(corners, self.atlas.corners[patch.triangle as usize], patch.texel, self.resolution)
    }

    /// Appends the nodes of some texels, by their ascending keys: of each node the children differ in `bits` bits of their keys.
    fn stack(&mut self, texels: &[(u64, Range<u32>)], bits: u32) {
        let index = self.nodes.len();
        match texels {
            [] => return,
            [(_, patches)] => self.nodes.push(Node { next: 0, patches: patches.clone() }),
            [(first, _), .., (last, _)] => {
                self.nodes.push(Node { next: 0, patches: 0..0 });
                // Levels on which they are all below one node have none.
                let shift = (first ^ last).checked_ilog2().unwrap_or(0) / bits * bits;
                texels.chunk_by(|a, b| a.0 >> shift == b.0 >> shift).for_each(|below| self.stack(below, bits));
            }
        }
        self.nodes[index].next = self.nodes.len() as u32;
    }

    /// The nodes right below a node.
    pub(super) fn children(&self, node: u32) -> impl Iterator<Item = u32> + Clone {
        let Node { next: end, patches } = &self.nodes[node as usize];
        let inside = move |child: u32| (child < *end).then_some(child);
        let first = if patches.is_empty() { inside(node + 1) } else { None };
        std::iter::successors(first, move |child| inside(self.nodes[*child as usize].next))
    }

    /// Nodes in the order of their heights over the texels, and the range of each height.
    #[cfg(feature = "gpu")]
    pub(super) fn levels(&self) -> (Vec<u32>, Vec<Range<u32>>) {
        let mut heights = vec![0u32; self.nodes.len()];
        for (index, node) in self.nodes.iter().enumerate().rev() {
            if !node.is_texel() {
                let below = self.children(index as u32).map(|child| heights[child as usize]).max();
                heights[index] = 1 + below.unwrap_or(0);
            }
        }
        let mut order: Vec<u32> = (0..self.nodes.len() as u32).collect();
        order.sort_by_key(|node| heights[*node as usize]);
        let mut ranges = Vec::new();
        let mut first = 0;
        for level in order.chunk_by(|a, b| heights[*a as usize] == heights[*b as usize]) {
            ranges.push(first..first + level.len() as u32);
            first += level.len() as u32;
        }
        (order, ranges)
    }

    /// Bytes in memory.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(self.patches.as_slice())
            + size_of_val(self.points.as_slice())
            + size_of_val(self.areas_mm2.as_slice())
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
