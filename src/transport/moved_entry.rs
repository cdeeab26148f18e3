//! Entry of light where it first scatters.
//!
//! Light that enters at `y` along a refracted direction scatters for the first time a free path further on. A kernel
//! that was calibrated with diffuse entry knows the mean of that; under a lone direction the irradiance is moved by the
//! tangential part of the step: the place of the first collision is brought back to the surface along the outward normal
//! of the entrance. Where that meets no surface of the body, the light stays. No light is lost.
//!
//! Moved light is fetched, not thrown: each sample takes the irradiance of the places that steps of a few fixed lengths come from, which
//! is as smooth as the irradiance itself. Places are found between neighbours in a few directions and distances, which are looked up once for
//! all lights. What is thrown from the same samples with the same lengths says how much light there is of which
//! a neighbourhood has its share: where normals converge it gathers, and the fetched light is brought to that, over cells that are wide
//! enough to hold many samples.

use std::f64::consts::TAU;
use std::sync::OnceLock;

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::domain::Domain;
use super::irradiance::{Illumination, LightSampling, Pieces};
use super::many_lights::IrradianceRows;
use super::surface::Surface;
use crate::error::Result;
use crate::geometry::bvh::Ray;
use crate::geometry::mesh::Mesh;
use crate::geometry::samples::{Facet, Patch, bisect};
use crate::light::Light;
use crate::light::suns::apart;
use crate::progress::Progress;

/// Steps of each sample.
const STEPS: usize = 6;

/// Edge of the cells in mean free paths, and the least in distances between samples.
const CELL: f64 = 3.0;
const CELL_SAMPLES: f64 = 4.0;

/// Bounds of the factor of a cell; what is more is light that fetching does not find, and is spread over the cell.
const LEAST_FACTOR: f64 = 0.5;
const MOST_FACTOR: f64 = 2.0;

/// Directions and distances over the surface in which the neighbours of a sample are found; each distance is half of the next.
const AZIMUTHS: usize = 12;
const DISTANCES: usize = 4;

/// Distances shorter than this share of the radius of a sample stay in it.
const SHORT: f64 = 0.25;

/// Heights over the tangent plane within which surface is found, over the distance.
const SLOPE: f64 = 1.25;

/// Cosine towards the light below which samples look for none.
const TURNED_AWAY: f64 = -0.5;

/// Facets of every triangle, by their paths.
struct Facets {
    offsets: Vec<u32>,
    /// Path and sample.
    of: Vec<(u32, u32)>,
}

impl Facets {
    fn new(surface: &Surface) -> Self {
        let mut all: Vec<(u32, u32, u32)> = (0..surface.samples.len())
            .flat_map(|i| surface.samples.patch(i).iter().map(move |f| (f.triangle, f.path, i as u32)))
            .collect();
        all.sort_unstable();
        let count = surface.domain.mesh.triangles.len() as u32;
        let offsets = (0..=count).map(|t| all.partition_point(|f| f.0 < t) as u32).collect();
        Self { offsets, of: all.into_iter().map(|(_, path, sample)| (path, sample)).collect() }
    }

    /// The sample around a point of a triangle.
    fn at(&self, mesh: &Mesh, triangle: u32, point: DVec3) -> Option<u32> {
        let (from, to) = (*self.offsets.get(triangle as usize)?, *self.offsets.get(triangle as usize + 1)?);
        let of = self.of.get(from as usize..to as usize)?;
        let mut facet = Facet::whole(triangle);
        let mut corners = mesh.corners_local_mm(triangle);
        loop {
            if let Ok(found) = of.binary_search_by_key(&facet.path, |f| f.0) {
                return Some(of[found].1);
            }
            let [left, right] = facet.halves()?;
            let halves = bisect(corners);
            // The cut runs from the middle of the longest edge to the corner that both halves end with.
            let [first, middle, apex] = halves[0];
            let across = (middle - apex).cross((first - middle).cross(apex - middle));
            let is_left = (point - middle).dot(across) * (first - middle).dot(across) >= 0.0;
            (facet, corners) = if is_left { (left, halves[0]) } else { (right, halves[1]) };
        }
    }
}

