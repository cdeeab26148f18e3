//! Bake of `quantized_lights`: radiosity at reference points under every light of the set, coded.

use std::borrow::Cow;
use std::sync::Arc;

use glam::DVec3;
use serde::{Deserialize, Serialize};
use translux_format::Tag;
use translux_format::quantised_lights::{QuantisedLights as File, tags};

use super::evaluate::{open, transport};
use super::light_set::{LightSet, light_net, light_spacing};
use super::seen::UnderSet;
use super::settings::{LightSetSettings, QuantisedLights};
use crate::asset::Asset;
use crate::compress::ledger::Ledger;
use crate::compress::prediction::Net;
use crate::error::Result;
use crate::evaluate::form::write_error;
use crate::evaluate::stage_cache::Key;
use crate::evaluate::stages::{of_kinds, spread, worst};
use crate::evaluate::{AssetParts, BakeSettings, Capabilities, Evaluator, Forecast, Form, Model, StageCache};
use crate::forms::density;
use crate::forms::distant;
use crate::forms::projected::coding::{Radiosities, code};
use crate::forms::projected::components::LightBasis;
use crate::forms::projected::forecast::{Basis, forecast};
use crate::forms::projected::reach::allowed;
use crate::forms::projected::references::{in_ascending_order, in_order_of_rows, spacing, spatial_error, under};
use crate::forms::sampled_scene::{GROUP, SampledScene, parts};
use crate::forms::truths::Truths;
use crate::light::{Light, LightKind};
use crate::math::statistics::VertexError;
use crate::progress::{Progress, Silent};
use crate::scene::Scene;
use crate::transport::gather::Scheme;
use crate::transport::many_lights::ManyLights;
use crate::transport::near_rule::NearField;

/// Shares of the asked error: the rest of its square goes to the interpolation between lights.
const SPATIAL: f64 = 0.42;
const CODED: f64 = 0.45;
const HIERARCHY: f64 = 0.1;
const BETWEEN_LIGHTS: f64 = 0.65;

/// Light without sharp shadows, but for that of suns in an environment.
const SOFT: [LightKind; 2] = [LightKind::Environment, LightKind::Constant];

/// Directions of the first set, from whose error the number is chosen, those of the second at most, and the largest number.
const FIRST_SET: usize = 200;
const SECOND_SET: usize = 400;
const LARGEST_SET: usize = 1600;

/// Receivers that these errors are measured at.
const FIRST_POINTS: usize = 768;

/// The interpolation's error falls with this power of the number of directions (measured on closed bunny and horse), where no second
/// set tells another one in this range. Below the least it hardly falls any more: more directions are not worth their bytes.
const ORDER: f64 = 0.7;
const ORDERS: std::ops::RangeInclusive<f64> = 0.3..=2.0;
const WORTHWHILE: f64 = 0.3;

/// A number of directions that is as good as none.
const MANY: usize = 100_000;

/// Lights that choices look at.
pub const TUNING: usize = 20;

/// Vertices of which more than a quarter may be reference points.
const MANY_VERTICES: u64 = 4096;

/// Copies of the radiosities that are in memory together.
const COPIES: u64 = 4;

impl Form for QuantisedLights {
    const NAME: &'static str = "quantised_lights";

    fn validate(&self) -> Result<()> {
        self.density.validate()?;
        self.lights.validate()?;
        self.single.validate()?;
        self.spacing.validate()
    }

