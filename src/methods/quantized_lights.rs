//! `quantized_lights`: radiosity under a quantised set of lights, precomputed; any light is interpolated from the set (Hao &
//! Varshney 2004). What the paper stores, to the letter, is there for comparison (`encoding`).

use crate::compress::reference_points::{self, Bounds};
use crate::error::{Error, Result};
use crate::evaluate::keys::{AnyKey, Auto, Key, Keys, Number, OneOf, Share};
use crate::evaluate::{AnyForm, BakeSettings, Method};
use crate::forms::density::Density;
use crate::forms::hao::bleeding::NeighbourLists;
use crate::forms::hao::{ChosenBy, Encoding, Integral, VertexValues};
use crate::forms::projected::lights::{LightSetSettings, MOST_DIRECTIONS, MOST_SHELLS, QuantisedLights};
use crate::forms::projected::references::Spacing;
use crate::light::LightKind;
use crate::light::quantised::distances::Blend;
use crate::light::quantised::interpolation::Scheme;
use crate::math::sh::{MOST_ORDER, Window};

/// The method.
pub struct QuantizedLights;

/// Shadow boundaries stay well inside the kernel.
const DENSITY: Density = Density { spacing: 0.35, least: 1 << 16, most: 1 << 18 };

/// The error that the density is made for.
const DENSITY_RMS: f64 = 0.02;

/// Shells of point lights unless they are asked for.
const DEFAULT_SHELLS: usize = 3;

/// Share of the asked error that the range of lists may cost.
const RANGE: f64 = 0.3;

/// What is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stored {
    /// Principal components at reference points.
    Components,
    /// Values of every vertex.
    Values(Encoding),
    /// Lists of neighbours.
    Lists,
}

const LIGHTS: Key<Auto<Number<usize>>> = Key::new(
    "lights",
    "auto",
    Auto(Number(16, MOST_DIRECTIONS)),
    "directions in the set (200 in the paper); auto: as many as --max-rms asks for, 200 for the paper's encodings and more for sh of \
     a high order",
);

const SHELLS: Key<Auto<Number<usize>>> = Key::new(
    "shells",
    "auto",
    Auto(Number(0, MOST_SHELLS)),
    "distances of point and area lights in the set, beside infinity; auto: 3 where --for-lights has them, else 0",
);

const NEAREST: Key<Number<f64>> = Key::new(
    "nearest",
    "1.5",
    Number(1.05, 100.0),
    "nearest distance of point and area lights, in bounding radii from the centre",
);

const SPACING: Key<Auto<Number<f64>>> = Key::new(
    "spacing",
    "auto",
    Auto(Number(1e-6, 1e6)),
    "distance between reference points of components, mm; auto: what --max-rms asks for",
);

const REFERENCES: Key<Auto<Number<usize>>> = Key::new(
    "references",
    "auto",
    Auto(Number(1, 100_000_000)),
    "number of reference points, for components (about) and reference-points; auto: what --max-rms asks for",
);

const INTERPOLATION: Key<OneOf<Scheme>> = Key::new(
    "interpolation",
    "rbf",
    OneOf(&[
        ("rbf", Scheme::Rbf),
        ("least-squares", Scheme::LeastSquares),
        ("barycentric", Scheme::Barycentric),
        ("nearest4", Scheme::Nearest4),
    ]),
    "between the lights (not for sh): rbf is smooth, nearest4 the paper's, which jumps",
)
.expert();

const BLEND: Key<OneOf<Blend>> = Key::new(
    "blend",
    "polynomial",
    OneOf(&[("polynomial", Blend::Polynomial), ("linear", Blend::Linear)]),
    "between the distances of point lights: polynomial through all, or linear between two (the paper's, with nearest4)",
)
.expert();

const ENCODING: Key<OneOf<Stored>> = Key::new(
    "encoding",
    "auto",
    OneOf(&[
        ("auto", Stored::Components),
        ("components", Stored::Components),
        ("raw", Stored::Values(Encoding::Raw)),
        ("uniform8", Stored::Values(Encoding::Uniform8)),
        ("lloyd8", Stored::Values(Encoding::Lloyd8)),
        ("sh", Stored::Values(Encoding::Harmonics)),
        ("reference-points", Stored::Values(Encoding::ReferencePoints)),
        ("bleeding", Stored::Lists),
    ]),
    "what is stored: components at reference points (auto), or what the paper has: values of every vertex, or for bleeding nothing: \
     two passes over lists of neighbouring vertices for each light",
)
.expert();

