//! Radiosity of every vertex under a quantised set of lights, as stored by Hao and Varshney 2004: values, one byte
//! each, spherical harmonics, or reference points with harmonics of the differences.

use serde::{Deserialize, Serialize};

use crate::asset::{RawSection, pick};
use crate::checks::{in_range, invalid, same_length};
use crate::coefficients;
use crate::error::Result;
use crate::quantised_lights::MOST_LIGHTS;
use crate::types::{Codec, Kind, Tag};

/// Tags of the quantised values.
pub mod tags {
    use crate::types::Tag;

    /// Numbers of the quantised values, a record.
    pub const NUMBERS: Tag = Tag::from_static("qlv.rec");
    /// Plain values, f32.
    pub const RAW: Tag = Tag::from_static("qlv.raw");
    /// Tables of the codes, f32.
    pub const TABLES: Tag = Tag::from_static("qlv.tab");
    /// Codes, one byte each, coded.
    pub const CODES: Tag = Tag::from_static("qlv.cod");
    /// Unit of each harmonic, f32.
    pub const SCALES: Tag = Tag::from_static("qlv.scl");
    /// Harmonics, coded.
    pub const HARMONICS: Tag = Tag::from_static("qlv.har");
    /// Reference points among the vertices, coded.
    pub const MEMBERS: Tag = Tag::from_static("qlv.mem");
    /// Triangle and weights of every other vertex, coded.
    pub const PLACES: Tag = Tag::from_static("qlv.plc");

    /// All tags, in the order of the file.
    pub const ALL: [Tag; 8] = [NUMBERS, RAW, TABLES, CODES, SCALES, HARMONICS, MEMBERS, PLACES];
}

/// Number of entries of a table.
pub const LEVELS: usize = 256;

/// Highest order of the harmonics.
pub const MOST_ORDER: u8 = 32;

/// Number of channels.
const CHANNELS: usize = 3;

/// Number of planes of vectors: three components for each channel.
const VECTOR_PLANES: u8 = 9;

/// Encoding of the radiosity.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Encoding {
    /// Plain values, 32 bits each.
    #[default]
    Raw,
    /// One byte for each value.
    Codes,
    /// Spherical harmonics, 16 bits each.
    Harmonics,
    /// One byte for each value at reference points, spherical harmonics of the differences elsewhere.
    References,
}

impl Encoding {
    /// The sections of the encoding, in the order of the file.
    pub fn tags(self) -> &'static [Tag] {
        use tags::{CODES, HARMONICS, MEMBERS, NUMBERS, PLACES, RAW, SCALES, TABLES};
        match self {
            Self::Raw => &[NUMBERS, RAW],
            Self::Codes => &[NUMBERS, TABLES, CODES],
            Self::Harmonics => &[NUMBERS, SCALES, HARMONICS],
            Self::References => &[NUMBERS, TABLES, CODES, SCALES, HARMONICS, MEMBERS, PLACES],
        }
    }
}

/// Quantised values. See `spec/papers.md`, "Quantised values". Arrays that the encoding does not need are empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct QuantisedValues {
    /// Encoding of the radiosity.
    pub encoding: Encoding,
    /// Number of directions of the spherical Fibonacci lattice.
    pub directions: u32,
    /// Radius of the scene over the distance of each shell of lights, ascending from 0.
    pub shells: Vec<f64>,
    /// Number of samples that the values were computed from.
    pub samples: u32,
    /// Number of planes of values for each light: 3 channels, or 9, three vector components for each channel.
    pub planes: u8,
    /// Order of the harmonics; 0 without harmonics.
    pub order: u8,
    /// Plain values, `[vertex][plane][light]`.
    pub raw: Vec<f32>,
    /// Values of the codes, 256 in ascending order for each plane.
    pub tables: Vec<f32>,
    /// Coded codes of the vertices, or of the reference points, less their predictions, as [`coefficients::encode`]
    /// writes them: a row for each vertex and plane, a column for each light.
    pub codes: Vec<u8>,
    /// Unit of each harmonic, `[channel][shell][coefficient]`.
    pub scales: Vec<f32>,
    /// Coded harmonics, a row for each vertex (or each that is no reference point), columns as in `scales`.
    pub harmonics: Vec<u8>,
    /// Coded membership: a row for each vertex, one column, 1 for a reference point.
    pub members: Vec<u8>,
    /// Coded places, a row for each vertex that is no reference point: triangle, two weights.
    pub places: Vec<u8>,
}

