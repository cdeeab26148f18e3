//! How radiosities are stored: the keys that choose it, and which of them go together.

use std::collections::BTreeMap;

use super::bleeding::RANGE_SHARE;
use super::{
    BLEND, CHOICE, ENCODING, INTEGRAL, INTERPOLATION, LIGHTS, NEAREST, ORDER, REFERENCES, SHELLS, SPACING, WEIGHTS,
    WINDOW,
};
use crate::compress::reference_points::{self, Bounds};
use crate::error::{Error, Result};
use crate::evaluate::Key;
use crate::math::sh::{MOST_ORDER, Window};
use crate::methods::settings::number;

/// What is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    /// Principal components at scattered reference points.
    Components,
    /// A float for each vertex and light.
    Raw,
    /// A byte for each, equal steps.
    Uniform8,
    /// A byte for each, Lloyd's table: the paper's section 4.
    Lloyd8,
    /// Spherical harmonics: section 4.1.
    Harmonics,
    /// A byte for each light at reference points, spherical harmonics of the differences: section 4.2.
    ReferencePoints,
    /// Nothing: two passes for each light, section 2.3.
    Bleeding,
}

impl Encoding {
    const ALL: [(&'static str, Self); 8] = [
        ("auto", Self::Components),
        ("components", Self::Components),
        ("raw", Self::Raw),
        ("uniform8", Self::Uniform8),
        ("lloyd8", Self::Lloyd8),
        ("sh", Self::Harmonics),
        ("reference-points", Self::ReferencePoints),
        ("bleeding", Self::Bleeding),
    ];

    /// Its name as a value of the key.
    pub(super) fn name(self) -> &'static str {
        Self::ALL.iter().rev().find(|(_, encoding)| *encoding == self).map_or("auto", |(name, _)| name)
    }

    /// Whether a key means something to it.
    fn reads(self, key: &str) -> bool {
        const SET: &[Encoding] = &[
            Encoding::Components,
            Encoding::Raw,
            Encoding::Uniform8,
            Encoding::Lloyd8,
            Encoding::Harmonics,
            Encoding::ReferencePoints,
        ];
        const INTERPOLATED: &[Encoding] =
            &[Encoding::Components, Encoding::Raw, Encoding::Uniform8, Encoding::Lloyd8, Encoding::ReferencePoints];
        const RULES: [(&str, &[Encoding]); 13] = [
            (INTEGRAL.name, &[Encoding::Raw, Encoding::Uniform8, Encoding::Lloyd8]),
            (ORDER.name, &[Encoding::Harmonics, Encoding::ReferencePoints]),
            (WINDOW.name, &[Encoding::Harmonics]),
            (REFERENCES.name, &[Encoding::Components, Encoding::ReferencePoints]),
            (CHOICE.name, &[Encoding::ReferencePoints]),
            (WEIGHTS.name, &[Encoding::ReferencePoints]),
            (SPACING.name, &[Encoding::Components]),
            (INTERPOLATION.name, INTERPOLATED),
            (LIGHTS.name, SET),
            (SHELLS.name, SET),
            (NEAREST.name, SET),
            (BLEND.name, SET),
            (RANGE_SHARE.name, &[Encoding::Bleeding]),
        ];
        RULES.iter().find(|(name, _)| *name == key).is_none_or(|(_, encodings)| encodings.contains(&self))
    }
}

/// What is integrated over the neighbourhood (the paper's section 3.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Integral {
    /// q, the radiosity.
    Scalar,
    /// Q, whose product with the direction of the light it is.
    Vector,
}

/// What the simplification that chooses the reference points looks at.
///
/// Error added to values under 200 lights, the median and the worst of 16 parallel lights, harmonics of order 3; closed bunny of
/// 30 mm in marble, by the share of the vertices that are reference points, in % (`Barycentric` and geometry are the paper's):
///
/// | | 1 % | 3 % | 6 % |
/// | --- | --- | --- | --- |
/// | geometry, barycentric | 4.31, 8.92 | 2.27, 4.75 | 1.43, 2.83 |
/// | geometry, least squares | 3.72, 9.04 | 2.03, 4.58 | 1.28, 2.76 |
/// | geometry, best triangle | 3.52, 9.12 | 1.90, 4.04 | 1.22, 2.48 |
/// | illumination, barycentric | 3.95, 9.30 | 1.99, 4.40 | 1.32, 2.80 |
/// | illumination, least squares | 3.49, 9.04 | 1.77, 4.22 | 1.16, 2.58 |
/// | illumination, best triangle | 3.37, 8.30 | 1.60, 3.67 | 1.01, 2.32 |
///
/// In skin1 the best triangle gives 2.10, 4.71 and 1.16, 2.67 at 3 and 6 % by geometry, 1.95, 5.15 and 1.09, 2.76 by
/// illumination: less under most lights, a little more under the worst. Weights and triangles cost up to 2 bytes a vertex.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ChosenBy {
    Geometry,
    Illumination,
}

