//! `translux materials`.

use clap::Args;
use serde::Serialize;

use super::console::{Console, Format, significant};
use super::{output, report};
use crate::error::{ExitCode, Result};
use crate::medium::fresnel::BoundaryFit;
use crate::medium::material::{OpticalProperties, PRESETS};

#[derive(Clone, Debug, Args)]
pub(super) struct MaterialsArgs {}

#[derive(Serialize)]
struct MaterialsReport {
    materials: Vec<MaterialRow>,
}

#[derive(Serialize)]
struct MaterialRow {
    name: &'static str,
    #[serde(flatten)]
    properties: OpticalProperties,
    mean_free_path_mm: [f64; 3],
    /// Null where nothing absorbs.
    diffusion_length_mm: [Option<f64>; 3],
    total_reflectance: [f64; 3],
}

pub(super) fn run(_: &MaterialsArgs, console: &Console) -> Result<ExitCode> {
    let rows: Vec<MaterialRow> = PRESETS
        .iter()
        .map(|preset| {
            let properties = preset.properties();
            let summary = properties.summary(BoundaryFit::Published);
            let finite = |v: f64| v.is_finite().then_some(v);
            MaterialRow {
                name: preset.name,
                properties,
                mean_free_path_mm: summary.map(|c| c.mean_free_path_mm),
                diffusion_length_mm: summary.map(|c| finite(c.diffusion_length_mm)),
                total_reflectance: summary.map(|c| c.total_reflectance),
            }
        })
        .collect();
    if console.format == Format::Text {
        let header = ["material", "sigma_s' 1/mm", "sigma_a 1/mm", "eta", "mean free path mm", "diffusion mm", "R_d"];
        let mut lines = vec![header.map(str::to_owned)];
        for row in &rows {
            let three = |v: [f64; 3]| v.map(significant).join(" ");
            let lengths = row.diffusion_length_mm.map(|v| v.map_or_else(|| "inf".to_owned(), significant)).join(" ");
            lines.push([
                row.name.to_owned(),
                row.properties.sigma_s_reduced_per_mm.to_array().map(|v| v.to_string()).join(" "),
                row.properties.sigma_a_per_mm.to_array().map(|v| v.to_string()).join(" "),
                row.properties.eta_inside_over_outside.to_string(),
                three(row.mean_free_path_mm),
                lengths,
                row.total_reflectance.map(|v| format!("{v:.3}")).join(" "),
            ]);
        }
        output::print_line(&output::table(&lines))?;
    }
    report::print(console, "materials", &MaterialsReport { materials: rows })?;
    Ok(ExitCode::Ok)
}
