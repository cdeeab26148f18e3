//! The exitance of every vertex of a scene under its lights, with its standard error.

use glam::DVec3;

use super::boundary::{Boundary, MeshBoundary};
use super::entry::{Candidate, Entries};
use super::tally::{Budget, Hats, SlotTally};
use super::walk::{End, Start, Stream, WalkMedium, walk};
use crate::error::{Error, ExitCode, Result};
use crate::geometry::bvh::Bvh;
use crate::light::Light;
use crate::math::statistics::units_of;
use crate::parallel::*;
use crate::progress::{Progress, Silent};
use crate::transport::domain::Domain;

/// Batches that the standard errors come from: their own relative error is 1 / sqrt(2 * 31), an eighth.
pub const BATCHES: u64 = 32;

/// Candidates of one task.
const CHUNK: u64 = 512;

/// Sums of slots of the batches that are walked together at most: small batches keep many threads busy together.
const TOGETHER: usize = 1 << 20;

/// Slots of one task.
const LEAST_SLOTS: usize = 4096;

/// Candidates that the mean irradiance is estimated from.
const IRRADIANCE_PILOT: u64 = 1 << 14;

/// Photons that one candidate becomes at most; a brighter one has heavier photons, up to a weight that the sums hold.
const MOST_COPIES: f64 = 256.0;
const HEAVIEST: f64 = 1_048_576.0;

/// Photons for each vertex, and in all, of the walk that tells how many are needed; their weights are not used otherwise,
/// so that stopping has no influence on the result.
const PILOT_PHOTONS_PER_SLOT: u64 = 8;
const PILOT_PHOTONS: std::ops::RangeInclusive<u64> = (1 << 14)..=(1 << 20);

/// A pilot that is noisier than this is repeated with more photons, up to this many.
const WORTHLESS: f64 = 0.7;
const MOST_PILOT_PHOTONS: u64 = 1 << 26;

/// The message where that many are not enough.
const HOPELESS: &str =
    "hardly any light comes out, less than its noise: ask for a number of photons instead of an error";

/// More photons than the pilot asks for, against its own uncertainty.
const MARGIN: f64 = 1.1;

/// Most photons of a channel.
pub const MOST_PHOTONS: u64 = 1 << 40;

/// A larger share of the flux that is lost is an error: the surface has openings.
pub const MOST_LOST: f64 = 1e-3;

/// Length of the walk.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Effort {
    /// This number of photons in each channel.
    Photons(u64),
    /// As many photons as bring [`Exitance::noise`] to this.
    Noise(f64),
}

/// Exitance on the vertices' hat functions, RGB.
///
/// A value is `Int B hat dA / Int hat dA`: the mean of the exitance around a vertex, weighted by its hat function. For
/// another method's figures in the same form see [`super::model_error::project`].
#[derive(Clone, Debug, PartialEq)]
pub struct Exitance {
    /// The hat functions, one for each entry of the vectors below.
    pub hats: Hats,
    /// Exitance of every order from 1 on.
    pub total: Vec<DVec3>,
    /// Exitance of order 1, which `total` includes.
    pub single: Vec<DVec3>,
    /// Standard error of `total`, from [`BATCHES`] independent batches.
    pub standard_error: Vec<DVec3>,
    /// Balance of the flux of each channel.
    pub budget: [Budget; 3],
    /// Candidates of each channel; on average each is one photon.
    pub photons: [u64; 3],
}

impl Exitance {
    /// RMS over the surface of the true values of each channel: that of the estimates less their noise.
    pub fn rms(&self) -> DVec3 {
        let squares = self.mean(|b, e| b * b - e * e);
        squares.max(DVec3::ZERO).map(f64::sqrt)
    }

    /// RMS of the standard errors over the RMS of the channel (of the brightest one's thousandth where that is more); infinite
    /// where there is nothing but noise.
    pub fn relative_noise(&self) -> DVec3 {
        let noise = self.mean(|_, e| e * e).map(f64::sqrt);
        let unit = self.unit();
        DVec3::select(noise.cmpgt(DVec3::ZERO), noise / unit, DVec3::ZERO)
    }

    /// [`Self::relative_noise`] of the worst channel.
    pub fn noise(&self) -> f64 {
        self.relative_noise().max_element()
    }

    /// Unit of the errors of each channel: its RMS, or a thousandth of the brightest channel's if larger.
    pub fn unit(&self) -> DVec3 {
        units_of(self.rms())
    }

