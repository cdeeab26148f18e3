//! Visibility of the lights of a set from the samples, and radiosity under all of them.

use std::sync::OnceLock;

use glam::DVec3;

use super::light_set::SIDE;
use crate::error::{Error, Result};
use crate::evaluate::StageCache;
use crate::evaluate::stage_cache::Key;
use crate::forms::sampled_scene::SampledScene;
use crate::geometry::cluster;
use crate::light::Light;
use crate::light::quantised::directions::DirectionSet;
use crate::light::quantised::distances::QuantisedLights;
use crate::math::cube_map::texel_of;
use crate::medium::fresnel;
use crate::parallel::*;
use crate::progress::{Progress, Silent};
use crate::transport::many_lights::{IrradianceRows, ManyLights};
use crate::transport::visibility::{self, Observer, Occluders, Resolution, visit};

/// Samples whose visibility is decided together.
const GROUP_OF_OBSERVERS: usize = 2 * visibility::GROUP;

/// Lights that share their clusters.
const NEIGHBOURS: usize = 128;

/// Visibility of the lights of a set from each sample: one bit each, `[sample][word]`.
pub struct Seen {
    observers: Vec<Observer>,
    /// Places of the lights; visibility of those nearer than something that casts shadows is not known here.
    places: Vec<Place>,
    words: usize,
    bits: Vec<u64>,
}

/// A light of irradiance 1 at the centre of the scene.
#[derive(Clone, Copy)]
enum Place {
    /// From the centre of a texel of a cube map, and the texel.
    Direction(DVec3, usize),
    /// Position relative to the mesh's origin, and its distance from the centre, mm; everything else is nearer to the centre.
    Point(DVec3, f64),
    /// Visibility left to rays.
    Near,
}

impl Seen {
    /// Visibility of parallel lights from the centres of texels of a cube map, and of points around the scene:
    /// everything in their direction is in front of them, so that the texel decides whether it is blocked.
    pub fn new(sampled: &SampledScene, lights: &QuantisedLights, progress: &dyn Progress) -> Self {
        let mut seen = Self::undecided(sampled, lights);
        seen.bits = seen.decided(sampled, progress);
        seen
    }

    /// The same, taken from another process where several share a bake.
    fn common(
        sampled: &SampledScene,
        lights: &QuantisedLights,
        (cache, progress): (&StageCache, &dyn Progress),
    ) -> Result<Self> {
        let mut seen = Self::undecided(sampled, lights);
        let key = |key: &mut Key| {
            key.samples(&sampled.samples).text(&format!("{lights:?}"));
        };
        seen.bits = cache.common("visibility", key, || Ok(seen.decided(sampled, progress)))?;
        if seen.bits.len() != seen.observers.len() * seen.words {
            return Err(Error::input(format!("visibility of {} words is that of another set", seen.bits.len())));
        }
        Ok(seen)
    }

    /// Without any light that is seen.
    fn undecided(sampled: &SampledScene, lights: &QuantisedLights) -> Self {
        let mesh = &sampled.scene.mesh;
        let centre = lights.shells.centre_mm() - mesh.origin_mm;
        let farthest = mesh.local_mm.iter().map(|v| v.as_dvec3().distance(centre)).fold(0.0, f64::max);
        let place = |index: usize| match lights.entry(index) {
            Some(Light::Directional { from, .. }) => Place::Direction(from, texel_of(SIDE, from)),
            Some(Light::Point { at_mm, .. }) => {
                let at = at_mm - mesh.origin_mm;
                let distance_mm = at.distance(centre);
                if distance_mm > farthest { Place::Point(at, distance_mm) } else { Place::Near }
            }
            _ => Place::Near,
        };
        let places: Vec<Place> = (0..lights.count()).map(place).collect();
        let (words, samples) = (places.len().div_ceil(64), sampled.samples.len());
        let observers: Vec<Observer> =
            (0..samples).into_par_iter().map(|i| Observer::of(mesh, sampled.samples.patch(i))).collect();
        Self { observers, places, words, bits: Vec::new() }
    }

