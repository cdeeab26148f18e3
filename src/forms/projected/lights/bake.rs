//! Bake of `quantized_lights`: radiosity at reference points under every light of the set, coded.

use std::borrow::Cow;
use std::sync::Arc;

use glam::DVec3;
use translux_format::quantised_lights::{QuantisedLights as File, tags};

use super::evaluate::{open, transport};
use super::light_set::{LightSet, light_net, light_spacing};
use super::seen::radiosity_of_set;
use super::settings::{LightSetSettings, QuantisedLights};
use crate::asset::Asset;
use crate::compress::ledger::Ledger;
use crate::compress::prediction::Net;
use crate::error::Result;
use crate::evaluate::form::write_error;
use crate::evaluate::stages::{of_kinds, spread, worst};
use crate::evaluate::{AssetParts, BakeSettings, Evaluator, Forecast, Form, Model};
use crate::forms::density;
use crate::forms::distant;
use crate::forms::projected::coding::{Radiosities, code};
use crate::forms::projected::components::LightBasis;
use crate::forms::projected::forecast::{Basis, forecast};
use crate::forms::projected::references::{in_ascending_order, in_order_of_rows, spacing, spatial_error, under};
use crate::forms::sampled_scene::{GROUP, SampledScene, parts};
use crate::light::{Light, LightKind};
use crate::progress::{Progress, Silent};
use crate::scene::Scene;
use crate::transport::calibration::Orders;
use crate::transport::many_lights::ManyLights;
use crate::transport::near_rule::NearField;

/// Shares of the asked error: the rest of its square goes to the interpolation between lights.
const SPATIAL: f64 = 0.42;
const CODED: f64 = 0.45;
const HIERARCHY: f64 = 0.1;
const BETWEEN_LIGHTS: f64 = 0.65;

/// Directions of the first set, from whose error the number is chosen, and the largest number.
const FIRST_SET: usize = 200;
const LARGEST_SET: usize = 1600;

/// Reference points, the coarsest ones, that this error is measured at.
const FIRST_POINTS: usize = 1024;

/// The interpolation's error falls with this power of the number of directions (measured on closed bunny and horse).
const ORDER: f64 = 0.7;

/// Lights that choices look at.
pub const TUNING: usize = 20;

impl Form for QuantisedLights {
    const NAME: &'static str = "quantised_lights";

    fn validate(&self) -> Result<()> {
        self.density.validate()?;
        self.lights.validate()?;
        self.spacing.validate()
    }

    fn serves(&self, _: Model) -> bool {
        true
    }

    fn bake_memory(&self, scene: &Scene, settings: &BakeSettings) -> u64 {
        let directions = self.lights.directions.unwrap_or(LARGEST_SET) as u64;
        let shells = self.lights.shells as u64 + 1;
        let (samples, lights) = (self.density.count(scene, settings.samples) as u64, directions * shells);
        // Radiosities of each reference point, twice; about a quarter of the vertices at most.
        let references = scene.mesh.local_mm.len() as u64 / 4 + 256;
        // Visibility, irradiance and flux of a run of lights; the products of lights and of their functions.
        density::memory(samples as usize, scene)
            + references * 3 * 4 * 2 * lights
            + samples * (lights / 8 + 128 * 4 * 3)
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
        let kinds = if self.lights.shells == 0 { distant::KINDS } else { &LightKind::ALL[..] };
        Some(forecast(scene, settings.max_rms, basis, true).served(kinds))
    }

