//! What a plan considered, measured, chose and left out, and why: for `--report`, for JSON, and as sentences for the asset.

use serde::Serialize;

use super::request::{DEFAULT_MAX_RMS, Request, unasked};
use crate::evaluate::forecast::Body;
use crate::evaluate::form::Model;
use crate::evaluate::{Forecast, Recipe};
use crate::math::statistics::VertexError;
use crate::report::text::{megabytes, percent, significant};
use crate::scene::Scene;

/// Identifies the shape of the JSON.
pub const SCHEMA: &str = "translux.plan.v1";

/// Why a candidate was not chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Left {
    /// It cannot serve the lights, the edits or the model asked for.
    Unfit,
    /// Its bake takes more memory than allowed.
    Memory,
    /// Its file is expected to be too large.
    Size,
    /// A new light is expected to take too long.
    Relight,
    /// Its bake is expected to take too long.
    Bake,
    /// Its error is expected to be too large.
    Error,
    /// It was baked and missed the request.
    Missed,
    /// Another one was cheaper.
    Costlier,
}

/// A way to bake that was considered.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Considered {
    /// Method and keys.
    pub family: String,
    /// Method.
    pub method: String,
    /// Surface samples; none where the method chooses.
    pub samples: Option<usize>,
    /// Whether environments, although asked for, are left to rays at run time.
    pub by_rays: bool,
    /// Relative error that the bake is asked for; none for a family that is left out as a whole.
    pub max_rms: Option<f64>,
    /// What it is expected to be; none for a family that is left out as a whole.
    pub expected: Option<Expected>,
    /// Reason for not choosing it; none for what was chosen.
    pub left: Option<Left>,
    /// The reason in words.
    pub why: String,
}

/// What an asset is expected to be before it is baked. Times are those of the nominal machine of the cost model.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Expected {
    /// Size of the file, bytes.
    pub bytes: u64,
    /// Bytes for each vertex, the mesh apart.
    pub bytes_per_vertex: f64,
    /// Seconds of the bake.
    pub bake_s: f64,
    /// Time of a new light of the slowest kind asked for, ms.
    pub relight_ms: f64,
    /// Relative RMS error, samples included; none where no measurement was needed.
    pub rms: Option<f64>,
}

impl Considered {
    pub(super) fn new(
        recipe: &Recipe,
        family: &str,
        forecast: &Forecast,
        mesh_bytes: u64,
        request: &Request,
        scene: &Scene,
    ) -> Self {
        let vertices = scene.mesh.local_mm.len().max(1) as f64;
        Self {
            family: family.to_owned(),
            method: recipe.method.to_owned(),
            samples: recipe.settings.samples,
            by_rays: !request.for_lights.is_subset(&recipe.settings.for_lights),
            max_rms: Some(recipe.settings.max_rms),
            expected: Some(Expected {
                bytes: mesh_bytes + forecast.bytes as u64,
                bytes_per_vertex: forecast.bytes / vertices,
                bake_s: forecast.bake_s,
                relight_ms: forecast.slowest_relight_ms(&request.for_lights),
                rms: None,
            }),
            left: Some(Left::Costlier),
            why: "costs more than what was chosen".to_owned(),
        }
    }

    pub(super) fn dropped(method: &str, family: &str, why: String) -> Self {
        Self {
            family: family.to_owned(),
            method: method.to_owned(),
            samples: None,
            by_rays: false,
            max_rms: None,
            expected: None,
            left: Some(Left::Unfit),
            why,
        }
    }

    /// Method, keys and samples.
    pub(super) fn name(&self) -> String {
        match self.samples {
            Some(samples) => format!("{} with {samples} samples", self.family),
            None => self.family.clone(),
        }
    }
}

/// An asset that was baked and measured from end to end.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Attempt {
    /// Index among the considered ones.
    pub considered: usize,
    /// Size of the file, bytes.
    pub bytes: u64,
    /// Bytes for each vertex, the mesh apart.
    pub bytes_per_vertex: f64,
    /// Error of radiosity against the brute-force truth, the worst light for each figure.
    pub error: VertexError,
    /// The light with the largest RMS, as it would be typed.
    pub worst_light: String,
    /// Number of lights that no choice saw.
    pub lights: usize,
    /// Number of vertices at which it was measured; where there are enough, no choice saw them.
    pub vertices: usize,
    /// Number of further points between vertices, where these alone say nothing of the surface.
    pub between: usize,
    /// What it misses of the request, in words; empty where it meets it.
    pub misses: Vec<String>,
}