const INTEGRAL: Key<OneOf<Integral>> = Key::new(
    "integral",
    "scalar",
    OneOf(&[("scalar", Integral::Scalar), ("vector", Integral::Vector)]),
    "for raw, uniform8 and lloyd8: scalar (q of the paper), vector (Q, three times the size, parallel light only)",
)
.expert();

const ORDER: Key<Auto<Number<usize>>> = Key::new(
    "order",
    "auto",
    Auto(Number(1, MOST_ORDER)),
    "order n of spherical harmonics, n^2 coefficients; auto: for sh what --max-rms asks for (7 in the paper), for reference-points 3",
)
.expert();

const WINDOW: Key<OneOf<Window>> = Key::new(
    "window",
    "none",
    OneOf(&[("none", Window::None), ("lanczos", Window::Lanczos), ("hanning", Window::Hanning)]),
    "for sh, against ringing: lanczos and hanning are smoother and less exact",
)
.expert();

const CHOICE: Key<OneOf<ChosenBy>> = Key::new(
    "choice",
    "illumination",
    OneOf(&[("geometry", ChosenBy::Geometry), ("illumination", ChosenBy::Illumination)]),
    "what reference points follow, for reference-points: geometry (the paper's) or illumination as well",
)
.expert();

const WEIGHTS: Key<OneOf<reference_points::Choice>> = Key::new(
    "weights",
    "best",
    OneOf(&[
        ("barycentric", reference_points::Choice::Barycentric),
        ("least-squares", reference_points::Choice::Fitted(Bounds::Extrapolating)),
        ("best", reference_points::Choice::BestTriangle(Bounds::Extrapolating)),
    ]),
    "of three reference points, for reference-points: barycentric (the paper's), least-squares, best (of the triangles nearby as well)",
)
.expert();

const RANGE_SHARE: Key<Auto<Share>> = Key::new(
    "range-share",
    "auto",
    Auto(Share),
    "for bleeding: share of the reflectance beyond the range of a vertex's list; auto: 30 % of --max-rms",
)
.expert();

impl Method for QuantizedLights {
    fn name(&self) -> &'static str {
        "quantized_lights"
    }

    fn summary(&self) -> &'static str {
        "radiosity under a set of lights, interpolated; the fastest new light, material baked in (Hao & Varshney 2004)"
    }

    fn choose_when(&self) -> &'static str {
        "Light moves in every frame and the material stays: a new light of any kind takes a millisecond, also on a GPU."
    }

    fn keys(&self) -> &'static [&'static dyn AnyKey] {
        &[
            &LIGHTS,
            &SHELLS,
            &NEAREST,
            &SPACING,
            &REFERENCES,
            &INTERPOLATION,
            &BLEND,
            &ENCODING,
            &INTEGRAL,
            &ORDER,
            &WINDOW,
            &CHOICE,
            &WEIGHTS,
            &RANGE_SHARE,
        ]
    }

    fn default_max_rms(&self) -> f64 {
        0.02
    }

    fn ladder(&self) -> &'static [&'static str] {
        &[
            "",
            "--max-rms 10%",
            "--max-rms 5%",
            "--max-rms 2%",
            "--set lights=200",
            "--set lights=200 --set interpolation=nearest4",
            "--set lights=200 --set interpolation=barycentric",
            "--set lights=200 --set interpolation=least-squares",
            "--set encoding=lloyd8",
            "--set encoding=lloyd8 --set interpolation=nearest4",
            "--set encoding=sh --set order=7",
            "--set encoding=reference-points",
        ]
    }

    fn form(&self, keys: &Keys, settings: &BakeSettings) -> Result<Box<dyn AnyForm>> {
        let density = DENSITY.finer((DENSITY_RMS / settings.max_rms).sqrt().max(1.0));
        match keys.get(&ENCODING)? {
            Stored::Components => {
                let scheme = keys.get(&INTERPOLATION)?;
                let lights = light_set(keys, settings, scheme)?;
                let spacing = Spacing { mm: keys.get(&SPACING)?, references: keys.get(&REFERENCES)? };
                Ok(Box::new(QuantisedLights { density, lights, spacing }))
            }
            Stored::Values(encoding) => Ok(Box::new(values(encoding, keys, settings, density)?)),
            Stored::Lists => {
                let share = keys.get(&RANGE_SHARE)?.unwrap_or((RANGE * settings.max_rms).clamp(f64::MIN_POSITIVE, 1.0));
                Ok(Box::new(NeighbourLists { density, range_share: share }))
            }
        }
    }
}

