//! Buffers and shader text that all methods share: samples, receivers, media and the light on the samples.

use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use wgpu::util::DeviceExt;

use super::Device;
use super::jobs::{CLUSTER, RECEIVERS};
use crate::error::{Error, Result};
use crate::evaluate::evaluator::Held;
use crate::geometry::samples::Patch;
use crate::transport::kernel::EdgeRule;
use crate::transport::kernel::medium::MediumKernel;
use crate::transport::kernel::radial_table::{RadialTable, Rgb};
use crate::transport::near_field::Corners;
use crate::transport::near_rule::{
    MOST_SPLITS, NearField, PIECE_IS_POINT, SIX_POINTS, SLIVER, THREE_BEYOND, THREE_POINTS,
};
use crate::transport::receivers::Receivers;
use crate::transport::sample_light::SampleLight;

/// Number of edge rules that the shader holds, and of their nodes in total.
const RULES: usize = 6;
const NODES: usize = 64;

/// Invocations that share the receivers of a workgroup, each with a slice of the entries.
const SLICES: usize = 4;

/// Completes the text of a shader that sums over the entries of jobs: as [`kernel_shader`], and what its workgroups do.
pub fn shader(text: &str) -> String {
    kernel_shader(&[include_str!("slices.wgsl"), text].concat())
}

/// Completes the text of a shader that uses these buffers: adds the shared code and the constants of the near-field
/// rule and of the workgroups, the same as on the processor.
pub fn kernel_shader(text: &str) -> String {
    let (three, [inner, outer]) = (THREE_POINTS, SIX_POINTS);
    let numbers = format!(
        "const LANES: u32 = {RECEIVERS}u;
const SLICES: u32 = {SLICES}u;
const WORKGROUP: u32 = {workgroup}u;
const CLUSTER: u32 = {CLUSTER}u;
const EDGE_RULES: u32 = {RULES}u;
const EDGE_NODES: u32 = {NODES}u;
const THREE_POINTS: vec2<f32> = vec2({:?}, {:?});
const INNER_OF_SIX: vec2<f32> = vec2({:?}, {:?});
const OUTER_OF_SIX: vec2<f32> = vec2({:?}, {:?});
const THREE_BEYOND2: f32 = {:?};
const PIECE_IS_POINT2: f32 = {:?};
const MOST_SPLITS: u32 = {MOST_SPLITS}u;
const SLIVER: f32 = {SLIVER:?};
",
        three.0,
        three.1,
        inner.0,
        inner.1,
        outer.0,
        outer.1,
        THREE_BEYOND * THREE_BEYOND,
        PIECE_IS_POINT * PIECE_IS_POINT,
        workgroup = RECEIVERS * SLICES,
    );
    [&numbers, include_str!("kernel.wgsl"), text].concat()
}

/// Completes the text of a shader that looks up radial tables whose segments are indexed by `bits` bits.
pub fn table_shader(bits: u32, text: &str) -> String {
    [&format!("const SHIFT: u32 = {bits}u;\n"), include_str!("radial_table.wgsl"), text].concat()
}

/// The place of a [`RadialTable`] among the segments of several.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
pub struct GpuTable {
    scale2: f32,
    bits: u32,
    first: u32,
    last: u32,
}

impl GpuTable {
    /// Appends the segments of a table.
    pub fn append<const BITS: u32>(table: &RadialTable<2, BITS>, all: &mut Vec<[Rgb; 2]>) -> Self {
        let (scale2, bits, segments) = table.segments();
        let first = all.len() as u32;
        all.extend(segments);
        Self { scale2, bits, first, last: (all.len() as u32).saturating_sub(first + 1) }
    }
}

/// Workgroups along the first axis at most, on every adapter; more go into further rows.
const WIDTH: u32 = 65_535;