/// Steps of light in a medium: their lengths, mm, and the share of the light of each channel that takes them.
#[derive(Clone, Copy)]
struct Steps {
    eta: f64,
    lengths_mm: [f64; STEPS],
    shares: [DVec3; STEPS],
}

/// Lights whose irradiance is moved at once.
const AT_ONCE: usize = 16;

/// Neighbours of samples along the surface.
type Around = [[u32; DISTANCES]; AZIMUTHS];

impl Steps {
    /// Strata of equal shares of the mean distribution of all channels, and the mean lengths in them; none without free paths.
    fn new(eta: f64, paths_mm: DVec3) -> Option<Self> {
        if !(paths_mm.min_element() > 0.0 && paths_mm.max_element().is_finite()) {
            return None;
        }
        // Shares and mean lengths of the channels beyond a length.
        let beyond = |length: f64| (-length / paths_mm).exp();
        let moment = |length: f64| (paths_mm + length) * beyond(length);
        let mean = |v: DVec3| v.element_sum() / 3.0;
        let edge = |share: f64| {
            let (mut low, mut high) = (0.0, -paths_mm.max_element() * share.ln());
            for _ in 0..60 {
                let middle = 0.5 * (low + high);
                if mean(beyond(middle)) > share { low = middle } else { high = middle }
            }
            0.5 * (low + high)
        };
        let (mut lengths_mm, mut shares) = ([0.0; STEPS], [DVec3::ZERO; STEPS]);
        let (mut share, mut length) = (DVec3::ONE, paths_mm);
        for k in 0..STEPS {
            let (next_share, next_length) = if k + 1 == STEPS {
                (DVec3::ZERO, DVec3::ZERO)
            } else {
                let end = edge(1.0 - (k + 1) as f64 / STEPS as f64);
                (beyond(end), moment(end))
            };
            shares[k] = share - next_share;
            lengths_mm[k] = mean(length - next_length) / mean(shares[k]);
            (share, length) = (next_share, next_length);
        }
        Some(Self { eta, lengths_mm, shares })
    }

    /// The farthest that light goes along the surface, mm.
    fn farthest_mm(&self) -> f64 {
        self.lengths_mm[STEPS - 1] / self.eta
    }

    /// Shares of the light of an angle of incidence that stay, and that go each of the distances of neighbours.
    #[inline]
    fn rungs<const C: usize>(&self, sine: f64, share: impl Fn(&Self, usize) -> [f64; C]) -> [[f64; C]; DISTANCES + 1] {
        let mut rungs = [[0.0; C]; DISTANCES + 1];
        for (k, length) in self.lengths_mm.iter().enumerate() {
            // Distances are 0, 1/8, 1/4, 1/2 and 1 of the farthest.
            let mut place = length / self.lengths_mm[STEPS - 1] * sine * f64::from(1u32 << (DISTANCES - 1));
            let mut rung = 0;
            while place > 1.0 && rung < DISTANCES - 1 {
                place = if rung == 0 { place - 1.0 } else { 0.5 * (place - 1.0) };
                // Beyond the first a distance is twice the one before.
                rung += 1;
            }
            let (along, share) = (place.clamp(0.0, 1.0), share(self, k));
            add(&mut rungs[rung], 1.0 - along, &share);
            add(&mut rungs[rung + 1], along, &share);
        }
        rungs
    }
}

/// Cells of a grid around the samples of a part; samples share in the eight nearest.
struct Cells {
    /// Eight cells of each sample, and the place between them.
    of_sample: Vec<([u32; 8], [f32; 3])>,
    count: usize,
}

