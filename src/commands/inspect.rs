//! `translux inspect A.tlux`.

use std::path::PathBuf;

use clap::Args;

use super::console::Console;
use super::many;
use super::opening::{FEWER, check_file};
use crate::error::{ExitCode, Result};
use crate::report::inspection::{Depth, inspect};

#[derive(Clone, Debug, Args)]
pub(super) struct InspectArgs {
    /// Assets
    #[arg(required = true)]
    assets: Vec<PathBuf>,
    /// Read everything and make the evaluator: size of the object, triangles and area of each part, bytes in memory. Without it only
    /// header, directory and records are read, and damage elsewhere is not noticed (`translux validate` looks for that)
    #[arg(long)]
    deep: bool,
}

pub(super) fn run(args: &InspectArgs, console: &Console) -> Result<ExitCode> {
    let depth = if args.deep { Depth::Everything } else { Depth::Directory };
    many::show("inspect", &args.assets, console, many::Text::Always, |path| {
        if args.deep {
            check_file(path, 3, console)?;
        }
        let found = console.with_limits(FEWER, |limits| inspect(path, &console.registry, depth, limits))?;
        Ok((found, ExitCode::Ok))
    })
}
