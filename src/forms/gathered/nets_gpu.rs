//! Multilevel summation ([`SurfaceNets`]) in compute shaders. Light reaches the samples, and tables of kernels are made, on the
//! CPU; every sum runs on the device. Any radial profile.

use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3};

use super::hierarchy_gpu::buffers;
use super::lit_samples::GatheredEvaluator;
use crate::error::{Error, Result};
use crate::evaluate::device::Device;
use crate::evaluate::device::interpolated::{Interpolation, check_turns, cut, longest};
use crate::evaluate::device::jobs::{Effort, Entries, Shard, shards};
use crate::evaluate::device::surface::{
    ComputePass, GpuTable, READ, SurfaceBuffers, UNIFORM, WRITE, bind, bind_group_layout, dispatch, pipeline, shader,
    table_shader, uniform,
};
use crate::evaluate::forward::{forward_scene, forward_to_processor};
use crate::evaluate::{DeviceEvaluator, Evaluator, Held};
use crate::geometry::samples::Facet;
use crate::light::Light;
use crate::medium::material::Medium;
use crate::medium::profiles::model::LoadedProfile;
use crate::progress::{Progress, Silent};
use crate::transport::interpolation::Adjoint;
use crate::transport::kernel::radial_table::{SHIFT, SMOOTH_SHIFT};
use crate::transport::multilevel::{Net, NetsOfPart, SurfaceNets, SurfaceTables};
use crate::transport::near_rule::{MOST_SPLITS, PIECE_IS_POINT};
use crate::transport::sample_light::SampleLight;
use crate::transport::surface::Surface;

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
struct GpuNetKernel {
    table: GpuTable,
    is_added: u32,
    padding: [u32; 3],
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct GpuCompact {
    point: GpuTable,
    disc: GpuTable,
    smooth2: f32,
    split2: f32,
    facets_below: f32,
    pieces_below: f32,
}

/// A [`GatheredEvaluator`] that sums over nets, on a device.
pub(super) struct NetsOnDevice {
    cpu: GatheredEvaluator,
    device: Arc<Device>,
    buffers: SurfaceBuffers,
    flux: wgpu::Buffer,
    parts: Vec<PartOnDevice>,
    near: Near,
    is_current: bool,
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

/// The compact part of the kernel, summed over near samples.
struct Near {
    layout: wgpu::BindGroupLayout,
    pipeline: wgpu::ComputePipeline,
    shards: Vec<Shard>,
    /// Splits of triangles that the shards are cut for.
    splits: Splits,
    groups: Vec<(wgpu::BindGroup, u32)>,
}

/// Limits of splitting triangles: distance over their radius below which, and scale down to which they are split, mm.
#[derive(Clone, Copy, Debug)]
struct Splits {
    below: f64,
    smooth_mm: f64,
}

impl Splits {
    fn of(tables: &SurfaceTables) -> Self {
        let mut splits = Self { below: PIECE_IS_POINT.into(), smooth_mm: f64::INFINITY };
        for (_, compact) in &tables.parts {
            splits.below = splits.below.max(compact.split_below.into());
            splits.smooth_mm = splits.smooth_mm.min(compact.smooth_mm);
        }
        splits
    }

    fn covers(self, other: Self) -> bool {
        self.below >= other.below && self.smooth_mm <= other.smooth_mm
    }

    /// Turns of the shader's loops for a triangle; radius about its centroid in mm.
    fn turns(self, radius: f64, area: f64) -> usize {
        let levels = (self.below * radius / self.smooth_mm).log2().ceil();
        let depth = if levels.is_finite() { levels.clamp(0.0, MOST_SPLITS.into()) as u32 } else { MOST_SPLITS };
        // Of each size those around the receiver, at most.
        let around = 4.0 * std::f64::consts::PI * ((self.below + 1.0) * radius).powi(2) / area.max(f64::MIN_POSITIVE);
        let triangles: f64 = (0..=depth).map(|level| around.clamp(1.0, 4f64.powi(level as i32))).sum();
        let of_one = (2 * depth + 8) as f64;
        (triangles * of_one).min(1e12) as usize
    }

