//! Vertices as samples, and for each the list of those that it receives light from.

use std::f64::consts::PI;

use glam::DVec3;
use rayon::prelude::*;

use translux::geometry::bvh::NO_TRIANGLE;
use translux::geometry::cluster;
use translux::math::simd::InstructionSet;
use translux::medium::dipole::Dipole;
use translux::medium::fresnel::BoundaryFit;
use translux::medium::profile::Profile;
use translux::scene::Scene;
use translux::transport::irradiance::SurfacePoint;
use translux::transport::kernel::medium::MediumKernel;
use translux::transport::kernel::{Block, PointSource, Receiver};
use translux::transport::receivers::{Group, NONE, Sphere};

/// Vertices whose candidates are found together.
const CAPACITY: usize = 16;

/// Rows that an estimate of the number of entries looks at.
const ESTIMATE_ROWS: usize = 512;

/// A vertex counts with the pieces around it where they are wider than this share of the distance to its sources.
const NEAR: f64 = 0.25;

/// Entries that are summed in single precision.
const BLOCK: usize = 256;

/// One entry of a list.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub(super) struct Entry {
    /// `Int R_d dA` over the area that the vertex stands for, RGB.
    pub(super) factors: [f32; 3],
    /// The vertex that light enters at.
    pub(super) vertex: u32,
}

/// How the integral over the area of a vertex is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Cell {
    /// R_d at the vertex times its area, as in the paper.
    #[cfg(test)]
    Point,
    /// The same unless the vertex is near; then the pieces of its triangles.
    Pieces,
}

/// The vertices of a scene, once for each part that uses them, neighbours together.
pub(super) struct Neighbourhoods {
    /// Where light enters, with the medium.
    pub(super) points: Vec<(SurfacePoint, u32)>,
    /// A third of the triangles of its part, mm^2.
    pub(super) areas_mm2: Vec<f64>,
    /// Runs of vertices of one part that lie close together.
    groups: Vec<Group>,
    /// The vertex that each source vertex takes its value from, or [`NONE`].
    pub(super) of_vertex: Vec<u32>,
    /// Centroids of the sixths of triangles around each vertex, and their areas.
    pieces: Vec<(DVec3, f64)>,
    first_piece: Vec<u32>,
    dipoles: Vec<[Dipole; 3]>,
}

