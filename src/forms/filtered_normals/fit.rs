//! Alpha and width of the filter, chosen by the error against exact sums, and that error.

use glam::DVec3;

use super::evaluate::{FilteredNormalsEvaluator, MediumFilter, local_lighting};
use super::light::Lit;
use crate::error::Result;
use crate::evaluate::Evaluator;
use crate::forms::baked_in::truth;
use crate::forms::gathered::GatheredEvaluator;
use crate::light::Light;
use crate::math::statistics::{VertexError, vertex_error};
use crate::progress::{Progress, Silent};

/// Vertices that the shape is fitted on.
const PROBES: usize = 768;

/// Lights of the fit.
const LIGHTS: usize = 4;

/// Samples of the exact sums at most.
const MOST_SAMPLES: usize = 1 << 14;

/// Values of alpha and of the width that are tried.
const ALPHAS: [f64; 7] = [0.0, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8];
const WIDTHS: [f64; 9] = [0.25, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0];

/// Fitted alpha and width, with their error.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fitted {
    pub(super) alpha: f64,
    pub(super) width: f64,
    /// RMS over the lights, relative.
    pub(super) error: f64,
}

impl FilteredNormalsEvaluator {
    /// Reference: samples, lit by rays.
    pub(super) fn truth(&mut self) -> &mut GatheredEvaluator {
        let samples = (self.numbers.samples as usize).min(MOST_SAMPLES);
        self.truth.get_or_insert_with(|| Box::new(truth(&self.scene, samples)))
    }

    /// Fits alpha and width for the least error under some of the lights; a value given in the settings stays.
    pub(super) fn fit(&mut self, lights: &[Light]) -> Result<Fitted> {
        let chosen: Vec<Light> = lights.iter().step_by(lights.len().div_ceil(LIGHTS).max(1)).cloned().collect();
        let (subset, indices) = self.points.receivers.subset(PROBES, 0);
        let dressed = self.dressed.only(&indices);
        let areas: Vec<f64> = indices.iter().map(|i| self.points.areas[*i as usize]).collect();
        let mut cases = Vec::new();
        for light in &chosen {
            let light = std::slice::from_ref(light);
            self.truth().set_lights(light.to_vec(), &Silent)?;
            let expected = self.truth().radiosity_at(&subset, &Silent)?;
            cases.push((expected, Lit::new(self.lookers(&dressed), self.bvh(), light)?));
        }
        let mut best = Fitted { alpha: self.numbers.alpha, width: self.numbers.width, error: f64::INFINITY };
        for alpha in self.form.alpha.map_or(ALPHAS.to_vec(), |alpha| vec![alpha]) {
            for width in self.form.width.map_or(WIDTHS.to_vec(), |width| vec![width]) {
                let filters: Vec<MediumFilter> =
                    self.scene.media.iter().map(|medium| self.filters.of(medium, (alpha, width))).collect();
                let square = |(expected, lit): &(Vec<DVec3>, Lit)| {
                    let found = local_lighting(&dressed, &filters, self.form.length, lit);
                    vertex_error(&found, expected, &areas).or_none().rms.powi(2)
                };
                let error = (cases.iter().map(square).sum::<f64>() / cases.len().max(1) as f64).sqrt();
                if error < best.error {
                    best = Fitted { alpha, width, error };
                }
            }
        }
        (self.numbers.alpha, self.numbers.width) = (best.alpha, best.width);
        self.refilter();
        Ok(best)
    }

    /// The error under the worst of some sets of lights, on so many vertices, or on all where there are not many more.
    pub(super) fn error_under(
        &mut self,
        sets: &[Vec<Light>],
        measured: usize,
        progress: &dyn Progress,
    ) -> Result<VertexError> {
        let (subset, indices) = if self.points.len() <= 2 * measured {
            (self.points.receivers.clone(), (0..self.points.len() as u32).collect())
        } else {
            self.points.receivers.subset(measured, 1)
        };
        let areas: Vec<f64> = indices.iter().map(|i| self.points.areas[*i as usize]).collect();
        let mut error = VertexError::default();
        for lights in sets {
            let all = self.radiosity_under(lights)?;
            let found: Vec<DVec3> = indices.iter().map(|i| all[*i as usize]).collect();
            self.truth().set_lights(lights.clone(), progress)?;
            let expected = self.truth().radiosity_at(&subset, progress)?;
            error = error.max(vertex_error(&found, &expected, &areas).or_none());
        }
        Ok(error)
    }
}
