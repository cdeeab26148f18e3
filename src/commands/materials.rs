//! `translux materials`.

use clap::Args;

use super::console::Console;
use crate::error::{ExitCode, Result};
use crate::report::materials::MaterialsReport;

#[derive(Clone, Debug, Args)]
pub(super) struct MaterialsArgs {}

pub(super) fn run(_: &MaterialsArgs, console: &Console) -> Result<ExitCode> {
    console.show("materials", &MaterialsReport::of_presets())?;
    Ok(ExitCode::Ok)
}
