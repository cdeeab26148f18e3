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

/// Samples, how light reaches them, and how they are summed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Gathered {
    /// How many samples there are.
    pub density: Density,
    /// Rays.
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
    /// Light that leaves and falls on the surface again.
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
        /// Which clusters may stand for their samples.
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

    /// Where tuning starts: loose enough that a larger limit would not pay, by the measured error of each criterion.
    pub(super) fn first_limit(self, error: f64) -> f64 {
        match self {
            Self::SolidAngle => (8.0 * error).clamp(1e-4, 1.0),
            Self::Kernel => 0.02 * error,
        }
    }
}

/// How samples turn into radiosity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gathering {
    /// Rays.
    pub sampling: LightSampling,
    /// Near field.
    pub near: NearField,
    /// Far field.
    pub far: Far,
    /// Receivers that share a traversal.
    pub group: usize,
    /// Radiosity of the vertices by multilevel summation; through the far field above otherwise.
    pub nets: Option<Quality>,
}

impl Gathered {
    /// How an evaluator sums, with nets of a quality.
    pub(super) fn gathering(&self, nets: Option<Quality>) -> Gathering {
        let Self { sampling, near, far, group, .. } = *self;
        Gathering { sampling, near, far, group: group as usize, nets }
    }
}