    /// Decides the visibility, one bit for each light, `[sample][word]`.
    fn decided(&self, sampled: &SampledScene, progress: &dyn Progress) -> Vec<u64> {
        let Self { observers, places, words, .. } = self;
        let (words, samples) = (*words, observers.len());
        let occluders = Occluders::new(&sampled.scene.mesh);
        let mut bits = vec![0u64; samples * words];
        progress.start("visibility", samples as u64);
        let chunks = observers.par_chunks(GROUP_OF_OBSERVERS);
        bits.par_chunks_mut(GROUP_OF_OBSERVERS * words.max(1)).zip(chunks).for_each(|(bits, observers)| {
            visit(&occluders, &sampled.bvh, observers, Resolution::Sub64, |i, visible| {
                let Some(observer) = observers.get(i) else { return };
                for (light, place) in places.iter().enumerate() {
                    let (direction, texel) = match place {
                        Place::Direction(direction, texel) => (*direction, Some(*texel)),
                        Place::Point(at, _) => (*at - observer.eye.as_dvec3(), None),
                        Place::Near => continue,
                    };
                    if observer.normal.dot(direction) > 0.0 {
                        let texel = texel.unwrap_or_else(|| texel_of(SIDE, direction));
                        let (face, x, y) = (texel / (SIDE * SIDE), texel % SIDE, texel / SIDE % SIDE);
                        bits[i * words + light / 64] |=
                            u64::from(visible.bit(&visible.seen, face, x, y)) << (light % 64);
                    }
                }
            });
            progress.advance(observers.len() as u64);
        });
        progress.finish();
        bits
    }

    /// True if the visibility of all of some lights is known.
    fn knows(&self, lights: &[u32]) -> bool {
        lights.iter().all(|&l| !matches!(self.places.get(l as usize), Some(Place::Near) | None))
    }

    /// Irradiance that enters at a sample from a light; 0 where its visibility is not known.
    fn irradiance(&self, sample: usize, light: u32, eta: f64) -> f64 {
        if self.bits[sample * self.words + light as usize / 64] >> (light % 64) & 1 == 0 {
            return 0.0;
        }
        let observer = &self.observers[sample];
        let (direction, falloff) = match self.places[light as usize] {
            Place::Direction(direction, _) => (direction, 1.0),
            Place::Point(at, distance_mm) => {
                let to_light = at - observer.eye.as_dvec3();
                let squared = to_light.length_squared();
                (to_light / squared.sqrt(), distance_mm * distance_mm / squared)
            }
            Place::Near => return 0.0,
        };
        let cosine = observer.normal.dot(direction).max(0.0);
        falloff * fresnel::transmittance(eta, cosine) * cosine
    }
}

/// Irradiance of every sample under lights of a set, by their indices, from the known visibility.
pub fn irradiance_of_seen(sampled: &SampledScene, seen: &Seen, lights: &[u32]) -> IrradianceRows {
    let count = lights.len();
    let mut values = vec![0.0f32; sampled.samples.len() * count];
    let eta_of_part = |part: usize| {
        let medium = sampled.scene.parts.parts[part].medium.and_then(|m| sampled.scene.media.get(m as usize));
        medium.map_or(1.0, |m| m.properties.eta_inside_over_outside)
    };
    values.par_chunks_mut(count.max(1)).enumerate().for_each(|(sample, row)| {
        let part = sampled.samples.part_offsets.partition_point(|&p| p as usize <= sample).saturating_sub(1);
        let eta = eta_of_part(part);
        row.iter_mut().zip(lights).for_each(|(value, &light)| *value = seen.irradiance(sample, light, eta) as f32);
    });
    IrradianceRows { lights: count, by_channel: false, values }
}

/// The lights of a set in runs of neighbours, indices of entries, with all shells of a direction in one run, since the
/// tree is walked once for a run.
pub fn neighbours(set: &DirectionSet, shells: usize) -> Vec<Vec<u32>> {
    let count = set.count();
    let mut order: Vec<u32> = (0..count as u32).collect();
    let runs = cluster::groups(&mut order, set.directions(), (NEIGHBOURS / shells.max(1)).max(1));
    let of_run = |run: &cluster::Run| {
        let directions = &order[run.range()];
        (0..shells).flat_map(|shell| directions.iter().map(move |i| (shell * count) as u32 + i)).collect()
    };
    runs.iter().map(of_run).collect()
}

