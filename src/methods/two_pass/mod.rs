//! `two_pass`: irradiance at surface samples, then R_d summed through a tree (Jensen & Buhler 2002).

mod bake;
mod evaluate;

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::asset::Asset;
use crate::error::Result;
use crate::evaluate::{AssetParts, BakeSettings, Evaluator, Key, Method};
use crate::methods::inter_reflection::{self, INTER_REFLECTION};
use crate::methods::sampling;
use crate::progress::Progress;
use crate::transport::scene::Scene;

/// The method.
pub struct TwoPass;

/// Error of the hierarchy.
const ERROR: Key = Key {
    name: "error",
    default: "auto",
    help: "relative error asked of the hierarchy, such as 0.1%; auto: 30 % of --max-rms",
};

/// Criterion of the hierarchy.
const BOUND: Key = Key {
    name: "bound",
    default: "solid-angle",
    help: "which clusters stand for their samples: solid-angle or kernel (a bound on the kernel's error)",
};

const POINTS: Key = sampling::points("4");
const DIRECTIONS: Key = sampling::directions("256");
const AREA_SIDE: Key = sampling::area_side("8");

const RAYS: Key = inter_reflection::rays("32");

const KEYS: &[Key] = &[ERROR, BOUND, POINTS, DIRECTIONS, AREA_SIDE, INTER_REFLECTION, RAYS];

/// What charts compare.
const LADDER: &[&str] = &[
    "",
    "--max-rms 4% --samples 16384",
    "--max-rms 2% --samples 32768",
    "--max-rms 1%",
    "--max-rms 0.1%",
    "--set bound=kernel",
];

impl Method for TwoPass {
    fn name(&self) -> &'static str {
        "two_pass"
    }

    fn summary(&self) -> &'static str {
        "surface samples only; shadows and hierarchical transfer for each light (Jensen & Buhler 2002)"
    }

    fn keys(&self) -> &'static [Key] {
        KEYS
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

    fn stores_transport(&self, _settings: &BTreeMap<String, String>) -> bool {
        false
    }

    fn open(&self, asset: Arc<Asset>) -> Result<Box<dyn Evaluator>> {
        evaluate::open(asset)
    }
}