/// Content of the record.
#[derive(Serialize, Deserialize)]
struct Record {
    encoding: Encoding,
    directions: u32,
    shells: Vec<f64>,
    samples: u32,
    planes: u8,
    order: u8,
}

impl QuantisedValues {
    /// Number of lights.
    pub fn lights(&self) -> usize {
        self.directions as usize * self.shells.len()
    }

    /// Number of harmonics of a vertex, over all channels and shells.
    pub fn columns(&self) -> usize {
        CHANNELS * self.shells.len() * usize::from(self.order) * usize::from(self.order)
    }

    /// Checks every length and range that [`QuantisedValues::from_sections`] guarantees; of coded bytes, only the
    /// shapes.
    ///
    /// # Errors
    /// [`crate::FormatError::Invalid`] with the tag of the section at fault.
    pub fn validate(&self) -> Result<()> {
        self.validate_numbers()?;
        let lengths = [
            (tags::RAW, self.raw.len()),
            (tags::TABLES, self.tables.len()),
            (tags::CODES, self.codes.len()),
            (tags::SCALES, self.scales.len()),
            (tags::HARMONICS, self.harmonics.len()),
            (tags::MEMBERS, self.members.len()),
            (tags::PLACES, self.places.len()),
        ];
        let needed = self.encoding.tags();
        if let Some((tag, _)) = lengths.iter().find(|(tag, length)| *length > 0 && !needed.contains(tag)) {
            return invalid(*tag, format!("the encoding {:?} has no such section", self.encoding));
        }
        let has = |tag| needed.contains(&tag);
        if has(tags::RAW) {
            self.validate_raw()?;
        }
        if has(tags::TABLES) {
            self.validate_codes()?;
        }
        if has(tags::SCALES) {
            self.validate_harmonics()?;
        }
        if has(tags::MEMBERS) { self.validate_references() } else { Ok(()) }
    }

    fn validate_numbers(&self) -> Result<()> {
        let fail = |reason: String| invalid(tags::NUMBERS, reason);
        in_range(tags::NUMBERS, "a shell", &self.shells, 0.0)?;
        if self.shells.first() != Some(&0.0) || self.shells.windows(2).any(|pair| pair[0] >= pair[1]) {
            return fail("the shells do not ascend from 0".to_owned());
        }
        if !(1..=MOST_LIGHTS).contains(&self.lights()) {
            return fail(format!("{} lights: from 1 to {MOST_LIGHTS} are possible", self.lights()));
        }
        let vectors = self.planes == VECTOR_PLANES
            && self.shells.len() == 1
            && matches!(self.encoding, Encoding::Raw | Encoding::Codes);
        if usize::from(self.planes) != CHANNELS && !vectors {
            return fail(format!("{} planes: 3, or 9 for values of parallel light", self.planes));
        }
        let orders = match self.encoding {
            Encoding::Raw | Encoding::Codes => 0..=0,
            Encoding::Harmonics | Encoding::References => 1..=MOST_ORDER,
        };
        if !orders.contains(&self.order) {
            return fail(format!("harmonics of order {} in the encoding {:?}", self.order, self.encoding));
        }
        Ok(())
    }

    fn validate_raw(&self) -> Result<()> {
        let row = self.lights() * usize::from(self.planes);
        if !self.raw.len().is_multiple_of(row) {
            return invalid(tags::RAW, format!("{} values are not whole rows of {row}", self.raw.len()));
        }
        match self.raw.iter().position(|value| !value.is_finite()) {
            Some(i) => invalid(tags::RAW, format!("value {i} is not finite")),
            None => Ok(()),
        }
    }

    fn validate_codes(&self) -> Result<()> {
        let planes = usize::from(self.planes);
        same_length(tags::TABLES, "values of tables", self.tables.len(), planes * LEVELS)?;
        let ascending = |table: &[f32]| table.windows(2).all(|pair| pair[0] <= pair[1]);
        if !self.tables.iter().all(|v| v.is_finite()) || !self.tables.chunks(LEVELS).all(ascending) {
            return invalid(tags::TABLES, "a table is not finite and ascending");
        }
        let (rows, columns) = coefficients::shape(tags::CODES, &self.codes)?;
        same_length(tags::CODES, "lights", columns, self.lights())?;
        if !rows.is_multiple_of(planes) {
            return invalid(tags::CODES, format!("{rows} rows are not {planes} for each vertex"));
        }
        Ok(())
    }

