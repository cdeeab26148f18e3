//! Single scattering of forms that keep no basis of their own for it: by rays, when the asset is evaluated or when it is baked.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::evaluate::{ByRays, exits};
use crate::error::{Error, Result};
use crate::evaluate::single_scattering::{LitScene, Scattering, Traced};
use crate::forms::baked_in::Single;
use crate::forms::sampled_scene::SampledScene;
use crate::light::Light;
use crate::medium::profile::Orders;
use crate::parallel::*;
use crate::progress::Progress;
use crate::transport::single_scattering::ExitPoint;

/// Where light that scatters once is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub enum FirstOrder {
    /// In the kernel, which holds all orders.
    #[default]
    InKernel,
    /// Isotropic, a part of the stored radiosity.
    Folded(Traced),
    /// Beside the radiosity, at run time.
    AtRunTime(Traced),
}

impl FirstOrder {
    /// The orders of scattering that the kernel holds.
    pub fn orders(&self) -> Orders {
        Orders::beside_first(*self != Self::InKernel)
    }

    /// Refuses settings out of range.
    ///
    /// # Errors
    /// Invalid input.
    pub fn validate(&self) -> Result<()> {
        match self {
            Self::InKernel => Ok(()),
            Self::AtRunTime(traced) => traced.validate(),
            Self::Folded(traced) => {
                traced.validate()?;
                match traced.scattering {
                    Scattering::Isotropic => Ok(()),
                    Scattering::OfMedium => Err(Error::input("folded single scattering is isotropic")),
                }
            }
        }
    }

    /// That of an opened asset.
    pub(crate) fn opened(self) -> Single {
        match self {
            Self::InKernel => Single::None,
            Self::Folded(traced) => Single::Folded(traced),
            Self::AtRunTime(traced) => Single::Beside(Box::new(ByRays(traced))),
        }
    }

    /// What is added to the radiosity of receivers.
    pub(crate) fn folded<'a>(&self, sampled: &'a SampledScene<'a>) -> Option<Folding<'a>> {
        match self {
            Self::Folded(traced) => {
                let exits = exits(sampled.scene, &sampled.receivers);
                Some(Folding { traced: *traced, sampled, exits })
            }
            Self::InKernel | Self::AtRunTime(_) => None,
        }
    }
}

/// Isotropic single scattering of receivers, by rays.
pub(crate) struct Folding<'a> {
    traced: Traced,
    sampled: &'a SampledScene<'a>,
    /// Where the light of each receiver leaves.
    exits: Vec<ExitPoint>,
}

impl Folding<'_> {
    /// Adds it to the radiosity of every receiver under a light.
    ///
    /// # Errors
    /// Lights that cannot be served.
    pub(crate) fn add(&self, light: &Light, radiosity: &mut [DVec3]) -> Result<()> {
        let numbered: Vec<(u64, ExitPoint)> = (0..).zip(self.exits.iter().copied()).collect();
        let single = self.under(light, &numbered)?;
        radiosity.iter_mut().zip(single).for_each(|(sum, s)| *sum += s);
        Ok(())
    }

    /// Adds it to values `[point][channel][light]` of some receivers, in their order; `light` gives each light of the set.
    ///
    /// # Errors
    /// Lights that cannot be served.
    pub(crate) fn add_under_set(
        &self,
        points: &[u32],
        (count, light): (usize, impl Fn(usize) -> Option<Light>),
        values: &mut [f32],
        progress: &dyn Progress,
    ) -> Result<()> {
        let exit = |&point: &u32| (u64::from(point), self.exits.get(point as usize).copied().unwrap_or_default());
        let numbered: Vec<(u64, ExitPoint)> = points.iter().map(exit).collect();
        progress.start("single scattering", count as u64);
        for index in 0..count {
            let Some(light) = light(index) else { continue };
            let single = self.under(&light, &numbered)?;
            values.par_chunks_mut(3 * count).zip(single).for_each(|(of_point, s)| {
                for (channel, s) in s.to_array().into_iter().enumerate() {
                    if let Some(value) = of_point.get_mut(channel * count + index) {
                        *value += s as f32;
                    }
                }
            });
            progress.advance(1);
        }
        progress.finish();
        Ok(())
    }

    fn under(&self, light: &Light, numbered: &[(u64, ExitPoint)]) -> Result<Vec<DVec3>> {
        let SampledScene { scene, bvh, .. } = self.sampled;
        let lit = LitScene { scene, bvh, lights: std::slice::from_ref(light) };
        self.traced.at_points(lit, numbered)
    }
}
