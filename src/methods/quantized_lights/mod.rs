//! `quantized_lights`: radiosity under a quantised set of lights, precomputed; any light is interpolated from the set (Hao &
//! Varshney 2004).

mod bake;
mod basis;
mod evaluate;
#[cfg(feature = "gpu")]
mod gpu;
mod lights;
mod sections;
mod stage;

use std::sync::Arc;

use crate::asset::Asset;
use crate::error::Result;
use crate::evaluate::{AssetParts, BakeSettings, Evaluator, Key, Method};
use crate::progress::Progress;
use crate::transport::scene::Scene;

/// The method.
pub struct QuantizedLights;

const LIGHTS: Key = Key {
    name: "lights",
    default: "auto",
    help: "directions in the set, 16 to 2048 (200 in the paper); auto: as many as --max-rms asks for",
};

const INTERPOLATION: Key = Key {
    name: "interpolation",
    default: "rbf",
    help: "between the lights: rbf (smooth), least-squares, barycentric, nearest4 (the paper's, which jumps)",
};

const SHELLS: Key = Key {
    name: "shells",
    default: "auto",
    help: "distances of point and area lights in the set, beside infinity, 0 to 16; auto: 3 where --for-lights has them, else 0",
};

const NEAREST: Key = Key {
    name: "nearest",
    default: "1.5",
    help: "nearest distance of point and area lights, in bounding radii from the centre, 1.05 to 100",
};

const SPACING: Key = Key {
    name: "spacing",
    default: "auto",
    help: "distance between reference points, mm; auto: what --max-rms asks for",
};

const KEYS: &[Key] = &[LIGHTS, INTERPOLATION, SHELLS, NEAREST, SPACING];

/// What charts compare.
const LADDER: &[&str] = &[
    "",
    "--max-rms 10%",
    "--max-rms 5%",
    "--max-rms 2%",
    "--set lights=200",
    "--set lights=200 --set interpolation=nearest4",
    "--set lights=200 --set interpolation=barycentric",
    "--set lights=200 --set interpolation=least-squares",
];

impl Method for QuantizedLights {
    fn name(&self) -> &'static str {
        "quantized_lights"
    }

    fn summary(&self) -> &'static str {
        "radiosity under a set of lights, interpolated; the fastest new light, material baked in (Hao & Varshney 2004)"
    }

    fn keys(&self) -> &'static [Key] {
        KEYS
    }

    fn default_max_rms(&self) -> f64 {
        0.03
    }

    fn ladder(&self) -> &'static [&'static str] {
        LADDER
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
