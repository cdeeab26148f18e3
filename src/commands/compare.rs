//! `translux compare A... B`: PLY files, EXR pictures or assets against one; exact equality without a threshold.

use std::path::{Path, PathBuf};

use clap::Args;

use super::console::Console;
use super::{many, opening};
use crate::error::{ExitCode, Result};
use crate::evaluate::keys::share;
use crate::report::comparison::{Comparison, Metric, compare};

#[derive(Clone, Debug, Args)]
pub(super) struct CompareArgs {
    /// Files to judge (.ply, .exr or .tlux), each against the reference
    #[arg(required = true)]
    a: Vec<PathBuf>,
    /// Reference of the same kind
    b: PathBuf,
    /// Figure that --fail-above judges
    #[arg(long, default_value = "rms")]
    metric: Metric,
    /// Exit with 7 if the metric is above this, such as 0.5%; without it anything but equality does. Assets are
    /// evaluated under fixed probe lights then
    #[arg(long, value_name = "E")]
    fail_above: Option<String>,
}

pub(super) fn run(args: &CompareArgs, console: &Console) -> Result<ExitCode> {
    let threshold = args.fail_above.as_deref().map(threshold).transpose()?;
    many::show("compare", &args.a, console, many::Text::UnlessQuiet, |path| {
        let result = judge(path, args, threshold, console)?;
        let code = if result.differs() { ExitCode::Difference } else { ExitCode::Ok };
        Ok((result, code))
    })
}

/// Compares one file with the reference.
fn judge(path: &Path, args: &CompareArgs, threshold: Option<f64>, console: &Console) -> Result<Comparison> {
    for path in [path, &args.b] {
        opening::check_file(path, 2, console)?;
    }
    let open = opening::within_memory(console);
    let result = compare([path, &args.b], args.metric, threshold, (&open, console.budget()), console)?;
    result.notes.iter().for_each(|note| console.note(note));
    result.warnings.iter().for_each(|warning| console.warn(warning));
    Ok(result)
}

/// A share as the threshold, 0 included.
fn threshold(text: &str) -> Result<f64> {
    if text.trim().trim_end_matches('%').trim().parse() == Ok(0.0) { Ok(0.0) } else { share(text, "--fail-above") }
}
