//! A scan of a whole file: all of its faults, and all content that can be read nevertheless.

use std::collections::BTreeSet;

use crate::asset::{AssetFile, COMMON_TAGS, RawSection};
use crate::container::SectionInfo;
use crate::error::{FormatError, Result};
use crate::mesh::Mesh;
use crate::metadata::{self, LedgerEntry, Provenance};
use crate::parts::Parts;
use crate::reader::Reader;
use crate::sample_rule;
use crate::samples::{self, Samples};
use crate::types::{Budget, Tag};

/// Result of a scan. Without errors the file is exactly one that [`AssetFile::from_bytes`] accepts, and every component
/// is present.
#[derive(Clone, Debug, Default)]
pub struct Scan {
    /// All faults, roughly in the order of the file. An error may be the consequence of another one.
    pub errors: Vec<FormatError>,
    /// Major and minor version, where the header could be read.
    pub version: Option<(u16, u16)>,
    /// The sections with a place in the file.
    pub sections: Vec<SectionInfo>,
    /// The mesh, if it is valid.
    pub mesh: Option<Mesh>,
    /// Parts and media, if valid.
    pub parts: Option<Parts>,
    /// Samples, if valid.
    pub samples: Option<Samples>,
    /// Provenance, if valid.
    pub provenance: Option<Provenance>,
    /// The ledger, if valid.
    pub ledger: Option<Vec<LedgerEntry>>,
    /// The sections without a type in this crate that decode.
    pub extra: Vec<RawSection>,
}

/// Scans every section of a file, whatever the faults of others. Takes at most the memory of `budget`.
pub fn scan(bytes: &[u8], budget: Budget) -> Scan {
    let first = match AssetFile::from_bytes(bytes, budget) {
        Ok(asset) => return Scan::of(asset, bytes, budget),
        Err(error) => error,
    };
    let mut scan = Scan::default();
    let mut keep = |error| {
        scan.errors.push(error);
        Ok(())
    };
    match Reader::parse_with(bytes, budget, &mut keep) {
        Ok(reader) => scan.read(reader, budget),
        Err(error) => scan.errors.push(error),
    }
    // A section that does not decode is none to what would have found another fault in its entry.
    if !scan.errors.contains(&first) {
        scan.errors.insert(0, first);
    }
    scan
}

impl Scan {
    /// The scan of the file that has this asset.
    fn of(asset: AssetFile, bytes: &[u8], budget: Budget) -> Self {
        let AssetFile { mesh, parts, samples, samples_stored: _, provenance, ledger, extra } = asset;
        let reader = Reader::parse(bytes, budget);
        Self {
            errors: Vec::new(),
            version: reader.as_ref().ok().map(Reader::version),
            sections: reader.map_or_else(|_| Vec::new(), |reader| reader.sections().to_vec()),
            mesh: Some(mesh),
            parts: Some(parts),
            samples: Some(samples),
            provenance: Some(provenance),
            ledger: Some(ledger),
            extra,
        }
    }

    fn read(&mut self, reader: Reader<'_>, budget: Budget) {
        self.version = Some(reader.version());
        self.sections = reader.sections().to_vec();
        let mut damaged = BTreeSet::new();
        for info in self.sections.clone() {
            if COMMON_TAGS.contains(&info.tag) {
                if let Err(error) = reader.check(&info) {
                    damaged.insert(info.tag);
                    self.errors.push(error);
                }
            } else {
                match RawSection::read(&reader, &info) {
                    Ok(section) => self.extra.push(section),
                    Err(error) => self.errors.push(error),
                }
            }
        }
        let reader = reader.keeping(|info| !damaged.contains(&info.tag));
        damaged.extend(self.errors.iter().filter_map(FormatError::tag));
        self.mesh = self.component(&damaged, Mesh::decode(&reader));
        self.parts = self.component(&damaged, Parts::decode(&reader));
        self.fit_parts();
        let none = (Mesh::default(), Parts::default());
        let (mesh, parts) = (self.mesh.as_ref().unwrap_or(&none.0), self.parts.as_ref().unwrap_or(&none.1));
        // Where there is nothing to make samples from, that is the fault.
        if reader.find(samples::tags::RULE).is_none() || (self.mesh.is_some() && self.parts.is_some()) {
            let decoded = sample_rule::decode(&reader, (mesh, parts), budget);
            self.samples = self.component(&damaged, decoded);
        }
        self.provenance = self.component(&damaged, metadata::provenance(&reader));
        self.ledger = self.component(&damaged, metadata::ledger(&reader));
        self.fit_samples();
    }

    /// Records a component or its error; that a damaged section is missing is not reported again.
    fn component<T>(&mut self, damaged: &BTreeSet<Tag>, component: Result<T>) -> Option<T> {
        match component {
            Ok(component) => return Some(component),
            Err(FormatError::MissingSection { tag }) if damaged.contains(&tag) => {}
            Err(error) => self.errors.push(error),
        }
        None
    }

    /// Removes parts that do not fit the mesh.
    fn fit_parts(&mut self) {
        if let (Some(mesh), Some(parts)) = (&self.mesh, &self.parts)
            && let Err(error) = parts.validate_against(mesh.triangles.len())
        {
            self.errors.push(error);
            self.parts = None;
        }
    }

    /// Removes samples that do not fit the parts.
    fn fit_samples(&mut self) {
        if let (Some(parts), Some(samples)) = (&self.parts, &self.samples)
            && let Err(error) = samples.validate_against(&parts.triangle_part, parts.parts.len())
        {
            self.errors.push(error);
            self.samples = None;
        }
    }

    /// The whole asset, where there are no errors.
    pub fn into_asset(self) -> Option<AssetFile> {
        let Self { errors, sections, mesh, parts, samples, provenance, ledger, extra, .. } = self;
        if !errors.is_empty() {
            return None;
        }
        let samples_stored = sections.iter().any(|info| info.tag == samples::tags::FACETS);
        Some(AssetFile {
            mesh: mesh?,
            parts: parts?,
            samples: samples?,
            samples_stored,
            provenance: provenance?,
            ledger: ledger?,
            extra,
        })
    }
}
