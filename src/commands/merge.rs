//! `translux merge SHARDS -o A.tlux`.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;

use super::bake::{self, BakeArgs};
use super::console::Console;
use super::output;
use super::shards::Merged;
use crate::error::{Error, ExitCode, Result};

#[derive(Clone, Debug, Args)]
pub(super) struct MergeArgs {
    /// The shards of one bake, all of them, in any order
    #[arg(required = true, value_name = "SHARD")]
    shards: Vec<PathBuf>,
    /// Asset to write (.tlux)
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Write the asset although it misses what was asked for
    #[arg(long)]
    keep_on_fail: bool,
}

/// Puts shards together; `parse` makes the arguments of the bake from its options, which stand in a shard, and from another output.
pub(super) fn run(
    args: &MergeArgs,
    parse: impl FnOnce(&Path, String, &Path) -> Result<BakeArgs>,
    console: &Console,
) -> Result<ExitCode> {
    output::check(std::slice::from_ref(&args.output), &["tlux"], console)?;
    let merged = Merged::open(&args.shards)?;
    let Some((path, options)) = merged.options() else { return Err(Error::command_line("no shard is given")) };
    let mut bake = parse(path, options.to_owned(), &args.output)?;
    bake.build.keep_on_fail = args.keep_on_fail;
    bake::merged(&bake, Arc::new(merged), console)
}
