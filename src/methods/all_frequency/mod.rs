//! `all_frequency`: radiosity under light from far away, transport stored as vectors over the directions of an environment (Wang,
//! Tran & Luebke 2005).

mod bake;
mod bake_harmonics;
mod bake_returned;
mod bake_rows;
mod bake_single;
mod evaluate;
mod harmonics;
mod plan;
mod rows;
mod single;
pub mod uncoded;

use std::sync::Arc;

use self::plan::Plan;
use crate::asset::Asset;
use crate::error::Result;
use crate::evaluate::{AssetParts, BakeSettings, Evaluator, Key, Method};
use crate::light::LightKind;
use crate::methods::inter_reflection::{self, INTER_REFLECTION};
use crate::methods::single_keys;
use crate::progress::Progress;
use crate::transport::scene::Scene;

/// The method.
pub struct AllFrequency;

/// Kinds of light that come from far away.
const KINDS: &[LightKind] = &[LightKind::Constant, LightKind::Directional, LightKind::Environment];

const CUBE: Key = Key {
    name: "cube",
    default: "32",
    help: "texels along an edge of the cube map that irradiance is sampled on: 32 or 64",
};

const BASIS: Key = Key {
    name: "basis",
    default: "auto",
    help: "of the light: sh (spherical harmonics, coded over the vertices), haar (wavelets of the cube map, the paper's), auto (sh)",
};

const COEFFICIENTS: Key = Key {
    name: "coefficients",
    default: "auto",
    help: "for haar: kept for each vertex, 6 and more, auto 128 (the paper's); for sh: a square, 1 to 576; auto: what --max-rms asks for",
};

const TRANSFORM: Key = Key {
    name: "transform",
    default: "solid-angle",
    help: "for haar: orthonormal on the sphere (solid-angle) or on the texels (texels, the paper's)",
};

const SELECTION: Key = Key {
    name: "selection",
    default: "light",
    help: "which coefficients haar keeps: the largest of each vertex (magnitude, the paper's), the largest times expected light \
           (light), the same at one threshold for all vertices (rate)",
};

const SPACING: Key = Key {
    name: "spacing",
    default: "auto",
    help: "for sh: distance between reference points, mm; auto: what --max-rms asks for",
};

const REFERENCES: Key = Key {
    name: "references",
    default: "auto",
    help: "for sh: number of reference points (about); auto: what --max-rms asks for",
};

const SINGLE: Key = Key {
    name: "single-scattering",
    default: "off",
    help: "off; isotropic: with reduced coefficients, a value for each vertex; folded: the same as part of the radiosity, which costs \
           nothing at run time; phase: by the g of each medium, towards the eye, and \
           g stays free at run time (its directions; extinction is baked)",
};

const SINGLE_BASIS: Key = Key {
    name: "single-basis",
    default: "auto",
    help: "of light that is scattered once: sh or haar (isotropic, 128 coefficients for each vertex unless basis=haar has others); \
           auto: that of the radiosity, sh for phase",
};

const PHASE_TERMS: Key = Key {
    name: "phase-terms",
    default: "auto",
    help: "for phase: harmonics of the phase function, 1, 4, 9 or 16; rays: nothing is stored, rays are cast at run time, right \
           for every g; auto: what g and --max-rms ask for",
};

const RAYS: Key = inter_reflection::rays("32");

const KEYS: &[Key] = &[
    CUBE,
    BASIS,
    COEFFICIENTS,
    TRANSFORM,
    SELECTION,
    SPACING,
    REFERENCES,
    SINGLE,
    SINGLE_BASIS,
    PHASE_TERMS,
    single_keys::FORM,
    single_keys::CROSSINGS,
    INTER_REFLECTION,
    RAYS,
];

/// What charts compare.
const LADDER: &[&str] = &[
    "",
    "--max-rms 5%",
    "--max-rms 2%",
    "--max-rms 0.5%",
    "--set basis=haar --set selection=magnitude --set transform=texels",
    "--set basis=haar --set selection=magnitude",
    "--set basis=haar",
    "--set basis=haar --set selection=rate",
    "--set basis=haar --set coefficients=512",
    "--set coefficients=25",
];

impl Method for AllFrequency {
    fn name(&self) -> &'static str {
        "all_frequency"
    }

    fn summary(&self) -> &'static str {
        "transport vectors over an environment; the fastest new environment, material baked in (Wang, Tran & Luebke 2005)"
    }

    fn keys(&self) -> &'static [Key] {
        KEYS
    }

    fn kinds(&self) -> &'static [LightKind] {
        KINDS
    }

    fn default_max_rms(&self) -> f64 {
        0.01
    }

    fn ladder(&self) -> &'static [&'static str] {
        LADDER
    }

    fn bake_memory(&self, scene: &Scene, settings: &BakeSettings) -> u64 {
        bake::memory(scene, settings)
    }

    fn bake(&self, scene: &Scene, settings: &BakeSettings, progress: &dyn Progress) -> Result<AssetParts> {
        let plan = Plan::new(&settings.values)?;
        plan.check(&settings.values, &settings.for_lights)?;
        bake::bake(scene, settings, &plan, progress)
    }

    fn open(&self, asset: Arc<Asset>) -> Result<Box<dyn Evaluator>> {
        evaluate::open(&asset)
    }
}
