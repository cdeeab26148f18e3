//! The measurements behind the mesh check, of the whole mesh and of its parts against the mean free path of their medium.

use glam::DVec3;
use serde::Serialize;

use crate::geometry::buckets::Buckets;
use crate::geometry::mesh::{Mesh, simple_chains};
use crate::geometry::parts::{Analysis, ComponentTree, DisjointSets, Part, Parts, Role, is_slit};
use crate::math::random::uniform;
use crate::parallel::*;

/// A part is thin where a straight way inwards leaves it within this many mean free paths: diffusion, which assumes
/// many scattering events between two surfaces, is inaccurate there.
pub const THIN_MEAN_FREE_PATHS: f64 = 3.0;

/// Inward rays that measure thickness, spread over the translucent area of the whole mesh.
pub const THICKNESS_SAMPLES: usize = 2048;

/// Mean free paths 1/sigma_t' of one medium over its colour channels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeanFreePath {
    /// Mean free path of the densest channel, in mm: triangles must resolve it.
    pub shortest_mm: f64,
    /// Mean free path of the clearest channel, in mm: thickness must exceed it.
    pub longest_mm: f64,
}

/// Measurements of one part.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct PartCheck {
    /// The part itself.
    #[serde(flatten)]
    pub part: Part,
    /// Thickness of a sheet of the same area and volume, 2 V / A, in mm; none for open parts.
    pub mean_thickness_mm: Option<f64>,
    /// 5th and 50th percentile over the area of the way straight inwards to the next back face of the part, in mm;
    /// none where so many of the rays find no way out, and for parts with fewer than 16 of the samples.
    pub thickness_mm: [Option<f64>; 2],
    /// Share of the area where that way is below [`THIN_MEAN_FREE_PATHS`]; none without a mean free path. Parts with
    /// fewer than 16 samples are judged by their mean thickness.
    pub thin_area_share: Option<f64>,
    /// Share of the area in triangles with an edge longer than the shortest mean free path; none without one.
    pub long_edge_area_share: Option<f64>,
}

/// Stage number of the random numbers that place thickness samples.
const STAGE: u64 = 0x7468_6963_6b6e_6573;
/// Samples below which a part's percentiles say nothing.
const FEW_SAMPLES: usize = 16;

pub(super) struct EdgeCounts {
    pub count: usize,
    pub boundary: usize,
    pub loops: usize,
    pub slits: usize,
    pub non_manifold: usize,
    pub lengths_mm: [f64; 3],
}

/// Counts edges by the number of their triangles over all media, and joins the boundary ones to loops.
pub(super) fn edges(mesh: &Mesh, analysis: &Analysis) -> EdgeCounts {
    let mut boundary = Vec::new();
    let mut lengths = Vec::with_capacity(mesh.triangles.len() * 3 / 2);
    let mut non_manifold = 0;
    for edge in analysis.edges.edges() {
        match edge.valence() {
            1 => boundary.push(edge.vertices),
            2 => {}
            _ => non_manifold += 1,
        }
        let [a, b] = edge.vertices.map(|v| mesh.local_mm[v as usize]);
        lengths.push((b - a).length());
    }
    let chains = simple_chains(&boundary);
    let slits = chains.iter().filter(|chain| is_slit(mesh, chain)).count();
    let count = lengths.len();
    let lengths_mm = [0.0, 0.5, 1.0].map(|p| f64::from(percentile(&mut lengths, p)));
    EdgeCounts { count, boundary: boundary.len(), loops: chains.len(), slits, non_manifold, lengths_mm }
}

/// 1st and 50th percentile of the quality of triangles.
pub(super) fn triangle_shapes(mesh: &Mesh) -> [f64; 2] {
    let quality = |t| {
        let [a, b, c] = mesh.corners_local_mm(t);
        let squares = a.distance_squared(b) + b.distance_squared(c) + c.distance_squared(a);
        (2.0 * 3f64.sqrt() * (b - a).cross(c - a).length() / squares) as f32
    };
    let mut values: Vec<f32> = (0..mesh.triangles.len() as u32).map(quality).collect();
    [0.01, 0.5].map(|p| f64::from(percentile(&mut values, p)))
}

/// The value at a fraction of the sorted order; 0 for no values.
fn percentile(values: &mut [f32], fraction: f64) -> f32 {
    if values.is_empty() {
        return 0.0;
    }
    let place = ((values.len() - 1) as f64 * fraction).round() as usize;
    *values.select_nth_unstable_by(place, f32::total_cmp).1
}

/// Number of welded vertices in use, and of those with more than one fan of triangles.
pub(super) fn vertices(mesh: &Mesh) -> (usize, usize) {
    // For each corner the edge opposite to it, in the direction of the triangle.
    let of_triangle = |t: u32| {
        let [a, b, c] = mesh.welded(t);
        [(a, [b, c]), (b, [c, a]), (c, [a, b])]
    };
    let opposite = Buckets::new(mesh.weld.len(), || (0..mesh.triangles.len() as u32).flat_map(of_triangle));
    let used = opposite.all().filter(|link| !link.is_empty()).count();
    (used, (0..opposite.len()).into_par_iter().filter_map(|v| is_split(opposite.bucket(v)).then_some(())).count())
}

