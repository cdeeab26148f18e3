//! Results of the library as reports: typed figures that serialise to JSON and display as text.
//!
//! ```no_run
//! use std::path::Path;
//! use std::sync::Arc;
//! use translux::progress::Silent;
//! use translux::report::{comparison, inspection, validation};
//!
//! # fn main() -> translux::error::Result<()> {
//! let registry = translux::methods::built_in();
//! let (asset, other) = (Path::new("head.tlux"), Path::new("before.tlux"));
//! let limits = translux::evaluate::memory::Limits::none();
//! println!("{}", inspection::inspect(asset, &registry, inspection::Depth::Directory, limits)?);
//! assert_eq!(validation::validate(asset, &registry, limits, &Silent)?.errors, 0);
//! let open = |asset: &Arc<_>, _: &Path| registry.open(Arc::clone(asset));
//! let metric = comparison::Metric::Rms;
//! assert!(!comparison::compare([asset, other], metric, Some(0.01), (&open, limits.budget), &Silent)?.differs());
//! # Ok(())
//! # }
//! ```

pub(crate) mod bake;
pub(crate) mod blame;
pub(crate) mod chart;
pub mod comparison;
pub(crate) mod evaluation;
pub(crate) mod export;
pub mod findings;
pub mod inspection;
pub mod materials;
pub(crate) mod methods;
pub(crate) mod opened;
pub(crate) mod picture;
pub(crate) mod pose_check;
pub(crate) mod quality;
pub(crate) mod radiosity_ply;
pub(crate) mod sheet;
pub mod sizes;
pub(crate) mod text;
pub(crate) mod trust;
pub(crate) mod trust_picture;
pub mod validation;

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize, Serializer};

use self::materials::LookReport;
use crate::error::{Error, Result};

/// Time that a stage took.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct StageTime {
    /// Name of the stage.
    pub stage: String,
    /// Wall-clock seconds.
    pub seconds: f64,
}

/// What differs from run to run of the same work; everything else in a report is the same.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Timings {
    /// Wall-clock seconds in total.
    pub seconds: f64,
    /// Stages in the order of their first start; one that ran several times has one entry with the sum.
    pub stages: Vec<StageTime>,
    /// Stages whose results `--cache` had; left out where there are none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub reused: Vec<String>,
    /// Memory that the work was expected to take, bytes, before it began; 0 for commands that estimate none.
    pub estimated_memory_bytes: u64,
    /// Largest resident size of the process, bytes; 0 where the system does not report it.
    pub peak_memory_bytes: u64,
    /// Worker threads.
    pub threads: usize,
}

/// The run that a report belongs to.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Run {
    /// Looks that were asked for (`--color`, `--radius-mm`, or in material files) and what became of them.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub looks: Vec<LookReport>,
    /// Warnings of the program, one line each.
    pub warnings: Vec<String>,
    /// What differs from run to run.
    pub timings: Timings,
}

/// A report with its schema and its run.
#[derive(Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Envelope<'a, T: Serialize> {
    /// Name of the schema.
    schema: String,
    /// Version of the program.
    version: &'static str,
    #[serde(flatten)]
    body: &'a T,
    #[serde(flatten)]
    run: &'a Run,
}

/// The report of a command as JSON, with the schema `translux.COMMAND.v1`.
///
/// # Errors
/// Run time: a body that JSON cannot hold.
pub fn json<T: Serialize>(command: &str, body: &T, run: &Run) -> Result<String> {
    serde_json::to_string_pretty(&envelope(command, body, run)).map_err(|e| Error::runtime(format!("report: {e}")))
}

/// The same as a value, for a report of many.
///
/// # Errors
/// As [`json`].
pub(crate) fn document<T: Serialize>(command: &str, body: &T, run: &Run) -> Result<serde_json::Value> {
    serde_json::to_value(envelope(command, body, run)).map_err(|e| Error::runtime(format!("report: {e}")))
}

fn envelope<'a, T: Serialize>(command: &str, body: &'a T, run: &'a Run) -> Envelope<'a, T> {
    Envelope { schema: format!("translux.{command}.v1"), version: env!("CARGO_PKG_VERSION"), body, run }
}

/// Serialises a path as text; bytes that are not UTF-8 are replaced, because a report is not worth failing for.
///
/// # Errors
/// Errors of the serialiser.
pub fn path<S: Serializer>(path: &Path, serializer: S) -> std::result::Result<S::Ok, S::Error> {
    serializer.collect_str(&path.display())
}

/// Like [`path`], for several paths.
///
/// # Errors
/// Errors of the serialiser.
pub fn paths<S: Serializer>(paths: &[PathBuf], serializer: S) -> std::result::Result<S::Ok, S::Error> {
    serializer.collect_seq(paths.iter().map(|p| p.to_string_lossy()))
}
