//! Double layers over nets in compute shaders: the sums of nets, of four fields at once.

use std::sync::Arc;

use bytemuck::{Pod, Zeroable};

use super::net_shaders::{GpuNetKernel, Shaders, points};
use crate::error::Result;
use crate::evaluate::device::Device;
use crate::evaluate::device::surface::{
    ComputePass, GpuTable, READ, SurfaceBuffers, UNIFORM, bind, bind_group_layout, dispatch, kernel_shader, pipeline,
    uniform,
};
use crate::geometry::samples::Patch;
use crate::transport::multilevel::{Double, FIELDS, NetsOfPart, SurfaceNets, SurfaceTables};

/// Receivers of a workgroup.
const WORKGROUP: u32 = 64;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct GpuRange {
    first: u32,
    end: u32,
    padding: [u32; 2],
}

/// A buffer of each field.
type Fields = [wgpu::Buffer; FIELDS];

/// The double layers of all parts.
pub(super) struct DoubleOnDevice {
    /// Flux times normal of every sample, by axis.
    moments: [wgpu::Buffer; FIELDS - 1],
    parts: Vec<DoublePart>,
    faced: wgpu::ComputePipeline,
}

/// The layer of a part, finest net first.
struct DoublePart {
    levels: Vec<DoubleLevel>,
    to_receivers: [ComputePass; FIELDS],
    /// The fields of the part's receivers, and workgroups of those.
    range: (wgpu::BindGroup, u32),
}

struct DoubleLevel {
    restriction: [ComputePass; FIELDS],
    prolongation: Option<[ComputePass; FIELDS]>,
    sums: ComputePass,
}

impl DoubleOnDevice {
    /// Uploads the nets and the tables of the layers there are.
    ///
    /// # Errors
    /// An adapter with too small bindings (exit 5).
    pub(super) fn new(
        shaders: &Shaders,
        device: &Arc<Device>,
        buffers: &SurfaceBuffers,
        (nets, tables): (&SurfaceNets, &SurfaceTables),
        flux: &wgpu::Buffer,
    ) -> Result<Self> {
        let moment = |_| device.zeros("moments", flux.size());
        let moments = three([moment(0), moment(1), moment(2)])?;
        let [x, y, z] = &moments;
        let charges = [flux, x, y, z];
        let at_receivers = fields(device, "fields of receivers", buffers.radiosity().size())?;
        let layout = bind_group_layout(&device.device, "fields of receivers", &[UNIFORM, READ, READ, READ, READ]);
        let text = kernel_shader(include_str!("faced.wgsl"));
        let faced = pipeline(&device.device, &text, "faced", [buffers.layout(), &layout]);
        let mut parts = Vec::new();
        for (part, double) in nets.parts.iter().zip(&tables.doubles) {
            let Some(double) = double else { continue };
            parts.push(DoublePart::new(shaders, device, (part, double), (charges, &at_receivers), &layout)?);
        }
        Ok(Self { moments, parts, faced })
    }

    /// Enqueues the layers of a flux through samples, whose buffer is up to date.
    pub(super) fn run(&self, device: &Device, buffers: &SurfaceBuffers, (flux, patches): (&[[f32; 4]], &[Patch])) {
        for (axis, buffer) in self.moments.iter().enumerate() {
            let moment = |(flux, patch): (&[f32; 4], &Patch)| {
                let normal = (patch.cross_mm2[axis] / patch.area_mm2) as f32;
                flux.map(|value| value * normal)
            };
            let moments: Vec<[f32; 4]> = flux.iter().zip(patches).map(moment).collect();
            device.queue.write_buffer(buffer, 0, bytemuck::cast_slice(&moments));
        }
        for part in &self.parts {
            for level in &part.levels {
                level.restriction.iter().for_each(|pass| pass.run(device));
            }
            for level in part.levels.iter().rev() {
                level.prolongation.iter().flatten().for_each(|pass| pass.run(device));
                level.sums.run(device);
            }
            part.to_receivers.iter().for_each(|pass| pass.run(device));
            dispatch(device, &self.faced, buffers.bind_group(), [&part.range]);
        }
    }
}

