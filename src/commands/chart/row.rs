//! One method at one setting: baked by a process of its own, opened, timed and compared.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;
use serde_json::Value;

use super::truth::Reference;
use super::{Extent, Subject};
use crate::asset::Asset;
use crate::commands::inspect;
use crate::error::{Error, ExitCode, Result};
use crate::evaluate::{Evaluator, MaterialEdit, Method};
use crate::io::atomic;
use crate::light::Light;
use crate::math::statistics::{Quantiles, VertexError, vertex_error};
use crate::measure::chart::{LightError, PictureError, Row};
use crate::measure::flip::{self, Picture};
use crate::measure::image_error::image_error;
use crate::medium::material::preset;
use crate::progress::Silent;
use crate::render::frame::{Frame, render};
use crate::transport::scene::Medium;

/// An asset, and what its bake said.
pub(super) struct Baked {
    pub(super) path: PathBuf,
    /// As it would be typed.
    pub(super) command: String,
    report: Value,
}

/// What the page shows of a row: its picture of the first view, with the error of each pixel.
pub(super) struct Shown {
    pub(super) frame: Frame,
    pub(super) truth: Frame,
}

/// The last part of a path.
pub(super) fn name(model: &Path) -> String {
    model.file_name().map_or_else(|| model.display().to_string(), |n| n.to_string_lossy().into_owned())
}

/// Bakes in another process, whose memory and time are its own; an asset and a report that are there already are taken.
pub(super) fn bake(subject: &Subject, method: &str, rung: &str) -> Result<Baked> {
    let model = subject.model.display().to_string();
    let mut words: Vec<String> =
        ["bake", &model, "--method", method, "--material", subject.material].map(str::to_owned).into();
    words.extend_from_slice(subject.placement);
    words.extend(rung.split_whitespace().map(str::to_owned));
    let command = format!("translux {}", words.join(" "));
    let bytes = std::fs::read(subject.model).map_err(|e| Error::io(subject.model, &e))?;
    let mut hasher = blake3::Hasher::new();
    hasher.update(env!("CARGO_PKG_VERSION").as_bytes()).update(command.as_bytes()).update(&bytes);
    let key = hasher.finalize().to_hex()[..16].to_owned();
    let file = |suffix: &str| subject.folder.join(format!("{key}.{suffix}"));
    let (path, report_path) = (file("tlux"), file("json"));
    let cached = std::fs::read(&report_path).ok().and_then(|text| serde_json::from_slice(&text).ok());
    if let Some(report) = cached.filter(|_| path.is_file()) {
        return Ok(Baked { path, command, report });
    }
    let program = std::env::current_exe().map_err(|e| Error::runtime(format!("where this program is: {e}")))?;
    let threads = rayon::current_num_threads().to_string();
    let output = std::process::Command::new(program)
        .args(&words)
        .args(["--json", "-q", "--threads", &threads, "-o"])
        .arg(&path)
        .output()
        .map_err(|e| Error::runtime(format!("{command}: {e}")))?;
    let failed = |what: &str| Error::runtime(format!("{command}: {what}"));
    if !output.status.success() {
        let said = String::from_utf8_lossy(&output.stderr).trim().trim_start_matches("translux: ").to_owned();
        let code = ExitCode::ALL.iter().find(|(code, _)| output.status.code() == Some(*code as i32));
        return Err(Error::new(code.map_or(ExitCode::Runtime, |(code, _)| *code), format!("{command}: {said}")));
    }
    let report: Value = serde_json::from_slice(&output.stdout).map_err(|e| failed(&e.to_string()))?;
    atomic::write(&report_path, &output.stdout)?;
    Ok(Baked { path, command, report })
}

