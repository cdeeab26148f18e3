//! One method at one size: prediction and estimate, the bake, the time of a new light; stored by key.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use serde::{Deserialize, Serialize};

use crate::asset::Asset;
use crate::commands::chart::child::{self, Bake, BakeCost, Outcome};
use crate::commands::chart::timing::Repetitions;
use crate::commands::console::Console;
use crate::error::{Error, Result};
use crate::evaluate::Method;
use crate::geometry::source::SourceModel;
use crate::light::Light;
use crate::math::statistics::Quantiles;
use crate::measure::growth::fit::predict;
use crate::measure::growth::{Axis, Costs, Limits, Missing, Point, Quantity, Skipped, pairs};
use crate::progress::Silent;
use crate::report::sizes::sizes;
use crate::report::text::{duration, megabytes};
use crate::scene::Scene;

/// One size on one axis.
pub(super) struct Place {
    pub(super) axis: Axis,
    /// Size as asked for.
    pub(super) size: f64,
    pub(super) vertices: usize,
    pub(super) samples: Option<usize>,
    pub(super) size_mm: f64,
}

/// The surface with some number of vertices.
pub(super) struct Shape {
    /// Number of vertices as asked for.
    pub(super) asked: usize,
    pub(super) vertices: usize,
    pub(super) path: PathBuf,
    /// BLAKE3 hash of the file.
    pub(super) hash: String,
    pub(super) model: SourceModel,
}

/// Material, light and limits of every point.
pub(super) struct Measurer<'a> {
    pub(super) material_text: &'a str,
    /// Shortest mean free path of the channels, mm.
    pub(super) free_path_mm: f64,
    pub(super) light: &'a Light,
    pub(super) light_text: &'a str,
    /// Machine and inputs on which times depend beside the command and the light.
    pub(super) context: String,
    pub(super) limits: Limits,
    pub(super) repetitions: Repetitions,
    pub(super) work: &'a Path,
    pub(super) console: &'a Console,
}

/// Costs of a point that are stored for later runs.
#[derive(Serialize, Deserialize)]
struct Kept {
    costs: Option<Costs>,
    skipped: Option<Skipped>,
}

