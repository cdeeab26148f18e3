//! Multilevel summation ([`SurfaceNets`]) in compute shaders. Tables of kernels are made on the CPU; every sum runs on the device. Any
//! radial profile, and double layers beside it.

use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

use super::double_gpu::DoubleOnDevice;
use super::lit_samples::GatheredEvaluator;
use super::near_gpu::NearOnDevice;
use crate::error::{Error, Result};
use crate::evaluate::device::Device;
use crate::evaluate::device::interpolated::{Interpolation, check_turns, cut, longest};
use crate::evaluate::device::surface::{
    ComputePass, GpuTable, READ, SurfaceBuffers, UNIFORM, WRITE, bind, bind_group_layout, pipeline, table_shader,
    uniform,
};
use crate::transport::interpolation::Adjoint;
use crate::transport::kernel::radial_table::SMOOTH_SHIFT;
use crate::transport::multilevel::{FIELDS, Net, NetsOfPart, SurfaceNets, SurfaceTables, Tables};

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

/// Sums over nets.
pub(super) struct NetsOnDevice {
    shaders: Shaders,
    /// Flux of every sample.
    flux: wgpu::Buffer,
    parts: Vec<PartOnDevice>,
    /// Double layers of the parts that have one.
    doubles: Option<DoubleOnDevice>,
    near: NearOnDevice,
}

/// The nets of a part, finest first.
struct PartOnDevice {
    levels: Vec<NetPasses>,
    to_receivers: ComputePass,
}

struct NetPasses {
    restriction: ComputePass,
    /// Interpolation from the next coarser net.
    prolongation: Option<ComputePass>,
    sums: ComputePass,
    table: wgpu::Buffer,
    segments: wgpu::Buffer,
    is_nothing: bool,
}

impl NetsOnDevice {
    /// Uploads nets and samples, and the tables of the kernels in force.
    ///
    /// # Errors
    /// An adapter with too few or too small bindings (exit 5); an evaluator that does not sum over nets (exit 4: a caller's
    /// mistake).
    pub(super) fn new(cpu: &GatheredEvaluator, device: &Arc<Device>, buffers: &SurfaceBuffers) -> Result<Self> {
        let (nets, tables) = nets_of(cpu)?;
        let flux = device.zeros("flux", 16 * cpu.surface().patches.len() as u64)?;
        let shaders = Shaders::new(device);
        let part = |part, tables| shaders.part(device, (part, tables), [&flux, buffers.radiosity()]);
        let parts =
            nets.parts.iter().zip(&tables.parts).map(|(p, (tables, _))| part(p, tables)).collect::<Result<_>>()?;
        let near = NearOnDevice::new(cpu, device, buffers, (nets, tables))?;
        let mut result = Self { shaders, flux, parts, doubles: None, near };
        result.set_tables(cpu, device, buffers)?;
        Ok(result)
    }

    /// Uploads the tables of the kernels in force.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub(super) fn set_tables(
        &mut self,
        cpu: &GatheredEvaluator,
        device: &Arc<Device>,
        buffers: &SurfaceBuffers,
    ) -> Result<()> {
        let (nets, tables) = nets_of(cpu)?;
        for (part, (own, _)) in self.parts.iter_mut().zip(&tables.parts) {
            let coarsest = part.levels.len().saturating_sub(1);
            for (index, (level, table)) in part.levels.iter_mut().zip(&own.levels).enumerate() {
                let mut segments = Vec::new();
                let own = GpuTable::append(&table.table, &mut segments);
                if size_of_val(segments.as_slice()) as u64 > level.segments.size() {
                    return Err(Error::runtime("tables of another medium do not fit the device's"));
                }
                let header = GpuNetKernel { table: own, is_added: u32::from(index < coarsest), padding: [0; 3] };
                device.queue.write_buffer(&level.segments, 0, bytemuck::cast_slice(segments.as_flattened()));
                device.queue.write_buffer(&level.table, 0, bytemuck::bytes_of(&header));
                level.is_nothing = table.is_nothing();
            }
        }
        self.near.set_tables(cpu, device, (nets, tables), &self.flux)?;
        let has_doubles = tables.doubles.iter().any(Option::is_some);
        let doubles = || DoubleOnDevice::new(&self.shaders, device, buffers, (nets, tables), &self.flux);
        self.doubles = if has_doubles { Some(doubles()?) } else { None };
        device.check()
    }

    /// Enqueues the sums of the light in force at all receivers; the buffers hold it already.
    ///
    /// # Errors
    /// A lost device (exit 4).
    pub(super) fn run(&self, cpu: &GatheredEvaluator, device: &Device, buffers: &SurfaceBuffers) -> Result<()> {
        let light = cpu.sample_light(cpu.lit());
        let patches = cpu.surface().patches;
        let flux = patches.iter().enumerate().map(|(i, patch)| light.flux(i, patch).as_vec3().extend(0.0).to_array());
        let flux: Vec<[f32; 4]> = flux.collect();
        device.queue.write_buffer(&self.flux, 0, bytemuck::cast_slice(&flux));
        let mut encoder = device.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.clear_buffer(buffers.radiosity(), 0, None);
        device.queue.submit([encoder.finish()]);
        for part in &self.parts {
            part.run(device);
        }
        if let Some(doubles) = &self.doubles {
            doubles.run(device, buffers, (&flux, patches));
        }
        self.near.run(device, buffers);
        device.check()
    }
}

