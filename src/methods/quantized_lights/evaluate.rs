//! How `quantized_lights` evaluates: lights become weights over what is stored, and radiosity is linear in these. Components:
//! weights over the set become a vector over the columns, radiosity at a reference point is a dot product with it, and at a vertex
//! a weighted sum over reference points.

use std::sync::Arc;

use super::lights::{LightSet, blend, scheme};
use super::sections::{self, read};
use crate::asset::Asset;
use crate::error::Result;
use crate::evaluate::Evaluator;
use crate::light::Light;
use crate::methods::baked_in::BakedIn;
use crate::methods::components::{Components, LightBasis, Lit, Transport};
use crate::methods::stage::GROUP;
use crate::transport::receivers::Receivers;

/// An asset of components.
pub(super) fn open(asset: &Arc<Asset>) -> Result<Box<dyn Evaluator>> {
    let file = read(&asset.sections)?;
    let scene = asset.scene.clone();
    let receivers = Receivers::new(&scene.mesh, &scene.parts, GROUP);
    let settings = &asset.provenance.settings;
    let between = (scheme(settings)?, blend(settings)?);
    let mut set = LightSet::new(&scene, file.directions as usize, file.shells.clone(), between)?;
    let transport = sections::transport(&file, &scene, &receivers, &set)?;
    // The basis has taken them in.
    set.interpolator.forget_weights();
    let components = Components { basis: set, transport };
    BakedIn::boxed(scene, receivers, file.samples as usize, components)
}

impl LightBasis for LightSet {
    const STAGE: &'static str = "quantised lights";

    fn lit(&self, transport: &Transport, lights: &[Light]) -> Result<Lit> {
        sections::light(transport, self, lights)
    }
}