/// Wall-clock times of this run. Nothing else in a plan depends on them, but for what `--max-relight-ms` and `--max-bake-s` are judged by.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Timings {
    /// Measurements for the choice.
    pub choice_s: f64,
    /// Bakes.
    pub bake_s: f64,
    /// Measurements of what was baked.
    pub verdict_s: f64,
    /// A new light of the slowest kind asked for with the last asset that was baked, the best of several; none without an asset.
    pub relight_ms: Option<f64>,
    /// The whole bake.
    pub total_s: f64,
    /// What is missed of the times asked for, in words.
    pub misses: Vec<String>,
}

/// A plan and what came of it.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Plan {
    /// Always [`SCHEMA`].
    pub schema: &'static str,
    /// Version of the program.
    pub version: &'static str,
    /// What was asked for.
    pub request: Request,
    /// The model of the light inside.
    pub model: &'static str,
    /// Its error against walks through the volume, where it is calibrated and no part lets light out: what a default request follows.
    pub model_error: Option<VertexError>,
    /// Numbers that costs follow from.
    pub body: Body,
    /// Every way to bake that was considered.
    pub considered: Vec<Considered>,
    /// Error of sampling that was measured for the choice, by the number of samples.
    pub sampling: Vec<(usize, VertexError)>,
    /// What was baked, in order.
    pub attempts: Vec<Attempt>,
    /// The attempt whose asset was kept: the one that meets the request, else the nearest.
    pub kept: Option<usize>,
    /// What the scene does not need and was left out, in sentences.
    pub dropped: Vec<String>,
    /// What is missed of the request, in words; empty where the asset meets it.
    pub misses: Vec<String>,
    /// What would meet the request, or which request could be met; none where it is met.
    pub would_meet: Option<String>,
    /// Wall-clock times.
    pub timings: Timings,
}

impl Plan {
    pub(super) fn new(
        request: &Request,
        (body, model_error): (Body, Option<VertexError>),
        considered: Vec<Considered>,
    ) -> Self {
        Self {
            schema: SCHEMA,
            version: env!("CARGO_PKG_VERSION"),
            request: request.clone(),
            model: match request.model {
                Model::Dipole => "dipole",
                Model::Calibrated(_) => "calibrated",
            },
            model_error,
            body,
            considered,
            sampling: Vec::new(),
            attempts: Vec::new(),
            kept: None,
            dropped: Vec::new(),
            misses: Vec::new(),
            would_meet: None,
            timings: Timings::default(),
        }
    }

    /// Returns whether the request is met.
    pub fn is_met(&self) -> bool {
        self.misses.is_empty() && self.timings.misses.is_empty() && self.kept.is_some()
    }

    /// The error that stands for one that nobody named, where nothing reached it and a larger one had to do.
    pub fn relaxed(&self) -> Option<f64> {
        let base = unasked(self.model_error);
        (self.request.max_rms_may_grow && self.request.max_rms > base).then_some(base)
    }

    /// The plan in sentences, one a line: what was asked, chosen, measured, considered and left out. Without times of this run.
    pub fn sentences(&self) -> Vec<String> {
        let mut lines = self.summary();
        let others = self.attempts.iter().enumerate().filter(|(index, _)| Some(*index) != self.kept);
        lines.extend(others.filter_map(|(_, attempt)| {
            let name = self.considered.get(attempt.considered)?.name();
            Some(format!("baked as well: {name}: {}", attempt.misses.join("; ")))
        }));
        lines.extend(self.families());
        lines.extend(self.dropped.iter().map(|what| format!("left out: {what}")));
        if !self.misses.is_empty() {
            lines.push(format!("missed: {}", self.misses.join("; ")));
        }
        lines.extend(self.would_meet.iter().map(|what| format!("what would meet it: {what}")));
        lines
    }

