//! What evaluators share whose material is baked in: the samples that their error is measured against, and media that stay.

use std::sync::Arc;

use glam::DVec3;

use crate::asset::Asset;
use crate::compress::ledger::Ledger;
use crate::error::{Error, Result};
use crate::evaluate::Evaluator;
use crate::evaluate::sampled::{Bound, Far, Plan, SampledEvaluator};
use crate::geometry::samples::Samples;
use crate::light::Light;
use crate::math::statistics::{VertexError, vertex_error};
use crate::progress::Progress;
use crate::transport::gather::NearField;
use crate::transport::irradiance::LightSampling;
use crate::transport::scene::{Medium, Scene};

use super::stage::GROUP;

/// Error of the hierarchy that the transport is measured against.
const TRUTH_ERROR: f64 = 0.001;

/// An error, or none where the truth is black and the values are not: nothing can be relative to that.
pub(super) fn relative(error: VertexError) -> VertexError {
    if error.rms.is_finite() { error } else { VertexError::default() }
}

/// Samples lit by rays and summed through the hierarchy.
pub(super) fn truth(scene: &Scene, samples: usize) -> SampledEvaluator {
    let asset = Asset {
        samples: Samples::new(&scene.mesh, &scene.parts, samples),
        scene: scene.clone(),
        provenance: Default::default(),
        ledger: Ledger::default(),
        sections: Vec::new(),
    };
    let plan = Plan {
        sampling: LightSampling::FAST,
        near: NearField::FAST,
        far: Far::Hierarchical { error: TRUTH_ERROR, bound: Bound::SolidAngle },
        group: GROUP,
    };
    SampledEvaluator::new(Arc::new(asset), plan)
}

/// What an evaluator gives, against [`truth`], which is made when it is first asked for.
pub(super) struct Truth {
    samples: usize,
    made: Option<Box<SampledEvaluator>>,
}

impl Truth {
    pub(super) fn new(samples: usize) -> Self {
        Self { samples, made: None }
    }

    /// Number of samples.
    pub(super) fn samples(&self) -> usize {
        self.samples
    }

    /// Under some lights.
    pub(super) fn lit(
        &mut self,
        scene: &Scene,
        lights: &[Light],
        progress: &dyn Progress,
    ) -> Result<&mut SampledEvaluator> {
        let made = self.made.get_or_insert_with(|| Box::new(truth(scene, self.samples)));
        made.set_lights(lights.to_vec(), progress)?;
        Ok(made)
    }

    /// The truth's own error, and a stage: that of `values` under the worst of the lights in force, all together, and of others,
    /// each alone.
    pub(super) fn measured(
        &mut self,
        scene: &Scene,
        (lights, unseen): (&[Light], &[Light]),
        mut values: impl FnMut(&[Light]) -> Result<Vec<DVec3>>,
        (stage, note): (&str, &str),
        progress: &dyn Progress,
    ) -> Result<Ledger> {
        let areas = scene.vertex_areas_mm2();
        let mut error = VertexError::default();
        for lights in unseen.iter().map(std::slice::from_ref).chain([lights]) {
            let expected = self.lit(scene, lights, progress)?.radiosity(progress)?;
            error = error.max(relative(vertex_error(&values(lights)?, &expected, &areas)));
        }
        let mut ledger = self.lit(scene, lights, progress)?.measured_error(&[], progress)?;
        ledger.add(stage, error, note);
        Ok(ledger)
    }
}

/// Names may change, properties may not.
///
/// # Errors
/// Command line: another number of media; unsupported: other properties.
pub(super) fn replace_media(scene: &mut Scene, media: Vec<Medium>) -> Result<()> {
    if media.len() != scene.media.len() {
        let (given, there) = (media.len(), scene.media.len());
        return Err(Error::command_line(format!("{given} materials for the {there} media of the asset")));
    }
    if media.iter().zip(&scene.media).any(|(a, b)| a.properties != b.properties) {
        return Err(Error::unsupported(
            "the material is baked into this asset of `quantized_lights`; bake it again, or with --method editable",
        ));
    }
    scene.media = media;
    Ok(())
}