    fn effort(self, surface: &Surface, (rule_below, pieces): (f64, usize)) -> Effort {
        let mesh = surface.domain.mesh;
        let of_facet = |facet: &Facet| {
            let [a, b, c] = facet.corners_local_mm(mesh);
            let middle = (a + b + c) / 3.0;
            let radius = [a, b, c].iter().map(|p| p.distance(middle)).fold(0.0, f64::max);
            self.turns(radius, 0.5 * (b - a).cross(c - a).length())
        };
        let turns = |index: usize| {
            let facets = surface.samples.patch(index);
            let radius = surface.patches[index].radius_mm;
            let whole = facets.iter().map(of_facet).sum::<usize>();
            // What shadow boundaries leave of a sample is not much thinner than this.
            let close = whole + pieces * self.turns(radius, 0.1 * radius * radius);
            let less_close = 9 * facets.len() + pieces;
            [(close + less_close).min(1 << 40), less_close]
        };
        // Triangles are not larger than their sample, nor farther from its centroid.
        Effort::with_turns(surface.patches, [self.below + 1.0, rule_below], turns)
    }
}

impl NetsOnDevice {
    /// Uploads nets and samples.
    ///
    /// # Errors
    /// An adapter with too few or too small bindings (exit 5); an evaluator that does not sum over nets (exit 4: a caller's
    /// mistake).
    pub(super) fn new(mut cpu: GatheredEvaluator, device: &Arc<Device>) -> Result<Self> {
        cpu.prepare_nets(&Silent);
        let surface = cpu.surface();
        let (nets, tables) = nets_of(&cpu)?;
        let buffers = buffers(&cpu, device)?;
        let flux = device.zeros("flux", 16 * surface.patches.len() as u64)?;
        let shaders = Shaders::new(device);
        let part = |part, tables| shaders.part(device, (part, tables), [&flux, buffers.radiosity()]);
        let parts =
            nets.parts.iter().zip(&tables.parts).map(|(p, (tables, _))| part(p, tables)).collect::<Result<_>>()?;
        let layout = bind_group_layout(&device.device, "compact", &[READ; 5]);
        let text = table_shader(SHIFT, &shader(include_str!("compact.wgsl")));
        let pipeline = pipeline(&device.device, &text, "near", [buffers.layout(), &layout]);
        // Other media may need smaller pieces: cut for those as well.
        let splits = Splits { smooth_mm: 0.5 * Splits::of(tables).smooth_mm, ..Splits::of(tables) };
        let shards = near_shards(device, (&cpu, nets, tables), splits)?;
        let near = Near { layout, pipeline, shards, splits, groups: Vec::new() };
        device.check()?;
        let device = Arc::clone(device);
        let mut result = Self { cpu, device, buffers, flux, parts, near, is_current: false };
        result.set_tables()?;
        Ok(result)
    }

    /// Uploads the tables of the media and profiles in force.
    fn set_tables(&mut self) -> Result<()> {
        self.is_current = false;
        self.cpu.prepare_nets(&Silent);
        let (nets, tables) = nets_of(&self.cpu)?;
        for (part, (own, _)) in self.parts.iter_mut().zip(&tables.parts) {
            let coarsest = part.levels.len().saturating_sub(1);
            for (index, (level, table)) in part.levels.iter_mut().zip(&own.levels).enumerate() {
                let mut segments = Vec::new();
                let own = GpuTable::append(&table.table, &mut segments);
                if size_of_val(segments.as_slice()) as u64 > level.segments.size() {
                    return Err(Error::runtime("tables of another medium do not fit the device's"));
                }
                let header = GpuNetKernel { table: own, is_added: u32::from(index < coarsest), padding: [0; 3] };
                self.device.queue.write_buffer(&level.segments, 0, bytemuck::cast_slice(segments.as_flattened()));
                self.device.queue.write_buffer(&level.table, 0, bytemuck::bytes_of(&header));
                level.is_nothing = table.is_nothing();
            }
        }
        let needed = Splits::of(tables);
        if !self.near.splits.covers(needed) {
            self.near.shards = near_shards(&self.device, (&self.cpu, nets, tables), needed)?;
            self.near.splits = needed;
        }
        let (mut heads, mut all) = (Vec::new(), Vec::new());
        for (_, compact) in &tables.parts {
            heads.push(GpuCompact {
                point: GpuTable::append(&compact.point, &mut all),
                disc: GpuTable::append(&compact.disc, &mut all),
                smooth2: (compact.smooth_mm * compact.smooth_mm) as f32,
                split2: compact.split_below * compact.split_below,
                facets_below: compact.rule.facets_below as f32,
                pieces_below: compact.rule.pieces_below as f32,
            });
        }
        let heads = self.device.storage("compact parts", &heads)?;
        let segments = self.device.storage("tables of compact parts", all.as_flattened())?;
        let of_shard = |shard: &Shard| {
            let bound = [&shard.jobs, &shard.list, &self.flux, &heads, &segments];
            (bind(&self.device.device, &self.near.layout, bound), shard.count)
        };
        self.near.groups = self.near.shards.iter().map(of_shard).collect();
        self.device.check()
    }
}

fn nets_of(cpu: &GatheredEvaluator) -> Result<(&SurfaceNets, &SurfaceTables)> {
    cpu.nets().ok_or_else(|| Error::runtime("no nets to sum over on the device"))
}

/// The work of the compact part; the "medium" of a job is its part among those that have nets.
fn near_shards(
    device: &Device,
    (cpu, nets, tables): (&GatheredEvaluator, &SurfaceNets, &SurfaceTables),
    splits: Splits,
) -> Result<Vec<Shard>> {
    let receivers = &cpu.receivers;
    let mut lists = vec![Entries::List(Vec::new()); receivers.groups.len()];
    let mut table_of_part = vec![None; cpu.scene().parts.parts.len()];
    for (index, part) in nets.parts.iter().enumerate() {
        let first = receivers.groups.partition_point(|g| (g.run.first as usize) < part.receivers.start);
        let Some(of_part) = receivers.groups.get(first).map(|g| g.part as usize) else { continue };
        table_of_part[of_part] = Some(index as u32);
        let start = part.samples.start as u32;
        let groups = receivers.groups.partition_point(|g| (g.run.first as usize) < part.receivers.end);
        for (group, list) in lists[first..groups].iter_mut().enumerate() {
            *list = Entries::List(part.near.close.of(group).iter().map(|sample| start + sample).collect());
        }
    }
    let rule = |(_, compact): &(_, crate::transport::multilevel::Compact)| {
        compact.rule.facets_below.max(compact.rule.pieces_below)
    };
    let rule_below = tables.parts.iter().map(rule).fold(0.0, f64::max);
    let effort = splits.effort(&cpu.surface(), (rule_below, cpu.gathering.sampling.pieces_of_uneven() as usize));
    shards(device, receivers, |part| table_of_part.get(part as usize).copied().flatten(), &lists, &effort)
}

/// Pipelines and layouts shared by the nets of all parts.
struct Shaders {
    restriction: [wgpu::BindGroupLayout; 2],
    restricted: wgpu::ComputePipeline,
    sums: [wgpu::BindGroupLayout; 2],
    smoothed: wgpu::ComputePipeline,
    interpolation: Interpolation,
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
        Self { restriction, restricted, sums, smoothed, interpolation: Interpolation::new(device) }
    }

