//! Radiosity under lights: of an asset, of another mesh of its object, and by a random walk.

use std::path::PathBuf;

use glam::DVec3;
use serde::Serialize;

use crate::compress::ledger::Ledger;
use crate::evaluate::Cost;
use crate::import::file::Input;
use crate::math::statistics::VertexError;
use crate::transport::random_walk::tally::Budget;

/// Radiosity that was written.
#[derive(Clone, Debug, Serialize)]
pub struct RadiosityReport {
    /// Lights as they would be typed.
    pub lights: Vec<String>,
    /// Files that lights, and another mesh, were read from.
    pub inputs: Vec<Input>,
    /// Files that were written.
    #[serde(serialize_with = "super::paths")]
    pub outputs: Vec<PathBuf>,
    /// Number of values.
    pub vertices: usize,
    /// Vertices on no translucent surface, whose radiosity is 0.
    pub vertices_without_area: usize,
    /// Over the vertices, RGB.
    pub mean_radiosity: [f64; 3],
    /// Largest of each channel.
    pub max_radiosity: [f64; 3],
}

impl RadiosityReport {
    /// Computes mean and maximum of the radiosity of the vertices.
    pub fn new(
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

/// Mean and maximum of the channels.
pub fn mean_and_max(values: &[DVec3]) -> ([f64; 3], [f64; 3]) {
    let mean = values.iter().sum::<DVec3>() / values.len().max(1) as f64;
    (mean.to_array(), values.iter().fold(DVec3::ZERO, |a, &b| a.max(b)).to_array())
}

/// Figures of an asset under lights.
#[derive(Clone, Debug, Serialize)]
pub struct EvaluationReport {
    /// Method that baked it.
    pub method: String,
    /// The radiosity.
    #[serde(flatten)]
    pub radiosity: RadiosityReport,
    /// Beside the radiosity, where the method has it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mean_single_scattering: Option<[f64; 3]>,
    /// Largest of each channel.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_single_scattering: Option<[f64; 3]>,
    /// Of the evaluator.
    pub cost: Cost,
    /// Relative error that the bake was asked for.
    pub asked_rms: Option<f64>,
    /// Errors under these lights and others; empty where they were not asked for.
    pub measured: Ledger,
}

/// Figures of an asset's object on another mesh.
#[derive(Clone, Debug, Serialize)]
pub struct OnMeshReport {
    /// Method that baked the asset.
    pub method: String,
    /// The radiosity.
    #[serde(flatten)]
    pub radiosity: RadiosityReport,
    /// Distance of the vertices from the asset's surface, mean by area.
    pub mean_distance_mm: f64,
    /// The largest.
    pub max_distance_mm: f64,
    /// Radiosity at the vertices themselves against that of the nearest points, which is what is written.
    pub at_vertices: VertexError,
    /// Radiosity interpolated at the centres of the triangles against that of the nearest points.
    pub between_vertices: VertexError,
    /// Of the evaluator.
    pub cost: Cost,
}

/// Figures of a random walk.
#[derive(Clone, Debug, Serialize)]
pub struct WalkReport {
    /// Always `monte-carlo`.
    pub model: &'static str,
    /// The exitance of every order of scattering.
    #[serde(flatten)]
    pub radiosity: RadiosityReport,
    /// Seed of the photons.
    pub seed: u64,
    /// Photons of each channel.
    pub photons: [u64; 3],
    /// Where the flux of each channel went.
    pub budget: [Budget; 3],
    /// The result's own error: RMS of the standard errors of the vertices over the RMS of the exitance, by channel.
    pub noise: [f64; 3],
    /// The noise that was asked for.
    pub asked_noise: Option<f64>,
}
