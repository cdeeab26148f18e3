//! Everything that is wrong with an asset, as numbered findings.

use std::fmt;
use std::path::{Path, PathBuf};

use serde::Serialize;
use translux_format::{FormatError, Scan};

use super::findings::{self, CATALOGUE, Finding, Severity};
use super::opened;
use super::text::table;
use crate::error::{Error, Result};
use crate::evaluate::Registry;
use crate::evaluate::memory::Limits;
use crate::progress::{Progress, stage};

/// The findings about an asset.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Validation {
    /// The asset's file.
    #[serde(serialize_with = "super::path")]
    #[cfg_attr(test, schemars(with = "String"))]
    pub asset: PathBuf,
    /// Length of the file.
    pub bytes: usize,
    /// Version of the format; none where the file is too short to have one.
    pub format_version: Option<String>,
    /// Sections that the directory lists.
    pub sections: usize,
    /// Findings that are errors: the asset is not valid.
    pub errors: usize,
    /// Findings that are warnings.
    pub finding_warnings: usize,
    /// Findings, those about the bytes first.
    pub findings: Vec<Finding>,
}

/// Validates a file; methods and forms that are not in the registry are findings, as is what the budget does not allow to decode.
///
/// # Errors
/// I/O; anything else that is wrong is a finding.
pub fn validate(path: &Path, registry: &Registry, limits: Limits<'_>, progress: &dyn Progress) -> Result<Validation> {
    let bytes = std::fs::read(path).map_err(|e| Error::io(path, &e))?;
    examine(path, &bytes, (registry, limits), progress)
}

/// Validates the bytes of a file; the path is for the report.
///
/// # Errors
/// Run time: an evaluator that the limits do not admit.
pub fn examine(
    path: &Path,
    bytes: &[u8],
    (registry, limits): (&Registry, Limits<'_>),
    progress: &dyn Progress,
) -> Result<Validation> {
    let scan = stage(progress, "read", || translux_format::scan(bytes, limits.budget));
    let format_version = scan.version.map(|(major, minor)| format!("{major}.{minor}"));
    let sections = scan.sections.len();
    let findings = stage(progress, "check", || find(scan, bytes, (registry, limits)))?;
    let count = |severity| findings.iter().filter(|finding| finding.severity == severity).count();
    Ok(Validation {
        asset: path.to_owned(),
        bytes: bytes.len(),
        format_version,
        sections,
        errors: count(Severity::Error),
        finding_warnings: count(Severity::Warning),
        findings,
    })
}

fn find(scan: Scan, bytes: &[u8], (registry, limits): (&Registry, Limits<'_>)) -> Result<Vec<Finding>> {
    let mut out: Vec<Finding> = scan.errors.iter().map(Finding::of_format).collect();
    out.extend(findings::of_version(&scan, registry));
    out.extend(findings::of_geometry(&scan, registry));
    out.extend(findings::of_provenance(&scan, registry));
    match findings::of_method_sections(&scan) {
        Ok(found) => out.extend(found),
        Err(errors) => out.extend(errors.iter().map(Finding::of_format)),
    }
    // What was scanned goes before the asset is decoded once more.
    let provenance = scan.provenance.filter(|_| !out.iter().any(|finding| finding.severity == Severity::Error));
    if let Some(provenance) = provenance {
        out.extend(opened::of_opening(&provenance, bytes, (registry, limits))?);
    }
    Ok(out)
}

/// The catalogue of findings as text.
pub fn catalogue() -> String {
    let row = |kind: &findings::FindingKind| {
        let number = kind.number.to_string();
        [number, kind.severity.name().to_owned(), kind.name.to_owned(), kind.meaning.to_owned()]
    };
    let rows: Vec<[String; 4]> = CATALOGUE.iter().map(row).collect();
    let last = FormatError::NAMES.len();
    format!(
        "Findings 1 to {last} are errors of the bytes; the format's SPEC.md lists them. The others:\n{}\n\
         Errors end the command with 3; warnings with 6 where --strict is given.",
        table(&rows)
    )
}

impl fmt::Display for Validation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for Finding { number, name, severity, message, .. } in &self.findings {
            writeln!(f, "{} {number} {name}: {message}", severity.name())?;
        }
        let verdict = if self.errors == 0 { "valid" } else { "not valid" };
        let (path, errors, warnings) = (self.asset.display(), self.errors, self.finding_warnings);
        write!(f, "{path}: {verdict}; {errors} errors, {warnings} warnings")
    }
}
