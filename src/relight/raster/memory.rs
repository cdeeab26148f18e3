//! Buffers, textures and samplers with their contents.

use wgpu::util::DeviceExt;

use crate::error::{Error, Result};
use crate::evaluate::device::Device;
use crate::render::camera::Resolution;

/// A buffer with these contents, never empty.
pub(super) fn filled<T: bytemuck::NoUninit>(
    device: &Device,
    label: &str,
    values: &[T],
    usage: wgpu::BufferUsages,
) -> Result<wgpu::Buffer> {
    let bytes: &[u8] = bytemuck::cast_slice(values);
    let limit = device.device.limits().max_buffer_size;
    if bytes.len() as u64 > limit {
        return Err(Error::unsupported(format!(
            "{label}: {} MiB where {} holds {} MiB at most; use --device cpu",
            bytes.len() >> 20,
            device.info.name,
            limit >> 20
        )));
    }
    // Room for one element of any type.
    let contents = if bytes.is_empty() { &[0; 64] } else { bytes };
    Ok(device.device.create_buffer_init(&wgpu::util::BufferInitDescriptor { label: Some(label), contents, usage }))
}

/// A two-dimensional texture without mipmaps.
pub(super) fn descriptor(
    label: &str,
    resolution: Resolution,
    format: wgpu::TextureFormat,
    samples: u32,
    usage: wgpu::TextureUsages,
) -> wgpu::TextureDescriptor<'_> {
    wgpu::TextureDescriptor {
        label: Some(label),
        size: wgpu::Extent3d {
            width: resolution.width as u32,
            height: resolution.height as u32,
            depth_or_array_layers: 1,
        },
        mip_level_count: 1,
        sample_count: samples,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage,
        view_formats: &[],
    }
}

/// One mip level of a layer, row by row.
pub(super) struct Level {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) texels: Vec<[u8; 4]>,
}

/// A texture array of these layers of one size, each with its levels, the largest first.
pub(super) fn layered(
    device: &Device,
    label: &str,
    format: wgpu::TextureFormat,
    layers: &[Vec<Level>],
) -> wgpu::TextureView {
    let first = layers.first().map_or(&[] as &[Level], Vec::as_slice);
    let (width, height) = first.first().map_or((1, 1), |level| (level.width, level.height));
    let usage = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST;
    let descriptor = descriptor(label, Resolution { width, height }, format, 1, usage);
    let texture = device.device.create_texture(&wgpu::TextureDescriptor {
        // A single layer is no array to the OpenGL backend.
        size: wgpu::Extent3d { depth_or_array_layers: layers.len().max(2) as u32, ..descriptor.size },
        mip_level_count: first.len().max(1) as u32,
        ..descriptor
    });
    for (layer, levels) in layers.iter().enumerate() {
        for (index, level) in levels.iter().enumerate() {
            let (width, height) = (level.width as u32, level.height as u32);
            let target = wgpu::TexelCopyTextureInfo {
                texture: &texture,
                mip_level: index as u32,
                origin: wgpu::Origin3d { x: 0, y: 0, z: layer as u32 },
                aspect: wgpu::TextureAspect::All,
            };
            let (bytes_per_row, rows_per_image) = (Some(4 * width), Some(height));
            let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row, rows_per_image };
            let size = wgpu::Extent3d { width, height, depth_or_array_layers: 1 };
            device.queue.write_texture(target, level.texels.as_flattened(), layout, size);
        }
    }
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..Default::default()
    })
}

/// A sampler that interpolates, between levels as well, and repeats sideways.
pub(super) fn sampler(device: &Device, label: &str, upwards: wgpu::AddressMode) -> wgpu::Sampler {
    device.device.create_sampler(&wgpu::SamplerDescriptor {
        label: Some(label),
        address_mode_u: wgpu::AddressMode::Repeat,
        address_mode_v: upwards,
        mag_filter: wgpu::FilterMode::Linear,
        min_filter: wgpu::FilterMode::Linear,
        mipmap_filter: wgpu::MipmapFilterMode::Linear,
        ..Default::default()
    })
}
