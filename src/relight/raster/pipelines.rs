//! Bindings and pipelines of the shaders.

use std::f64::consts::PI;

use super::canvas::{DEPTH_FORMAT, Finish};
use super::corners::{Corner, NONE};
use super::environment::LEVELS;
use super::lit::{ALBEDO_STEPS, Environments};
use super::pattern::{self, Pattern};
use super::shown::Shown;
use super::view::{ENVIRONMENTS, ERROR_COLOURS};
use crate::evaluate::device::Device;
use crate::render::eye::LEAST_COSINE_SHARE;

/// The pipelines that draw with one finish.
pub(super) struct Pipelines {
    pub(super) finish: Finish,
    pub(super) surface: wgpu::RenderPipeline,
    pub(super) wire: wgpu::RenderPipeline,
    pub(super) beside: wgpu::RenderPipeline,
}

/// The text of the shaders with the constants that the renderer and the tables have.
fn shader() -> String {
    let numbers = format!(
        "const PI = {PI:?};
const NONE = {NONE}u;
const LEAST_COSINE_SHARE = {LEAST_COSINE_SHARE:?};
const ALBEDO_STEPS = {ALBEDO_STEPS}u;
const LAST_LEVEL = {:?};
const ERROR_COLOURS = {}u;
const ENVIRONMENTS = {ENVIRONMENTS}u;
",
        (LEVELS - 1) as f32,
        ERROR_COLOURS.len()
    );
    [&numbers, include_str!("surface.wgsl"), &pattern::shader()].concat()
}

impl Pipelines {
    pub(super) fn new(device: &Device, layout: &wgpu::BindGroupLayout, finish: Finish) -> Self {
        let module = device.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("surface"),
            source: wgpu::ShaderSource::Wgsl(shader().into()),
        });
        let pipeline_layout = device.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("scene"),
            bind_group_layouts: &[Some(layout)],
            immediate_size: 0,
        });
        let corners = [Some(wgpu::VertexBufferLayout {
            array_stride: size_of::<Corner>() as u64,
            step_mode: wgpu::VertexStepMode::Vertex,
            attributes: &Corner::ATTRIBUTES,
        })];
        // Only the surface covers what lies behind it.
        let make = |name: &str, topology, buffers, covers: bool| {
            let depth = if covers { wgpu::CompareFunction::Greater } else { wgpu::CompareFunction::GreaterEqual };
            device.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some(name),
                layout: Some(&pipeline_layout),
                vertex: wgpu::VertexState {
                    module: &module,
                    entry_point: Some(&format!("{name}_corner")),
                    compilation_options: wgpu::PipelineCompilationOptions::default(),
                    buffers,
                },
                primitive: wgpu::PrimitiveState { topology, ..Default::default() },
                depth_stencil: Some(wgpu::DepthStencilState {
                    format: DEPTH_FORMAT,
                    depth_write_enabled: Some(covers),
                    depth_compare: Some(depth),
                    stencil: wgpu::StencilState::default(),
                    bias: wgpu::DepthBiasState::default(),
                }),
                multisample: wgpu::MultisampleState { count: finish.samples, ..Default::default() },
                fragment: Some(wgpu::FragmentState {
                    module: &module,
                    entry_point: Some(&format!("{name}_colour")),
                    compilation_options: wgpu::PipelineCompilationOptions::default(),
                    targets: &[Some(finish.format.into())],
                }),
                multiview_mask: None,
                cache: None,
            })
        };
        Self {
            finish,
            surface: make("surface", wgpu::PrimitiveTopology::TriangleList, &corners[..], true),
            wire: make("wire", wgpu::PrimitiveTopology::LineList, &corners, false),
            beside: make("beside", wgpu::PrimitiveTopology::TriangleList, &[], false),
        }
    }
}

/// Bindings 0 to 13 of the shaders.
pub(super) fn layout(device: &Device) -> wgpu::BindGroupLayout {
    let both = wgpu::ShaderStages::VERTEX_FRAGMENT;
    let (vertex, fragment) = (wgpu::ShaderStages::VERTEX, wgpu::ShaderStages::FRAGMENT);
    let buffer = |ty| wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None };
    let storage = buffer(wgpu::BufferBindingType::Storage { read_only: true });
    let texture = wgpu::BindingType::Texture {
        sample_type: wgpu::TextureSampleType::Float { filterable: true },
        view_dimension: wgpu::TextureViewDimension::D2Array,
        multisampled: false,
    };
    let sampler = wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering);
    let kinds = [
        (both, buffer(wgpu::BufferBindingType::Uniform)),
        (vertex, storage),
        (vertex, storage),
        (vertex, storage),
        (fragment, storage),
        (fragment, storage),
        (fragment, storage),
        (fragment, texture),
        (fragment, texture),
        (fragment, sampler),
        (fragment, buffer(wgpu::BufferBindingType::Uniform)),
        (fragment, texture),
        (fragment, sampler),
        (fragment, storage),
    ];
    let entries: Vec<wgpu::BindGroupLayoutEntry> = (0..)
        .zip(kinds)
        .map(|(binding, (visibility, ty))| wgpu::BindGroupLayoutEntry { binding, visibility, ty, count: None })
        .collect();
    let descriptor = wgpu::BindGroupLayoutDescriptor { label: Some("scene"), entries: &entries };
    device.device.create_bind_group_layout(&descriptor)
}

/// The resources of [`layout`].
pub(super) struct Bound {
    pub(super) uniform: wgpu::Buffer,
    pub(super) shown: Shown,
    pub(super) errors: wgpu::Buffer,
    pub(super) media: wgpu::Buffer,
    pub(super) albedo: wgpu::Buffer,
    pub(super) lamps: wgpu::Buffer,
    pub(super) wrap: wgpu::Sampler,
    pub(super) environments: Environments,
    pub(super) pattern: Pattern,
}

impl Bound {
    pub(super) fn group(&self, device: &Device, layout: &wgpu::BindGroupLayout) -> wgpu::BindGroup {
        let Self { uniform, shown, errors, media, albedo, lamps, wrap, environments, pattern } = self;
        let buffers = [uniform, &shown.radiosity, &shown.visibility, errors, media, albedo, lamps];
        let mut resources: Vec<wgpu::BindingResource> = buffers.iter().map(|b| b.as_entire_binding()).collect();
        resources.extend([
            wgpu::BindingResource::TextureView(&environments.glossy),
            wgpu::BindingResource::TextureView(&environments.backdrop),
            wgpu::BindingResource::Sampler(wrap),
            pattern.uniform.as_entire_binding(),
            wgpu::BindingResource::TextureView(&pattern.pictures),
            wgpu::BindingResource::Sampler(&pattern.repeat),
            pattern.coats.as_entire_binding(),
        ]);
        let entries: Vec<wgpu::BindGroupEntry> =
            (0..).zip(resources).map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource }).collect();
        device.device.create_bind_group(&wgpu::BindGroupDescriptor { label: Some("scene"), layout, entries: &entries })
    }
}
