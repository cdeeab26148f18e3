//! How `reference` evaluates: many shadow rays, then every sample with every receiver.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::{AREA_SIDE, DIRECTIONS, POINTS};
use crate::asset::Asset;
use crate::error::{Error, Result};
use crate::evaluate::Evaluator;
use crate::evaluate::sampled::{Far, Plan, SampledEvaluator};
use crate::methods::settings::number;
use crate::transport::gather::NearField;
use crate::transport::irradiance::LightSampling;

/// Receivers of a block: wide, because the kernels are faster on long rows and every sample is seen anyway.
const GROUP: usize = 64;

/// The plan that the keys describe.
pub(super) fn plan(values: &BTreeMap<String, String>) -> Result<Plan> {
    let sampling = LightSampling {
        points_per_patch: number(values, &POINTS, 1..=64)?,
        directions: number(values, &DIRECTIONS, 1..=65536)?,
        area_side: number(values, &AREA_SIDE, 1..=256)?,
    };
    if !sampling.points_per_patch.is_power_of_two() {
        let points = sampling.points_per_patch;
        return Err(Error::command_line(format!("--set points={points}: a power of two is needed")));
    }
    Ok(Plan { sampling, near: NearField::REFERENCE, far: Far::AllPairs, group: GROUP })
}

pub(super) fn open(asset: Arc<Asset>) -> Result<Box<dyn Evaluator>> {
    let plan = plan(&asset.provenance.settings)?;
    Ok(Box::new(SampledEvaluator::new(asset, plan)))
}