    fn bake(&self, scene: &Scene, settings: &BakeSettings, progress: &dyn Progress) -> Result<AssetParts> {
        progress.start("samples", 0);
        let sampled = SampledScene::new(scene, self.density.count(scene, settings.samples));
        let (sampled, calibration) = sampled.with_model(settings, Orders::FromOne, progress)?;
        progress.finish();
        sampled.with_transfer(NearField::for_error(settings.max_rms), |mut transfer| {
            let tuning = chosen(&settings.probes.tuning, TUNING);
            progress.start("tuning", tuning.len() as u64);
            let rows = sampled.irradiance(&tuning)?;
            let hierarchy = transfer.tune(HIERARCHY * settings.max_rms, &rows);
            let truth = transfer.radiosity(&rows, &Silent);
            let truth: Vec<Vec<DVec3>> = (0..tuning.len()).map(|light| truth.under(light)).collect();
            let by_error = || spacing(&sampled, &truth, SPATIAL * settings.max_rms);
            let spacing_mm = self.spacing.asked_mm(&sampled).unwrap_or_else(by_error);
            progress.finish();
            let net = Net::new(&sampled.points, &parts(&sampled.receivers), spacing_mm);
            let directions = match self.lights.directions {
                Some(directions) => directions,
                None => {
                    // Parallel light tells how many directions are needed, at some reference points.
                    let few = &net.point[..net.point.len().min(FIRST_POINTS)];
                    let first = LightSet::planned(scene, FIRST_SET, &LightSetSettings { shells: 0, ..self.lights })?;
                    let values = at_references(&sampled, &transfer, &first, few, progress)?;
                    let found = between_lights(&sampled, &first, few, &values, &tuning, &truth)?;
                    let factor = (found / (BETWEEN_LIGHTS * settings.max_rms)).powf(1.0 / ORDER);
                    ((FIRST_SET as f64 * factor).ceil() as usize).clamp(FIRST_SET / 4, LARGEST_SET)
                }
            };
            let set = LightSet::planned(scene, directions, &self.lights)?;
            let values = at_references(&sampled, &transfer, &set, &net.point, progress)?;
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
                    file.sets.push(code(&radiosities, &net, &directions_net, tags, CODED * settings.max_rms)?);
                }
            }
            let mut sections = file.to_sections().map_err(write_error)?;
            sections.extend(calibration);
            progress.finish();
            let mut ledger = Ledger::default();
            ledger.add("hierarchy", hierarchy, "against all pairs, on vertices that no tuning saw");
            measure(&sampled, &transfer, (&set, &net, &values, &file), &settings.probes.unseen, &mut ledger, progress)?;
            Ok(AssetParts::without_samples(scene, ledger, sections))
        })
    }

    fn open(&self, asset: Arc<Asset>) -> Result<Box<dyn Evaluator>> {
        open(self, &asset)
    }
}

/// `count` or fewer of the directional and point lights, spread over all.
pub fn chosen(lights: &[Light], count: usize) -> Vec<Light> {
    spread(&of_kinds(lights, &[LightKind::Directional, LightKind::Point]), count).cloned().collect()
}

/// Radiosities `[point][channel][light]` of some receivers.
fn at_references(
    sampled: &SampledScene,
    transfer: &ManyLights,
    set: &LightSet,
    points: &[u32],
    progress: &dyn Progress,
) -> Result<Vec<f32>> {
    in_ascending_order(points, 3 * set.lights.count(), |ascending| {
        let receivers = sampled.receivers.only(ascending, GROUP);
        let areas = vec![1.0; receivers.len()];
        let transfer = transfer.towards(&receivers, &areas);
        radiosity_of_set(sampled, &transfer, &set.lights, receivers.len(), progress)
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

/// Error of the interpolation between lights under the worst parallel one.
fn between_lights(
    sampled: &SampledScene,
    set: &LightSet,
    points: &[u32],
    values: &[f32],
    lights: &[Light],
    truth: &[Vec<DVec3>],
) -> Result<f64> {
    let points = sampled.probes(points.to_vec());
    let parallel = lights.iter().zip(truth).filter(|(light, _)| light.kind() == LightKind::Directional);
    let [error] =
        worst(parallel, |(light, truth)| Ok([points.error(&interpolated(set, values, light)?, &points.of(truth))]))?;
    Ok(error.rms)
}

/// Enters the error of each stage under lights that no choice saw.
fn measure(
    sampled: &SampledScene,
    transfer: &ManyLights,
    (set, net, values, file): (&LightSet, &Net, &[f32], &File),
    unseen: &[Light],
    ledger: &mut Ledger,
    progress: &dyn Progress,
) -> Result<()> {
    let parallel = set.lights.shells.inverse().len() == 1;
    let served = of_kinds(unseen, if parallel { distant::KINDS } else { &LightKind::ALL });
    let transport = transport(file, sampled.scene, &sampled.receivers, set)?;
    let points = sampled.probes(net.point.clone());
    progress.start("errors", served.len() as u64);
    let errors = worst(&served, |light| {
        progress.advance(1);
        let truth = transfer.under(&sampled.by_rays(light)?);
        let between = interpolated(set, values, light)?;
        let lit = set.lit(&transport, std::slice::from_ref(light))?;
        let coded = in_order_of_rows(net, &transport.at_references(&lit));
        Ok([
            points.error(&between, &points.of(&truth)),
            spatial_error(sampled, net, file.spacing_mm, std::slice::from_ref(&truth)),
            points.error(&coded, &between),
        ])
    })?;
    progress.finish();
    let count = set.lights.directions.count();
    ledger.add(
        "lights",
        errors[0],
        format!("interpolation between {count} directions, under lights that no choice saw"),
    );
    ledger.add("reference points", errors[1], format!("interpolation from {} of them, as above", net.point.len()));
    ledger.add("coding", errors[2], "basis of the lights and quantiser, as above");
    Ok(())
}