/// The set of lights that the keys describe.
fn light_set(keys: &Keys, settings: &BakeSettings, scheme: Scheme) -> Result<LightSetSettings> {
    let near = settings.is_for(LightKind::Point) || settings.is_for(LightKind::Area);
    Ok(LightSetSettings {
        directions: keys.get(&LIGHTS)?,
        scheme,
        blend: keys.get(&BLEND)?,
        shells: keys.get(&SHELLS)?.unwrap_or(DEFAULT_SHELLS * usize::from(near)),
        nearest: 1.0 / keys.get(&NEAREST)?,
    })
}

/// What the paper stores of every vertex.
fn values(encoding: Encoding, keys: &Keys, settings: &BakeSettings, density: Density) -> Result<VertexValues> {
    // Harmonics need no interpolation between lights; this one takes no time to set up.
    let scheme = if encoding == Encoding::Harmonics { Scheme::Nearest4 } else { keys.get(&INTERPOLATION)? };
    let mut form = VertexValues {
        density,
        lights: light_set(keys, settings, scheme)?,
        encoding,
        integral: Integral::Scalar,
        order: None,
        window: Window::None,
        references: None,
        chosen_by: ChosenBy::Illumination,
        weights: reference_points::Choice::BestTriangle(Bounds::Extrapolating),
    };
    match encoding {
        Encoding::Raw | Encoding::Uniform8 | Encoding::Lloyd8 => form.integral = keys.get(&INTEGRAL)?,
        Encoding::Harmonics => (form.order, form.window) = (keys.get(&ORDER)?, keys.get(&WINDOW)?),
        Encoding::ReferencePoints => {
            (form.order, form.references) = (keys.get(&ORDER)?, keys.get(&REFERENCES)?);
            (form.chosen_by, form.weights) = (keys.get(&CHOICE)?, keys.get(&WEIGHTS)?);
        }
    }
    if form.integral == Integral::Vector && form.lights.shells > 0 {
        return Err(Error::command_line(
            "--set integral=vector: vectors are for parallel light alone; add --set shells=0 (or --for-lights without point and \
             area)",
        ));
    }
    if let (Some(order), Some(count)) = (form.order, form.lights.directions)
        && order * order > count
    {
        return Err(Error::command_line(format!(
            "--set order={order}: {} harmonics need as many directions at least; --set lights={count} gives fewer",
            order * order
        )));
    }
    Ok(form)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::error::ExitCode;
    use crate::evaluate::Recipe;

    fn recipe(given: &[(&str, &str)]) -> Result<Recipe> {
        let given: Vec<(String, String)> = given.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect();
        let method: &dyn Method = &QuantizedLights;
        method.recipe(&given, BakeSettings::new(0.02))
    }

    #[test]
    fn keys_belong_to_encodings() {
        for (given, form) in [
            (&[][..], "quantised_lights"),
            (&[("encoding", "sh"), ("order", "7"), ("window", "lanczos")], "vertex_values"),
            (&[("encoding", "raw"), ("integral", "vector"), ("shells", "0")], "vertex_values"),
            (&[("encoding", "reference-points"), ("references", "30"), ("choice", "geometry")], "vertex_values"),
            (&[("encoding", "bleeding"), ("range-share", "1%")], "neighbour_lists"),
        ] {
            assert_eq!(recipe(given).unwrap().form.name(), form);
        }
        let refused = [
            [("encoding", "sh"), ("integral", "vector")],
            [("encoding", "sh"), ("interpolation", "nearest4")],
            [("encoding", "sh"), ("references", "30")],
            [("encoding", "lloyd8"), ("spacing", "1")],
            [("encoding", "lloyd8"), ("order", "3")],
            [("encoding", "reference-points"), ("window", "hanning")],
            [("encoding", "components"), ("weights", "barycentric")],
            [("encoding", "auto"), ("order", "5")],
            [("encoding", "bleeding"), ("lights", "100")],
        ];
        for given in refused {
            let error = recipe(&given).err().unwrap();
            assert_eq!(error.code(), ExitCode::CommandLine);
            assert!(error.message().contains(given[1].0) && error.message().contains("leave it out"), "{error}");
        }
        for given in [[("encoding", "raw"), ("integral", "vector")], [("encoding", "sh"), ("order", "30")]] {
            let also = [("lights", "100")];
            assert!(recipe(&[&given[..], &also].concat()).err().unwrap().message().contains(given[1].0));
        }
    }
}
