//! `editable`: the material is chosen at evaluation (Wang et al. 2008): sums over samples at run time, or stored
//! transport of a basis of R_d.

use super::keys::{self, SINGLE, SINGLE_CROSSINGS, SINGLE_FORM};
use crate::error::Result;
use crate::evaluate::keys::{Auto, Domain, Key, Keys, Number, OneOf, PowerOfTwo, Share};
use crate::evaluate::{About, AnyForm, BakeSettings, Method};
use crate::forms::density::Density;
use crate::forms::environment_rows::EnvironmentRows;
use crate::forms::factored::{Factored, MOST_LEVELS};
use crate::forms::gathered::{Bound, Far, Gathered};
use crate::medium::profile_basis::Family;
use crate::transport::far_field;
use crate::transport::near_rule::NearField;

/// The method.
pub struct Editable;

/// Density of the samples; its spacing keeps shadow boundaries well inside the kernel.
const DENSITY: Density = Density { spacing: 0.35, least: 1 << 17, most: 1 << 18 };

/// Error that the density is made for; a smaller one asks for more samples.
const DENSITY_RMS: f64 = 0.01;

/// Receivers that share a traversal of the tree.
const GROUP: u32 = 16;

/// Shares of the asked error that lossy stages may take. The rest is for sampling and for rows.
const NETS: f64 = 0.8;
const HIERARCHY: f64 = 0.3;
const TRUNCATION_SHARE: f64 = 0.6;
const QUANTISER: f64 = 0.1;
const BASIS_ERROR: f64 = 0.15;
const INTERPOLATION: f64 = 0.6;
const LEVELS: f64 = 0.2;

/// Largest distance between the points of the far field at an error of 1 %, in sample spacings.
const FAR_SPACING_AT_1: f64 = 4.0;

/// Stored transport, if any.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Transport {
    None,
    Stored,
}

const TRANSPORT: Key<OneOf<Transport>> = Key::new(
    "transport",
    "none",
    OneOf(&[("none", Transport::None), ("stored", Transport::Stored)]),
    "none: samples alone, summed at run time with any profile, at any size; or stored, of a basis of R_d",
);

const TERMS: Key<Auto<Number<usize>>> = Key::new(
    "terms",
    "auto",
    Auto(Number(1, far_field::TERMS)),
    "stored: basis functions; auto: as few as a fifth of --max-rms allows for the published materials and others",
);

const CUBE: Key<OneOf<u32>> =
    Key::new("cube", "32", OneOf(&[("32", 32), ("64", 64)]), "texels along an edge of the environment's cube map");

const COEFFICIENTS: Key<Number<u32>> = Key::new(
    "coefficients",
    "128",
    Number(8, 1024),
    "irradiance rows of samples have the squared error of so many Haar coefficients for each sample",
);

const BASIS: Key<OneOf<Family>> = Key::new(
    "basis",
    "ladder",
    OneOf(&[("ladder", Family::Ladder), ("transported", Family::Transported), ("plain", Family::Plain)]),
    "stored: ladder: Gaussians that are combined without negative coefficients; transported: principal components weighted for \
     transported light over this object's range; plain: the components of the paper",
)
.expert();

const SPLIT: Key<Number<f64>> = Key::new(
    "split",
    "6",
    Number(4.0, 64.0),
    "stored: radius of the near field, which is not stored, in sample spacings",
)
.expert();

const FAR_SPACING: Key<Auto<FarSpacing>> = Key::new(
    "far-spacing",
    "auto",
    Auto(FarSpacing),
    "stored: distance of the points that the far field is stored at, in sample spacings; 0: every vertex; auto: as far as 60 % of \
     --max-rms lets them",
)
.expert();

const FAR_LEVELS: Key<Number<usize>> = Key::new(
    "far-levels",
    "4",
    Number(1, MOST_LEVELS),
    "stored: spacings of these points, each twice as far as the one before: every basis function has the widest that 20 % of --max-rms \
     lets it",
)
.expert();

const TRUNCATION: Key<Auto<Share>> = Key::new(
    "truncation",
    "auto",
    Auto(Share),
    "stored: relative error asked of dropping coefficients; auto: 60 % of --max-rms",
)
.expert();

const SINGLE_SAMPLES: Key<Number<u32>> = keys::single_samples("32");
const POINTS: Key<PowerOfTwo> = keys::points("4");
const DIRECTIONS: Key<Number<u32>> = keys::directions("256");
const AREA_SIDE: Key<Number<u32>> = keys::area_side("8");

