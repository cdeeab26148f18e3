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
//!
//! Light from everywhere enters as the walks of the calibration did, and must not change: each sample has a factor that makes the mean over
//! all directions of moved light what entered there. Light of skies is moved as a whole, by what moving changes in the first harmonics
//! of the direction that it comes from; that of small lights with an area by the mean of its directions.

use std::f64::consts::TAU;
use std::sync::OnceLock;

use glam::{DVec2, DVec3, Vec3};
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
use crate::light::harmonics::{coefficients, to_harmonics};
use crate::light::quantised::directions::lattice;
use crate::light::suns::apart;
use crate::math::sh::real_sh;
use crate::progress::{Progress, Silent};

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

/// Order of the harmonics of skies whose light moves.
const SKY_ORDER: usize = 3;

/// Directions of light from everywhere.
const EVERYWHERE: usize = 48;

/// One ray from each sample towards a direction.
const ONE_RAY: LightSampling = LightSampling { points_per_patch: 1, ..LightSampling::FAST };

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
    fn rungs_at(&self, sine: f64) -> Rungs {
        let mut rungs = [[0.0; 3]; DISTANCES + 1];
        for (length, share) in self.lengths_mm.iter().zip(&self.shares) {
            // Distances are 0, 1/8, 1/4, 1/2 and 1 of the farthest.
            let mut place = length / self.lengths_mm[STEPS - 1] * sine * f64::from(1u32 << (DISTANCES - 1));
            let mut rung = 0;
            while place > 1.0 && rung < DISTANCES - 1 {
                place = if rung == 0 { place - 1.0 } else { 0.5 * (place - 1.0) };
                // Beyond the first a distance is twice the one before.
                rung += 1;
            }
            let (along, share) = (place.clamp(0.0, 1.0), share.to_array());
            add(&mut rungs[rung], 1.0 - along, &share);
            add(&mut rungs[rung + 1], along, &share);
        }
        rungs
    }
}

/// Shares of each channel that stay, and that go each of the distances of neighbours.
type Rungs = [[f64; 3]; DISTANCES + 1];

/// Angles of incidence, by their sines, at which shares are kept.
const SINES: usize = 128;

/// Where steps end, by the angle of incidence.
struct Ladder(Vec<Rungs>);

impl Ladder {
    fn new(steps: Steps) -> Self {
        Self((0..=SINES).map(|i| steps.rungs_at(i as f64 / SINES as f64)).collect())
    }

    /// [`Steps::rungs_at`], linear between the angles that are kept.
    #[inline]
    fn at(&self, sine: f64) -> Rungs {
        let place = (sine * SINES as f64).clamp(0.0, SINES as f64);
        let first = (place as usize).min(SINES - 1);
        let along = place - first as f64;
        let (a, b) = (&self.0[first], &self.0[first + 1]);
        std::array::from_fn(|k| std::array::from_fn(|c| a[k][c] + along * (b[k][c] - a[k][c])))
    }
}

