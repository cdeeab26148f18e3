//! `quantized_lights`: radiosity under a quantised set of lights, precomputed; any light is interpolated from the set (Hao &
//! Varshney 2004).

mod bake;
mod baked_in;
mod basis;
mod bleeding;
mod evaluate;
mod lights;
mod sections;
mod stage;

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::asset::Asset;
use crate::error::{Error, Result};
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

const BLEND: Key = Key {
    name: "blend",
    default: "polynomial",
    help: "between the distances of point lights: polynomial through all, or linear between two (the paper's, with nearest4)",
};

const SPACING: Key = Key {
    name: "spacing",
    default: "auto",
    help: "distance between reference points, mm; auto: what --max-rms asks for",
};

const ENCODING: Key = Key {
    name: "encoding",
    default: "auto",
    help: "auto: quantised lights; bleeding: none, two passes over lists of neighbouring vertices for each light, for comparison",
};

const KEYS: &[Key] = &[LIGHTS, INTERPOLATION, SHELLS, NEAREST, BLEND, SPACING, ENCODING, bleeding::RANGE_SHARE];

/// What an asset keeps of the transport.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Encoding {
    Auto,
    Bleeding,
}

fn encoding(values: &BTreeMap<String, String>) -> Result<Encoding> {
    match values.get(ENCODING.name).map_or(ENCODING.default, String::as_str) {
        "auto" => Ok(Encoding::Auto),
        "bleeding" => Ok(Encoding::Bleeding),
        other => Err(Error::command_line(format!("--set encoding={other}: it is auto or bleeding"))),
    }
}

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
        0.02
    }

    fn ladder(&self) -> &'static [&'static str] {
        LADDER
    }

    fn bake_memory(&self, scene: &Scene, settings: &BakeSettings) -> u64 {
        match encoding(&settings.values) {
            Ok(Encoding::Bleeding) => bleeding::memory(scene, settings),
            _ => bake::memory(scene, settings),
        }
    }

    fn bake(&self, scene: &Scene, settings: &BakeSettings, progress: &dyn Progress) -> Result<AssetParts> {
        // Values of keys that this encoding does not use are judged as well.
        lights::Plan::new(&settings.values, &settings.for_lights)?;
        bleeding::range_share(&settings.values, settings.max_rms)?;
        match encoding(&settings.values)? {
            Encoding::Auto => bake::bake(scene, settings, progress),
            Encoding::Bleeding => bleeding::bake(scene, settings, progress),
        }
    }

    fn open(&self, asset: Arc<Asset>) -> Result<Box<dyn Evaluator>> {
        match encoding(&asset.provenance.settings)? {
            Encoding::Auto => evaluate::open(asset),
            Encoding::Bleeding => bleeding::open(asset),
        }
    }
}