    /// The first of these sentences: what was asked, chosen and measured.
    pub fn summary(&self) -> Vec<String> {
        let mut lines = vec![self.asked()];
        let kept = self.kept.and_then(|index| self.attempts.get(index));
        if let Some((last, chosen)) = kept.and_then(|kept| Some((kept, self.considered.get(kept.considered)?))) {
            lines.push(format!("chosen: {}, {}", chosen.name(), self.reason(chosen)));
            lines.push(format!(
                "measured: {} RMS, worst vertex {}, dark part {}, against sums over all pairs at {} under {} lights that the \
                 choice did not see, the worst {}{}",
                percent(last.error.rms),
                percent(last.error.worst),
                percent(last.error.dark),
                match last.between {
                    0 => format!("{} vertices", last.vertices),
                    between => format!("{} points of the surface", last.vertices + between),
                },
                last.lights,
                last.worst_light,
                match &chosen.expected {
                    Some(Expected { rms: Some(rms), .. }) => format!("; {} was expected", percent(*rms)),
                    _ => String::new(),
                }
            ));
        }
        lines
    }

    fn asked(&self) -> String {
        let Request { max_rms, max_dark, edit, max_bytes_per_vertex, max_bytes, max_relight_ms, max_bake_s, .. } =
            &self.request;
        let limits = [
            max_dark.map(|dark| format!("{} in the dark part", percent(dark))),
            (*edit != super::request::Edits::None).then(|| format!("edits of the material: {}", edit.name())),
            max_bytes_per_vertex.map(|bytes| format!("at most {} bytes/vertex", significant(bytes))),
            max_bytes.map(|bytes| format!("a file of at most {}", megabytes(bytes))),
            max_relight_ms.map(|ms| format!("a new light in at most {} ms", significant(ms))),
            max_bake_s.map(|s| format!("a bake of at most {} s", significant(s))),
        ];
        let (error, kinds) = (percent(*max_rms), self.request.kinds());
        let base = unasked(self.model_error);
        let whose = match self.model_error.filter(|_| base > DEFAULT_MAX_RMS) {
            Some(model) => format!(", where the model's own error is {}", percent(model.rms)),
            None => String::new(),
        };
        let mut words = vec![match self.relaxed() {
            Some(_) => format!(
                "asked: no error, so at most {} RMS{whose}; nothing reaches that under {kinds}, {error} is what does",
                percent(base)
            ),
            None if !whose.is_empty() => format!("asked: no error, so at most {error} RMS{whose}, under {kinds}"),
            None => format!("asked: at most {error} RMS under {kinds}"),
        }];
        words.extend(limits.into_iter().flatten());
        words.join(", ")
    }

    fn reason(&self, chosen: &Considered) -> String {
        let Some(Expected { bytes, bytes_per_vertex, bake_s, relight_ms, .. }) = &chosen.expected else {
            return String::new();
        };
        format!(
            "expected at {} ({} bytes/vertex), a bake of {} s and {} ms for a new light: of all that meet the request and are at most a \
             quarter larger than the smallest, the one that a person waits least for",
            megabytes(*bytes),
            significant(*bytes_per_vertex),
            significant(*bake_s),
            significant(*relight_ms)
        )
    }

    /// A sentence for each family that was not chosen: its best candidate and why it was left.
    fn families(&self) -> Vec<String> {
        let kept = self.kept.and_then(|index| self.attempts.get(index));
        let chosen = kept.and_then(|kept| self.considered.get(kept.considered)).map(|chosen| chosen.family.as_str());
        let mut names: Vec<&str> = self.considered.iter().map(|c| c.family.as_str()).collect();
        names.dedup();
        let others = names.into_iter().filter(|name| Some(*name) != chosen);
        others
            .filter_map(|name| {
                // The one that came nearest: what was only costlier before what would miss something.
                let of_family = self.considered.iter().filter(|c| c.family == name);
                let best = of_family.min_by_key(|c| (c.left != Some(Left::Missed), c.left != Some(Left::Costlier)))?;
                let expected = best.expected.as_ref().map_or_else(String::new, |e| {
                    format!(" ({} and {} ms for a new light expected)", megabytes(e.bytes), significant(e.relight_ms))
                });
                Some(format!("not chosen: {}{expected}: {}", best.name(), best.why))
            })
            .collect()
    }
}
