//! The verdict on an asset: its error from end to end, at places and under lights that the choice did not see.

use std::time::Instant;

use super::candidates::Candidate;
use super::lights::{Purpose, lights};
use super::record::Attempt;
use super::request::Request;
use super::truth::{Places, TrueSums, Truth};
use crate::asset::Asset;
use crate::error::Result;
use crate::evaluate::{Evaluator, Model};
use crate::forms::gathered::model::sections_of;
use crate::light::{Light, LightKind};
use crate::math::statistics::VertexError;
use crate::measure::exact_sums::true_samples;
use crate::progress::{Progress, Silent};
use crate::report::sizes::Sizes;
use crate::report::text::{megabytes, percent, significant};
use crate::scene::Scene;

/// Places at which an asset is judged.
const PLACES: usize = 256;

/// Directions beside the four odd ones: as many as fit into a quarter of the bake or this time, whichever is longer, on the nominal
/// machine.
const DIRECTIONS: std::ops::RangeInclusive<usize> = 4..=60;
const LEAST_S: f64 = 0.7;
const SHARE_OF_BAKE: f64 = 0.15;

/// Seconds that the truth under one direction takes there, about: more where light moves.
const TRUTH_S: f64 = 0.05;
const TRUTH_MOVED_S: f64 = 0.2;

/// Runs of which the fastest counts, where times are asked for.
const RUNS: usize = 3;

/// Truth that assets of a scene are judged by.
pub(super) struct Verdict {
    scene: Scene,
    truth: Truth,
    /// Samples of the assets that it is fine enough for.
    judges: usize,
}

impl Verdict {
    /// `sums` are those of the choice, and of the verdict from now on; `between` tells whether vertices alone say nothing.
    pub(super) fn new(
        sums: &mut TrueSums,
        (scene, request, between): (&Scene, &Request, bool),
        candidate: &Candidate,
        asset: &Asset,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let forecast = &candidate.forecast;
        let directional = forecast.relight_ms.iter().find(|(kind, _)| *kind == LightKind::Directional);
        let truth_s = if request.model == Model::Dipole { TRUTH_S } else { TRUTH_MOVED_S };
        let each = directional.map_or(0.0, |(_, ms)| 1e-3 * ms) + truth_s;
        let affordable = (SHARE_OF_BAKE * forecast.bake_s).max(LEAST_S) / each;
        let directions = (affordable as usize).clamp(*DIRECTIONS.start(), *DIRECTIONS.end());
        let lights = lights(scene, &request.for_lights, Purpose::Verdict { directions })?;
        let judges = forecast.erring_samples().unwrap_or(0);
        let kernels = sections_of(asset);
        if !sums.judge(request.max_rms, judges, &kernels) {
            let samples = true_samples(scene, request.max_rms, judges);
            *sums = TrueSums::new(scene, (samples, request.max_rms), (kernels, None));
        }
        let places = if between { Places::between(scene, PLACES, 1) } else { Places::new(scene, PLACES, 1) };
        let truth = Truth::new(sums, (lights, places), progress)?;
        Ok(Self { scene: scene.clone(), truth, judges })
    }

    /// Returns whether the truth is fine enough for a candidate.
    pub(super) fn suits(&self, candidate: &Candidate) -> bool {
        candidate.forecast.erring_samples().unwrap_or(0) <= self.judges
    }

    /// The error of the asset of an evaluator, what it misses of the request apart from times, and, where times are asked for, the milliseconds to
    /// new radiosity under the slowest kind of light.
    pub(super) fn judge(
        &self,
        mut evaluator: Box<dyn Evaluator>,
        (candidate, sizes): (&Candidate, &Sizes),
        request: &Request,
        progress: &dyn Progress,
    ) -> Result<(Attempt, Option<f64>)> {
        let (mut worst, mut worst_light, mut largest) = (VertexError::default(), String::new(), -1.0);
        let samples = candidate.forecast.erring_samples().unwrap_or(0);
        progress.start("verdict", self.truth.lights.len() as u64);
        for (index, light) in self.truth.lights.iter().enumerate() {
            evaluator.set_lights(vec![light.clone()], &Silent)?;
            let values = self.truth.places.exitance(evaluator.as_mut())?;
            let error = self.truth.error(index, &values, (&self.scene, samples));
            if error.rms > largest {
                (largest, worst_light) = (error.rms, name(light));
            }
            worst = worst.max(error);
            progress.advance(1);
        }
        progress.finish();
        let relight_ms = match request.max_relight_ms {
            Some(_) => Some(self.slowest_ms(evaluator.as_mut(), request)?),
            None => None,
        };
        let own = sizes.stored_without_mesh + sizes.stored_environment;
        let attempt = Attempt {
            considered: candidate.entry,
            bytes: sizes.file,
            bytes_per_vertex: own as f64 / candidate.vertices.max(1) as f64,
            error: worst,
            worst_light,
            lights: self.truth.lights.len(),
            vertices: self.truth.places.vertices.len(),
            between: self.truth.places.len() - self.truth.places.vertices.len(),
            misses: Vec::new(),
        };
        let misses = misses(request, &attempt);
        Ok((Attempt { misses, ..attempt }, relight_ms))
    }

    /// Wall-clock time of a new light of the slowest kind, ms.
    fn slowest_ms(&self, evaluator: &mut dyn Evaluator, request: &Request) -> Result<f64> {
        let mut slowest: f64 = 0.0;
        for kind in &request.for_lights {
            let Some(light) = self.truth.lights.iter().find(|light| light.kind() == *kind) else { continue };
            let mut fastest = f64::INFINITY;
            for _ in 0..RUNS {
                let started = Instant::now();
                evaluator.set_lights(vec![light.clone()], &Silent)?;
                evaluator.radiosity(&Silent)?;
                fastest = fastest.min(1e3 * started.elapsed().as_secs_f64());
            }
            slowest = slowest.max(fastest);
        }
        Ok(slowest)
    }
}

/// What an asset misses of a request, times apart.
pub(super) fn misses(request: &Request, attempt: &Attempt) -> Vec<String> {
    let mut misses = Vec::new();
    let Attempt { error, bytes, bytes_per_vertex, worst_light, .. } = attempt;
    if error.rms > request.max_rms {
        let [found, most] = [error.rms, request.max_rms].map(percent);
        misses.push(format!("{found} RMS under {worst_light}, more than {most}"));
    }
    if let Some(most) = request.max_dark.filter(|most| error.dark > *most) {
        misses.push(format!("{} in the dark part, more than {}", percent(error.dark), percent(most)));
    }
    if let Some(most) = request.max_bytes_per_vertex.filter(|most| bytes_per_vertex > most) {
        let [found, most] = [*bytes_per_vertex, most].map(significant);
        misses.push(format!("{found} bytes/vertex, more than {most}"));
    }
    if let Some(most) = request.max_bytes.filter(|most| bytes > most) {
        misses.push(format!("a file of {}, more than {}", megabytes(*bytes), megabytes(most)));
    }
    misses
}

/// A light as it would be typed; the built-in environment has no file.
fn name(light: &Light) -> String {
    match light {
        Light::Environment { rotate_degrees, .. } => format!("a sky with a sun, rotate={rotate_degrees}"),
        _ => light.to_string(),
    }
}
