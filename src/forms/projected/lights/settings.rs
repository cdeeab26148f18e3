//! The settings of `quantised_lights`.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::{bake, evaluate};
use crate::asset::Asset;
use crate::error::{Error, Result};
use crate::evaluate::{AssetParts, BakeSettings, Evaluator, Form};
use crate::forms::density::Density;
use crate::forms::projected::references::Spacing;
use crate::light::quantised::distances::Blend;
use crate::light::quantised::interpolation::Scheme;
use crate::progress::Progress;
use crate::scene::Scene;

/// Directions at most.
pub const MOST_DIRECTIONS: usize = 2048;

/// Shells at most.
pub const MOST_SHELLS: usize = 16;

/// A set of lights and how others are interpolated from it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LightSetSettings {
    /// Directions; as many as the error asks for.
    pub directions: Option<usize>,
    /// Interpolation between directions.
    pub scheme: Scheme,
    /// Interpolation between distances.
    pub blend: Blend,
    /// Shells of point lights beside parallel light.
    pub shells: usize,
    /// Bounding radius over the distance of the nearest shell.
    pub nearest: f64,
}

impl LightSetSettings {
    /// Refuses settings out of range.
    ///
    /// # Errors
    /// Invalid input.
    pub fn validate(&self) -> Result<()> {
        let fits = self.directions.is_none_or(|count| (16..=MOST_DIRECTIONS).contains(&count))
            && self.shells <= MOST_SHELLS
            && (0.01..1.0).contains(&self.nearest);
        if fits { Ok(()) } else { Err(Error::input(format!("a set of lights out of range: {self:?}"))) }
    }
}

/// Radiosity under a set of lights at reference points, as principal components.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct QuantisedLights {
    /// How many samples a bake takes.
    pub density: Density,
    /// The set.
    pub lights: LightSetSettings,
    /// Distance between reference points.
    pub spacing: Spacing,
}

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
