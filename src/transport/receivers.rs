//! Points where radiosity is gathered: a receiver for each welded vertex of a part, in groups that lie close together.

use std::collections::{BTreeMap, BTreeSet};

use glam::DVec3;

use super::kernel::Receiver;
use crate::geometry::cluster::{self, Run};
use crate::geometry::mesh::Mesh;
use crate::geometry::part_table::PartTable;
use crate::math::slices::cut;
use crate::math::statistics::{VertexError, vertex_error_of_some};
use crate::parallel::*;

/// Points that gather flux, grouped by part and place.
#[derive(Clone, Debug, Default, serde::Serialize, serde::Deserialize)]
pub struct Receivers {
    /// Positions relative to the mesh's origin, mm, group after group.
    pub positions: Vec<DVec3>,
    /// Their unit normals, outward; zero or missing where nobody asked for them.
    pub normals: Vec<DVec3>,
    /// Factors on what they gather, RGB; missing where there are none.
    pub factors: Vec<DVec3>,
    /// Runs of `positions` that lie close together and belong to one part.
    pub groups: Vec<Group>,
    /// For each source vertex the receiver whose value it takes; `NONE` for vertices without transferring area.
    pub of_vertex: Vec<u32>,
    /// The spheres around the groups where these were larger once; else missing.
    pub spheres: Vec<Sphere>,
}

/// Vertices of one task at least.
const VERTICES_OF_A_TASK: usize = 1 << 13;

/// No receiver.
pub const NONE: u32 = u32::MAX;

/// Neighbouring receivers of one part.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Group {
    /// Positions in [`Receivers::positions`].
    pub run: Run,
    /// The part whose flux they gather.
    pub part: u32,
}

/// A sphere around points.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Sphere {
    /// Middle of their bounding box, mm.
    pub centre_mm: DVec3,
    /// Distance of the farthest, mm.
    pub radius_mm: f64,
}

impl Sphere {
    /// The sphere around these points; about the origin if there are none.
    pub fn around(points: &[DVec3]) -> Self {
        let grow = |(low, high): (DVec3, DVec3), &p: &DVec3| (low.min(p), high.max(p));
        let (low, high) = points.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), grow);
        let centre_mm = if points.is_empty() { DVec3::ZERO } else { 0.5 * (low + high) };
        Self { centre_mm, radius_mm: points.iter().map(|p| p.distance(centre_mm)).fold(0.0, f64::max) }
    }
}

/// A subset of receivers, at which errors are measured or choices made.
#[derive(Clone, Debug, Default)]
pub struct ProbePoints {
    /// Index of each among all receivers.
    pub indices: Vec<u32>,
    /// Area around each, mm^2.
    pub areas_mm2: Vec<f64>,
    /// Number of all receivers, that these stand for.
    pub all: usize,
}

impl ProbePoints {
    /// The receivers of some indices; `areas_mm2` are those around all.
    pub fn new(indices: Vec<u32>, areas_mm2: &[f64]) -> Self {
        let all = areas_mm2.len();
        let areas_mm2 = indices.iter().map(|&i| areas_mm2.get(i as usize).copied().unwrap_or(0.0)).collect();
        Self { indices, areas_mm2, all }
    }

    /// Values at these receivers, out of those of all.
    pub fn of<T: Copy + Default>(&self, all: &[T]) -> Vec<T> {
        self.indices.iter().map(|&i| all.get(i as usize).copied().unwrap_or_default()).collect()
    }

    /// Error of radiosity at these points, whose 99.9th percentile and worst are expected of all receivers; none where the truth is
    /// black at all of them.
    pub fn error(&self, values: &[DVec3], truth: &[DVec3]) -> VertexError {
        vertex_error_of_some(values, truth, &self.areas_mm2, self.all).or_none()
    }
}

impl Receivers {
    /// Receivers of a group.
    pub fn of(&self, group: Group) -> impl ExactSizeIterator<Item = Receiver> {
        let first = group.run.range().start;
        let normal = move |i: usize| self.normals.get(first + i).copied().unwrap_or_default();
        let places = self.positions[group.run.range()].iter().enumerate();
        places.map(move |(i, &at_mm)| Receiver { at_mm, normal: normal(i) })
    }