/// Measures one row.
pub(super) fn of(
    subject: &Subject,
    method: &'static dyn Method,
    rung: &str,
    truth: &Reference,
) -> Result<(Row, Shown)> {
    let Baked { path, command, report } = bake(subject, method.name(), rung)?;
    let bytes = std::fs::read(&path).map_err(|e| Error::io(&path, &e))?;
    let sizes = inspect::sizes(&bytes)?;
    let started = Instant::now();
    let asset = Arc::new(Asset::read(&path)?);
    let ledger = asset.ledger.clone();
    let mut evaluator = subject.console.registry.open(Arc::clone(&asset))?;
    let open_ms = 1e3 * started.elapsed().as_secs_f64();
    let kinds = subject.console.registry.form(&asset)?.kinds();
    let mut lights = Vec::with_capacity(truth.lights.len());
    let mut shown = None;
    let served = |(_, light): &&(String, Light)| kinds.contains(&light.kind());
    for (index, ((text, light), expected)) in truth.lights.iter().zip(&truth.radiosity).enumerate() {
        if !kinds.contains(&light.kind()) {
            continue;
        }
        let mut times = Vec::with_capacity(subject.extent.repeats);
        let mut values = Vec::new();
        let begun = Instant::now();
        while times.is_empty()
            || times.len() < subject.extent.repeats && begun.elapsed().as_secs_f64() < subject.extent.patience
        {
            let started = Instant::now();
            evaluator.set_lights(vec![light.clone()], &Silent)?;
            values = evaluator.radiosity(&Silent)?;
            times.push(1e3 * started.elapsed().as_secs_f64());
        }
        let (picture, of_light) = pictures(evaluator.as_ref(), &values, index, truth)?;
        shown = shown.or(of_light);
        lights.push(LightError {
            light: text.clone(),
            picture,
            error: vertex_error(&values, expected, &truth.areas),
            negative_share: negative_share(&values, &truth.areas),
            relight_ms: Quantiles::of(times),
        });
    }
    let edit_ms = edits(evaluator.as_mut(), &subject.extent)?;
    let (own, unserved): (Vec<_>, Vec<_>) = truth.lights.iter().partition(served);
    let own: Vec<(String, Light)> = own.into_iter().cloned().collect();
    let device = subject.adapter.row(|| subject.console.registry.open(Arc::clone(&asset)), &own, &subject.extent)?;
    let none = || Error::unsupported(format!("no light of the chart is one that {} serves", method.name()));
    let shown = shown.ok_or_else(none)?;
    let vertices = truth.areas.len();
    let per_vertex = |bytes: u64| bytes as f64 / vertices.max(1) as f64;
    let number = |name: &str| report[name].as_f64().unwrap_or(f64::NAN);
    let stages = report["stages"].as_array().map_or(&[] as &[Value], Vec::as_slice);
    let stage = |s: &Value| Some((s["stage"].as_str()?.to_owned(), s["seconds"].as_f64()?));
    let cost = evaluator.cost();
    let row = Row {
        model: name(subject.model),
        material: subject.material.to_owned(),
        method: method.name().to_owned(),
        setting: rung.to_owned(),
        command,
        vertices,
        samples: cost.samples,
        bake_seconds: number("seconds"),
        bake_stages: stages.iter().filter_map(stage).collect(),
        peak_memory_bytes: report["peak_memory_bytes"].as_u64().unwrap_or(0),
        file_bytes: bytes.len() as u64,
        bytes_per_vertex: per_vertex(sizes.stored_without_mesh),
        environment_bytes_per_vertex: per_vertex(sizes.stored_environment),
        resident_bytes_per_vertex: per_vertex(cost.resident_bytes as u64),
        open_ms,
        relight_ms: middle(&lights),
        edit_ms,
        device,
        error: lights.iter().fold(VertexError::default(), |worst, l| worst.max(l.error)),
        negative_share: lights.iter().map(|l| l.negative_share).fold(0.0, f64::max),
        picture: lights.iter().fold(PictureError::default(), |worst, l| worst.max(l.picture)),
        promised_rms: ledger.total_rms(),
        ledger: ledger.entries.iter().map(|e| (e.stage.clone(), e.error.rms)).collect(),
        lights,
        unserved: unserved.into_iter().map(|(text, _)| text.clone()).collect(),
    };
    Ok((row, shown))
}

/// The light in the middle of all, by its median.
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

/// Times of a change between two materials of one index of refraction; the media are as before in the end.
fn edits(evaluator: &mut dyn Evaluator, extent: &Extent) -> Result<Option<Quantiles>> {
    if evaluator.capabilities().material == MaterialEdit::None {
        return Ok(None);
    }
    let before = evaluator.scene().media.clone();
    let other: Vec<Medium> = before.iter().map(edited).collect();
    let mut times = Vec::with_capacity(extent.repeats + 1);
    let begun = Instant::now();
    for (index, media) in [&other, &before].into_iter().cycle().take(2 * extent.repeats.div_ceil(2)).enumerate() {
        // The second of a pair puts the media back.
        if index >= 2 && index % 2 == 0 && begun.elapsed().as_secs_f64() > extent.patience {
            break;
        }
        let started = Instant::now();
        evaluator.set_media(media.clone())?;
        evaluator.radiosity(&Silent)?;
        times.push(1e3 * started.elapsed().as_secs_f64());
    }
    Ok(Some(Quantiles::of(times)))
}

/// Another material of the same index of refraction.
pub(super) fn edited(medium: &Medium) -> Medium {
    let mut other = medium.clone();
    if let Some(skin) = preset("skin1") {
        other.properties = skin.properties();
        other.properties.eta_inside_over_outside = medium.properties.eta_inside_over_outside;
    }
    other
}

/// Errors of the pictures under the `index`-th light, and that of the first view.
fn pictures(
    evaluator: &dyn Evaluator,
    radiosity: &[DVec3],
    index: usize,
    truth: &Reference,
) -> Result<(PictureError, Option<Shown>)> {
    let mut worst = PictureError::default();
    let mut shown = None;
    for (settings, frames) in &truth.views {
        let Some(expected) = frames.get(index) else { continue };
        let frame = render(evaluator, radiosity, &[], settings, &Silent)?;
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
