//! The settings of `factored`.

use serde::{Deserialize, Serialize};

use crate::forms::density::Density;
use crate::forms::environment_rows::EnvironmentRows;
use crate::medium::profile_basis::Family;
use crate::transport::irradiance::LightSampling;
use crate::transport::near_rule::NearField;

/// Levels of spacing at most.
pub const MOST_LEVELS: usize = 4;

/// Transport of each function of a basis of R_d: the far field stored, the near field from the geometry.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Factored {
    /// Number of samples.
    pub density: Density,
    /// Family of the basis functions.
    pub family: Family,
    /// Number of basis functions; `None`: as few as `basis_error` allows.
    pub terms: Option<usize>,
    /// Error asked of the basis for any light (T1), over the total reflectance.
    pub basis_error: f64,
    /// Near-field radius over the spacing of the samples.
    pub split: f64,
    /// Spacing of the points of the far field over that of the samples; 0: every receiver is a point. `None`: as
    /// `interpolation` allows, at most `widest_far_spacing`.
    pub far_spacing: Option<f64>,
    /// Largest `far_spacing` that is chosen.
    pub widest_far_spacing: f64,
    /// Error asked of interpolating the far field.
    pub interpolation: f64,
    /// Levels of spacing of the far field's points.
    pub levels: usize,
    /// Error asked of choosing these levels.
    pub levels_error: f64,
    /// Error asked of dropping coefficients.
    pub truncation: f64,
    /// Error asked of quantising coefficients.
    pub quantiser: f64,
    /// Cells of the hierarchy open above this radius over distance.
    pub opening: f64,
    /// Light sampling by rays.
    pub sampling: LightSampling,
    /// Near field.
    pub near: NearField,
    /// Stored rows for light from far away, where the asset is made for environments.
    pub environment: Option<EnvironmentRows>,
}
