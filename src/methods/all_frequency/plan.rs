//! What the keys ask for.

use std::collections::{BTreeMap, BTreeSet};

use super::{BASIS, COEFFICIENTS, CUBE, REFERENCES, SELECTION, SPACING, TRANSFORM};
use crate::error::{Error, Result};
use crate::light::LightKind;
use crate::light::cube_light::Transform;
use crate::math::cube_map::FACES;
use crate::methods::settings::number;
use crate::transport::visibility::Resolution;

/// Order of the harmonics at most.
pub(super) const MOST_ORDER: usize = 24;

/// Coefficients of a row unless they are asked for: the paper's.
const ROW: usize = 128;

/// What transport is expressed in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Basis {
    /// Sparse rows of Haar coefficients.
    Haar,
    /// Spherical harmonics, coded together.
    Harmonics,
}

/// How the coefficients of a row are chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Choice {
    /// The largest of each vertex.
    Magnitude,
    /// The largest of each vertex times what light is expected.
    Light,
    /// As many as are worth their bytes, at one threshold for all vertices.
    Rate,
}

/// Everything together.
#[derive(Clone, Debug)]
pub(super) struct Plan {
    pub(super) resolution: Resolution,
    pub(super) basis: Basis,
    pub(super) transform: Transform,
    pub(super) choice: Choice,
    /// Coefficients of each row, if they are Haar's.
    pub(super) row: usize,
    /// Order of the harmonics, or as the error asks.
    pub(super) order: Option<usize>,
    pub(super) spacing_mm: Option<f64>,
    pub(super) references: Option<usize>,
}

fn one_of<T: Copy>(values: &BTreeMap<String, String>, key: &crate::evaluate::Key, all: &[(&str, T)]) -> Result<T> {
    let text = values.get(key.name).map_or(key.default, String::as_str);
    all.iter().find(|(name, _)| *name == text).map(|(_, value)| *value).ok_or_else(|| {
        let names: Vec<&str> = all.iter().map(|(name, _)| *name).collect();
        Error::command_line(format!("--set {}={text}: it is one of {}", key.name, names.join(", ")))
    })
}

impl Plan {
    pub(super) fn new(values: &BTreeMap<String, String>) -> Result<Self> {
        let given = |key: &crate::evaluate::Key| values.get(key.name).filter(|text| *text != "auto");
        let resolution = one_of(values, &CUBE, &[("32", Resolution::Sub64), ("64", Resolution::Sub128)])?;
        let names = [("auto", Basis::Harmonics), ("sh", Basis::Harmonics), ("haar", Basis::Haar)];
        let basis = one_of(values, &BASIS, &names)?;
        let transform =
            one_of(values, &TRANSFORM, &[("solid-angle", Transform::SolidAngle), ("texels", Transform::Texels)])?;
        let choices = [("magnitude", Choice::Magnitude), ("light", Choice::Light), ("rate", Choice::Rate)];
        let choice = one_of(values, &SELECTION, &choices)?;
        let most = FACES * (resolution.side() / 2).pow(2);
        let (row, order) = match (given(&COEFFICIENTS), basis) {
            (None, _) => (ROW, None),
            (Some(_), Basis::Haar) => (number(values, &COEFFICIENTS, FACES..=most)?, None),
            (Some(_), Basis::Harmonics) => {
                let count = number(values, &COEFFICIENTS, 1..=MOST_ORDER * MOST_ORDER)?;
                let order = count.isqrt();
                if order * order != count {
                    return Err(Error::command_line(format!(
                        "--set coefficients={count}: harmonics come in squares, {} or {}",
                        order * order,
                        (order + 1) * (order + 1)
                    )));
                }
                (ROW, Some(order))
            }
        };
        let spacing_mm = given(&SPACING).map(|_| number(values, &SPACING, 1e-6..=1e6)).transpose()?;
        let references = given(&REFERENCES).map(|_| number(values, &REFERENCES, 1..=1 << 30)).transpose()?;
        Ok(Self { resolution, basis, transform, choice, row, order, spacing_mm, references })
    }

    /// Refuses keys that this basis does not read, and kinds of light that it does not serve.
    pub(super) fn check(&self, values: &BTreeMap<String, String>, kinds: &BTreeSet<LightKind>) -> Result<()> {
        let unread: &[&crate::evaluate::Key] = match self.basis {
            Basis::Haar => &[&SPACING, &REFERENCES],
            Basis::Harmonics => &[&TRANSFORM, &SELECTION],
        };
        for key in unread {
            if values.get(key.name).is_some_and(|text| text != key.default) {
                let basis = if self.basis == Basis::Haar { "haar" } else { "sh" };
                return Err(Error::command_line(format!("--set {}: basis={basis} has no use for it", key.name)));
            }
        }
        if kinds.iter().all(|kind| !super::KINDS.contains(kind)) && !kinds.is_empty() {
            return Err(Error::unsupported(
                "all_frequency is for light from far away (environment, constant, directional): bake --for-lights point or area with \
                 --method quantized_lights or editable",
            ));
        }
        Ok(())
    }
}