impl Measurer<'_> {
    /// Measures a point; predictions are made from the points `before`.
    pub(super) fn point(
        &self,
        place: &Place,
        shape: &Shape,
        scene: &Scene,
        method: &'static dyn Method,
        before: &[Point],
    ) -> Result<Point> {
        let words = self.words(place, shape, method);
        let command = format!("translux {}", words.join(" "));
        let mut point = Point {
            axis: place.axis,
            method: method.name().to_owned(),
            size: match place.axis {
                Axis::Vertices => shape.vertices as f64,
                Axis::Samples | Axis::Ratio => place.size,
            },
            vertices: shape.vertices,
            size_mm: place.size_mm,
            size_over_mean_free_path: place.size_mm / self.free_path_mm,
            command: command.clone(),
            costs: None,
            skipped: None,
        };
        let key = |more: &[&str]| {
            let mut hasher = blake3::Hasher::new();
            for text in [env!("CARGO_PKG_VERSION"), &command, &shape.hash, &self.context].iter().chain(more) {
                hasher.update(text.as_bytes()).update(b"\0");
            }
            hasher.finalize().to_hex()[..16].to_owned()
        };
        let bake_key = key(&[]);
        let limit = self.limits.seconds.to_string();
        let path = self.work.join(format!("{}.point.json", key(&["point", self.light_text, &limit])));
        let kept = match child::stored::<Kept>(&path) {
            Some(kept) => kept,
            None => {
                let kept = self.measure(&point, place, scene, method, (&words, &bake_key), before)?;
                // What was not started costs nothing to decide again, and other points may decide it otherwise.
                let was_ended = |s: &Skipped| s.what == Missing::Bake && s.reason.starts_with(ENDED);
                if kept.skipped.as_ref().is_none_or(was_ended) {
                    child::store(&path, &kept)?;
                }
                kept
            }
        };
        if let (Axis::Samples, Some(costs)) = (place.axis, &kept.costs) {
            point.size = costs.samples as f64;
        }
        (point.costs, point.skipped) = (kept.costs, kept.skipped);
        Ok(point)
    }

    /// The command of the bake as it would be typed, without its output.
    fn words(&self, place: &Place, shape: &Shape, method: &'static dyn Method) -> Vec<String> {
        let model = shape.path.display().to_string();
        let size = place.size_mm.to_string();
        let mut words: Vec<String> =
            ["bake", &model, "--method", method.name(), "--material", self.material_text, "--size-mm", &size]
                .map(str::to_owned)
                .into();
        words.extend(place.samples.into_iter().flat_map(|n| ["--samples".to_owned(), n.to_string()]));
        words
    }

    fn measure(
        &self,
        point: &Point,
        place: &Place,
        scene: &Scene,
        method: &'static dyn Method,
        (words, key): (&[String], &str),
        before: &[Point],
    ) -> Result<Kept> {
        let without = |reason: String| Kept { costs: None, skipped: Some(Skipped { what: Missing::Bake, reason }) };
        let mut recipe = method.default_recipe()?;
        recipe.settings.samples = place.samples;
        if let Some(reason) = self.limits.too_large(recipe.bake_memory(scene), megabytes) {
            return Ok(without(reason));
        }
        let history = self.bake_history(point, before);
        // One bake alone says little of the next, which can be ended; a light cannot.
        let predicted = predict(&history, point.size, 0.0);
        if let Some(reason) = self.limits.too_long(predicted, duration) {
            return Ok(without(reason));
        }
        let bake = Bake { words, key, work: self.work, limits: Some(self.limits) };
        match child::bake(&bake)? {
            Outcome::Done(asset, bake) => self.costs(point, &asset, &bake, before),
            Outcome::Ended(after) => {
                let allowed = duration(self.limits.seconds);
                Ok(without(format!("{ENDED} after {}, {allowed} allowed", duration(after))))
            }
            Outcome::Failed(said) => {
                self.console.warn(&format!("{}: {said}", point.command));
                Ok(without(format!("failed: {said}")))
            }
        }
    }

    /// Sizes and times of this method's bakes on this axis; an ended bake took at least as long as it was allowed.
    fn bake_history(&self, point: &Point, before: &[Point]) -> Vec<(f64, f64)> {
        let same = before.iter().filter(|p| p.axis == point.axis && p.method == point.method);
        let ended = |p: &Point| p.skipped.as_ref().is_some_and(|s| s.reason.starts_with(ENDED));
        same.filter_map(|p| match Quantity::BakeSeconds.of(p) {
            Some(seconds) => Some((p.size, seconds)),
            None => ended(p).then(|| (p.size, self.limits.kill_seconds())),
        })
        .collect()
    }

    /// The time of a new light, s, predicted from the smaller sizes; for a method that sums over all pairs, from their
    /// number.
    fn predicted_relight(&self, point: &Point, samples: usize, before: &[Point]) -> Option<f64> {
        let same = before.iter().filter(|p| p.axis == point.axis && p.method == point.method);
        let by_pairs = pairs(&point.method, point.vertices, samples);
        let size = |p: &Point| match by_pairs {
            Some(_) => pairs(&p.method, p.vertices, p.costs.as_ref()?.samples),
            None => Some(p.size),
        };
        let history: Vec<(f64, f64)> =
            same.filter_map(|p| Some((size(p)?, 1e-3 * Quantity::RelightMs.of(p)?))).collect();
        predict(&history, by_pairs.unwrap_or(point.size), 1.0)
    }

    /// Opens an asset and times a new light.
    fn costs(&self, point: &Point, path: &Path, bake: &BakeCost, before: &[Point]) -> Result<Kept> {
        let sizes = sizes(&std::fs::read(path).map_err(|e| Error::io(path, &e))?)?;
        let started = Instant::now();
        let mut evaluator = self.console.registry.open(Arc::new(Asset::read(path)?))?;
        let open_ms = 1e3 * started.elapsed().as_secs_f64();
        let cost = evaluator.cost();
        let predicted = self.predicted_relight(point, cost.samples, before);
        let skipped =
            self.limits.too_long(predicted, duration).map(|reason| Skipped { what: Missing::Relight, reason });
        let relight = || {
            evaluator.set_lights(vec![self.light.clone()], &Silent)?;
            let radiosity = evaluator.radiosity(&Silent)?;
            match radiosity.iter().all(|b| b.is_finite()) {
                true => Ok(()),
                false => Err(Error::runtime(format!("{}: its radiosity is not finite", point.command))),
            }
        };
        let times = if skipped.is_none() { self.repetitions.times(relight)? } else { Vec::new() };
        let costs = Costs {
            samples: cost.samples,
            bake_seconds: bake.seconds(),
            bake_stages: bake.stages(),
            peak_memory_bytes: bake.peak_memory_bytes(),
            file_bytes: sizes.file,
            bytes: sizes.stored_without_mesh,
            environment_bytes: sizes.stored_environment,
            resident_bytes: cost.resident_bytes as u64,
            open_ms,
            relights: times.len(),
            relight_ms: (!times.is_empty()).then(|| Quantiles::of(times)),
        };
        Ok(Kept { costs: Some(costs), skipped })
    }
}

/// First word of the reason of an ended bake.
const ENDED: &str = "ended";
