//! Components in compute shaders: lights become columns on the CPU; products with the stored rows and interpolation
//! between the reference points run on the device.

use std::sync::Arc;

use glam::DVec3;

use super::components::{Components, LightBasis};
use super::digits::Term;
use crate::error::Result;
use crate::evaluate::device::Device;
use crate::evaluate::device::interpolated::{InterpolatedOnDevice, Sum};
use crate::evaluate::forward::{forward_scene, forward_to_processor};
use crate::evaluate::{DeviceEvaluator, Evaluator, Held};
use crate::forms::baked_in::BakedIn;
use crate::light::Light;
use crate::medium::material::Medium;
use crate::progress::Progress;

/// The transport of an asset on a device.
pub(crate) struct ComponentsOnDevice<B: LightBasis> {
    cpu: BakedIn<Components<B>>,
    stored: InterpolatedOnDevice,
    /// Scale of the radiosity in the buffer.
    scale: f64,
    is_current: bool,
}

impl<B: LightBasis> ComponentsOnDevice<B> {
    pub(crate) fn new(cpu: BakedIn<Components<B>>, device: &Arc<Device>) -> Result<Self> {
        let transport = &cpu.stored.transport;
        let coefficients: Vec<i16> = transport.coefficients.iter().map(|&digit| i16::from(digit)).collect();
        let stored = InterpolatedOnDevice::new(device, &coefficients, transport.columns, &transport.weights)?;
        Ok(Self { cpu, stored, scale: 1.0, is_current: false })
    }
}

impl<B: LightBasis> DeviceEvaluator for ComponentsOnDevice<B> {
    fn update(&mut self, _: &dyn Progress) -> Result<()> {
        if !self.is_current {
            let lit = &self.cpu.light;
            for (index, part) in lit.parts.iter().enumerate() {
                let sum = if index == 0 { Sum::New } else { Sum::Added };
                let columns = Term::columns(&part.terms, self.cpu.stored.transport.columns);
                self.stored.add(&columns, &part.factors, sum)?;
            }
            self.stored.interpolate()?;
            self.scale = lit.scale;
            self.is_current = true;
        }
        Ok(())
    }

    fn held(&self) -> Held<'_> {
        let receiver_of_vertex = &self.cpu.receivers.of_vertex;
        Held { device: self.stored.device(), radiosity: self.stored.radiosity(), scale: self.scale, receiver_of_vertex }
    }
}

impl<B: LightBasis> Evaluator for ComponentsOnDevice<B> {
    forward_scene!(cpu);
    forward_to_processor!(cpu);

    fn set_lights(&mut self, lights: Vec<Light>, progress: &dyn Progress) -> Result<()> {
        self.cpu.set_lights(lights, progress)?;
        self.is_current = false;
        Ok(())
    }

    fn set_media(&mut self, media: Vec<Medium>) -> Result<()> {
        self.cpu.set_media(media)
    }

    fn radiosity(&mut self, progress: &dyn Progress) -> Result<Vec<DVec3>> {
        self.read_back(progress)
    }
}
