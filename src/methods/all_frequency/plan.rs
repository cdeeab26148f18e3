//! What the keys ask for.

use std::collections::{BTreeMap, BTreeSet};

use super::{
    BASIS, COEFFICIENTS, CUBE, PHASE_TERMS, RAYS, REFERENCES, SELECTION, SINGLE, SINGLE_BASIS, SPACING, TRANSFORM,
};
use crate::error::{Error, Result};
use crate::evaluate::inter_reflection::Outside;
use crate::light::LightKind;
use crate::light::cube_light::Transform;
use crate::math::cube_map::FACES;
use crate::methods::inter_reflection::outside;
use crate::methods::references::spacing_of;
use crate::methods::settings::number;
use crate::methods::single_keys::Integrand;
use crate::methods::stage::Stage;
use crate::transport::visibility::Resolution;

/// Order of the harmonics at most.
pub(super) const MOST_ORDER: usize = 32;

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

/// What becomes of light that is scattered once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Single {
    /// It is left out.
    Off,
    /// Isotropic, with reduced coefficients: a value for each vertex.
    Isotropic,
    /// The same, part of the radiosity.
    Folded,
    /// By the phase function of each medium, as a sum of terms.
    Phase(Terms),
}

/// Terms of a phase function.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Terms {
    /// As the media ask.
    Auto,
    /// So many.
    Stored(usize),
    /// None: rays at run time.
    Rays,
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
    spacing_mm: Option<f64>,
    references: Option<usize>,
    pub(super) single: Single,
    /// What it is expressed in.
    pub(super) single_basis: Basis,
    /// What is integrated for it.
    pub(super) integrand: Integrand,
    /// Light that falls on the surface again.
    pub(super) outside: Option<Outside>,
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
        let terms = [1, 4, 9, 16].map(Terms::Stored);
        let names = ["auto", "1", "4", "9", "16", "rays"].into_iter();
        let terms = [&[Terms::Auto], &terms[..], &[Terms::Rays]].concat();
        let terms = one_of(values, &PHASE_TERMS, &names.zip(terms).collect::<Vec<_>>())?;
        let single = [
            ("off", Single::Off),
            ("isotropic", Single::Isotropic),
            ("folded", Single::Folded),
            ("phase", Single::Phase(terms)),
        ];
        let single = one_of(values, &SINGLE, &single)?;
        // Rows hold one term.
        let auto = if matches!(single, Single::Phase(_) | Single::Folded) { Basis::Harmonics } else { basis };
        let names = [("auto", auto), ("sh", Basis::Harmonics), ("haar", Basis::Haar)];
        let single_basis = one_of(values, &SINGLE_BASIS, &names)?;
        let integrand = Integrand::new(values)?;
        Ok(Self {
            resolution,
            basis,
            transform,
            choice,
            row,
            order,
            spacing_mm,
            references,
            single,
            single_basis,
            integrand,
            outside: outside(values, &RAYS)?,
        })
    }

    /// Distance between reference points, mm, where it or their number is asked for.
    pub(super) fn asked_spacing_mm(&self, stage: &Stage) -> Option<f64> {
        self.spacing_mm.or_else(|| self.references.map(|count| spacing_of(stage, count)))
    }

    /// Refuses keys that this basis does not read, and kinds of light that it does not serve.
    pub(super) fn check(&self, values: &BTreeMap<String, String>, kinds: &BTreeSet<LightKind>) -> Result<()> {
        let given = |key: &crate::evaluate::Key| values.get(key.name).is_some_and(|text| text != key.default);
        if given(&PHASE_TERMS) && !matches!(self.single, Single::Phase(_)) {
            return Err(Error::command_line("--set phase-terms: for --set single-scattering=phase"));
        }
        if self.outside.is_some() && self.basis == Basis::Haar {
            return Err(Error::command_line("--set inter-reflection: for harmonics, --set basis=sh"));
        }
        if self.single == Single::Off {
            Integrand::check_unused(values)?;
        }
        if given(&SINGLE_BASIS) && self.single == Single::Off {
            return Err(Error::command_line("--set single-basis: for --set single-scattering=isotropic or phase"));
        }
        if self.single == Single::Folded && (self.basis, self.single_basis) != (Basis::Harmonics, Basis::Harmonics) {
            return Err(Error::command_line("--set single-scattering=folded: for harmonics, --set basis=sh"));
        }
        if self.single_basis == Basis::Haar && matches!(self.single, Single::Phase(_)) {
            return Err(Error::command_line("--set single-basis=haar: for --set single-scattering=isotropic"));
        }
        let uses = |basis: Basis| self.basis == basis || (self.single != Single::Off && self.single_basis == basis);
        let unread: &[&crate::evaluate::Key] = match (uses(Basis::Haar), uses(Basis::Harmonics)) {
            (true, true) => &[],
            (_, false) => &[&SPACING, &REFERENCES],
            (false, _) => &[&TRANSFORM, &SELECTION],
        };
        for key in unread {
            if given(key) {
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
