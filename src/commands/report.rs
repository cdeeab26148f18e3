//! The report of a command: typed, printed as JSON with `--json`.

use std::path::{Path, PathBuf};

use serde::{Serialize, Serializer};

use super::console::{Console, Format, StageTime, peak_memory};
use crate::error::{Error, Result};

/// What every report holds beside the command's own figures.
#[derive(Debug, Serialize)]
struct Envelope<'a, T: Serialize> {
    /// Identifies the shape of this report.
    schema: String,
    version: &'static str,
    #[serde(flatten)]
    body: &'a T,
    seconds: f64,
    stages: Vec<StageTime>,
    peak_memory_bytes: u64,
    threads: usize,
    warnings: Vec<String>,
}

/// Prints the report of a command as JSON where that was asked for.
pub(super) fn print<T: Serialize>(console: &Console, command: &str, body: &T) -> Result<()> {
    if console.format != Format::Json {
        return Ok(());
    }
    let envelope = Envelope {
        schema: format!("translux.{command}.v0"),
        version: env!("CARGO_PKG_VERSION"),
        body,
        seconds: console.seconds(),
        stages: console.times(),
        peak_memory_bytes: peak_memory(),
        threads: rayon::current_num_threads(),
        warnings: console.warnings(),
    };
    let text = serde_json::to_string_pretty(&envelope).map_err(|e| Error::runtime(format!("report: {e}")))?;
    super::output::print_line(&text)
}

/// Serialises a path as text; bytes that are not UTF-8 are replaced, because a report is not worth failing for.
pub(super) fn path<S: Serializer>(path: &Path, serializer: S) -> std::result::Result<S::Ok, S::Error> {
    serializer.collect_str(&path.display())
}

/// As [`path`], for several.
pub(super) fn paths<S: Serializer>(paths: &[PathBuf], serializer: S) -> std::result::Result<S::Ok, S::Error> {
    serializer.collect_seq(paths.iter().map(|p| p.to_string_lossy()))
}
