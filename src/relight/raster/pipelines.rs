//! Bindings and pipelines of the shaders.

use super::canvas::{DEPTH_FORMAT, Finish};
use super::corners::Corner;
use super::lit::Environments;
use super::pattern::Pattern;
use crate::evaluate::device::Device;

/// The pipelines that draw with one finish.
pub(super) struct Pipelines {
    pub(super) finish: Finish,
    pub(super) surface: wgpu::RenderPipeline,
    pub(super) wire: wgpu::RenderPipeline,
    pub(super) beside: wgpu::RenderPipeline,
}

/// The functions of the shader, the primitives and the depth test of one pipeline.
struct PipelineVariant<'a> {
    label: &'a str,
    vertex: &'a str,
    fragment: &'a str,
    topology: wgpu::PrimitiveTopology,
    corners: bool,
    depth_writes: bool,
    depth: wgpu::CompareFunction,
}

impl Pipelines {
    pub(super) fn new(device: &Device, layout: &wgpu::BindGroupLayout, finish: Finish) -> Self {
        let module = device.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("surface"),
            source: wgpu::ShaderSource::Wgsl(
                concat!(include_str!("surface.wgsl"), include_str!("texture.wgsl")).into(),
            ),
        });
        let pipeline_layout = device.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("scene"),
            bind_group_layouts: &[Some(layout)],
            immediate_size: 0,
        });
        let make = |variant: PipelineVariant| pipeline(device, &module, &pipeline_layout, finish, &variant);
        let surface = make(PipelineVariant {
            label: "surface",
            vertex: "surface_corner",
            fragment: "surface_colour",
            topology: wgpu::PrimitiveTopology::TriangleList,
            corners: true,
            depth_writes: true,
            depth: wgpu::CompareFunction::Greater,
        });
        let wire = make(PipelineVariant {
            label: "wires",
            vertex: "wire_corner",
            fragment: "wire_colour",
            topology: wgpu::PrimitiveTopology::LineList,
            corners: true,
            depth_writes: false,
            depth: wgpu::CompareFunction::GreaterEqual,
        });
        let beside = make(PipelineVariant {
            label: "beside",
            vertex: "beside_corner",
            fragment: "beside_colour",
            topology: wgpu::PrimitiveTopology::TriangleList,
            corners: false,
            depth_writes: false,
            depth: wgpu::CompareFunction::GreaterEqual,
        });
        Self { finish, surface, wire, beside }
    }
}

fn pipeline(
    device: &Device,
    module: &wgpu::ShaderModule,
    layout: &wgpu::PipelineLayout,
    finish: Finish,
    variant: &PipelineVariant,
) -> wgpu::RenderPipeline {
    let corners = [Some(wgpu::VertexBufferLayout {
        array_stride: size_of::<Corner>() as u64,
        step_mode: wgpu::VertexStepMode::Vertex,
        attributes: &Corner::ATTRIBUTES,
    })];
    device.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(variant.label),
        layout: Some(layout),
        vertex: wgpu::VertexState {
            module,
            entry_point: Some(variant.vertex),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: if variant.corners { &corners } else { &[] },
        },
        primitive: wgpu::PrimitiveState { topology: variant.topology, ..Default::default() },
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTH_FORMAT,
            depth_write_enabled: Some(variant.depth_writes),
            depth_compare: Some(variant.depth),
            stencil: wgpu::StencilState::default(),
            bias: wgpu::DepthBiasState::default(),
        }),
        multisample: wgpu::MultisampleState { count: finish.samples, ..Default::default() },
        fragment: Some(wgpu::FragmentState {
            module,
            entry_point: Some(variant.fragment),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            targets: &[Some(finish.format.into())],
        }),
        multiview_mask: None,
        cache: None,
    })
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

/// The resources of [`layout`]; `buffers` are bindings 0 to 6.
pub(super) fn bindings(
    device: &Device,
    layout: &wgpu::BindGroupLayout,
    buffers: [&wgpu::Buffer; 7],
    environments: &Environments,
    wrap: &wgpu::Sampler,
    pattern: &Pattern,
) -> wgpu::BindGroup {
    let mut resources: Vec<wgpu::BindingResource> = buffers.iter().map(|b| b.as_entire_binding()).collect();
    resources.push(wgpu::BindingResource::TextureView(&environments.glossy));
    resources.push(wgpu::BindingResource::TextureView(&environments.backdrop));
    resources.push(wgpu::BindingResource::Sampler(wrap));
    resources.push(pattern.uniform.as_entire_binding());
    resources.push(wgpu::BindingResource::TextureView(&pattern.pictures));
    resources.push(wgpu::BindingResource::Sampler(&pattern.repeat));
    resources.push(pattern.coats.as_entire_binding());
    let entries: Vec<wgpu::BindGroupEntry> =
        (0..).zip(resources).map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource }).collect();
    device.device.create_bind_group(&wgpu::BindGroupDescriptor { label: Some("scene"), layout, entries: &entries })
}