/// Storage buffers that the shaders bind at once.
const STORAGE_BUFFERS: u32 = 12;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct GpuSettings {
    exact_below: f32,
    three_points_below: f32,
    terms: u32,
    pieces: u32,
    oriented: u32,
    narrow_mm: f32,
    padding: [u32; 2],
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct GpuRules {
    limits: [f32; 8],
    starts: [u32; 8],
    nodes: [[f32; 2]; NODES],
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct GpuMedium {
    real: [[f32; 4]; 3],
    image: [[f32; 4]; 3],
    polynomial: [[f32; 4]; 3],
    split2: f32,
    smooth2: f32,
    padding: [f32; 2],
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct GpuPatch {
    centre: [f32; 3],
    area: f32,
    radius: f32,
    first_facet: u32,
    end_facet: u32,
    padding: u32,
    normal: [f32; 3],
    more_padding: u32,
}

/// Samples, receivers, media and light.
pub struct SurfaceBuffers {
    device: Arc<Device>,
    layout: wgpu::BindGroupLayout,
    settings: GpuSettings,
    /// In the order of their bindings.
    buffers: [wgpu::Buffer; 10],
    count: u32,
    scale: f64,
    bind_group: wgpu::BindGroup,
}

/// Bindings of the buffers that change or are read elsewhere.
const SETTINGS: usize = 0;
const RULES_OF_EDGES: usize = 1;
const MEDIA: usize = 2;
const RECEIVERS_AT: usize = 5;
const RADIOSITY: usize = 6;
const IRRADIANCE: usize = 7;
const FIRST_PIECE: usize = 8;
const PIECES: usize = 9;

/// Geometry and settings that stay the same under every light and material.
pub struct Geometry<'a> {
    /// Facets of each sample: sample `i` has `facet_offsets[i]..facet_offsets[i + 1]` of the corners.
    pub facet_offsets: &'a [u32],
    /// Centre, area and radius of each sample.
    pub patches: &'a [Patch],
    /// Corners of the samples' facets.
    pub corners: &'a Corners,
    /// Points where radiosity is gathered.
    pub receivers: &'a Receivers,
    /// The near-field rule.
    pub near: NearField,
    /// Rules of the integrals along the edges of triangles.
    pub rules: &'static [EdgeRule],
    /// Basis functions of a far field; 0 without one.
    pub terms: usize,
}

impl SurfaceBuffers {
    /// Uploads the geometry and the settings.
    ///
    /// # Errors
    /// An adapter with too few or too small bindings (exit 5).
    pub fn new(device: &Arc<Device>, geometry: &Geometry) -> Result<Self> {
        let most = device.device.limits().max_storage_buffers_per_shader_stage;
        if most < STORAGE_BUFFERS {
            let name = &device.info.name;
            return Err(Error::unsupported(format!(
                "{name} binds {most} storage buffers where {STORAGE_BUFFERS} are needed; use --device cpu"
            )));
        }
        let Geometry { facet_offsets, patches, corners, receivers, near, rules, terms } = geometry;
        let settings = GpuSettings {
            exact_below: near.exact_below as f32,
            three_points_below: near.three_points_below as f32,
            terms: *terms as u32,
            pieces: 0,
            oriented: 0,
            narrow_mm: near.narrow_mm(patches) as f32,
            padding: [0; 2],
        };
        let patch = |(index, patch): (usize, &Patch)| GpuPatch {
            centre: patch.centre_mm.as_vec3().to_array(),
            area: patch.area_mm2 as f32,
            radius: patch.radius_mm as f32,
            first_facet: facet_offsets[index],
            end_facet: facet_offsets[index + 1],
            padding: 0,
            normal: (patch.cross_mm2 / patch.area_mm2.max(f64::MIN_POSITIVE)).as_vec3().to_array(),
            more_padding: 0,
        };
        let patches: Vec<GpuPatch> = patches.iter().enumerate().map(patch).collect();
        let positions: Vec<[f32; 4]> = receivers.positions.iter().map(|p| p.as_vec3().extend(0.0).to_array()).collect();
        let count = patches.len();
        // Two uniforms, then storage, in which the shaders write the radiosity.
        let kinds = [UNIFORM, UNIFORM, READ, READ, READ, READ, WRITE, READ, READ, READ];
        let layout = bind_group_layout(&device.device, "surface", &kinds);
        let buffers = [
            uniform(&device.device, "settings", bytemuck::bytes_of(&settings)),
            uniform(&device.device, "rules", bytemuck::bytes_of(&pack(rules)?)),
            device.storage::<GpuMedium>("media", &[GpuMedium::zeroed()])?,
            device.storage("samples", &patches)?,
            device.storage("corners of the facets", corners.values().as_flattened().as_flattened())?,
            device.storage("receivers", &positions)?,
            device.zeros("radiosity", 16 * receivers.len() as u64)?,
            device.zeros("irradiance", 16 * count as u64)?,
            device.zeros("first pieces", 4 * count as u64)?,
            device.zeros("pieces", 16)?,
        ];
        let bind_group = bind(&device.device, &layout, &buffers);
        let device = Arc::clone(device);
        Ok(Self { device, layout, settings, buffers, count: count as u32, scale: 1.0, bind_group })
    }

    /// Replaces the media; the far field, if there is one, begins at `split_mm`.
    ///
    /// # Errors
    /// More media than the adapter binds, or others than dipoles (exit 5).
    pub fn set_media(&mut self, media: &[MediumKernel], split_mm: Option<f64>) -> Result<()> {
        let media: Vec<GpuMedium> = media.iter().map(|m| medium(m, split_mm)).collect::<Result<_>>()?;
        self.replace(MEDIA, self.device.storage("media", &media)?);
        Ok(())
    }

    /// Replaces the rules of integrals along edges.
    ///
    /// # Errors
    /// More rules than the shaders hold (exit 4: a caller's mistake).
    pub fn set_rules(&mut self, rules: &[EdgeRule]) -> Result<()> {
        let packed = pack(rules)?;
        self.device.queue.write_buffer(&self.buffers[RULES_OF_EDGES], 0, bytemuck::bytes_of(&packed));
        Ok(())
    }

    /// Gives the receivers, which are those that there are, their normals and factors, where they have factors.
    ///
    /// # Errors
    /// More than the adapter binds (exit 5).
    pub fn orient(&mut self, receivers: &Receivers) -> Result<()> {
        let count = if receivers.factors.is_empty() { 0 } else { receivers.len() };
        let packed = |values: &[DVec3]| values.iter().map(|v| v.as_vec3().extend(0.0).to_array()).collect::<Vec<_>>();
        let mut all: Vec<[f32; 4]> = packed(&receivers.positions);
        if count > 0 {
            all.extend(packed(&receivers.normals));
            all.resize(2 * count, [0.0; 4]);
            all.extend(packed(&receivers.factors));
        }
        self.replace(RECEIVERS_AT, self.device.storage("receivers", &all)?);
        self.settings.oriented = count as u32;
        self.device.queue.write_buffer(&self.buffers[SETTINGS], 0, bytemuck::bytes_of(&self.settings));
        Ok(())
    }

    /// Replaces the light on the samples.
    ///
    /// # Errors
    /// More pieces than the adapter binds (exit 5).
    pub fn set_light(&mut self, light: &SampleLight) -> Result<()> {
        self.scale = light.unit();
        let samples = 0..self.count as usize;
        let scaled: Vec<[f32; 4]> = samples.map(|i| light.irradiance(i).as_vec3().extend(0.0).to_array()).collect();
        let mut first = vec![u32::MAX; self.count as usize];
        let mut packed: Vec<[f32; 4]> = Vec::new();
        for (patch, first) in first.iter_mut().enumerate() {
            let Some(of_patch) = light.pieces(patch) else { continue };
            *first = (packed.len() / 3) as u32;
            for (deviation, corners) in of_patch {
                let deviation = deviation.as_vec3().to_array();
                packed.extend(corners.iter().zip(deviation).map(|([x, y, z], e)| [*x, *y, *z, e]));
            }
        }
        let queue = self.device.queue.clone();
        queue.write_buffer(&self.buffers[IRRADIANCE], 0, bytemuck::cast_slice(&scaled));
        queue.write_buffer(&self.buffers[FIRST_PIECE], 0, bytemuck::cast_slice(&first));
        let bytes = 16 * packed.len() as u64;
        if bytes > self.buffers[PIECES].size() {
            let room = bytes.next_power_of_two().min(self.device.largest_binding()).max(bytes);
            self.replace(PIECES, self.device.zeros("pieces", room)?);
        }
        queue.write_buffer(&self.buffers[PIECES], 0, bytemuck::cast_slice(&packed));
        self.settings.pieces = light.most_pieces() as u32;
        queue.write_buffer(&self.buffers[SETTINGS], 0, bytemuck::bytes_of(&self.settings));
        Ok(())
    }

    /// Tells that the irradiance on the device is over another unit: a shader wrote it.
    pub fn set_unit(&mut self, unit: f64) {
        self.scale = unit;
    }

    fn replace(&mut self, binding: usize, buffer: wgpu::Buffer) {
        self.buffers[binding] = buffer;
        self.bind_group = bind(&self.device.device, &self.layout, &self.buffers);
    }

    /// The device that holds the buffers.
    pub fn device(&self) -> &Arc<Device> {
        &self.device
    }

    /// Irradiance of every sample over the scale, RGB and 0.
    pub fn irradiance(&self) -> &wgpu::Buffer {
        &self.buffers[IRRADIANCE]
    }

    /// Radiosity of every receiver over the scale, RGB and 0.
    pub fn radiosity(&self) -> &wgpu::Buffer {
        &self.buffers[RADIOSITY]
    }

    /// The radiosity as that of an evaluator with these receivers.
    pub fn held<'a>(&'a self, receivers: &'a Receivers) -> Held<'a> {
        let (device, radiosity) = (&self.device, self.radiosity());
        Held { device, radiosity, scale: self.scale, receiver_of_vertex: &receivers.of_vertex }
    }

    /// Layout of the first bind group.
    pub fn layout(&self) -> &wgpu::BindGroupLayout {
        &self.layout
    }

    /// The first bind group.
    pub fn bind_group(&self) -> &wgpu::BindGroup {
        &self.bind_group
    }
}

fn pack(rules: &[EdgeRule]) -> Result<GpuRules> {
    let mut packed = GpuRules { limits: [f32::MAX; 8], starts: [0; 8], nodes: [[0.0; 2]; NODES] };
    let fits = rules.len() <= RULES && rules.iter().map(|(_, nodes)| nodes.len()).sum::<usize>() <= NODES;
    let (Some((_, last)), true) = (rules.last(), fits) else {
        return Err(Error::runtime("the rules for edges do not fit the shader"));
    };
    let mut at = 0;
    // The shader looks at all places: the last rule stands for those that are not there.
    for place in 0..=RULES {
        packed.starts[place] = at as u32;
        let Some((limit, nodes)) = rules.get(place) else { continue };
        packed.limits[place] = limit.min(f32::MAX);
        for node in *nodes {
            packed.nodes[at] = [node.0, node.1];
            at += 1;
        }
    }
    debug_assert!(!last.is_empty());
    Ok(packed)
}

fn medium(medium: &MediumKernel, split_mm: Option<f64>) -> Result<GpuMedium> {
    let poles = medium.poles().ok_or_else(|| Error::unsupported("the shaders sum dipoles alone; use --device cpu"))?;
    let rgb = |value: &dyn Fn(usize) -> f64| -> [f32; 4] {
        std::array::from_fn(|channel| if channel < 3 { value(channel) as f32 } else { 0.0 })
    };
    let term = |which: usize| {
        [
            rgb(&|c| poles[c][which].weight),
            rgb(&|c| poles[c][which].z_mm.powi(2)),
            rgb(&|c| poles[c][which].sigma_per_mm),
        ]
    };
    let polynomials = split_mm.map_or([[0.0; 3]; 3], |split_mm| medium.softened(split_mm).map(|far| far.polynomial()));
    let shallowest = medium.smooth_mm();
    Ok(GpuMedium {
        real: term(0),
        image: term(1),
        polynomial: [0, 1, 2].map(|power| rgb(&|c| polynomials[c][power])),
        split2: split_mm.map_or(f32::MAX, |split_mm| (split_mm * split_mm) as f32),
        smooth2: (shallowest * shallowest) as f32,
        padding: [0.0; 2],
    })
}

/// A uniform buffer with these contents.
pub fn uniform(device: &wgpu::Device, label: &str, contents: &[u8]) -> wgpu::Buffer {
    device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
        label: Some(label),
        contents,
        usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
    })
}