    /// One receiver for each welded vertex that a transferring part uses. A vertex that several parts share belongs to
    /// the first of them. Groups hold at most `capacity` receivers.
    pub fn new(mesh: &Mesh, parts: &PartTable, capacity: usize) -> Self {
        let part_of_weld = parts_of_welds(mesh, parts);
        let at = |(vertex, &part): (usize, &u32)| (part != NONE).then(|| (part, mesh.local_mm[vertex].as_dvec3()));
        let places: Vec<Option<(u32, DVec3)>> = part_of_weld.iter().enumerate().map(at).collect();
        let normals = normals_of_welds(mesh, parts, &part_of_weld);
        let mut result = Self::oriented(&places, &normals, capacity);
        let mut of_vertex = vec![NONE; mesh.local_mm.len()];
        for &v in mesh.triangles.iter().flatten() {
            of_vertex[v as usize] = result.of_vertex[mesh.weld[v as usize] as usize];
        }
        result.of_vertex = of_vertex;
        result
    }

    /// Receivers anywhere: places (relative to the mesh's origin, mm) with the part whose flux they gather, or none. Place `i` takes
    /// the value of receiver `of_vertex[i]`. Groups hold at most `capacity` receivers.
    pub fn at(places: &[Option<(u32, DVec3)>], capacity: usize) -> Self {
        Self::oriented(places, &[], capacity)
    }

    /// [`Self::at`] with a unit normal for each place; zero for those that have none.
    pub fn oriented(places: &[Option<(u32, DVec3)>], normals: &[DVec3], capacity: usize) -> Self {
        let positions: Vec<DVec3> = places.iter().map(|place| place.map_or(DVec3::ZERO, |(_, at)| at)).collect();
        let mut by_part: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
        for (i, place) in places.iter().enumerate() {
            if let Some((part, _)) = place {
                by_part.entry(*part).or_default().push(i as u32);
            }
        }
        let mut result = Self { of_vertex: vec![NONE; places.len()], ..Self::default() };
        for (part, mut order) in by_part {
            let first = result.positions.len() as u32;
            for run in cluster::groups(&mut order, &positions, capacity) {
                let run = Run { first: first + run.first, end: first + run.end };
                result.groups.push(Group { run, part });
            }
            for place in order {
                result.of_vertex[place as usize] = result.positions.len() as u32;
                result.positions.push(positions[place as usize]);
                result.normals.push(normals.get(place as usize).copied().unwrap_or_default());
            }
        }
        result
    }

    /// The same receivers with factors on what they gather, RGB, one for each of the places or vertices that they are made of.
    #[must_use]
    pub fn with_factors(mut self, of_places: &[DVec3]) -> Self {
        self.factors = vec![DVec3::ONE; self.len()];
        for (receiver, factor) in self.of_vertex.iter().zip(of_places) {
            if let Some(of_receiver) = self.factors.get_mut(*receiver as usize) {
                *of_receiver = *factor;
            }
        }
        self
    }

    /// The same receivers with other unit normals, one for each of the places or vertices that they are made of; zero leaves what there is.
    #[must_use]
    pub fn with_normals(mut self, of_places: &[DVec3]) -> Self {
        self.normals.resize(self.len(), DVec3::ZERO);
        for (receiver, normal) in self.of_vertex.iter().zip(of_places).filter(|(_, normal)| **normal != DVec3::ZERO) {
            if let Some(of_receiver) = self.normals.get_mut(*receiver as usize) {
                *of_receiver = *normal;
            }
        }
        self
    }

    /// The factor of a receiver, RGB.
    #[inline(always)]
    pub(super) fn factor(&self, receiver: usize) -> DVec3 {
        self.factors.get(receiver).copied().unwrap_or(DVec3::ONE)
    }

