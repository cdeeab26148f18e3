//! `all_frequency`: radiosity under light from far away, transport stored as vectors over the directions of an
//! environment (Wang, Tran & Luebke 2005).

use super::keys::{self, INTER_REFLECTION, SCATTERED, SINGLE_CROSSINGS, SINGLE_FORM, Scattered};
use crate::error::{Error, Result};
use crate::evaluate::keys::{Auto, Key, Keys, Number, OneOf, PowerOfTwo};
use crate::evaluate::{About, AnyForm, BakeSettings, Method};
use crate::forms::density::Density;
use crate::forms::distant::{Basis, Choice, Distant, Integrand, KINDS, MOST_ORDER, Single, Terms};
use crate::forms::projected::harmonics::Harmonics;
use crate::forms::projected::references::Spacing;
use crate::forms::rows::DirectionalRows;
use crate::light::cube_light::Transform;
use crate::math::cube_map::FACES;

/// The method.
pub struct AllFrequency;

/// Density of the samples; its spacing keeps shadow boundaries well inside the kernel.
const DENSITY: Density = Density { spacing: 0.35, least: 1 << 16, most: 1 << 18 };

/// Error that the density is made for.
const DENSITY_RMS: f64 = 0.02;

/// Default number of coefficients of a row: the paper's.
const ROW: usize = 128;

const SINGLE: Key<OneOf<Scattered>> = Key::new(
    "single-scattering",
    "off",
    SCATTERED,
    "isotropic: with reduced coefficients, a value for each vertex; folded: the same as part of the radiosity, which costs nothing at \
     run time; phase: by the g of each medium, towards the eye, and g stays free at run time (its directions; extinction is baked)",
);

const CUBE: Key<OneOf<u32>> = Key::new(
    "cube",
    "32",
    OneOf(&[("32", 32), ("64", 64)]),
    "texels along an edge of the cube map that irradiance is sampled on",
);

const BASIS: Key<OneOf<Basis>> = Key::new(
    "basis",
    "auto",
    OneOf(&[("auto", Basis::Harmonics), ("sh", Basis::Harmonics), ("haar", Basis::Haar)]),
    "of the light: sh (spherical harmonics, coded over the vertices), haar (wavelets of the cube map, the paper's), auto (sh)",
)
.expert();

const COEFFICIENTS: Key<Auto<Number<usize>>> = Key::new(
    "coefficients",
    "auto",
    Auto(Number(1, 6 * 64 * 64)),
    "for haar: kept for each vertex, 6 and more, auto 128 (the paper's); for sh: a square, 1 to 576; auto: what --max-rms asks for",
);

const TRANSFORM: Key<OneOf<Transform>> = Key::new(
    "transform",
    "solid-angle",
    OneOf(&[("solid-angle", Transform::SolidAngle), ("texels", Transform::Texels)]),
    "for haar: orthonormal on the sphere (solid-angle) or on the texels (texels, the paper's)",
)
.expert();

const SELECTION: Key<OneOf<Choice>> = Key::new(
    "selection",
    "light",
    OneOf(&[("magnitude", Choice::Magnitude), ("light", Choice::Light), ("rate", Choice::Rate)]),
    "which coefficients haar keeps: the largest of each vertex (magnitude, the paper's), the largest times expected light (light), the \
     same at one threshold for all vertices (rate)",
)
.expert();

const SPACING: Key<Auto<Number<f64>>> = Key::new(
    "spacing",
    "auto",
    Auto(Number(1e-6, 1e6)),
    "for sh: distance between reference points, mm; auto: what --max-rms asks for",
)
.expert();

const REFERENCES: Key<Auto<Number<usize>>> = Key::new(
    "references",
    "auto",
    Auto(Number(1, 1 << 30)),
    "for sh: number of reference points (about); auto: what --max-rms asks for",
)
.expert();

const SINGLE_BASIS: Key<Auto<OneOf<Basis>>> = Key::new(
    "single-basis",
    "auto",
    Auto(OneOf(&[("sh", Basis::Harmonics), ("haar", Basis::Haar)])),
    "of light that is scattered once: sh or haar (isotropic, 128 coefficients for each vertex unless basis=haar has others); auto: \
     that of the radiosity, sh for phase",
)
.expert();

const PHASE_TERMS: Key<OneOf<Terms>> = Key::new(
    "phase-terms",
    "auto",
    OneOf(&[
        ("auto", Terms::Auto),
        ("1", Terms::Stored(1)),
        ("4", Terms::Stored(4)),
        ("9", Terms::Stored(9)),
        ("16", Terms::Stored(16)),
        ("rays", Terms::Rays),
    ]),
    "for phase: harmonics of the phase function; rays: nothing is stored, rays are cast at run time, right for every g; auto: what g \
     and --max-rms ask for",
)
.expert();

const RAYS: Key<PowerOfTwo> = keys::rays("32");

