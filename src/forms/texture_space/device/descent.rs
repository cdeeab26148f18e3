//! Descents on a device: every receiver walks the hierarchy by the sphere around its group.

use std::sync::Arc;

use bytemuck::{Pod, Zeroable};

use super::light::{NODE, WORKGROUP};
use crate::error::{Error, Result};
use crate::evaluate::device::Device;
use crate::evaluate::device::surface::{
    READ, SurfaceBuffers, UNIFORM, WRITE, bind, bind_group_layout, dispatch, kernel_shader, pipeline, uniform,
};
use crate::forms::texture_space::descent::{limit_for, probes};
use crate::forms::texture_space::falloff::SHIFT;
use crate::forms::texture_space::light::Walked;
use crate::forms::texture_space::state::TextureSpaceEvaluator;
use crate::transport::kernel::EdgePrecision;
use crate::transport::receivers::Group;

/// Turns of the loops of an invocation: software adapters end them after some 65,000, a patch nearby may take a few hundred more than these; and
/// desktops end long dispatches.
const TURNS_OF_SOFTWARE: u32 = 60_000;
const TURNS_OF_HARDWARE: u32 = 1 << 20;

/// Dispatches of one descent at most.
const MOST_ROUNDS: usize = 100_000;

/// Words of [`DescentOnDevice::places`] for each receiver.
const OF_RECEIVER: usize = 3;

