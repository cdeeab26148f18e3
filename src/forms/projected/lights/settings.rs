//! The settings of `quantised_lights`.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::forms::density::Density;
use crate::forms::projected::references::Spacing;
use crate::forms::single_scattering::FirstOrder;
use crate::light::quantised::distances::Blend;
use crate::light::quantised::interpolation::Scheme;

/// Directions at most.
pub const MOST_DIRECTIONS: usize = 2048;

/// Shells at most.
pub const MOST_SHELLS: usize = 16;

/// A set of lights and the interpolation of other lights from it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LightSetSettings {
    /// Number of directions; `None`: as many as the error asks for.
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
    /// Number of samples of a bake.
    pub density: Density,
    /// Settings of the set of lights.
    pub lights: LightSetSettings,
    /// Distance between reference points.
    pub spacing: Spacing,
    /// Single scattering.
    pub single: FirstOrder,
}
