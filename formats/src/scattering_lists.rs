//! Scattering neighbourhoods: the range of the lists of each vertex.

use serde::{Deserialize, Serialize};

use crate::asset::{RawSection, pick};
use crate::checks::{in_range, invalid};
use crate::error::Result;
use crate::types::{Codec, Kind};

/// Tags of the scattering neighbourhoods.
pub mod tags {
    use crate::types::Tag;

    /// Numbers of the neighbourhoods, a record.
    pub const NUMBERS: Tag = Tag::from_static("qlt.ngh");
}

/// Data from which a mesh's lists follow. See `spec/papers.md`, "Scattering neighbourhoods".
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ScatteringLists {
    /// Range of the light that enters at a vertex, for each medium, mm.
    pub ranges_mm: Vec<f64>,
    /// Number of samples against which the lists were measured.
    pub samples: u32,
}

impl ScatteringLists {
    /// Checks every range, as [`ScatteringLists::from_sections`] guarantees it.
    ///
    /// # Errors
    /// [`crate::FormatError::Invalid`].
    pub fn validate(&self) -> Result<()> {
        in_range(tags::NUMBERS, "a range", &self.ranges_mm, 0.0)?;
        if self.samples == 0 { invalid(tags::NUMBERS, "no samples") } else { Ok(()) }
    }

    /// The section of valid ranges.
    ///
    /// # Errors
    /// [`crate::FormatError::Invalid`] as [`ScatteringLists::validate`].
    pub fn to_sections(&self) -> Result<Vec<RawSection>> {
        self.validate()?;
        Ok(vec![RawSection::from_record(tags::NUMBERS, Kind::Method, Codec::Raw, self)?])
    }

    /// Reads the ranges among the sections of an asset; `None` where there are none. Other sections are ignored.
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
