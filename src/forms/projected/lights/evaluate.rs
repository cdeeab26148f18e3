//! Evaluation of `quantized_lights`: lights become weights over the set, these a vector over the columns of components;
//! radiosity is a dot product with it at a reference point, and at a vertex a weighted sum over these.

use super::light_set::LightSet;
use super::sections::{self, read};
use super::settings::QuantisedLights;
use crate::asset::Asset;
use crate::error::Result;
use crate::evaluate::Evaluator;
use crate::forms::baked_in::BakedIn;
use crate::forms::projected::components::{Components, LightBasis, Lit, Transport};
use crate::forms::sampled_scene::GROUP;
use crate::light::Light;
use crate::transport::receivers::Receivers;

/// Opens an asset of components.
pub(super) fn open(form: &QuantisedLights, asset: &Asset) -> Result<Box<dyn Evaluator>> {
    let file = read(&asset.sections)?;
    let scene = asset.scene.clone();
    let receivers = Receivers::new(&scene.mesh, &scene.parts, GROUP);
    let between = (form.lights.scheme, form.lights.blend);
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
