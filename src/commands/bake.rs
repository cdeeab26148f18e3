//! `translux bake MODEL -o A.tlux`.

use std::path::PathBuf;

use clap::Args;
use serde::Serialize;

use super::baking::{self, BakeOptions};
use super::console::{Console, duration, megabytes, percent, significant};
use super::media::MediumReport;
use super::model::ModelArgs;
use super::{output, report};
use crate::compress::ledger::Ledger;
use crate::error::{ExitCode, Result};
use crate::geometry::check::MeshCheck;
use crate::geometry::samples::{self, Spacing};

#[derive(Clone, Debug, Args)]
pub(super) struct BakeArgs {
    #[command(flatten)]
    model: ModelArgs,
    /// Asset to write (.tlux)
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Method (see `translux methods`)
    #[arg(long, default_value = "editable")]
    method: String,
    #[command(flatten)]
    options: BakeOptions,
}

/// Samples whose spacing is measured.
const SPACING_PROBES: usize = 2048;

#[derive(Serialize)]
struct BakeReport {
    method: &'static str,
    #[serde(serialize_with = "report::path")]
    output: PathBuf,
    vertices: usize,
    triangles: usize,
    samples: usize,
    spacing: Spacing,
    /// Nominal spacing over the shortest mean free path of any medium.
    spacing_over_mean_free_path: Option<f64>,
    bytes: u64,
    bytes_without_mesh: u64,
    bytes_per_vertex: f64,
    diagonal_mm: f64,
    media: Vec<MediumReport>,
    mesh: MeshCheck,
    ledger: Ledger,
}

pub(super) fn run(args: &BakeArgs, console: &Console) -> Result<ExitCode> {
    let method = console.registry.method(&args.method)?;
    let recipe = args.options.resolve(method)?;
    let asked = recipe.settings.max_rms;
    output::check(std::slice::from_ref(&args.output), &["tlux"], console)?;
    let loaded = args.model.load(console)?;
    let (media, mesh) = (loaded.scene.media.iter().map(MediumReport::of).collect(), loaded.check.clone());
    let asset = baking::bake(recipe, loaded, console)?;
    let (bytes, without_mesh) = console.stage("write", || -> Result<_> {
        let bytes = asset.to_bytes()?;
        let sizes = super::inspect::sizes(&bytes)?;
        crate::io::atomic::write(&args.output, &bytes)?;
        Ok((bytes.len() as u64, sizes.stored_without_mesh))
    })?;
    let vertices = asset.scene.mesh.local_mm.len();
    let spacing = samples::spacing(&samples::patches(&asset.scene.mesh, &asset.samples), SPACING_PROBES);
    let paths = asset.scene.media.iter().map(|m| m.properties.mean_free_path_mm().min_element());
    let free_path = paths.fold(f64::INFINITY, f64::min);
    let result = BakeReport {
        method: method.name(),
        output: args.output.clone(),
        vertices,
        triangles: asset.scene.mesh.triangles.len(),
        samples: asset.samples.len(),
        spacing,
        spacing_over_mean_free_path: free_path.is_finite().then_some(spacing.nominal_mm / free_path),
        bytes,
        bytes_without_mesh: without_mesh,
        bytes_per_vertex: without_mesh as f64 / vertices.max(1) as f64,
        diagonal_mm: asset.scene.mesh.diagonal_mm(),
        media,
        mesh,
        ledger: asset.ledger,
    };
    let samples = match result.samples {
        0 => String::new(),
        count => format!(" {count} samples {} mm apart,", significant(spacing.nominal_mm)),
    };
    console.note(&format!(
        "{}: {},{samples} {:.1} bytes/vertex without the mesh, {}",
        result.output.display(),
        megabytes(bytes),
        result.bytes_per_vertex,
        duration(console.seconds())
    ));
    for entry in &result.ledger.entries {
        console.note(&format!("  {}: {} RMS ({})", entry.stage, percent(entry.error.rms), entry.note));
    }
    let measured = result.ledger.total_rms_without_environment();
    let verdict = super::evaluate::judge_error(measured, Some(asked), console);
    report::print(console, "bake", &result)?;
    verdict
}
