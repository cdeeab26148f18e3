//! Rendering: what a picture is made of, and the way from a lit scene to one.

use rayon::prelude::*;

use super::background::Background;
use super::camera::{Camera, Resolution};
use super::exit::ExitFresnel;
use super::eye::{Counts, Renderer, TILE};
use super::single::{Exitance, Single};
use super::specular::Roughness;
use crate::error::{Error, Result};
use crate::evaluate::Evaluator;
use crate::light::Light;
use crate::progress::Progress;

/// Eye rays through a pixel where none are asked for.
pub const DEFAULT_SAMPLES_PER_PIXEL: u32 = 16;
/// Most eye rays through a pixel.
pub const MAX_SAMPLES_PER_PIXEL: u32 = 1 << 14;

/// Specular reflection of the lights by translucent parts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Specular {
    /// None.
    Off,
    /// A rough dielectric boundary with the index of refraction of the medium (see [`super::specular`]).
    Rough(Roughness),
}

impl Specular {
    /// Of the boundary, if it reflects.
    pub fn roughness(self) -> Option<Roughness> {
        match self {
            Self::Off => None,
            Self::Rough(roughness) => Some(roughness),
        }
    }
}

impl Default for Specular {
    fn default() -> Self {
        Self::Rough(Roughness::default())
    }
}

/// What to render beside the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RenderSettings {
    /// The eye.
    pub camera: Camera,
    /// Size of the picture.
    pub resolution: Resolution,
    /// Eye rays through a pixel: stratified over the pixel's square, all with the same weight (a box filter).
    pub samples_per_pixel: u32,
    /// How the exit Fresnel factor is normalised.
    pub exit_fresnel: ExitFresnel,
    /// What is seen beside the object.
    pub background: Background,
    /// What the boundary reflects.
    pub specular: Specular,
    /// The radiance that will be white where the picture is shown: what single eye rays have above it goes into
    /// [`Pixel::glare`]. Infinite where that is not known.
    pub white: f64,
}

impl RenderSettings {
    /// The defaults for a camera and a size.
    pub fn new(camera: Camera, resolution: Resolution) -> Self {
        Self {
            camera,
            resolution,
            samples_per_pixel: DEFAULT_SAMPLES_PER_PIXEL,
            exit_fresnel: ExitFresnel::default(),
            background: Background::default(),
            specular: Specular::default(),
            white: f64::INFINITY,
        }
    }
}

/// One pixel: means over its eye rays. Colours are linear sRGB radiance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pixel {
    /// Diffuse, singly scattered and specular radiance where the object is, the background elsewhere.
    pub beauty: [f32; 3],
    /// Diffuse radiance, 0 beside the object: multiplied by the coverage, as OpenEXR has it.
    pub diffuse: [f32; 3],
    /// Singly scattered radiance, likewise.
    pub single: [f32; 3],
    /// Specular radiance, likewise.
    pub specular: [f32; 3],
    /// What the texture multiplied the diffuse and the singly scattered radiance by, likewise; 0 without a texture.
    pub albedo: [f32; 3],
    /// The mean of what the specular radiance, or the background, of single eye rays has above white. A highlight thinner
    /// than a pixel may be so bright that all pixels it touches are white: without the glare, its edges are smooth.
    pub glare: [f32; 3],
    /// Unit mean of the shading normals in world axes; 0 where nothing is hit.
    pub normal: [f32; 3],
    /// Mean distance of what is hit along the viewing axis, in mm; infinite where nothing is hit.
    pub depth_mm: f32,
    /// Share of the eye rays that hit the object.
    pub coverage: f32,
    /// The part that most eye rays hit, of equal ones the first, counted from 1; 0 where nothing is hit.
    pub part: u32,
}

/// Where single scattering came from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum SingleLayer {
    /// There is none.
    #[default]
    None,
    /// Values of the vertices.
    PerVertex,
    /// Each eye ray's own.
    TowardsEye,
}

/// Whether a texture was multiplied in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AlbedoLayer {
    /// There is none.
    #[default]
    None,
    /// [`Pixel::albedo`] says what it was.
    Textured,
}

