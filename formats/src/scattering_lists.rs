//! Scattering neighbourhoods: how far the lists of each vertex reach.

use serde::{Deserialize, Serialize};

use crate::asset::{RawSection, pick};
use crate::checks::{in_range, invalid};
use crate::error::Result;
use crate::types::{Codec, Kind};

/// Tags of the scattering neighbourhoods.
pub mod tags {
    use crate::types::Tag;

    /// Numbers, a record.
    pub const NUMBERS: Tag = Tag::from_static("qlt.ngh");
}

/// What the lists of a mesh follow from. See `spec/papers.md`, "Scattering neighbourhoods".
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ScatteringLists {
    /// For each medium, how far light that enters at a vertex counts, mm.
    pub ranges_mm: Vec<f64>,
    /// Samples that the lists were measured against.
    pub samples: u32,
}

impl ScatteringLists {
    /// Checks every range, as [`ScatteringLists::from_sections`] guarantees them.
    ///
    /// # Errors
    /// [`crate::FormatError::Invalid`].
    pub fn validate(&self) -> Result<()> {
        in_range(tags::NUMBERS, "a range", &self.ranges_mm, 0.0)?;
        if self.samples == 0 { invalid(tags::NUMBERS, "no samples") } else { Ok(()) }
    }

    /// The section of valid numbers.
    ///
    /// # Errors
    /// [`crate::FormatError::Invalid`] as [`ScatteringLists::validate`].
    pub fn to_sections(&self) -> Result<Vec<RawSection>> {
        self.validate()?;
        Ok(vec![RawSection::from_record(tags::NUMBERS, Kind::Method, Codec::Raw, self)?])
    }

    /// Reads them among the sections of an asset; `None` where there are none. Other sections are left alone.
    ///
    /// # Errors
    /// Whatever is wrong with their type or content.
    pub fn from_sections(sections: &[RawSection]) -> Result<Option<Self>> {
        let Some([numbers]) = pick(sections, [tags::NUMBERS], Kind::Method)? else { return Ok(None) };
        let result: Self = numbers.record()?;
        result.validate()?;
        Ok(Some(result))
    }
}
