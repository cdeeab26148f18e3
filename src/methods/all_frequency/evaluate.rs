//! How `all_frequency` evaluates: lights become vectors in the basis of the transport.

use std::sync::Arc;

use translux_format::distant_transport::{DistantTransport, tags};

use super::KINDS;
use super::harmonics;
use super::plan::Plan;
use super::rows::Rows;
use super::single;
use crate::asset::Asset;
use crate::error::{Error, Result};
use crate::evaluate::Evaluator;
use crate::light::Light;
use crate::methods::baked_in::{BakedIn, Beside};
use crate::methods::stage::GROUP;
use crate::transport::receivers::Receivers;

/// Refuses lights at a distance.
pub(super) fn far_away(light: &Light) -> Result<()> {
    if KINDS.contains(&light.kind()) {
        return Ok(());
    }
    Err(Error::unsupported(
        "this asset of `all_frequency` has light from far away only (environment, constant, directional): bake it with --method \
         quantized_lights or editable for point and area lights",
    ))
}

pub(super) fn open(asset: &Arc<Asset>) -> Result<Box<dyn Evaluator>> {
    let plan = Plan::new(&asset.provenance.settings)?;
    let scene = asset.scene.clone();
    let receivers = Receivers::new(&scene.mesh, &scene.parts, GROUP);
    let file = DistantTransport::from_sections(&asset.sections, receivers.len())
        .map_err(|e| Error::input(e.to_string()))?
        .ok_or_else(|| Error::input("an asset of `all_frequency` without its sections aft.*; bake it again"))?;
    let samples = file.samples as usize;
    let single = single::stored(file.single.as_ref(), &plan, &scene, &receivers)?;
    let beside = Beside { single, outside: plan.outside };
    match (&file.harmonics, &file.rows) {
        (Some(file), None) => {
            let components = harmonics::components(file, (tags::SET, 1), &scene, &receivers)?;
            BakedIn::with(scene, receivers, samples, components, beside)
        }
        (None, Some(rows)) => {
            let rows = Rows::new(rows, plan.transform)?;
            BakedIn::with(scene, receivers, samples, rows, beside)
        }
        _ => Err(Error::input("an asset of `all_frequency` that needs a later version of this program")),
    }
}
