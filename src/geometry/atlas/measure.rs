//! Measures of a texture atlas: what it covers, and how it stretches.

use glam::{DVec2, DVec3};
use rayon::slice::ParallelSliceMut;

use super::cut::{self, Codes};
use crate::geometry::mesh::Mesh;
use crate::parallel::*;

/// Texels of a side of the grid on which coverage is measured.
const RESOLUTION: u32 = 2048;

/// Excess of coverage over a texel that is rounding.
const ROUNDING: f64 = 1e-9;

/// Measures of a map of a mesh to the unit square. `A_T` is a triangle's area in the map, `A_S` on the surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Report {
    /// Whether the map is that of the mesh's own texture coordinates.
    pub own: bool,
    /// Number of charts: sets of triangles that vertices join in the map.
    pub charts: u32,
    /// Share of the unit square that is covered.
    pub occupancy: f64,
    /// Share of the mapped area by which texels of a 2048 x 2048 grid are covered more than once.
    pub overlap: f64,
    /// L2 stretch (Sander et al. 2001) normalised by the total areas: 1 for an isometry.
    pub stretch: f64,
    /// The 1st and 99th percentile by surface area of `A_T / A_S` over its mean.
    pub area_range: [f64; 2],
    /// Least `A_T / A_S` over its mean, of triangles that have an area in the map.
    pub smallest: f64,
    /// Number of triangles without area in the map.
    pub flat: u32,
}

/// Shares of the unit square that triangles cover, and that they cover again.
struct Coverage {
    mapped: f64,
    covered: f64,
    again: f64,
}

/// The coverage by triangles. Where they are more than any bijective map has, all but one square counts as again.
fn coverage(codes: &[Codes]) -> Coverage {
    let doubled: f64 = codes.iter().map(|c| cut::doubled_area(c).unsigned_abs() as f64).sum();
    let mapped = 0.5 * doubled / (cut::STEPS * cut::STEPS);
    if mapped > 2.0 || !cut::is_bounded(codes, RESOLUTION) {
        return Coverage { mapped, covered: mapped.min(1.0), again: (mapped - 1.0).max(0.5 * mapped) };
    }
    let pairs = cut::blocks(codes, RESOLUTION, |_| Some(0));
    let blocks: Vec<&[(u64, u32)]> = pairs.chunk_by(|a, b| a.0 == b.0).collect();
    let of = |block: &&[(u64, u32)]| {
        let mut texels = vec![0.0; cut::BLOCK];
        for &(key, triangle) in *block {
            cut::pieces(&codes[triangle as usize], RESOLUTION, key as u32, |piece| {
                texels[piece.texel as usize % cut::BLOCK] += piece.area;
            });
        }
        let twice = |area: &f64| (area - 1.0 - ROUNDING).max(0.0);
        [texels.iter().map(|area: &f64| area.min(1.0)).sum(), texels.iter().map(twice).sum::<f64>()]
    };
    let sums: Vec<[f64; 2]> = blocks.par_iter().map(of).collect();
    let texels = f64::from(RESOLUTION) * f64::from(RESOLUTION);
    let [covered, again] = [0, 1].map(|i| sums.iter().map(|sum| sum[i]).sum::<f64>() / texels);
    Coverage { mapped, covered, again }
}

/// Number of sets of triangles that share places of the surface and of the map.
fn charts(mesh: &Mesh, codes: &[Codes]) -> u32 {
    let corner = |i: usize| (mesh.welded((i / 3) as u32)[i % 3], codes[i / 3][i % 3], i as u32);
    let mut corners: Vec<(u32, [u16; 2], u32)> = (0..3 * codes.len()).into_par_iter().map(corner).collect();
    corners.par_sort_unstable();
    let mut parent: Vec<u32> = (0..codes.len() as u32).collect();
    let mut sets = codes.len() as u32;
    for pair in corners.windows(2) {
        if (pair[0].0, pair[0].1) == (pair[1].0, pair[1].1) {
            let [a, b] = [0, 1].map(|i| root(&mut parent, pair[i].2 / 3));
            sets -= u32::from(a != b);
            parent[a.max(b) as usize] = a.min(b);
        }
    }
    sets
}

/// The first of a triangle's set; halves the paths to it.
fn root(parent: &mut [u32], mut of: u32) -> u32 {
    while parent[of as usize] != of {
        parent[of as usize] = parent[parent[of as usize] as usize];
        of = parent[of as usize];
    }
    of
}

/// Sander's squared L2 stretch of a triangle, the mean of the squared singular values of the map to the surface, mm^2;
/// `doubled` is twice the signed area of the corners in the map.
pub(super) fn squared_stretch([a, b, c]: [DVec2; 3], doubled: f64, [p, q, r]: [DVec3; 3]) -> f64 {
    let along_u = (p * (b.y - c.y) + q * (c.y - a.y) + r * (a.y - b.y)) / doubled;
    let along_v = (p * (c.x - b.x) + q * (a.x - c.x) + r * (b.x - a.x)) / doubled;
    0.5 * (along_u.length_squared() + along_v.length_squared())
}

impl Report {
    /// The measures of a map; `codes` has an entry for each triangle of the mesh.
    pub(super) fn new(mesh: &Mesh, codes: &[Codes], own: bool) -> Self {
        let of = |(triangle, codes): (usize, &Codes)| {
            let surface = mesh.area_mm2(triangle as u32);
            let doubled = cut::doubled_area(codes) as f64 / (cut::STEPS * cut::STEPS);
            let stretch = if doubled == 0.0 {
                0.0
            } else {
                surface * squared_stretch(cut::in_texels(codes, 1), doubled, mesh.corners_local_mm(triangle as u32))
            };
            [0.5 * doubled.abs(), surface, stretch]
        };
        let areas: Vec<[f64; 3]> = codes.par_iter().enumerate().map(of).collect();
        let [map, surface, stretch] = [0, 1, 2].map(|i| areas.iter().map(|a| a[i]).sum::<f64>());
        let Coverage { mapped, covered, again } = coverage(codes);
        let flat = areas.iter().filter(|a| a[0] == 0.0).count() as u32;
        let mut report = Self { own, charts: charts(mesh, codes), occupancy: covered, flat, ..Self::default() };
        if !(map > 0.0 && surface > 0.0) {
            return report;
        }
        let mean = map / surface;
        let mut ratios: Vec<(f64, f64)> =
            areas.iter().map(|[map, surface, _]| (map / (surface * mean), *surface)).collect();
        ratios.retain(|(ratio, _)| ratio.is_finite());
        ratios.par_sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let percentile = |share: f64| {
            let mut sum = 0.0;
            let at = ratios.iter().find(|(_, area)| {
                sum += area;
                sum >= share * surface
            });
            at.or(ratios.last()).map_or(0.0, |(ratio, _)| *ratio)
        };
        report.overlap = again / mapped;
        report.stretch = (stretch / surface * mean).sqrt();
        report.area_range = [percentile(0.01), percentile(0.99)];
        report.smallest = ratios.iter().map(|r| r.0).find(|ratio| *ratio > 0.0).unwrap_or(0.0);
        report
    }
}
