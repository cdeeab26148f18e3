//! Transport as coefficients at reference points over a basis of spherical harmonics: a light becomes its projection on the
//! harmonics, that a vector over the columns, and radiosity at a reference point is a dot product.

#[cfg(feature = "gpu")]
use std::sync::Arc;

use glam::DVec3;
use translux_format::distant_transport::{Harmonics as File, tags};

use super::evaluate::far_away;
use crate::compress::prediction::Net;
use crate::error::Result;
#[cfg(feature = "gpu")]
use crate::evaluate::device::{Device, DeviceEvaluator};
use crate::light::Light;
use crate::light::harmonics::coefficients;
#[cfg(feature = "gpu")]
use crate::methods::baked_in::BakedIn;
use crate::methods::baked_in::Stored;
#[cfg(feature = "gpu")]
use crate::methods::components::gpu::{ComponentsOnDevice, HasComponents};
use crate::methods::components::{Coded, Lit, Transport, Weighted};
use crate::transport::receivers::Receivers;
use crate::transport::scene::Scene;

/// The transport, ready for lights.
pub(super) struct Harmonics {
    order: usize,
    transport: Transport,
}

impl Harmonics {
    pub(super) fn new(file: &File, scene: &Scene, receivers: &Receivers) -> Result<Self> {
        let order = file.order as usize;
        let net = Net::unpredicted(order * order);
        let coded = [Coded { set: &file.set, tags: tags::SET, shells: 0..1, net: &net }];
        let fold = |basis: Vec<f32>, _| basis.iter().map(|v| f64::from(*v)).collect();
        let transport = Transport::new(&coded, (scene, receivers), file.spacing_mm, fold)?;
        Ok(Self { order, transport })
    }

    /// Radiosity of the reference points in the order of the receivers.
    pub(super) fn at_references(&self, lit: &Lit) -> Vec<DVec3> {
        let mut values = Vec::new();
        self.transport.products(lit, &mut values);
        let value = |v: &[f32; 4]| DVec3::new(v[0].into(), v[1].into(), v[2].into()).max(DVec3::ZERO) * lit.scale;
        values.iter().map(value).collect()
    }
}

impl Stored for Harmonics {
    type Light = Lit;

    fn light(&self, lights: &[Light]) -> Result<Lit> {
        let mut sums = vec![DVec3::ZERO; self.order * self.order];
        for light in lights {
            far_away(light)?;
            let own = coefficients(light, self.order)?;
            sums.iter_mut().zip(own).for_each(|(sum, c)| *sum += c);
        }
        let shells = vec![sums.iter().map(DVec3::to_array).collect()];
        self.transport.lit(vec![Weighted { shells, factors: Vec::new() }])
    }

    fn radiosity(&mut self, lit: &Lit, receivers: &Receivers) -> Vec<DVec3> {
        self.transport.radiosity(lit, receivers)
    }

    fn stage(&self) -> &'static str {
        "transport in harmonics"
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
impl HasComponents for Harmonics {
    fn components(&self) -> &Transport {
        &self.transport
    }
}
