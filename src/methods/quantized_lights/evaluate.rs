//! How `quantized_lights` evaluates: lights become weights over what is stored, and radiosity is linear in these. Components:
//! weights over the set become a vector over the columns, radiosity at a reference point is a dot product with it, and at a vertex
//! a weighted sum over reference points.

use std::sync::Arc;

use glam::DVec3;

use super::lights::{LightSet, blend, scheme};
use super::sections::{self, read};
use crate::asset::Asset;
use crate::error::Result;
use crate::evaluate::Evaluator;
#[cfg(feature = "gpu")]
use crate::evaluate::device::{Device, DeviceEvaluator};
use crate::light::Light;
use crate::methods::baked_in::{BakedIn, Stored};
#[cfg(feature = "gpu")]
use crate::methods::components::gpu::{ComponentsOnDevice, HasComponents};
use crate::methods::components::{Lit, Transport};
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
    let components = Components { set, transport };
    BakedIn::boxed(scene, receivers, file.samples as usize, components)
}

/// Components at reference points.
pub(super) struct Components {
    set: LightSet,
    transport: Transport,
}

impl Stored for Components {
    type Light = Lit;

    fn light(&self, lights: &[Light]) -> Result<Self::Light> {
        sections::light(&self.transport, &self.set, lights)
    }

    fn radiosity(&mut self, lit: &Self::Light, receivers: &Receivers) -> Vec<DVec3> {
        self.transport.radiosity(lit, receivers)
    }

    fn stage(&self) -> &'static str {
        "quantised lights"
    }

    fn bytes(&self) -> usize {
        self.transport.bytes()
    }

    #[cfg(feature = "gpu")]
    fn on_device(evaluator: BakedIn<Self>, device: &Arc<Device>) -> Result<Box<dyn DeviceEvaluator>> {
        Ok(Box::new(ComponentsOnDevice::new(evaluator, device)?))
    }
}

#[cfg(feature = "gpu")]
impl HasComponents for Components {
    fn components(&self) -> &Transport {
        &self.transport
    }
}
