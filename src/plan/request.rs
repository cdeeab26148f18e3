//! What is asked of an asset.

use std::collections::BTreeSet;

use serde::Serialize;

use crate::evaluate::{MaterialEdit, Model};
use crate::light::LightKind;
use crate::math::statistics::VertexError;

/// Largest relative RMS error unless another one is asked for.
pub const DEFAULT_MAX_RMS: f64 = 0.01;

/// Share of the error of the model that transport may have where nobody asked for less, and the most. Errors that are independent add as
/// squares do: a third beside one makes 5 % more of both.
const OF_THE_MODEL: f64 = 1.0 / 3.0;
const MOST_OF_THE_MODEL: f64 = 0.05;

/// What stands for it where nothing reaches it and nobody asked for it.
pub(super) const RELAXED: [f64; 3] = [0.02, 0.05, 0.1];

/// A new light may take this long where nothing is said about it, ms.
const PATIENCE_RELIGHT_MS: f64 = 1000.0;

/// A bake may take this long where nothing is said about it, s.
const PATIENCE_BAKE_S: f64 = 600.0;

/// Edits of the material that an asset must allow.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Edits {
    /// None: the material may be baked in.
    #[default]
    None,
    /// Absorption alone. Forms that allow any edit allow this one; none allows it alone.
    Absorption,
    /// Every optical property.
    Any,
}

impl Edits {
    /// Returns whether a form allows these edits.
    pub fn allowed_by(self, edit: MaterialEdit) -> bool {
        self == Self::None || edit == MaterialEdit::Any
    }

    /// The word on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Absorption => "absorption",
            Self::Any => "any",
        }
    }
}

/// What is asked of an asset: limits that it must keep. What is not named is free.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Request {
    /// Largest relative RMS error of transport under any light of the kinds asked for.
    pub max_rms: f64,
    /// Whether a larger error will do where nothing reaches this one, because nobody named it.
    pub max_rms_may_grow: bool,
    /// Largest error of the dark part (vertices below a tenth of the mean, relative to their own mean).
    pub max_dark: Option<f64>,
    /// Kinds of light that the asset must serve.
    pub for_lights: BTreeSet<LightKind>,
    /// Edits of the material that it must allow.
    pub edit: Edits,
    /// Largest number of bytes for each vertex, the mesh apart.
    pub max_bytes_per_vertex: Option<f64>,
    /// Largest size of the file, bytes.
    pub max_bytes: Option<u64>,
    /// Largest time to new radiosity after a change of the light, ms.
    pub max_relight_ms: Option<f64>,
    /// Longest bake, planning included, s.
    pub max_bake_s: Option<f64>,
    /// Whether the file holds samples that could be made again from the mesh.
    pub samples_stored: bool,
    /// Model of the light inside.
    #[serde(skip)]
    pub model: Model,
}

/// Error of transport where nobody names one, beside an error of the model.
pub(super) fn unasked(model: Option<VertexError>) -> f64 {
    model.map_or(0.0, |error| (OF_THE_MODEL * error.rms).min(MOST_OF_THE_MODEL)).max(DEFAULT_MAX_RMS)
}

impl Request {
    /// A request for an error under some kinds of light, everything else free.
    pub fn new(max_rms: f64, for_lights: BTreeSet<LightKind>) -> Self {
        Self {
            max_rms,
            max_rms_may_grow: false,
            max_dark: None,
            for_lights,
            edit: Edits::None,
            max_bytes_per_vertex: None,
            max_bytes: None,
            max_relight_ms: None,
            max_bake_s: None,
            samples_stored: false,
            model: Model::Dipole,
        }
    }

    /// The request of a model with an error: where nobody named an error of transport, a share of that of the model will do.
    pub(super) fn beside(&self, model: Option<VertexError>) -> Self {
        let base = unasked(model);
        Self { max_rms: if self.max_rms_may_grow { self.max_rms.max(base) } else { self.max_rms }, ..self.clone() }
    }

    /// Time of a new light that a choice may take, ms: the asked one, or what a person waits.
    pub(super) fn relight_ms(&self) -> f64 {
        self.max_relight_ms.unwrap_or(PATIENCE_RELIGHT_MS)
    }

    /// Time of a bake that a choice may take, s.
    pub(super) fn bake_s(&self) -> f64 {
        self.max_bake_s.unwrap_or(PATIENCE_BAKE_S)
    }

    /// The next larger error that will do as well, if any.
    pub(super) fn relaxed(&self, least: f64) -> Option<f64> {
        let larger = RELAXED.into_iter().find(|error| *error > self.max_rms && *error >= least);
        larger.filter(|_| self.max_rms_may_grow)
    }

    /// Names of the kinds of light.
    pub(super) fn kinds(&self) -> String {
        let all = LightKind::STORABLE.iter().all(|kind| self.for_lights.contains(kind));
        let names: Vec<&str> = self.for_lights.iter().map(|kind| kind.name()).collect();
        if all { "all kinds of light".to_owned() } else { format!("light of the kinds {}", names.join(", ")) }
    }
}
