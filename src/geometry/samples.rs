//! Surface samples: an exact partition of the surface into patches of nearly equal area.
//!
//! A patch is either a piece of one triangle, cut off by repeated bisection of the longest edge, or a cluster of whole
//! small triangles; every bit of surface belongs to exactly one patch, so the areas of the patches are exact and the
//! near field can be integrated over the geometry of the same patches that the far field takes as points. The patches
//! come from one largest-area-first subdivision (a kd-tree over triangles, then bisection inside a triangle), which
//! ends at exactly the asked number: any count works, on any mix of triangle sizes. The rule is [`subdivision`]'s, since assets that follow
//! it store no samples. Where there are as many samples as
//! triangles, clusters are opened first, so that every triangle has its own irradiance.
//!
//! Why not blue noise: a sample set that ignores triangles has no exact near field, and point rules with random or
//! blue-noise positions converge as h^1 to h^2 with a constant 3 to 10 times that of the centroid rule used here
//! (centroids of congruent pieces integrate linear functions exactly). Measured on a closed bunny of 69,666 triangles with
//! 20,000, 131,072 and 500,000 samples ([`spacing`]): nearest neighbour at 0.76, 0.69, 0.69 of sqrt(area / count) with a
//! variation of 0.18, 0.20, 0.20 (random points: 0.5 and 0.52), areas varying by 0.25, 0.21, 0.23.

use glam::DVec3;
use translux_format::subdivision::{self, Surface};

use super::mesh::Mesh;
use super::part_table::{PartEntry, PartTable};

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
pub fn bisect(corners: [DVec3; 3]) -> [[DVec3; 3]; 2] {
    cut_at(corners, longest_edge(corners), |p, q| 0.5 * (p + q))
}

/// The corner of a triangle that its longest edge starts at (the first of equals).
pub(super) fn longest_edge([a, b, c]: [DVec3; 3]) -> usize {
    let (ab, bc, ca) = (a.distance_squared(b), b.distance_squared(c), c.distance_squared(a));
    if ab >= bc && ab >= ca {
        0
    } else if bc >= ca {
        1
    } else {
        2
    }
}

