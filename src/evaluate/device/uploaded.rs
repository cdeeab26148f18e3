//! Transport on the CPU, its radiosity uploaded: the fastest way on a software adapter, and open to every method.

use std::sync::Arc;

use glam::DVec3;

use super::adapter::Device;
use crate::error::Result;
use crate::evaluate::evaluator::{DeviceEvaluator, Evaluator, Held, Refined};
use crate::evaluate::forward::{forward_scene, forward_to_processor};
use crate::light::Light;
use crate::medium::material::Medium;
use crate::medium::profiles::model::LoadedProfile;
use crate::progress::Progress;
use crate::transport::balanced_tree::power_of_two_near;

/// A CPU evaluator with a copy of its radiosity on a device; each source vertex is a receiver.
pub struct Uploaded {
    evaluator: Box<dyn Evaluator>,
    device: Arc<Device>,
    buffer: wgpu::Buffer,
    receivers: Vec<u32>,
    scale: f64,
}

impl Uploaded {
    /// Wraps an evaluator for a device.
    ///
    /// # Errors
    /// More vertices than the adapter binds (exit 5).
    pub fn new(evaluator: Box<dyn Evaluator>, device: Arc<Device>) -> Result<Self> {
        let vertices = evaluator.scene().mesh.local_mm.len();
        let buffer = device.zeros("radiosity", vertices as u64 * 16)?;
        Ok(Self { evaluator, device, buffer, receivers: (0..vertices as u32).collect(), scale: 1.0 })
    }
}

impl DeviceEvaluator for Uploaded {
    fn update(&mut self, progress: &dyn Progress) -> Result<()> {
        let radiosity = self.evaluator.radiosity(progress)?;
        self.scale = power_of_two_near(radiosity.iter().map(|b| b.abs().max_element()).fold(0.0, f64::max));
        let values: Vec<[f32; 4]> = radiosity.iter().map(|b| (*b / self.scale).extend(0.0).as_vec4().into()).collect();
        self.device.queue.write_buffer(&self.buffer, 0, bytemuck::cast_slice(&values));
        self.device.check()
    }

    fn held(&self) -> Held<'_> {
        let Self { device, buffer, scale, receivers, .. } = self;
        Held { device, radiosity: buffer, scale: *scale, receiver_of_vertex: receivers }
    }

    fn transport(&self) -> String {
        "CPU".to_owned()
    }
}

impl Evaluator for Uploaded {
    forward_scene!(evaluator);
    forward_to_processor!(evaluator);

    fn set_lights(&mut self, lights: Vec<Light>, progress: &dyn Progress) -> Result<()> {
        self.evaluator.set_lights(lights, progress)
    }

    fn move_lights(&mut self, lights: Vec<Light>, progress: &dyn Progress) -> Result<()> {
        self.evaluator.move_lights(lights, progress)
    }

    fn set_media(&mut self, media: Vec<Medium>) -> Result<()> {
        self.evaluator.set_media(media)
    }

    fn set_profile(&mut self, profile: LoadedProfile) -> Result<()> {
        self.evaluator.set_profile(profile)
    }

    fn prepare_for_edits(&mut self, progress: &dyn Progress) {
        self.evaluator.prepare_for_edits(progress);
    }

    fn remember_lights(&mut self, count: usize) {
        self.evaluator.remember_lights(count);
    }

    fn answer_at_once(&mut self) {
        self.evaluator.answer_at_once();
    }

    fn refine(&mut self) -> Result<Refined> {
        self.evaluator.refine()
    }

    fn set_eye(&mut self, at_mm: DVec3) -> bool {
        self.evaluator.set_eye(at_mm)
    }

    fn radiosity(&mut self, progress: &dyn Progress) -> Result<Vec<DVec3>> {
        self.evaluator.radiosity(progress)
    }

    fn on_device(self: Box<Self>, device: &Arc<Device>) -> Result<Box<dyn DeviceEvaluator>> {
        self.evaluator.on_device(device)
    }
}