/// A distance in sample spacings, or 0.
#[derive(Clone, Copy, Debug)]
struct FarSpacing;

impl Domain for FarSpacing {
    type Value = f64;

    fn parse(&self, text: &str) -> Option<f64> {
        Number(0.0, 8.0).parse(text).filter(|spacing| *spacing == 0.0 || *spacing >= 0.5)
    }

    fn describe(&self) -> String {
        "0 or a number from 0.5 to 8".to_owned()
    }
}

impl Method for Editable {
    fn about(&self) -> About {
        About {
            name: "editable",
            summary: "the material is chosen later: samples summed at run time, or transport of a basis of R_d (Wang \
                et al. 2008)",
            choose_when: "The material changes after the bake, or it is not known yet what will: the default takes any \
                light, material, profile and size. With transport=stored a new light or material takes milliseconds.",
            keys: &[
                &TRANSPORT,
                &SINGLE,
                &TERMS,
                &CUBE,
                &COEFFICIENTS,
                &BASIS,
                &SPLIT,
                &FAR_SPACING,
                &FAR_LEVELS,
                &TRUNCATION,
                &POINTS,
                &DIRECTIONS,
                &AREA_SIDE,
                &SINGLE_SAMPLES,
                &SINGLE_FORM,
                &SINGLE_CROSSINGS,
            ],
            default_max_rms: 0.01,
            declared_error: None,
            ladder: &[
                "",
                "--set transport=stored",
                "--samples 32768 --set points=1",
                "--max-rms 0.2%",
                "--max-rms 4% --set transport=stored",
                "--max-rms 2% --set transport=stored",
                "--samples 32768 --set transport=stored",
                "--max-rms 0.5% --set transport=stored",
                "--max-rms 0.5% --samples 262144 --set transport=stored",
            ],
        }
    }

    fn planned(&self) -> &'static [&'static [(&'static str, &'static str)]] {
        &[&[], &[("transport", "stored")]]
    }

    fn form(&self, keys: &Keys, settings: &BakeSettings) -> Result<Box<dyn AnyForm>> {
        let max_rms = settings.max_rms;
        let density = DENSITY.finer((DENSITY_RMS / max_rms).sqrt());
        let sampling = keys::light_sampling(keys, (&POINTS, &DIRECTIONS, &AREA_SIDE))?;
        let near = NearField::for_error(max_rms);
        let environment = Some(EnvironmentRows { side: keys.get(&CUBE)?, coefficients: keys.get(&COEFFICIENTS)? });
        if keys.get(&TRANSPORT)? == Transport::None {
            return Ok(Box::new(Gathered {
                density,
                sampling,
                near,
                far: Far::Hierarchical { error: HIERARCHY * max_rms, bound: Bound::SolidAngle },
                group: GROUP,
                nets: Some(NETS * max_rms),
                environment,
                single: keys::traced(keys, &SINGLE_SAMPLES)?,
                outside: None,
            }));
        }
        Ok(Box::new(Factored {
            density,
            family: keys.get(&BASIS)?,
            terms: keys.get(&TERMS)?,
            basis_error: BASIS_ERROR * max_rms,
            split: keys.get(&SPLIT)?,
            far_spacing: keys.get(&FAR_SPACING)?,
            // The error goes with a power between 1.5 and 2.
            widest_far_spacing: (FAR_SPACING_AT_1 * (max_rms / 0.01).sqrt()).clamp(0.5, 6.0),
            interpolation: INTERPOLATION * max_rms,
            levels: keys.get(&FAR_LEVELS)?,
            levels_error: LEVELS * max_rms,
            truncation: keys.get(&TRUNCATION)?.unwrap_or(TRUNCATION_SHARE * max_rms),
            quantiser: QUANTISER * max_rms,
            opening: (0.1 * (max_rms / 0.01).sqrt()).clamp(0.03, 0.2),
            sampling,
            near,
            environment,
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_stored_form_shares_out_the_error() {
        // Five errors of different origin: their squares add.
        let interpolated = INTERPOLATION.hypot(LEVELS);
        let all = TRUNCATION_SHARE.hypot(interpolated).hypot(QUANTISER).hypot(BASIS_ERROR);
        assert!(all < 0.9, "{all}");
    }
}