    fn kinds(&self) -> &'static [LightKind] {
        &LightKind::STORABLE
    }

    fn serves(&self, _: Model) -> bool {
        true
    }

    fn divides(&self) -> bool {
        true
    }

    fn edits(&self, _: &dyn Fn(Tag) -> bool) -> Option<Capabilities> {
        Some(Capabilities::NONE)
    }

    fn bake_memory(&self, scene: &Scene, settings: &BakeSettings) -> u64 {
        let directions = self.lights.directions.unwrap_or(LARGEST_SET) as u64;
        let shells = self.lights.shells as u64 + 1;
        let (samples, lights) = (self.density.count(scene, settings.samples) as u64, directions * shells);
        // Radiosities of each reference point; about a quarter of many vertices at most, and nearly all of few. Beside them while they are
        // coded: those of the shells that are coded, decorrelated, and their coefficients, predicted, quantised and known.
        let vertices = scene.mesh.local_mm.len() as u64;
        let references = (vertices / 4 + 256).max(vertices.min(MANY_VERTICES));
        // Light that is moved to where it first scatters is another in every channel.
        let channels = if settings.model == Model::Dipole { 1 } else { 3 };
        // Visibility, irradiance and flux of a run of lights; the products of lights and of their functions.
        density::memory(samples as usize, scene, settings.model)
            + references * 3 * 4 * COPIES * lights
            + samples * (lights / 8 + 128 * 4 * 3 * channels)
            + 8 * 4 * directions * directions
    }

    fn forecast(&self, scene: &Scene, settings: &BakeSettings) -> Option<Forecast> {
        let shells = self.lights.shells as f64;
        let basis = Basis {
            sharp_rms: 0.038,
            bytes: 2e6 * (1.0 + 0.8 * shells),
            bake_s: 11.0 + 6.0 * shells,
            keeps: [1.0, 1.6],
        };
        let kinds = if self.lights.shells == 0 { distant::KINDS } else { &LightKind::STORABLE[..] };
        Some(forecast(scene, settings, self.density, basis, true).served(kinds))
    }

    fn bake(&self, scene: &Scene, settings: &BakeSettings, progress: &dyn Progress) -> Result<AssetParts> {
        progress.start("samples", 0);
        let sampled = SampledScene::with_density(scene, self.density, settings)?;
        let (sampled, calibration) = sampled.with_model(settings, self.single.orders(), progress)?;
        progress.finish();
        sampled.with_transfer(NearField::for_error(settings.max_rms), |mut transfer| {
            let mut tuning = chosen(&settings.probes.tuning, TUNING);
            let unseen = &settings.probes.unseen;
            if settings.is_for(LightKind::Directional) && !tuning.is_empty() {
                tuning.extend(distant::edge_on(scene, distant::TUNING_TURNS));
            }
            let asked = |key: &mut Key| {
                key.text(&format!("{self:?} {}", settings.max_rms)).samples(&sampled.samples);
            };
            let Tuned { scheme, hierarchy, truth } = settings.cache.common("tuning", asked, || {
                progress.start("tuning", tuning.len() as u64);
                let rows = sampled.irradiance(&tuning)?;
                let hierarchy = transfer.tune(HIERARCHY * settings.max_rms, &rows);
                let truth = transfer.radiosity(&rows, &Silent);
                let truth = (0..tuning.len()).map(|light| truth.under(light)).collect();
                progress.finish();
                Ok(Tuned { scheme: transfer.scheme(), hierarchy, truth })
            })?;
            let transfer = transfer.with_scheme(scheme);
            let needed = match self.lights.directions {
                Some(directions) => Needed { directions, reached: 0.0, wanted: directions, largest: 0.0 },
                None => settings.cache.common("number of lights", asked, || {
                    let under = (tuning.as_slice(), truth.as_slice());
                    needed((&sampled, &transfer, &self.lights), under, settings.max_rms, progress)
                })?,
            };
            // What the set cannot reach is not worth the bytes of the other stages.
            let allowed = allowed(settings.max_rms, needed.reached);
            let by_error = || spacing(&sampled, &truth, SPATIAL * allowed);
            let spacing_mm = self.spacing.asked_mm(&sampled).unwrap_or_else(by_error);
            let net = Net::new(&sampled.points, &parts(&sampled.receivers), spacing_mm);
            let set = LightSet::planned(scene, needed.directions, &self.lights)?;
            let folding = self.single.folded(&sampled);
            let chosen = |key: &mut Key| {
                key.text(&format!("{self:?} {allowed} {:?} {:?}", needed.directions, transfer.scheme()));
                key.samples(&sampled.samples).rows(&net.point);
            };
            let served = served(&set, unseen);
            let truth = |light: &Light| -> Result<Vec<DVec3>> {
                let mut truth = transfer.under(&sampled.by_rays(light)?);
                if let Some(folding) = &folding {
                    folding.add(light, &mut truth)?;
                }
                Ok(truth)
            };
            let truths = Truths::new(&served, (&truth, sampled.receivers.len()), &settings.cache, chosen);
            truths.ahead(progress)?;
            let ways = (&settings.cache, progress);
            let mut values = at_references(&sampled, &transfer, &set, (&net.point, ways), |under, receivers| {
                let blocks = settings.cache.blocks("lights", under.runs(), chosen);
                if blocks.are_computed() {
                    under.look()?;
                }
                blocks.ahead(progress, |run| under.of_run(run))?;
                settings.cache.gather()?;
                under.all(receivers, |run| blocks.rows((run, under.rows_of(run, receivers)), || under.of_run(run)))
            })?;
            if let Some(folding) = &folding {
                let of_set = (set.lights.count(), |index| set.lights.entry(index));
                folding.add_under_set(&net.point, of_set, &mut values, progress)?;
            }
            progress.start("coding", 0);
            let shells = set.lights.shells.inverse().len();
            let direction_spacing = light_spacing(&set.lights.directions);
            let directions_net = light_net(&set.lights.directions, direction_spacing);
            let count = set.lights.directions.count();
            let mut file = File {
                directions: count as u32,
                shells: set.lights.shells.inverse().to_vec(),
                spacing_mm,
                direction_spacing,
                samples: sampled.samples.len() as u32,
                sets: Vec::new(),
            };
            // Parallel light is alone, so that who has no other does not pay for it.
            for (tags, shells) in tags::SETS.into_iter().zip([0..1, 1..shells]) {
                if !shells.is_empty() {
                    let own = of_shells(&values, set.lights.shells.inverse().len(), count, shells.clone());
                    let radiosities = Radiosities::new(own, shells.len(), count);
                    file.sets.push(code(&radiosities, &net, &directions_net, tags, CODED * allowed)?);
                }
            }
            let mut sections = file.to_sections().map_err(write_error)?;
            sections.extend(calibration);
            progress.finish();
            let mut ledger = Ledger::default();
            let near = NearField::for_error(settings.max_rms);
            let soft = settings.for_lights.iter().all(|kind| SOFT.contains(kind));
            let judges = if soft { of_kinds(&served, &SOFT) } else { sharp(&served) };
            sampled.enter_sampling(&judges, near, &mut ledger, progress)?;
            ledger.add("hierarchy", hierarchy, "against all pairs, on vertices that no tuning saw");
            let baked = (&set, &net, values.as_slice(), &file);
            measure((&sampled, &truths), baked, (&needed, soft), &mut ledger, progress)?;
            Ok(AssetParts::without_samples(scene, ledger, sections))
        })
    }

    fn open(&self, asset: Arc<Asset>) -> Result<Box<dyn Evaluator>> {
        open(self, &asset)
    }
}

