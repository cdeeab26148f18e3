//! Multilevel summation ([`SurfaceNets`]) in compute shaders. Tables of kernels are made on the CPU; every sum runs on the device. Any
//! radial profile, and double layers beside it.

use std::sync::Arc;

use bytemuck::Zeroable;

use super::double_gpu::DoubleOnDevice;
use super::lit_samples::GatheredEvaluator;
use super::near_gpu::NearOnDevice;
use super::net_shaders::{GpuNetKernel, Shaders, points};
use crate::error::{Error, Result};
use crate::evaluate::device::Device;
use crate::evaluate::device::surface::{ComputePass, GpuTable, SurfaceBuffers, uniform};
use crate::transport::multilevel::{Net, NetsOfPart, SurfaceNets, SurfaceTables, Tables};

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
        let made = |of, tables| part(&shaders, device, (of, tables), [&flux, buffers.radiosity()]);
        let parts =
            nets.parts.iter().zip(&tables.parts).map(|(p, (tables, _))| made(p, tables)).collect::<Result<_>>()?;
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

/// The passes of a part.
fn part(
    shaders: &Shaders,
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
            None => shaders.restricted(device, (&nets.from_samples, part.samples.start), [flux, &charges[index]])?,
            Some(finer) => {
                shaders.restricted(device, (&nets.levels[finer].up, 0), [&charges[finer], &charges[index]])?
            }
        };
        let prolongation = match potentials.get(index + 1) {
            None => None,
            Some(coarser) => {
                Some(shaders.interpolation.stage(device, &net.down, [coarser, &potentials[index]], Some(0))?)
            }
        };
        let points = points(device, net)?;
        let header = uniform(&device.device, "table", bytemuck::bytes_of(&GpuNetKernel::zeroed()));
        let segments = device.storage("softened kernel", table.table.segments().2.as_flattened())?;
        let bound = [&charges[index], &potentials[index], &points, &header, &segments];
        let sums = shaders.smoothed(device, net, bound)?;
        levels.push(NetPasses { restriction, prolongation, sums, table: header, segments, is_nothing: false });
    }
    let nothing = device.zeros("no potential", 16)?;
    let from = potentials.first().unwrap_or(&nothing);
    let first = part.receivers.start as u32;
    let to_receivers = shaders.interpolation.stage(device, &nets.to_receivers, [from, radiosity], Some(first))?;
    Ok(PartOnDevice { levels, to_receivers })
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
