//! `reference`: the brute-force truth. All pairs of samples and vertices, the near field integrated exactly, many rays;
//! its own error is measured and printed.

mod bake;
mod evaluate;

use std::sync::Arc;

use crate::asset::Asset;
use crate::error::Result;
use crate::evaluate::{AssetParts, BakeSettings, Evaluator, Key, Method};
use crate::progress::Progress;
use crate::transport::scene::Scene;

/// The method.
pub struct Reference;

/// Shadow rays of a sample.
const POINTS: Key = Key {
    name: "points",
    default: "16",
    help: "points of a sample that a directional or point light's shadow rays start from, a power of two",
};

/// Directions of soft lights.
const DIRECTIONS: Key = Key {
    name: "directions",
    default: "512",
    help: "shadow rays of a sample towards a constant light or an environment",
};

/// Cells of an area light.
const AREA_SIDE: Key =
    Key { name: "area-side", default: "16", help: "an area light is cut into this many cells along each edge" };

const KEYS: &[Key] = &[POINTS, DIRECTIONS, AREA_SIDE];

impl Method for Reference {
    fn name(&self) -> &'static str {
        "reference"
    }

    fn summary(&self) -> &'static str {
        "brute force: all pairs, exact near field; the truth that every error is measured against"
    }

    fn keys(&self) -> &'static [Key] {
        KEYS
    }

    fn bake_memory(&self, scene: &Scene, settings: &BakeSettings) -> u64 {
        bake::memory(scene, settings)
    }

    fn bake(&self, scene: &Scene, settings: &BakeSettings, progress: &dyn Progress) -> Result<AssetParts> {
        bake::bake(scene, settings, progress)
    }

    fn open(&self, asset: Arc<Asset>) -> Result<Box<dyn Evaluator>> {
        evaluate::open(asset)
    }
}
