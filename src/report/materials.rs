//! Reports of media and measured materials with their lengths.

use std::fmt;

use glam::DVec3;
use serde::Serialize;

use super::text::{significant, titled};
use crate::math::srgb::hex_from_linear;
use crate::medium::fresnel::{BoundaryFit, diffuse_transmittance};
use crate::medium::look::Found;
use crate::medium::material::{Medium, OpticalProperties, Preset, PresetOrigin, presets};

/// A medium and its lengths, RGB.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct MediumReport {
    pub(crate) name: String,
    #[serde(flatten)]
    pub(crate) properties: OpticalProperties,
    /// Mean free path 1 / sigma_t', mm.
    pub(crate) mean_free_path_mm: [f64; 3],
    /// Diffusion length 1 / sigma_tr, mm; none where nothing absorbs.
    pub(crate) diffusion_length_mm: [Option<f64>; 3],
}

impl MediumReport {
    /// The report of a medium.
    pub(crate) fn of(medium: &Medium) -> Self {
        Self {
            name: medium.name.clone(),
            properties: medium.properties,
            mean_free_path_mm: medium.properties.mean_free_path_mm().to_array(),
            diffusion_length_mm: medium.properties.diffusion_length_mm().to_array().map(|v| v.is_finite().then_some(v)),
        }
    }
}

/// A look that was asked for and the nearest that there is; channels are linear sRGB.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct LookReport {
    /// Name of the medium.
    name: String,
    /// Colour under constant light that was asked for.
    asked: [f64; 3],
    /// Colour of the medium.
    achieved: [f64; 3],
    /// The same two as sRGB.
    asked_hex: String,
    achieved_hex: String,
    /// Whether the achieved colour is the asked one.
    reached: bool,
    /// What the radius is: mfp, diffusion, cycles, burley or openpbr.
    radius_convention: &'static str,
    radius_mm: [f64; 3],
}

impl LookReport {
    /// The report of a look.
    pub fn of(name: &str, found: &Found) -> Self {
        let Found { target, inversion } = found;
        Self {
            name: name.to_owned(),
            asked: inversion.asked.to_array(),
            achieved: inversion.achieved.to_array(),
            asked_hex: hex_from_linear(inversion.asked),
            achieved_hex: hex_from_linear(inversion.achieved),
            reached: inversion.is_reached(),
            radius_convention: target.radius.word(),
            radius_mm: target.radius_mm.to_array(),
        }
    }
}

/// The materials that the program knows by name.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct MaterialsReport {
    materials: Vec<MaterialRow>,
}

#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
struct MaterialRow {
    #[serde(flatten)]
    medium: MediumReport,
    total_reflectance: [f64; 3],
    /// Colour under constant light by the dipole, both Fresnel terms included, as sRGB.
    color: String,
    origin: Origin,
}

/// Where the numbers are from.
#[derive(Clone, Copy, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
enum Origin {
    /// Measured (Jensen et al. 2001).
    Measured,
    /// Chosen by eye.
    ByEye,
}

impl MaterialsReport {
    /// The report of all presets.
    pub(crate) fn of_presets() -> Self {
        let row = |preset: &Preset| {
            let properties = preset.properties();
            let total_reflectance = properties.total_reflectance(BoundaryFit::Published);
            let entering = diffuse_transmittance(properties.eta_inside_over_outside);
            MaterialRow {
                medium: MediumReport::of(&preset.material().into()),
                total_reflectance,
                color: hex_from_linear(entering * DVec3::from_array(total_reflectance)),
                origin: match preset.origin {
                    PresetOrigin::Measured { .. } => Origin::Measured,
                    PresetOrigin::ByEye { .. } => Origin::ByEye,
                },
            }
        };
        Self { materials: presets().map(row).collect() }
    }
}

impl fmt::Display for MaterialsReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let titles = [
            "material",
            "sigma_s' 1/mm",
            "sigma_a 1/mm",
            "eta",
            "mean free path mm",
            "diffusion mm",
            "R_d",
            "color",
            "",
        ];
        let row = |MaterialRow { medium, total_reflectance, color, origin }: &MaterialRow| {
            let OpticalProperties { sigma_s_reduced_per_mm, sigma_a_per_mm, eta_inside_over_outside, .. } =
                medium.properties;
            let length = |v: Option<f64>| v.map_or_else(|| "inf".to_owned(), significant);
            [
                medium.name.clone(),
                sigma_s_reduced_per_mm.to_array().map(|v| v.to_string()).join(" "),
                sigma_a_per_mm.to_array().map(|v| v.to_string()).join(" "),
                eta_inside_over_outside.to_string(),
                medium.mean_free_path_mm.map(significant).join(" "),
                medium.diffusion_length_mm.map(length).join(" "),
                total_reflectance.map(|v| format!("{v:.3}")).join(" "),
                color.clone(),
                match origin {
                    Origin::Measured => String::new(),
                    Origin::ByEye => "by eye".to_owned(),
                },
            ]
        };
        f.write_str(&titled(titles, self.materials.iter().map(row)))
    }
}
