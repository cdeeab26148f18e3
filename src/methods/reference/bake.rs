//! What `reference` precomputes: the surface samples.

use super::{RAYS, evaluate};
use crate::error::Result;
use crate::evaluate::{AssetParts, BakeSettings};
use crate::methods::inter_reflection;
use crate::methods::sampling::{self, Density};
use crate::progress::Progress;
use crate::transport::scene::Scene;

/// Shadow boundaries stay well inside the kernel.
const DENSITY: Density = Density { spacing: 0.2, least: 1 << 17, most: 1 << 19 };

fn count(scene: &Scene, settings: &BakeSettings) -> usize {
    DENSITY.count(scene, settings, 1.0)
}

pub(super) fn memory(scene: &Scene, settings: &BakeSettings) -> u64 {
    let samples = count(scene, settings);
    sampling::memory(samples, scene) + inter_reflection::memory(scene, samples, &settings.values, &RAYS)
}

pub(super) fn bake(scene: &Scene, settings: &BakeSettings, progress: &dyn Progress) -> Result<AssetParts> {
    // Refuses values of keys now that would fail when the asset is opened.
    evaluate::plan(&settings.values)?;
    evaluate::single_scattering(&settings.values)?;
    inter_reflection::outside(&settings.values, &RAYS)?;
    Ok(sampling::bake(scene, count(scene, settings), progress))
}
