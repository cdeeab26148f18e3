//! Calibrated kernels: two radial functions of each part and channel, and one factor a point.

use serde::{Deserialize, Serialize};

use crate::asset::{RawSection, pick};
use crate::checks::{in_range, invalid, same_length};
use crate::coefficients;
use crate::error::Result;
use crate::filtered_normals::Earlier;
use crate::types::{Budget, Codec, Kind};

/// Tags of a calibration.
pub mod tags {
    use crate::types::Tag;

    /// Numbers of the calibration, a record.
    pub const NUMBERS: Tag = Tag::from_static("cal.rec");
    /// Factors of the points, coded.
    pub const FACTORS: Tag = Tag::from_static("cal.fac");

    /// All tags, in the order of the file.
    pub const ALL: [Tag; 2] = [NUMBERS, FACTORS];
}

/// Largest number of intervals between knots.
const MOST_INTERVALS: u32 = 256;

/// Functions of a cubic spline beside its intervals.
const DEGREE: usize = 3;

/// Channels of a factor.
const CHANNELS: usize = 3;

/// Largest absolute value of a code.
const MOST_CODE: u16 = 8192;

/// Two radial functions as cubic B-splines of the logarithm of the distance.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Layers {
    /// The distance at which the splines start, mm.
    pub first_mm: f64,
    /// Factor between the distances of two knots.
    pub ratio: f64,
    /// Number of intervals between knots.
    pub intervals: u32,
    /// Coefficients of the single layer over the dipole, three more than intervals.
    pub single: Vec<f64>,
    /// Coefficients of the double layer over the dipole, as many.
    pub double: Vec<f64>,
}

/// What walks through one part told.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Part {
    /// Layers of each channel.
    pub layers: [Layers; CHANNELS],
    /// Photons of each channel.
    pub photons: [u64; CHANNELS],
}

/// Numbers of a calibration.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Numbers {
    /// Photons that were asked for, of each channel of a part.
    pub photons: u64,
    /// Scattering events of a channel at most.
    pub collisions: u64,
    /// Seed of the walks.
    pub seed: u64,
    /// The least number of scattering events of the light that the kernels hold, 1 or 2.
    pub from_order: u8,
    /// Diagonal of the mesh that was calibrated, mm.
    pub diagonal_mm: f64,
    /// Quantiser step of the logarithms of the factors.
    pub step: f64,
    /// Each part; none for those that keep their dipole.
    pub parts: Vec<Option<Part>>,
}

/// A calibration; see `spec/calibration.md`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Calibration {
    /// Numbers of the whole.
    pub numbers: Numbers,
    /// Codes of the factors, `[point][channel]`.
    pub codes: Vec<i16>,
}

impl Layers {
    fn validate(&self) -> Result<()> {
        let Self { first_mm, ratio, intervals, single, double } = self;
        let functions = *intervals as usize + DEGREE;
        let sound = *first_mm > 0.0 && *ratio > 1.0 && (1..=MOST_INTERVALS).contains(intervals);
        if !(sound && first_mm.is_finite() && ratio.is_finite()) {
            return invalid(tags::NUMBERS, "knots out of range");
        }
        for coefficients in [single, double] {
            same_length(tags::NUMBERS, "functions", coefficients.len(), functions)?;
            in_range(tags::NUMBERS, "a coefficient", coefficients, f64::NEG_INFINITY)?;
        }
        Ok(())
    }
}

impl Calibration {
    /// Checks everything that [`Calibration::from_sections`] guarantees.
    ///
    /// # Errors
    /// [`crate::FormatError::Invalid`].
    pub fn validate(&self) -> Result<()> {
        let Numbers { from_order, diagonal_mm, step, parts, .. } = &self.numbers;
        in_range(tags::NUMBERS, "a number", &[*diagonal_mm, *step], f64::MIN_POSITIVE)?;
        if !(1..=2).contains(from_order) || *step > 1.0 {
            return invalid(tags::NUMBERS, "numbers out of range");
        }
        parts.iter().flatten().flat_map(|part| &part.layers).try_for_each(Layers::validate)?;
        match self.codes.iter().find(|code| code.unsigned_abs() > MOST_CODE) {
            Some(code) => invalid(tags::FACTORS, format!("a code of {code}")),
            None if !self.codes.len().is_multiple_of(CHANNELS) => {
                invalid(tags::FACTORS, "a point without all channels")
            }
            None => Ok(()),
        }
    }

    /// The sections of a valid calibration; `earlier` are the neighbours of its points.
    ///
    /// # Errors
    /// [`crate::FormatError::Invalid`] as [`Calibration::validate`], or where `earlier` is of other points.
    pub fn to_sections(&self, earlier: &Earlier) -> Result<Vec<RawSection>> {
        self.validate()?;
        let rows = self.codes.len() / CHANNELS;
        same_length(tags::FACTORS, "points", rows, earlier.rows())?;
        let rest = earlier.without_means(&self.codes, CHANNELS);
        let coded = coefficients::encode(tags::FACTORS, rows, CHANNELS, &rest, Some(&earlier.last()))?;
        Ok(vec![
            RawSection::from_record(tags::NUMBERS, Kind::Method, Codec::Zstd, &self.numbers)?,
            RawSection::from_rows(tags::FACTORS, Kind::Method, Codec::Raw, &coded),
        ])
    }

    /// Reads the calibration among the sections of an asset; `None` where there is none. Other sections are ignored.
    ///
    /// # Errors
    /// Any fault of their type or content.
    pub fn from_sections(sections: &[RawSection], earlier: &Earlier, budget: Budget) -> Result<Option<Self>> {
        let Some([numbers, factors]) = pick(sections, tags::ALL, Kind::Method)? else { return Ok(None) };
        let (numbers, bytes): (Numbers, Vec<u8>) = (numbers.record()?, factors.rows()?);
        let (rows, columns) = coefficients::shape(tags::FACTORS, &bytes)?;
        if rows != earlier.rows() || columns != CHANNELS {
            return invalid(tags::FACTORS, format!("{rows} rows of {columns} for {} points", earlier.rows()));
        }
        let mut codes = coefficients::decode(tags::FACTORS, &bytes, Some(&earlier.last()), budget)?.values;
        earlier.add_means(&mut codes, CHANNELS);
        let result = Self { numbers, codes };
        result.validate()?;
        Ok(Some(result))
    }

    /// True if there are factors: assets that hold transport have them in that.
    pub fn is_kept(sections: &[RawSection]) -> bool {
        sections.iter().any(|section| section.tag == tags::FACTORS)
    }

    /// The numbers alone; `None` where there is no calibration.
    ///
    /// # Errors
    /// Any fault of their type or content.
    pub fn numbers(sections: &[RawSection]) -> Result<Option<Numbers>> {
        let Some([numbers]) = pick(sections, [tags::NUMBERS], Kind::Method)? else { return Ok(None) };
        let result = Self { numbers: numbers.record()?, codes: Vec::new() };
        result.validate()?;
        Ok(Some(result.numbers))
    }
}