/// Cuts a triangle at the middle of the edge that starts at a corner, whatever its corners are given by.
#[inline]
pub(super) fn cut_at<T: Copy>([a, b, c]: [T; 3], edge: usize, mut middle: impl FnMut(T, T) -> T) -> [[T; 3]; 2] {
    // `rotate_left` moves memory here, which took a tenth of the gathering on meshes of few triangles.
    let [p, q, r] = match edge {
        0 => [a, b, c],
        1 => [b, c, a],
        _ => [c, a, b],
    };
    let middle = middle(p, q);
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

impl Samples {
    /// Cuts the transfer parts of a mesh into `count` patches (at least one for each part that is not opaque).
    pub fn new(mesh: &Mesh, parts: &PartTable, count: usize) -> Self {
        let transfers: Vec<bool> = parts.parts.iter().map(PartEntry::transfers).collect();
        Self::from_file(subdivision::subdivide(&surface(mesh, parts), &transfers, count))
    }

    /// The samples with those of each part in the order of a balanced tree ([`subdivision::in_tree_order`]).
    #[must_use]
    pub fn in_tree_order(&self, mesh: &Mesh, parts: &PartTable) -> Self {
        Self::from_file(subdivision::in_tree_order(&surface(mesh, parts), &self.to_file()))
    }

    /// The samples as a file has them.
    pub fn to_file(&self) -> translux_format::Samples {
        translux_format::Samples {
            facets: self.facets.iter().map(|f| [f.triangle, f.path]).collect(),
            patch_offsets: self.patch_offsets.clone(),
            part_offsets: self.part_offsets.clone(),
        }
    }

    /// The samples of a file.
    pub fn from_file(file: translux_format::Samples) -> Self {
        Self {
            facets: file.facets.into_iter().map(|[triangle, path]| Facet { triangle, path }).collect(),
            patch_offsets: file.patch_offsets,
            part_offsets: file.part_offsets,
        }
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

/// A mesh as the rule of the samples sees it.
fn surface<'a>(mesh: &'a Mesh, parts: &'a PartTable) -> Surface<'a> {
    Surface {
        positions_mm: bytemuck::cast_slice(&mesh.local_mm),
        triangles: &mesh.triangles,
        triangle_part: &parts.triangle_part,
    }
}

/// Centroid, size and normal of a patch, derived from its facets.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Patch {
    /// Area-weighted centroid relative to the mesh's origin, mm.
    pub centre_mm: DVec3,
    /// Area, mm^2.
    pub area_mm2: f64,
    /// Largest distance of a corner from the centroid, mm.
    pub radius_mm: f64,
    /// Unit normal of a patch that is one facet; zero for others.
    pub normal: DVec3,
    /// Area times unit normal, summed over its facets, mm^2.
    pub cross_mm2: DVec3,
}

/// Centroid, area, radius and normal of every patch.
pub fn patches(mesh: &Mesh, samples: &Samples) -> Vec<Patch> {
    use crate::parallel::*;
    (0..samples.len()).into_par_iter().map(|i| measure(mesh, samples.patch(i))).collect()
}

fn measure(mesh: &Mesh, facets: &[Facet]) -> Patch {
    let (mut moment, mut total, mut cross_mm2) = (DVec3::ZERO, 0.0, DVec3::ZERO);
    for facet in facets {
        let corners = facet.corners_local_mm(mesh);
        let a = area(corners);
        cross_mm2 += a * mesh.normal(facet.triangle);
        moment += a / 3.0 * corners.iter().sum::<DVec3>();
        total += a;
    }
    if total <= 0.0 {
        return Patch::default();
    }
    let centre = moment / total;
    let radius2 =
        facets.iter().flat_map(|f| f.corners_local_mm(mesh)).map(|c| c.distance_squared(centre)).fold(0.0, f64::max);
    let normal = match facets {
        [facet] => mesh.cross_mm2(facet.triangle).normalize_or_zero(),
        _ => DVec3::ZERO,
    };
    Patch { centre_mm: centre, area_mm2: total, radius_mm: radius2.sqrt(), normal, cross_mm2 }
}

/// Statistics of the spacing between samples.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
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
    use crate::parallel::*;
    let n = patches.len().max(1) as f64;
    let mean_area = patches.iter().map(|p| p.area_mm2).sum::<f64>() / n;
    let area_variance = patches.iter().map(|p| (p.area_mm2 - mean_area).powi(2)).sum::<f64>() / n;
    let nominal = mean_area.sqrt();
    let mut order: Vec<u32> = (0..patches.len() as u32).collect();
    order.sort_by(|&a, &b| patches[a as usize].centre_mm.x.total_cmp(&patches[b as usize].centre_mm.x).then(a.cmp(&b)));
    let step = (patches.len() / probes.max(1)).max(1);
    let distances: Vec<f64> = (0..patches.len().div_ceil(step))
        .into_par_iter()
        .filter_map(|i| nearest(patches, &order, i * step))
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

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::geometry::shapes;
    use crate::geometry::source::SourceModel;
    use crate::geometry::test_data;

    fn mesh_of(source: SourceModel) -> (Mesh, PartTable) {
        let (mesh, _) = test_data::mesh_of(source);
        let triangle_part = vec![0; mesh.triangles.len()];
        let parts = PartTable::new(&mesh, triangle_part, vec![("all".into(), Some(0))]);
        (mesh, parts)
    }

    #[test]
    fn areas_are_exact_and_the_count_is_the_asked_one_below_and_above_the_number_of_triangles() {
        let (mesh, parts) = mesh_of(shapes::bumpy_head(10.0, 4));
        let triangles = mesh.triangles.len();
        for count in [1, 2, 7, triangles / 3, triangles, triangles + 1, 3 * triangles + 5] {
            let samples = Samples::new(&mesh, &parts, count);
            assert_eq!(samples.len(), count);
            assert_eq!(samples.part(0), 0..count);
            let patches = patches(&mesh, &samples);
            let total: f64 = patches.iter().map(|p| p.area_mm2).sum();
            assert!((total / mesh.total_area_mm2() - 1.0).abs() < 1e-12, "{count}: {total}");
            let mut seen: Vec<Facet> = samples.facets.clone();
            seen.sort_unstable();
            seen.dedup();
            assert_eq!(seen.len(), samples.facets.len());
        }
    }

    #[test]
    fn halves_cover_their_facet_and_paths_find_their_corners() {
        let (mesh, _) = mesh_of(shapes::icosphere(3.0, 0));
        let mut facet = Facet::whole(5);
        let mut expected = mesh.corners_local_mm(5);
        for bit in [0, 1, 1, 0, 1] {
            let halves = facet.halves().unwrap();
            let pieces = bisect(expected);
            assert!((area(pieces[0]) + area(pieces[1]) - area(expected)).abs() < 1e-12);
            facet = halves[bit];
            expected = pieces[bit];
            assert_eq!(facet.corners_local_mm(&mesh), expected);
        }
    }

    #[test]
    fn the_deepest_facet_does_not_split_and_a_tiny_part_still_has_a_patch() {
        assert!(Facet { triangle: 0, path: 1 << MAX_DEPTH }.halves().is_none());
        let small = shapes::icosphere(0.001, 0);
        let big = shapes::icosphere(10.0, 2);
        let triangles = small.triangles.len();
        let (mesh, _) = mesh_of(shapes::compose(&[(small, DVec3::new(30.0, 0.0, 0.0)), (big, DVec3::ZERO)]));
        let part_of = (0..mesh.triangles.len()).map(|t| u32::from(t >= triangles)).collect();
        let parts = PartTable::new(&mesh, part_of, vec![("a".into(), Some(0)), ("b".into(), Some(0))]);
        let samples = Samples::new(&mesh, &parts, 100);
        assert_eq!((samples.len(), samples.part(0), samples.part(1)), (100, 0..1, 1..100));
    }

    #[test]
    fn opaque_parts_have_no_samples() {
        let (mesh, mut parts) = mesh_of(shapes::icosphere(1.0, 1));
        parts.parts[0].medium = None;
        let samples = Samples::new(&mesh, &parts, 50);
        assert!(samples.is_empty() && samples.part(0).is_empty());
    }

    #[test]
    fn spacing_is_far_more_even_than_random() {
        let (mesh, parts) = mesh_of(shapes::bumpy_head(10.0, 5));
        let samples = Samples::new(&mesh, &parts, 4 * mesh.triangles.len());
        let statistics = spacing(&patches(&mesh, &samples), 2000);
        // Random points: nearest 0.5 with variation 0.52.
        assert!(statistics.nearest_mean > 0.6, "{statistics:?}");
        assert!(statistics.nearest_variation < 0.3, "{statistics:?}");
        assert!(statistics.area_variation < 0.5, "{statistics:?}");
    }

    #[test]
    fn the_result_does_not_depend_on_threads() {
        let (mesh, parts) = mesh_of(shapes::torus(10.0, 3.0, 120, 40));
        let on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| Samples::new(&mesh, &parts, 20_000))
        };
        assert_eq!(on(1), on(4));
    }
}