impl DoublePart {
    fn new(
        shaders: &Shaders,
        device: &Device,
        (part, double): (&NetsOfPart, &Double),
        (own, at_receivers): ([&wgpu::Buffer; FIELDS], &Fields),
        layout: &wgpu::BindGroupLayout,
    ) -> Result<Self> {
        let nets = &double.nets;
        let values = |count: usize| fields(device, "fields of a net", 16 * count as u64);
        let charges: Vec<Fields> = nets.levels.iter().map(|net| values(net.at.len())).collect::<Result<_>>()?;
        let potentials: Vec<Fields> = nets.levels.iter().map(|net| values(net.at.len())).collect::<Result<_>>()?;
        let mut levels = Vec::with_capacity(nets.levels.len());
        let coarsest = nets.levels.len().saturating_sub(1);
        for (index, (net, kernel)) in nets.levels.iter().zip(&double.levels).enumerate() {
            let restriction = match index.checked_sub(1) {
                None => of_fields(device, own, &charges[0], |bound| {
                    shaders.restricted(device, (&nets.from_samples, part.samples.start), bound)
                })?,
                Some(finer) => of_fields(device, charges[finer].each_ref(), &charges[index], |bound| {
                    shaders.restricted(device, (&nets.levels[finer].up, 0), bound)
                })?,
            };
            let prolongation = match potentials.get(index + 1) {
                None => None,
                Some(coarser) => Some(of_fields(device, coarser.each_ref(), &potentials[index], |bound| {
                    shaders.interpolation.stage(device, &net.down, bound, Some(0))
                })?),
            };
            let mut segments = Vec::new();
            let table = GpuTable::append(&kernel.table, &mut segments);
            let header = GpuNetKernel { table, is_added: u32::from(index < coarsest), padding: [0; 3] };
            let header = uniform(&device.device, "table of a double layer", bytemuck::bytes_of(&header));
            let segments = device.storage("double layer", segments.as_flattened())?;
            let points = points(device, net)?;
            let mut bound: Vec<&wgpu::Buffer> = charges[index].iter().chain(&potentials[index]).collect();
            bound.extend([&points, &header, &segments]);
            levels.push(DoubleLevel { restriction, prolongation, sums: shaders.heights(device, net, &bound)? });
        }
        let nothing = fields(device, "no potential", 16)?;
        let from = potentials.first().unwrap_or(&nothing);
        let to_receivers = of_fields(device, from.each_ref(), at_receivers, |bound| {
            shaders.interpolation.stage(device, &nets.to_receivers, bound, Some(part.receivers.start as u32))
        })?;
        let (first, end) = (part.receivers.start as u32, part.receivers.end as u32);
        let range = GpuRange { first, end, padding: [0; 2] };
        let range = uniform(&device.device, "receivers of a part", bytemuck::bytes_of(&range));
        let [under, x, y, z] = at_receivers;
        let range = bind(&device.device, layout, [&range, under, x, y, z]);
        Ok(Self { levels, to_receivers, range: (range, (end - first).div_ceil(WORKGROUP)) })
    }
}

/// A buffer of zeros for each field.
fn fields(device: &Device, label: &str, bytes: u64) -> Result<Fields> {
    let [a, b, c] = three([device.zeros(label, bytes), device.zeros(label, bytes), device.zeros(label, bytes)])?;
    Ok([a, b, c, device.zeros(label, bytes)?])
}

fn three<T>([a, b, c]: [Result<T>; 3]) -> Result<[T; 3]> {
    Ok([a?, b?, c?])
}

/// The same pass for each field, `made` from its two buffers; the work of all is that of the first.
fn of_fields(
    device: &Device,
    from: [&wgpu::Buffer; FIELDS],
    to: &Fields,
    made: impl Fn([&wgpu::Buffer; 2]) -> Result<ComputePass>,
) -> Result<[ComputePass; FIELDS]> {
    let first = made([from[0], &to[0]])?;
    let layout = first.pipeline.get_bind_group_layout(0);
    let other = |field: usize| ComputePass {
        pipeline: first.pipeline.clone(),
        bind_group: bind(&device.device, &layout, [from[field], &to[field]]),
        shards: first.shards.clone(),
    };
    let others = [other(1), other(2), other(3)];
    let [b, c, d] = others;
    Ok([first, b, c, d])
}
