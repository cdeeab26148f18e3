//! `quantised_lights`: radiosity under a quantised set of lights at reference points; any light is interpolated from the set (Hao &
//! Varshney 2004).

mod bake;
mod evaluate;
mod light_set;
mod sections;
mod seen;
mod settings;

use std::sync::Arc;

pub use self::bake::{TUNING, chosen};
pub use self::light_set::LightSet;
pub use self::seen::{Seen, irradiance_of_seen, neighbours, radiosity_of_set};
pub use self::settings::{LightSetSettings, MOST_DIRECTIONS, MOST_SHELLS, QuantisedLights};
use crate::asset::Asset;
use crate::error::Result;
use crate::evaluate::{AssetParts, BakeSettings, Evaluator, Form};
use crate::progress::Progress;
use crate::scene::Scene;

impl Form for QuantisedLights {
    const NAME: &'static str = "quantised_lights";

    fn validate(&self) -> Result<()> {
        self.density.validate()?;
        self.lights.validate()?;
        self.spacing.validate()
    }

    fn bake_memory(&self, scene: &Scene, settings: &BakeSettings) -> u64 {
        bake::memory(self, scene, settings)
    }

    fn bake(&self, scene: &Scene, settings: &BakeSettings, progress: &dyn Progress) -> Result<AssetParts> {
        bake::bake(self, scene, settings, progress)
    }

    fn open(&self, asset: Arc<Asset>) -> Result<Box<dyn Evaluator>> {
        evaluate::open(self, &asset)
    }
}
