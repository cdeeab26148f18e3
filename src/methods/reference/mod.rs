//! `reference`: the brute-force truth. All pairs of samples and vertices, the near field integrated exactly, many rays;
//! its own error is measured and printed.

mod bake;
mod evaluate;

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::asset::Asset;
use crate::error::Result;
use crate::evaluate::{AssetParts, BakeSettings, Evaluator, Key, Method};
use crate::methods::inter_reflection::{self, INTER_REFLECTION};
use crate::methods::sampling;
use crate::methods::single_keys;
use crate::progress::Progress;
use crate::transport::scene::Scene;

/// The method.
pub struct Reference;

const POINTS: Key = sampling::points("16");
const DIRECTIONS: Key = sampling::directions("512");
const AREA_SIDE: Key = sampling::area_side("16");

/// Whether there is single scattering.
const SINGLE: Key = Key {
    name: "single-scattering",
    default: "off",
    help: "off; isotropic: with reduced coefficients, for each vertex along the inverse normal and in pictures along the \
           refracted direction; phase: by the medium's g, in pictures alone unless g = 0",
};

const SINGLE_SAMPLES: Key = Key {
    name: "single-samples",
    default: "128",
    help: "places inside where light is scattered once, for each vertex or pixel and each directional or point light; other \
           lights take 16 times as many",
};

const RAYS: Key = inter_reflection::rays("64");

const KEYS: &[Key] = &[
    POINTS,
    DIRECTIONS,
    AREA_SIDE,
    SINGLE,
    SINGLE_SAMPLES,
    single_keys::FORM,
    single_keys::CROSSINGS,
    INTER_REFLECTION,
    RAYS,
];

/// What charts compare.
const LADDER: &[&str] = &["", "--samples 16384", "--samples 65536"];

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