impl Cells {
    /// Cells of the samples, whose edges depend on the part.
    fn new(surface: &Surface, edge_mm: impl Fn(usize) -> Option<f64>) -> Self {
        let mut keys: Vec<[i32; 4]> = Vec::new();
        let mut of_sample = Vec::new();
        let corners = |[part, x, y, z]: [i32; 4]| -> [[i32; 4]; 8] {
            std::array::from_fn(|i| [part, x + (i & 1) as i32, y + (i >> 1 & 1) as i32, z + (i >> 2) as i32])
        };
        let mut bases = vec![([i32::MIN; 4], [0.0; 3]); surface.samples.len()];
        for part in 0..surface.domain.parts.parts.len() {
            let Some(edge) = edge_mm(part) else { continue };
            for sample in surface.samples.part(part) {
                let at = surface.patches[sample].centre_mm / edge;
                let base = at.floor();
                bases[sample] =
                    ([part as i32, base.x as i32, base.y as i32, base.z as i32], (at - base).as_vec3().to_array());
                keys.extend(corners(bases[sample].0));
            }
        }
        keys.sort_unstable();
        keys.dedup();
        for (base, at) in bases {
            let found = |key: [i32; 4]| keys.binary_search(&key).map_or(u32::MAX, |found| found as u32);
            of_sample.push((if base[0] == i32::MIN { [u32::MAX; 8] } else { corners(base).map(found) }, at));
        }
        Self { of_sample, count: keys.len() }
    }

    /// Cells of a sample and its shares in them.
    fn shares(&self, sample: usize) -> impl Iterator<Item = (usize, f64)> {
        let (cells, at) = &self.of_sample[sample];
        let share = |i: usize| {
            let of = |axis: usize| if i >> axis & 1 == 1 { at[axis] } else { 1.0 - at[axis] };
            f64::from(of(0) * of(1) * of(2))
        };
        cells.iter().enumerate().filter(|(_, cell)| **cell != u32::MAX).map(move |(i, cell)| (*cell as usize, share(i)))
    }

    /// Sums over the cells of values of the samples.
    fn sums<const C: usize>(&self, values: impl Iterator<Item = [f64; C]>) -> Vec<[f64; C]> {
        let mut sums = vec![[0.0; C]; self.count];
        for (sample, value) in values.enumerate() {
            if value != [0.0; C] {
                self.shares(sample).for_each(|(cell, share)| add(&mut sums[cell], share, &value));
            }
        }
        sums
    }

    /// Means at a sample of values of the cells.
    fn mean<const C: usize>(&self, sample: usize, values: &[[f64; C]]) -> [f64; C] {
        let mut mean = [0.0; C];
        self.shares(sample).for_each(|(cell, share)| add(&mut mean, share, &values[cell]));
        mean
    }
}

/// Adds a multiple of values.
#[inline(always)]
fn add<const C: usize>(sum: &mut [f64; C], factor: f64, values: &[f64; C]) {
    sum.iter_mut().zip(values).for_each(|(sum, value)| *sum += factor * value);
}

/// Adds the products of values.
#[inline(always)]
fn multiply_add<const C: usize>(sum: &mut [f64; C], factor: f64, left: &[f64; C], right: &[f64; C]) {
    sum.iter_mut().zip(left).zip(right).for_each(|((sum, left), right)| *sum += factor * left * right);
}

/// No sample.
const NOWHERE: u32 = u32::MAX;

/// What the moving of light needs of a surface, whatever the light; made when light moves for the first time.
pub struct MovedEntry {
    /// Steps of each part; none of parts whose light stays.
    steps: Vec<Option<Steps>>,
    ways: OnceLock<Ways>,
}

/// The ways of light between the samples of a surface.
struct Ways {
    steps: Vec<Option<Steps>>,
    /// Neighbours of each sample; its own index where they are too near, [`NOWHERE`] where there is no surface.
    around: Vec<Around>,
    frames: Vec<Frame>,
    cells: Cells,
    /// Part of each sample.
    part: Vec<u32>,
    /// Area of the samples in each cell, mm^2.
    areas_mm2: Vec<[f64; 1]>,
}

