//! `quantized_lights`: radiosity under a quantised set of lights, precomputed; any light is interpolated from the set (Hao &
//! Varshney 2004).

mod bake;
mod bleeding;
mod encoding;
mod evaluate;
mod lights;
mod sections;
mod seen;
mod values;

use std::sync::Arc;

use self::encoding::{Choices, Encoding};
use self::lights::Plan;
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
    help: "between the lights (not for sh): rbf (smooth), least-squares, barycentric, nearest4 (the paper's, which jumps)",
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
    help: "distance between reference points of components, mm; auto: what --max-rms asks for",
};

const ENCODING: Key = Key {
    name: "encoding",
    default: "auto",
    help: "what is stored: auto (components), components, and the paper's: raw, uniform8, lloyd8, sh, reference-points \
           (these with 200 lights where lights=auto, more for sh of a high order); bleeding: nothing, two passes over lists of \
           neighbouring vertices for each light",
};

const INTEGRAL: Key = Key {
    name: "integral",
    default: "scalar",
    help: "for raw, uniform8 and lloyd8: scalar (q of the paper), vector (Q, three times the size, parallel light only)",
};

const ORDER: Key = Key {
    name: "order",
    default: "auto",
    help: "order n of spherical harmonics, 1 to 32, n^2 coefficients; auto: for sh what --max-rms asks for (7 in the paper), for \
           reference-points 3",
};

const WINDOW: Key = Key {
    name: "window",
    default: "none",
    help: "for sh, against ringing: none, lanczos, hanning (smoother and less exact)",
};

const REFERENCES: Key = Key {
    name: "references",
    default: "auto",
    help: "number of reference points, for components (about) and reference-points; auto: what --max-rms asks for",
};

const CHOICE: Key = Key {
    name: "choice",
    default: "illumination",
    help: "what reference points follow, for reference-points: geometry (the paper's), illumination (as well as geometry)",
};

const WEIGHTS: Key = Key {
    name: "weights",
    default: "best",
    help: "of three reference points, for reference-points: barycentric (the paper's), least-squares, best (of the triangles nearby \
           as well)",
};

const KEYS: &[Key] = &[
    LIGHTS,
    INTERPOLATION,
    SHELLS,
    NEAREST,
    BLEND,
    SPACING,
    ENCODING,
    INTEGRAL,
    ORDER,
    WINDOW,
    REFERENCES,
    CHOICE,
    WEIGHTS,
    bleeding::RANGE_SHARE,
];

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
    "--set encoding=lloyd8",
    "--set encoding=lloyd8 --set interpolation=nearest4",
    "--set encoding=sh --set order=7",
    "--set encoding=reference-points",
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
        // Keys that are refused take no memory; the bake says what is wrong with them.
        let Ok(plan) = Plan::new(&settings.values, &settings.for_lights) else { return bake::memory(scene, settings) };
        match plan.choices.encoding {
            Encoding::Components => bake::memory(scene, settings),
            Encoding::Bleeding => bleeding::memory(scene, settings),
            Encoding::Raw | Encoding::Uniform8 | Encoding::Lloyd8 | Encoding::Harmonics | Encoding::ReferencePoints => {
                values::bake::memory(scene, settings, &plan)
            }
        }
    }

    fn bake(&self, scene: &Scene, settings: &BakeSettings, progress: &dyn Progress) -> Result<AssetParts> {
        let plan = Plan::new(&settings.values, &settings.for_lights)?;
        // Judged where it is not used as well.
        bleeding::range_share(&settings.values, settings.max_rms)?;
        match plan.choices.encoding {
            Encoding::Components => bake::bake(scene, settings, progress),
            Encoding::Bleeding => bleeding::bake(scene, settings, progress),
            Encoding::Raw | Encoding::Uniform8 | Encoding::Lloyd8 | Encoding::Harmonics | Encoding::ReferencePoints => {
                values::bake::bake(scene, settings, &plan, progress)
            }
        }
    }

    fn open(&self, asset: Arc<Asset>) -> Result<Box<dyn Evaluator>> {
        let choices = Choices::new(&asset.provenance.settings)?;
        match choices.encoding {
            Encoding::Components => evaluate::open(&asset),
            Encoding::Bleeding => bleeding::open(asset),
            Encoding::Raw | Encoding::Uniform8 | Encoding::Lloyd8 | Encoding::Harmonics | Encoding::ReferencePoints => {
                values::open(&asset, &choices)
            }
        }
    }
}
