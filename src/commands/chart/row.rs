//! One method at one setting: baked in a process of its own, opened, timed and compared.

use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;

use super::subject::{Baked, Subject};
use super::truth::Reference;
use crate::asset::Asset;
use crate::compress::ledger::TOGETHER;
use crate::error::{Error, Result};
use crate::evaluate::exitance::Exitance;
use crate::evaluate::measured::{Measured, Truth, measured};
use crate::evaluate::{Evaluator, Method};
use crate::light::Light;
use crate::math::statistics::{Quantiles, VertexError};
use crate::measure::chart::{LightError, PictureError, Row};
use crate::measure::flip::{self, Picture};
use crate::measure::image_error::image_error;
use crate::progress::Silent;
use crate::render::frame::{Frame, render};
use crate::report::chart::Shown;
use crate::report::sizes::sizes;
use crate::transport::random_walk::model_error::compare;

/// Measures one row.
pub(super) fn of(
    subject: &Subject,
    method: &'static dyn Method,
    rung: &str,
    truth: &Reference,
) -> Result<(Row, Shown)> {
    let Baked { path, command, cost } = subject.bake(method.name(), rung)?;
    let bytes = std::fs::read(&path).map_err(|e| Error::io(&path, &e))?;
    let sizes = sizes(&bytes)?;
    let started = Instant::now();
    let asset = Arc::new(Asset::read(&path)?);
    let ledger = asset.ledger.clone();
    let mut evaluator = subject.console.registry.open(Arc::clone(&asset))?;
    let open_ms = 1e3 * started.elapsed().as_secs_f64();
    let kinds = subject.console.registry.form(&asset)?.kinds();
    let mut lights = Vec::with_capacity(truth.lights.len());
    let mut shown = None;
    let served = |(_, light): &&(String, Light)| kinds.contains(&light.kind());
    let pairs = truth.lights.iter().zip(&truth.radiosity).enumerate();
    for (index, ((text, light), expected)) in pairs.filter(|(_, (light, _))| served(light)) {
        let times = subject.repetitions.times(|| {
            evaluator.set_lights(vec![light.clone()], &Silent)?;
            evaluator.radiosity(&Silent).map(drop)
        })?;
        let Measured { radiosity: values, error, .. } = measured(evaluator.as_mut(), Truth::Given(expected), &Silent)?;
        let (picture, of_light) = pictures(evaluator.as_ref(), &values, index, truth)?;
        shown = shown.or(of_light);
        let volume =
            truth.walks.get(index).map(|walk| compare(walk, &values).map(|error| error.worst())).transpose()?;
        lights.push(LightError {
            light: text.clone(),
            picture,
            error,
            volume_rms: volume,
            negative_share: negative_share(&values, &truth.areas),
            relight_ms: Quantiles::of(times),
        });
    }
    let edit_ms = subject.repetitions.edits(evaluator.as_mut(), |evaluator| evaluator.radiosity(&Silent).map(drop))?;
    let (own, unserved): (Vec<_>, Vec<_>) = truth.lights.iter().partition(served);
    let own: Vec<(String, Light)> = own.into_iter().cloned().collect();
    let device =
        subject.adapter.row(|| subject.console.registry.open(Arc::clone(&asset)), &own, subject.repetitions)?;
    let none = || Error::unsupported(format!("no light of the chart is one that {} serves", method.name()));
    let shown = shown.ok_or_else(none)?;
    let vertices = truth.areas.len();
    let per_vertex = |bytes: u64| bytes as f64 / vertices.max(1) as f64;
    let evaluation = evaluator.cost();
    let row = Row {
        model: subject.name(),
        material: subject.material.to_owned(),
        method: method.name().to_owned(),
        setting: rung.to_owned(),
        command,
        vertices,
        samples: evaluation.samples,
        bake_seconds: cost.seconds(),
        bake_stages: cost.stages(),
        peak_memory_bytes: cost.peak_memory_bytes(),
        file_bytes: bytes.len() as u64,
        bytes_per_vertex: per_vertex(sizes.stored_without_mesh),
        environment_bytes_per_vertex: per_vertex(sizes.stored_environment),
        resident_bytes_per_vertex: per_vertex(evaluation.resident_bytes as u64),
        open_ms,
        relight_ms: middle(&lights),
        edit_ms,
        device,
        error: lights.iter().fold(VertexError::default(), |worst, l| worst.max(l.error)),
        volume_rms: lights.iter().filter_map(|l| l.volume_rms).max_by(|a, b| a[0].total_cmp(&b[0])),
        negative_share: lights.iter().map(|l| l.negative_share).fold(0.0, f64::max),
        picture: lights.iter().fold(PictureError::default(), |worst, l| worst.max(l.picture)),
        promised_rms: ledger.total_rms(),
        ledger: ledger.entries.iter().filter(|e| e.stage != TOGETHER).map(|e| (e.stage.clone(), e.error.rms)).collect(),
        lights,
        unserved: unserved.into_iter().map(|(text, _)| text.clone()).collect(),
    };
    Ok((row, shown))
}

/// Relight time of the median light, by the lights' medians.
fn middle(lights: &[LightError]) -> Quantiles {
    let mut times: Vec<Quantiles> = lights.iter().map(|l| l.relight_ms).collect();
    times.sort_unstable_by(|a, b| a.median.total_cmp(&b.median));
    times.get(times.len() / 2).copied().unwrap_or_default()
}

/// Share of the area with negative radiosity, in the channel where it is largest.
fn negative_share(values: &[DVec3], areas: &[f64]) -> f64 {
    let total: f64 = areas.iter().sum();
    let of_channel = |channel: usize| {
        let negative = values.iter().zip(areas).filter(|(b, _)| b[channel] < 0.0);
        negative.map(|(_, area)| area).sum::<f64>() / total.max(f64::MIN_POSITIVE)
    };
    (0..3).map(of_channel).fold(0.0, f64::max)
}

/// Errors of the pictures under the `index`-th light, and the first view's picture.
fn pictures(
    evaluator: &dyn Evaluator,
    exitance: &dyn Exitance,
    index: usize,
    truth: &Reference,
) -> Result<(PictureError, Option<Shown>)> {
    let mut worst = PictureError::default();
    let mut shown = None;
    for (settings, frames) in &truth.views {
        let Some(expected) = frames.get(index) else { continue };
        let frame = render(evaluator, exitance, &[], settings, &Silent)?;
        let diffuse = |f: &Frame| f.pixels.iter().map(|p| p.diffuse).collect::<Vec<_>>();
        let (found, wanted) = (diffuse(&frame), diffuse(expected));
        let (width, height) = (frame.resolution.width, frame.resolution.height);
        let picture = |rgb| Picture { width, height, rgb };
        let flip = flip::hdr(&picture(&wanted), &picture(&found), &flip::Settings::default())?;
        let covered: Vec<bool> =
            frame.pixels.iter().zip(&expected.pixels).map(|(a, b)| a.coverage > 0.0 || b.coverage > 0.0).collect();
        let error = image_error(&found, &wanted, &covered);
        let of_view = PictureError { rms: error.rms, rms_with_background: error.rms_with_background, flip: flip.mean };
        worst = worst.max(of_view);
        shown.get_or_insert(Shown { frame, truth: expected.clone() });
    }
    Ok((worst, shown))
}
