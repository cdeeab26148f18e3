//! Surface samples: an exact partition of the surface into patches of nearly equal area.
//!
//! A patch is either a piece of one triangle, cut off by repeated bisection of the longest edge, or a cluster of whole
//! small triangles; every bit of surface belongs to exactly one patch, so the areas of the patches are exact and the
//! near field can be integrated over the geometry of the same patches that the far field takes as points. The patches
//! come from one largest-area-first subdivision (a kd-tree over triangles, then bisection inside a triangle), which
//! ends at exactly the asked number: any count works, on any mix of triangle sizes.
//!
//! Why not blue noise: a sample set that ignores triangles has no exact near field, and point rules with random or
//! blue-noise positions converge as h^1 to h^2 with a constant 3 to 10 times that of the centroid rule used here
//! (centroids of congruent pieces integrate linear functions exactly). Measured on the closed bunny with 128k samples,
//! spacing / sqrt(area / count): see `spacing`.

use std::collections::BinaryHeap;

use glam::DVec3;

use super::cluster::longest_axis;
use super::mesh::Mesh;
use super::part_table::PartTable;

/// A triangle, or a piece of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Facet {
    /// Triangle of the mesh.
    pub triangle: u32,
    /// Choices of the longest-edge bisection, first choice in the highest bit below the leading one; 1 = whole.
    pub path: u32,
}

/// Deepest bisection: 2^30 pieces of one triangle.
const MAX_DEPTH: u32 = 30;

impl Facet {
    /// A whole triangle.
    pub fn whole(triangle: u32) -> Self {
        Self { triangle, path: 1 }
    }

    /// The two halves, or `None` at the deepest level.
    pub fn halves(self) -> Option<[Self; 2]> {
        let depth = self.path.checked_ilog2()?;
        (depth < MAX_DEPTH).then(|| [0, 1].map(|bit| Self { triangle: self.triangle, path: self.path << 1 | bit }))
    }

    /// Corners relative to the mesh's origin, mm; the winding is the triangle's.
    pub fn corners_local_mm(self, mesh: &Mesh) -> [DVec3; 3] {
        let mut corners = mesh.corners_local_mm(self.triangle);
        for level in (0..self.path.checked_ilog2().unwrap_or(0)).rev() {
            corners = bisect(corners)[(self.path >> level & 1) as usize];
        }
        corners
    }
}

/// Cuts a triangle at the middle of its longest edge (the first of equals).
pub fn bisect([a, b, c]: [DVec3; 3]) -> [[DVec3; 3]; 2] {
    let (ab, bc, ca) = (a.distance_squared(b), b.distance_squared(c), c.distance_squared(a));
    let [p, q, r] = if ab >= bc && ab >= ca {
        [a, b, c]
    } else if bc >= ca {
        [b, c, a]
    } else {
        [c, a, b]
    };
    let middle = 0.5 * (p + q);
    [[p, middle, r], [middle, q, r]]
}

/// Area of a triangle, mm^2.
pub fn area([a, b, c]: [DVec3; 3]) -> f64 {
    0.5 * (b - a).cross(c - a).length()
}

/// The partition into patches, in an order that keeps neighbours together; patches of one part are contiguous.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Samples {
    /// Facets of all patches.
    pub facets: Vec<Facet>,
    /// Patch `i` holds `facets[offsets[i]..offsets[i + 1]]`; one entry more than there are patches.
    pub patch_offsets: Vec<u32>,
    /// Part `i` holds patches `part_offsets[i]..part_offsets[i + 1]`; empty for opaque parts.
    pub part_offsets: Vec<u32>,
}

/// A node of the subdivision: whole triangles, or one facet.
struct Piece {
    area: f64,
    part: u32,
    /// Creation order, which breaks ties and makes the result unique.
    serial: u64,
    content: Content,
    /// Position in the hierarchy, for the final order: bit string from the root.
    key: (u32, u128),
}

enum Content {
    Triangles(std::ops::Range<usize>),
    Facet(Facet, [DVec3; 3]),
}

impl PartialEq for Piece {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}
impl Eq for Piece {}
impl PartialOrd for Piece {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Piece {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.area.total_cmp(&other.area).then(other.serial.cmp(&self.serial))
    }
}

impl Samples {
    /// Cuts the transfer parts of a mesh into `count` patches (at least one for each part that is not opaque).
    pub fn new(mesh: &Mesh, parts: &PartTable, count: usize) -> Self {
        let mut builder = Builder::new(mesh, parts);
        let mut heap = BinaryHeap::with_capacity(count + 1);
        let mut done = Vec::new();
        for root in builder.roots(parts) {
            heap.push(root);
        }
        while heap.len() + done.len() < count {
            let Some(piece) = heap.pop() else { break };
            match builder.split(&piece) {
                Some(halves) => heap.extend(halves),
                None => done.push(piece),
            }
        }
        done.extend(heap);
        builder.collect(done, parts.parts.len())
    }