    /// Mean over the surface of a function of value and standard error.
    pub(super) fn mean(&self, f: impl Fn(DVec3, DVec3) -> DVec3) -> DVec3 {
        let area: f64 = self.hats.mass_mm2.iter().sum();
        let values = self.total.iter().zip(&self.standard_error).zip(&self.hats.mass_mm2);
        let sum: DVec3 = values.map(|((&b, &e), &mass)| mass * f(b, e)).sum();
        if area > 0.0 { sum / area } else { DVec3::ZERO }
    }

    /// The largest share of a channel's flux that was lost.
    pub fn lost_share(&self) -> f64 {
        self.budget.iter().map(|b| b.share(b.lost)).fold(0.0, f64::max)
    }
}

/// Bytes that a walk takes about, beside the scene.
pub fn memory(domain: Domain) -> u64 {
    let (vertices, triangles) = (domain.mesh.local_mm.len() as u64, domain.mesh.triangles.len() as u64);
    let tallies = (BATCHES * vertices).min(TOGETHER as u64) * size_of::<[u64; 2]>() as u64;
    400 * vertices + 500 * triangles + tallies + (20 << 20)
}

/// Walks photons through a scene: [`Walkable::exitance`] where it is done once.
///
/// # Errors
/// As [`Walkable::exitance`].
pub fn exitance(
    domain: Domain,
    lights: &[Light],
    effort: Effort,
    seed: u64,
    progress: &dyn Progress,
) -> Result<Exitance> {
    Walkable::new(domain).exitance(lights, effort, seed, progress)
}

/// A scene that photons walk through, whatever the light.
pub struct Walkable<'a> {
    domain: Domain<'a>,
    bvh: Bvh,
    bodies: Bodies,
    hats: Hats,
}

impl<'a> Walkable<'a> {
    /// Prepares the parts of a domain that light enters.
    pub fn new(domain: Domain<'a>) -> Self {
        let hats = Hats::new(domain.mesh, domain.parts);
        Self { domain, bvh: Bvh::new(domain.mesh), bodies: Bodies::new(domain), hats }
    }

    /// Walks photons through the scene. The same seed gives the same bits on any number of threads.
    ///
    /// # Errors
    /// Environments that cannot be cut; more than [`MOST_LOST`] of the flux lost (the surface of a part is not closed); a noise
    /// that no number of photons within reason brings (exit 6).
    pub fn exitance(&self, lights: &[Light], effort: Effort, seed: u64, progress: &dyn Progress) -> Result<Exitance> {
        let entries = Entries::new(self.domain, &self.bvh, lights)?;
        Run { entries: &entries, bodies: &self.bodies, hats: &self.hats }.exitance(effort, seed, progress)
    }
}

fn check_lost(exitance: &Exitance) -> Result<()> {
    let lost = exitance.lost_share();
    if lost <= MOST_LOST {
        return Ok(());
    }
    Err(Error::input(format!(
        "{:.2} % of the light inside was lost through the surface: it is not closed, or folds into itself; close it, or use \
         --model dipole, which does not need a volume",
        100.0 * lost
    )))
}

/// The parts that light walks in.
struct Bodies {
    of_part: Vec<Option<(MeshBoundary, [WalkMedium; 3])>>,
}

impl Bodies {
    fn new(domain: Domain) -> Self {
        let mut members = vec![Vec::new(); domain.parts.parts.len()];
        for (triangle, &part) in domain.parts.triangle_part.iter().enumerate() {
            if let Some(list) = members.get_mut(part as usize) {
                list.push(triangle as u32);
            }
        }
        let body = |(part, triangles): (usize, Vec<u32>)| {
            let medium = domain.media.get(domain.parts.parts[part].medium? as usize)?;
            let media = [0, 1, 2].map(|channel| WalkMedium::new(&medium.properties, channel));
            let free_path = media.iter().map(|m| m.free_path_mm).fold(f64::INFINITY, f64::min);
            Some((MeshBoundary::new(domain.mesh, triangles, free_path), media))
        };
        Self { of_part: members.into_iter().enumerate().map(body).collect() }
    }
}

/// Inputs shared by the photons of all channels.
struct Run<'a> {
    entries: &'a Entries<'a>,
    bodies: &'a Bodies,
    hats: &'a Hats,
}

