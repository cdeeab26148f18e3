//! The report of what was handed on to engines.

use std::path::PathBuf;

use serde::Serialize;

use crate::evaluate::Cost;
use crate::export::harmonics::Flattening;
use crate::import::file::Input;
use crate::render::frame::ExitanceAt;

/// What was written for engines.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct ExportReport {
    pub(crate) method: String,
    /// What was written: `vertex-colors`, `lightmap`, `sh1` or `sh2`.
    #[serde(rename = "as")]
    pub(crate) kind: String,
    /// Media of the asset.
    pub(crate) materials: Vec<String>,
    /// Lights that colours are of; with harmonics, those under which the error was measured.
    pub(crate) lights: Vec<String>,
    /// Files of the lights, and the file that attributes were added to.
    pub(crate) inputs: Vec<Input>,
    #[serde(serialize_with = "super::paths")]
    #[cfg_attr(test, schemars(with = "Vec<String>"))]
    pub(crate) outputs: Vec<PathBuf>,
    /// Source vertices of the asset.
    pub(crate) vertices: usize,
    /// Names of the attributes that were added.
    pub(crate) attributes: Vec<String>,
    /// Bytes of the GLB; none where none was written.
    pub(crate) glb_bytes: Option<usize>,
    /// Millimetres of the asset in a metre of the file: 1000 where it has its true size.
    pub(crate) mm_per_metre: f64,
    /// How colours were exposed; none with harmonics.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) exposure: Option<ExposureReport>,
    /// The light map, where there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) lightmap: Option<LightmapReport>,
    /// Error of harmonics against the asset under the lights.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) flattening: Option<Flattening>,
    pub(crate) cost: Cost,
}

/// How radiosity became colours.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct ExposureReport {
    /// As it was asked for: `auto` or stops.
    pub(crate) asked: String,
    /// Colours are radiosity times this, at most 1.
    pub(crate) factor: f64,
    /// Share of the area where a channel was cut at 1.
    pub(crate) clamped_share: f64,
}

/// A light map that was written.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct LightmapReport {
    /// Texels of a side.
    pub(crate) resolution: u32,
    /// Whether it lies on the texture coordinates of the mesh as they are.
    pub(crate) own_coordinates: bool,
    /// Number of charts.
    pub(crate) charts: u32,
    /// Share of the texels that show the surface.
    pub(crate) coverage: f64,
    /// Share of the mapped area that is covered again.
    pub(crate) overlap: f64,
    /// Where exitance was evaluated: at the vertices, or at what each texel shows (`pixels`).
    pub(crate) exitance: ExitanceAt,
}