    /// Values of the receivers, `each` of every one, cut into those of each group.
    pub(super) fn cut<'a, T>(&self, values: &'a mut [T], each: usize) -> Vec<&'a mut [T]> {
        cut(values, self.groups.iter().map(|group| group.run.range().len() * each))
    }

    /// Number of receivers.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// The sphere around a group.
    pub fn sphere(&self, group: Group) -> Sphere {
        let index = self.groups.partition_point(|other| other.run.first < group.run.first);
        let known = self.spheres.get(index).copied();
        known.unwrap_or_else(|| Sphere::around(&self.positions[group.run.range()]))
    }

    /// True if there are none.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// A third of the area of the triangles around each receiver, mm^2; `mesh` is the one that they are vertices of.
    pub fn areas_mm2(&self, mesh: &Mesh) -> Vec<f64> {
        let mut areas = vec![0.0; self.len()];
        for (index, triangle) in mesh.triangles.iter().enumerate() {
            let third = mesh.cross_mm2(index as u32).length() / 6.0;
            for &v in triangle {
                if let Some(area) = areas.get_mut(self.of_vertex[v as usize] as usize) {
                    *area += third;
                }
            }
        }
        areas
    }

    /// Some of the receivers, by their ascending indices, in groups of at most `capacity`; no vertex takes their values.
    pub fn only(&self, indices: &[u32], capacity: usize) -> Self {
        let mut result = Self::default();
        let mut rest = indices;
        for part in self.groups.chunk_by(|a, b| a.part == b.part) {
            let end = part.last().map_or(0, |g| g.run.end);
            let (mine, others) = rest.split_at(rest.partition_point(|&i| i < end));
            rest = others;
            for run in mine.chunks(capacity.max(1)) {
                let first = result.positions.len() as u32;
                result.positions.extend(run.iter().filter_map(|&i| self.positions.get(i as usize)));
                result.normals.extend(run.iter().filter_map(|&i| self.normals.get(i as usize)));
                result.factors.extend(run.iter().filter_map(|&i| self.factors.get(i as usize)));
                let run = Run { first, end: result.positions.len() as u32 };
                result.groups.push(Group { run, part: part[0].part });
            }
        }
        result
    }

    /// The receivers of some vertices, in their groups among all: what each gathers from is the same as among all. Place `i` is vertex
    /// `vertices[i]`.
    pub fn of_vertices(&self, vertices: &[u32]) -> Self {
        let mut of_vertex: Vec<u32> =
            vertices.iter().map(|&v| self.of_vertex.get(v as usize).copied().unwrap_or(NONE)).collect();
        let wanted: BTreeSet<u32> = of_vertex.iter().copied().filter(|receiver| *receiver != NONE).collect();
        let mut result = Self::default();
        for group in &self.groups {
            let first = result.positions.len() as u32;
            for receiver in wanted.range(group.run.first..group.run.end).map(|receiver| *receiver as usize) {
                result.positions.push(self.positions[receiver]);
                result.normals.extend(self.normals.get(receiver));
                result.factors.extend(self.factors.get(receiver));
            }
            let end = result.positions.len() as u32;
            if end > first {
                result.groups.push(Group { run: Run { first, end }, part: group.part });
                result.spheres.push(self.sphere(*group));
            }
        }
        let wanted: Vec<u32> = wanted.into_iter().collect();
        for receiver in of_vertex.iter_mut().filter(|receiver| **receiver != NONE) {
            *receiver = wanted.partition_point(|there| there < receiver) as u32;
        }
        Self { of_vertex, ..result }
    }

    /// Values of the receivers handed to the source vertices; zero where a vertex has none.
    pub fn expand(&self, values: &[DVec3]) -> Vec<DVec3> {
        self.of_vertex.iter().map(|&r| values.get(r as usize).copied().unwrap_or(DVec3::ZERO)).collect()
    }

    /// [`Self::expand`] of values in single precision (RGB, the fourth unused) times `scale`, on all threads.
    pub fn expand_rgb(&self, values: &[[f32; 4]], scale: f64) -> Vec<DVec3> {
        let of_vertex = |&receiver: &u32| match values.get(receiver as usize) {
            Some(&[r, g, b, _]) => DVec3::new(r.into(), g.into(), b.into()) * scale,
            None => DVec3::ZERO,
        };
        self.of_vertex.par_iter().with_min_len(VERTICES_OF_A_TASK).map(of_vertex).collect()
    }

    /// About `count` receivers or more from groups spread over all of them, a few of each, and their indices; different
    /// `phase`s (0 to 2) give disjoint subsets. Where there are few receivers, each phase has a third of them, or
    /// all where there are very few.
    pub fn subset(&self, count: usize, phase: usize) -> (Self, Vec<u32>) {
        const OF_A_GROUP: usize = 8;
        const PHASES: usize = 3;
        let (groups, wanted) = (self.groups.len(), count.max(1));
        let few = groups * OF_A_GROUP < PHASES * wanted;
        let very_few = self.len() < PHASES * OF_A_GROUP;
        let step = if few { 1 } else { groups * OF_A_GROUP / wanted };
        let mut subset = Self::default();
        let mut indices = Vec::new();
        for group in self.groups.iter().skip(if few { 0 } else { phase * step / PHASES }).step_by(step) {
            let first = subset.positions.len() as u32;
            let all = group.run.first..group.run.end;
            if few {
                indices.extend(all.filter(|i| very_few || *i as usize % PHASES == phase % PHASES));
            } else {
                indices.extend(all.take(OF_A_GROUP));
            }
            subset.positions.extend(indices[first as usize..].iter().map(|&i| self.positions[i as usize]));
            subset.normals.extend(indices[first as usize..].iter().filter_map(|&i| self.normals.get(i as usize)));
            subset.factors.extend(indices[first as usize..].iter().filter_map(|&i| self.factors.get(i as usize)));
            let run = Run { first, end: subset.positions.len() as u32 };
            if !run.range().is_empty() {
                subset.groups.push(Group { run, part: group.part });
            }
        }
        (subset, indices)
    }

    /// All receivers where there are no more than `most`, else as [`Self::probe_points`].
    pub fn all_or_probe_points(&self, areas_mm2: &[f64], most: usize, few: (usize, usize)) -> (Self, ProbePoints) {
        if self.len() <= most {
            (self.clone(), ProbePoints::new((0..self.len() as u32).collect(), areas_mm2))
        } else {
            self.probe_points(areas_mm2, few)
        }
    }

    /// As [`Self::subset`], with the areas around the receivers of the subset; `areas_mm2` are those around all.
    pub fn probe_points(&self, areas_mm2: &[f64], (count, phase): (usize, usize)) -> (Self, ProbePoints) {
        let (subset, indices) = self.subset(count, phase);
        (subset, ProbePoints::new(indices, areas_mm2))
    }
}