/// Radiosity at receivers under all lights of a set, run by run of neighbours.
pub(super) struct UnderSet<'a> {
    sampled: &'a SampledScene<'a>,
    transfer: &'a ManyLights<'a>,
    lights: &'a QuantisedLights,
    runs: Vec<Vec<u32>>,
    /// Made for the first run that is computed.
    seen: OnceLock<Seen>,
    cache: &'a StageCache,
    progress: &'a dyn Progress,
}

impl<'a> UnderSet<'a> {
    /// `transfer` goes to the receivers.
    pub(super) fn new(
        sampled: &'a SampledScene<'a>,
        transfer: &'a ManyLights<'a>,
        lights: &'a QuantisedLights,
        (cache, progress): (&'a StageCache, &'a dyn Progress),
    ) -> Self {
        let runs = neighbours(&lights.directions, lights.shells.inverse().len());
        Self { sampled, transfer, lights, runs, seen: OnceLock::new(), cache, progress }
    }

    /// Number of runs.
    pub(super) fn runs(&self) -> usize {
        self.runs.len()
    }

    /// Number of radiosities of a run at so many receivers.
    pub(super) fn rows_of(&self, run: usize, receivers: usize) -> usize {
        3 * receivers * self.runs.get(run).map_or(0, Vec::len)
    }

    /// Decides the visibility of all lights, unless that has been done: a stage of its own, before the first run is computed.
    pub(super) fn look(&self) -> Result<&Seen> {
        if let Some(seen) = self.seen.get() {
            return Ok(seen);
        }
        let seen = Seen::common(self.sampled, self.lights, (self.cache, self.progress))?;
        Ok(self.seen.get_or_init(|| seen))
    }

    /// Radiosities `[receiver][channel][light of the run]`.
    ///
    /// # Errors
    /// Lights that cannot be served.
    pub(super) fn of_run(&self, run: usize) -> Result<Vec<f32>> {
        let run = self.runs.get(run).map_or(&[] as &[u32], Vec::as_slice);
        let seen = self.look()?;
        let entries: Vec<Light> = run.iter().filter_map(|&i| self.lights.entry(i as usize)).collect();
        let irradiance = if seen.knows(run) {
            self.sampled.moved_rows(&entries, irradiance_of_seen(self.sampled, seen, run))
        } else {
            self.sampled.irradiance(&entries)?
        };
        Ok(self.transfer.radiosity(&irradiance, &Silent).values)
    }

    /// Radiosities `[receiver][channel][light]` of a number of receivers, from those of each run.
    ///
    /// # Errors
    /// Those of `of_run`.
    pub(super) fn all(&self, receivers: usize, of_run: impl Fn(usize) -> Result<Vec<f32>>) -> Result<Vec<f32>> {
        let count = self.lights.count();
        let mut values = vec![0.0f32; receivers * 3 * count];
        self.progress.start("lights", count as u64);
        for (index, run) in self.runs.iter().enumerate() {
            let rows = of_run(index)?;
            for (out, row) in values.chunks_exact_mut(count).zip(rows.chunks_exact(run.len().max(1))) {
                run.iter().zip(row).for_each(|(&light, value)| out[light as usize] = *value);
            }
            self.progress.advance(run.len() as u64);
        }
        self.progress.finish();
        Ok(values)
    }
}

/// Radiosity at receivers under lights of a set: `[receiver][channel][light]`.
///
/// # Errors
/// Lights that cannot be served.
pub fn radiosity_of_set(
    sampled: &SampledScene,
    transfer: &ManyLights,
    lights: &QuantisedLights,
    receivers: usize,
    progress: &dyn Progress,
) -> Result<Vec<f32>> {
    let alone = StageCache::default();
    let under = UnderSet::new(sampled, transfer, lights, (&alone, progress));
    under.look()?;
    under.all(receivers, |run| under.of_run(run))
}
