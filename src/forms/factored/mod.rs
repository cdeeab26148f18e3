//! `factored`: transport of each function of a basis of R_d, so that the material is chosen when the asset is evaluated (Wang et al.
//! 2008).

mod bake;
mod choice;
mod evaluate;
mod evaluator;
#[cfg(feature = "gpu")]
mod far_field_gpu;
mod far_sums;
#[cfg(feature = "gpu")]
mod gpu;
mod interpolation;
mod ledger;
mod levels;
mod ordered_samples;
mod points;
mod sections;
mod settings;
mod sources;
mod subset;

use std::sync::Arc;

pub use self::settings::{Factored, MOST_LEVELS};
use crate::asset::Asset;
use crate::error::{Error, Result};
use crate::evaluate::{AssetParts, BakeSettings, Evaluator, Form};
use crate::forms::environment_rows::EnvironmentRows;
use crate::progress::Progress;
use crate::scene::Scene;
use crate::transport::far_field;

impl Form for Factored {
    const NAME: &'static str = "factored";

    fn validate(&self) -> Result<()> {
        self.density.validate()?;
        self.sampling.validate()?;
        self.near.validate()?;
        self.environment.iter().try_for_each(EnvironmentRows::validate)?;
        let shares = [self.basis_error, self.interpolation, self.levels_error, self.truncation, self.quantiser];
        if let Some(share) = shares.into_iter().find(|share| !(*share > 0.0 && *share <= 1.0)) {
            return Err(Error::input(format!("an asked error of {share}, not above 0 and at most 1")));
        }
        let spacings = self.far_spacing.into_iter().chain([self.widest_far_spacing]);
        let fits = self.terms.is_none_or(|terms| (1..=far_field::TERMS).contains(&terms))
            && (1..=MOST_LEVELS).contains(&self.levels)
            && (4.0..=64.0).contains(&self.split)
            && (1e-3..=1.0).contains(&self.opening)
            && spacings.into_iter().all(|spacing| (0.0..=8.0).contains(&spacing));
        if !fits {
            return Err(Error::input(format!("settings of the far field out of range: {self:?}")));
        }
        Ok(())
    }

    fn bake_memory(&self, scene: &Scene, settings: &BakeSettings) -> u64 {
        bake::memory(self, scene, settings)
    }

    fn bake(&self, scene: &Scene, settings: &BakeSettings, progress: &dyn Progress) -> Result<AssetParts> {
        bake::bake(self, scene, settings, progress)
    }

    fn open(&self, asset: Arc<Asset>) -> Result<Box<dyn Evaluator>> {
        evaluate::open(*self, &asset)
    }
}