/// What the keys say about storage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Choices {
    pub(super) encoding: Encoding,
    pub(super) integral: Integral,
    /// Of the harmonics; what the error asks for.
    pub(super) order: Option<usize>,
    pub(super) window: Window,
    /// Reference points; as many as the error asks for.
    pub(super) references: Option<usize>,
    pub(super) chosen_by: ChosenBy,
    pub(super) weights: reference_points::Choice,
}

impl Choices {
    pub(super) fn new(values: &BTreeMap<String, String>) -> Result<Self> {
        let order = match is_auto(values, &ORDER) {
            true => None,
            false => Some(number(values, &ORDER, 1..=MOST_ORDER)?),
        };
        let choices = Self {
            encoding: one_of(values, &ENCODING, &Encoding::ALL)?,
            integral: one_of(values, &INTEGRAL, &[("scalar", Integral::Scalar), ("vector", Integral::Vector)])?,
            order,
            window: one_of(
                values,
                &WINDOW,
                &[("none", Window::None), ("lanczos", Window::Lanczos), ("hanning", Window::Hanning)],
            )?,
            references: references(values)?,
            chosen_by: one_of(
                values,
                &CHOICE,
                &[("geometry", ChosenBy::Geometry), ("illumination", ChosenBy::Illumination)],
            )?,
            weights: one_of(
                values,
                &WEIGHTS,
                &[
                    ("barycentric", reference_points::Choice::Barycentric),
                    ("least-squares", reference_points::Choice::Fitted(Bounds::Extrapolating)),
                    ("best", reference_points::Choice::BestTriangle(Bounds::Extrapolating)),
                ],
            )?,
        };
        for key in super::KEYS {
            let text = text(values, key);
            if text != key.default && !choices.encoding.reads(key.name) {
                let encoding = choices.encoding.name();
                return Err(Error::command_line(format!(
                    "--set {}={text}: --set encoding={encoding} does not read this key; leave it out",
                    key.name
                )));
            }
        }
        Ok(choices)
    }
}

/// The number of reference points that was asked for, none where the error decides.
pub(super) fn references(values: &BTreeMap<String, String>) -> Result<Option<usize>> {
    match is_auto(values, &REFERENCES) {
        true => Ok(None),
        false => number(values, &REFERENCES, 1..=100_000_000).map(Some),
    }
}

fn text<'a>(values: &'a BTreeMap<String, String>, key: &Key) -> &'a str {
    values.get(key.name).map_or(key.default, String::as_str)
}

fn is_auto(values: &BTreeMap<String, String>, key: &Key) -> bool {
    text(values, key) == "auto"
}

/// The meaning of a key's value by its name.
fn one_of<T: Copy>(values: &BTreeMap<String, String>, key: &Key, all: &[(&str, T)]) -> Result<T> {
    let text = text(values, key);
    all.iter().find(|(name, _)| *name == text).map(|(_, meaning)| *meaning).ok_or_else(|| {
        let names: Vec<&str> = all.iter().map(|(name, _)| *name).collect();
        Error::command_line(format!("--set {}={text}: it is one of {}", key.name, names.join(", ")))
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::error::ExitCode;

    fn choices(given: &[(&str, &str)]) -> Result<Choices> {
        let pairs: Vec<(String, String)> = given.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect();
        Choices::new(&crate::methods::settings::resolve(&super::super::QuantizedLights, &pairs)?)
    }

    #[test]
    fn keys_belong_to_encodings() {
        assert_eq!(choices(&[]).unwrap().encoding, Encoding::Components);
        assert_eq!(choices(&[("encoding", "sh"), ("order", "7"), ("window", "lanczos")]).unwrap().order, Some(7));
        assert_eq!(choices(&[("encoding", "raw"), ("integral", "vector")]).unwrap().integral, Integral::Vector);
        let all = [("encoding", "reference-points"), ("references", "30"), ("choice", "geometry"), ("weights", "best")];
        assert_eq!(choices(&all).unwrap().references, Some(30));
        let refused = [
            [("encoding", "sh"), ("integral", "vector")],
            [("encoding", "sh"), ("interpolation", "nearest4")],
            [("encoding", "sh"), ("references", "30")],
            [("encoding", "lloyd8"), ("spacing", "1")],
            [("encoding", "lloyd8"), ("order", "3")],
            [("encoding", "reference-points"), ("window", "hanning")],
            [("encoding", "components"), ("weights", "barycentric")],
            [("encoding", "auto"), ("order", "5")],
        ];
        for given in refused {
            let error = choices(&given).unwrap_err();
            assert_eq!(error.code(), ExitCode::CommandLine);
            assert!(error.message().contains(given[1].0) && error.message().contains("leave it out"), "{error}");
        }
    }
}
