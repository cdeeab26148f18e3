//! The ways of light between the samples of a surface, whatever the light.

use std::f64::consts::TAU;

use glam::DVec3;

use super::cells::{Cells, Shares, add};
use super::neighbours::{AZIMUTHS, Around, DISTANCES, Facets, Frame, NOWHERE, Way, neighbours};
use super::steps::{Ladder, Steps};
use crate::light::Light;
use crate::light::harmonics::to_harmonics;
use crate::light::quantised::directions::lattice;
use crate::math::sh::real_sh;
use crate::parallel::*;
use crate::progress::Silent;
use crate::transport::domain::Domain;
use crate::transport::irradiance::{Illumination, LightSampling};
use crate::transport::surface::Surface;

/// Edge of the cells in mean free paths, and the least in distances between samples.
const CELL: f64 = 3.0;
const CELL_SAMPLES: f64 = 4.0;

/// Bounds of the factor of a cell; what is more is light that fetching does not find, and is spread over the cell.
const LEAST_FACTOR: f32 = 0.5;
const MOST_FACTOR: f32 = 2.0;

/// Order of the harmonics of skies whose light moves.
pub(super) const SKY_ORDER: usize = 3;

/// Number of those harmonics.
const HARMONICS: usize = SKY_ORDER * SKY_ORDER;

/// Directions of light from everywhere.
const EVERYWHERE: usize = 48;

/// One ray from each sample towards a direction.
pub(super) const ONE_RAY: LightSampling = LightSampling { points_per_patch: 1, ..LightSampling::FAST };

/// Bytes of a sample while the light of one direction is moved: what enters, from where, what it brings, and what is there.
const OF_A_LIGHT: usize = 96 + size_of::<Way>();

/// Lights whose irradiance is moved at once: a few, each of which keeps threads at work for most of its time, since all of them take memory.
pub(super) const AT_ONCE: usize = 4;

/// Means over all directions of what enters a sample, and of what is there after it has moved, by harmonic.
type UnderSkies = ([f64; HARMONICS], [[f64; 3]; HARMONICS]);

/// Most bytes that a sample takes while the ways are made.
pub(super) fn bytes_of_a_sample() -> u64 {
    (Ways::OF_A_SAMPLE + size_of::<UnderSkies>() + AT_ONCE * OF_A_LIGHT) as u64
}

/// What moving changes in the irradiance of a sample under each harmonic of the light from far away, from the second on.
type Changes = [[f32; 3]; HARMONICS - 1];

/// The ways of light between the samples of a surface.
pub(super) struct Ways {
    pub(super) steps: Vec<Option<Ladder>>,
    /// Neighbours of each sample; its own index where they are too near, [`NOWHERE`] where there is no surface.
    pub(super) around: Vec<Around>,
    pub(super) frames: Vec<Frame>,
    pub(super) cells: Cells,
    /// Part of each sample.
    pub(super) part: Vec<u32>,
    /// Mean area of the samples, mm^2, and the area of those in each cell over it.
    pub(super) mean_mm2: f64,
    pub(super) areas: Vec<f32>,
    /// For each sample, the irradiance of light from everywhere that enters there over that which is moved there.
    pub(super) balance: Vec<[f64; 3]>,
    /// For each sample, what moving changes in the irradiance under each harmonic of the light from far away, from the second on.
    pub(super) sky: Vec<Changes>,
}

/// Direction towards a light from a place of the mesh; the mean of those of an area, which is shorter the more of them there are.
fn towards(surface: &Surface, light: &Light) -> impl Fn(DVec3) -> DVec3 + Sync + use<> {
    let (origin, light) = (surface.domain.mesh.origin_mm, light.clone());
    move |at: DVec3| match &light {
        Light::Directional { from, .. } => *from,
        Light::Point { at_mm, .. } | Light::Spot { at_mm, .. } => (*at_mm - origin - at).normalize_or_zero(),
        Light::Area { at_mm, normal, u, size_mm, .. } => {
            let [along, across] = [0.5 * size_mm[0] * *u, 0.5 * size_mm[1] * normal.cross(*u)].map(|v| v / 3f64.sqrt());
            let places = [along + across, along - across, across - along, -along - across];
            0.25 * places.map(|place| (*at_mm + place - origin - at).normalize_or_zero()).iter().sum::<DVec3>()
        }
        Light::Constant { .. } | Light::Environment { .. } => DVec3::ZERO,
    }
}

