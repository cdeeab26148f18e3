//! The report of a picture, and the attributes of its OpenEXR file.

use std::path::PathBuf;

use serde::Serialize;

use super::trust::TrustReport;
use crate::evaluate::Cost;
use crate::geometry::part_table::PartEntry;
use crate::import::file::Input;
use crate::math::statistics::VertexError;
use crate::medium::material::Medium;
use crate::render::camera::{Resolution, xyz};
use crate::render::exit::ExitFresnel;
use crate::render::film::ColourType;
use crate::render::frame::{ExitanceAt, SingleLayer};
use crate::render::specular::Roughness;
use crate::render::tone::Tone;
use crate::scene::Scene;

/// Report of a picture.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct RenderReport {
    pub(crate) method: String,
    pub(crate) materials: Vec<String>,
    pub(crate) lights: Vec<String>,
    pub(crate) inputs: Vec<Input>,
    pub(crate) outputs: Vec<PathBuf>,
    /// Camera as it would be typed.
    pub(crate) camera: String,
    pub(crate) resolution: Resolution,
    pub(crate) samples_per_pixel: u32,
    pub(crate) exit_fresnel: ExitFresnel,
    pub(crate) background: String,
    /// Model of the highlights as it would be typed; none without specular reflection.
    pub(crate) highlights: Option<String>,
    /// Roughness of the surface; none without specular reflection, and for models without a roughness.
    pub(crate) roughness: Option<Roughness>,
    /// Texture as it would be typed; none without texture.
    pub(crate) texture: Option<String>,
    /// Where exitance was evaluated.
    pub(crate) exitance: ExitanceAt,
    /// Error of light that is linear between the vertices, under probe lights, where --exitance auto found it too large.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) between_vertices: Option<VertexError>,
    pub(crate) single_scattering: SingleLayer,
    /// Number of light paths for each covered pixel.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) single_scattering_paths: Option<u64>,
    pub(crate) exr_type: ColourType,
    /// Tone curve; PNG only.
    pub(crate) tone: Tone,
    /// Whether a plane under the object catches its shadow.
    pub(crate) ground: bool,
    /// Whether light that crosses the object unscattered is in the picture.
    pub(crate) straight_through: bool,
    /// Exposure as asked for; PNG only.
    pub(crate) exposure: String,
    /// Factor on radiance in PNG colours, before the transfer curve.
    pub(crate) exposure_factor: f64,
    /// Share of the picture that the object covers.
    pub(crate) coverage: f64,
    /// Share of the hits on back sides, which are black.
    pub(crate) back_facing_share: f64,
    pub(crate) cost: Cost,
    /// The map of where the asset is wrong; left out where it was not asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) trust: Option<TrustReport>,
    /// Text attributes of OpenEXR pictures.
    #[serde(skip)]
    pub(crate) header: Vec<(String, String)>,
}

impl RenderReport {
    /// Text attributes of an OpenEXR picture: everything that determines it, but no time and no path of the asset.
    /// `sources` are the files that the asset was made from, `image` is the texture's file.
    pub(crate) fn attributes(&self, scene: &Scene, sources: &[Input], image: Option<&Input>) -> Vec<(String, String)> {
        let exit_fresnel = match self.exit_fresnel {
            ExitFresnel::Normalised => "normalised",
            ExitFresnel::Paper => "paper",
        };
        let joined = |texts: Vec<String>| texts.join("; ");
        let hashed =
            |inputs: &[Input]| joined(inputs.iter().map(|i| format!("{} blake3 {}", i.name, i.blake3)).collect());
        let mut all = vec![
            ("software", format!("translux {}", env!("CARGO_PKG_VERSION"))),
            ("method", self.method.clone()),
            ("material", self.materials.join("; ")),
            ("opticalProperties", joined(scene.media.iter().map(optical_properties).collect())),
            ("parts", joined(scene.parts.parts.iter().enumerate().map(|(i, p)| part(i, p, &scene.media)).collect())),
            ("lights", self.lights.join("; ")),
            ("camera", self.camera.clone()),
            ("samplesPerPixel", self.samples_per_pixel.to_string()),
            ("exitFresnel", exit_fresnel.to_owned()),
            self.reflection(),
            ("background", self.background.clone()),
            ("units", "radiance: linear sRGB; depth: mm along the viewing axis, infinite beside the object".to_owned()),
        ];
        let exitance = match self.exitance {
            ExitanceAt::Vertices => None,
            ExitanceAt::Pixels => Some("at what each pixel sees, not at the vertices"),
        };
        all.extend(exitance.map(|text| ("exitance", text.to_owned())));
        let single = match self.single_scattering {
            SingleLayer::None => None,
            SingleLayer::PerVertex => Some("along the inverse normal of the vertices"),
            SingleLayer::TowardsEye => Some("along the refracted direction of the eye"),
        };
        all.extend(single.map(|text| ("singleScattering", text.to_owned())));
        all.extend(
            self.straight_through.then(|| ("straightThrough", "along the refracted direction of the eye".to_owned())),
        );
        all.extend(self.texture.clone().map(|texture| ("texture", texture)));
        let image = image.map_or(&[] as &[Input], std::slice::from_ref);
        for (name, inputs) in [("bakedFrom", sources), ("environments", &self.inputs), ("textureFrom", image)] {
            if !inputs.is_empty() {
                all.push((name, hashed(inputs)));
            }
        }
        all.into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
    }

    /// The attribute of the specular reflection: the roughness, or the model of one that has none.
    fn reflection(&self) -> (&'static str, String) {
        match (&self.highlights, self.roughness) {
            (_, Some(roughness)) => ("roughness", roughness.to_string()),
            (Some(model), None) => ("highlights", model.clone()),
            (None, None) => ("roughness", "no specular reflection".to_owned()),
        }
    }
}

fn optical_properties(medium: &Medium) -> String {
    let Medium { name, properties: p } = medium;
    let (scattering, absorption) = (xyz(p.sigma_s_reduced_per_mm), xyz(p.sigma_a_per_mm));
    let (eta, g) = (p.eta_inside_over_outside, p.g);
    format!("{name}: sigma_s'={scattering}/mm sigma_a={absorption}/mm eta={eta} g={g}")
}

/// Text of a part, numbered as in `part.ID`.
fn part(index: usize, part: &PartEntry, media: &[Medium]) -> String {
    let medium = part.medium.and_then(|m| media.get(m as usize)).map_or("opaque", |m| m.name.as_str());
    format!("{} {} ({medium})", index + 1, part.name)
}