    fn part(
        &self,
        device: &Device,
        (part, tables): (&NetsOfPart, &crate::transport::multilevel::Tables),
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
            let points: Vec<[f32; 4]> = net.at.iter().map(|&p| Vec3::from(p).extend(0.0).to_array()).collect();
            let points = device.storage("points of a net", &points)?;
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

    fn restricted(
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
        let bind_group = bind(&device.device, &self.sums[0], bound);
        Ok(ComputePass { pipeline: self.smoothed.clone(), bind_group, shards })
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

impl DeviceEvaluator for NetsOnDevice {
    fn update(&mut self, progress: &dyn Progress) -> Result<()> {
        if self.is_current {
            return Ok(());
        }
        self.cpu.irradiance(progress)?;
        let (irradiance, pieces) = self.cpu.lit();
        let light = SampleLight::new(irradiance, pieces);
        self.buffers.set_light(&light)?;
        let patches = self.cpu.surface().patches.iter().enumerate();
        let flux: Vec<[f32; 4]> =
            patches.map(|(i, patch)| light.flux(i, patch).as_vec3().extend(0.0).to_array()).collect();
        self.device.queue.write_buffer(&self.flux, 0, bytemuck::cast_slice(&flux));
        let mut encoder = self.device.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.clear_buffer(self.buffers.radiosity(), 0, None);
        self.device.queue.submit([encoder.finish()]);
        for part in &self.parts {
            part.run(&self.device);
        }
        dispatch(&self.device, &self.near.pipeline, self.buffers.bind_group(), &self.near.groups);
        self.device.check()?;
        self.is_current = true;
        Ok(())
    }

    fn held(&self) -> Held<'_> {
        self.buffers.held(&self.cpu.receivers)
    }
}

impl Evaluator for NetsOnDevice {
    forward_scene!(cpu);
    forward_to_processor!(cpu);

    fn set_lights(&mut self, lights: Vec<Light>, progress: &dyn Progress) -> Result<()> {
        self.is_current = false;
        self.cpu.set_lights(lights, progress)
    }

    fn set_media(&mut self, media: Vec<Medium>) -> Result<()> {
        self.cpu.set_media(media)?;
        self.set_tables()
    }

    fn set_profile(&mut self, profile: LoadedProfile) -> Result<()> {
        self.cpu.set_profile(profile)?;
        self.set_tables()
    }

    fn radiosity(&mut self, progress: &dyn Progress) -> Result<Vec<DVec3>> {
        self.read_back(progress)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turns_grow_with_what_is_split_and_stay_finite() {
        let splits = |smooth_mm| Splits { below: 2.0, smooth_mm };
        let [few, some, many] = [10.0, 0.5, 0.01].map(|smooth| splits(smooth).turns(1.0, 1.3));
        assert!(few >= 8 && few < some && some < many, "{few} {some} {many}");
        assert!(splits(0.0).turns(1.0, 0.0) >= many && splits(0.0).turns(0.0, 0.0) >= 8);
        assert!(splits(0.1).covers(splits(0.2)) && !splits(0.2).covers(splits(0.1)));
        assert!(!splits(0.1).covers(Splits { below: 3.0, smooth_mm: 0.1 }));
    }
}