impl Ways {
    pub(super) fn new(surface: &Surface, steps: Vec<Option<Steps>>) -> Self {
        let Domain { parts, media, .. } = surface.domain;
        let edge = |part: usize| {
            let medium = media.get(parts.parts[part].medium? as usize)?.properties;
            let spacing = (parts.parts[part].area_mm2 / surface.samples.part(part).len().max(1) as f64).sqrt();
            steps[part].map(|_| (CELL * medium.mean_free_path_mm().max_element()).max(CELL_SAMPLES * spacing))
        };
        let cells = Cells::new(surface, edge);
        let count = surface.patches.len().max(1) as f64;
        let mean_mm2 = (surface.patches.iter().map(|patch| patch.area_mm2).sum::<f64>() / count).max(f64::MIN_POSITIVE);
        let areas = cells.sums(surface.patches.iter().map(|patch| [(patch.area_mm2 / mean_mm2) as f32]));
        let areas = areas.into_iter().map(|[area]| area).collect();
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
        let mut ways =
            Self { steps, around, frames, cells, part, mean_mm2, areas, balance: Vec::new(), sky: Vec::new() };
        (ways.balance, ways.sky) = ways.under_skies(surface);
        ways
    }

    /// What makes light from everywhere the same before and after it is moved, and what moving changes then under other harmonics. Kernels are
    /// calibrated with diffuse entry, which stays: what moving changes under one direction has to vanish in the mean over all.
    fn under_skies(&self, surface: &Surface) -> (Vec<[f64; 3]>, Vec<Changes>) {
        let etas: Vec<f64> = surface.domain.media.iter().map(|m| m.properties.eta_inside_over_outside).collect();
        let directions = lattice(EVERYWHERE, 0.5);
        let of_direction = |from: &DVec3| {
            let light = Light::Directional { from: *from, irradiance: DVec3::ONE };
            // Parallel light has no pixels that could be missing, which is all that is refused.
            let lit = Illumination::new(surface, std::slice::from_ref(&light), &etas, ONE_RAY).ok()?;
            let entered: Vec<f64> = lit.all(&Silent).into_iter().map(|e| e.x).collect();
            let moved = self.moved_by(surface, &towards(surface, &light), &entered);
            let mut harmonics = [0.0; HARMONICS];
            real_sh(SKY_ORDER, to_harmonics(*from), &mut harmonics);
            Some((harmonics, entered, moved))
        };
        let mut sums: Vec<UnderSkies> = vec![([0.0; HARMONICS], [[0.0; 3]; HARMONICS]); self.part.len()];
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
        let of_sample = |(before, after): &UnderSkies| {
            let factor = after[0].map(|after| {
                let ratio = before[0] / after;
                if ratio.is_finite() { ratio.clamp(LEAST_FACTOR.into(), MOST_FACTOR.into()) } else { 1.0 }
            });
            let change = |k: usize, c: usize| (solid_angle * (factor[c] * after[k][c] - before[k])) as f32;
            (factor, std::array::from_fn(|k| std::array::from_fn(|c| change(k + 1, c))))
        };
        sums.iter().map(of_sample).unzip()
    }

    /// Moved irradiance whose mean over all directions is that which entered; and for a sample, the share of its own light, of each channel, that
    /// is still within it.
    pub(super) fn balanced(
        &self,
        surface: &Surface,
        light: &Light,
        irradiance: &[f64],
    ) -> (Vec<[f64; 3]>, impl Fn(usize) -> [f64; 3]) {
        let towards = towards(surface, light);
        let mut moved = self.moved_by(surface, &towards, irradiance);
        moved.iter_mut().zip(&self.balance).for_each(|(e, factor)| (0..3).for_each(|c| e[c] *= factor[c]));
        self.keep_flux(surface, irradiance, &mut moved);
        let stays = move |sample: usize| {
            let Some(steps) = &self.steps[self.part[sample] as usize] else { return [1.0; 3] };
            let way = self.frames[sample].way(towards(surface.patches[sample].centre_mm));
            let rungs = steps.at(way.sine.into());
            let mut sum = rungs[0];
            for (neighbours, back, weight) in self.both_ways(sample, way) {
                for ((at, lost), share) in neighbours.iter().zip(back).zip(&rungs[1..]) {
                    let stays = f64::from(u8::from(*at as usize == sample)) + f64::from(u8::from(*lost == NOWHERE));
                    add(&mut sum, weight * stays, share);
                }
            }
            sum
        };
        (moved, stays)
    }