/// Cells of a grid around the samples of a part; samples share in the eight nearest.
struct Cells {
    /// Eight cells of each sample, and its shares in them.
    of_sample: Vec<([u32; 8], [f32; 8])>,
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
            let share = |i: usize| {
                let of = |axis: usize| if i >> axis & 1 == 1 { at[axis] } else { 1.0f32 - at[axis] };
                of(0) * of(1) * of(2)
            };
            let cells = if base[0] == i32::MIN { [u32::MAX; 8] } else { corners(base).map(found) };
            of_sample.push((cells, std::array::from_fn(share)));
        }
        Self { of_sample, count: keys.len() }
    }

    /// Cells of a sample and its shares in them.
    #[inline]
    fn shares(&self, sample: usize) -> impl Iterator<Item = (usize, f64)> {
        let (cells, shares) = &self.of_sample[sample];
        let all = cells.iter().zip(shares).filter(|(cell, _)| **cell != u32::MAX);
        all.map(|(cell, share)| (*cell as usize, f64::from(*share)))
    }

    /// Sums over the cells of values of the samples.
    fn sums<const C: usize>(&self, values: impl Iterator<Item = [[f64; C]; 2]>) -> Vec<[[f64; C]; 2]> {
        let mut sums = vec![[[0.0; C]; 2]; self.count];
        for (sample, value) in values.enumerate() {
            if value != [[0.0; C]; 2] {
                self.shares(sample)
                    .for_each(|(cell, share)| (0..2).for_each(|k| add(&mut sums[cell][k], share, &value[k])));
            }
        }
        sums
    }

    /// Means at a sample of values of the cells.
    fn mean(&self, sample: usize, values: &[[[f64; 3]; 2]]) -> [[f64; 3]; 2] {
        let mut mean = [[0.0; 3]; 2];
        self.shares(sample).for_each(|(cell, share)| {
            (0..2).for_each(|k| add(&mut mean[k], share, &values[cell][k]));
        });
        mean
    }
}

/// Adds a multiple of values.
#[inline(always)]
fn add<const C: usize>(sum: &mut [f64; C], factor: f64, values: &[f64; C]) {
    sum.iter_mut().zip(values).for_each(|(sum, value)| *sum += factor * value);
}