/// A uniform buffer.
pub const UNIFORM: wgpu::BufferBindingType = wgpu::BufferBindingType::Uniform;
/// A storage buffer that a shader reads.
pub const READ: wgpu::BufferBindingType = wgpu::BufferBindingType::Storage { read_only: true };
/// A storage buffer that a shader writes.
pub const WRITE: wgpu::BufferBindingType = wgpu::BufferBindingType::Storage { read_only: false };

/// A layout of buffers for compute shaders, bound from 0 on.
pub fn bind_group_layout(
    device: &wgpu::Device,
    label: &str,
    kinds: &[wgpu::BufferBindingType],
) -> wgpu::BindGroupLayout {
    let entry = |(binding, ty): (usize, &wgpu::BufferBindingType)| wgpu::BindGroupLayoutEntry {
        binding: binding as u32,
        visibility: wgpu::ShaderStages::COMPUTE,
        ty: wgpu::BindingType::Buffer { ty: *ty, has_dynamic_offset: false, min_binding_size: None },
        count: None,
    };
    let entries: Vec<_> = kinds.iter().enumerate().map(entry).collect();
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some(label), entries: &entries })
}

/// Whole buffers, bound from 0 on.
pub fn bind<'a>(
    device: &wgpu::Device,
    layout: &wgpu::BindGroupLayout,
    buffers: impl IntoIterator<Item = &'a wgpu::Buffer>,
) -> wgpu::BindGroup {
    let entry = |(binding, buffer): (usize, &'a wgpu::Buffer)| wgpu::BindGroupEntry {
        binding: binding as u32,
        resource: buffer.as_entire_binding(),
    };
    let entries: Vec<_> = buffers.into_iter().enumerate().map(entry).collect();
    device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries: &entries })
}

