//! Multilevel summation: resolution of the kernels where no transport is stored.

use serde::{Deserialize, Serialize};

use crate::asset::{RawSection, pick};
use crate::checks::{in_range, invalid};
use crate::error::Result;
use crate::types::{Codec, Kind};

/// Tags of multilevel summation.
pub mod tags {
    use crate::types::Tag;

    /// Numbers of the summation, a record.
    pub const NUMBERS: Tag = Tag::from_static("mls.num");
}

/// Settings that a bake has measured to be accurate enough. See `spec/samples.md`, "Multilevel summation".
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MultilevelSummation {
    /// Asked relative error, RMS.
    pub error: f64,
    /// Spacing of the finest net over that of the samples.
    pub spacing: f64,
    /// Radius of the compact part in spacings of the finest net.
    pub softening: f64,
    /// Distance over the radius of a sample below which points of its facets are used.
    pub facets_below: f64,
    /// Distance over the radius of a sample below which its pieces are used, where it is not lit evenly.
    pub pieces_below: f64,
}

/// Largest accepted number; larger distances would make sums visit every pair.
const MOST: f64 = 1024.0;

impl MultilevelSummation {
    /// Checks every number, as [`MultilevelSummation::from_sections`] guarantees it.
    ///
    /// # Errors
    /// [`crate::FormatError::Invalid`].
    pub fn validate(&self) -> Result<()> {
        let Self { error, spacing, softening, facets_below, pieces_below } = *self;
        let numbers = [error, spacing, softening, facets_below, pieces_below];
        in_range(tags::NUMBERS, "a number", &numbers, 0.0)?;
        let usable = error > 0.0 && error <= 1.0 && (0.1..=MOST).contains(&spacing) && softening >= 1.0;
        if usable && numbers.iter().all(|n| *n <= MOST) {
            Ok(())
        } else {
            invalid(tags::NUMBERS, "numbers out of range")
        }
    }

    /// The section of valid settings.
    ///
    /// # Errors
    /// [`crate::FormatError::Invalid`] as [`MultilevelSummation::validate`].
    pub fn to_sections(&self) -> Result<Vec<RawSection>> {
        self.validate()?;
        Ok(vec![RawSection::from_record(tags::NUMBERS, Kind::Method, Codec::Raw, self)?])
    }

    /// Reads the settings among the sections of an asset; `None` where there are none. Other sections are ignored.
    ///
    /// # Errors
    /// Any fault of their type or content.
    pub fn from_sections(sections: &[RawSection]) -> Result<Option<Self>> {
        let Some([numbers]) = pick(sections, [tags::NUMBERS], Kind::Method)? else { return Ok(None) };
        let result: Self = numbers.record()?;
        result.validate()?;
        Ok(Some(result))
    }
}