/// The directional and point lights among some.
fn sharp(lights: &[Light]) -> Vec<Light> {
    of_kinds(lights, &[LightKind::Directional, LightKind::Point])
}

/// `count` or fewer of the directional and point lights, spread over all.
pub fn chosen(lights: &[Light], count: usize) -> Vec<Light> {
    spread(&sharp(lights), count).cloned().collect()
}

/// Radiosities `[point][channel][light]` of some receivers, whose number `all` is told.
fn at_references(
    sampled: &SampledScene,
    transfer: &ManyLights,
    set: &LightSet,
    (points, ways): (&[u32], (&StageCache, &dyn Progress)),
    all: impl FnOnce(&UnderSet, usize) -> Result<Vec<f32>>,
) -> Result<Vec<f32>> {
    in_ascending_order(points, 3 * set.lights.count(), |ascending| {
        let receivers = sampled.receivers.only(ascending, GROUP);
        let areas = vec![1.0; receivers.len()];
        let transfer = transfer.towards(&receivers, &areas);
        all(&UnderSet::new(sampled, &transfer, &set.lights, ways), receivers.len())
    })
}

/// Radiosities of some of the shells.
fn of_shells(values: &[f32], shells: usize, directions: usize, some: std::ops::Range<usize>) -> Cow<'_, [f32]> {
    if some.len() == shells {
        return Cow::Borrowed(values);
    }
    let planes = values.chunks_exact((shells * directions).max(1));
    Cow::Owned(planes.flat_map(|plane| &plane[some.start * directions..some.end * directions]).copied().collect())
}

/// Radiosity under a light by interpolation between the lights of a set, at the rows of the net.
fn interpolated(set: &LightSet, values: &[f32], light: &Light) -> Result<Vec<DVec3>> {
    Ok(under(values, set.lights.count(), &set.vector(std::slice::from_ref(light))?))
}

/// What lights that choices look at tell.
#[derive(Serialize, Deserialize)]
struct Tuned {
    scheme: Scheme,
    /// Error of the hierarchy.
    hierarchy: VertexError,
    /// Radiosity of every receiver under each of the lights.
    truth: Vec<Vec<DVec3>>,
}

/// A number of directions, and what it reaches.
#[derive(Serialize, Deserialize)]
struct Needed {
    directions: usize,
    /// Smallest error that a bake with so many could be asked for.
    reached: f64,
    /// Directions that the asked error would take, about, and what the largest set would reach.
    wanted: usize,
    largest: f64,
}

