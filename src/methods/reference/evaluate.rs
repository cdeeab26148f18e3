//! How `reference` evaluates: many shadow rays, then every sample with every receiver.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::{AREA_SIDE, DIRECTIONS, POINTS};
use crate::asset::Asset;
use crate::error::Result;
use crate::evaluate::Evaluator;
use crate::evaluate::sampled::{Far, Plan, SampledEvaluator};
use crate::methods::sampling::light_sampling;
use crate::transport::gather::NearField;

/// Receivers of a block: wide, because the kernels are faster on long rows and every sample is seen anyway.
const GROUP: usize = 64;

/// The plan that the keys describe.
pub(super) fn plan(values: &BTreeMap<String, String>) -> Result<Plan> {
    let sampling = light_sampling(values, [&POINTS, &DIRECTIONS, &AREA_SIDE])?;
    Ok(Plan { sampling, near: NearField::REFERENCE, far: Far::AllPairs, group: GROUP })
}

pub(super) fn open(asset: Arc<Asset>) -> Result<Box<dyn Evaluator>> {
    let plan = plan(&asset.provenance.settings)?;
    Ok(Box::new(SampledEvaluator::new(asset, plan)))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::methods::reference::Reference;
    use crate::methods::settings::resolve;
    use crate::transport::irradiance::LightSampling;

    #[test]
    fn the_defaults_are_the_named_quality() {
        let plan = plan(&resolve(&Reference, &[]).unwrap()).unwrap();
        assert_eq!((plan.sampling, plan.near), (LightSampling::REFERENCE, NearField::REFERENCE));
    }
}
