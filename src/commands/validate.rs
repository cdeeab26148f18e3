//! `translux validate A.tlux`.

use std::path::PathBuf;

use clap::Args;

use super::console::Console;
use super::many;
use super::opening::{FEWER, check_file};
use crate::error::{ExitCode, Result};
use crate::report::validation::{catalogue, validate};

#[derive(Clone, Debug, Args)]
#[command(after_long_help = catalogue())]
pub(super) struct ValidateArgs {
    /// Assets
    #[arg(required = true)]
    assets: Vec<PathBuf>,
}

pub(super) fn run(args: &ValidateArgs, console: &Console) -> Result<ExitCode> {
    many::show("validate", &args.assets, console, many::Text::Always, |path| {
        // What was scanned, and sections as they are evaluated.
        check_file(path, 3, console)?;
        let result = console.with_limits(FEWER, |limits| validate(path, &console.registry, limits, console))?;
        let code = match (result.errors, result.finding_warnings, console.global.strict) {
            (1.., _, _) => ExitCode::InvalidInput,
            (_, 1.., true) => ExitCode::QualityNotMet,
            _ => ExitCode::Ok,
        };
        Ok((result, code))
    })
}
