//! Transport of light from far away: coefficients at reference points over a basis of spherical harmonics, or sparse
//! rows of Haar coefficients over a cube map, or the sum of both.

use serde::{Deserialize, Serialize};

use crate::asset::{RawSection, pick};
use crate::checks::{in_range, invalid, samples};
use crate::error::{FormatError, Result};
use crate::quantised_lights::{self, Set};
use crate::rows::{self, IrradianceRows};
use crate::types::{Codec, Kind, Tag};

/// Tags of the transport; those of its rows are [`rows::tags::TRANSPORT`] and [`rows::tags::SINGLE`].
pub mod tags {
    use crate::quantised_lights::tags::Set;
    use crate::types::Tag;

    /// Numbers of the transport, a record.
    pub const NUMBERS: Tag = Tag::from_static("aft.rec");

    /// Coefficients over harmonics, with their basis.
    pub const SET: Set = Set {
        units: Tag::from_static("aft.uni"),
        basis_steps: Tag::from_static("aft.stp"),
        basis: Tag::from_static("aft.bas"),
        columns: Tag::from_static("aft.col"),
        coefficients: Tag::from_static("aft.cof"),
    };

    /// Numbers of single scattering, a record.
    pub const SINGLE_NUMBERS: Tag = Tag::from_static("afs.rec");

    /// Coefficients of single scattering over harmonics, with their basis.
    pub const SINGLE_SET: Set = Set {
        units: Tag::from_static("afs.uni"),
        basis_steps: Tag::from_static("afs.stp"),
        basis: Tag::from_static("afs.bas"),
        columns: Tag::from_static("afs.col"),
        coefficients: Tag::from_static("afs.cof"),
    };

    /// All tags except those of the rows, in the order of the file.
    pub const ALL: [Tag; 12] = [
        NUMBERS,
        SET.units,
        SET.basis_steps,
        SET.basis,
        SET.columns,
        SET.coefficients,
        SINGLE_NUMBERS,
        SINGLE_SET.units,
        SINGLE_SET.basis_steps,
        SINGLE_SET.basis,
        SINGLE_SET.columns,
        SINGLE_SET.coefficients,
    ];
}

/// Largest order of the harmonics.
pub const MOST_ORDER: u32 = 32;

/// Largest number of terms of the phase function.
pub const MOST_TERMS: u32 = 16;

/// Number of terms of the rows: the channels R, G, B.
const CHANNELS: usize = 3;

/// See `spec/projected.md`, "Harmonics", `spec/rows.md` and `spec/single_scattering.md`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DistantTransport {
    /// Number of samples that the transport was computed from.
    pub samples: u32,
    /// The part in harmonics.
    pub harmonics: Option<Harmonics>,
    /// The part in Haar coefficients, a row for each vertex that a transferring part uses.
    pub rows: Option<IrradianceRows>,
    /// Single scattering.
    pub single: Option<Single>,
}

/// Single scattering, in harmonics or in rows.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Single {
    /// Number of terms of the phase function's light side, one for each shell of the set; rows have one.
    pub terms: u32,
    /// Single scattering in harmonics.
    pub harmonics: Option<Harmonics>,
    /// Single scattering in Haar coefficients, a row for each vertex.
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

/// Content of the record of numbers.
#[derive(Serialize, Deserialize)]
struct Record {
    samples: u32,
    numbers: Numbers,
}

/// Content of the record of single scattering.
#[derive(Serialize, Deserialize)]
struct SingleRecord {
    terms: u32,
    numbers: Numbers,
}

/// Numbers of harmonics; order 0 for none.
#[derive(Default, Serialize, Deserialize)]
struct Numbers {
    order: u32,
    spacing_mm: f64,
    channels: Vec<f64>,
    step: f32,
}

impl Numbers {
    fn new(harmonics: Option<&Harmonics>) -> Self {
        let of = |h: &Harmonics| Self {
            order: h.order,
            spacing_mm: h.spacing_mm,
            channels: h.set.channels.clone(),
            step: h.set.step,
        };
        harmonics.map(of).unwrap_or_default()
    }

    /// The harmonics with the arrays of a set; `None` for order 0.
    fn joined(self, tag: Tag, tags: quantised_lights::tags::Set, set: Option<Set>) -> Result<Option<Harmonics>> {
        let Self { order, spacing_mm, channels, step } = self;
        match (order, set) {
            (0, None) => Ok(None),
            (0, Some(_)) => invalid(tag, "harmonics of order 0"),
            (_, None) => Err(FormatError::MissingSection { tag: tags.units }),
            (_, Some(set)) => Ok(Some(Harmonics { order, spacing_mm, set: Set { channels, step, ..set } })),
        }
    }
}

impl Harmonics {
    fn validate(&self, (tag, tags): (Tag, quantised_lights::tags::Set), shells: usize) -> Result<()> {
        let Self { order, spacing_mm, set } = self;
        in_range(tag, "a spacing", &[*spacing_mm], 0.0)?;
        if !(1..=MOST_ORDER).contains(order) {
            return invalid(tag, format!("order {order}: from 1 to {MOST_ORDER} is possible"));
        }
        set.validate((tag, tags), (order * order) as usize, shells)
    }
}

fn validate_rows(rows: &IrradianceRows, tags: &rows::tags::Set) -> Result<()> {
    if rows.terms != CHANNELS {
        return invalid(tags.dimensions, format!("{} terms, not {CHANNELS}", rows.terms));
    }
    rows.validate_as(tags)
}

