//! The radiosity that is drawn, separate from the computed one: a copy that changes in one submission, so that a frame
//! never mixes two states.

use std::sync::Arc;

use super::memory::filled;
use crate::error::Result;
use crate::evaluate::{DeviceEvaluator, device::Device};

/// Bytes before the radiosity, for the scale of its values.
const HEADER: u64 = 16;

/// Radiosity and visibility as they are drawn; clones share memory.
#[derive(Clone)]
pub struct Shown {
    device: Arc<Device>,
    /// Four floats with the scale, then four for every receiver.
    pub(super) radiosity: wgpu::Buffer,
    pub(super) visibility: wgpu::Buffer,
}

impl Shown {
    pub(super) fn new(evaluator: &dyn DeviceEvaluator) -> Result<Self> {
        let device = Arc::clone(evaluator.held().device);
        let radiosity = device.zeros("shown radiosity", HEADER + evaluator.held().radiosity.size())?;
        let visibility = device.zeros("shown visibility", evaluator.scene().mesh.local_mm.len() as u64 * 4)?;
        Ok(Self { device, radiosity, visibility })
    }

    /// Shows an evaluator's current radiosity from now on; `visibility` has an entry for each source vertex.
    ///
    /// # Errors
    /// A lost device (exit 4).
    pub fn publish(&self, evaluator: &dyn DeviceEvaluator, visibility: &[u32]) -> Result<()> {
        let held = evaluator.held();
        let scale = (held.scale as f32).clamp(f32::MIN_POSITIVE, f32::MAX);
        let header = filled(&self.device, "scale", &[scale, 0.0, 0.0, 0.0], wgpu::BufferUsages::COPY_SRC)?;
        let source = held.radiosity;
        let mut encoder = self.device.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.copy_buffer_to_buffer(&header, 0, &self.radiosity, 0, HEADER);
        let bytes = source.size().min(self.radiosity.size() - HEADER) / 4 * 4;
        encoder.copy_buffer_to_buffer(source, 0, &self.radiosity, HEADER, bytes);
        let bytes = size_of_val(visibility) as u64;
        if bytes > 0 && bytes <= self.visibility.size() {
            let seen = filled(&self.device, "visibility", visibility, wgpu::BufferUsages::COPY_SRC)?;
            encoder.copy_buffer_to_buffer(&seen, 0, &self.visibility, 0, bytes);
        }
        self.device.queue.submit([encoder.finish()]);
        self.device.check()
    }
}
