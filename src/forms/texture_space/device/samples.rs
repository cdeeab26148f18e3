//! Shared samples on a device: drawn there, or clusters that the processor finds in the nodes' light.

use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use super::light::{NODE, WORKGROUP};
use crate::error::Result;
use crate::evaluate::device::Device;
use crate::evaluate::device::surface::{READ, UNIFORM, WRITE, bind, bind_group_layout, dispatch, pipeline, uniform};
use crate::forms::texture_space::light::{Flux, Walked};
use crate::forms::texture_space::map::TexelMap;
use crate::forms::texture_space::samples::clusters;

/// A sample of several receivers.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct GpuSample {
    centre: [f32; 4],
    flux: [f32; 4],
}

/// The samples of each part.
pub(super) struct SamplesOnDevice {
    device: Arc<Device>,
    count: usize,
    /// Parts that have nodes, in their order.
    parts: Vec<usize>,
    buffer: wgpu::Buffer,
    draw: wgpu::ComputePipeline,
    drawn: wgpu::BindGroup,
    numbers: wgpu::BindGroup,
}

impl SamplesOnDevice {
    /// Room for `count` samples of each part.
    ///
    /// # Errors
    /// More samples than the adapter binds (exit 5).
    pub(super) fn new(device: &Arc<Device>, map: &TexelMap, count: usize, nodes: &wgpu::Buffer) -> Result<Self> {
        let roots: Vec<(usize, u32)> =
            map.roots.iter().enumerate().filter_map(|(part, root)| Some((part, (*root)?))).collect();
        let calls = &device.device;
        let of_part = |(index, (_, root)): (usize, &(usize, u32))| {
            let first = (index * count) as u32;
            [*root, first, first + count as u32, 0]
        };
        let table: Vec<[u32; 4]> = roots.iter().enumerate().map(of_part).collect();
        let samples = roots.len() * count;
        let buffer = device.zeros("samples", (size_of::<GpuSample>() * samples) as u64)?;
        let first = bind_group_layout(calls, "samples", &[READ, READ, WRITE]);
        let second = bind_group_layout(calls, "numbers of samples", &[UNIFORM]);
        let text = [NODE, include_str!("draws.wgsl")].concat();
        let draw = pipeline(calls, &text, "draw", [&first, &second]);
        let drawn = bind(calls, &first, [nodes, &device.storage("parts", &table)?, &buffer]);
        let numbers = [samples as u32, roots.len() as u32, 0, 0];
        let numbers = bind(calls, &second, [&uniform(calls, "numbers of samples", bytemuck::cast_slice(&numbers))]);
        let parts = roots.iter().map(|(part, _)| *part).collect();
        Ok(Self { device: Arc::clone(device), count, parts, buffer, draw, drawn, numbers })
    }

    /// The samples: place and flux over the unit of irradiance, RGB.
    pub(super) fn buffer(&self) -> &wgpu::Buffer {
        &self.buffer
    }

    /// First and end of the samples of a part.
    pub(super) fn of_part(&self, part: usize) -> std::ops::Range<u32> {
        let Some(index) = self.parts.iter().position(|own| *own == part) else { return 0..0 };
        let first = (index * self.count) as u32;
        first..first + self.count as u32
    }

    /// Enqueues the draws from the nodes.
    pub(super) fn draw(&self) {
        let groups = (self.parts.len() * self.count).div_ceil(WORKGROUP) as u32;
        dispatch(&self.device, &self.draw, &self.drawn, [&(self.numbers.clone(), groups)]);
    }

    /// Finds clusters in the light of the nodes, which is read back, and uploads them.
    ///
    /// # Errors
    /// A lost device (exit 4).
    pub(super) fn cluster(&self, map: &TexelMap, nodes: &wgpu::Buffer) -> Result<()> {
        let bytes = self.device.read(nodes, (size_of::<Walked>() * map.nodes.len()) as u64)?;
        let walked: Vec<Walked> = bytemuck::pod_collect_to_vec(&bytes);
        let wide = |v: [f32; 3]| DVec3::from(v.map(f64::from));
        let flux = |w: &Walked| Flux { rgb: wide(w.rgb), at_mm: wide(w.at_mm), moment: w.moment.into() };
        let light: Vec<Flux> = walked.iter().map(flux).collect();
        let mut packed = vec![GpuSample::zeroed(); self.parts.len() * self.count];
        for (packed, part) in packed.chunks_mut(self.count.max(1)).zip(&self.parts) {
            for (packed, sample) in packed.iter_mut().zip(clusters(map, &light, *part, self.count)) {
                packed.centre = sample.at_mm.as_vec3().extend(0.0).to_array();
                packed.flux = sample.flux.as_vec3().extend(0.0).to_array();
            }
        }
        self.device.queue.write_buffer(&self.buffer, 0, bytemuck::cast_slice(&packed));
        self.device.check()
    }
}
