//! Textures of the object as the shaders read them.

use glam::{DVec2, DVec3};

use super::memory::{Level, filled, layered, sampler};
use super::view::{finite, finite3};
use crate::error::Result;
use crate::evaluate::device::Device;
use crate::math::srgb::srgb_from_linear;
use crate::parallel::*;
use crate::render::texture::Texture;
use crate::render::texture::marble::{ACROSS, SHIFT};
use crate::render::texture::noise::MEAN_ABSOLUTE_NOISE;
use crate::render::texture::picture::{Coat, Picture};

/// A texture as declared in `texture.wgsl`.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct PatternUniform {
    base: [f32; 3],
    veins_per_mm: f32,
    veins: [f32; 3],
    turbulence: f32,
    sharpness: f32,
    mean_vein: f32,
    kind: u32,
    octaves: u32,
    seed: u32,
    unused: [u32; 3],
}

impl PatternUniform {
    fn of(texture: Option<&Texture>) -> Self {
        let marble = match texture {
            None => return Self::default(),
            Some(Texture::Picture(_)) => return Self { kind: 2, ..Self::default() },
            Some(Texture::Marble(marble)) => marble,
        };
        let spec = &marble.spec;
        Self {
            base: finite3(spec.base),
            veins_per_mm: finite(marble.scale_mm.recip()),
            veins: finite3(spec.veins),
            turbulence: finite(spec.turbulence),
            sharpness: finite(spec.sharpness),
            mean_vein: finite(marble.mean_vein()),
            kind: 1,
            octaves: spec.octaves,
            seed: spec.seed,
            unused: [0; 3],
        }
    }
}

/// The albedo of a material as declared in `texture.wgsl`.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct CoatAlbedo {
    factor: [f32; 4],
    place: [f32; 4],
}

impl CoatAlbedo {
    fn of(coat: &Coat) -> Self {
        let [r, g, b] = finite3(coat.factor);
        match coat.picture {
            None => Self { factor: [r, g, b, -1.0], place: [0.0; 4] },
            Some(placed) => Self {
                factor: [r, g, b, placed.index as f32],
                place: [placed.scale.x, placed.scale.y, placed.offset.x, placed.offset.y].map(finite),
            },
        }
    }
}

/// The bound texture.
pub(super) struct Pattern {
    pub(super) uniform: wgpu::Buffer,
    pub(super) pictures: wgpu::TextureView,
    pub(super) repeat: wgpu::Sampler,
    pub(super) coats: wgpu::Buffer,
}

impl Pattern {
    /// A white texture, for a scene without one.
    pub(super) fn new(device: &Device) -> Result<Self> {
        let usage = wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST;
        let uniform = filled(device, "texture", &[PatternUniform::default()], usage)?;
        let repeat = sampler(device, "texture", wgpu::AddressMode::Repeat);
        let white = MipLevel { width: 1, height: 1, rgb: vec![[1.0; 3]] };
        let coats = device.storage("coats", &[CoatAlbedo::default()])?;
        Ok(Self { uniform, pictures: uploaded(device, &[vec![white]]), repeat, coats })
    }

    /// Replaces the texture; the bind groups must be renewed.
    pub(super) fn set(&mut self, device: &Device, texture: Option<&Texture>) -> Result<()> {
        if let Some(Texture::Picture(texture)) = texture {
            let entries: Vec<CoatAlbedo> = texture.coats.iter().map(CoatAlbedo::of).collect();
            self.coats = device.storage("coats", &entries)?;
            let limit = device.device.limits().max_texture_dimension_2d as usize;
            let layers = layers(&texture.pictures, limit);
            if !layers.is_empty() {
                self.pictures = uploaded(device, &layers);
            }
        }
        device.queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&PatternUniform::of(texture)));
        Ok(())
    }
}

/// One mip level of a picture, linear.
struct MipLevel {
    width: usize,
    height: usize,
    rgb: Vec<[f32; 3]>,
}

impl MipLevel {
    /// The level at half the size along each side, rounded down as for textures; each pixel is the mean of the pixels
    /// it covers.
    fn halved(&self) -> Self {
        let (width, height) = ((self.width / 2).max(1), (self.height / 2).max(1));
        let spans =
            |size: usize, of: usize| -> Vec<Vec<(usize, f32)>> { (0..size).map(|i| covered(i, size, of)).collect() };
        let (columns, rows) = (spans(width, self.width), spans(height, self.height));
        let mut rgb = Vec::with_capacity(width * height);
        for row in &rows {
            for column in &columns {
                let mut sum = [0.0f32; 3];
                for (y, share_y) in row {
                    for (x, share_x) in column {
                        let pixel = self.rgb[y * self.width + x];
                        (0..3).for_each(|c| sum[c] += pixel[c] * share_x * share_y);
                    }
                }
                rgb.push(sum);
            }
        }
        Self { width, height, rgb }
    }

