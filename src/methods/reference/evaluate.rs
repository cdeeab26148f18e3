//! How `reference` evaluates: many shadow rays, then every sample with every receiver.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::{AREA_SIDE, DIRECTIONS, POINTS, RAYS, SINGLE, SINGLE_SAMPLES};
use crate::asset::Asset;
use crate::error::{Error, Result};
use crate::evaluate::Evaluator;
use crate::evaluate::sampled::{Far, Plan, SampledEvaluator};
use crate::evaluate::single_scattering::{Scattering, Traced};
use crate::methods::inter_reflection::outside;
use crate::methods::sampling::light_sampling;
use crate::methods::settings::number;
use crate::methods::single_keys::Integrand;
use crate::transport::gather::NearField;

/// Receivers of a block: wide, because the kernels are faster on long rows and every sample is seen anyway.
const GROUP: usize = 64;

/// The plan that the keys describe.
pub(super) fn plan(values: &BTreeMap<String, String>) -> Result<Plan> {
    let sampling = light_sampling(values, [&POINTS, &DIRECTIONS, &AREA_SIDE])?;
    Ok(Plan { sampling, near: NearField::REFERENCE, far: Far::AllPairs, group: GROUP, nets: None })
}

/// The single scattering that the keys describe.
pub(super) fn single_scattering(values: &BTreeMap<String, String>) -> Result<Option<Traced>> {
    let samples = number(values, &SINGLE_SAMPLES, 1..=4096)?;
    let Integrand { form, crossings } = Integrand::new(values)?;
    let of = |scattering| Some(Traced { form, crossings, ..Traced::new(scattering, samples) });
    match values.get(SINGLE.name).map_or(SINGLE.default, String::as_str) {
        "off" => Integrand::check_unused(values).map(|()| None),
        "isotropic" => Ok(of(Scattering::Isotropic)),
        "phase" => Ok(of(Scattering::OfMedium)),
        other => Err(Error::command_line(format!("--set {}={other}: it is off, isotropic or phase", SINGLE.name))),
    }
}

pub(super) fn open(asset: Arc<Asset>) -> Result<Box<dyn Evaluator>> {
    let settings = &asset.provenance.settings;
    let (plan, single, outside) = (plan(settings)?, single_scattering(settings)?, outside(settings, &RAYS)?);
    let evaluator = SampledEvaluator::new(asset, plan).with_single_scattering(single);
    Ok(Box::new(evaluator.with_inter_reflection(outside)))
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
        assert_eq!(single_scattering(&resolve(&Reference, &[]).unwrap()).unwrap(), None);
        assert_eq!(outside(&resolve(&Reference, &[]).unwrap(), &RAYS).unwrap(), None);
    }
}
