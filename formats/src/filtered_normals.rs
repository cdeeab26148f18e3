//! Filtered normals: low-passed normals of the vertices at a ladder of widths, and the openness of the vertices.

use serde::{Deserialize, Serialize};

use crate::asset::{RawSection, pick};
use crate::checks::{self, in_range, invalid, same_length};
use crate::coefficients::{self, NO_ROW};
use crate::error::Result;
use crate::types::{Budget, Codec, Kind};

/// Tags of the filtered normals.
pub mod tags {
    use crate::types::Tag;

    /// Numbers of the filtered normals, a record.
    pub const NUMBERS: Tag = Tag::from_static("fln.rec");
    /// Fields, coded.
    pub const FIELDS: Tag = Tag::from_static("fln.fld");
    /// Openness of each row, u8.
    pub const OPENNESS: Tag = Tag::from_static("fln.opn");

    /// All tags, in the order of the file.
    pub const ALL: [Tag; 3] = [NUMBERS, FIELDS, OPENNESS];
}

/// Largest number of rungs.
pub const MOST_RUNGS: usize = 16;

/// Largest absolute value of a code: fields are vectors of at most unit length, or logarithms.
const MOST_CODE: i16 = 8192;

/// Numbers that apply to all rows.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Numbers {
    /// The width of each rung, mm.
    pub rungs: Vec<f64>,
    /// Columns of each rung: 3, or 4 with the logarithm of a sum.
    pub columns: u8,
    /// Quantiser step of the vectors.
    pub step: f64,
    /// Share of the unfiltered normal.
    pub alpha: f64,
    /// Factor on the widths that materials imply.
    pub width: f64,
    /// Number of samples against which errors are measured.
    pub samples: u32,
}

/// Filtered normals; see `spec/filtered_normals.md`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FilteredNormals {
    /// Numbers that apply to all rows.
    pub numbers: Numbers,
    /// Codes of the fields, `[row][column]`, rung after rung.
    pub codes: Vec<i16>,
    /// Share of the sky visible from each row's vertex, in 1/255.
    pub openness: Vec<u8>,
}

/// Earlier rows that share an edge with each row, ascending.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Earlier {
    offsets: Vec<u32>,
    rows: Vec<u32>,
}

impl Earlier {
    /// The neighbours from triangles over `rows` rows; corners beyond them are left out.
    pub fn new(rows: usize, triangles: impl Iterator<Item = [u32; 3]>) -> Self {
        let mut pairs = Vec::new();
        for [a, b, c] in triangles {
            for (i, j) in [(a, b), (b, c), (c, a)] {
                if i != j && (i.max(j) as usize) < rows {
                    pairs.push((i.max(j), i.min(j)));
                }
            }
        }
        pairs.sort_unstable();
        pairs.dedup();
        let mut earlier = Self { offsets: vec![0; rows + 1], rows: Vec::with_capacity(pairs.len()) };
        for (row, before) in pairs {
            earlier.offsets[row as usize + 1] += 1;
            earlier.rows.push(before);
        }
        for row in 0..rows {
            earlier.offsets[row + 1] += earlier.offsets[row];
        }
        earlier
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.offsets.len().saturating_sub(1)
    }

    fn of(&self, row: usize) -> &[u32] {
        &self.rows[self.offsets[row] as usize..self.offsets[row + 1] as usize]
    }

    /// The last of the earlier neighbours of each row.
    pub(crate) fn last(&self) -> Vec<u32> {
        (0..self.rows()).map(|row| self.of(row).last().copied().unwrap_or(NO_ROW)).collect()
    }

    /// The mean of a column over a row's earlier neighbours, rounded towards minus infinity; 0 without any.
    fn mean(&self, codes: &[i16], columns: usize, row: usize, column: usize) -> i32 {
        let before = self.of(row);
        let sum: i32 = before.iter().map(|b| i32::from(codes[*b as usize * columns + column])).sum();
        if before.is_empty() { 0 } else { (2 * sum + before.len() as i32).div_euclid(2 * before.len() as i32) }
    }

