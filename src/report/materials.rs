//! Reports of media and measured materials with their lengths.

use std::fmt;

use serde::Serialize;

use super::text::{significant, titled};
use crate::medium::fresnel::BoundaryFit;
use crate::medium::material::{Medium, OpticalProperties, PRESETS};

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

/// The measured materials.
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
}

impl MaterialsReport {
    /// The report of all presets.
    pub(crate) fn of_presets() -> Self {
        let row = |preset: &crate::medium::material::Preset| MaterialRow {
            medium: MediumReport::of(&preset.material().into()),
            total_reflectance: preset.properties().total_reflectance(BoundaryFit::Published),
        };
        Self { materials: PRESETS.iter().map(row).collect() }
    }
}

impl fmt::Display for MaterialsReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let titles = ["material", "sigma_s' 1/mm", "sigma_a 1/mm", "eta", "mean free path mm", "diffusion mm", "R_d"];
        let row = |MaterialRow { medium, total_reflectance }: &MaterialRow| {
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
            ]
        };
        f.write_str(&titled(titles, self.materials.iter().map(row)))
    }
}