    /// Number of patches.
    pub fn len(&self) -> usize {
        self.patch_offsets.len().saturating_sub(1)
    }

    /// True if there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Facets of one patch.
    pub fn patch(&self, patch: usize) -> &[Facet] {
        &self.facets[self.patch_offsets[patch] as usize..self.patch_offsets[patch + 1] as usize]
    }

    /// Patches of one part.
    pub fn part(&self, part: usize) -> std::ops::Range<usize> {
        self.part_offsets[part] as usize..self.part_offsets[part + 1] as usize
    }
}

struct Builder<'a> {
    mesh: &'a Mesh,
    order: Vec<u32>,
    centroids: Vec<DVec3>,
    areas: Vec<f64>,
    serial: u64,
}

impl<'a> Builder<'a> {
    fn new(mesh: &'a Mesh, parts: &PartTable) -> Self {
        let corners = |t: u32| mesh.corners_local_mm(t);
        let count = mesh.triangles.len() as u32;
        let mut order: Vec<u32> = (0..count).collect();
        order.sort_by_key(|&t| parts.triangle_part[t as usize]);
        Self {
            mesh,
            order,
            centroids: (0..count).map(|t| corners(t).iter().sum::<DVec3>() / 3.0).collect(),
            areas: (0..count).map(|t| area(corners(t))).collect(),
            serial: 0,
        }
    }

    fn roots(&mut self, parts: &PartTable) -> Vec<Piece> {
        let mut roots = Vec::new();
        let mut first = 0;
        for (index, part) in parts.parts.iter().enumerate() {
            let len =
                self.order[first..].iter().take_while(|&&t| parts.triangle_part[t as usize] as usize == index).count();
            if part.transfers() && len > 0 {
                roots.push(self.piece(index as u32, first..first + len, (index as u32, 1)));
            }
            first += len;
        }
        roots
    }

    fn piece(&mut self, part: u32, range: std::ops::Range<usize>, key: (u32, u128)) -> Piece {
        self.serial += 1;
        let area = self.order[range.clone()].iter().map(|&t| self.areas[t as usize]).sum();
        Piece { area, part, serial: self.serial, content: Content::Triangles(range), key }
    }

    fn split(&mut self, piece: &Piece) -> Option<[Piece; 2]> {
        match &piece.content {
            Content::Triangles(range) if range.len() > 1 => {
                let middle = self.area_median(range.clone());
                let keys = child_keys(piece.key);
                Some([
                    self.piece(piece.part, range.start..middle, keys[0]),
                    self.piece(piece.part, middle..range.end, keys[1]),
                ])
            }
            Content::Triangles(range) => {
                let triangle = self.order[range.start];
                self.halves(piece, Facet::whole(triangle), self.mesh.corners_local_mm(triangle))
            }
            Content::Facet(facet, corners) => self.halves(piece, *facet, *corners),
        }
    }

    fn halves(&mut self, piece: &Piece, facet: Facet, corners: [DVec3; 3]) -> Option<[Piece; 2]> {
        let facets = facet.halves()?;
        let corners = bisect(corners);
        let keys = child_keys(piece.key);
        let mut half = |i: usize| {
            self.serial += 1;
            Piece {
                area: 0.5 * piece.area,
                part: piece.part,
                serial: self.serial,
                content: Content::Facet(facets[i], corners[i]),
                key: keys[i],
            }
        };
        Some([half(0), half(1)])
    }

    /// Orders the triangles of a range along its longest axis and returns where half of the area is reached.
    fn area_median(&mut self, range: std::ops::Range<usize>) -> usize {
        let (centroids, areas) = (&self.centroids, &self.areas);
        let slice = &mut self.order[range.clone()];
        let axis = longest_axis(slice.iter().map(|&t| centroids[t as usize]));
        let total: f64 = slice.iter().map(|&t| areas[t as usize]).sum();
        let along =
            |&a: &u32, &b: &u32| centroids[a as usize][axis].total_cmp(&centroids[b as usize][axis]).then(a.cmp(&b));
        // Quickselect by area: keep the half that holds the median until it is one element wide.
        let (mut low, mut high, mut before) = (0, slice.len(), 0.0);
        while high - low > 1 {
            let k = (high - low) / 2;
            slice[low..high].select_nth_unstable_by(k, along);
            let left: f64 = slice[low..low + k].iter().map(|&t| areas[t as usize]).sum();
            if before + left > 0.5 * total {
                high = low + k;
            } else {
                before += left;
                low += k;
            }
        }
        range.start + (low + 1).min(range.len() - 1).max(1)
    }