/// Not within a texel.
const OUTSIDE: u32 = u32::MAX;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct GpuWalk {
    centre: [f32; 3],
    radius: f32,
    first: u32,
    end: u32,
    medium: u32,
    table: u32,
    last: u32,
    bits: u32,
    scale: f32,
    most: f32,
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct GpuLimits {
    limit: f32,
    turns: u32,
    of_triangle: u32,
    count: u32,
}

/// The walks of all groups.
pub(super) struct DescentOnDevice {
    device: Arc<Device>,
    layout: wgpu::BindGroupLayout,
    descend: wgpu::ComputePipeline,
    count: wgpu::ComputePipeline,
    falloffs: wgpu::Buffer,
    walks: wgpu::Buffer,
    of_groups: Vec<GpuWalk>,
    places: wgpu::Buffer,
    /// What the places are before the first dispatch.
    first_places: Vec<u32>,
    of_triangle: u32,
}

impl DescentOnDevice {
    /// Prepares the walks of the receivers.
    ///
    /// # Errors
    /// More receivers than the adapter binds (exit 5).
    pub(super) fn new(cpu: &TextureSpaceEvaluator, buffers: &SurfaceBuffers, precision: EdgePrecision) -> Result<Self> {
        let device = buffers.device();
        let calls = &device.device;
        let layout = bind_group_layout(calls, "walks", &[UNIFORM, READ, READ, READ, WRITE]);
        let constants = format!("const FALLOFF_SHIFT: u32 = {SHIFT}u;\n");
        let text = kernel_shader(&[&constants, NODE, include_str!("descent.wgsl")].concat());
        let [descend, count] =
            ["descend", "count"].map(|entry| pipeline(calls, &text, entry, [buffers.layout(), &layout]));
        let nodes = precision.rules().iter().map(|(_, nodes)| nodes.len()).max().unwrap_or(0);
        let mut first_places = vec![0];
        for (index, group) in cpu.receivers.groups.iter().enumerate() {
            for _ in group.run.range() {
                first_places.extend([index as u32, root(cpu, group).map_or(0, |root| root[0]), OUTSIDE]);
            }
        }
        let places = device.storage("places of the walks", &first_places)?;
        let mut result = Self {
            device: Arc::clone(device),
            layout,
            descend,
            count,
            falloffs: device.zeros("falloffs", 4)?,
            walks: device.zeros("walks", 4)?,
            of_groups: Vec::new(),
            places,
            first_places,
            // Three edges, their nodes and the search for the rule; and the facet.
            of_triangle: (3 * (nodes + 1) + precision.rules().len() + 1) as u32,
        };
        result.set_media(cpu)?;
        Ok(result)
    }

    /// Takes the media in force.
    ///
    /// # Errors
    /// More groups than the adapter binds (exit 5).
    pub(super) fn set_media(&mut self, cpu: &TextureSpaceEvaluator) -> Result<()> {
        let (mut values, mut tables): (Vec<f32>, Vec<u32>) = (Vec::new(), Vec::new());
        for (_, falloff) in cpu.kernels().media() {
            tables.push(values.len() as u32);
            values.extend(&falloff.values);
        }
        let walk = |group: &Group| {
            let sphere = cpu.receivers.sphere(*group);
            let [first, end] = root(cpu, group).unwrap_or([0, 0]);
            let part = cpu.scene.parts.parts.get(group.part as usize);
            let medium = part.and_then(|part| part.medium).unwrap_or(0);
            let falloff = cpu.kernels().media().get(medium as usize).map(|(_, falloff)| falloff);
            GpuWalk {
                centre: sphere.centre_mm.as_vec3().to_array(),
                radius: sphere.radius_mm as f32,
                first,
                end: if falloff.is_some() { end } else { first },
                medium,
                table: tables.get(medium as usize).copied().unwrap_or(0),
                last: falloff.map_or(0, |f| f.values.len().saturating_sub(1) as u32),
                bits: falloff.map_or(0, |f| f.first),
                scale: falloff.map_or(1.0, |f| f.smooth_mm),
                most: falloff.map_or(0.0, |f| f.most),
            }
        };
        self.of_groups = cpu.receivers.groups.iter().map(walk).collect();
        self.falloffs = self.device.storage("falloffs", &values)?;
        self.walks = self.device.storage("walks", &self.of_groups)?;
        Ok(())
    }

    /// The limit with which receivers see `count` sources in the mean, about.
    ///
    /// # Errors
    /// A lost device (exit 4).
    pub(super) fn limit(
        &self,
        cpu: &TextureSpaceEvaluator,
        buffers: &SurfaceBuffers,
        (nodes, guess): (&wgpu::Buffer, Option<f64>),
    ) -> Result<f64> {
        let count = cpu.numbers.count as usize;
        let (mut patches, mut largest) = (0, 0.0f64);
        for (part, root) in cpu.map.roots.iter().enumerate() {
            let (Some(root), Some((_, falloff))) = (*root, cpu.kernels().at(&cpu.scene, part as u32)) else { continue };
            let size = size_of::<Walked>() as u64;
            let bytes = self.device.read_at(nodes, u64::from(root) * size, size)?;
            let Some(top) = bytemuck::pod_collect_to_vec::<u8, Walked>(&bytes).first().copied() else { continue };
            patches += top.lit as usize;
            largest = largest.max(f64::from(top.moment) * f64::from(falloff.at(0.0)));
        }
        let index = |group: &Group| cpu.receivers.groups.binary_search_by_key(&group.run.first, |g| g.run.first);
        let chosen: Vec<GpuWalk> =
            probes(&cpu.receivers, count).filter_map(|group| self.of_groups.get(index(group).ok()?).copied()).collect();
        let walks = self.device.storage("probed walks", &chosen)?;
        let mut first = vec![0];
        chosen.iter().for_each(|walk| first.extend([0, walk.first, OUTSIDE]));
        let places = self.device.storage("places of probed walks", &first)?;
        let bytes = 4 * first.len() as u64;
        limit_for(count, (patches, largest), guess, |limit| {
            self.walk(&self.count, buffers, [nodes, &walks, &places], (&first, chosen.len(), limit))?;
            let found: Vec<u32> = bytemuck::pod_collect_to_vec(&self.device.read(&places, bytes)?);
            let sources: f64 = found.iter().skip(1).step_by(OF_RECEIVER).map(|n| f64::from(*n)).sum();
            Ok(sources / chosen.len().max(1) as f64)
        })
    }

    /// Enqueues the radiosity of every receiver.
    ///
    /// # Errors
    /// A lost device (exit 4).
    pub(super) fn run(&self, buffers: &SurfaceBuffers, nodes: &wgpu::Buffer, limit: f64) -> Result<()> {
        let receivers = self.first_places.len() / OF_RECEIVER;
        self.walk(&self.descend, buffers, [nodes, &self.walks, &self.places], (&self.first_places, receivers, limit))
    }

    /// Dispatches until all walks are at their ends.
    fn walk(
        &self,
        pipeline: &wgpu::ComputePipeline,
        buffers: &SurfaceBuffers,
        [nodes, walks, places]: [&wgpu::Buffer; 3],
        (first_places, count, limit): (&[u32], usize, f64),
    ) -> Result<()> {
        let turns = if self.device.is_software() { TURNS_OF_SOFTWARE } else { TURNS_OF_HARDWARE };
        let limits = GpuLimits { limit: limit as f32, turns, of_triangle: self.of_triangle, count: count as u32 };
        let calls = &self.device.device;
        let limits = uniform(calls, "limits", bytemuck::bytes_of(&limits));
        let second = bind(calls, &self.layout, [&limits, nodes, &self.falloffs, walks, places]);
        let shard = (second, count.div_ceil(WORKGROUP) as u32);
        self.device.queue.write_buffer(places, 0, bytemuck::cast_slice(first_places));
        for _ in 0..MOST_ROUNDS {
            dispatch(&self.device, pipeline, buffers.bind_group(), [&shard]);
            let unfinished: Vec<u32> = bytemuck::pod_collect_to_vec(&self.device.read(places, 4)?);
            if unfinished == [0] {
                return Ok(());
            }
            self.device.queue.write_buffer(places, 0, bytemuck::bytes_of(&0u32));
        }
        Err(Error::runtime("descents of the texture that do not end on the device; use --device cpu"))
    }
}

/// First and end of the walk of a group; none in opaque parts.
fn root(cpu: &TextureSpaceEvaluator, group: &Group) -> Option<[u32; 2]> {
    let root = cpu.map.roots.get(group.part as usize).copied().flatten()?;
    Some([root, cpu.map.nodes.get(root as usize)?.next])
}