impl Method for AllFrequency {
    fn about(&self) -> About {
        About {
            name: "all_frequency",
            summary: "transport vectors over an environment; the fastest new environment, material baked in (Wang, \
                Tran & Luebke 2005)",
            choose_when: "Light comes from far away (environments, suns) and the material stays: the smallest asset, a \
                thousand turned environments a second.",
            keys: &[
                &SINGLE,
                &INTER_REFLECTION,
                &CUBE,
                &COEFFICIENTS,
                &BASIS,
                &TRANSFORM,
                &SELECTION,
                &SPACING,
                &REFERENCES,
                &SINGLE_BASIS,
                &PHASE_TERMS,
                &SINGLE_FORM,
                &SINGLE_CROSSINGS,
                &RAYS,
            ],
            default_max_rms: 0.01,
            declared_error: None,
            ladder: &[
                "",
                "--max-rms 5%",
                "--max-rms 2%",
                "--max-rms 0.5%",
                "--set basis=haar --set selection=magnitude --set transform=texels",
                "--set basis=haar --set selection=magnitude",
                "--set basis=haar",
                "--set basis=haar --set selection=rate",
                "--set basis=haar --set coefficients=512",
                "--set coefficients=25",
            ],
        }
    }

    fn planned(&self) -> &'static [&'static [(&'static str, &'static str)]] {
        &[&[]]
    }

    fn form(&self, keys: &Keys, settings: &BakeSettings) -> Result<Box<dyn AnyForm>> {
        if !settings.for_lights.is_empty() && !KINDS.iter().any(|kind| settings.is_for(*kind)) {
            return Err(Error::unsupported(
                "all_frequency is for light from far away (environment, constant, directional): bake --for-lights point, spot or area with \
                 --method editable, or point or area with quantized_lights",
            ));
        }
        let basis = keys.get(&BASIS)?;
        let (single, single_basis, integrand) = single(keys, basis)?;
        let uses = |of: Basis| basis == of || (single != Single::Off && single_basis == of);
        let (mut transform, mut choice) = (Transform::SolidAngle, Choice::Light);
        if uses(Basis::Haar) {
            (transform, choice) = (keys.get(&TRANSFORM)?, keys.get(&SELECTION)?);
        }
        let mut spacing = Spacing::default();
        if uses(Basis::Harmonics) {
            spacing = Spacing { mm: keys.get(&SPACING)?, references: keys.get(&REFERENCES)? };
        }
        let side = keys.get(&CUBE)?;
        let (row, order) = coefficients(keys, basis, side)?;
        // Rows do not follow light outside.
        let outside = if basis == Basis::Harmonics { keys::outside(keys, &RAYS)? } else { None };
        let distant = Distant {
            density: DENSITY.finer((DENSITY_RMS / settings.max_rms).sqrt().max(1.0)),
            side,
            transform,
            choice,
            row,
            order,
            spacing,
            single,
            single_basis,
            integrand,
            outside,
        };
        Ok(match basis {
            Basis::Harmonics => Box::new(Harmonics(distant)),
            Basis::Haar => Box::new(DirectionalRows(distant)),
        })
    }
}

/// Single scattering, its basis and its integrand.
fn single(keys: &Keys, basis: Basis) -> Result<(Single, Basis, Integrand)> {
    let scattered = keys.get(&SINGLE)?;
    if scattered == Scattered::Off {
        return Ok((Single::Off, basis, Integrand::default()));
    }
    let asked = keys.get(&SINGLE_BASIS)?;
    let integrand = keys::integrand(keys)?;
    // Rows hold one term.
    let refused =
        |name: &str| Err(Error::command_line(format!("--set single-scattering={name}: for harmonics, --set basis=sh")));
    match scattered {
        Scattered::Folded if basis == Basis::Haar || asked == Some(Basis::Haar) => refused("folded"),
        Scattered::Phase if asked == Some(Basis::Haar) => {
            Err(Error::command_line("--set single-basis=haar: for --set single-scattering=isotropic"))
        }
        Scattered::Off | Scattered::Folded => Ok((Single::Folded, Basis::Harmonics, integrand)),
        Scattered::Isotropic => Ok((Single::Isotropic, asked.unwrap_or(basis), integrand)),
        Scattered::Phase => Ok((Single::Phase(keys.get(&PHASE_TERMS)?), Basis::Harmonics, integrand)),
    }
}

/// Number of coefficients of a Haar row, and the order of the harmonics where it is given.
fn coefficients(keys: &Keys, basis: Basis, side: u32) -> Result<(usize, Option<usize>)> {
    let Some(count) = keys.get(&COEFFICIENTS)? else { return Ok((ROW, None)) };
    let most = FACES * (side as usize).pow(2);
    match basis {
        Basis::Haar if (FACES..=most).contains(&count) => Ok((count, None)),
        Basis::Haar => {
            Err(Error::command_line(format!("--set coefficients={count}: a number from {FACES} to {most} is needed")))
        }
        Basis::Harmonics => {
            let order = count.isqrt();
            if order * order == count && order <= MOST_ORDER {
                return Ok((ROW, Some(order)));
            }
            let (below, above) = (order.min(MOST_ORDER), (order + 1).min(MOST_ORDER));
            Err(Error::command_line(format!(
                "--set coefficients={count}: harmonics come in squares, {} or {}",
                below * below,
                above * above
            )))
        }
    }
}