impl MovedEntry {
    /// The samples of a surface, on parts whose light moves.
    pub fn new(surface: &Surface, moves: impl Fn(usize) -> bool) -> Self {
        let Domain { parts, media, .. } = surface.domain;
        let of_part = |(part, entry): (usize, &crate::geometry::part_table::PartEntry)| {
            let medium = media.get(entry.medium? as usize)?.properties;
            Steps::new(medium.eta_inside_over_outside, medium.mean_free_path_mm()).filter(|_| moves(part))
        };
        Self { steps: parts.parts.iter().enumerate().map(of_part).collect(), ways: OnceLock::new() }
    }

    /// True if the light of no part moves.
    pub fn is_still(&self) -> bool {
        self.steps.iter().all(Option::is_none)
    }

    /// Makes what is needed before light moves on several threads at once.
    pub fn prepare(&self, surface: &Surface) {
        if !self.is_still() {
            self.ways(surface);
        }
    }

    fn ways(&self, surface: &Surface) -> &Ways {
        self.ways.get_or_init(|| Ways::new(surface, self.steps.clone()))
    }

    /// Irradiance of every sample under lights, RGB, and of the pieces of samples that are lit unevenly: that of lights of one direction
    /// moved, and of the others, if there are any, as a function tells it. `etas` are the indices of the media, inside over outside.
    ///
    /// # Errors
    /// As [`Illumination::new`]; those of the function.
    pub fn entered(
        &self,
        surface: &Surface,
        lights: &[Light],
        (etas, sampling): (&[f64], LightSampling),
        of_others: impl FnOnce(&[Light]) -> Result<(Vec<DVec3>, Pieces)>,
        progress: &dyn Progress,
    ) -> Result<(Vec<DVec3>, Pieces)> {
        if self.is_still() {
            return of_others(lights);
        }
        // The suns of environments come from one direction too.
        let (moving, others): (Vec<Light>, Vec<Light>) = apart(lights, |_| true).into_iter().partition(Light::is_sharp);
        let (mut irradiance, pieces) = match others.as_slice() {
            [] => (vec![DVec3::ZERO; surface.samples.len()], Pieces::NONE),
            others => of_others(others)?,
        };
        for light in &moving {
            let of_light = Illumination::new(surface, std::slice::from_ref(light), etas, sampling)?.all(progress);
            irradiance.iter_mut().zip(self.moved(surface, light, &of_light)).for_each(|(sum, e)| *sum += e);
        }
        Ok((irradiance, pieces))
    }

    /// [`Self::entered`] with rays towards all lights.
    ///
    /// # Errors
    /// As [`Illumination::new`].
    pub fn entered_by_rays(
        &self,
        surface: &Surface,
        lights: &[Light],
        (etas, sampling): (&[f64], LightSampling),
        progress: &dyn Progress,
    ) -> Result<(Vec<DVec3>, Pieces)> {
        let rays = |others: &[Light]| Ok(Illumination::new(surface, others, etas, sampling)?.all_with_pieces(progress));
        self.entered(surface, lights, (etas, sampling), rays, progress)
    }

    /// Moves the irradiance of one light, RGB for each sample. Light of many directions at once stays, as diffuse entry does.
    pub fn moved(&self, surface: &Surface, light: &Light, irradiance: &[DVec3]) -> Vec<DVec3> {
        if !light.is_sharp() || self.is_still() {
            return irradiance.to_vec();
        }
        let values: Vec<[f64; 3]> = irradiance.iter().map(|e| e.to_array()).collect();
        let moved = self.ways(surface).moved_by(surface, light, &values, |steps, k| steps.shares[k].to_array());
        moved.into_iter().map(DVec3::from_array).collect()
    }

    /// Moves irradiance that is the same for all channels by the mean of the steps of all.
    pub fn move_rows(&self, surface: &Surface, lights: &[Light], rows: &mut IrradianceRows) {
        if self.is_still() {
            return;
        }
        let (count, ways) = (rows.lights, self.ways(surface));
        let of_light = |rows: &IrradianceRows, (column, light): (usize, &Light)| {
            let values: Vec<[f64; 1]> =
                rows.values.iter().skip(column).step_by(count).map(|e| [f64::from(*e)]).collect();
            ways.moved_by(surface, light, &values, |steps, k| [steps.shares[k].element_sum() / 3.0])
        };
        let moving: Vec<(usize, &Light)> =
            lights.iter().enumerate().take(count).filter(|(_, light)| light.is_sharp()).collect();
        for some in moving.chunks(AT_ONCE) {
            let columns: Vec<Vec<[f64; 1]>> = some.par_iter().map(|&of| of_light(rows, of)).collect();
            for ((column, _), values) in some.iter().zip(columns) {
                let slots = rows.values.iter_mut().skip(*column).step_by(count);
                slots.zip(values).for_each(|(slot, [value])| *slot = value as f32);
            }
        }
    }

