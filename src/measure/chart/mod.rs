//! Speed against accuracy against size: the measurements of a method at one setting, and charts, tables and pages of
//! many such rows.

pub(in crate::measure) mod axis;
pub mod draw;
pub mod front;
pub mod page;
pub mod table;

use serde::{Deserialize, Serialize};

use crate::math::statistics::{Quantiles, VertexError};
use crate::transport::random_walk::model_error::ModelError;

/// Identifies the shape of the JSON.
pub const SCHEMA: &str = "translux.chart-file.v1";

/// The machine on which the rows were measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Machine {
    /// Name that the processor reports.
    pub processor: String,
    /// Threads that were used.
    pub threads: usize,
    /// Load average over the last minute when the measurement began; none where the system does not report it.
    pub load: Option<f64>,
}

/// The reference that all rows of one model and material are compared with.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Truth {
    /// Model, as it was named.
    pub model: String,
    /// Material.
    pub material: String,
    /// Samples of the reference.
    pub samples: usize,
    /// RMS of the reference's own error, the sum of its stages, worst light.
    pub own_rms: f64,
    /// The command that makes its asset.
    pub command: String,
    /// Difference between its model of the light inside and a random walk, for each light; empty where none can be
    /// walked.
    pub model_errors: Vec<ModelLine>,
    /// Reason why no random walk was possible.
    pub no_model_errors: Option<String>,
}

impl Truth {
    /// RMS of the model's own error under the worst light, and its standard error.
    pub fn model_rms(&self) -> Option<[f64; 2]> {
        self.model_errors.iter().map(|line| line.error.worst()).max_by(|a, b| a[0].total_cmp(&b[0]))
    }
}

/// The difference between dipole and random walk under one light.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct ModelLine {
    /// The light as it would be typed.
    pub light: String,
    /// Error of the reference against the walk.
    pub error: ModelError,
    /// Photons of each channel.
    pub photons: [u64; 3],
    /// The command that walks the same photons.
    pub command: String,
}

/// Errors under one light.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct LightError {
    /// The light as it would be typed.
    pub light: String,
    /// Error over the vertices.
    pub error: VertexError,
    /// RMS of the difference from what leaves the volume, worst channel, and its standard error; none where no random walk
    /// was possible.
    pub volume_rms: Option<[f64; 2]>,
    /// Share of the area with negative radiosity, in the channel where it is largest.
    pub negative_share: f64,
    /// Worst error of any view, for each figure.
    pub picture: PictureError,
    /// Time to new radiosity after a change of this light, ms.
    pub relight_ms: Quantiles,
}

/// Errors of one picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct PictureError {
    /// RMS over covered pixels.
    pub rms: f64,
    /// RMS over all pixels.
    pub rms_with_background: f64,
    /// Mean HDR-FLIP over all pixels.
    pub flip: f64,
}

impl PictureError {
    /// The larger of each figure.
    pub fn max(self, other: Self) -> Self {
        Self {
            rms: self.rms.max(other.rms),
            rms_with_background: self.rms_with_background.max(other.rms_with_background),
            flip: self.flip.max(other.flip),
        }
    }
}

/// A method at one setting, on one model of one material.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Row {
    /// Model, as it was named.
    pub model: String,
    /// Material.
    pub material: String,
    /// Method.
    pub method: String,
    /// Options that differ from the method's defaults, as they would be typed; empty for the defaults.
    pub setting: String,
    /// The command that bakes the asset.
    pub command: String,
    /// Vertices of the model.
    pub vertices: usize,
    /// Surface samples.
    pub samples: usize,
    /// Duration of the whole bake, s.
    pub bake_seconds: f64,
    /// Duration of each of its stages, s.
    pub bake_stages: Vec<(String, f64)>,
    /// Peak memory of the bake, bytes.
    pub peak_memory_bytes: u64,
    /// Size of the asset, bytes.
    pub file_bytes: u64,
    /// Bytes on disk for each vertex, without the mesh's and the environment's sections.
    pub bytes_per_vertex: f64,
    /// Bytes of the environment's sections on disk for each vertex.
    pub environment_bytes_per_vertex: f64,
    /// Bytes of the method's data in memory for each vertex.
    pub resident_bytes_per_vertex: f64,
    /// Time from the file to an evaluator, ms.
    pub open_ms: f64,
    /// Time to new radiosity after a change of light, ms, of the median light.
    pub relight_ms: Quantiles,
    /// Time to new radiosity after a change of material, ms; none where the material is baked in.
    pub edit_ms: Option<Quantiles>,
    /// Times on a graphics adapter.
    pub device: Option<DeviceRow>,
    /// Error over the vertices, worst light for each figure.
    pub error: VertexError,
    /// RMS of the difference from what leaves the volume, worst channel and light, and its standard error; none where no
    /// random walk was possible.
    pub volume_rms: Option<[f64; 2]>,
    /// Largest share of the area with negative radiosity under any light.
    pub negative_share: f64,
    /// Error of the pictures, worst light and view for each figure.
    pub picture: PictureError,
    /// Relative RMS error that the asset states.
    pub promised_rms: f64,
    /// Ledger of the asset: stage and RMS.
    pub ledger: Vec<(String, f64)>,
    /// Errors under each light.
    pub lights: Vec<LightError>,
    /// Lights that the method does not serve, as they would be typed; they are in no figure.
    #[serde(default)]
    pub unserved: Vec<String>,
}

/// Times on a graphics adapter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct DeviceRow {
    /// Name, kind and backend: software adapters say so.
    pub adapter: String,
    /// Time to new radiosity in the adapter's memory after a change of light, ms.
    pub relight_ms: Quantiles,
    /// Time to new radiosity after a change of material, ms.
    pub edit_ms: Option<Quantiles>,
}

/// The whole measurement.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Chart {
    /// Always [`SCHEMA`].
    pub schema: String,
    /// Version of the program.
    pub version: String,
    /// The machine on which the rows were measured.
    pub machine: Machine,
    /// References, one for each model and material.
    pub truths: Vec<Truth>,
    /// Rows in the order of models, materials, methods and their ladders.
    pub rows: Vec<Row>,
}
