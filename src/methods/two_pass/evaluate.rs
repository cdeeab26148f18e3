//! How `two_pass` evaluates: shadow rays at the samples, then the hierarchy with an asked error.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::{AREA_SIDE, BOUND, DIRECTIONS, ERROR, POINTS, RAYS};
use crate::asset::Asset;
use crate::error::{Error, Result};
use crate::evaluate::Evaluator;
use crate::evaluate::sampled::{Bound, Far, Plan, SampledEvaluator};
use crate::methods::inter_reflection::outside;
use crate::methods::sampling::light_sampling;
use crate::methods::settings::share;
use crate::transport::gather::NearField;

/// Receivers that share a traversal of the tree.
const GROUP: usize = 16;

/// The plan that the keys describe.
pub(super) fn plan(values: &BTreeMap<String, String>, max_rms: f64) -> Result<Plan> {
    let error = match values.get(ERROR.name).map(String::as_str) {
        None | Some("auto") => 0.3 * max_rms,
        Some(text) => share(text, "--set error")?,
    };
    let bound = match values.get(BOUND.name).map_or(BOUND.default, String::as_str) {
        "solid-angle" => Bound::SolidAngle,
        "kernel" => Bound::Kernel,
        other => {
            return Err(Error::command_line(format!("--set bound={other}: it is solid-angle or kernel")));
        }
    };
    let sampling = light_sampling(values, [&POINTS, &DIRECTIONS, &AREA_SIDE])?;
    let far = Far::Hierarchical { error, bound };
    Ok(Plan { sampling, near: NearField::for_error(max_rms), far, group: GROUP, nets: None })
}

pub(super) fn open(asset: Arc<Asset>) -> Result<Box<dyn Evaluator>> {
    let settings = &asset.provenance.settings;
    let max_rms = settings.get("max-rms").map_or(Ok(0.005), |text| share(text, "max-rms"))?;
    let (plan, outside) = (plan(settings, max_rms)?, outside(settings, &RAYS)?);
    Ok(Box::new(SampledEvaluator::new(asset, plan).with_inter_reflection(outside)))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::methods::settings::resolve;
    use crate::methods::two_pass::TwoPass;
    use crate::transport::irradiance::LightSampling;

    #[test]
    fn the_defaults_are_the_named_quality() {
        let plan = plan(&resolve(&TwoPass, &[]).unwrap(), 0.005).unwrap();
        assert_eq!((plan.sampling, plan.near), (LightSampling::FAST, NearField::FAST));
    }
}