    /// Bytes in memory.
    pub fn bytes(&self) -> usize {
        self.ways.get().map_or(0, Ways::bytes)
    }
}

impl Ways {
    fn new(surface: &Surface, steps: Vec<Option<Steps>>) -> Self {
        let Domain { parts, media, .. } = surface.domain;
        let edge = |part: usize| {
            let medium = media.get(parts.parts[part].medium? as usize)?.properties;
            let spacing = (parts.parts[part].area_mm2 / surface.samples.part(part).len().max(1) as f64).sqrt();
            steps[part].map(|_| (CELL * medium.mean_free_path_mm().max_element()).max(CELL_SAMPLES * spacing))
        };
        let cells = Cells::new(surface, edge);
        let areas_mm2 = cells.sums(surface.patches.iter().map(|patch| [patch.area_mm2]));
        let mut part = vec![0; surface.samples.len()];
        for p in 0..parts.parts.len() {
            part[surface.samples.part(p)].fill(p as u32);
        }
        let facets = Facets::new(surface);
        let around = |sample: usize| {
            let farthest = steps[part[sample] as usize].map_or(0.0, |steps| steps.farthest_mm());
            neighbours(surface, &facets, (sample, part[sample]), farthest)
        };
        let around = (0..part.len()).into_par_iter().map(around).collect();
        let frames = surface.patches.iter().map(Frame::new).collect();
        Self { steps, around, frames, cells, part, areas_mm2 }
    }

    fn moved_by<const C: usize>(
        &self,
        surface: &Surface,
        light: &Light,
        irradiance: &[[f64; C]],
        share: impl Fn(&Steps, usize) -> [f64; C] + Sync + Copy,
    ) -> Vec<[f64; C]> {
        let origin = surface.domain.mesh.origin_mm;
        let towards = |at: DVec3| match light {
            Light::Directional { from, .. } => *from,
            Light::Point { at_mm, .. } | Light::Spot { at_mm, .. } => (*at_mm - origin - at).normalize_or_zero(),
            Light::Constant { .. } | Light::Area { .. } | Light::Environment { .. } => DVec3::ZERO,
        };
        // Irradiance that is fetched or stays.
        let of_sample = |sample: usize| {
            let Some(steps) = &self.steps[self.part[sample] as usize] else { return irradiance[sample] };
            let way = self.frames[sample].way(towards(surface.patches[sample].centre_mm));
            let own = irradiance[sample];
            let is_lit = own != [0.0; C];
            if !is_lit && way.cosine <= TURNED_AWAY {
                return own;
            }
            let rungs = steps.rungs(way.along.length(), share);
            let mut sum = [0.0; C];
            multiply_add(&mut sum, 1.0, &rungs[0], &own);
            for (neighbours, back, weight) in self.both_ways(sample, way.along) {
                for ((at, lost), share) in neighbours.iter().zip(back).zip(&rungs[1..]) {
                    if is_lit && *lost == NOWHERE {
                        multiply_add(&mut sum, weight, share, &own);
                    }
                    if *at != NOWHERE {
                        multiply_add(&mut sum, weight, share, &irradiance[*at as usize]);
                    }
                }
            }
            sum
        };
        let mut result: Vec<[f64; C]> = (0..irradiance.len()).into_par_iter().map(of_sample).collect();
        let flux = self.thrown(surface, irradiance, share, towards);
        let there = self.cells.sums(result.iter().zip(surface.patches).map(|(e, patch)| e.map(|e| e * patch.area_mm2)));
        let wanted = self.cells.sums(flux.into_iter());
        // Factors of the cells, and irradiance that fetching does not find.
        let (mut factors, mut missing) = (vec![[1.0; C]; self.cells.count], vec![[0.0; C]; self.cells.count]);
        for cell in 0..self.cells.count {
            let area = self.areas_mm2[cell][0].max(f64::MIN_POSITIVE);
            for c in 0..C {
                let (wanted, there) = (wanted[cell][c], there[cell][c]);
                if there > 0.0 {
                    factors[cell][c] = (wanted / there).clamp(LEAST_FACTOR, MOST_FACTOR);
                }
                missing[cell][c] = (wanted - factors[cell][c] * there).max(0.0) / area;
            }
        }
        result.par_iter_mut().enumerate().for_each(|(sample, e)| {
            if self.steps[self.part[sample] as usize].is_some() {
                let (factor, missing) = (self.cells.mean(sample, &factors), self.cells.mean(sample, &missing));
                e.iter_mut().zip(factor).zip(missing).for_each(|((e, factor), missing)| *e = *e * factor + missing);
            }
        });
        self.keep_flux(surface, irradiance, &mut result);
        result
    }

