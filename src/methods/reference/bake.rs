//! What `reference` precomputes: the surface samples.

use super::evaluate;
use crate::compress::ledger::Ledger;
use crate::error::Result;
use crate::evaluate::{AssetParts, BakeSettings};
use crate::geometry::samples::Samples;
use crate::methods::settings::{sample_count, sample_memory};
use crate::progress::Progress;
use crate::transport::scene::Scene;

/// Spacing over the shortest mean free path.
const SPACING: f64 = 0.2;

/// Samples at least: what the shape's own shadows ask for.
const LEAST: usize = 1 << 16;

/// Samples at most, unless asked for: where even that is coarser than a mean free path, a boundary of a shadow is drawn
/// as sharp as the samples are.
const MOST: usize = 1 << 19;

fn count(scene: &Scene, settings: &BakeSettings) -> usize {
    settings.samples.unwrap_or_else(|| sample_count(scene, SPACING, LEAST, MOST))
}

pub(super) fn memory(scene: &Scene, settings: &BakeSettings) -> u64 {
    sample_memory(count(scene, settings), scene.mesh.triangles.len())
}

pub(super) fn bake(scene: &Scene, settings: &BakeSettings, progress: &dyn Progress) -> Result<AssetParts> {
    evaluate::plan(&settings.values)?;
    let count = count(scene, settings);
    progress.start("samples", count as u64);
    let samples = Samples::new(&scene.mesh, &scene.parts, count);
    progress.finish();
    Ok(AssetParts { samples, ledger: Ledger::default(), sections: Vec::new() })
}
