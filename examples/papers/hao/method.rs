//! `hao_varshney`: what the paper stores, chosen by `encoding`.

use translux::error::{Error, Result};
use translux::evaluate::keys::{Auto, Key, Keys, Number, OneOf, Share};
use translux::evaluate::{About, AnyForm, BakeSettings, Method};
use translux::light::quantised::interpolation::Scheme;
use translux::math::sh::MOST_ORDER;
use translux::methods::quantized_lights::{BLEND, INTERPOLATION, LIGHTS, NEAREST, SHELLS, density, light_set};

use super::bleeding::NeighbourLists;
use super::harmonic_fit::Window;
use super::reference_points::{Bounds, Choice};
use super::{ChosenBy, Encoding, Integral, METHOD, VertexValues};

/// The method.
pub(crate) struct HaoVarshney;

/// Share of the asked error that the range of lists may cost.
const RANGE: f64 = 0.3;

/// What is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stored {
    /// Values of every vertex.
    Values(Encoding),
    /// Lists of neighbours.
    Lists,
}

const ENCODING: Key<OneOf<Stored>> = Key::new(
    "encoding",
    "lloyd8",
    OneOf(&[
        ("raw", Stored::Values(Encoding::Raw)),
        ("uniform8", Stored::Values(Encoding::Uniform8)),
        ("lloyd8", Stored::Values(Encoding::Lloyd8)),
        ("sh", Stored::Values(Encoding::Harmonics)),
        ("reference-points", Stored::Values(Encoding::ReferencePoints)),
        ("bleeding", Stored::Lists),
    ]),
    "what is stored: values of every vertex as they are or in a byte (section 4), spherical harmonics (4.1), reference points (4.2); \
     bleeding: nothing, two passes over lists of neighbouring vertices for each light (2.3)",
);

const REFERENCES: Key<Auto<Number<usize>>> = Key::new(
    "references",
    "auto",
    Auto(Number(1, 100_000_000)),
    "number of reference points, for reference-points; auto: what --max-rms asks for",
);

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

const WEIGHTS: Key<OneOf<Choice>> = Key::new(
    "weights",
    "best",
    OneOf(&[
        ("barycentric", Choice::Barycentric),
        ("least-squares", Choice::Fitted(Bounds::Extrapolating)),
        ("best", Choice::BestTriangle(Bounds::Extrapolating)),
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

impl Method for HaoVarshney {
    fn about(&self) -> About {
        About {
            name: METHOD,
            summary: "radiosity of every vertex under 200 lights, as the paper encodes it (Hao & Varshney 2004)",
            choose_when: "You compare with the paper; quantized_lights is smaller and nearer to the truth.",
            keys: &[
                &ENCODING,
                &LIGHTS,
                &SHELLS,
                &NEAREST,
                &INTERPOLATION,
                &BLEND,
                &INTEGRAL,
                &ORDER,
                &WINDOW,
                &REFERENCES,
                &CHOICE,
                &WEIGHTS,
                &RANGE_SHARE,
            ],
            default_max_rms: 0.02,
            declared_error: None,
            ladder: &[
                "",
                "--set interpolation=nearest4",
                "--set encoding=sh --set order=7",
                "--set encoding=reference-points",
            ],
        }
    }

    fn form(&self, keys: &Keys, settings: &BakeSettings) -> Result<Box<dyn AnyForm>> {
        match keys.get(&ENCODING)? {
            Stored::Values(encoding) => Ok(Box::new(values(encoding, keys, settings)?)),
            Stored::Lists => {
                let share = keys.get(&RANGE_SHARE)?.unwrap_or((RANGE * settings.max_rms).clamp(f64::MIN_POSITIVE, 1.0));
                Ok(Box::new(NeighbourLists { density: density(settings), range_share: share }))
            }
        }
    }
}

/// What the paper stores of every vertex.
fn values(encoding: Encoding, keys: &Keys, settings: &BakeSettings) -> Result<VertexValues> {
    // Harmonics need no interpolation between lights; this one takes no time to set up.
    let scheme = if encoding == Encoding::Harmonics { Scheme::Nearest4 } else { keys.get(&INTERPOLATION)? };
    let mut form = VertexValues {
        density: density(settings),
        lights: light_set(keys, settings, scheme)?,
        encoding,
        integral: Integral::Scalar,
        order: None,
        window: Window::None,
        references: None,
        chosen_by: ChosenBy::Illumination,
        weights: Choice::BestTriangle(Bounds::Extrapolating),
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
    use translux::error::ExitCode;
    use translux::evaluate::Recipe;

    fn recipe(given: &[(&str, &str)]) -> Result<Recipe> {
        let given: Vec<(String, String)> = given.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect();
        let method: &dyn Method = &HaoVarshney;
        method.recipe(&given, BakeSettings::new(0.02))
    }

    #[test]
    fn keys_belong_to_encodings() {
        for (given, form) in [
            (&[][..], "vertex_values"),
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
            [("encoding", "lloyd8"), ("order", "3")],
            [("encoding", "reference-points"), ("window", "hanning")],
            [("encoding", "raw"), ("weights", "barycentric")],
            [("encoding", "uniform8"), ("order", "5")],
            [("encoding", "bleeding"), ("lights", "100")],
        ];
        for given in refused {
            let error = recipe(&given).err().unwrap();
            assert_eq!(error.code(), ExitCode::CommandLine);
            assert!(error.message().contains(given[1].0) && error.message().contains("leave"), "{error}");
        }
        for given in [[("encoding", "raw"), ("integral", "vector")], [("encoding", "sh"), ("order", "30")]] {
            let also = [("lights", "100")];
            assert!(recipe(&[&given[..], &also].concat()).err().unwrap().message().contains(given[1].0));
        }
    }
}
