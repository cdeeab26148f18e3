//! What `two_pass` precomputes: the surface samples.

use super::evaluate;
use crate::compress::ledger::Ledger;
use crate::error::Result;
use crate::evaluate::{AssetParts, BakeSettings};
use crate::geometry::samples::Samples;
use crate::methods::settings::{sample_count, sample_memory};
use crate::progress::Progress;
use crate::transport::scene::Scene;

/// Spacing over the shortest mean free path at the default of 0.5 %: shadow boundaries stay well inside the kernel.
const SPACING: f64 = 0.35;

/// Samples at least: what the shape's own shadows ask for.
const LEAST: usize = 1 << 16;

/// Samples at most, unless asked for: where even that is coarser than a mean free path, a boundary of a shadow is drawn
/// as sharp as the samples are.
const MOST: usize = 1 << 17;

fn count(scene: &Scene, settings: &BakeSettings) -> usize {
    let spacing = SPACING * (settings.max_rms / 0.005).sqrt();
    settings.samples.unwrap_or_else(|| sample_count(scene, spacing, LEAST, MOST))
}

pub(super) fn memory(scene: &Scene, settings: &BakeSettings) -> u64 {
    sample_memory(count(scene, settings), scene.mesh.triangles.len())
}

pub(super) fn bake(scene: &Scene, settings: &BakeSettings, progress: &dyn Progress) -> Result<AssetParts> {
    evaluate::plan(&settings.values, settings.max_rms)?;
    let count = count(scene, settings);
    progress.start("samples", count as u64);
    let samples = Samples::new(&scene.mesh, &scene.parts, count);
    progress.finish();
    Ok(AssetParts { samples, ledger: Ledger::default(), sections: Vec::new() })
}