/// For each welded vertex the mean normal of the triangles of its part around it, by their areas.
fn normals_of_welds(mesh: &Mesh, parts: &PartTable, part_of_weld: &[u32]) -> Vec<DVec3> {
    let mut normals = vec![DVec3::ZERO; mesh.local_mm.len()];
    for (triangle, &part) in parts.triangle_part.iter().enumerate().take(mesh.triangles.len()) {
        let cross = mesh.cross_mm2(triangle as u32);
        for weld in mesh.welded(triangle as u32) {
            if part_of_weld[weld as usize] == part {
                normals[weld as usize] += cross;
            }
        }
    }
    normals.iter().map(|n| n.normalize_or_zero()).collect()
}

/// For each welded vertex the first transferring part that uses it, or [`NONE`].
pub(super) fn parts_of_welds(mesh: &Mesh, parts: &PartTable) -> Vec<u32> {
    let mut result = vec![NONE; mesh.local_mm.len()];
    for (triangle, &part) in mesh.triangles.iter().zip(&parts.triangle_part) {
        if parts.parts.get(part as usize).is_some_and(|p| p.transfers()) {
            for &v in triangle {
                let slot = &mut result[mesh.weld[v as usize] as usize];
                *slot = (*slot).min(part);
            }
        }
    }
    result
}

#[cfg(test)]
#[path = "receivers_tests.rs"]
mod tests;
