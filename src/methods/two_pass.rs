//! `two_pass`: irradiance at surface samples, then R_d summed through a tree (Jensen & Buhler 2002).

use super::keys::{self, INTER_REFLECTION, SINGLE, SINGLE_CROSSINGS, SINGLE_FORM};
use crate::error::Result;
use crate::evaluate::keys::{Auto, Key, Keys, Number, OneOf, PowerOfTwo, Share};
use crate::evaluate::{About, AnyForm, BakeSettings, Method};
use crate::forms::density::Density;
use crate::forms::gathered::{Bound, Far, Gathered};
use crate::transport::near_rule::NearField;

/// The method.
pub struct TwoPass;

/// Density of the samples; its spacing keeps shadow boundaries well inside the kernel.
const DENSITY: Density = Density { spacing: 0.35, least: 1 << 17, most: 1 << 18 };

/// Error that the density is made for; a smaller one asks for more samples.
const DENSITY_RMS: f64 = 0.005;

/// Share of the asked error for the hierarchy.
const HIERARCHY: f64 = 0.3;

/// Receivers that share a traversal of the tree.
const GROUP: u32 = 16;

const ERROR: Key<Auto<Share>> =
    Key::new("error", "auto", Auto(Share), "relative error asked of the hierarchy; auto: 30 % of --max-rms").expert();

const BOUND: Key<OneOf<Bound>> = Key::new(
    "bound",
    "solid-angle",
    OneOf(&[("solid-angle", Bound::SolidAngle), ("kernel", Bound::Kernel)]),
    "which clusters stand for their samples: by their solid angle or by a bound on the kernel's error",
)
.expert();

const SINGLE_SAMPLES: Key<Number<u32>> = keys::single_samples("32");
const POINTS: Key<PowerOfTwo> = keys::points("4");
const DIRECTIONS: Key<Number<u32>> = keys::directions("256");
const AREA_SIDE: Key<Number<u32>> = keys::area_side("8");
const RAYS: Key<PowerOfTwo> = keys::rays("32");

impl Method for TwoPass {
    fn about(&self) -> About {
        About {
            name: "two_pass",
            summary: "surface samples only; shadows and hierarchical transfer for each light (Jensen & Buhler 2002)",
            choose_when: "Nothing should be precomputed but samples, and a second or so for each new light is fast \
                enough.",
            keys: &[
                &SINGLE,
                &INTER_REFLECTION,
                &ERROR,
                &BOUND,
                &POINTS,
                &DIRECTIONS,
                &AREA_SIDE,
                &SINGLE_SAMPLES,
                &SINGLE_FORM,
                &SINGLE_CROSSINGS,
                &RAYS,
            ],
            default_max_rms: 0.005,
            declared_error: None,
            ladder: &[
                "",
                "--max-rms 4% --samples 16384",
                "--max-rms 2% --samples 32768",
                "--max-rms 1%",
                "--max-rms 0.1%",
                "--set bound=kernel",
            ],
        }
    }

    fn planned(&self) -> &'static [&'static [(&'static str, &'static str)]] {
        &[&[]]
    }

    fn form(&self, keys: &Keys, settings: &BakeSettings) -> Result<Box<dyn AnyForm>> {
        let max_rms = settings.max_rms;
        Ok(Box::new(Gathered {
            density: DENSITY.finer((DENSITY_RMS / max_rms).sqrt()),
            sampling: keys::light_sampling(keys, (&POINTS, &DIRECTIONS, &AREA_SIDE))?,
            near: NearField::for_error(max_rms),
            far: Far::Hierarchical {
                error: keys.get(&ERROR)?.unwrap_or(HIERARCHY * max_rms),
                bound: keys.get(&BOUND)?,
            },
            group: GROUP,
            nets: None,
            environment: None,
            single: keys::traced(keys, &SINGLE_SAMPLES)?,
            outside: keys::outside(keys, &RAYS)?,
        }))
    }
}
