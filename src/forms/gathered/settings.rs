//! The settings of `gathered`.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::bake;
use crate::asset::Asset;
use crate::error::{Error, Result};
use crate::evaluate::inter_reflection::Outside;
use crate::evaluate::single_scattering::Traced;
use crate::evaluate::{AssetParts, BakeSettings, Evaluator, Form};
use crate::forms::density::Density;
use crate::forms::environment_rows::EnvironmentRows;
use crate::progress::Progress;
use crate::scene::Scene;
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