    fn validate_harmonics(&self) -> Result<()> {
        same_length(tags::SCALES, "harmonics", self.scales.len(), self.columns())?;
        if let Some(i) = self.scales.iter().position(|v| !(*v > 0.0 && v.is_finite())) {
            return invalid(tags::SCALES, format!("unit {i} is not positive"));
        }
        let (_, columns) = coefficients::shape(tags::HARMONICS, &self.harmonics)?;
        same_length(tags::HARMONICS, "harmonics", columns, self.columns())
    }

    fn validate_references(&self) -> Result<()> {
        let (vertices, columns) = coefficients::shape(tags::MEMBERS, &self.members)?;
        same_length(tags::MEMBERS, "columns", columns, 1)?;
        let (rows, columns) = coefficients::shape(tags::PLACES, &self.places)?;
        same_length(tags::PLACES, "columns", columns, 3)?;
        let (harmonics, _) = coefficients::shape(tags::HARMONICS, &self.harmonics)?;
        same_length(tags::HARMONICS, "vertices between reference points", harmonics, rows)?;
        let (codes, _) = coefficients::shape(tags::CODES, &self.codes)?;
        same_length(tags::PLACES, "vertices that are no reference points", rows + codes / CHANNELS, vertices)
    }

    /// The sections of valid quantised values.
    ///
    /// # Errors
    /// [`crate::FormatError::Invalid`] as [`QuantisedValues::validate`].
    pub fn to_sections(&self) -> Result<Vec<RawSection>> {
        self.validate()?;
        let Self { encoding, directions, ref shells, samples, planes, order, .. } = *self;
        let record = Record { encoding, directions, shells: shells.clone(), samples, planes, order };
        let kind = Kind::Method;
        let section = |&tag: &Tag| match tag {
            tags::NUMBERS => RawSection::from_record(tag, kind, Codec::Zstd, &record),
            tags::RAW => Ok(RawSection::from_rows(tag, kind, Codec::Zstd, &self.raw)),
            tags::TABLES => Ok(RawSection::from_rows(tag, kind, Codec::Zstd, &self.tables)),
            tags::SCALES => Ok(RawSection::from_rows(tag, kind, Codec::Zstd, &self.scales)),
            tags::CODES => Ok(RawSection::from_rows(tag, kind, Codec::Raw, &self.codes)),
            tags::HARMONICS => Ok(RawSection::from_rows(tag, kind, Codec::Raw, &self.harmonics)),
            tags::MEMBERS => Ok(RawSection::from_rows(tag, kind, Codec::Raw, &self.members)),
            _ => Ok(RawSection::from_rows(tag, kind, Codec::Raw, &self.places)),
        };
        encoding.tags().iter().map(section).collect()
    }

    /// Reads the quantised values among the sections of an asset; `None` where there are none. Other sections are
    /// ignored.
    ///
    /// # Errors
    /// [`crate::FormatError::MissingSection`] where only some exist, [`crate::FormatError::Invalid`] where some belong
    /// to another encoding, and any fault of their type or content.
    pub fn from_sections(sections: &[RawSection]) -> Result<Option<Self>> {
        let is_there = |tag: Tag| sections.iter().any(|section| section.tag == tag);
        if !tags::ALL.into_iter().any(is_there) {
            return Ok(None);
        }
        let one = |tag: Tag| match pick(sections, [tag], Kind::Method)? {
            Some([section]) => Ok(section),
            None => Err(crate::error::FormatError::MissingSection { tag }),
        };
        let Record { encoding, directions, shells, samples, planes, order } = one(tags::NUMBERS)?.record()?;
        let mut result = Self { encoding, directions, shells, samples, planes, order, ..Self::default() };
        if let Some(tag) = tags::ALL.into_iter().find(|tag| is_there(*tag) && !encoding.tags().contains(tag)) {
            return invalid(tag, format!("the encoding {encoding:?} has no such section"));
        }
        for &tag in encoding.tags() {
            let section = one(tag)?;
            match tag {
                tags::NUMBERS => {}
                tags::RAW => result.raw = section.rows()?,
                tags::TABLES => result.tables = section.rows()?,
                tags::SCALES => result.scales = section.rows()?,
                tags::CODES => result.codes = section.rows()?,
                tags::HARMONICS => result.harmonics = section.rows()?,
                tags::MEMBERS => result.members = section.rows()?,
                _ => result.places = section.rows()?,
            }
        }
        result.validate()?;
        Ok(Some(result))
    }
}