    fn collect(&self, mut pieces: Vec<Piece>, parts: usize) -> Samples {
        pieces.sort_by_key(|p| p.key_order());
        let mut samples =
            Samples { facets: Vec::new(), patch_offsets: vec![0], part_offsets: Vec::with_capacity(parts + 1) };
        for piece in &pieces {
            while samples.part_offsets.len() <= piece.part as usize {
                samples.part_offsets.push(samples.patch_offsets.len() as u32 - 1);
            }
            match &piece.content {
                Content::Triangles(range) => {
                    let first = samples.facets.len();
                    samples.facets.extend(self.order[range.clone()].iter().map(|&t| Facet::whole(t)));
                    samples.facets[first..].sort_unstable();
                }
                Content::Facet(facet, _) => samples.facets.push(*facet),
            }
            samples.patch_offsets.push(samples.facets.len() as u32);
        }
        samples.part_offsets.resize(parts + 1, samples.patch_offsets.len() as u32 - 1);
        samples
    }
}

/// Keys of the children: one more bit. Past 127 levels (sliver cascades) siblings share a key and keep creation order.
fn child_keys((part, bits): (u32, u128)) -> [(u32, u128); 2] {
    if bits.leading_zeros() == 0 { [(part, bits); 2] } else { [(part, bits << 1), (part, bits << 1 | 1)] }
}

impl Piece {
    /// Depth-first order: keys aligned to the left, so that a subtree is contiguous.
    fn key_order(&self) -> (u32, u128, u64) {
        let (part, bits) = self.key;
        (part, bits << bits.leading_zeros(), self.serial)
    }
}

/// Where a patch lies, derived from its facets.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Patch {
    /// Area-weighted centroid relative to the mesh's origin, mm.
    pub centre_mm: DVec3,
    /// Area, mm^2.
    pub area_mm2: f64,
    /// Largest distance of a corner from the centroid, mm.
    pub radius_mm: f64,
}

/// Centroid, area and radius of every patch.
pub fn patches(mesh: &Mesh, samples: &Samples) -> Vec<Patch> {
    use rayon::prelude::*;
    (0..samples.len()).into_par_iter().map(|i| measure(mesh, samples.patch(i))).collect()
}

fn measure(mesh: &Mesh, facets: &[Facet]) -> Patch {
    let (mut moment, mut total) = (DVec3::ZERO, 0.0);
    for facet in facets {
        let corners = facet.corners_local_mm(mesh);
        let a = area(corners);
        moment += a / 3.0 * corners.iter().sum::<DVec3>();
        total += a;
    }
    if total <= 0.0 {
        return Patch::default();
    }
    let centre = moment / total;
    let radius2 =
        facets.iter().flat_map(|f| f.corners_local_mm(mesh)).map(|c| c.distance_squared(centre)).fold(0.0, f64::max);
    Patch { centre_mm: centre, area_mm2: total, radius_mm: radius2.sqrt() }
}

/// Statistics of the spacing between samples.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Spacing {
    /// sqrt(mean area), mm.
    pub nominal_mm: f64,
    /// Mean distance to the nearest other sample over `nominal_mm` (0.5 for random points, 1.07 for a hexagonal lattice).
    pub nearest_mean: f64,
    /// Standard deviation of that ratio over its mean (0.52 for random points).
    pub nearest_variation: f64,
    /// Standard deviation of the areas over their mean.
    pub area_variation: f64,
}

/// Measures the spacing of patches on a regular subset of at most `probes` of them.
pub fn spacing(patches: &[Patch], probes: usize) -> Spacing {
    use rayon::prelude::*;
    let n = patches.len().max(1) as f64;
    let mean_area = patches.iter().map(|p| p.area_mm2).sum::<f64>() / n;
    let area_variance = patches.iter().map(|p| (p.area_mm2 - mean_area).powi(2)).sum::<f64>() / n;
    let nominal = mean_area.sqrt();
    let mut order: Vec<u32> = (0..patches.len() as u32).collect();
    order.sort_by(|&a, &b| patches[a as usize].centre_mm.x.total_cmp(&patches[b as usize].centre_mm.x).then(a.cmp(&b)));
    let step = (patches.len() / probes.max(1)).max(1);
    let distances: Vec<f64> = (0..patches.len())
        .into_par_iter()
        .step_by(step)
        .filter_map(|i| nearest(patches, &order, i))
        .map(|d| d / nominal)
        .collect();
    let count = distances.len().max(1) as f64;
    let mean = distances.iter().sum::<f64>() / count;
    let variance = distances.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / count;
    Spacing {
        nominal_mm: nominal,
        nearest_mean: mean,
        nearest_variation: if mean > 0.0 { variance.sqrt() / mean } else { 0.0 },
        area_variation: if mean_area > 0.0 { area_variance.sqrt() / mean_area } else { 0.0 },
    }
}

/// Distance from the `i`-th patch in the order along x to its nearest other.
fn nearest(patches: &[Patch], order: &[u32], i: usize) -> Option<f64> {
    let at = |k: usize| patches[order[k] as usize].centre_mm;
    let p = at(i);
    let mut best = f64::INFINITY;
    for k in i + 1..order.len() {
        if at(k).x - p.x >= best {
            break;
        }
        best = best.min(at(k).distance(p));
    }
    for k in (0..i).rev() {
        if p.x - at(k).x >= best {
            break;
        }
        best = best.min(at(k).distance(p));
    }
    best.is_finite().then_some(best)
}
