//! `translux validate A.tlux`: everything that is wrong with an asset, as numbered findings.

use std::path::PathBuf;
use std::sync::Arc;

use clap::Args;
use serde::Serialize;
use translux_format::{Budget, FormatError, Scan, Tag};

use super::console::{Console, Format, Strictness};
use super::findings::{self, CATALOGUE, Severity};
use super::{output, report};
use crate::asset::Asset;
use crate::error::{Error, ExitCode, Result};
use crate::evaluate::Registry;

#[derive(Clone, Debug, Args)]
#[command(after_long_help = catalogue())]
pub(super) struct ValidateArgs {
    /// Asset
    asset: PathBuf,
}

fn catalogue() -> String {
    let row = |kind: &findings::FindingKind| {
        let number = kind.number.to_string();
        [number, kind.severity.name().to_owned(), kind.name.to_owned(), kind.meaning.to_owned()]
    };
    let rows: Vec<[String; 4]> = CATALOGUE.iter().map(row).collect();
    let last = FormatError::NAMES.len();
    format!(
        "Findings 1 to {last} are errors of the bytes; the format's SPEC.md lists them. The others:\n{}\n\
         Errors end the command with 3; warnings with 6 where --strict is given.",
        output::table(&rows)
    )
}

/// Something that is wrong.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(super) struct Finding {
    /// Never changes its meaning: those of the format up to 99, those of [`CATALOGUE`] from 100 on.
    pub(super) number: u16,
    pub(super) name: &'static str,
    pub(super) severity: Severity,
    /// Section that it is about.
    pub(super) section: Option<String>,
    /// What is wrong, with values.
    pub(super) message: String,
}

impl Finding {
    fn of_format(error: &FormatError) -> Self {
        Self {
            number: error.code(),
            name: error.name(),
            severity: Severity::Error,
            section: error.tag().map(|tag| tag.to_string()),
            message: error.to_string(),
        }
    }

    pub(super) fn new(kind: &findings::FindingKind, section: Option<Tag>, message: String) -> Self {
        let (number, name, severity) = (kind.number, kind.name, kind.severity);
        Self { number, name, severity, section: section.map(|tag| tag.to_string()), message }
    }
}

#[derive(Serialize)]
struct ValidateReport {
    #[serde(serialize_with = "report::path")]
    asset: PathBuf,
    bytes: usize,
    format_version: Option<String>,
    sections: usize,
    errors: usize,
    /// Those among the findings; the report's `warnings` are those of the program.
    finding_warnings: usize,
    findings: Vec<Finding>,
}

pub(super) fn run(args: &ValidateArgs, console: &Console) -> Result<ExitCode> {
    let bytes = std::fs::read(&args.asset).map_err(|e| Error::io(&args.asset, &e))?;
    let scan = console.stage("read", || translux_format::scan(&bytes, Budget::default()));
    let findings = console.stage("check", || find(&scan, &bytes, &console.registry));
    let count = |severity| findings.iter().filter(|finding| finding.severity == severity).count();
    let result = ValidateReport {
        asset: args.asset.clone(),
        bytes: bytes.len(),
        format_version: scan.version.map(|(major, minor)| format!("{major}.{minor}")),
        sections: scan.sections.len(),
        errors: count(Severity::Error),
        finding_warnings: count(Severity::Warning),
        findings,
    };
    if console.format == Format::Text {
        print(&result)?;
    }
    report::print(console, "validate", &result)?;
    Ok(match (result.errors, result.finding_warnings, console.strictness) {
        (1.., _, _) => ExitCode::InvalidInput,
        (_, 1.., Strictness::Fail) => ExitCode::QualityNotMet,
        _ => ExitCode::Ok,
    })
}

fn print(r: &ValidateReport) -> Result<()> {
    for finding in &r.findings {
        let Finding { number, name, severity, message, .. } = finding;
        output::print_line(&format!("{} {number} {name}: {message}", severity.name()))?;
    }
    let (path, verdict) = (r.asset.display(), if r.errors == 0 { "valid" } else { "not valid" });
    output::print_line(&format!("{path}: {verdict}; {} errors, {} warnings", r.errors, r.finding_warnings))
}

/// Everything that is wrong, the bytes first.
fn find(scan: &Scan, bytes: &[u8], registry: &Registry) -> Vec<Finding> {
    let mut out: Vec<Finding> = scan.errors.iter().map(Finding::of_format).collect();
    out.extend(findings::of_version(scan));
    out.extend(findings::of_geometry(scan));
    out.extend(findings::of_provenance(scan, registry));
    match findings::of_method_sections(scan) {
        Ok(found) => out.extend(found),
        Err(errors) => out.extend(errors.iter().map(Finding::of_format)),
    }
    if !out.iter().any(|finding| finding.severity == Severity::Error) {
        out.extend(opened(scan, bytes, registry));
    }
    out
}

/// Opens what nothing is wrong with so far, as every other command does.
fn opened(scan: &Scan, bytes: &[u8], registry: &Registry) -> Option<Finding> {
    let method = registry.method(&scan.provenance.as_ref()?.method).ok()?;
    let refused = Asset::from_bytes(bytes).and_then(|asset| registry.open(Arc::new(asset))).err()?;
    Some(Finding::new(&findings::REFUSED, None, format!("method {}: {refused}", method.name())))
}