impl Single {
    fn validate(&self) -> Result<()> {
        let tag = tags::SINGLE_NUMBERS;
        if !(1..=MOST_TERMS).contains(&self.terms) {
            return invalid(
                tag,
                format!("{} terms of a phase function: from 1 to {MOST_TERMS} are possible", self.terms),
            );
        }
        match (&self.harmonics, &self.rows) {
            (Some(harmonics), None) => harmonics.validate((tag, tags::SINGLE_SET), self.terms as usize),
            (None, Some(_)) if self.terms != 1 => invalid(tag, format!("rows of {} terms, not 1", self.terms)),
            (None, Some(rows)) => validate_rows(rows, &rows::tags::SINGLE),
            _ => invalid(tag, "either harmonics or rows hold light that is scattered once"),
        }
    }

    fn to_sections(&self) -> Result<Vec<RawSection>> {
        let record = SingleRecord { terms: self.terms, numbers: Numbers::new(self.harmonics.as_ref()) };
        let mut sections = vec![RawSection::from_record(tags::SINGLE_NUMBERS, Kind::Method, Codec::Zstd, &record)?];
        if let Some(Harmonics { set, .. }) = &self.harmonics {
            sections.extend(set.arrays(tags::SINGLE_SET));
        }
        if let Some(rows) = &self.rows {
            sections.extend(rows.to_sections_as(&rows::tags::SINGLE, Kind::Method)?);
        }
        Ok(sections)
    }

    fn from_sections(sections: &[RawSection], vertices: usize) -> Result<Option<Self>> {
        let numbers = pick(sections, [tags::SINGLE_NUMBERS], Kind::Method)?;
        let set = Set::from_arrays(sections, tags::SINGLE_SET)?;
        let rows = IrradianceRows::from_sections_as(sections, (&rows::tags::SINGLE, Kind::Method), vertices)?;
        let Some([numbers]) = numbers else {
            return match set.is_none() && rows.is_none() {
                true => Ok(None),
                false => Err(FormatError::MissingSection { tag: tags::SINGLE_NUMBERS }),
            };
        };
        let SingleRecord { terms, numbers } = numbers.record()?;
        let harmonics = numbers.joined(tags::SINGLE_NUMBERS, tags::SINGLE_SET, set)?;
        Ok(Some(Self { terms, harmonics, rows }))
    }
}

impl DistantTransport {
    /// Checks every length and range that [`DistantTransport::from_sections`] guarantees; of coded bytes, only the
    /// shapes.
    ///
    /// # Errors
    /// [`crate::FormatError::Invalid`] with the tag of the section at fault.
    pub fn validate(&self) -> Result<()> {
        samples(tags::NUMBERS, self.samples)?;
        if self.harmonics.is_none() && self.rows.is_none() {
            return invalid(tags::NUMBERS, "neither harmonics nor rows");
        }
        if let Some(harmonics) = &self.harmonics {
            harmonics.validate((tags::NUMBERS, tags::SET), 1)?;
        }
        if let Some(rows) = &self.rows {
            validate_rows(rows, &rows::tags::TRANSPORT)?;
        }
        self.single.as_ref().map_or(Ok(()), Single::validate)
    }

    /// The sections of a valid transport.
    ///
    /// # Errors
    /// [`crate::FormatError::Invalid`] as [`DistantTransport::validate`].
    pub fn to_sections(&self) -> Result<Vec<RawSection>> {
        self.validate()?;
        let record = Record { samples: self.samples, numbers: Numbers::new(self.harmonics.as_ref()) };
        let mut sections = vec![RawSection::from_record(tags::NUMBERS, Kind::Method, Codec::Zstd, &record)?];
        if let Some(Harmonics { set, .. }) = &self.harmonics {
            sections.extend(set.arrays(tags::SET));
        }
        if let Some(rows) = &self.rows {
            sections.extend(rows.to_sections_as(&rows::tags::TRANSPORT, Kind::Method)?);
        }
        if let Some(single) = &self.single {
            sections.extend(single.to_sections()?);
        }
        Ok(sections)
    }

    /// Reads the transport among the sections of an asset; `None` where there is none. Other sections are ignored. Rows
    /// are those of `vertices` vertices.
    ///
    /// # Errors
    /// [`crate::FormatError::MissingSection`] where only some exist, and any fault of their type or content.
    pub fn from_sections(sections: &[RawSection], vertices: usize) -> Result<Option<Self>> {
        let numbers = pick(sections, [tags::NUMBERS], Kind::Method)?;
        let set = Set::from_arrays(sections, tags::SET)?;
        let rows = IrradianceRows::from_sections_as(sections, (&rows::tags::TRANSPORT, Kind::Method), vertices)?;
        let single = Single::from_sections(sections, vertices)?;
        let Some([numbers]) = numbers else {
            return match set.is_none() && rows.is_none() && single.is_none() {
                true => Ok(None),
                false => Err(FormatError::MissingSection { tag: tags::NUMBERS }),
            };
        };
        let Record { samples, numbers } = numbers.record()?;
        let result = Self { samples, harmonics: numbers.joined(tags::NUMBERS, tags::SET, set)?, rows, single };
        result.validate()?;
        Ok(Some(result))
    }
}