/// True for light that comes from one direction at each point, or nearly so; that of skies is moved as a whole.
fn moves(light: &Light) -> bool {
    light.is_sharp() || matches!(light, Light::Area { .. })
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
    steps: Vec<Option<Ladder>>,
    /// Neighbours of each sample; its own index where they are too near, [`NOWHERE`] where there is no surface.
    around: Vec<Around>,
    frames: Vec<Frame>,
    cells: Cells,
    /// Part of each sample.
    part: Vec<u32>,
    /// Area of the samples in each cell, mm^2.
    areas_mm2: Vec<f64>,
    /// For each sample, the irradiance of light from everywhere that enters there over that which is moved there.
    balance: Vec<[f64; 3]>,
    /// For each sample, what moving changes in the irradiance under each harmonic of the light from far away, from the second on.
    sky: Vec<[[f32; 3]; SKY_ORDER * SKY_ORDER - 1]>,
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
        let (moving, others): (Vec<Light>, Vec<Light>) = apart(lights, |_| true).into_iter().partition(moves);
        let (mut irradiance, pieces) = match others.as_slice() {
            [] => (vec![DVec3::ZERO; surface.samples.len()], Pieces::NONE),
            others => {
                let (mut irradiance, pieces) = of_others(others)?;
                for light in others {
                    self.move_sky(surface, &coefficients(light, SKY_ORDER)?, &mut irradiance);
                }
                (irradiance, pieces)
            }
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

    /// Moves irradiance of light from far away in many directions at once, given by the first harmonics of its radiance.
    fn move_sky(&self, surface: &Surface, radiance: &[DVec3], irradiance: &mut [DVec3]) {
        if self.is_still() {
            return;
        }
        let ways = self.ways(surface);
        irradiance.par_iter_mut().zip(&ways.sky).for_each(|(e, changes)| {
            let of_harmonic =
                |(change, radiance): (&[f32; 3], &DVec3)| Vec3::from_array(*change).as_dvec3() * *radiance;
            // What all directions share does not change.
            *e = (*e + changes.iter().zip(&radiance[1..]).map(of_harmonic).sum::<DVec3>()).max(DVec3::ZERO);
        });
    }

    /// Moves the irradiance of one light, RGB for each sample. Light of many directions at once stays here.
    pub fn moved(&self, surface: &Surface, light: &Light, irradiance: &[DVec3]) -> Vec<DVec3> {
        if !moves(light) || self.is_still() {
            return irradiance.to_vec();
        }
        // One light has one colour: the channels are multiples of the brightest.
        let sum = irradiance.iter().copied().sum::<DVec3>();
        let brightest = [0, 1, 2].into_iter().fold(0, |best, c| if sum[c] > sum[best] { c } else { best });
        let colour = if sum[brightest] > 0.0 { sum / sum[brightest] } else { DVec3::ZERO };
        let values: Vec<f64> = irradiance.iter().map(|e| e[brightest]).collect();
        let moved = self.ways(surface).balanced(surface, light, &values);
        moved.into_iter().map(|e| DVec3::from_array(e) * colour).collect()
    }

    /// Irradiance that is the same for all channels, moved: each channel has its own then. Nothing happens where no light moves.
    #[must_use]
    pub fn moved_rows(&self, surface: &Surface, lights: &[Light], rows: IrradianceRows) -> IrradianceRows {
        if self.is_still() || rows.by_channel {
            return rows;
        }
        let (count, ways) = (rows.lights, self.ways(surface));
        let mut result = IrradianceRows { lights: count, by_channel: true, values: vec![0.0; 3 * rows.values.len()] };
        let of_light = |(column, light): (usize, &Light)| -> Vec<[f64; 3]> {
            let values: Vec<f64> =
                rows.values.iter().skip(column).step_by(count.max(1)).map(|e| f64::from(*e)).collect();
            if moves(light) {
                ways.balanced(surface, light, &values)
            } else {
                values.into_iter().map(|e| [e; 3]).collect()
            }
        };
        let all: Vec<(usize, &Light)> = lights.iter().enumerate().take(count).collect();
        for some in all.chunks(AT_ONCE) {
            let columns: Vec<Vec<[f64; 3]>> = some.par_iter().map(|&of| of_light(of)).collect();
            for ((column, _), values) in some.iter().zip(columns) {
                for (row, value) in result.values.chunks_exact_mut((3 * count).max(1)).zip(values) {
                    (0..3).for_each(|c| row[c * count + column] = value[c] as f32);
                }
            }
        }
        result
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
        let areas_mm2 = cells.sums(surface.patches.iter().map(|patch| [[patch.area_mm2], [0.0]]));
        let areas_mm2 = areas_mm2.into_iter().map(|[[area], _]| area).collect();
        let mut part = vec![0; surface.samples.len()];
        for p in 0..parts.parts.len() {
            part[surface.samples.part(p)].fill(p as u32);
        }
        let facets = Facets::new(surface);
        let around = |sample: usize| {
            let farthest = steps[part[sample] as usize].map_or(0.0, |steps: Steps| steps.farthest_mm());
            neighbours(surface, &facets, (sample, part[sample]), farthest)
        };
        let around = (0..part.len()).into_par_iter().map(around).collect();
        let frames = surface.patches.iter().map(Frame::new).collect();
        let steps = steps.into_iter().map(|steps| steps.map(Ladder::new)).collect();
        let mut ways = Self { steps, around, frames, cells, part, areas_mm2, balance: Vec::new(), sky: Vec::new() };
        (ways.balance, ways.sky) = ways.under_skies(surface);
        ways
    }

    /// What makes light from everywhere the same before and after it is moved, and what moving changes then under other harmonics. Kernels are
    /// calibrated with diffuse entry, which stays: what moving changes under one direction has to vanish in the mean over all.
    fn under_skies(&self, surface: &Surface) -> (Vec<[f64; 3]>, Vec<[[f32; 3]; SKY_ORDER * SKY_ORDER - 1]>) {
        const HARMONICS: usize = SKY_ORDER * SKY_ORDER;
        let etas: Vec<f64> = surface.domain.media.iter().map(|m| m.properties.eta_inside_over_outside).collect();
        let directions = lattice(EVERYWHERE, 0.5);
        let of_direction = |from: &DVec3| {
            let light = Light::Directional { from: *from, irradiance: DVec3::ONE };
            let lit = Illumination::new(surface, std::slice::from_ref(&light), &etas, ONE_RAY).ok()?;
            let entered: Vec<f64> = lit.all(&Silent).into_iter().map(|e| e.x).collect();
            let moved = self.moved_by(surface, &light, &entered);
            let mut harmonics = [0.0; HARMONICS];
            real_sh(SKY_ORDER, to_harmonics(*from), &mut harmonics);
            Some((harmonics, entered, moved))
        };
        let mut sums = vec![([0.0; HARMONICS], [[0.0; 3]; HARMONICS]); self.part.len()];
        for some in directions.chunks(AT_ONCE) {
            let found: Vec<_> = some.par_iter().filter_map(of_direction).collect();
            sums.par_iter_mut().enumerate().for_each(|(sample, (before, after))| {
                for (harmonics, entered, moved) in &found {
                    add(before, entered[sample], harmonics);
                    after.iter_mut().zip(harmonics).for_each(|(sum, y)| add(sum, *y, &moved[sample]));
                }
            });
        }
        let solid_angle = 2.0 * TAU / EVERYWHERE as f64;
        let of_sample = |(before, after): &([f64; HARMONICS], [[f64; 3]; HARMONICS])| {
            let factor = after[0].map(|after| {
                let ratio = before[0] / after;
                if ratio.is_finite() { ratio.clamp(LEAST_FACTOR, MOST_FACTOR) } else { 1.0 }
            });
            let change = |k: usize, c: usize| (solid_angle * (factor[c] * after[k][c] - before[k])) as f32;
            (factor, std::array::from_fn(|k| std::array::from_fn(|c| change(k + 1, c))))
        };
        sums.iter().map(of_sample).unzip()
    }

    /// Moved irradiance whose mean over all directions is that which entered.
    fn balanced(&self, surface: &Surface, light: &Light, irradiance: &[f64]) -> Vec<[f64; 3]> {
        let mut moved = self.moved_by(surface, light, irradiance);
        moved.iter_mut().zip(&self.balance).for_each(|(e, factor)| (0..3).for_each(|c| e[c] *= factor[c]));
        self.keep_flux(surface, irradiance, &mut moved);
        moved
    }

    /// Irradiance, the same for all channels, moved: that of each channel.
    fn moved_by(&self, surface: &Surface, light: &Light, irradiance: &[f64]) -> Vec<[f64; 3]> {
        let origin = surface.domain.mesh.origin_mm;
        let towards = |at: DVec3| match light {
            Light::Directional { from, .. } => *from,
            Light::Point { at_mm, .. } | Light::Spot { at_mm, .. } => (*at_mm - origin - at).normalize_or_zero(),
            // The mean of directions, which is shorter the more of them there are.
            Light::Area { at_mm, normal, u, size_mm, .. } => {
                let [along, across] =
                    [0.5 * size_mm[0] * *u, 0.5 * size_mm[1] * normal.cross(*u)].map(|v| v / 3f64.sqrt());
                let places = [along + across, along - across, across - along, -along - across];
                0.25 * places.map(|place| (*at_mm + place - origin - at).normalize_or_zero()).iter().sum::<DVec3>()
            }
            Light::Constant { .. } | Light::Environment { .. } => DVec3::ZERO,
        };
        // Irradiance that is fetched or stays.
        let of_sample = |sample: usize| {
            let own = irradiance[sample];
            let Some(steps) = &self.steps[self.part[sample] as usize] else { return [own; 3] };
            let way = self.frames[sample].way(towards(surface.patches[sample].centre_mm));
            let is_lit = own != 0.0;
            if !is_lit && way.cosine <= TURNED_AWAY {
                return [0.0; 3];
            }
            let rungs = steps.at(way.along.length());
            let mut sum = rungs[0].map(|share| share * own);
            for (neighbours, back, weight) in self.both_ways(sample, way.along) {
                for ((at, lost), share) in neighbours.iter().zip(back).zip(&rungs[1..]) {
                    let stays = if is_lit && *lost == NOWHERE { own } else { 0.0 };
                    let fetched = irradiance.get(*at as usize).copied().unwrap_or(0.0);
                    add(&mut sum, weight * (stays + fetched), share);
                }
            }
            sum
        };
        let mut result: Vec<[f64; 3]> = (0..irradiance.len()).into_par_iter().map(of_sample).collect();
        let flux = self.thrown(surface, irradiance, towards);
        let both = result.iter().zip(&flux).zip(surface.patches);
        let sums = self.cells.sums(both.map(|((e, flux), patch)| [e.map(|e| e * patch.area_mm2), *flux]));
        // Factors of the cells, and irradiance that fetching does not find.
        let mut of_cells = vec![[[1.0; 3], [0.0; 3]]; self.cells.count];
        for (cell, [factor, missing]) in of_cells.iter_mut().enumerate() {
            let area = self.areas_mm2[cell].max(f64::MIN_POSITIVE);
            for c in 0..3 {
                let [there, wanted] = [sums[cell][0][c], sums[cell][1][c]];
                if there > 0.0 {
                    factor[c] = (wanted / there).clamp(LEAST_FACTOR, MOST_FACTOR);
                }
                missing[c] = (wanted - factor[c] * there).max(0.0) / area;
            }
        }
        result.par_iter_mut().enumerate().for_each(|(sample, e)| {
            if self.steps[self.part[sample] as usize].is_some() {
                let [factor, missing] = self.cells.mean(sample, &of_cells);
                e.iter_mut().zip(factor).zip(missing).for_each(|((e, factor), missing)| *e = *e * factor + missing);
            }
        });
        result
    }

    /// Flux that light's steps bring each sample.
    fn thrown(&self, surface: &Surface, irradiance: &[f64], towards: impl Fn(DVec3) -> DVec3) -> Vec<[f64; 3]> {
        let mut flux = vec![[0.0; 3]; irradiance.len()];
        for (sample, patch) in surface.patches.iter().enumerate() {
            let own = irradiance[sample] * patch.area_mm2;
            let Some(steps) = self.steps[self.part[sample] as usize].as_ref().filter(|_| own != 0.0) else { continue };
            let way = self.frames[sample].way(towards(patch.centre_mm));
            let rungs = steps.at(way.along.length());
            add(&mut flux[sample], own, &rungs[0]);
            for (neighbours, _, weight) in self.both_ways(sample, -way.along) {
                for (at, share) in neighbours.iter().zip(&rungs[1..]) {
                    let at = if *at == NOWHERE { sample } else { *at as usize };
                    add(&mut flux[at], weight * own, share);
                }
            }
        }
        flux
    }

    /// Scales the irradiance of each part to the flux that it had.
    fn keep_flux(&self, surface: &Surface, before: &[f64], after: &mut [[f64; 3]]) {
        for part in (0..surface.domain.parts.parts.len()).filter(|&part| self.steps[part].is_some()) {
            let range = surface.samples.part(part);
            let (mut entered, mut there) = (0.0, [0.0; 3]);
            range.clone().for_each(|i| {
                entered += surface.patches[i].area_mm2 * before[i];
                add(&mut there, surface.patches[i].area_mm2, &after[i]);
            });
            for c in (0..3).filter(|&c| there[c] > 0.0) {
                let factor = entered / there[c];
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
            + size_of_val(self.balance.as_slice())
            + size_of_val(self.sky.as_slice())
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
    fn even_light_stays_even_and_rows_move_as_single_lights_do() {
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
        let rows = IrradianceRows { lights: 2, by_channel: false, values };
        let rows = entry.moved_rows(&surface, &[light.clone(), light.clone()], rows);
        assert!(rows.by_channel && rows.under(1).iter().all(|e| *e == DVec3::ZERO));
        for (row, e) in rows.under(0).iter().zip(entry.moved(&surface, &light, &spot)) {
            assert!((*row - e).abs().max_element() < 1e-6, "{row} {e}");
        }
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

    #[test]
    fn skies_move_as_the_sum_of_their_suns_and_light_from_everywhere_stays() {
        let fixture = Fixture::new(shapes::bumpy_head(10.0, 3), named("skin1"), 4000);
        let surface = fixture.surface();
        let entry = MovedEntry::new(&surface, |_| true);
        let etas = [named("skin1").eta_inside_over_outside];
        let suns = lattice(400, 0.5);
        for (power, moved_by, allowed) in [(0, 0.0, 0.01), (1, 0.02, 0.012), (3, 0.04, 0.02)] {
            let radiance = |from: &DVec3| DVec3::new(1.0, 2.0, 0.5) * (1.0 + from.y).powi(power);
            let mut harmonics = vec![DVec3::ZERO; SKY_ORDER * SKY_ORDER];
            let (mut plain, mut moved) =
                (vec![DVec3::ZERO; surface.samples.len()], vec![DVec3::ZERO; surface.samples.len()]);
            for from in &suns {
                let light = Light::Directional { from: *from, irradiance: radiance(from) };
                let lit =
                    Illumination::new(&surface, std::slice::from_ref(&light), &etas, ONE_RAY).unwrap().all(&Silent);
                moved.iter_mut().zip(entry.moved(&surface, &light, &lit)).for_each(|(sum, e)| *sum += e);
                plain.iter_mut().zip(lit).for_each(|(sum, e)| *sum += e);
                let mut y = [0.0; SKY_ORDER * SKY_ORDER];
                real_sh(SKY_ORDER, to_harmonics(*from), &mut y);
                harmonics.iter_mut().zip(y).for_each(|(sum, y)| *sum += y * radiance(from));
            }
            let error = |values: &[DVec3]| {
                let of = |(a, b): (&DVec3, &DVec3)| (*a - *b).length_squared();
                let all: f64 = moved.iter().map(|e| e.length_squared()).sum();
                (values.iter().zip(&moved).map(of).sum::<f64>() / all).sqrt()
            };
            let before = error(&plain);
            entry.move_sky(&surface, &harmonics, &mut plain);
            let after = error(&plain);
            println!("(1 + y)^{power}: {before:.4} before, {after:.4} after");
            assert!(before >= moved_by && after < allowed, "{power}: {before} {after}");
        }
    }

    #[test]
    fn an_area_light_moves_as_the_points_that_it_is_made_of() {
        let fixture = Fixture::new(shapes::bumpy_head(10.0, 3), named("skin1"), 4000);
        let surface = fixture.surface();
        let entry = MovedEntry::new(&surface, |_| true);
        let etas = [named("skin1").eta_inside_over_outside];
        let of = |light: &Light| {
            let lit = Illumination::new(&surface, std::slice::from_ref(light), &etas, LightSampling::FAST)
                .unwrap()
                .all(&Silent);
            let moved = entry.moved(&surface, light, &lit);
            let norm = |v: &[DVec3]| v.iter().map(|e| e.length_squared()).sum::<f64>().sqrt();
            let changes: Vec<DVec3> = lit.iter().zip(&moved).map(|(a, b)| *b - *a).collect();
            (norm(&changes) / norm(&lit), moved, norm(&lit))
        };
        let at_mm = DVec3::new(8.0, 40.0, 20.0);
        let area = Light::area(at_mm, -at_mm, [2.0, 3.0], DVec3::splat(100.0), None).unwrap();
        let (by_area, moved, size) = of(&area);
        let (by_point, of_point, size_of_point) = of(&Light::Point { at_mm, intensity: DVec3::ONE });
        let differences = moved.iter().zip(&of_point).map(|(a, b)| (*a / size - *b / size_of_point).length_squared());
        let difference = differences.sum::<f64>().sqrt();
        assert!(
            by_area > 0.03 && (by_area / by_point - 1.0).abs() < 0.1 && difference < 0.03,
            "{by_area} {by_point} {difference}"
        );
    }
}