/// A compute pipeline of an entry point.
pub fn pipeline(
    device: &wgpu::Device,
    text: &str,
    entry: &str,
    layouts: [&wgpu::BindGroupLayout; 2],
) -> wgpu::ComputePipeline {
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(entry),
        source: wgpu::ShaderSource::Wgsl(text.into()),
    });
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some(entry),
        bind_group_layouts: &layouts.map(Some),
        ..Default::default()
    });
    device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(entry),
        layout: Some(&layout),
        module: &module,
        entry_point: Some(entry),
        compilation_options: wgpu::PipelineCompilationOptions::default(),
        cache: None,
    })
}

/// A stage of the evaluation: pipeline, buffers, and shards that fit the adapter's bindings, each with its workgroups.
pub(crate) struct ComputePass {
    pub(crate) pipeline: wgpu::ComputePipeline,
    pub(crate) bind_group: wgpu::BindGroup,
    pub(crate) shards: Vec<(wgpu::BindGroup, u32)>,
}

impl ComputePass {
    pub(crate) fn run(&self, device: &Device) {
        dispatch(device, &self.pipeline, &self.bind_group, &self.shards);
    }
}

/// Runs a pipeline once for each (bind group, number of workgroups), each a submission of its own.
pub fn dispatch<'a>(
    device: &Device,
    pipeline: &wgpu::ComputePipeline,
    first: &wgpu::BindGroup,
    shards: impl IntoIterator<Item = &'a (wgpu::BindGroup, u32)>,
) {
    for &(ref shard, count) in shards {
        let mut encoder = device.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, first, &[]);
            pass.set_bind_group(1, shard, &[]);
            pass.dispatch_workgroups(count.min(WIDTH), count.div_ceil(WIDTH), 1);
        }
        device.queue.submit([encoder.finish()]);
    }
}
