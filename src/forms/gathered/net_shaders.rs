//! Pipelines over nets of points, and their buffers.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

use crate::error::Result;
use crate::evaluate::device::Device;
use crate::evaluate::device::interpolated::{Interpolation, check_turns, cut, longest};
use crate::evaluate::device::surface::{
    ComputePass, GpuTable, READ, UNIFORM, WRITE, bind, bind_group_layout, pipeline, table_shader, uniform,
};
use crate::transport::interpolation::Adjoint;
use crate::transport::kernel::radial_table::SMOOTH_SHIFT;
use crate::transport::multilevel::{FIELDS, Net};

/// Rows of one workgroup, and invocations for each row.
const ROWS: usize = 4;
const INVOCATIONS: usize = 16;

/// Invocations that share a point.
const SLICES: usize = 4;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct GpuShard {
    first: u32,
    count: u32,
    padding: [u32; 2],
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
pub(super) struct GpuNetKernel {
    pub(super) table: GpuTable,
    pub(super) is_added: u32,
    pub(super) padding: [u32; 3],
}

/// Pipelines and layouts shared by the nets of all parts.
pub(super) struct Shaders {
    restriction: [wgpu::BindGroupLayout; 2],
    restricted: wgpu::ComputePipeline,
    sums: [wgpu::BindGroupLayout; 2],
    smoothed: wgpu::ComputePipeline,
    heights: (wgpu::BindGroupLayout, wgpu::ComputePipeline),
    pub(super) interpolation: Interpolation,
}

impl Shaders {
    pub(super) fn new(device: &Device) -> Self {
        let calls = &device.device;
        let text = &table_shader(SMOOTH_SHIFT, include_str!("nets.wgsl"));
        let work = || bind_group_layout(calls, "shard", &[UNIFORM, READ, READ]);
        let restriction = [bind_group_layout(calls, "restriction", &[READ, WRITE]), work()];
        let sums = [bind_group_layout(calls, "net", &[READ, WRITE, READ, UNIFORM, READ]), work()];
        let restricted = pipeline(calls, text, "restricted", restriction.each_ref());
        let smoothed = pipeline(calls, text, "smoothed", sums.each_ref());
        let fields = [vec![READ; FIELDS], vec![WRITE; FIELDS], vec![READ, UNIFORM, READ]].concat();
        let heights = bind_group_layout(calls, "double layer on a net", &fields);
        let text = &table_shader(SMOOTH_SHIFT, include_str!("heights.wgsl"));
        let doubled = pipeline(calls, text, "heights", [&heights, &sums[1]]);
        let interpolation = Interpolation::new(device);
        Self { restriction, restricted, sums, smoothed, heights: (heights, doubled), interpolation }
    }

    /// Sums of rows of weights, which bring values to the points of a net.
    pub(super) fn restricted(
        &self,
        device: &Device,
        (rows, first): (&Adjoint, usize),
        bound: [&wgpu::Buffer; 2],
    ) -> Result<ComputePass> {
        let offsets: Vec<u32> = rows.offsets.iter().map(|&o| o as u32).collect();
        check_turns(longest(&offsets) / INVOCATIONS + INVOCATIONS)?;
        let binding = device.largest_binding() as usize;
        let mut shards = Vec::new();
        for range in cut(&offsets, binding / 8, (binding / 4).saturating_sub(1)) {
            let (from, to) = (rows.offsets[range.start], rows.offsets[range.end]);
            let own: Vec<u32> = offsets[range.start..=range.end].iter().map(|o| o - from as u32).collect();
            let cell = |&(fine, weight): &(u32, f32)| [first as u32 + fine, weight.to_bits()];
            let cells: Vec<[u32; 2]> = rows.cells[from..to].iter().map(cell).collect();
            let work = [
                shard(device, &range),
                device.storage("rows of weights", &own)?,
                device.storage("weights of rows", cells.as_flattened())?,
            ];
            shards.push((bind(&device.device, &self.restriction[1], &work), range.len().div_ceil(ROWS) as u32));
        }
        let bind_group = bind(&device.device, &self.restriction[0], bound);
        Ok(ComputePass { pipeline: self.restricted.clone(), bind_group, shards })
    }

    /// Sums from point to point of a net: charges, potentials, points, table and segments.
    pub(super) fn smoothed(&self, device: &Device, net: &Net, bound: [&wgpu::Buffer; 5]) -> Result<ComputePass> {
        let bind_group = bind(&device.device, &self.sums[0], bound);
        Ok(ComputePass { pipeline: self.smoothed.clone(), bind_group, shards: self.groups(device, net)? })
    }

    /// Sums of a double layer from point to point of a net: charges, potentials, points, table and segments.
    pub(super) fn heights(&self, device: &Device, net: &Net, bound: &[&wgpu::Buffer]) -> Result<ComputePass> {
        let (layout, pipeline) = &self.heights;
        let bind_group = bind(&device.device, layout, bound.iter().copied());
        Ok(ComputePass { pipeline: pipeline.clone(), bind_group, shards: self.groups(device, net)? })
    }

    /// Groups of points of a net, and the points around them.
    fn groups(&self, device: &Device, net: &Net) -> Result<Vec<(wgpu::BindGroup, u32)>> {
        let (offsets, around) = net.around.flat();
        let offsets: Vec<u32> = offsets.iter().map(|&o| o as u32).collect();
        check_turns(longest(&offsets) / SLICES + 1)?;
        let binding = device.largest_binding() as usize;
        let mut shards = Vec::new();
        for range in cut(&offsets, binding / 4, binding / 16) {
            let (from, to) = (offsets[range.start], offsets[range.end]);
            let group = |g: usize| [net.groups[g].first, net.groups[g].end, offsets[g] - from, offsets[g + 1] - from];
            let groups: Vec<[u32; 4]> = range.clone().map(group).collect();
            let work = [
                shard(device, &range),
                device.storage("groups of points", groups.as_flattened())?,
                device.storage("points around", &around[from as usize..to as usize])?,
            ];
            shards.push((bind(&device.device, &self.sums[1], &work), range.len() as u32));
        }
        Ok(shards)
    }
}

fn shard(device: &Device, range: &std::ops::Range<usize>) -> wgpu::Buffer {
    let shard = GpuShard { first: range.start as u32, count: range.len() as u32, padding: [0; 2] };
    uniform(&device.device, "shard of a net", bytemuck::bytes_of(&shard))
}

/// Positions of the points of a net, mm.
pub(super) fn points(device: &Device, net: &Net) -> Result<wgpu::Buffer> {
    let points: Vec<[f32; 4]> = net.at.iter().map(|&p| Vec3::from(p).extend(0.0).to_array()).collect();
    device.storage("points of a net", &points)
}
