//! Keys that several methods offer.

use crate::error::Result;
use crate::evaluate::inter_reflection::{MOST_TIMES, Outside};
use crate::evaluate::keys::{Domain, Key, Keys, Number, OneOf, PowerOfTwo};
use crate::evaluate::single_scattering::{MOST_SAMPLES, Scattering, Traced};
use crate::forms::distant::Integrand;
use crate::transport::interreflection::{LEAST_RAYS, MOST_RAYS};
use crate::transport::irradiance::LightSampling;
use crate::transport::single_scattering::{Crossings, Form};

/// Key for the points of a sample where shadow rays towards sharp lights start.
pub(super) const fn points(default: &'static str) -> Key<PowerOfTwo> {
    let help = "points of a sample that a directional or point light's shadow rays start from";
    Key::new("points", default, PowerOfTwo(1, 64), help).expert()
}

/// Key for the shadow rays of a sample towards soft lights.
pub(super) const fn directions(default: &'static str) -> Key<Number<u32>> {
    let help = "shadow rays of a sample towards an environment; a constant light takes a quarter of them";
    Key::new("directions", default, Number(1, 65536), help).expert()
}

/// Key for the cells along each edge of an area light.
pub(super) const fn area_side(default: &'static str) -> Key<Number<u32>> {
    let help = "an area light is cut into this many cells along each edge";
    Key::new("area-side", default, Number(1, 256), help).expert()
}

/// The light sampling from the keys `points`, `directions` and `area-side`.
pub(super) fn light_sampling(
    keys: &Keys,
    (points, directions, area_side): (&Key<PowerOfTwo>, &Key<Number<u32>>, &Key<Number<u32>>),
) -> Result<LightSampling> {
    Ok(LightSampling {
        points_per_patch: keys.get(points)?,
        directions: keys.get(directions)?,
        area_side: keys.get(area_side)?,
    })
}

/// Number of bounces of light that leaves the surface and falls on it again; 0 for none.
#[derive(Clone, Copy, Debug)]
pub(super) struct Times;

impl Domain for Times {
    type Value = u32;

    fn parse(&self, text: &str) -> Option<u32> {
        match text {
            "off" => Some(0),
            "once" => Some(1),
            _ => Number(1, MOST_TIMES).parse(text),
        }
    }

    fn describe(&self) -> String {
        format!("off, once or a number of times from 1 to {MOST_TIMES}")
    }

    fn words(&self) -> Vec<&'static str> {
        vec!["off", "once"]
    }
}

/// Key for the number of bounces of light outside the medium.
pub(super) const INTER_REFLECTION: Key<Times> = Key::new(
    "inter-reflection",
    "off",
    Times,
    "light that leaves the surface and falls on it again from outside the medium, to be transferred again; each time costs a \
     transfer more",
);

/// Key for the rays of each sample that find these bounces.
pub(super) const fn rays(default: &'static str) -> Key<PowerOfTwo> {
    let help = "rays of a sample that look for surfaces whose light falls on it";
    Key::new("inter-reflection-rays", default, PowerOfTwo(LEAST_RAYS, MOST_RAYS), help).expert()
}

/// The inter-reflection that the keys choose; none where it is off.
pub(super) fn outside(keys: &Keys, rays: &Key<PowerOfTwo>) -> Result<Option<Outside>> {
    match keys.get(&INTER_REFLECTION)? {
        0 => Ok(None),
        times => Ok(Some(Outside { times, rays: keys.get(rays)? })),
    }
}

/// Choice of single scattering of a method whose material is baked in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scattered {
    Off,
    Isotropic,
    Folded,
    Phase,
}

/// The words of that choice.
pub(super) const SCATTERED: OneOf<Scattered> = OneOf(&[
    ("off", Scattered::Off),
    ("isotropic", Scattered::Isotropic),
    ("folded", Scattered::Folded),
    ("phase", Scattered::Phase),
]);

/// Key for single scattering by rays at run time.
pub(super) const SINGLE: Key<OneOf<Option<Scattering>>> = Key::new(
    "single-scattering",
    "off",
    OneOf(&[("off", None), ("isotropic", Some(Scattering::Isotropic)), ("phase", Some(Scattering::OfMedium))]),
    "light that scatters once, by rays at run time, apart from the radiosity, which has the later orders then; isotropic: with reduced \
     coefficients, for each vertex along the inverse normal and in pictures along the refracted direction; phase: by the medium's g, \
     in pictures alone unless g = 0",
);

/// Key for its places inside.
pub(super) const fn single_samples(default: &'static str) -> Key<Number<u32>> {
    let help = "places inside where light is scattered once, for each vertex or pixel and each directional or point light; other lights \
                take 16 times as many";
    Key::new("single-samples", default, Number(1, MOST_SAMPLES), help).expert()
}

/// The single scattering that [`SINGLE`] chooses.
pub(super) fn traced(keys: &Keys, samples: &Key<Number<u32>>) -> Result<Option<Traced>> {
    keys.get(&SINGLE)?.map(|scattering| traced_as(keys, samples, scattering)).transpose()
}

/// Single scattering by rays.
pub(super) fn traced_as(keys: &Keys, samples: &Key<Number<u32>>, scattering: Scattering) -> Result<Traced> {
    let Integrand { form, crossings } = integrand(keys)?;
    Ok(Traced { scattering, samples: keys.get(samples)?, form, crossings })
}

/// Key for the form of equation (4) of Wang, Tran and Luebke 2005.
pub(super) const SINGLE_FORM: Key<OneOf<Form>> = Key::new(
    "single-form",
    "physical",
    OneOf(&[("physical", Form::Physical), ("printed", Form::Printed)]),
    "integrand of single scattering: physical, or as printed in the paper, without the refraction factor (2 to 3 times as bright)",
)
.expert();

/// Key for the treatment of light whose straight path crosses further surfaces.
pub(super) const SINGLE_CROSSINGS: Key<OneOf<Crossings>> = Key::new(
    "single-crossings",
    "occluded",
    OneOf(&[("occluded", Crossings::Occluded), ("attenuated", Crossings::Attenuated)]),
    "light of single scattering that meets another body or fold on its way: occluded (the paper's) or attenuated (it passes \
     translucent ones)",
)
.expert();

/// The integrand that the keys choose.
pub(super) fn integrand(keys: &Keys) -> Result<Integrand> {
    Ok(Integrand { form: keys.get(&SINGLE_FORM)?, crossings: keys.get(&SINGLE_CROSSINGS)? })
}
