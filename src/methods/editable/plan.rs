//! The keys of `editable`, checked.

use std::collections::BTreeMap;

use super::{
    AREA_SIDE, BASIS, COEFFICIENTS, CUBE, DIRECTIONS, FAR_LEVELS, FAR_SPACING, POINTS, SPLIT, TERMS, TRANSPORT,
    TRUNCATION, levels::MOST_LEVELS, unstored,
};
use crate::error::{Error, Result};
use crate::evaluate::Key;
use crate::medium::profile_basis::Family;
use crate::methods::sampling::light_sampling;
use crate::methods::settings::{number, share};
use crate::transport::far_field;
use crate::transport::gather::NearField;
use crate::transport::irradiance::LightSampling;

/// Shares of the asked error that the lossy stages of the far field may take. What is left is for sampling.
const TRUNCATION_SHARE: f64 = 0.6;
const QUANTISER_SHARE: f64 = 0.1;
const BASIS_SHARE: f64 = 0.15;

const INTERPOLATION_SHARE: f64 = 0.6;
const LEVELS_SHARE: f64 = 0.2;

/// Distance of the points of the far field at an error of 1 %, in sample spacings, at most.
const FAR_SPACING_AT_1: f64 = 4.0;

/// Whether transport is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Transport {
    Stored,
    None,
}

impl Transport {
    /// What the keys say.
    pub(super) fn of(values: &BTreeMap<String, String>) -> Result<Self> {
        match values.get(TRANSPORT.name).map_or(TRANSPORT.default, |text| text.trim()) {
            "stored" => Ok(Self::Stored),
            "none" => Ok(Self::None),
            other => Err(Error::command_line(format!("--set transport={other}: it is stored or none"))),
        }
    }
}

/// What a bake and an evaluation follow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Plan {
    pub(super) transport: Transport,
    pub(super) family: Family,
    /// `None`: as few as `basis_error` allows.
    pub(super) terms: Option<usize>,
    /// Error asked of the basis for any light (T1), over the total reflectance.
    pub(super) basis_error: f64,
    /// Near-field radius over the spacing of the samples.
    pub(super) split: f64,
    /// Distance of the points of the far field over the spacing of the samples; 0: every receiver is one. `None`: as
    /// `interpolation` allows, at most `widest_far_spacing`.
    pub(super) far_spacing: Option<f64>,
    pub(super) widest_far_spacing: f64,
    /// Error asked of interpolating the far field.
    pub(super) interpolation: f64,
    /// Levels of spacing of these points, and the error asked of them.
    pub(super) levels: usize,
    pub(super) levels_error: f64,
    pub(super) truncation: f64,
    pub(super) quantiser: f64,
    /// Cells of the hierarchy open above this radius over distance.
    pub(super) opening: f64,
    pub(super) cube: u32,
    pub(super) coefficients: usize,
    pub(super) sampling: LightSampling,
    pub(super) near: NearField,
}

impl Plan {
    pub(super) fn new(values: &BTreeMap<String, String>, max_rms: f64) -> Result<Self> {
        let text = |key: &Key| values.get(key.name).map_or(key.default, String::as_str).trim().to_owned();
        let transport = Transport::of(values)?;
        if transport == Transport::None {
            unstored::check(values)?;
        }
        let family = match text(&BASIS).as_str() {
            "transported" => Family::Transported,
            "ladder" => Family::Ladder,
            "plain" => Family::Plain,
            other => {
                return Err(Error::command_line(format!("--set basis={other}: it is transported, ladder or plain")));
            }
        };
        let terms = match text(&TERMS).as_str() {
            "auto" => None,
            _ => Some(number(values, &TERMS, 1..=far_field::TERMS)?),
        };
        let truncation = match text(&TRUNCATION).as_str() {
            "auto" => TRUNCATION_SHARE * max_rms,
            text => share(text, "--set truncation")?,
        };
        let far_spacing = match text(&FAR_SPACING).as_str() {
            "auto" => None,
            _ => Some(number(values, &FAR_SPACING, 0.0..=8.0)?),
        };
        if let Some(asked) = far_spacing.filter(|asked| *asked > 0.0 && *asked < 0.5) {
            return Err(Error::command_line(format!("--set far-spacing={asked}: it is 0, or from 0.5 to 8")));
        }
        let cube = number(values, &CUBE, 32..=64)?;
        if cube != 32 && cube != 64 {
            return Err(Error::command_line(format!("--set cube={cube}: it is 32 or 64")));
        }
        Ok(Self {
            transport,
            family,
            terms,
            basis_error: BASIS_SHARE * max_rms,
            split: number(values, &SPLIT, 4.0..=64.0)?,
            far_spacing,
            // The error goes with a power between 1.5 and 2.
            widest_far_spacing: (FAR_SPACING_AT_1 * (max_rms / 0.01).sqrt()).clamp(0.5, 6.0),
            interpolation: INTERPOLATION_SHARE * max_rms,
            levels: number(values, &FAR_LEVELS, 1..=MOST_LEVELS)?,
            levels_error: LEVELS_SHARE * max_rms,
            truncation,
            quantiser: QUANTISER_SHARE * max_rms,
            opening: (0.1 * (max_rms / 0.01).sqrt()).clamp(0.03, 0.2),
            cube,
            coefficients: number(values, &COEFFICIENTS, 8..=1024)?,
            sampling: light_sampling(values, [&POINTS, &DIRECTIONS, &AREA_SIDE])?,
            near: NearField::for_error(max_rms),
        })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::methods::editable::Editable;
    use crate::methods::settings::resolve;

    fn plan(set: &[(&str, &str)]) -> Result<Plan> {
        let set: Vec<(String, String)> = set.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect();
        Plan::new(&resolve(&Editable, &set).unwrap(), 0.01)
    }

    #[test]
    fn defaults_share_out_the_error() {
        let plan = plan(&[]).unwrap();
        assert_eq!((plan.terms, plan.family, plan.cube), (None, Family::Ladder, 32));
        // Five errors of different origin: their squares add.
        let interpolated = plan.interpolation.hypot(plan.levels_error);
        let all = plan.truncation.hypot(interpolated).hypot(plan.quantiser).hypot(plan.basis_error);
        assert!(all < 0.9 * 0.01, "{all}");
        assert_eq!(plan.sampling, LightSampling::FAST);
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        for (key, value) in [
            ("basis", "best"),
            ("terms", "0"),
            ("terms", "17"),
            ("split", "1"),
            ("split", "nan"),
            ("truncation", "0"),
            ("far-spacing", "0.1"),
            ("far-spacing", "9"),
            ("far-levels", "0"),
            ("far-levels", "5"),
            ("cube", "48"),
            ("coefficients", "4"),
            ("points", "3"),
            ("transport", "some"),
        ] {
            let transport = if key == "transport" { value } else { "stored" };
            let error = plan(&[("transport", transport), (key, value)]).unwrap_err();
            assert!(error.message().contains(key), "{}", error.message());
        }
        for key in ["terms", "split", "far-spacing", "basis", "truncation"] {
            let value = if key == "basis" { "plain" } else { "5" };
            let error = plan(&[("transport", "none"), (key, value)]).unwrap_err();
            assert!(error.message().contains("transport=stored"), "{}", error.message());
        }
        assert_eq!(plan(&[("transport", "none")]).unwrap().transport, Transport::None);
        assert_eq!(plan(&[("transport", "stored"), ("terms", "7"), ("truncation", "0.2%")]).unwrap().terms, Some(7));
    }
}
