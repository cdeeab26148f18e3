//! Transport of light from far away: coefficients at reference points over a basis of spherical harmonics of the light.

use serde::{Deserialize, Serialize};

use crate::asset::{RawSection, pick};
use crate::checks::{in_range, invalid};
use crate::error::{FormatError, Result};
use crate::quantised_lights::Set;
use crate::types::{Codec, Kind};

/// Tags of the transport.
pub mod tags {
    use crate::quantised_lights::tags::Set;
    use crate::types::Tag;

    /// Numbers, a record.
    pub const NUMBERS: Tag = Tag::from_static("aft.rec");

    /// Coefficients and their basis.
    pub const SET: Set = Set {
        units: Tag::from_static("aft.uni"),
        basis_steps: Tag::from_static("aft.stp"),
        basis: Tag::from_static("aft.bas"),
        columns: Tag::from_static("aft.col"),
        coefficients: Tag::from_static("aft.cof"),
    };
}

/// Order of the harmonics at most.
pub const MOST_ORDER: u32 = 24;

/// See `SPEC.md`, "Harmonic transport".
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HarmonicTransport {
    /// Order n: n^2 harmonics.
    pub order: u32,
    /// Spacing of the reference points, mm.
    pub spacing_mm: f64,
    /// Samples that the transport was computed from.
    pub samples: u32,
    /// Radiosity of the reference points under each harmonic.
    pub set: Set,
}

/// What is no array.
#[derive(Serialize, Deserialize)]
struct Record {
    order: u32,
    spacing_mm: f64,
    samples: u32,
    channels: Vec<f64>,
    step: f32,
}

impl HarmonicTransport {
    /// Checks every length and range, as [`HarmonicTransport::from_sections`] guarantees them; coded bytes only as far as their
    /// shapes.
    ///
    /// # Errors
    /// [`crate::FormatError::Invalid`] with the tag of the section at fault.
    pub fn validate(&self) -> Result<()> {
        in_range(tags::NUMBERS, "a spacing", &[self.spacing_mm], 0.0)?;
        if !(1..=MOST_ORDER).contains(&self.order) {
            return invalid(tags::NUMBERS, format!("order {}: from 1 to {MOST_ORDER} is possible", self.order));
        }
        self.set.validate(tags::SET, (self.order * self.order) as usize, 1)
    }

    /// The sections of valid transport.
    ///
    /// # Errors
    /// [`crate::FormatError::Invalid`] as [`HarmonicTransport::validate`].
    pub fn to_sections(&self) -> Result<Vec<RawSection>> {
        self.validate()?;
        let Self { order, spacing_mm, samples, set } = self;
        let record = Record {
            order: *order,
            spacing_mm: *spacing_mm,
            samples: *samples,
            channels: set.channels.clone(),
            step: set.step,
        };
        let mut sections = vec![RawSection::from_record(tags::NUMBERS, Kind::Method, Codec::Zstd, &record)?];
        sections.extend(set.arrays(tags::SET));
        Ok(sections)
    }

    /// Reads it among the sections of an asset; `None` where there is none. Other sections are left alone.
    ///
    /// # Errors
    /// [`crate::FormatError::MissingSection`] where only some are there, and whatever is wrong with their type or content.
    pub fn from_sections(sections: &[RawSection]) -> Result<Option<Self>> {
        let numbers = pick(sections, [tags::NUMBERS], Kind::Method)?;
        let (numbers, set) = match (numbers, Set::from_arrays(sections, tags::SET)?) {
            (Some([numbers]), Some(set)) => (numbers, set),
            (None, None) => return Ok(None),
            (None, Some(_)) => return Err(FormatError::MissingSection { tag: tags::NUMBERS }),
            (Some(_), None) => return Err(FormatError::MissingSection { tag: tags::SET.units }),
        };
        let Record { order, spacing_mm, samples, channels, step } = numbers.record()?;
        let result = Self { order, spacing_mm, samples, set: Set { channels, step, ..set } };
        result.validate()?;
        Ok(Some(result))
    }
}