/// One batch of one channel.
struct Batch<'a> {
    channel: usize,
    stage: u64,
    candidates: u64,
    /// Irradiance that a photon of weight 1 stands for.
    irradiance: f64,
    tally: &'a SlotTally,
}

impl Run<'_> {
    fn exitance(&self, effort: Effort, seed: u64, progress: &dyn Progress) -> Result<Exitance> {
        let photons = match effort {
            Effort::Photons(photons) => [photons.clamp(1, MOST_PHOTONS); 3],
            Effort::Noise(asked) => {
                let mut count = (PILOT_PHOTONS_PER_SLOT * self.hats.len() as u64)
                    .clamp(*PILOT_PHOTONS.start(), *PILOT_PHOTONS.end());
                let noise = loop {
                    let pilot = self.channels([count; 3], !seed, "pilot", progress);
                    check_lost(&pilot)?;
                    let noise = pilot.relative_noise();
                    // Where hardly anything comes out, a pilot may see nothing but noise, and its estimate is worth nothing.
                    if noise.max_element() <= WORTHLESS || count >= MOST_PILOT_PHOTONS {
                        if !noise.is_finite() {
                            return Err(Error::new(ExitCode::QualityNotMet, HOPELESS));
                        }
                        break noise / asked.max(f64::MIN_POSITIVE);
                    }
                    count *= 8;
                };
                noise
                    .to_array()
                    .map(|n| (MARGIN * n * n * count as f64).clamp(BATCHES as f64, MOST_PHOTONS as f64) as u64)
            }
        };
        let result = self.channels(photons, seed, "random walk", progress);
        check_lost(&result)?;
        Ok(result)
    }

    fn channels(&self, photons: [u64; 3], seed: u64, stage: &'static str, progress: &dyn Progress) -> Exitance {
        let slots = self.hats.len();
        let (mut total, mut single) = (vec![DVec3::ZERO; slots], vec![DVec3::ZERO; slots]);
        let mut standard_error = vec![DVec3::ZERO; slots];
        let mut budget = [Budget::default(); 3];
        let in_batch = photons.map(|n| n.div_ceil(BATCHES));
        let indices: Vec<u64> = (0..BATCHES).collect();
        let together = (TOGETHER / slots.max(1)).clamp(1, BATCHES as usize);
        let tallies: Vec<SlotTally> = std::iter::repeat_with(|| SlotTally::new(slots)).take(together).collect();
        progress.start(stage, in_batch.iter().sum::<u64>() * BATCHES);
        for channel in 0..3 {
            let Some(irradiance) = self.mean_irradiance(channel, seed) else {
                progress.advance(in_batch[channel] * BATCHES);
                continue;
            };
            // Sums of order 1, of all orders, and of the squares of the latter.
            let mut sums = vec![[0.0; 3]; slots];
            let candidates = in_batch[channel];
            let scale = irradiance * self.entries.area_mm2() / candidates as f64;
            for together in indices.chunks(together) {
                let batch = |(index, tally): (&u64, _)| {
                    let stage = stage_of(seed, &[channel as u64, *index]);
                    Batch { channel, stage, candidates, irradiance, tally }
                };
                let batches: Vec<Batch> = together.iter().zip(&tallies).map(batch).collect();
                let enter = |index: u64, budget: &mut Budget| {
                    self.enter(&batches[(index / candidates) as usize], index % candidates, budget);
                };
                let ends = summed(batches.len() as u64 * candidates, progress, enter);
                budget[channel] = budget[channel].plus(&ends.scaled(scale / BATCHES as f64));
                sums.par_iter_mut().enumerate().with_min_len(LEAST_SLOTS).for_each(|(slot, sums)| {
                    let mass = self.hats.mass_mm2[slot];
                    let factor = if mass > 0.0 { scale / mass } else { 0.0 };
                    for batch in &batches {
                        let [once, more] = batch.tally.take(slot);
                        let all = factor * (once + more);
                        sums[0] += factor * once;
                        sums[1] += all;
                        sums[2] += all * all;
                    }
                });
            }
            let n = BATCHES as f64;
            for (slot, [once, all, squares]) in sums.into_iter().enumerate() {
                single[slot][channel] = once / n;
                total[slot][channel] = all / n;
                let variance = (squares / n - (all / n) * (all / n)).max(0.0) / (n - 1.0);
                standard_error[slot][channel] = variance.sqrt();
            }
        }
        progress.finish();
        Exitance {
            hats: self.hats.clone(),
            total,
            single,
            standard_error,
            budget,
            photons: in_batch.map(|n| n * BATCHES),
        }
    }

    /// Mean irradiance over the surface, roughly; none without light.
    fn mean_irradiance(&self, channel: usize, seed: u64) -> Option<f64> {
        let stage = stage_of(seed, &[3, channel as u64]);
        let candidate = |i: u64| {
            let mut stream = Stream::new(stage, i);
            let candidate = self.entries.candidate(i as f64 / IRRADIANCE_PILOT as f64, &mut stream);
            let unshadowed = candidate.as_ref().map_or(0.0, |c| c.irradiance[channel]);
            [unshadowed, if candidate.is_some_and(|c| self.entries.is_lit(&c)) { unshadowed } else { 0.0 }]
        };
        let values: Vec<[f64; 2]> = (0..IRRADIANCE_PILOT).into_par_iter().map(candidate).collect();
        let mean = |k: usize| values.iter().map(|v| v[k]).sum::<f64>() / IRRADIANCE_PILOT as f64;
        // Any value is right, this one makes a candidate one photon; light that none of them met may still be there.
        [mean(1), mean(0)].into_iter().find(|m| m.is_normal())
    }

    /// Walks the photons that one candidate becomes; their mean number is its irradiance over that of a photon.
    fn enter(&self, batch: &Batch, index: u64, budget: &mut Budget) {
        let mut stream = Stream::new(batch.stage, index << 9);
        // One candidate in each of as many equal areas.
        let along = (index as f64 + stream.uniform()) / batch.candidates as f64;
        let Some(candidate) = self.entries.candidate(along, &mut stream) else { return };
        let wanted = candidate.irradiance[batch.channel] / batch.irradiance;
        let (copies, heavier) = if wanted <= MOST_COPIES {
            ((wanted + stream.uniform()).floor() as u64, 1.0)
        } else {
            (MOST_COPIES as u64, (wanted / MOST_COPIES).min(HEAVIEST))
        };
        if copies == 0 || !self.entries.is_lit(&candidate) {
            return;
        }
        for copy in 0..copies {
            let mut stream = Stream::new(batch.stage, index << 9 | (copy + 1));
            self.photon(batch, &candidate, heavier, &mut stream, budget);
        }
    }

    fn photon(&self, batch: &Batch, candidate: &Candidate, weight: f64, stream: &mut Stream, budget: &mut Budget) {
        let Some(Some((boundary, media))) = self.bodies.of_part.get(candidate.part as usize) else { return };
        let walked = walk(boundary, &media[batch.channel], candidate.start, stream);
        let mut own = Budget::default();
        own.add(&walked);
        *budget = budget.plus(&own.scaled(weight));
        if let End::Left { site, order, weight: left } = walked.end
            && order > 0
        {
            batch.tally.add(self.hats, site, order > 1, left * weight);
        }
    }
}