    /// A picture at a size that is not smaller than its own; unchanged at its own size.
    fn enlarged(picture: &Picture, [width, height]: [usize; 2]) -> Self {
        let at = |i: usize| {
            let (x, y) = ((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            let uv = DVec2::new(x / width as f64, 1.0 - y / height as f64);
            picture.albedo(uv).as_vec3().to_array()
        };
        Self { width, height, rgb: (0..width * height).into_par_iter().map(at).collect() }
    }

    /// The level with all smaller ones, down to one pixel; the largest is within `limit`.
    fn pyramid(self, limit: usize) -> Vec<Self> {
        let mut largest = self;
        while largest.width.max(largest.height) > limit.max(1) {
            largest = largest.halved();
        }
        let mut levels = vec![largest];
        while let Some(next) = levels.last().filter(|l| l.width.max(l.height) > 1).map(Self::halved) {
            levels.push(next);
        }
        levels
    }
}

/// Pixels of a line of `of` pixels that pixel `index` of a line of `size` covers, with their shares.
fn covered(index: usize, size: usize, of: usize) -> Vec<(usize, f32)> {
    let step = of as f64 / size as f64;
    let (from, to) = (index as f64 * step, (index + 1) as f64 * step);
    let share = |i: usize| ((to.min((i + 1) as f64) - from.max(i as f64)).max(0.0) / step) as f32;
    (from as usize..(to.ceil() as usize).min(of)).map(|i| (i, share(i))).filter(|(_, share)| *share > 0.0).collect()
}

/// The levels of each picture; the largest ones have equal sizes, as the layers of a texture must.
fn layers(pictures: &[Picture], limit: usize) -> Vec<Vec<MipLevel>> {
    let sizes = pictures.iter().map(Picture::size);
    let size = sizes.fold([1, 1], |[width, height], [w, h]| [width.max(w), height.max(h)]);
    pictures.iter().map(|picture| MipLevel::enlarged(picture, size).pyramid(limit)).collect()
}

/// A texture array of one layer for each picture.
fn uploaded(device: &Device, layers: &[Vec<MipLevel>]) -> wgpu::TextureView {
    let code = |c: f32| (255.0 * srgb_from_linear(f64::from(c.clamp(0.0, 1.0)))).round() as u8;
    let level = |level: &MipLevel| Level {
        width: level.width,
        height: level.height,
        texels: level.rgb.iter().map(|[r, g, b]| [code(*r), code(*g), code(*b), 255]).collect(),
    };
    let layers: Vec<Vec<Level>> = layers.iter().map(|levels| levels.iter().map(level).collect()).collect();
    layered(device, "texture", wgpu::TextureFormat::Rgba8UnormSrgb, &layers)
}

/// The text of `texture.wgsl` with the constants of the renderer's noise and marble.
pub(super) fn shader() -> String {
    let text = |v: DVec3| format!("vec3f({:?}, {:?}, {:?})", v.x, v.y, v.z);
    let numbers = format!(
        "const MEAN_ABSOLUTE_NOISE = {MEAN_ABSOLUTE_NOISE:?};
const ACROSS = {};
const SHIFT = {};
",
        text(ACROSS),
        text(SHIFT)
    );
    [&numbers, include_str!("texture.wgsl")].concat()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::math::random::uniform;
    use crate::render::texture::marble::Marble;
    use crate::render::texture::noise::noise;
    use crate::render::texture::spec::MarbleSpec;

    /// Albedo and noise at each place; the fourth number is the width of a pixel.
    const EVALUATE: &str = "
        @group(0) @binding(0) var<storage, read> places: array<vec4f>;
        @group(0) @binding(1) var<storage, read_write> found: array<vec4f>;
        @compute @workgroup_size(64)
        fn evaluate(@builtin(global_invocation_id) id: vec3u) {
            if id.x < arrayLength(&places) {
                let place = places[id.x];
                found[id.x] = vec4f(marble(place.xyz, place.w), noise(place.xyz, pattern.seed));
            }
        }";

    fn evaluated(device: &Device, pattern: &Pattern, places: &[[f32; 4]]) -> Vec<[f32; 4]> {
        let module = device.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: None,
            source: wgpu::ShaderSource::Wgsl((shader() + EVALUATE).into()),
        });
        let pipeline = device.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: None,
            layout: None,
            module: &module,
            entry_point: Some("evaluate"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            cache: None,
        });
        let places_there = device.storage("places", places).unwrap();
        let found = device.zeros("found", 16 * places.len() as u64).unwrap();
        let bindings = device.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &pipeline.get_bind_group_layout(0),
            entries: &[(0, &places_there), (1, &found), (10, &pattern.uniform)]
                .map(|(binding, buffer)| wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() }),
        });
        let mut encoder = device.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            pass.set_pipeline(&pipeline);
            pass.set_bind_group(0, &bindings, &[]);
            pass.dispatch_workgroups(places.len().div_ceil(64) as u32, 1, 1);
        }
        device.queue.submit([encoder.finish()]);
        bytemuck::pod_collect_to_vec(&device.read(&found, 16 * places.len() as u64).unwrap())
    }

    #[test]
    fn shaders_have_the_same_noise_and_marble() {
        let device = match Device::open() {
            Ok(device) => device,
            Err(error) => return println!("SKIPPED: {error}"),
        };
        let mut pattern = Pattern::new(&device).unwrap();
        let coordinate = |i: u64, d: u64| (30.0 * (uniform(3, i, d) - 0.5)) as f32;
        let mut places: Vec<[f32; 4]> =
            (0..8192).map(|i| [coordinate(i, 0), coordinate(i, 1), coordinate(i, 2), 1e-3]).collect();
        // Lattice points, and pixels that see no vein.
        places.extend((0..64).map(|i| [i as f32 - 32.0, 3.0, -7.0, 1e-3]));
        places.extend((0..64).map(|i| [coordinate(i, 5), 0.0, 0.0, 1e4]));
        let narrow = MarbleSpec { sharpness: 40.0, octaves: 10, seed: u32::MAX, ..MarbleSpec::default() };
        let planes = MarbleSpec { turbulence: 0.0, scale_mm: Some(0.7), ..MarbleSpec::default() };
        for spec in [MarbleSpec::default(), narrow, planes] {
            let marble = Marble::new(spec, 50.0).unwrap();
            pattern.set(&device, Some(&Texture::Marble(marble))).unwrap();
            let mut worst = [0.0f64; 2];
            for (place, found) in places.iter().zip(evaluated(&device, &pattern, &places)) {
                let at = DVec3::new(place[0].into(), place[1].into(), place[2].into());
                let seen = if place[3] < 1.0 {
                    marble.albedo(at)
                } else {
                    spec.base + (spec.veins - spec.base) * marble.mean_vein()
                };
                for (c, found) in found.iter().take(3).enumerate() {
                    worst[0] = worst[0].max((f64::from(*found) - seen[c]).abs());
                }
                worst[1] = worst[1].max((f64::from(found[3]) - noise(at, spec.seed)).abs());
            }
            println!("albedo {:.1e}, noise {:.1e} on {}", worst[0], worst[1], device.describe());
            assert!(worst[0] < 1e-3 && worst[1] < 1e-5, "{worst:?}");
        }
    }

    #[test]
    fn smaller_sizes_of_a_picture_keep_its_mean() {
        for (width, height) in [(1, 1), (8, 4), (7, 5), (1, 9), (640, 3)] {
            let rgb: Vec<[f32; 3]> =
                (0..width * height).map(|i| std::array::from_fn(|c| uniform(8, i as u64, c as u64) as f32)).collect();
            let mean = |rgb: &[[f32; 3]], c: usize| rgb.iter().map(|p| f64::from(p[c])).sum::<f64>() / rgb.len() as f64;
            let picture = Picture::new(width, height, rgb.clone()).unwrap();
            let all = MipLevel::enlarged(&picture, [width, height]).pyramid(100);
            assert!(all[0].width <= 100 && all.last().is_some_and(|l| (l.width, l.height) == (1, 1)));
            for (larger, level) in all.iter().zip(&all[1..]) {
                assert_eq!((level.width, level.height), ((larger.width / 2).max(1), (larger.height / 2).max(1)));
            }
            for level in &all {
                assert_eq!(level.rgb.len(), level.width * level.height);
                assert!((0..3).all(|c| (mean(&level.rgb, c) - mean(&rgb, c)).abs() < 1e-4), "{width} {height}");
            }
        }
    }

    #[test]
    fn pictures_of_other_sizes_become_layers_of_one() {
        let grey = |width: usize, height: usize, value: f32| {
            Picture::new(width, height, vec![[value; 3]; width * height]).unwrap()
        };
        let all = layers(&[grey(3, 8, 0.25), grey(6, 2, 0.75)], 4096);
        for (levels, value) in all.iter().zip([0.25, 0.75]) {
            assert_eq!(
                levels.iter().map(|l| (l.width, l.height)).collect::<Vec<_>>(),
                [(6, 8), (3, 4), (1, 2), (1, 1)]
            );
            assert!(levels.iter().flat_map(|l| &l.rgb).all(|p| (p[0] - value).abs() < 1e-6));
        }
        assert!(layers(&[], 10).is_empty());
    }
}