/// True if the edges around a vertex form more than one connected piece.
fn is_split(link: &[[u32; 2]]) -> bool {
    let Some(&[first, mut end]) = link.first() else { return false };
    // Nearly every vertex has one small closed fan: walk round it.
    if link.len() <= 16 {
        let mut steps = 1;
        while end != first && steps < link.len() {
            match link.iter().find(|edge| edge[0] == end) {
                Some(edge) => end = edge[1],
                None => break,
            }
            steps += 1;
        }
        if end == first && steps == link.len() {
            return false;
        }
    }
    let mut around: Vec<u32> = link.iter().flatten().copied().collect();
    around.sort_unstable();
    around.dedup();
    let mut sets = DisjointSets::new(around.len());
    let place = |v: u32| around.partition_point(|&w| w < v) as u32;
    for &[a, b] in link {
        sets.join(place(a), place(b));
    }
    sets.labels().1 > 1
}

/// Thickness and resolution of every part.
pub(super) fn parts(mesh: &Mesh, parts: &Parts, paths: &[MeanFreePath]) -> Vec<PartCheck> {
    let thickness = thickness_samples(mesh, parts);
    let path = |role| match role {
        Role::Medium(m) => paths.get(m as usize),
        Role::Opaque => None,
    };
    let resolved: Vec<Option<f64>> = parts.parts.iter().map(|part| Some(path(part.role)?.shortest_mm)).collect();
    let long_area = long_edge_areas_mm2(mesh, &parts.triangle_part, &resolved);
    let one = |(part, (mut ways, long)): (&Part, (Vec<f32>, f64))| {
        let mean_thickness_mm = part.volume_mm3.filter(|_| part.area_mm2 > 0.0).map(|v| 2.0 * v.abs() / part.area_mm2);
        let enough = ways.len() >= FEW_SAMPLES;
        let at = |ways: &mut [f32], p| Some(f64::from(percentile(ways, p))).filter(|t| enough && t.is_finite());
        let limit = path(part.role).map(|p| THIN_MEAN_FREE_PATHS * p.longest_mm);
        let thin_share = |limit: f64| {
            if enough {
                Some(ways.iter().filter(|&&w| f64::from(w) < limit).count() as f64 / ways.len() as f64)
            } else {
                mean_thickness_mm.map(|t| if t < limit { 1.0 } else { 0.0 })
            }
        };
        PartCheck {
            thin_area_share: limit.and_then(thin_share),
            long_edge_area_share: limit.filter(|_| part.area_mm2 > 0.0).map(|_| long / part.area_mm2),
            part: part.clone(),
            mean_thickness_mm,
            thickness_mm: [at(&mut ways, 0.05), at(&mut ways, 0.5)],
        }
    };
    parts.parts.iter().zip(thickness.into_iter().zip(long_area)).map(one).collect()
}

/// For each part the area in triangles with an edge longer than what its triangles must resolve, mm^2; zero for parts that need
/// resolve nothing.
pub fn long_edge_areas_mm2(mesh: &Mesh, triangle_part: &[u32], resolved_mm: &[Option<f64>]) -> Vec<f64> {
    let mut areas = vec![0.0; resolved_mm.len()];
    for (t, &p) in (0..mesh.triangles.len() as u32).zip(triangle_part) {
        let Some(&Some(resolved)) = resolved_mm.get(p as usize) else { continue };
        let [a, b, c] = mesh.corners_local_mm(t);
        let longest2 = a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a));
        if longest2 > resolved * resolved {
            areas[p as usize] += mesh.area_mm2(t);
        }
    }
    areas
}

/// For each part, the lengths of ways inwards from points spread evenly over its area; infinite without a way out.
fn thickness_samples(mesh: &Mesh, parts: &Parts) -> Vec<Vec<f32>> {
    let translucent: Vec<u32> = (0..mesh.triangles.len() as u32)
        .filter(|&t| parts.parts[parts.triangle_part[t as usize] as usize].role != Role::Opaque)
        .collect();
    let mut samples = vec![Vec::new(); parts.parts.len()];
    let mut sum = 0.0;
    let cumulative: Vec<f64> = translucent
        .iter()
        .map(|&t| {
            sum += mesh.area_mm2(t);
            sum
        })
        .collect();
    if sum <= 0.0 {
        return samples;
    }
    let tree = ComponentTree::of(translucent.iter().map(|&t| mesh.corners_local_mm(t)).collect());
    let t_min = 1e-6 * mesh.diagonal_mm();
    let way = |i: usize| {
        let random = |d| uniform(STAGE, i as u64, d);
        let target = (i as f64 + random(0)) / THICKNESS_SAMPLES as f64 * sum;
        let item = cumulative.partition_point(|&c| c <= target).min(translucent.len() - 1);
        let t = translucent[item];
        let part = parts.triangle_part[t as usize];
        let inwards = -mesh.normal(t);
        let same_part = |other: u32| parts.triangle_part[translucent[other as usize] as usize] == part;
        let way = tree.exit(point_on(mesh.corners_local_mm(t), random(1), random(2)), inwards, t_min, same_part);
        (part, way.map_or(f32::INFINITY, |w| w as f32))
    };
    let ways: Vec<(u32, f32)> = (0..THICKNESS_SAMPLES).into_par_iter().map(way).collect();
    for (part, way) in ways {
        samples[part as usize].push(way);
    }
    samples
}

/// A point of a triangle, uniform for uniform numbers (square-root map).
fn point_on([a, b, c]: [DVec3; 3], u: f64, v: f64) -> DVec3 {
    let s = u.sqrt();
    a * (1.0 - s) + b * (s * (1.0 - v)) + c * (s * v)
}
