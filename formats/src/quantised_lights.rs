//! Transport of a quantised set of lights: coefficients at reference points over a basis of functions of the lights.

use serde::{Deserialize, Serialize};

use crate::asset::{RawSection, pick};
use crate::checks::{in_range, invalid, same_length, samples};
use crate::coefficients;
use crate::error::{FormatError, Result};
use crate::types::{Codec, Kind, Tag};

/// Tags of the quantised lights.
pub mod tags {
    use crate::types::Tag;

    /// Numbers of the quantised lights, a record.
    pub const NUMBERS: Tag = Tag::from_static("qlt.rec");

    /// Tags of a set.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub struct Set {
        /// Unit of each direction, f32.
        pub units: Tag,
        /// Step of each basis function, f32.
        pub basis_steps: Tag,
        /// Basis, coded coefficients.
        pub basis: Tag,
        /// Function and plane of each column, u16.
        pub columns: Tag,
        /// Coefficients of the reference points, coded.
        pub coefficients: Tag,
    }

    /// Tags of the sets: parallel light, and lights at a distance.
    pub const SETS: [Set; 2] = [
        Set {
            units: Tag::from_static("qlt.uni"),
            basis_steps: Tag::from_static("qlt.stp"),
            basis: Tag::from_static("qlt.bas"),
            columns: Tag::from_static("qlt.col"),
            coefficients: Tag::from_static("qlt.cof"),
        },
        Set {
            units: Tag::from_static("qln.uni"),
            basis_steps: Tag::from_static("qln.stp"),
            basis: Tag::from_static("qln.bas"),
            columns: Tag::from_static("qln.col"),
            coefficients: Tag::from_static("qln.cof"),
        },
    ];

    impl Set {
        /// All tags of the set, in the order of the file.
        pub const fn all(self) -> [Tag; 5] {
            [self.units, self.basis_steps, self.basis, self.columns, self.coefficients]
        }
    }
}

/// Largest number of quantised lights.
pub const MOST_LIGHTS: usize = 1 << 20;

/// Radiosity of the reference points under the lights of some shells.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Set {
    /// Matrix from decorrelated planes to channels: a row for each plane, a column for each channel and, within a
    /// channel, each shell.
    pub channels: Vec<f64>,
    /// Quantiser step of the coefficients.
    pub step: f32,
    /// Unit of each direction, by which its radiosity is divided.
    pub units: Vec<f32>,
    /// Quantiser step of each basis function.
    pub basis_steps: Vec<f32>,
    /// Coded basis, `[direction][function]`, as [`coefficients::encode`] writes it.
    pub basis: Vec<u8>,
    /// Function and plane of each column of coefficients: function times the number of planes plus plane.
    pub columns: Vec<u16>,
    /// Coded coefficients, `[reference point][column]`, as [`coefficients::encode`] writes them.
    pub coefficients: Vec<u8>,
}

/// Transport of a quantised set of lights. See `spec/projected.md`, "Quantised lights".
#[derive(Clone, Debug, Default, PartialEq)]
pub struct QuantisedLights {
    /// Number of directions of the spherical Fibonacci lattice.
    pub directions: u32,
    /// Radius of the scene over the distance of each shell of lights, ascending from 0.
    pub shells: Vec<f64>,
    /// Spacing of the reference points, mm.
    pub spacing_mm: f64,
    /// Spacing of the coarsest to finest directions that predict each other, on the unit sphere.
    pub direction_spacing: f64,
    /// Number of samples that the transport was computed from.
    pub samples: u32,
    /// Set of parallel light; then, where there are several shells, the set of the others.
    pub sets: Vec<Set>,
}

/// Content of the record.
#[derive(Serialize, Deserialize)]
struct Record {
    directions: u32,
    shells: Vec<f64>,
    spacing_mm: f64,
    direction_spacing: f64,
    samples: u32,
    channels: Vec<Vec<f64>>,
    steps: Vec<f32>,
}

impl Set {
    /// Sections of the arrays; the matrix and the step belong in a record.
    pub(crate) fn arrays(&self, tags: tags::Set) -> [RawSection; 5] {
        let (kind, zstd) = (Kind::Method, Codec::Zstd);
        [
            RawSection::from_rows(tags.units, kind, zstd, &self.units),
            RawSection::from_rows(tags.basis_steps, kind, zstd, &self.basis_steps),
            RawSection::from_rows(tags.basis, kind, Codec::Raw, &self.basis),
            RawSection::from_rows(tags.columns, kind, zstd, &self.columns),
            RawSection::from_rows(tags.coefficients, kind, Codec::Raw, &self.coefficients),
        ]
    }

    /// A set from its arrays, without the numbers of the record; `None` where there are none.
    pub(crate) fn from_arrays(sections: &[RawSection], tags: tags::Set) -> Result<Option<Self>> {
        let Some([units, steps, basis, columns, values]) = pick(sections, tags.all(), Kind::Method)? else {
            return Ok(None);
        };
        Ok(Some(Self {
            units: units.rows()?,
            basis_steps: steps.rows()?,
            basis: basis.rows()?,
            columns: columns.rows()?,
            coefficients: values.rows()?,
            ..Self::default()
        }))
    }

