//! Reports of radiosity under lights: of an asset, of another mesh of its object, and by a random walk.

use std::path::PathBuf;

use glam::DVec3;
use serde::Serialize;

use super::export::LightmapReport;
use super::trust::TrustReport;
use crate::compress::ledger::Ledger;
use crate::evaluate::Cost;
use crate::import::file::Input;
use crate::math::statistics::VertexError;
use crate::transport::random_walk::tally::Budget;

/// Radiosity that was written.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct RadiosityReport {
    pub(crate) lights: Vec<String>,
    pub(crate) inputs: Vec<Input>,
    #[serde(serialize_with = "super::paths")]
    #[cfg_attr(test, schemars(with = "Vec<String>"))]
    pub(crate) outputs: Vec<PathBuf>,
    pub(crate) vertices: usize,
    /// Vertices on no translucent surface, whose radiosity is 0.
    pub(crate) vertices_without_area: usize,
    pub(crate) mean_radiosity: [f64; 3],
    pub(crate) max_radiosity: [f64; 3],
}

impl RadiosityReport {
    /// Computes mean and maximum of the radiosity of the vertices.
    pub(crate) fn new(
        (lights, inputs): (Vec<String>, Vec<Input>),
        outputs: &[PathBuf],
        radiosity: &[DVec3],
        vertices_without_area: usize,
    ) -> Self {
        let (mean_radiosity, max_radiosity) = mean_and_max(radiosity);
        let (outputs, vertices) = (outputs.to_vec(), radiosity.len());
        Self { lights, inputs, outputs, vertices, vertices_without_area, mean_radiosity, max_radiosity }
    }
}

/// Mean and maximum of each channel.
pub(crate) fn mean_and_max(values: &[DVec3]) -> ([f64; 3], [f64; 3]) {
    let mean = values.iter().sum::<DVec3>() / values.len().max(1) as f64;
    (mean.to_array(), values.iter().fold(DVec3::ZERO, |a, &b| a.max(b)).to_array())
}

/// Report of an asset under lights.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct EvaluationReport {
    pub(crate) method: String,
    /// Model of the light inside: `dipole` or `calibrated`.
    pub(crate) model: String,
    #[serde(flatten)]
    pub(crate) radiosity: RadiosityReport,
    /// Mean of single scattering, which the radiosity does not include; none where the method has none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) mean_single_scattering: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) max_single_scattering: Option<[f64; 3]>,
    pub(crate) cost: Cost,
    /// Relative error that the bake aimed at.
    pub(crate) asked_rms: Option<f64>,
    /// Errors under these lights and others; empty where they were not asked for.
    pub(crate) measured: Ledger,
    /// The map of where the asset is wrong; left out where it was not asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) trust: Option<TrustReport>,
    /// The texture that radiosity was written to; left out where there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) texture: Option<LightmapReport>,
}

/// Report of an asset's object on another mesh.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct OnMeshReport {
    pub(crate) method: String,
    #[serde(flatten)]
    pub(crate) radiosity: RadiosityReport,
    /// Mean distance of the vertices from the asset's surface, weighted by area, mm.
    pub(crate) mean_distance_mm: f64,
    pub(crate) max_distance_mm: f64,
    /// Radiosity at the vertices themselves against that at the nearest points, which is written.
    pub(crate) at_vertices: VertexError,
    /// Radiosity interpolated at the centres of the triangles against that at the nearest points.
    pub(crate) between_vertices: VertexError,
    pub(crate) cost: Cost,
}

/// Report of a random walk.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct WalkReport {
    pub(crate) model: &'static str,
    #[serde(flatten)]
    pub(crate) radiosity: RadiosityReport,
    pub(crate) seed: u64,
    /// Photons of each channel.
    pub(crate) photons: [u64; 3],
    /// Flux of each channel by its fate.
    pub(crate) budget: [Budget; 3],
    /// RMS of the standard errors of the vertices over the RMS of the exitance, by channel.
    pub(crate) noise: [f64; 3],
    pub(crate) asked_noise: Option<f64>,
}
