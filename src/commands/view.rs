//! Options of every command that shows the object: camera, exposure, surface, texture, background.

use std::path::Path;

use clap::Args;

use super::console::Console;
use crate::error::{Error, Result};
use crate::geometry::mesh::Mesh;
use crate::render::background::Background;
use crate::render::camera::{Resolution, View, xyz};
use crate::render::camera_text::CameraSpec;
use crate::render::film::Exposure;
use crate::render::frame::{RenderSettings, Specular, memory_bytes};
use crate::render::highlight::HighlightModel;
use crate::render::specular::{DEFAULT_ROUGHNESS, Roughness};
use crate::render::texture::Texture;
use crate::render::texture::spec::{MarbleSpec, TextureSpec};

/// From where the object is seen.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Picture")]
pub(super) struct CameraArgs {
    /// Eye, target, up and vertical degrees, in mm, as at=0,8,75:look=0,0,0:up=0,1,0:fov=28; every key may be left out
    /// (default: the whole object from the front, slightly above)
    #[arg(long, value_name = "CAMERA")]
    camera: Option<CameraSpec>,
    /// Side from which the whole object is seen, where --camera does not say at
    #[arg(long, value_name = "SIDE")]
    view: Option<View>,
}

/// How the object is seen.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Picture")]
pub(super) struct ViewArgs {
    #[command(flatten)]
    camera: CameraArgs,
    /// Brightness of 8-bit colours: auto (the 99.5th percentile of the object becomes white, in the first frame) or stops
    #[arg(long, value_name = "auto|EV", default_value = "auto", allow_hyphen_values = true)]
    pub(super) exposure: Exposure,
    /// What is seen beside the object: env (environments and constant lights), none (transparent in PNG) or R,G,B
    #[arg(long, value_name = "env|none|RGB", default_value = "env")]
    pub(super) background: Background,
    /// Model of specular reflection: ggx (microfacets, as wide as --roughness says) or blinn-phong:EXPONENT (a power, from
    /// 1, matt, to 10000, polished); both with the Fresnel reflectance of the medium
    #[arg(long, value_name = "MODEL", default_value_t)]
    highlights: HighlightModel,
    #[arg(long, value_name = "R", allow_hyphen_values = true, help = roughness_help())]
    roughness: Option<Roughness>,
    /// No specular reflection of the lights
    #[arg(long, conflicts_with_all = ["roughness", "highlights"])]
    no_specular: bool,
    /// Albedo that scattered light is multiplied by, not reflected light: none, marble, a PNG over the texture coordinates,
    /// or the base colours of a glTF model [default: none; over a guessed medium the base colours of its model]
    #[arg(long, value_name = "TEXTURE", long_help = texture_help())]
    texture: Option<TextureSpec>,
}

fn roughness_help() -> String {
    format!("Roughness of the surface for ggx highlights, from 0 (polished) to 1 (matt) [default: {DEFAULT_ROUGHNESS}]")
}

fn texture_help() -> String {
    let MarbleSpec { base, veins, turbulence, octaves, sharpness, .. } = MarbleSpec::default();
    format!(
        "Albedo that scattered light is multiplied by, not reflected light, and the same in every light:\n  \
         none\n  \
         marble, or marble:key=value:...\n  \
         image:path=FILE.png, or a bare path (PNG, JPEG, WebP): over the texture coordinates of the model\n  \
         base-colour:path=MODEL.glb, or a bare path: base-colour factors and pictures of the model that was baked\n\
         Keys of marble: scale (mm between veins; default a fifth of the diagonal), base and veins (linear R,G,B or one \
         number, 0 to 1; default {} and {}), turbulence (how far veins are shifted, in their distances; default \
         {turbulence}), octaves (of the turbulence; default {octaves}), sharpness (of the veins; default {sharpness}), seed.\n\
         [default: none; over a guessed medium the base colours of its model]",
        xyz(base),
        xyz(veins)
    )
}

/// Refuses so many pictures at once that the memory limit does not allow.
pub(super) fn check_memory(resolution: Resolution, count: usize, console: &Console) -> Result<()> {
    let needed = memory_bytes(resolution).saturating_mul(count as u64);
    let share = (console.max_memory as f64 / needed as f64).sqrt();
    let side = |n: usize| ((n as f64 * share) as usize).max(1);
    let (width, height) = (side(resolution.width), side(resolution.height));
    console.check_memory(needed, &format!("--resolution {width}x{height} would fit, or raise --max-memory"))
}

impl CameraArgs {
    /// The first of its options that was typed.
    pub(super) fn given(&self) -> Option<&'static str> {
        self.camera.map(|_| "--camera").or(self.view.map(|_| "--view"))
    }

    /// The camera as it is typed.
    pub(super) fn spec(&self) -> Result<CameraSpec> {
        let camera = self.camera.unwrap_or_default();
        match (self.view, camera.at_mm) {
            (Some(_), Some(_)) => {
                Err(Error::command_line("--view and at= of --camera both say from where: leave one out"))
            }
            (view, _) => Ok(CameraSpec { view: view.unwrap_or_default(), ..camera }),
        }
    }
}

impl ViewArgs {
    /// The settings of a picture of a mesh.
    pub(super) fn settings(&self, mesh: &Mesh, resolution: Resolution) -> Result<RenderSettings> {
        let camera = self.camera()?.resolve(mesh, resolution)?;
        let (background, specular) = (self.background, self.specular()?);
        Ok(RenderSettings { background, specular, ..RenderSettings::new(camera, resolution) })
    }

    /// The camera as it is typed.
    pub(super) fn camera(&self) -> Result<CameraSpec> {
        self.camera.spec()
    }

    pub(super) fn specular(&self) -> Result<Specular> {
        match (self.highlights, self.roughness) {
            _ if self.no_specular => Ok(Specular::Off),
            (HighlightModel::Ggx, roughness) => Ok(Specular::Rough(roughness.unwrap_or_default())),
            (HighlightModel::BlinnPhong(exponent), None) => Ok(Specular::BlinnPhong(exponent)),
            (model @ HighlightModel::BlinnPhong(_), Some(_)) => Err(Error::command_line(format!(
                "--roughness is the width of ggx highlights, and the exponent that of {model}: leave --roughness out, or                  --highlights"
            ))),
        }
    }

    /// The texture as it is typed, and without one the base colours of a model, where they cover guessed media.
    pub(super) fn texture(&self, base_colours: Option<&Path>) -> TextureSpec {
        let beneath = || base_colours.map_or(TextureSpec::None, |model| TextureSpec::BaseColour(model.to_owned()));
        self.texture.clone().unwrap_or_else(beneath)
    }

    /// The same options with this texture.
    pub(super) fn with_texture(&self, texture: TextureSpec) -> Self {
        Self { texture: Some(texture), ..self.clone() }
    }

    /// Reads the texture for a mesh and prints its warnings.
    pub(super) fn load_texture(&self, mesh: &Mesh, console: &Console) -> Result<Option<Texture>> {
        let texture = Texture::new(&self.texture(None), mesh)?;
        texture.iter().flat_map(Texture::warnings).for_each(|warning| console.warn(warning));
        Ok(texture)
    }
}