    pub(crate) fn validate(&self, (numbers, tags): (Tag, tags::Set), directions: usize, shells: usize) -> Result<()> {
        in_range(numbers, "a channel", &self.channels, f64::NEG_INFINITY)?;
        let planes = 3 * shells;
        same_length(numbers, "numbers of the channels", self.channels.len(), planes * planes)?;
        let positive = |tag, what: &str, values: &[f32]| match values.iter().position(|v| !(*v > 0.0 && v.is_finite()))
        {
            Some(i) => invalid(tag, format!("{what} {i} is not positive")),
            None => Ok(()),
        };
        positive(numbers, "step", &[self.step])?;
        positive(tags.units, "unit", &self.units)?;
        positive(tags.basis_steps, "step", &self.basis_steps)?;
        same_length(tags.units, "directions", self.units.len(), directions)?;
        let functions = self.basis_steps.len();
        let shape = coefficients::shape(tags.basis, &self.basis)?;
        if shape != (directions, functions) {
            let (rows, columns) = shape;
            return invalid(
                tags.basis,
                format!("{rows} rows of {columns} for {directions} directions and {functions} functions"),
            );
        }
        let (_, columns) = coefficients::shape(tags.coefficients, &self.coefficients)?;
        same_length(tags.columns, "columns", self.columns.len(), columns)?;
        let mut seen = vec![false; planes * functions];
        for &column in &self.columns {
            match seen.get_mut(usize::from(column)) {
                Some(seen) if !*seen => *seen = true,
                _ => return invalid(tags.columns, format!("column {column} is there twice or has no function")),
            }
        }
        Ok(())
    }
}

impl QuantisedLights {
    /// Number of lights.
    pub fn lights(&self) -> usize {
        self.directions as usize * self.shells.len()
    }

    /// Checks every length and range that [`QuantisedLights::from_sections`] guarantees; of coded bytes, only the
    /// shapes.
    ///
    /// # Errors
    /// [`crate::FormatError::Invalid`] with the tag of the section at fault.
    pub fn validate(&self) -> Result<()> {
        in_range(tags::NUMBERS, "a spacing", &[self.spacing_mm, self.direction_spacing], 0.0)?;
        samples(tags::NUMBERS, self.samples)?;
        in_range(tags::NUMBERS, "a shell", &self.shells, 0.0)?;
        if self.shells.first() != Some(&0.0) || self.shells.windows(2).any(|pair| pair[0] >= pair[1]) {
            return invalid(tags::NUMBERS, "the shells do not ascend from 0");
        }
        if !(1..=MOST_LIGHTS).contains(&self.lights()) {
            return invalid(tags::NUMBERS, format!("{} lights: from 1 to {MOST_LIGHTS} are possible", self.lights()));
        }
        let shells = shells_of_sets(self.shells.len());
        same_length(tags::NUMBERS, "sets", self.sets.len(), shells.len())?;
        for ((set, own), shells) in self.sets.iter().zip(tags::SETS).zip(shells) {
            set.validate((tags::NUMBERS, own), self.directions as usize, shells)?;
        }
        Ok(())
    }

    /// The sections of valid quantised lights.
    ///
    /// # Errors
    /// [`crate::FormatError::Invalid`] as [`QuantisedLights::validate`].
    pub fn to_sections(&self) -> Result<Vec<RawSection>> {
        self.validate()?;
        let record = Record {
            directions: self.directions,
            shells: self.shells.clone(),
            spacing_mm: self.spacing_mm,
            direction_spacing: self.direction_spacing,
            samples: self.samples,
            channels: self.sets.iter().map(|set| set.channels.clone()).collect(),
            steps: self.sets.iter().map(|set| set.step).collect(),
        };
        let (kind, zstd) = (Kind::Method, Codec::Zstd);
        let mut sections = vec![RawSection::from_record(tags::NUMBERS, kind, zstd, &record)?];
        for (set, tags) in self.sets.iter().zip(tags::SETS) {
            sections.extend(set.arrays(tags));
        }
        Ok(sections)
    }

    /// Reads the quantised lights among the sections of an asset; `None` where there are none. Other sections are
    /// ignored.
    ///
    /// # Errors
    /// [`crate::FormatError::MissingSection`] where only some exist, and any fault of their type or content.
    pub fn from_sections(sections: &[RawSection]) -> Result<Option<Self>> {
        let numbers = pick(sections, [tags::NUMBERS], Kind::Method)?;
        let mut sets = Vec::with_capacity(tags::SETS.len());
        for tags in tags::SETS {
            sets.extend(Set::from_arrays(sections, tags)?);
        }
        let Some([numbers]) = numbers else {
            return if sets.is_empty() { Ok(None) } else { Err(FormatError::MissingSection { tag: tags::NUMBERS }) };
        };
        let Record { directions, shells, spacing_mm, direction_spacing, samples, channels, steps } =
            numbers.record()?;
        if let Some(missing) = tags::SETS.get(sets.len()..shells_of_sets(shells.len()).len()).and_then(<[_]>::first) {
            return Err(FormatError::MissingSection { tag: missing.units });
        }
        same_length(tags::NUMBERS, "channels of sets", channels.len(), sets.len())?;
        same_length(tags::NUMBERS, "steps of sets", steps.len(), sets.len())?;
        for ((set, channels), step) in sets.iter_mut().zip(channels).zip(steps) {
            (set.channels, set.step) = (channels, step);
        }
        let result = Self { directions, shells, spacing_mm, direction_spacing, samples, sets };
        result.validate()?;
        Ok(Some(result))
    }
}

/// Number of shells of each set.
fn shells_of_sets(shells: usize) -> Vec<usize> {
    if shells > 1 { vec![1, shells - 1] } else { vec![1] }
}
