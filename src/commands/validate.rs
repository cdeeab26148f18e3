//! `translux validate A.tlux`.

use std::path::PathBuf;

use clap::Args;

use super::console::Console;
use crate::error::{ExitCode, Result};
use crate::report::validation::{catalogue, validate};

#[derive(Clone, Debug, Args)]
#[command(after_long_help = catalogue())]
pub(super) struct ValidateArgs {
    /// Asset
    asset: PathBuf,
}

pub(super) fn run(args: &ValidateArgs, console: &Console) -> Result<ExitCode> {
    let result = validate(&args.asset, &console.registry, console)?;
    console.show("validate", &result)?;
    Ok(match (result.errors, result.finding_warnings, console.global.strict) {
        (1.., _, _) => ExitCode::InvalidInput,
        (_, 1.., true) => ExitCode::QualityNotMet,
        _ => ExitCode::Ok,
    })
}