fn nets_of(cpu: &GatheredEvaluator) -> Result<(&SurfaceNets, &SurfaceTables)> {
    cpu.nets().ok_or_else(|| Error::runtime("no nets to sum over on the device"))
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
    fn new(device: &Device) -> Self {
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

    fn part(
        &self,
        device: &Device,
        (part, tables): (&NetsOfPart, &Tables),
        [flux, radiosity]: [&wgpu::Buffer; 2],
    ) -> Result<PartOnDevice> {
        let nets = &part.nets;
        let values = |net: &Net| device.zeros("values of a net", 16 * net.at.len() as u64);
        let charges = nets.levels.iter().map(values).collect::<Result<Vec<_>>>()?;
        let potentials = nets.levels.iter().map(values).collect::<Result<Vec<_>>>()?;
        let mut levels = Vec::with_capacity(nets.levels.len());
        for (index, (net, table)) in nets.levels.iter().zip(&tables.levels).enumerate() {
            let restriction = match index.checked_sub(1) {
                None => self.restricted(device, (&nets.from_samples, part.samples.start), [flux, &charges[index]])?,
                Some(finer) => {
                    self.restricted(device, (&nets.levels[finer].up, 0), [&charges[finer], &charges[index]])?
                }
            };
            let prolongation = match potentials.get(index + 1) {
                None => None,
                Some(coarser) => {
                    Some(self.interpolation.stage(device, &net.down, [coarser, &potentials[index]], Some(0))?)
                }
            };
            let points = points(device, net)?;
            let header = uniform(&device.device, "table", bytemuck::bytes_of(&GpuNetKernel::zeroed()));
            let segments = device.storage("softened kernel", table.table.segments().2.as_flattened())?;
            let bound = [&charges[index], &potentials[index], &points, &header, &segments];
            let sums = self.smoothed(device, net, bound)?;
            levels.push(NetPasses { restriction, prolongation, sums, table: header, segments, is_nothing: false });
        }
        let nothing = device.zeros("no potential", 16)?;
        let from = potentials.first().unwrap_or(&nothing);
        let first = part.receivers.start as u32;
        let to_receivers = self.interpolation.stage(device, &nets.to_receivers, [from, radiosity], Some(first))?;
        Ok(PartOnDevice { levels, to_receivers })
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

    fn smoothed(&self, device: &Device, net: &Net, bound: [&wgpu::Buffer; 5]) -> Result<ComputePass> {
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

impl PartOnDevice {
    fn run(&self, device: &Device) {
        for level in &self.levels {
            level.restriction.run(device);
        }
        for (index, level) in self.levels.iter().enumerate().rev() {
            if let Some(prolongation) = &level.prolongation {
                prolongation.run(device);
            }
            // The sums of the coarsest net are what there is to begin with.
            if !level.is_nothing || index + 1 == self.levels.len() {
                level.sums.run(device);
            }
        }
        self.to_receivers.run(device);
    }
}

/// Positions of the points of a net, mm.
pub(super) fn points(device: &Device, net: &Net) -> Result<wgpu::Buffer> {
    let points: Vec<[f32; 4]> = net.at.iter().map(|&p| Vec3::from(p).extend(0.0).to_array()).collect();
    device.storage("points of a net", &points)
}
