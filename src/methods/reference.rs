//! `reference`: the brute-force truth. All pairs of samples and vertices, the near field integrated exactly, many rays;
//! its own error is measured and printed.

use super::keys::{self, INTER_REFLECTION, SINGLE, SINGLE_CROSSINGS, SINGLE_FORM};
use crate::error::Result;
use crate::evaluate::keys::{Key, Keys, Number, PowerOfTwo};
use crate::evaluate::{About, AnyForm, BakeSettings, Method};
use crate::forms::density::Density;
use crate::forms::gathered::{Far, Gathered};
use crate::transport::near_rule::NearField;

/// The method.
pub struct Reference;

/// Density of the samples; its spacing keeps shadow boundaries well inside the kernel.
const DENSITY: Density = Density { spacing: 0.2, least: 1 << 17, most: 1 << 19 };

/// Receivers of a block: wide, because the kernels are faster on long rows and every sample is seen anyway.
const GROUP: u32 = 64;

const SINGLE_SAMPLES: Key<Number<u32>> = keys::single_samples("128");
const POINTS: Key<PowerOfTwo> = keys::points("16");
const DIRECTIONS: Key<Number<u32>> = keys::directions("512");
const AREA_SIDE: Key<Number<u32>> = keys::area_side("16");
const RAYS: Key<PowerOfTwo> = keys::rays("64");

impl Method for Reference {
    fn about(&self) -> About {
        About {
            name: "reference",
            summary: "brute force: all pairs, exact near field; the truth that every error is measured against",
            choose_when: "To measure others, or for a single picture that may take its time.",
            keys: &[
                &SINGLE,
                &INTER_REFLECTION,
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
            ladder: &["", "--samples 16384", "--samples 65536"],
        }
    }

    fn form(&self, keys: &Keys, _: &BakeSettings) -> Result<Box<dyn AnyForm>> {
        let single = keys::traced(keys, &SINGLE_SAMPLES)?;
        Ok(Box::new(Gathered {
            density: DENSITY,
            sampling: keys::light_sampling(keys, (&POINTS, &DIRECTIONS, &AREA_SIDE))?,
            near: NearField::REFERENCE,
            far: Far::AllPairs,
            group: GROUP,
            nets: None,
            environment: None,
            single,
            outside: keys::outside(keys, &RAYS)?,
        }))
    }
}
