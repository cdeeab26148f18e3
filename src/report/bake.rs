//! The report of a bake.

use std::path::PathBuf;

use serde::Serialize;

use super::materials::MediumReport;
use super::sizes::Sizes;
use super::text::{duration, megabytes, percent, significant};
use crate::asset::Asset;
use crate::compress::ledger::Ledger;
use crate::geometry::check::MeshCheck;
use crate::geometry::samples::{Spacing, patches, spacing};

/// Number of samples at which the spacing is measured.
const SPACING_PROBES: usize = 2048;

/// Error of the dark part that is told.
const DARK: f64 = 0.1;

/// Report of a bake.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct BakeReport {
    pub(crate) method: String,
    #[serde(serialize_with = "super::path")]
    #[cfg_attr(test, schemars(with = "String"))]
    pub(crate) output: PathBuf,
    pub(crate) vertices: usize,
    pub(crate) triangles: usize,
    pub(crate) samples: usize,
    pub(crate) spacing: Spacing,
    /// Nominal spacing over the shortest mean free path of any medium; none without a mean free path.
    pub(crate) spacing_over_mean_free_path: Option<f64>,
    pub(crate) bytes: u64,
    /// Stored bytes of all sections except the mesh's and the environment's.
    pub(crate) bytes_without_mesh: u64,
    pub(crate) bytes_per_vertex: f64,
    pub(crate) diagonal_mm: f64,
    pub(crate) media: Vec<MediumReport>,
    /// The mesh of the source, before it was refined.
    pub(crate) mesh: MeshCheck,
    pub(crate) ledger: Ledger,
}

impl BakeReport {
    /// Measures an asset that was written to `output`.
    pub(crate) fn new(output: PathBuf, asset: Asset, sizes: &Sizes, mesh: MeshCheck) -> Self {
        let scene = &asset.scene;
        let vertices = scene.mesh.local_mm.len();
        let spacing = spacing(&patches(&scene.mesh, &asset.samples), SPACING_PROBES);
        let paths = scene.media.iter().map(|m| m.properties.mean_free_path_mm().min_element());
        let free_path = paths.fold(f64::INFINITY, f64::min);
        Self {
            method: asset.provenance.method,
            output,
            vertices,
            triangles: scene.mesh.triangles.len(),
            samples: asset.samples.len(),
            spacing,
            spacing_over_mean_free_path: free_path.is_finite().then_some(spacing.nominal_mm / free_path),
            bytes: sizes.file,
            bytes_without_mesh: sizes.stored_without_mesh,
            bytes_per_vertex: sizes.stored_without_mesh as f64 / vertices.max(1) as f64,
            diagonal_mm: scene.mesh.diagonal_mm(),
            media: scene.media.iter().map(MediumReport::of).collect(),
            mesh,
            ledger: asset.ledger,
        }
    }

    /// What the ledger says about the dark part, where that is worth a line.
    fn dark_part(&self) -> Option<String> {
        let stages = self.ledger.of_radiosity();
        let worst = stages.max_by(|a, b| a.error.dark.total_cmp(&b.error.dark)).filter(|e| e.error.dark > DARK)?;
        let dark = percent(worst.error.dark);
        Some(format!(
            "  dark part (below a tenth of the mean): up to {dark} of its own mean by `{}`; what sums over samples, such as two_pass or editable, \
             keeps it",
            worst.stage
        ))
    }

    /// Text of size, samples and errors, with the duration in seconds.
    pub(crate) fn summary(&self, seconds: f64) -> String {
        let samples = match self.samples {
            0 => String::new(),
            count => format!(" {count} samples {} mm apart,", significant(self.spacing.nominal_mm)),
        };
        let (output, size, took) = (self.output.display(), megabytes(self.bytes), duration(seconds));
        let per_vertex = significant(self.bytes_per_vertex);
        let first = format!("{output}: {size},{samples} {per_vertex} bytes/vertex without the mesh, {took}");
        let mut lines = vec![first];
        let stage =
            |e: &crate::compress::ledger::Entry| format!("  {}: {} RMS ({})", e.stage, percent(e.error.rms), e.note);
        lines.extend(self.ledger.entries.iter().map(stage));
        lines.extend(self.dark_part());
        lines.join("\n")
    }
}
