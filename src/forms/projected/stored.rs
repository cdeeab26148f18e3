//! Components as the transport of a [`BakedIn`](crate::forms::baked_in::BakedIn) asset.

#[cfg(feature = "gpu")]
use std::sync::Arc;

use glam::DVec3;

use super::components::{Components, LightBasis, Lit};
#[cfg(feature = "gpu")]
use super::gpu::ComponentsOnDevice;
use crate::error::Result;
#[cfg(feature = "gpu")]
use crate::evaluate::{DeviceEvaluator, device::Device};
#[cfg(feature = "gpu")]
use crate::forms::baked_in::BakedIn;
use crate::forms::baked_in::Stored;
use crate::light::Light;
use crate::transport::receivers::Receivers;

impl<B: LightBasis> Stored for Components<B> {
    type Light = Lit;

    fn light(&self, lights: &[Light]) -> Result<Lit> {
        self.basis.lit(&self.transport, lights)
    }

    fn radiosity(&mut self, lit: &Lit, receivers: &Receivers) -> Vec<DVec3> {
        self.transport.radiosity(lit, receivers)
    }

    fn stage(&self) -> &'static str {
        B::STAGE
    }

    fn bytes(&self) -> usize {
        self.transport.bytes()
    }

    #[cfg(feature = "gpu")]
    fn on_device(evaluator: BakedIn<Self>, device: &Arc<Device>) -> Result<Box<dyn DeviceEvaluator>> {
        Ok(Box::new(ComponentsOnDevice::new(evaluator, device)?))
    }
}
