//! `translux inspect A.tlux`.

use std::path::PathBuf;

use clap::Args;

use super::console::Console;
use crate::error::{ExitCode, Result};
use crate::report::inspection::inspect;

#[derive(Clone, Debug, Args)]
pub(super) struct InspectArgs {
    /// Asset
    asset: PathBuf,
}

pub(super) fn run(args: &InspectArgs, console: &Console) -> Result<ExitCode> {
    console.show("inspect", &inspect(&args.asset, &console.registry)?)
}
