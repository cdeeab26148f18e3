//! The settings of `factored`.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::levels::MOST_LEVELS;
use super::{bake, evaluate};
use crate::asset::Asset;
use crate::error::{Error, Result};
use crate::evaluate::{AssetParts, BakeSettings, Evaluator, Form};
use crate::forms::density::Density;
use crate::forms::environment_rows::EnvironmentRows;
use crate::medium::profile_basis::Family;
use crate::progress::Progress;
use crate::scene::Scene;
use crate::transport::far_field;
use crate::transport::irradiance::LightSampling;
use crate::transport::near_rule::NearField;

/// Transport of each function of a basis of R_d: the far field stored, the near field from the geometry.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Factored {
    /// How many samples there are.
    pub density: Density,
    /// Functions of the basis.
    pub family: Family,
    /// How many; as few as `basis_error` allows.
    pub terms: Option<usize>,
    /// Error asked of the basis for any light (T1), over the total reflectance.
    pub basis_error: f64,
    /// Near-field radius over the spacing of the samples.
    pub split: f64,
    /// Distance of the points of the far field over the spacing of the samples; 0: every receiver is one. None: as `interpolation`
    /// allows, at most `widest_far_spacing`.
    pub far_spacing: Option<f64>,
    /// See there.
    pub widest_far_spacing: f64,
    /// Error asked of interpolating the far field.
    pub interpolation: f64,
    /// Levels of spacing of these points.
    pub levels: usize,
    /// Error asked of them.
    pub levels_error: f64,
    /// Error asked of dropping coefficients.
    pub truncation: f64,
    /// Error asked of quantising them.
    pub quantiser: f64,
    /// Cells of the hierarchy open above this radius over distance.
    pub opening: f64,
    /// Rays.
    pub sampling: LightSampling,
    /// Near field.
    pub near: NearField,
    /// Stored rows for light from far away, where the asset is made for environments.
    pub environment: Option<EnvironmentRows>,
}

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
