//! Transport of a quantised set of lights: coefficients at reference points over a basis of functions of the light.

use serde::{Deserialize, Serialize};

use crate::asset::{RawSection, pick};
use crate::checks::{in_range, invalid, same_length};
use crate::coefficients;
use crate::error::Result;
use crate::types::{Codec, Kind};

/// Tags of the quantised lights.
pub mod tags {
    use crate::types::Tag;

    /// Numbers, a record.
    pub const NUMBERS: Tag = Tag::from_static("qlt.rec");
    /// Unit of each direction, f32.
    pub const UNITS: Tag = Tag::from_static("qlt.uni");
    /// Step of each basis function, f32.
    pub const BASIS_STEPS: Tag = Tag::from_static("qlt.stp");
    /// Basis, coded coefficients.
    pub const BASIS: Tag = Tag::from_static("qlt.bas");
    /// Function of each column, u16.
    pub const COLUMNS: Tag = Tag::from_static("qlt.col");
    /// Coefficients of the reference points, coded.
    pub const COEFFICIENTS: Tag = Tag::from_static("qlt.cof");

    /// All of them, in the order of the file.
    pub const ALL: [Tag; 6] = [NUMBERS, UNITS, BASIS_STEPS, BASIS, COLUMNS, COEFFICIENTS];
}

/// Most quantised lights.
pub const MOST_LIGHTS: usize = 1 << 20;

/// What no reader needs geometry for. See `SPEC.md`, "Quantised lights".
#[derive(Clone, Debug, Default, PartialEq)]
pub struct QuantisedLights {
    /// Directions of the spherical Fibonacci lattice.
    pub directions: u32,
    /// Radius of the scene over the distance of each shell of lights, ascending from 0.
    pub shells: Vec<f64>,
    /// Spacing of the reference points, mm.
    pub spacing_mm: f64,
    /// Spacing of the coarsest to finest directions that predict each other, on the unit sphere.
    pub direction_spacing: f64,
    /// Samples that the transport was computed from.
    pub samples: u32,
    /// Rows: what one of each decorrelated plane is, columns: in each channel and, for a channel, each shell.
    pub channels: Vec<f64>,
    /// Step of the coefficients.
    pub step: f32,
    /// Unit of each direction: what its radiosity is divided by.
    pub units: Vec<f32>,
    /// Step of each basis function.
    pub basis_steps: Vec<f32>,
    /// Basis, `[direction][function]`, as [`coefficients::encode`] writes it.
    pub basis: Vec<u8>,
    /// Of each column of coefficients: function times the number of planes plus plane.
    pub columns: Vec<u16>,
    /// Coefficients, `[reference point][column]`, as [`coefficients::encode`] writes them.
    pub coefficients: Vec<u8>,
}

/// What is no array.
#[derive(Serialize, Deserialize)]
struct Record {
    directions: u32,
    shells: Vec<f64>,
    spacing_mm: f64,
    direction_spacing: f64,
    samples: u32,
    channels: Vec<f64>,
    step: f32,
}

impl QuantisedLights {
    /// Number of lights.
    pub fn lights(&self) -> usize {
        self.directions as usize * self.shells.len()
    }

    /// Checks every length and range, as [`QuantisedLights::from_sections`] guarantees them; coded bytes only as far as their
    /// shapes.
    ///
    /// # Errors
    /// [`crate::FormatError::Invalid`] with the tag of the section at fault.
    pub fn validate(&self) -> Result<()> {
        let finite = |what, values: &[f64]| in_range(tags::NUMBERS, what, values, f64::NEG_INFINITY);
        finite("a channel", &self.channels)?;
        in_range(tags::NUMBERS, "a spacing", &[self.spacing_mm, self.direction_spacing], 0.0)?;
        in_range(tags::NUMBERS, "a shell", &self.shells, 0.0)?;
        if self.shells.first() != Some(&0.0) || self.shells.windows(2).any(|pair| pair[0] >= pair[1]) {
            return invalid(tags::NUMBERS, "the shells do not ascend from 0");
        }
        if !(1..=MOST_LIGHTS).contains(&self.lights()) {
            return invalid(tags::NUMBERS, format!("{} lights: from 1 to {MOST_LIGHTS} are possible", self.lights()));
        }
        let planes = 3 * self.shells.len();
        same_length(tags::NUMBERS, "numbers of the channels", self.channels.len(), planes * planes)?;
        let positive = |tag, what: &str, values: &[f32]| match values.iter().position(|v| !(*v > 0.0 && v.is_finite()))
        {
            Some(i) => invalid(tag, format!("{what} {i} is not positive")),
            None => Ok(()),
        };
        positive(tags::NUMBERS, "step", &[self.step])?;
        positive(tags::UNITS, "unit", &self.units)?;
        positive(tags::BASIS_STEPS, "step", &self.basis_steps)?;
        same_length(tags::UNITS, "directions", self.units.len(), self.directions as usize)?;
        let functions = self.basis_steps.len();
        let shape = coefficients::shape(tags::BASIS, &self.basis)?;
        if shape != (self.directions as usize, functions) {
            let (rows, columns) = shape;
            return invalid(
                tags::BASIS,
                format!("{rows} rows of {columns} for {} directions and {functions} functions", self.directions),
            );
        }
        let (_, columns) = coefficients::shape(tags::COEFFICIENTS, &self.coefficients)?;
        same_length(tags::COLUMNS, "columns", self.columns.len(), columns)?;
        let mut seen = vec![false; planes * functions];
        for &column in &self.columns {
            match seen.get_mut(usize::from(column)) {
                Some(seen) if !*seen => *seen = true,
                _ => return invalid(tags::COLUMNS, format!("column {column} is there twice or has no function")),
            }
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
            channels: self.channels.clone(),
            step: self.step,
        };
        let (kind, zstd) = (Kind::Method, Codec::Zstd);
        Ok(vec![
            RawSection::from_record(tags::NUMBERS, kind, zstd, &record)?,
            RawSection::from_rows(tags::UNITS, kind, zstd, &self.units),
            RawSection::from_rows(tags::BASIS_STEPS, kind, zstd, &self.basis_steps),
            RawSection::from_rows(tags::BASIS, kind, Codec::Raw, &self.basis),
            RawSection::from_rows(tags::COLUMNS, kind, zstd, &self.columns),
            RawSection::from_rows(tags::COEFFICIENTS, kind, Codec::Raw, &self.coefficients),
        ])
    }

    /// Reads them among the sections of an asset; `None` where there are none. Other sections are left alone.
    ///
    /// # Errors
    /// [`crate::FormatError::MissingSection`] where only some are there, and whatever is wrong with their type or content.
    pub fn from_sections(sections: &[RawSection]) -> Result<Option<Self>> {
        let Some([numbers, units, steps, basis, columns, values]) = pick(sections, tags::ALL, Kind::Method)? else {
            return Ok(None);
        };
        let Record { directions, shells, spacing_mm, direction_spacing, samples, channels, step } = numbers.record()?;
        let result = Self {
            directions,
            shells,
            spacing_mm,
            direction_spacing,
            samples,
            channels,
            step,
            units: units.rows()?,
            basis_steps: steps.rows()?,
            basis: basis.rows()?,
            columns: columns.rows()?,
            coefficients: values.rows()?,
        };
        result.validate()?;
        Ok(Some(result))
    }
}
