//! Provenance of an asset, and the error that each lossy stage added.

use serde::{Deserialize, Serialize};

use crate::checks::{in_range, invalid, same_length, text};
use crate::error::Result;
use crate::reader::Reader;
use crate::types::{Codec, Element, Kind};
use crate::writer::Writer;

/// Tags of the metadata.
pub mod tags {
    use crate::types::Tag;

    /// Provenance, a record.
    pub const PROVENANCE: Tag = Tag::from_static("meta.src");
    /// Error ledger, a record.
    pub const LEDGER: Tag = Tag::from_static("meta.err");
    /// Dark error of each entry of the ledger, f64; left out where all are 0.
    pub const DARK: Tag = Tag::from_static("meta.drk");
    /// Name of the form of the transport, a record.
    pub const FORM: Tag = Tag::from_static("form.nam");
    /// Settings of that form, a record.
    pub const SETTINGS: Tag = Tag::from_static("form.set");
}

/// A file that the asset was made from.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct InputRecord {
    /// File name without any path.
    pub name: String,
    /// BLAKE3 hash of the content.
    pub blake3: [u8; 32],
    /// Length in bytes.
    pub bytes: u64,
}

/// Everything that fixes the content of an asset. No time, no path, no version of a program that does not change
/// results.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Provenance {
    /// Revision of the algorithms, raised whenever the same input and settings give a different result.
    pub algorithm_revision: u32,
    /// Name of the method.
    pub method: String,
    /// Resolved settings, sorted by key, no key twice.
    pub settings: Vec<(String, String)>,
    /// Seed of all random numbers.
    pub seed: u64,
    /// The files that were read.
    pub inputs: Vec<InputRecord>,
    /// The unit of the source as the user stated it or its format defines it.
    pub source_unit: String,
    /// Millimetres of one unit of the source, finite and above 0.
    pub mm_per_source_unit: f64,
    /// Repairs and warnings, one line each.
    pub notes: Vec<String>,
}

impl Default for Provenance {
    fn default() -> Self {
        Self {
            algorithm_revision: 0,
            method: String::new(),
            settings: Vec::new(),
            seed: 0,
            inputs: Vec::new(),
            source_unit: String::new(),
            mm_per_source_unit: 1.0,
            notes: Vec::new(),
        }
    }
}

impl Provenance {
    /// Checks lengths, the order of the settings, the names of the inputs and the scale.
    ///
    /// # Errors
    /// [`crate::FormatError::Invalid`].
    pub fn validate(&self) -> Result<()> {
        let tag = tags::PROVENANCE;
        text(tag, "the method", &self.method)?;
        text(tag, "the source unit", &self.source_unit)?;
        for (key, value) in &self.settings {
            text(tag, "the key of a setting", key)?;
            text(tag, "the value of a setting", value)?;
        }
        if let Some(i) = self.settings.windows(2).position(|pair| pair[0].0 >= pair[1].0) {
            return invalid(tag, format!("setting {} is out of order or there twice", i + 1));
        }
        for (i, input) in self.inputs.iter().enumerate() {
            text(tag, "the name of an input", &input.name)?;
            if input.name.is_empty() || input.name.contains(['/', '\\', '\0']) {
                return invalid(tag, format!("input {i} is not a file name without a path"));
            }
        }
        self.notes.iter().try_for_each(|note| text(tag, "a note", note))?;
        if !(self.mm_per_source_unit.is_finite() && self.mm_per_source_unit > 0.0) {
            let scale = self.mm_per_source_unit;
            return invalid(tag, format!("{scale} mm in a unit of the source: it must be finite and above 0"));
        }
        Ok(())
    }
}

/// The error that one lossy stage added to radiosity, relative to the reference's RMS (floored per channel).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LedgerEntry {
    /// Name of the stage.
    pub stage: String,
    /// Area-weighted RMS, at least 0.
    pub relative_rms: f64,
    /// Mean, of either sign.
    pub relative_bias: f64,
    /// 99.9th percentile over vertices, at least 0.
    pub p999: f64,
    /// Worst vertex, at least 0.
    pub worst: f64,
    /// RMS over the vertices below a tenth of the mean, relative to the mean there, at least 0; 0 in files of version
    /// 0.1, which lack it.
    #[serde(skip)]
    pub dark: f64,
    /// Method by which the error was measured or bounded, in words.
    pub note: String,
}

impl LedgerEntry {
    /// Checks lengths and ranges.
    ///
    /// # Errors
    /// [`crate::FormatError::Invalid`].
    pub fn validate(&self) -> Result<()> {
        let tag = tags::LEDGER;
        text(tag, "the name of a stage", &self.stage)?;
        text(tag, "a note", &self.note)?;
        in_range(tag, "an error", &[self.relative_rms, self.p999, self.worst, self.dark], 0.0)?;
        in_range(tag, "a bias", &[self.relative_bias], f64::NEG_INFINITY)
    }
}

/// Reads the provenance and validates it.
///
/// # Errors
/// The section is missing, damaged, of another type, or its content is not valid.
pub fn provenance(reader: &Reader<'_>) -> Result<Provenance> {
    let provenance: Provenance = reader.record_of(tags::PROVENANCE, Kind::Metadata)?;
    provenance.validate()?;
    Ok(provenance)
}

/// Reads the ledger and validates it.
///
/// # Errors
/// As [`provenance`].
pub fn ledger(reader: &Reader<'_>) -> Result<Vec<LedgerEntry>> {
    let mut ledger: Vec<LedgerEntry> = reader.record_of(tags::LEDGER, Kind::Metadata)?;
    if reader.find(tags::DARK).is_some() {
        let dark: Vec<f64> = reader.array_of(tags::DARK, Kind::Metadata)?;
        same_length(tags::DARK, "entries of the ledger", dark.len(), ledger.len())?;
        in_range(tags::DARK, "an error", &dark, 0.0)?;
        ledger.iter_mut().zip(dark).for_each(|(entry, dark)| entry.dark = dark);
    }
    ledger.iter().try_for_each(LedgerEntry::validate)?;
    Ok(ledger)
}

/// Adds the ledger to a file.
pub(crate) fn add_ledger(ledger: &[LedgerEntry], writer: &mut Writer<'_>) -> Result<()> {
    ledger.iter().try_for_each(LedgerEntry::validate)?;
    writer.add_record(tags::LEDGER, Kind::Metadata, Codec::Zstd, &ledger)?;
    if ledger.iter().any(|entry| entry.dark != 0.0) {
        let dark: Vec<u8> = ledger.iter().flat_map(|entry| entry.dark.to_le_bytes()).collect();
        writer.add_bytes(tags::DARK, Kind::Metadata, (f64::TYPE, f64::COMPONENTS), Codec::Zstd, dark.into())?;
    }
    Ok(())
}
