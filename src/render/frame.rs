//! Rendered pictures, and the rendering of a lit scene.

pub use super::settings::{
    DEFAULT_OPAQUE, DEFAULT_SAMPLES_PER_PIXEL, Ground, MAX_SAMPLES_PER_PIXEL, Pixel, RenderSettings, Specular,
};

use super::camera::Resolution;
use super::eye::{Counts, Renderer, TILE};
use super::settings::EMPTY;
use super::single::{Scattered, Single};
use crate::error::{Error, Result};
use crate::evaluate::Evaluator;
use crate::light::Light;
use crate::parallel::*;
use crate::progress::Progress;

/// Source of the single scattering in a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum SingleLayer {
    /// The picture has none.
    #[default]
    None,
    /// Interpolated from values at the vertices.
    PerVertex,
    /// Evaluated for each eye ray.
    TowardsEye,
}

/// Places where the exitance of a picture was evaluated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum ExitanceAt {
    /// At the vertices, interpolated linearly over each triangle.
    #[default]
    Vertices,
    /// At what each pixel sees.
    Pixels,
}

/// A rendered picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Size.
    pub resolution: Resolution,
    /// Pixels row by row from the top.
    pub pixels: Vec<Pixel>,
    /// Share of the hits that met a triangle from behind, which is black: the eye is inside, or the mesh is open or
    /// wound inwards.
    pub back_facing_share: f64,
    /// The meaning of [`Pixel::diffuse`].
    pub exitance: ExitanceAt,
    /// The meaning of [`Pixel::single`].
    pub single: SingleLayer,
    /// Whether [`Pixel::straight`] is that of the lights.
    pub has_straight: bool,
    /// Whether [`Pixel::albedo`] is that of a texture.
    pub textured: bool,
    /// Whether [`Pixel::matte`] is that of opaque parts.
    pub has_matte: bool,
    /// Whether [`Pixel::shadow`] is that of a ground.
    pub has_ground: bool,
}

/// Largest number of channels of a picture in a file.
const CHANNELS: u64 = 29;

/// Upper bound on the bytes for rendering and writing a picture of this size, without the scene.
pub fn memory_bytes(resolution: Resolution) -> u64 {
    // The pixels, a plane for each channel while a file is encoded, and its bytes.
    resolution.pixels() as u64 * (size_of::<Pixel>() as u64 + 4 * CHANNELS + 2 * 4 * CHANNELS)
}

/// Renders a scene with the exitance of its surface, and with single scattering where given.
///
/// Exit radiance is that of [`super::exit::ExitRadiance`] with the shading normal, for the medium of the part that is
/// hit; specular reflection that of [`super::highlight::Highlight`]: shadowed for directional, point and area lights,
/// unshadowed for environments and constant lights. Single scattering leaves at the shading normal too, and so does light that
/// crosses the object unscattered, where it is asked for. A texture
/// multiplies both kinds of scattered light, and no reflection. Opaque parts, which have no optical properties, are matte
/// plastic where an albedo is given: a diffuse base with shadows of all lights, below a boundary of index 1.5. Back sides are
/// black. The result does not depend on the number of threads.
///
/// Exitance of vertices is interpolated; other exitance is asked for at the points that eye rays see, those of a tile
/// together.
///
/// # Errors
/// An exitance that is not finite or does not fit the mesh, no samples per pixel or too many (exit 4: a caller's
/// mistake).
pub fn render<'a>(
    evaluator: &dyn Evaluator,
    scattered: impl Into<Scattered<'a>>,
    lights: &[Light],
    settings: &RenderSettings,
    progress: &dyn Progress,
) -> Result<Frame> {
    let (scene, bvh) = (evaluator.scene(), evaluator.bvh());
    let scattered = scattered.into();
    scattered.check(scene)?;
    check(settings)?;
    let resolution = settings.resolution;
    let exitance = match scattered.exitance.at_vertices() {
        Some(_) => ExitanceAt::Vertices,
        None => ExitanceAt::Pixels,
    };
    // Named after most of the work.
    let stage = match exitance {
        ExitanceAt::Vertices => "render",
        ExitanceAt::Pixels => "transfer",
    };
    progress.start(stage, resolution.pixels() as u64);
    let renderer = Renderer::new(scene, bvh, scattered, lights, settings);
    let mut pixels = vec![EMPTY; resolution.pixels()];
    let counts = pixels
        .par_chunks_mut(TILE * resolution.width)
        .enumerate()
        .map(|(row, pixels)| renderer.tile_row(row * TILE, pixels, progress))
        .reduce(Counts::default, Counts::add);
    progress.finish();
    if counts.not_finite() > 0 {
        return Err(Error::runtime(format!(
            "the exitance at {} of the points seen is not finite",
            counts.not_finite()
        )));
    }
    let single = match scattered.single {
        Single::None => SingleLayer::None,
        Single::PerVertex(_) => SingleLayer::PerVertex,
        Single::TowardsEye(_) => SingleLayer::TowardsEye,
    };
    let (back_facing_share, textured) = (counts.share(), scattered.texture.is_some());
    let has_matte = settings.opaque.is_some() && scene.parts.parts.iter().any(|part| !part.transfers());
    let has_ground = settings.ground != Ground::None;
    let has_straight = settings.straight;
    Ok(Frame { resolution, pixels, back_facing_share, exitance, single, has_straight, textured, has_matte, has_ground })
}

fn check(settings: &RenderSettings) -> Result<()> {
    if !(1..=MAX_SAMPLES_PER_PIXEL).contains(&settings.samples_per_pixel) {
        let asked = settings.samples_per_pixel;
        return Err(Error::command_line(format!(
            "{asked} samples per pixel: a number from 1 to {MAX_SAMPLES_PER_PIXEL} is needed"
        )));
    }
    Resolution::new(settings.resolution.width, settings.resolution.height).map(|_| ())
}