impl Neighbourhoods {
    pub(super) fn new(scene: &Scene) -> Self {
        let mesh = &scene.mesh;
        let medium_of =
            |part: u32| scene.parts.parts.get(part as usize).filter(|p| p.transfers()).and_then(|p| p.medium);
        let dipoles: Vec<[Dipole; 3]> =
            scene.media.iter().map(|m| m.properties.dipoles(BoundaryFit::Published)).collect();
        // Corners by part and welded vertex.
        let mut corners = Vec::new();
        for (triangle, &part) in scene.parts.triangle_part.iter().enumerate() {
            if medium_of(part).is_some_and(|m| (m as usize) < dipoles.len()) {
                let welded = mesh.welded(triangle as u32);
                corners.extend((0..3).map(|corner| (part, welded[corner], 3 * triangle as u32 + corner as u32)));
            }
        }
        corners.par_sort_unstable();
        let runs: Vec<&[(u32, u32, u32)]> = corners.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)).collect();
        let at: Vec<DVec3> = runs.iter().map(|run| mesh.local_mm[run[0].1 as usize].as_dvec3()).collect();
        let mut result = Self {
            points: Vec::with_capacity(runs.len()),
            areas_mm2: Vec::with_capacity(runs.len()),
            groups: Vec::new(),
            of_vertex: Vec::new(),
            pieces: Vec::with_capacity(2 * corners.len()),
            first_piece: vec![0],
            dipoles,
        };
        let mut of_weld = vec![NONE; mesh.local_mm.len()];
        let mut next = 0u32;
        for of_part in runs.chunk_by(|a, b| a[0].0 == b[0].0) {
            let part = of_part[0][0].0;
            let mut order: Vec<u32> = (next..next + of_part.len() as u32).collect();
            for mut run in cluster::groups(&mut order, &at, CAPACITY) {
                run.first += next;
                run.end += next;
                result.groups.push(Group { run, part });
            }
            for index in order {
                let run = runs[index as usize];
                // A vertex that several parts share has the value of the first.
                let slot = &mut of_weld[run[0].1 as usize];
                *slot = (*slot).min(result.points.len() as u32);
                result.push(scene, at[index as usize], medium_of(part).unwrap_or(NONE), run);
            }
            next += of_part.len() as u32;
        }
        let mut used = vec![false; mesh.local_mm.len()];
        mesh.triangles.iter().flatten().for_each(|&v| used[v as usize] = true);
        let value_of = |(&weld, used): (&u32, bool)| if used { of_weld[weld as usize] } else { NONE };
        result.of_vertex = mesh.weld.iter().zip(used).map(value_of).collect();
        result
    }

    /// Adds a vertex by the corners of its triangles, three times the triangle plus the corner.
    fn push(&mut self, scene: &Scene, at: DVec3, medium: u32, corners: &[(u32, u32, u32)]) {
        let (mut normal, mut area) = (DVec3::ZERO, 0.0);
        for &(_, _, corner) in corners {
            let (triangle, corner) = (corner / 3, corner as usize % 3);
            normal += scene.mesh.cross_mm2(triangle);
            let third = scene.mesh.area_mm2(triangle) / 3.0;
            area += third;
            let all = scene.mesh.corners_local_mm(triangle);
            let (own, left, right) = (all[corner], all[(corner + 1) % 3], all[(corner + 2) % 3]);
            let centre = (own + left + right) / 3.0;
            for other in [left, right] {
                self.pieces.push(((own + 0.5 * (own + other) + centre) / 3.0, 0.5 * third));
            }
        }
        self.first_piece.push(self.pieces.len() as u32);
        self.points.push((SurfacePoint { at, normal: normal.normalize_or_zero(), triangle: NO_TRIANGLE }, medium));
        self.areas_mm2.push(area);
    }

    pub(super) fn len(&self) -> usize {
        self.points.len()
    }

    fn at(&self, vertex: usize) -> DVec3 {
        self.points[vertex].0.at
    }

    /// Positions of a group of vertices.
    fn sphere(&self, group: Group) -> Sphere {
        let at: Vec<DVec3> = group.run.range().map(|i| self.at(i)).collect();
        Sphere::around(&at)
    }

    fn range(&self, group: Group, ranges_mm: &[f64]) -> f64 {
        let medium = self.points[group.run.first as usize].1;
        ranges_mm.get(medium as usize).copied().unwrap_or(0.0)
    }

    /// Calls `take` with each row of `step`-th groups and the vertices of its list, ascending; what `end` makes of each group, in
    /// their order.
    fn visit<T, U: Send>(
        &self,
        ranges_mm: &[f64],
        step: usize,
        take: impl Fn(&mut T, usize, &[u32]) + Sync,
        start: impl Fn() -> T + Sync,
        end: impl Fn(T) -> U + Sync,
    ) -> Vec<U> {
        let spheres: Vec<Sphere> = self.groups.par_iter().map(|g| self.sphere(*g)).collect();
        let chosen: Vec<usize> = (0..self.groups.len()).step_by(step.max(1)).collect();
        let of_group = |&index: &usize| {
            let group = self.groups[index];
            let range = self.range(group, ranges_mm);
            let (mut result, mut candidates, mut list) = (start(), Vec::new(), Vec::new());
            let first = self.groups.partition_point(|g| g.part < group.part);
            let last = self.groups.partition_point(|g| g.part <= group.part);
            for other in first..last {
                let reach = range + spheres[index].radius_mm + spheres[other].radius_mm;
                // Rounding of the radii must not lose what the exact test below would take.
                if spheres[index].centre_mm.distance(spheres[other].centre_mm) <= reach * (1.0 + 1e-9) {
                    candidates.extend(self.groups[other].run.first..self.groups[other].run.end);
                }
            }
            for row in group.run.range() {
                list.clear();
                let at = self.at(row);
                let within = |i: &u32| *i as usize == row || self.at(*i as usize).distance_squared(at) <= range * range;
                list.extend(candidates.iter().copied().filter(within));
                take(&mut result, row, &list);
            }
            end(result)
        };
        chosen.par_iter().map(of_group).collect()
    }

    /// Entries of all lists together.
    pub(super) fn entries(&self, ranges_mm: &[f64]) -> u64 {
        self.visit(ranges_mm, 1, |sum: &mut u64, _, list| *sum += list.len() as u64, || 0, |sum| sum).into_iter().sum()
    }

    /// About as many, from some of the rows.
    pub(super) fn estimated_entries(&self, ranges_mm: &[f64]) -> u64 {
        let step = (self.groups.len() / (ESTIMATE_ROWS / CAPACITY)).max(1);
        let count = |(rows, sum): &mut (u64, u64), _, list: &[u32]| {
            *rows += 1;
            *sum += list.len() as u64;
        };
        let found = self.visit(ranges_mm, step, count, || (0, 0), |found| found);
        let (rows, sum) = found.into_iter().fold((0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
        (sum as f64 / rows.max(1) as f64 * self.len() as f64) as u64
    }

    /// Radiosity of one vertex from all of its part, and from what is in range, under each light by its irradiance.
    pub(super) fn sums(&self, to: usize, ranges_mm: &[f64], irradiance: &[Vec<DVec3>]) -> Vec<[DVec3; 2]> {
        let mut sums = vec![[DVec3::ZERO; 2]; irradiance.len()];
        let group = self.groups.partition_point(|g| g.run.end as usize <= to);
        let Some(&own) = self.groups.get(group) else { return sums };
        let range = self.range(own, ranges_mm);
        for group in self.groups.iter().filter(|g| g.part == own.part) {
            for from in group.run.range() {
                let factors = DVec3::from(self.factors(to, from, Cell::Pieces));
                let near = from == to || self.at(from).distance_squared(self.at(to)) <= range * range;
                for (sums, irradiance) in sums.iter_mut().zip(irradiance) {
                    let part = factors * irradiance[from];
                    sums[0] += part;
                    sums[1] += if near { part } else { DVec3::ZERO };
                }
            }
        }
        sums
    }

    /// Whether R_d at a vertex times its area is what [`Neighbourhoods::factors`] gives.
    fn is_far(&self, to: usize, from: usize, cell: Cell) -> bool {
        let distance = self.at(from).distance(self.at(to));
        let near = |d: &Dipole| is_near(cell, self.areas_mm2[from], distance, d);
        to != from && !self.dipoles.get(self.points[to].1 as usize).is_some_and(|dipoles| dipoles.iter().any(near))
    }

    /// `Int R_d dA` over what a vertex stands for, as `to` receives it. The vertex itself is the disc of its area.
    pub(super) fn factors(&self, to: usize, from: usize, cell: Cell) -> [f64; 3] {
        let area = self.areas_mm2[from];
        let Some(dipoles) = self.dipoles.get(self.points[to].1 as usize) else { return [0.0; 3] };
        if to == from {
            let radius = (area / PI).sqrt();
            return dipoles.each_ref().map(|d| d.disc(radius));
        }
        let at = self.at(to);
        let distance = self.at(from).distance(at);
        let pieces = self.first_piece[from] as usize..self.first_piece[from + 1] as usize;
        dipoles.each_ref().map(|d| {
            if is_near(cell, area, distance, d) {
                self.pieces[pieces.clone()].iter().map(|(p, a)| d.reflectance(p.distance(at)) * a).sum()
            } else {
                d.reflectance(distance) * area
            }
        })
    }
}

/// Whether the area of a source is wide as seen from a receiver.
fn is_near(cell: Cell, area_mm2: f64, distance_mm: f64, dipole: &Dipole) -> bool {
    cell == Cell::Pieces && area_mm2 > PI * (NEAR * distance_mm.hypot(dipole.z_real_mm)).powi(2)
}

/// The lists of neighbouring vertices.
#[derive(Default)]
struct Rows {
    ends: Vec<usize>,
    entries: Vec<Entry>,
}

impl Rows {
    fn iter(&self) -> impl Iterator<Item = &[Entry]> {
        let mut first = 0;
        self.ends.iter().map(move |&end| {
            let row = self.entries.get(first..end).unwrap_or(&[]);
            first = end;
            row
        })
    }
}

/// The vertices of a group as receivers.
struct GroupBlock {
    level: InstructionSet,
    centre: DVec3,
    block: Block,
    factors: Vec<[f32; 3]>,
}

impl GroupBlock {
    /// R_d at each of them times the area of a source.
    fn receive(&mut self, kernel: &MediumKernel, at: DVec3, area_mm2: f64) {
        let source = PointSource::new(at, DVec3::splat(area_mm2), self.centre);
        kernel.add_points(self.level, &mut self.block, &[source]);
        self.block.take(&mut self.factors);
    }
}

/// The lists of all vertices, in their order.
pub(super) struct Lists {
    groups: Vec<Rows>,
}

impl Lists {
    pub(super) fn new(vertices: &Neighbourhoods, ranges_mm: &[f64], cell: Cell) -> Self {
        let level = InstructionSet::detect();
        let kernels: Vec<MediumKernel> = vertices.dipoles.iter().map(|d| MediumKernel::of_dipoles(*d)).collect();
        let of_group = |(mut lists, first): (Vec<Vec<u32>>, usize)| {
            let medium = vertices.points[first].1 as usize;
            let at: Vec<DVec3> = (first..first + lists.len()).map(|row| vertices.at(row)).collect();
            let mut block =
                GroupBlock { level, centre: at[0], block: Block::default(), factors: vec![[0.0; 3]; lists.len()] };
            block.block.reset(block.centre, at.iter().map(|&at_mm| Receiver { at_mm, normal: DVec3::ZERO }));
            let mut rows: Vec<Vec<Entry>> = lists.iter().map(|list| Vec::with_capacity(list.len())).collect();
            // Ascending in every list, so that the next vertex of all is the least of the next of each.
            lists.iter_mut().for_each(|list| list.reverse());
            while let Some(vertex) = lists.iter().filter_map(|list| list.last().copied()).min() {
                let from = vertex as usize;
                block.receive(&kernels[medium], vertices.at(from), vertices.areas_mm2[from]);
                for (i, (list, row)) in lists.iter_mut().zip(&mut rows).enumerate() {
                    if list.last() == Some(&vertex) {
                        list.pop();
                        let factors = match vertices.is_far(first + i, from, cell) {
                            true => block.factors[i],
                            false => vertices.factors(first + i, from, cell).map(|f| f as f32),
                        };
                        row.push(Entry { factors, vertex });
                    }
                }
            }
            let mut end = 0;
            let ends = rows.iter().map(|row| {
                end += row.len();
                end
            });
            Rows { ends: ends.collect(), entries: rows.concat() }
        };
        let take = |(lists, first): &mut (Vec<Vec<u32>>, usize), to: usize, list: &[u32]| {
            if lists.is_empty() {
                *first = to;
            }
            lists.push(list.to_vec());
        };
        Self { groups: vertices.visit(ranges_mm, 1, take, Default::default, of_group) }
    }

    /// Radiosity of every vertex from the irradiance at every vertex.
    pub(super) fn radiosity(&self, irradiance: &[DVec3]) -> Vec<DVec3> {
        // Any irradiance fits single precision relative to the largest.
        let largest = irradiance.iter().fold(0.0, |a: f64, e| a.max(e.max_element()));
        let unit = if largest > 0.0 && largest.is_finite() { largest } else { 1.0 };
        let entering: Vec<[f32; 3]> = irradiance.iter().map(|e| (*e / unit).as_vec3().to_array()).collect();
        let of_group = |rows: &Rows| rows.iter().map(|row| unit * sum(row, &entering)).collect::<Vec<DVec3>>();
        let groups: Vec<Vec<DVec3>> = self.groups.par_iter().map(of_group).collect();
        groups.concat()
    }

    #[cfg(test)]
    pub(super) fn rows(&self) -> impl Iterator<Item = &[Entry]> {
        self.groups.iter().flat_map(Rows::iter)
    }

    /// Leaves each vertex out of its own list, as the paper's pseudo code does.
    #[cfg(test)]
    pub(super) fn clear_own(&mut self) {
        let mut row = 0;
        for group in &mut self.groups {
            let mut first = 0;
            for &end in &group.ends {
                group.entries[first..end].iter_mut().filter(|e| e.vertex == row).for_each(|e| e.factors = [0.0; 3]);
                (first, row) = (end, row + 1);
            }
        }
    }

    /// Bytes in memory.
    pub(super) fn bytes(&self) -> usize {
        self.groups.iter().map(|g| size_of_val(g.ends.as_slice()) + size_of_val(g.entries.as_slice())).sum()
    }
}

fn sum(row: &[Entry], entering: &[[f32; 3]]) -> DVec3 {
    let mut total = DVec3::ZERO;
    for block in row.chunks(BLOCK) {
        let mut sums = [0.0f32; 3];
        for Entry { factors, vertex } in block {
            let e = entering.get(*vertex as usize).copied().unwrap_or_default();
            (0..3).for_each(|c| sums[c] += factors[c] * e[c]);
        }
        total += DVec3::from(sums.map(f64::from));
    }
    total
}
