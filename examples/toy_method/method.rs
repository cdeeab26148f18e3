//! A method: a name for the form `gathered` with other settings than those of the crate's own methods.

use translux::error::Result;
use translux::evaluate::keys::{Key, Keys, PowerOfTwo};
use translux::evaluate::{About, AnyForm, BakeSettings, Method};
use translux::forms::density::Density;
use translux::forms::gathered::{Bound, Far, Gathered};
use translux::transport::irradiance::LightSampling;
use translux::transport::near_rule::NearField;

/// The method.
pub(crate) struct ToyMethod;

/// Samples as dense as `two_pass` has them at 0.5 %.
const DENSITY: Density = Density { spacing: 0.35, least: 1 << 15, most: 1 << 18 };

/// Share of the asked error for the hierarchy.
const HIERARCHY: f64 = 0.3;

const RAYS: Key<PowerOfTwo> =
    Key::new("rays", "4", PowerOfTwo(1, 64), "shadow rays of a sample towards a directional or point light");

impl Method for ToyMethod {
    fn about(&self) -> About {
        About {
            name: "toy_method",
            summary: "samples and a hierarchy whose clusters are bounded by the kernel's error (an example)",
            choose_when: "You want to see how a method is added.",
            keys: &[&RAYS],
            default_max_rms: 0.005,
            declared_error: None,
            ladder: &[""],
        }
    }

    fn form(&self, keys: &Keys, settings: &BakeSettings) -> Result<Box<dyn AnyForm>> {
        Ok(Box::new(Gathered {
            density: DENSITY,
            sampling: LightSampling { points_per_patch: keys.get(&RAYS)?, ..LightSampling::FAST },
            near: NearField::for_error(settings.max_rms),
            far: Far::Hierarchical { error: HIERARCHY * settings.max_rms, bound: Bound::Kernel },
            group: 16,
            nets: None,
            environment: None,
            single: None,
            outside: None,
        }))
    }
}
