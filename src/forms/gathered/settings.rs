//! The settings of `gathered`.

use serde::{Deserialize, Serialize};

use crate::evaluate::inter_reflection::Outside;
use crate::evaluate::single_scattering::Traced;
use crate::forms::density::Density;
use crate::forms::environment_rows::EnvironmentRows;
use crate::transport::gather::Criterion;
use crate::transport::irradiance::LightSampling;
use crate::transport::multilevel::Quality;
use crate::transport::near_rule::NearField;

/// Samples, their lighting, and their summation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Gathered {
    /// Number of samples.
    pub density: Density,
    /// Light sampling by rays.
    pub sampling: LightSampling,
    /// Near field.
    pub near: NearField,
    /// Far field.
    pub far: Far,
    /// Receivers that share a traversal.
    pub group: u32,
    /// Error asked of sums over nets, which serve the vertices in place of the far field above; the bake finds the nets for it.
    pub nets: Option<f64>,
    /// Stored rows for light from far away, where the asset is made for environments.
    pub environment: Option<EnvironmentRows>,
    /// Single scattering by rays.
    pub single: Option<Traced>,
    /// Inter-reflection outside the medium.
    pub outside: Option<Outside>,
}

/// The far field.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Far {
    /// Every sample with every receiver.
    AllPairs,
    /// Through the tree, with an asked error relative to all pairs.
    Hierarchical {
        /// Asked relative error of the hierarchy alone.
        error: f64,
        /// Criterion for clusters that may stand for their samples.
        bound: Bound,
    },
}

/// The criterion that the asked error tunes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Bound {
    /// Solid angle of the cluster.
    SolidAngle,
    /// Bound on the kernel's error.
    Kernel,
}

impl Bound {
    /// The criterion at a limit.
    pub(super) fn criterion(self, limit: f64) -> Criterion {
        match self {
            Self::SolidAngle => Criterion::SolidAngle(limit),
            Self::Kernel => Criterion::KernelBound(limit),
        }
    }

    /// First limit of tuning: loose enough that a larger one would not pay, by the measured error of each criterion.
    pub(super) fn first_limit(self, error: f64) -> f64 {
        match self {
            Self::SolidAngle => (8.0 * error).clamp(1e-4, 1.0),
            Self::Kernel => 0.02 * error,
        }
    }
}

/// Settings of gathering radiosity from samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gathering {
    /// Light sampling by rays.
    pub sampling: LightSampling,
    /// Near field.
    pub near: NearField,
    /// Far field.
    pub far: Far,
    /// Receivers that share a traversal.
    pub group: usize,
    /// Nets for the radiosity of the vertices by multilevel summation; `None`: through the far field above.
    pub nets: Option<Quality>,
}

impl Gathered {
    /// Settings of an evaluator's sums, with nets of a quality.
    pub(crate) fn gathering(&self, nets: Option<Quality>) -> Gathering {
        let Self { sampling, near, far, group, .. } = *self;
        Gathering { sampling, near, far, group: group as usize, nets }
    }
}
