//! The report of a command: typed, printed as JSON with `--json`.

use serde::Serialize;

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