/// The number of directions for an asked error under the lights of a choice, as far as two small sets tell at some receivers: the second
/// says how fast the error falls. Where the largest set cannot reach it, the nearest that is worth its bytes.
fn needed(
    (sampled, transfer, settings): (&SampledScene, &ManyLights, &LightSetSettings),
    (lights, truth): (&[Light], &[Vec<DVec3>]),
    max_rms: f64,
    progress: &dyn Progress,
) -> Result<Needed> {
    let (_, points) = sampled.receivers.subset(FIRST_POINTS, 0);
    let error = |directions: usize| -> Result<f64> {
        let set = LightSet::planned(sampled.scene, directions, settings)?;
        let ways = (&StageCache::default(), progress);
        let values = at_references(sampled, transfer, &set, (&points, ways), |under, receivers| {
            under.look()?;
            under.all(receivers, |run| under.of_run(run))
        })?;
        between_lights(sampled, &set, &points, &values, lights, truth)
    };
    let target = BETWEEN_LIGHTS * max_rms;
    let for_error = |(count, error): (usize, f64), order: f64| {
        ((count as f64 * (error / target).powf(1.0 / order)).ceil()).clamp(1.0, 1e9) as usize
    };
    let first = error(FIRST_SET)?;
    let wanted = for_error((FIRST_SET, first), ORDER);
    if wanted <= FIRST_SET {
        return Ok(Needed { directions: wanted.max(FIRST_SET / 4), reached: 0.0, wanted, largest: 0.0 });
    }
    let count = wanted.clamp(FIRST_SET * 3 / 2, SECOND_SET);
    let second = error(count)?;
    let order = ((first / second).ln() / (count as f64 / FIRST_SET as f64).ln()).clamp(*ORDERS.start(), *ORDERS.end());
    let wanted = for_error((count, second), order);
    let most = if order < WORTHWHILE { count } else { LARGEST_SET };
    let directions = wanted.clamp(FIRST_SET / 4, most);
    let with = |directions: usize| second * (count as f64 / directions as f64).powf(order);
    let reached = if wanted > most { with(directions) / BETWEEN_LIGHTS } else { 0.0 };
    Ok(Needed { directions, reached, wanted, largest: with(LARGEST_SET) })
}

/// Error of the interpolation between lights under the worst of those that the set serves.
fn between_lights(
    sampled: &SampledScene,
    set: &LightSet,
    points: &[u32],
    values: &[f32],
    lights: &[Light],
    truth: &[Vec<DVec3>],
) -> Result<f64> {
    let points = sampled.probes(points.to_vec());
    let served = lights.iter().zip(truth).filter(|(light, _)| set.vector(std::slice::from_ref(*light)).is_ok());
    let [error] =
        worst(served, |(light, truth)| Ok([points.error(&interpolated(set, values, light)?, &points.of(truth))]))?;
    Ok(error.rms)
}

/// The lights among some that a set serves.
fn served(set: &LightSet, lights: &[Light]) -> Vec<Light> {
    let parallel = set.lights.shells.inverse().len() == 1;
    of_kinds(lights, if parallel { distant::KINDS } else { &LightKind::STORABLE })
}

/// Enters the error of each stage under lights that no choice saw.
fn measure(
    (sampled, truths): (&SampledScene, &Truths),
    (set, net, values, file): (&LightSet, &Net, &[f32], &File),
    (needed, soft): (&Needed, bool),
    ledger: &mut Ledger,
    progress: &dyn Progress,
) -> Result<()> {
    let transport = transport(file, sampled.scene, &sampled.receivers, set)?;
    let points = sampled.probes(net.point.clone());
    progress.start("errors", truths.lights().len() as u64);
    let under = |(index, light): (usize, &Light)| {
        progress.advance(1);
        let truth = truths.under(index)?;
        let between = interpolated(set, values, light)?;
        let lit = set.lit(&transport, std::slice::from_ref(light))?;
        let coded = in_order_of_rows(net, &transport.at_references(&lit));
        Ok([
            points.error(&between, &points.of(&truth)),
            spatial_error(sampled, net, file.spacing_mm, std::slice::from_ref(&truth)),
            points.error(&coded, &between),
        ])
    };
    // Where soft light alone is asked for, suns are what an environment may be dark but for.
    let (suns, judges): (Vec<_>, Vec<_>) =
        truths.lights().iter().copied().enumerate().partition(|(_, light)| soft && !SOFT.contains(&light.kind()));
    let errors: [VertexError; 3] = worst(judges, under)?;
    let alone: [VertexError; 3] = worst(suns.iter().copied(), under)?;
    progress.finish();
    let count = set.lights.directions.count();
    let mut note = format!("interpolation between {count} directions, under lights that no choice saw");
    if needed.reached > 0.0 {
        let (wanted, most) = (needed.wanted, 100.0 * needed.largest);
        note.push_str(&match count < LARGEST_SET {
            true => format!(": it hardly falls with more, {LARGEST_SET} would reach about {most:.2} %"),
            false if wanted > MANY => ": the most that are chosen, and no number reaches the asked error".to_owned(),
            false => format!(": the most that are chosen, and the asked error would take about {wanted}"),
        });
        note.push_str("; the other stages are no finer than is worth it beside that");
    }
    ledger.add("lights", errors[0], note);
    ledger.add("reference points", errors[1], format!("interpolation from {} of them, as above", net.point.len()));
    ledger.add("coding", errors[2], "basis of the lights and quantiser, as above");
    if soft && !suns.is_empty() {
        ledger.add_sun_alone(alone.into_iter().reduce(VertexError::beside).unwrap_or_default());
    }
    Ok(())
}
