//! The auxiliary textures to which a frame is drawn, and the format of its pixels.

use super::memory::descriptor;
use crate::error::{Error, Result};
use crate::evaluate::device::Device;
use crate::render::camera::Resolution;

/// Format of the depth, which is reversed, so that infinity is 0.
pub(super) const DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

/// Format of pictures off the screen.
const LINEAR_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;

/// Format, samples and encoding of pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Finish {
    /// Format of the texture that is drawn to.
    pub format: wgpu::TextureFormat,
    /// Samples per pixel, 1 or 4.
    pub samples: u32,
    /// Whether colours are encoded as sRGB and clamped to [0, 1]; linear up to the range of half floats otherwise.
    pub srgb: bool,
}

impl Finish {
    /// Finish of pictures that are read back: linear half floats and four samples per pixel.
    pub const PICTURE: Self = Self { format: LINEAR_FORMAT, samples: 4, srgb: false };
}

/// The textures to which a frame is drawn, besides the one that is shown.
pub struct Canvas {
    pub(super) resolution: Resolution,
    pub(super) finish: Finish,
    pub(super) depth: wgpu::TextureView,
    /// The multisampled texture, which is resolved into the shown one; none for one sample per pixel.
    pub(super) many: Option<wgpu::TextureView>,
}

impl Canvas {
    /// Textures of a size.
    ///
    /// # Errors
    /// A picture larger than the adapter has (exit 5).
    pub fn new(device: &Device, resolution: Resolution, finish: Finish) -> Result<Self> {
        let limit = device.device.limits().max_texture_dimension_2d as usize;
        if resolution.width.max(resolution.height) > limit {
            return Err(Error::unsupported(format!(
                "{resolution} pixels where {} draws {limit} along a side at most; \
                 use a smaller --resolution or --device cpu",
                device.info.name
            )));
        }
        let texture = |label, format| {
            let descriptor =
                descriptor(label, resolution, format, finish.samples, wgpu::TextureUsages::RENDER_ATTACHMENT);
            device.device.create_texture(&descriptor).create_view(&wgpu::TextureViewDescriptor::default())
        };
        Ok(Self {
            resolution,
            finish,
            depth: texture("depth", DEPTH_FORMAT),
            many: (finish.samples > 1).then(|| texture("samples", finish.format)),
        })
    }
}