    /// Irradiance, the same for all channels, moved: that of each channel.
    fn moved_by(
        &self,
        surface: &Surface,
        towards: &(impl Fn(DVec3) -> DVec3 + Sync),
        irradiance: &[f64],
    ) -> Vec<[f64; 3]> {
        let ways: Vec<Way> = (0..irradiance.len())
            .into_par_iter()
            .map(|sample| self.frames[sample].way(towards(surface.patches[sample].centre_mm)))
            .collect();
        // Irradiance that is fetched or stays.
        let of_sample = |sample: usize| {
            let own = irradiance[sample];
            let Some(steps) = &self.steps[self.part[sample] as usize] else { return [own; 3] };
            let way = ways[sample];
            let is_lit = own != 0.0;
            if !is_lit && way.is_turned_away {
                return [0.0; 3];
            }
            let rungs = steps.at(way.sine.into());
            let mut sum = rungs[0].map(|share| share * own);
            for (neighbours, back, weight) in self.both_ways(sample, way) {
                for ((at, lost), share) in neighbours.iter().zip(back).zip(&rungs[1..]) {
                    let stays = if is_lit && *lost == NOWHERE { own } else { 0.0 };
                    let fetched = irradiance.get(*at as usize).copied().unwrap_or(0.0);
                    add(&mut sum, weight * (stays + fetched), share);
                }
            }
            sum
        };
        let mut result: Vec<[f64; 3]> = (0..irradiance.len()).into_par_iter().map(of_sample).collect();
        let flux = self.thrown(surface, irradiance, &ways);
        // Relative to the brightest sample of the mean area, so that single precision holds any light.
        let peak = irradiance.iter().copied().fold(0.0, f64::max);
        let unit = peak * self.mean_mm2;
        if unit <= 0.0 || !unit.is_finite() {
            return result;
        }
        let sums = self.cells.sums(result.iter().zip(&flux).zip(surface.patches).map(|((e, flux), patch)| {
            let mut both = [0.0f32; 8];
            for c in 0..3 {
                both[c] = (e[c] * patch.area_mm2 / unit) as f32;
                both[4 + c] = (flux[c] / unit) as f32;
            }
            both
        }));
        // Factors of the cells, and irradiance that fetching does not find.
        let of_cell = |(sums, area): (&[f32; 8], &f32)| {
            let mut both = [1.0f32, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0];
            for c in 0..3 {
                let [there, wanted] = [sums[c], sums[4 + c]];
                if there > 0.0 {
                    both[c] = (wanted / there).clamp(LEAST_FACTOR, MOST_FACTOR);
                }
                both[4 + c] = (wanted - both[c] * there).max(0.0) / area.max(f32::MIN_POSITIVE);
            }
            both
        };
        let of_cells: Vec<[f32; 8]> = sums.iter().zip(&self.areas).map(of_cell).collect();
        result.par_iter_mut().enumerate().for_each(|(sample, e)| {
            if self.steps[self.part[sample] as usize].is_some() {
                let both = self.cells.mean(sample, &of_cells);
                for c in 0..3 {
                    e[c] = e[c] * f64::from(both[c]) + peak * f64::from(both[4 + c]);
                }
            }
        });
        result
    }

    /// Flux that light's steps bring each sample.
    fn thrown(&self, surface: &Surface, irradiance: &[f64], ways: &[Way]) -> Vec<[f64; 3]> {
        let mut flux = vec![[0.0; 3]; irradiance.len()];
        for (sample, patch) in surface.patches.iter().enumerate() {
            let own = irradiance[sample] * patch.area_mm2;
            let Some(steps) = self.steps[self.part[sample] as usize].as_ref().filter(|_| own != 0.0) else { continue };
            let rungs = steps.at(ways[sample].sine.into());
            add(&mut flux[sample], own, &rungs[0]);
            for (_, ahead, weight) in self.both_ways(sample, ways[sample]) {
                for (at, share) in ahead.iter().zip(&rungs[1..]) {
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

    /// Neighbours of a sample in the two directions next to the one towards a light, those in the opposite directions, and weights, 1 in all.
    #[inline]
    fn both_ways(&self, sample: usize, way: Way) -> [(&[u32; DISTANCES], &[u32; DISTANCES], f64); 2] {
        let around = &self.around[sample];
        let of = |azimuth: usize, weight: f32| {
            let [towards, away] = [azimuth, azimuth + AZIMUTHS / 2].map(|azimuth| &around[azimuth % AZIMUTHS]);
            (towards, away, f64::from(weight))
        };
        let (azimuth, beyond) = (way.azimuth as usize, way.azimuth.fract());
        [of(azimuth, 1.0 - beyond), of(azimuth + 1, beyond)]
    }

    /// Bytes of a sample: neighbours, frame, cells, part, balance, and changes under skies.
    const OF_A_SAMPLE: usize = size_of::<Around>()
        + size_of::<Frame>()
        + size_of::<Shares>()
        + size_of::<u32>()
        + size_of::<[f64; 3]>()
        + size_of::<Changes>();

    /// Bytes in memory.
    pub(super) fn bytes(&self) -> usize {
        self.part.len() * Self::OF_A_SAMPLE
    }
}