    /// Flux that light's steps bring each sample.
    fn thrown<const C: usize>(
        &self,
        surface: &Surface,
        irradiance: &[[f64; C]],
        share: impl Fn(&Steps, usize) -> [f64; C] + Copy,
        towards: impl Fn(DVec3) -> DVec3,
    ) -> Vec<[f64; C]> {
        let mut flux = vec![[0.0; C]; irradiance.len()];
        for (sample, patch) in surface.patches.iter().enumerate() {
            let own = irradiance[sample].map(|e| e * patch.area_mm2);
            let Some(steps) = self.steps[self.part[sample] as usize].filter(|_| own != [0.0; C]) else { continue };
            let way = self.frames[sample].way(towards(patch.centre_mm));
            let rungs = steps.rungs(way.along.length(), share);
            multiply_add(&mut flux[sample], 1.0, &rungs[0], &own);
            for (neighbours, _, weight) in self.both_ways(sample, -way.along) {
                for (at, share) in neighbours.iter().zip(&rungs[1..]) {
                    let at = if *at == NOWHERE { sample } else { *at as usize };
                    multiply_add(&mut flux[at], weight, share, &own);
                }
            }
        }
        flux
    }

    /// Scales the irradiance of each part to the flux that it had.
    fn keep_flux<const C: usize>(&self, surface: &Surface, before: &[[f64; C]], after: &mut [[f64; C]]) {
        for part in (0..surface.domain.parts.parts.len()).filter(|&part| self.steps[part].is_some()) {
            let range = surface.samples.part(part);
            let flux = |values: &[[f64; C]]| {
                let mut sum = [0.0; C];
                range.clone().for_each(|i| add(&mut sum, surface.patches[i].area_mm2, &values[i]));
                sum
            };
            let (before, there) = (flux(before), flux(after));
            for c in (0..C).filter(|&c| there[c] > 0.0) {
                let factor = before[c] / there[c];
                range.clone().for_each(|i| after[i][c] *= factor);
            }
        }
    }

    /// Neighbours of a sample in the two directions next to one in its tangent plane, those in the opposite directions, and weights, 1 in all.
    fn both_ways(&self, sample: usize, along: DVec2) -> [(&[u32; DISTANCES], &[u32; DISTANCES], f64); 2] {
        let turn = (along.y.atan2(along.x) / TAU + 1.0).fract() * AZIMUTHS as f64;
        let around = &self.around[sample];
        let way = |azimuth: usize, weight: f64| {
            (&around[azimuth % AZIMUTHS], &around[(azimuth + AZIMUTHS / 2) % AZIMUTHS], weight)
        };
        [way(turn as usize, 1.0 - turn.fract()), way(turn as usize + 1, turn.fract())]
    }

