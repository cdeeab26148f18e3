//! What `two_pass` precomputes: the surface samples.

use super::{RAYS, evaluate};
use crate::error::Result;
use crate::evaluate::{AssetParts, BakeSettings};
use crate::methods::inter_reflection;
use crate::methods::sampling::{self, Density};
use crate::progress::Progress;
use crate::transport::scene::Scene;

/// Shadow boundaries stay well inside the kernel.
const DENSITY: Density = Density { spacing: 0.35, least: 1 << 17, most: 1 << 18 };

/// The error that the density is made for; a smaller one asks for more samples.
const DEFAULT_RMS: f64 = 0.005;

fn count(scene: &Scene, settings: &BakeSettings) -> usize {
    DENSITY.count(scene, settings, (DEFAULT_RMS / settings.max_rms).sqrt())
}

pub(super) fn memory(scene: &Scene, settings: &BakeSettings) -> u64 {
    let samples = count(scene, settings);
    sampling::memory(samples, scene) + inter_reflection::memory(scene, samples, &settings.values, &RAYS)
}

pub(super) fn bake(scene: &Scene, settings: &BakeSettings, progress: &dyn Progress) -> Result<AssetParts> {
    // Refuses values of keys now that would fail when the asset is opened.
    evaluate::plan(&settings.values, settings.max_rms)?;
    inter_reflection::outside(&settings.values, &RAYS)?;
    Ok(sampling::bake(scene, count(scene, settings), progress))
}
