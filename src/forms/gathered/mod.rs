//! `gathered`: nothing is stored but surface samples. Light reaches the samples by ray casting, or through stored rows where it comes
//! from far away, and is summed at the receivers for each light: over all pairs, through a hierarchy, or over nets.

mod bake;
mod errors;
mod evaluator;
#[cfg(feature = "gpu")]
mod hierarchy_gpu;
mod lit_samples;
mod nets;
#[cfg(feature = "gpu")]
mod nets_gpu;
mod settings;

use std::sync::Arc;

pub use self::lit_samples::GatheredEvaluator;
pub use self::settings::{Bound, Far, Gathered, Gathering};
use crate::asset::Asset;
use crate::error::{Error, Result};
use crate::evaluate::inter_reflection::Outside;
use crate::evaluate::single_scattering::Traced;
use crate::evaluate::{AssetParts, BakeSettings, Evaluator, Form};
use crate::forms::environment_rows::EnvironmentRows;
use crate::progress::Progress;
use crate::scene::Scene;

impl Form for Gathered {
    const NAME: &'static str = "gathered";

    fn validate(&self) -> Result<()> {
        self.density.validate()?;
        self.sampling.validate()?;
        self.near.validate()?;
        if !(1..=4096).contains(&self.group) {
            return Err(Error::input(format!("{} receivers in a group, not 1 to 4096", self.group)));
        }
        let share = |value: f64| value.is_finite() && value > 0.0 && value <= 1.0;
        let hierarchy = match self.far {
            Far::AllPairs => None,
            Far::Hierarchical { error, .. } => Some(error),
        };
        if let Some(error) = hierarchy.into_iter().chain(self.nets).find(|error| !share(*error)) {
            return Err(Error::input(format!("an asked error of {error}, not above 0 and at most 1")));
        }
        self.environment.iter().try_for_each(EnvironmentRows::validate)?;
        self.single.iter().try_for_each(Traced::validate)?;
        self.outside.iter().try_for_each(Outside::validate)
    }

    fn holds_transport(&self) -> bool {
        false
    }

    fn bake_memory(&self, scene: &Scene, settings: &BakeSettings) -> u64 {
        bake::memory(self, scene, settings)
    }

    fn bake(&self, scene: &Scene, settings: &BakeSettings, progress: &dyn Progress) -> Result<AssetParts> {
        bake::bake(self, scene, settings, progress)
    }

    fn open(&self, asset: Arc<Asset>) -> Result<Box<dyn Evaluator>> {
        bake::open(self, asset)
    }
}
