//! `editable`: the material is chosen when the asset is evaluated (Wang et al. 2008): sums over samples at run time, or stored
//! transport of a basis of R_d.

mod bake;
mod choice;
mod environment;
mod evaluate;
#[cfg(feature = "gpu")]
mod gpu;
mod interpolation;
mod ledger;
mod levels;
mod plan;
mod points;
mod sections;
mod sources;
mod subset;
mod unstored;

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::asset::Asset;
use crate::error::Result;
use crate::evaluate::{AssetParts, BakeSettings, Evaluator, Key, Method};
use crate::methods::sampling;
use crate::progress::Progress;
use crate::transport::scene::Scene;

/// The method.
pub struct Editable;

const TRANSPORT: Key = Key {
    name: "transport",
    default: "none",
    help: "none: samples alone, summed at run time with any profile, at any size; or stored, of a basis of R_d",
};

const BASIS: Key = Key {
    name: "basis",
    default: "ladder",
    help: "ladder: Gaussians that are combined without negative coefficients; transported: principal components weighted for \
           transported light over this object's range; or plain: the components of the paper",
};

const TERMS: Key = Key {
    name: "terms",
    default: "auto",
    help: "basis functions, 1 to 16; auto: as few as a fifth of --max-rms allows for the published materials and others",
};

const SPLIT: Key = Key {
    name: "split",
    default: "6",
    help: "radius of the near field, which is not stored, in sample spacings, 4 to 64",
};

const FAR_SPACING: Key = Key {
    name: "far-spacing",
    default: "auto",
    help: "distance of the points that the far field is stored at, in sample spacings, 0.5 to 8; 0: every vertex; auto: as \
           far as 60 % of --max-rms lets them",
};

const FAR_LEVELS: Key = Key {
    name: "far-levels",
    default: "4",
    help: "spacings of these points, 1 to 4, each twice as far as the one before: every basis function has the widest that 20 % of \
           --max-rms lets it",
};

const TRUNCATION: Key = Key {
    name: "truncation",
    default: "auto",
    help: "relative error asked of dropping coefficients, such as 0.3%; auto: 60 % of --max-rms",
};

const CUBE: Key =
    Key { name: "cube", default: "32", help: "texels along an edge of the environment's cube map, 32 or 64" };

const COEFFICIENTS: Key = Key {
    name: "coefficients",
    default: "128",
    help: "irradiance rows of samples have the squared error of so many Haar coefficients for each sample, 8 to 1024",
};

const POINTS: Key = sampling::points("4");
const DIRECTIONS: Key = sampling::directions("256");
const AREA_SIDE: Key = sampling::area_side("8");

const KEYS: &[Key] = &[
    TRANSPORT,
    BASIS,
    TERMS,
    SPLIT,
    FAR_SPACING,
    FAR_LEVELS,
    TRUNCATION,
    CUBE,
    COEFFICIENTS,
    POINTS,
    DIRECTIONS,
    AREA_SIDE,
];

/// What charts compare.
const LADDER: &[&str] = &[
    "",
    "--set transport=stored",
    "--samples 32768 --set points=1",
    "--max-rms 0.2%",
    "--max-rms 4% --set transport=stored",
    "--max-rms 2% --set transport=stored",
    "--samples 32768 --set transport=stored",
    "--max-rms 0.5% --set transport=stored",
    "--max-rms 0.5% --samples 262144 --set transport=stored",
];

impl Method for Editable {
    fn name(&self) -> &'static str {
        "editable"
    }

    fn summary(&self) -> &'static str {
        "the material is chosen later: samples summed at run time, or transport of a basis of R_d (Wang et al. 2008)"
    }

    fn keys(&self) -> &'static [Key] {
        KEYS
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
        bake::bake(scene, settings, progress)
    }

    fn stores_transport(&self, settings: &BTreeMap<String, String>) -> bool {
        !matches!(plan::Transport::of(settings), Ok(plan::Transport::None))
    }

    fn open(&self, asset: Arc<Asset>) -> Result<Box<dyn Evaluator>> {
        evaluate::open(asset)
    }
}
