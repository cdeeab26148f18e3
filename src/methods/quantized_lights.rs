//! `quantized_lights`: radiosity under a quantised set of lights, precomputed; any light is interpolated from the set
//! (Hao & Varshney 2004). A program of its own, `examples/papers`, stores exactly the paper's data.

use super::keys::{self, SCATTERED, SINGLE_CROSSINGS, SINGLE_FORM, Scattered};
use crate::error::{Error, Result};
use crate::evaluate::keys::{Auto, Key, Keys, Number, OneOf};
use crate::evaluate::single_scattering::Scattering;
use crate::evaluate::{About, AnyForm, BakeSettings, Method};
use crate::forms::density::Density;
use crate::forms::projected::lights::{LightSetSettings, MOST_DIRECTIONS, MOST_SHELLS, QuantisedLights};
use crate::forms::projected::references::Spacing;
use crate::forms::single_scattering::FirstOrder;
use crate::light::LightKind;
use crate::light::quantised::distances::Blend;
use crate::light::quantised::interpolation::Scheme;

/// The method.
pub struct QuantizedLights;

/// Density of the samples for an error of [`DENSITY_RMS`]; its spacing keeps shadow boundaries well inside the kernel.
const DENSITY: Density = Density { spacing: 0.35, least: 1 << 16, most: 1 << 18 };

/// Error that the density is made for.
const DENSITY_RMS: f64 = 0.02;

/// Default number of shells of point lights.
const DEFAULT_SHELLS: usize = 3;

/// Key for the number of directions in the set.
pub const LIGHTS: Key<Auto<Number<usize>>> = Key::new(
    "lights",
    "auto",
    Auto(Number(16, MOST_DIRECTIONS)),
    "directions in the set (200 in the paper); auto: as many as --max-rms asks for",
);

/// Key for the number of distances of point lights in the set.
pub const SHELLS: Key<Auto<Number<usize>>> = Key::new(
    "shells",
    "auto",
    Auto(Number(0, MOST_SHELLS)),
    "distances of point and area lights in the set, beside infinity; auto: 3 where --for-lights has them, else 0",
);

/// Key for the nearest of these distances.
pub const NEAREST: Key<Number<f64>> = Key::new(
    "nearest",
    "1.5",
    Number(1.05, 100.0),
    "nearest distance of point and area lights, in bounding radii from the centre",
);

const SPACING: Key<Auto<Number<f64>>> = Key::new(
    "spacing",
    "auto",
    Auto(Number(1e-6, 1e6)),
    "distance between reference points, mm; auto: what --max-rms asks for",
);

const REFERENCES: Key<Auto<Number<usize>>> = Key::new(
    "references",
    "auto",
    Auto(Number(1, 100_000_000)),
    "number of reference points, about; auto: what --max-rms asks for",
);

/// Key for the interpolation between the lights of the set by direction.
pub const INTERPOLATION: Key<OneOf<Scheme>> = Key::new(
    "interpolation",
    "rbf",
    OneOf(&[
        ("rbf", Scheme::Rbf),
        ("least-squares", Scheme::LeastSquares),
        ("barycentric", Scheme::Barycentric),
        ("nearest4", Scheme::Nearest4),
    ]),
    "between the lights: rbf is smooth, nearest4 the paper's, which jumps",
)
.expert();

/// Key for the interpolation between the shells by distance.
pub const BLEND: Key<OneOf<Blend>> = Key::new(
    "blend",
    "polynomial",
    OneOf(&[("polynomial", Blend::Polynomial), ("linear", Blend::Linear)]),
    "between the distances of point lights: polynomial through all, or linear between two (the paper's, with nearest4)",
)
.expert();

const SINGLE: Key<OneOf<Scattered>> = Key::new(
    "single-scattering",
    "off",
    SCATTERED,
    "light that scatters once, whose orders the stored radiosity has not then; folded: isotropic, baked into the radiosity, which costs \
     nothing at run time; isotropic: by rays at run time, for each vertex; phase: by rays at run time, by the medium's g, towards the eye",
);

const SINGLE_SAMPLES: Key<Number<u32>> = keys::single_samples("32");

impl Method for QuantizedLights {
    fn about(&self) -> About {
        About {
            name: "quantized_lights",
            summary: "radiosity under a set of lights, interpolated; the fastest new light, material baked in (Hao & \
                Varshney 2004)",
            choose_when: "Light moves in every frame and the material stays: a new light of any kind takes a \
                millisecond, also on a GPU.",
            keys: &[
                &LIGHTS,
                &SHELLS,
                &NEAREST,
                &SINGLE,
                &SPACING,
                &REFERENCES,
                &INTERPOLATION,
                &BLEND,
                &SINGLE_SAMPLES,
                &SINGLE_FORM,
                &SINGLE_CROSSINGS,
            ],
            default_max_rms: 0.02,
            declared_error: None,
            ladder: &[
                "",
                "--max-rms 10%",
                "--max-rms 5%",
                "--max-rms 2%",
                "--set lights=200",
                "--set lights=200 --set interpolation=nearest4",
                "--set lights=200 --set interpolation=barycentric",
                "--set lights=200 --set interpolation=least-squares",
            ],
        }
    }

    fn planned(&self) -> &'static [&'static [(&'static str, &'static str)]] {
        &[&[]]
    }

    fn form(&self, keys: &Keys, settings: &BakeSettings) -> Result<Box<dyn AnyForm>> {
        if !settings.for_lights.is_empty() && !LightKind::STORABLE.iter().any(|kind| settings.is_for(*kind)) {
            return Err(Error::unsupported(
                "quantized_lights holds lights that shine on the whole body; a spot lights a part of it: bake --for-lights spot with \
                 --method editable or two_pass",
            ));
        }
        let lights = light_set(keys, settings, keys.get(&INTERPOLATION)?)?;
        let spacing = Spacing { mm: keys.get(&SPACING)?, references: keys.get(&REFERENCES)? };
        let by_rays = |scattering| keys::traced_as(keys, &SINGLE_SAMPLES, scattering);
        let single = match keys.get(&SINGLE)? {
            Scattered::Off => FirstOrder::InKernel,
            Scattered::Folded => FirstOrder::Folded(by_rays(Scattering::Isotropic)?),
            Scattered::Isotropic => FirstOrder::AtRunTime(by_rays(Scattering::Isotropic)?),
            Scattered::Phase => FirstOrder::AtRunTime(by_rays(Scattering::OfMedium)?),
        };
        Ok(Box::new(QuantisedLights { density: density(settings), lights, spacing, single }))
    }
}

/// The density of samples for the error that is asked for.
pub fn density(settings: &BakeSettings) -> Density {
    DENSITY.finer((DENSITY_RMS / settings.max_rms).sqrt().max(1.0))
}

/// The set of lights from the keys [`LIGHTS`], [`SHELLS`], [`NEAREST`] and [`BLEND`], with an interpolation.
///
/// # Errors
/// Command line: a method that lacks one of these keys.
pub fn light_set(keys: &Keys, settings: &BakeSettings, scheme: Scheme) -> Result<LightSetSettings> {
    let near = settings.is_for(LightKind::Point) || settings.is_for(LightKind::Area);
    Ok(LightSetSettings {
        directions: keys.get(&LIGHTS)?,
        scheme,
        blend: keys.get(&BLEND)?,
        shells: keys.get(&SHELLS)?.unwrap_or(DEFAULT_SHELLS * usize::from(near)),
        nearest: 1.0 / keys.get(&NEAREST)?,
    })
}
