//! The near field from the geometry, and the far field combined for the materials, on a device.

use std::sync::Arc;

use super::Device;
use super::jobs::{Effort, Entries, Shard, shards};
use super::surface::{READ, SurfaceBuffers, bind, bind_group_layout, dispatch, pipeline, shader};
use crate::error::Result;
use crate::transport::close_pairs::ClosePairs;
use crate::transport::receivers::Receivers;

/// Largest number of coefficients of a medium in the shader.
const TERMS: usize = 16;

/// The near field on a device.
pub struct NearOnDevice {
    device: Arc<Device>,
    pipeline: wgpu::ComputePipeline,
    coefficients: wgpu::Buffer,
    shards: Vec<(wgpu::BindGroup, u32)>,
}

impl NearOnDevice {
    /// Prepares the near field of the receivers: the samples around each group, their effort, the number of `media` and
    /// the medium of each part. `far_values` holds the far field.
    ///
    /// # Errors
    /// Lists beyond the adapter's bindings (exit 5).
    pub fn new(
        buffers: &SurfaceBuffers,
        receivers: &Receivers,
        (around, effort): (&ClosePairs, &Effort),
        (media, medium): (usize, impl Fn(u32) -> Option<u32>),
        far_values: &wgpu::Buffer,
    ) -> Result<Self> {
        let device = Arc::clone(buffers.device());
        let layout = bind_group_layout(&device.device, "near", &[READ; 4]);
        let text = shader(include_str!("near.wgsl"));
        let pipeline = pipeline(&device.device, &text, "near", [buffers.layout(), &layout]);
        let coefficients = device.zeros("coefficients of the media", (16 * TERMS * media) as u64)?;
        let lists: Vec<Entries> =
            (0..receivers.groups.len()).map(|group| Entries::List(around.of(group).to_vec())).collect();
        let of_shard = |shard: Shard| {
            let bound = [&shard.jobs, &shard.list, far_values, &coefficients];
            (bind(&device.device, &layout, bound), shard.count)
        };
        let shards = shards(&device, receivers, medium, &lists, effort)?.into_iter().map(of_shard).collect();
        device.check()?;
        Ok(Self { device, pipeline, coefficients, shards })
    }

    /// Replaces the coefficients of each medium's profile, `[channel][k]`.
    pub fn set_media(&mut self, coefficients: &[[Vec<f64>; 3]]) {
        let mut packed = vec![[0.0f32; 4]; TERMS * coefficients.len()];
        for (packed, channels) in packed.chunks_mut(TERMS).zip(coefficients) {
            for (channel, values) in channels.iter().enumerate() {
                packed.iter_mut().zip(values).for_each(|(slot, value)| slot[channel] = *value as f32);
            }
        }
        self.device.queue.write_buffer(&self.coefficients, 0, bytemuck::cast_slice(&packed));
    }

    /// Writes the radiosity of every receiver.
    pub fn run(&self, buffers: &SurfaceBuffers) {
        dispatch(&self.device, &self.pipeline, buffers.bind_group(), &self.shards);
    }
}