/// A stage of the random numbers for each purpose.
fn stage_of(seed: u64, purpose: &[u64]) -> u64 {
    purpose.iter().fold(crate::math::random::mix(seed), |stage, p| crate::math::random::mix(stage ^ p))
}

/// Walks photons of weight 1 from the same start, or from starts that `start` draws, through any boundary.
/// The result has the same bits on any number of threads.
pub fn budget<B: Boundary>(
    boundary: &B,
    medium: &WalkMedium,
    photons: u64,
    seed: u64,
    start: impl Fn(&mut Stream) -> Start + Sync,
) -> Budget {
    summed(photons, &Silent, |index, budget| {
        let mut stream = Stream::new(seed, index);
        let start = start(&mut stream);
        budget.add(&walk(boundary, medium, start, &mut stream));
    })
}

/// The budget of `count` photons or candidates, in a fixed order.
fn summed(count: u64, progress: &dyn Progress, add: impl Fn(u64, &mut Budget) + Sync) -> Budget {
    let chunk = |chunk: u64| {
        let mut budget = Budget::default();
        let range = chunk * CHUNK..((chunk + 1) * CHUNK).min(count);
        progress.advance(range.end - range.start);
        range.for_each(|index| add(index, &mut budget));
        budget
    };
    let budgets: Vec<Budget> = (0..count.div_ceil(CHUNK)).into_par_iter().map(chunk).collect();
    budgets.iter().fold(Budget::default(), |sum, b| sum.plus(b))
}