/// A rendered picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Size.
    pub resolution: Resolution,
    /// Row by row from the top.
    pub pixels: Vec<Pixel>,
    /// Share of the hits that met a triangle from behind, where nothing shines: the eye is inside, or the mesh is open
    /// or wound inwards.
    pub back_facing_share: f64,
    /// What [`Pixel::single`] is.
    pub single: SingleLayer,
    /// What [`Pixel::albedo`] is.
    pub albedo: AlbedoLayer,
}

/// Most channels of a picture in a file.
const CHANNELS: u64 = 22;

/// Bytes that rendering and writing a picture of this size takes at most, beside the scene.
pub fn memory_bytes(resolution: Resolution) -> u64 {
    // The pixels, a plane for each channel while a file is encoded, and its bytes.
    resolution.pixels() as u64 * (size_of::<Pixel>() as u64 + 4 * CHANNELS + 2 * 4 * CHANNELS)
}

/// Renders a scene with the radiosity of its source vertices, and single scattering where that is given as well.
///
/// Exit radiance is that of [`super::exit::ExitRadiance`] with the shading normal, for the medium of the part that is hit;
/// specular reflection that of [`super::specular::Ggx`]: shadowed for directional, point and area lights, unshadowed for
/// environments and constant lights. Single scattering leaves at the shading normal too. A texture multiplies both kinds of
/// scattered light, and no reflection. Opaque parts, which have no optical properties, and back sides are black.
/// The result does not depend on the number of threads.
///
/// # Errors
/// A radiosity that is not finite or does not fit the mesh, no samples per pixel or too many (exit 4: a caller's
/// mistake).
pub fn render<'a>(
    evaluator: &dyn Evaluator,
    exitance: impl Into<Exitance<'a>>,
    lights: &[Light],
    settings: &RenderSettings,
    progress: &dyn Progress,
) -> Result<Frame> {
    let (scene, bvh) = (evaluator.scene(), evaluator.bvh());
    let exitance = exitance.into();
    exitance.check(scene)?;
    check(settings)?;
    let resolution = settings.resolution;
    progress.start("render", resolution.height.div_ceil(TILE) as u64);
    let renderer = Renderer::new(scene, bvh, exitance, lights, settings);
    let mut pixels = vec![EMPTY; resolution.pixels()];
    let back_facing = pixels
        .par_chunks_mut(TILE * resolution.width)
        .enumerate()
        .map(|(row, pixels)| {
            let counts = renderer.tile_row(row * TILE, pixels);
            progress.advance(1);
            counts
        })
        .reduce(Counts::default, Counts::add);
    progress.finish();
    let single = match exitance.single {
        Single::None => SingleLayer::None,
        Single::PerVertex(_) => SingleLayer::PerVertex,
        Single::TowardsEye(_) => SingleLayer::TowardsEye,
    };
    let albedo = if exitance.texture.is_some() { AlbedoLayer::Textured } else { AlbedoLayer::None };
    Ok(Frame { resolution, pixels, back_facing_share: back_facing.share(), single, albedo })
}

/// Nothing.
pub(super) const EMPTY: Pixel = Pixel {
    beauty: [0.0; 3],
    diffuse: [0.0; 3],
    single: [0.0; 3],
    specular: [0.0; 3],
    albedo: [0.0; 3],
    glare: [0.0; 3],
    normal: [0.0; 3],
    depth_mm: f32::INFINITY,
    coverage: 0.0,
    part: 0,
};

fn check(settings: &RenderSettings) -> Result<()> {
    if !(1..=MAX_SAMPLES_PER_PIXEL).contains(&settings.samples_per_pixel) {
        let asked = settings.samples_per_pixel;
        return Err(Error::command_line(format!(
            "{asked} samples per pixel: a number from 1 to {MAX_SAMPLES_PER_PIXEL} is needed"
        )));
    }
    Resolution::new(settings.resolution.width, settings.resolution.height).map(|_| ())
}
