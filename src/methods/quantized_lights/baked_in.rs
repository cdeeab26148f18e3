//! What evaluators share whose material is baked in: the samples that their error is measured against, and media that stay.

use std::sync::Arc;

use crate::asset::Asset;
use crate::compress::ledger::Ledger;
use crate::error::{Error, Result};
use crate::evaluate::sampled::{Bound, Far, Plan, SampledEvaluator};
use crate::geometry::samples::Samples;
use crate::transport::gather::NearField;
use crate::transport::irradiance::LightSampling;
use crate::transport::scene::{Medium, Scene};

use super::stage::GROUP;

/// Error of the hierarchy that the transport is measured against.
const TRUTH_ERROR: f64 = 0.001;

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