    /// Codes less the means over the earlier neighbours of their rows.
    pub(crate) fn without_means(&self, codes: &[i16], columns: usize) -> Vec<i16> {
        let of = |at: usize| {
            let (row, column) = (at / columns, at % columns);
            (i32::from(codes[at]) - self.mean(codes, columns, row, column)) as i16
        };
        (0..codes.len()).map(of).collect()
    }

    /// The inverse of [`Self::without_means`], as far as codes fit 16 bits.
    pub(crate) fn add_means(&self, codes: &mut [i16], columns: usize) {
        for at in 0..codes.len() {
            let code = i32::from(codes[at]) + self.mean(codes, columns, at / columns, at % columns);
            codes[at] = code.clamp(i32::from(i16::MIN), i32::from(i16::MAX)) as i16;
        }
    }
}

impl FilteredNormals {
    /// Columns of a row.
    pub fn columns(&self) -> usize {
        self.numbers.rungs.len() * usize::from(self.numbers.columns)
    }

    /// Checks everything that [`FilteredNormals::from_sections`] guarantees.
    ///
    /// # Errors
    /// [`crate::FormatError::Invalid`].
    pub fn validate(&self) -> Result<()> {
        let Numbers { rungs, columns, step, alpha, width, samples } = &self.numbers;
        in_range(tags::NUMBERS, "a rung", rungs, f64::MIN_POSITIVE)?;
        in_range(tags::NUMBERS, "a number", &[*step, *alpha, *width], 0.0)?;
        checks::samples(tags::NUMBERS, *samples)?;
        let sound = (1..=MOST_RUNGS).contains(&rungs.len()) && (3..=4).contains(columns) && *samples > 0;
        if !sound || *step <= 0.0 || *step > 1.0 || *width <= 0.0 {
            return invalid(tags::NUMBERS, "numbers out of range");
        }
        same_length(tags::FIELDS, "codes", self.codes.len(), self.openness.len() * self.columns())?;
        match self.codes.iter().find(|code| code.unsigned_abs() > MOST_CODE as u16) {
            Some(code) => invalid(tags::FIELDS, format!("a code of {code}")),
            None => Ok(()),
        }
    }

    /// The sections of valid filtered normals.
    ///
    /// # Errors
    /// [`crate::FormatError::Invalid`] as [`FilteredNormals::validate`], or where `earlier` is of another mesh.
    pub fn to_sections(&self, earlier: &Earlier) -> Result<Vec<RawSection>> {
        self.validate()?;
        let (rows, columns) = (self.openness.len(), self.columns());
        same_length(tags::FIELDS, "rows", rows, earlier.rows())?;
        let rest = earlier.without_means(&self.codes, columns);
        let coded = coefficients::encode(tags::FIELDS, rows, columns, &rest, Some(&earlier.last()))?;
        Ok(vec![
            RawSection::from_record(tags::NUMBERS, Kind::Method, Codec::Raw, &self.numbers)?,
            RawSection::from_rows(tags::FIELDS, Kind::Method, Codec::Raw, &coded),
            RawSection::from_rows(tags::OPENNESS, Kind::Method, Codec::Zstd, &self.openness),
        ])
    }

    /// Reads the filtered normals among the sections of an asset; `None` where there are none. Other sections are
    /// ignored.
    ///
    /// # Errors
    /// Any fault of their type or content.
    pub fn from_sections(sections: &[RawSection], earlier: &Earlier, budget: Budget) -> Result<Option<Self>> {
        let Some([numbers, fields, openness]) = pick(sections, tags::ALL, Kind::Method)? else { return Ok(None) };
        let (numbers, openness): (Numbers, Vec<u8>) = (numbers.record()?, openness.rows()?);
        let bytes: Vec<u8> = fields.rows()?;
        same_length(tags::OPENNESS, "rows", openness.len(), earlier.rows())?;
        let (rows, columns) = coefficients::shape(tags::FIELDS, &bytes)?;
        let mut result = Self { numbers, codes: Vec::new(), openness };
        if rows != earlier.rows() || columns != result.columns() {
            return invalid(tags::FIELDS, format!("{rows} rows of {columns} columns"));
        }
        let mut codes = coefficients::decode(tags::FIELDS, &bytes, Some(&earlier.last()), budget)?.values;
        earlier.add_means(&mut codes, columns);
        result.codes = codes;
        result.validate()?;
        Ok(Some(result))
    }
}
