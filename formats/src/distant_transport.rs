//! Transport of light from far away: coefficients at reference points over a basis of spherical harmonics, or sparse rows of Haar
//! coefficients over a cube map, or the sum of both.

use serde::{Deserialize, Serialize};

use crate::asset::{RawSection, pick};
use crate::checks::{in_range, invalid};
use crate::error::{FormatError, Result};
use crate::quantised_lights::Set;
use crate::rows::{self, IrradianceRows};
use crate::types::{Codec, Kind};

/// Tags of the transport; those of its rows are [`rows::tags::TRANSPORT`].
pub mod tags {
    use crate::quantised_lights::tags::Set;
    use crate::types::Tag;

    /// Numbers, a record.
    pub const NUMBERS: Tag = Tag::from_static("aft.rec");

    /// Coefficients over harmonics and their basis.
    pub const SET: Set = Set {
        units: Tag::from_static("aft.uni"),
        basis_steps: Tag::from_static("aft.stp"),
        basis: Tag::from_static("aft.bas"),
        columns: Tag::from_static("aft.col"),
        coefficients: Tag::from_static("aft.cof"),
    };

    /// All of them, in the order of the file.
    pub const ALL: [Tag; 6] = [NUMBERS, SET.units, SET.basis_steps, SET.basis, SET.columns, SET.coefficients];
}

/// Order of the harmonics at most.
pub const MOST_ORDER: u32 = 24;

/// Terms of the rows: the channels R, G, B.
const CHANNELS: usize = 3;

/// See `SPEC.md`, "Distant light".
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DistantTransport {
    /// Samples that the transport was computed from.
    pub samples: u32,
    /// The part in harmonics.
    pub harmonics: Option<Harmonics>,
    /// The part in Haar coefficients, a row for each vertex that a transferring part uses.
    pub rows: Option<IrradianceRows>,
}

/// Radiosity of reference points under spherical harmonics of the light.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Harmonics {
    /// Order n: n^2 harmonics.
    pub order: u32,
    /// Spacing of the reference points, mm.
    pub spacing_mm: f64,
    /// Radiosity of the reference points under each harmonic.
    pub set: Set,
}

/// What is no array.
#[derive(Serialize, Deserialize)]
struct Record {
    samples: u32,
    order: u32,
    spacing_mm: f64,
    channels: Vec<f64>,
    step: f32,
}

impl DistantTransport {
    /// Checks every length and range, as [`DistantTransport::from_sections`] guarantees them; coded bytes only as far as their shapes.
    ///
    /// # Errors
    /// [`crate::FormatError::Invalid`] with the tag of the section at fault.
    pub fn validate(&self) -> Result<()> {
        if self.harmonics.is_none() && self.rows.is_none() {
            return invalid(tags::NUMBERS, "neither harmonics nor rows");
        }
        if let Some(Harmonics { order, spacing_mm, set }) = &self.harmonics {
            in_range(tags::NUMBERS, "a spacing", &[*spacing_mm], 0.0)?;
            if !(1..=MOST_ORDER).contains(order) {
                return invalid(tags::NUMBERS, format!("order {order}: from 1 to {MOST_ORDER} is possible"));
            }
            set.validate((tags::NUMBERS, tags::SET), (order * order) as usize, 1)?;
        }
        if let Some(rows) = &self.rows {
            if rows.terms != CHANNELS {
                return invalid(rows::tags::TRANSPORT.dimensions, format!("{} terms, not {CHANNELS}", rows.terms));
            }
            rows.validate_as(&rows::tags::TRANSPORT)?;
        }
        Ok(())
    }

    /// The sections of valid transport.
    ///
    /// # Errors
    /// [`crate::FormatError::Invalid`] as [`DistantTransport::validate`].
    pub fn to_sections(&self) -> Result<Vec<RawSection>> {
        self.validate()?;
        let numbers = |h: &Harmonics| (h.order, h.spacing_mm, h.set.channels.clone(), h.set.step);
        let (order, spacing_mm, channels, step) = self.harmonics.as_ref().map(numbers).unwrap_or_default();
        let record = Record { samples: self.samples, order, spacing_mm, channels, step };
        let mut sections = vec![RawSection::from_record(tags::NUMBERS, Kind::Method, Codec::Zstd, &record)?];
        if let Some(Harmonics { set, .. }) = &self.harmonics {
            sections.extend(set.arrays(tags::SET));
        }
        if let Some(rows) = &self.rows {
            sections.extend(rows.to_sections_as(&rows::tags::TRANSPORT, Kind::Method)?);
        }
        Ok(sections)
    }

    /// Reads it among the sections of an asset; `None` where there is none. Other sections are left alone. Rows are those of so
    /// many vertices.
    ///
    /// # Errors
    /// [`crate::FormatError::MissingSection`] where only some are there, and whatever is wrong with their type or content.
    pub fn from_sections(sections: &[RawSection], vertices: usize) -> Result<Option<Self>> {
        let numbers = pick(sections, [tags::NUMBERS], Kind::Method)?;
        let set = Set::from_arrays(sections, tags::SET)?;
        let rows = IrradianceRows::from_sections_as(sections, (&rows::tags::TRANSPORT, Kind::Method), vertices)?;
        let Some([numbers]) = numbers else {
            return match set.is_none() && rows.is_none() {
                true => Ok(None),
                false => Err(FormatError::MissingSection { tag: tags::NUMBERS }),
            };
        };
        let Record { samples, order, spacing_mm, channels, step } = numbers.record()?;
        let harmonics = match (order, set) {
            (0, None) => None,
            (0, Some(_)) => return invalid(tags::NUMBERS, "harmonics of order 0"),
            (_, None) => return Err(FormatError::MissingSection { tag: tags::SET.units }),
            (_, Some(set)) => Some(Harmonics { order, spacing_mm, set: Set { channels, step, ..set } }),
        };
        let result = Self { samples, harmonics, rows };
        result.validate()?;
        Ok(Some(result))
    }
}
