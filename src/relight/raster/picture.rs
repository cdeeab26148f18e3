//! Off-screen pictures, read back as linear radiance.

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
            .map(|texel| std::array::from_fn(|c| from_half(u16::from_le_bytes([texel[2 * c], texel[2 * c + 1]]))))
            .collect();
        Ok(LinearPicture { resolution, pixels })
    }
}

/// The value of a half float (IEEE 754 binary16).
fn from_half(bits: u16) -> f32 {
    let magnitude = match (bits >> 10 & 31, bits & 1023) {
        (0, fraction) => f32::from(fraction) / 16_777_216.0,
        (31, 0) => f32::INFINITY,
        (31, _) => f32::NAN,
        (exponent, fraction) => f32::from_bits((u32::from(exponent) + 112) << 23 | u32::from(fraction) << 13),
    };
    if bits >> 15 == 1 { -magnitude } else { magnitude }
}

#[cfg(test)]
mod tests {
    use super::from_half;

    #[test]
    fn half_floats_have_known_values() {
        let known =
            [(0, 0.0), (0x3c00, 1.0), (0xc000, -2.0), (0x7bff, 65504.0), (1, 5.960_464_5e-8), (0x3555, 0.333_251_95)];
        for (bits, value) in known {
            assert_eq!(from_half(bits), value);
        }
        assert!(from_half(0x7e00).is_nan() && from_half(0x7c00) == f32::INFINITY);
    }
}