    /// Bytes in memory.
    fn bytes(&self) -> usize {
        size_of_val(self.around.as_slice())
            + size_of_val(self.frames.as_slice())
            + size_of_val(self.cells.of_sample.as_slice())
            + size_of_val(self.part.as_slice())
    }
}

/// The tangent plane of a sample.
struct Frame {
    normal: DVec3,
    axes: [DVec3; 2],
}

/// The way to a light from a sample.
struct Way {
    /// Of the angle with the normal.
    cosine: f64,
    /// Sine of that angle along the axes of the tangent plane, towards the light.
    along: DVec2,
}

impl Frame {
    fn new(patch: &Patch) -> Self {
        let normal = patch.cross_mm2.normalize_or(DVec3::Z);
        let (x, y) = normal.any_orthonormal_pair();
        Self { normal, axes: [x, y] }
    }

    /// The way to a light in a unit direction; where that is below the horizon, light that comes over it grazes.
    fn way(&self, towards: DVec3) -> Way {
        let cosine = towards.dot(self.normal);
        let along = DVec2::from_array(self.axes.map(|axis| axis.dot(towards)));
        Way { cosine, along: if cosine < 0.0 { along.normalize_or_zero() } else { along } }
    }
}

/// Neighbours of a sample of a part along the surface, up to a distance, mm.
fn neighbours(surface: &Surface, facets: &Facets, (sample, part): (usize, u32), farthest_mm: f64) -> Around {
    let patch = &surface.patches[sample];
    let frame = Frame::new(patch);
    let mesh = surface.domain.mesh;
    let mut around = [[sample as u32; DISTANCES]; AZIMUTHS];
    for (azimuth, of_azimuth) in around.iter_mut().enumerate() {
        let (sin, cos) = (azimuth as f64 * TAU / AZIMUTHS as f64).sin_cos();
        let along = cos * frame.axes[0] + sin * frame.axes[1];
        for (k, found) in of_azimuth.iter_mut().enumerate() {
            let far = farthest_mm / f64::from(1u32 << (DISTANCES - 1 - k));
            if far < SHORT * patch.radius_mm || !far.is_finite() {
                continue;
            }
            let depth = SLOPE * far;
            let ray = Ray {
                origin: (patch.centre_mm + far * along - depth * frame.normal).as_vec3(),
                direction: frame.normal.as_vec3(),
                t_min: 0.0,
                t_max: (2.0 * depth) as f32,
            };
            // The surface of the same body that is nearest to the plane, seen from outside.
            let mut nearest: Option<(f64, u32)> = None;
            surface.bvh.crossings(&ray, |hit| {
                let height = (f64::from(hit.t) - depth).abs();
                let is_outside = surface.domain.parts.triangle_part.get(hit.triangle as usize) == Some(&part)
                    && mesh.normal(hit.triangle).dot(frame.normal) > 0.0;
                if is_outside && nearest.is_none_or(|(least, triangle)| (height, hit.triangle) < (least, triangle)) {
                    nearest = Some((height, hit.triangle));
                }
            });
            *found = nearest
                .and_then(|(_, triangle)| {
                    let [a, b, c] = mesh.corners_local_mm(triangle);
                    let origin = ray.origin.as_dvec3();
                    let normal = (b - a).cross(c - a);
                    let t = (a - origin).dot(normal) / frame.normal.dot(normal);
                    facets.at(mesh, triangle, origin + t * frame.normal)
                })
                .unwrap_or(NOWHERE);
        }
    }
    around
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::geometry::shapes;
    use crate::transport::test_scene::{Fixture, named};

    #[test]
    fn light_on_a_plane_moves_by_the_tangential_part_of_a_free_path() {
        // Steps go to the nearest of the samples, so that those of coarser ones are shorter: by 7 % where they lie a step apart.
        let fixture = Fixture::new(shapes::plane(40.0, 40.0, 7), named("marble"), 80_000);
        let surface = fixture.surface();
        let light = Light::Directional { from: DVec3::new(0.8, 0.6, 0.0), irradiance: DVec3::ONE };
        let spot = |at: DVec3| if at.x.abs() < 2.0 && at.z.abs() < 2.0 { DVec3::ONE } else { DVec3::ZERO };
        let before: Vec<DVec3> = surface.patches.iter().map(|p| spot(p.centre_mm)).collect();
        let after = MovedEntry::new(&surface, |_| true).moved(&surface, &light, &before);
        let properties = named("marble");
        let sine = 0.8 / properties.eta_inside_over_outside;
        for c in 0..3 {
            let sums = |values: &[DVec3]| {
                let of = values.iter().zip(surface.patches).map(|(e, p)| (e[c] * p.area_mm2, p.centre_mm));
                of.fold((0.0, DVec3::ZERO), |(sum, moment), (flux, at)| (sum + flux, moment + flux * at))
            };
            let ((flux, from), (there, to)) = (sums(&before), sums(&after));
            assert!((there / flux - 1.0).abs() < 1e-12);
            let shift = (to - from) / flux;
            let expected = -sine * properties.mean_free_path_mm()[c];
            assert!((shift.x / expected - 1.0).abs() < 0.05 && shift.z.abs() < 0.02, "{c}: {shift} {expected}");
        }
    }

    #[test]
    fn even_light_stays_even_and_rows_move_by_the_mean_of_the_channels() {
        let fixture = Fixture::new(shapes::plane(40.0, 40.0, 7), named("skin1"), 10_000);
        let surface = fixture.surface();
        let entry = MovedEntry::new(&surface, |_| true);
        let light = Light::Directional { from: DVec3::new(0.6, 0.4, 0.5).normalize(), irradiance: DVec3::ONE };
        let inside = |patch: &Patch| patch.centre_mm.x.abs().max(patch.centre_mm.z.abs()) < 5.0;
        let even = vec![DVec3::ONE; surface.samples.len()];
        let moved = entry.moved(&surface, &light, &even);
        let far_from_edges: Vec<DVec3> =
            moved.iter().zip(surface.patches).filter(|(_, patch)| inside(patch)).map(|(e, _)| *e).collect();
        for e in &far_from_edges {
            assert!(
                (*e - far_from_edges[0]).abs().max_element() < 1.5e-2 && (*e - 1.0).abs().max_element() < 0.01,
                "{e}"
            );
        }
        let spot: Vec<DVec3> =
            surface.patches.iter().map(|p| DVec3::splat(f64::from(u8::from(p.centre_mm.length() < 3.0)))).collect();
        let values = spot.iter().flat_map(|e| [e.x as f32, 0.0]).collect();
        let mut rows = IrradianceRows { lights: 2, values };
        entry.move_rows(&surface, &[light.clone(), light.clone()], &mut rows);
        let moved = entry.moved(&surface, &light, &spot);
        let mut change: f64 = 0.0;
        for (row, e) in rows.values.chunks(2).zip(&moved) {
            change = change.max((f64::from(row[0]) - e.element_sum() / 3.0).abs());
            assert_eq!(row[1], 0.0);
        }
        // The bounds of factors are the only thing that is not linear.
        assert!(change < 0.02, "{change}");
    }

    #[test]
    fn light_that_finds_no_surface_stays_and_light_from_all_around_too() {
        let fixture = Fixture::new(shapes::bumpy_head(10.0, 2), named("skin1"), 700);
        let surface = fixture.surface();
        let before: Vec<DVec3> = (0..surface.samples.len()).map(|i| DVec3::splat(f64::from(i as u32 % 5))).collect();
        let point = Light::Point { at_mm: DVec3::new(3.0, 20.0, 1.0), intensity: DVec3::ONE };
        let flux = |values: &[DVec3]| values.iter().zip(surface.patches).map(|(e, p)| *e * p.area_mm2).sum::<DVec3>();
        let entry = MovedEntry::new(&surface, |_| true);
        let after = entry.moved(&surface, &point, &before);
        assert!((flux(&after) - flux(&before)).abs().max_element() < 1e-9 * flux(&before).x && after != before);
        assert_eq!(entry.moved(&surface, &Light::Constant { radiance: DVec3::ONE }, &before), before);
    }
}
