//! Settings of a picture, and the values of its pixels.

use glam::DVec3;

use super::background::Background;
use super::blinn_phong::{BlinnPhong, Exponent};
use super::camera::{Camera, Resolution};
use super::exit::ExitFresnel;
use super::highlight::{Highlight, HighlightModel, HighlightShape};
use super::specular::{Ggx, Roughness};

/// Default number of eye rays through a pixel.
pub const DEFAULT_SAMPLES_PER_PIXEL: u32 = 16;

/// Largest number of eye rays through a pixel.
pub const MAX_SAMPLES_PER_PIXEL: u32 = 1 << 14;

/// Specular reflection of the lights by translucent parts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Specular {
    /// The lights are not reflected.
    Off,
    /// A rough dielectric boundary with the index of refraction of the medium (see [`super::specular`]).
    Rough(Roughness),
    /// A boundary with a Blinn-Phong highlight (see [`super::blinn_phong`]).
    BlinnPhong(Exponent),
}

impl Specular {
    /// Roughness of the boundary, if it is one that has a roughness.
    pub fn roughness(self) -> Option<Roughness> {
        match self {
            Self::Off | Self::BlinnPhong(_) => None,
            Self::Rough(roughness) => Some(roughness),
        }
    }

    /// Model of the highlights; none without reflection.
    pub fn model(self) -> Option<HighlightModel> {
        match self {
            Self::Off => None,
            Self::Rough(_) => Some(HighlightModel::Ggx),
            Self::BlinnPhong(exponent) => Some(HighlightModel::BlinnPhong(exponent)),
        }
    }

    /// Shape of the highlights; none without reflection.
    pub fn shape(self) -> Option<HighlightShape> {
        match self {
            Self::Off => None,
            Self::Rough(_) => Some(HighlightShape::Ggx),
            Self::BlinnPhong(_) => Some(HighlightShape::BlinnPhong),
        }
    }

    /// The boundary of a medium; none where nothing is reflected.
    pub fn highlight(self, eta_inside_over_outside: f64) -> Option<Highlight> {
        let eta = eta_inside_over_outside;
        match self {
            _ if eta == 1.0 => None,
            Self::Off => None,
            Self::Rough(roughness) => Some(Highlight::Ggx(Ggx::new(roughness, eta))),
            Self::BlinnPhong(exponent) => Some(Highlight::BlinnPhong(BlinnPhong::new(exponent, eta))),
        }
    }
}

impl Default for Specular {
    fn default() -> Self {
        Self::Rough(Roughness::default())
    }
}

/// The settings of a picture, everything beside the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RenderSettings {
    /// The camera.
    pub camera: Camera,
    /// Size of the picture.
    pub resolution: Resolution,
    /// Eye rays through a pixel: stratified over the pixel's square, all with the same weight (a box filter).
    pub samples_per_pixel: u32,
    /// Normalisation of the exit Fresnel factor.
    pub exit_fresnel: ExitFresnel,
    /// The background beside the object.
    pub background: Background,
    /// Specular reflection by the boundary.
    pub specular: Specular,
    /// The radiance that will be white where the picture is shown: the excess of single eye rays over it goes into
    /// [`Pixel::glare`]. Infinite where it is not known.
    pub white: f64,
    /// Diffuse albedo of opaque parts, linear sRGB; the base colours of a texture with a file take its place. Without one they
    /// are black, as the shaders of `relight` draw them.
    pub opaque: Option<DVec3>,
    /// Whether a matte plane under the object catches its shadow.
    pub ground: Ground,
    /// Whether light that crosses translucent parts unscattered is seen.
    pub straight: bool,
}

/// What is under the object.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Ground {
    /// Nothing.
    #[default]
    None,
    /// A level plane through the lowest point of the object, seen from above: the background times the share of the light
    /// that the object leaves it. It sends no light to the object.
    Shadow,
}

/// Default albedo of opaque parts.
pub const DEFAULT_OPAQUE: f64 = 0.5;

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
            opaque: None,
            ground: Ground::None,
            straight: false,
        }
    }
}

/// One pixel: means over its eye rays. Colours are linear sRGB radiance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pixel {
    /// Diffuse, singly scattered, unscattered and specular radiance where the object is, the background elsewhere, in the object's shadow where there is a ground.
    pub beauty: [f32; 3],
    /// Diffuse radiance, 0 beside the object: multiplied by the coverage, as OpenEXR requires.
    pub diffuse: [f32; 3],
    /// Singly scattered radiance, multiplied by the coverage.
    pub single: [f32; 3],
    /// Radiance of light that crossed the object unscattered, multiplied by the coverage.
    pub straight: [f32; 3],
    /// Specular radiance, multiplied by the coverage.
    pub specular: [f32; 3],
    /// Diffuse radiance of opaque parts, multiplied by the coverage.
    pub matte: [f32; 3],
    /// Share of the pixel's light that the object's shadow on the ground takes from the background, of the brightest channel;
    /// in a picture without a background, how dark the ground is there.
    pub shadow: f32,
    /// Albedo of the texture that multiplied the scattered radiance, multiplied by the coverage; 0 without a texture.
    pub albedo: [f32; 3],
    /// Mean excess over white of the specular radiance, or of the background, of single eye rays. A highlight thinner
    /// than a pixel may be so bright that all pixels it touches are white: without the glare, its edges are smooth.
    pub glare: [f32; 3],
    /// Unit mean of the shading normals in world axes; 0 where nothing is hit.
    pub normal: [f32; 3],
    /// Mean distance of the hits along the viewing axis, in mm; infinite where nothing is hit.
    pub depth_mm: f32,
    /// Share of the eye rays that hit the object.
    pub coverage: f32,
    /// The part that most eye rays hit, the first of equal ones, counted from 1; 0 where nothing is hit.
    pub part: u32,
}

/// A pixel without hits and background.
pub(super) const EMPTY: Pixel = Pixel {
    beauty: [0.0; 3],
    diffuse: [0.0; 3],
    single: [0.0; 3],
    straight: [0.0; 3],
    specular: [0.0; 3],
    matte: [0.0; 3],
    shadow: 0.0,
    albedo: [0.0; 3],
    glare: [0.0; 3],
    normal: [0.0; 3],
    depth_mm: f32::INFINITY,
    coverage: 0.0,
    part: 0,
};
