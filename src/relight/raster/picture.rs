//! Off-screen pictures, read back as linear radiance.

use exr::prelude::f16;

use super::Raster;
use super::canvas::{Canvas, Finish};
use super::memory::descriptor;
use super::view::View;
use crate::error::{Error, Result};
use crate::evaluate::device::Device;
use crate::render::camera::Resolution;

/// A picture that can be read back.
pub struct Picture {
    canvas: Canvas,
    texture: wgpu::Texture,
    buffer: wgpu::Buffer,
    bytes_per_row: u32,
}

/// Linear exposed radiance, row by row from the top, and coverage (1 everywhere before an opaque background).
#[derive(Clone, Debug, PartialEq)]
pub struct LinearPicture {
    /// Size.
    pub resolution: Resolution,
    /// R, G, B, coverage.
    pub pixels: Vec<[f32; 4]>,
}

impl Picture {
    /// A picture of this resolution.
    ///
    /// # Errors
    /// A picture larger than the adapter has (exit 5).
    pub fn new(device: &Device, resolution: Resolution) -> Result<Self> {
        let canvas = Canvas::new(device, resolution, Finish::PICTURE)?;
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC;
        let texture =
            device.device.create_texture(&descriptor("picture", resolution, Finish::PICTURE.format, 1, usage));
        let bytes_per_row = (8 * resolution.width as u32).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let size = u64::from(bytes_per_row) * resolution.height as u64;
        if size > device.device.limits().max_buffer_size {
            return Err(Error::unsupported(format!("{resolution} pixels are too many for {}", device.info.name)));
        }
        let buffer = device.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("picture"),
            size,
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        Ok(Self { canvas, texture, buffer, bytes_per_row })
    }

    /// Draws a view and reads it back.
    ///
    /// # Errors
    /// A lost device (exit 4).
    pub fn take(&self, raster: &Raster, view: &View) -> Result<LinearPicture> {
        let device = raster.device();
        let target = self.texture.create_view(&wgpu::TextureViewDescriptor::default());
        let mut encoder = device.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        raster.draw(&mut encoder, view, &self.canvas, &target);
        encoder.copy_texture_to_buffer(
            self.texture.as_image_copy(),
            wgpu::TexelCopyBufferInfo {
                buffer: &self.buffer,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(self.bytes_per_row),
                    rows_per_image: None,
                },
            },
            self.texture.size(),
        );
        device.queue.submit([encoder.finish()]);
        let bytes = device.read(&self.buffer, self.buffer.size())?;
        let resolution = self.canvas.resolution;
        let pixels = bytes
            .chunks_exact(self.bytes_per_row as usize)
            .flat_map(|row| row[..8 * resolution.width].chunks_exact(8))
            .map(|texel| std::array::from_fn(|c| f16::from_le_bytes([texel[2 * c], texel[2 * c + 1]]).to_f32()))
            .collect();
        Ok(LinearPicture { resolution, pixels })
    }
}
