//! `translux reference MODEL --light L -o B.ply`: the truth without an asset, or any method's figures in memory.

use std::path::PathBuf;
use std::sync::Arc;

use clap::Args;

use super::baking::{self, BakeOptions};
use super::console::Console;
use super::evaluate::{Measure, finish, judge};
use super::lights::LightArgs;
use super::model::ModelArgs;
use super::{output, report};
use crate::error::{ExitCode, Result};
use crate::methods;

#[derive(Clone, Debug, Args)]
pub(super) struct ReferenceArgs {
    #[command(flatten)]
    model: ModelArgs,
    #[command(flatten)]
    lights: LightArgs,
    /// PLY to write, `-` for standard output; repeatable
    #[arg(short, long, required = true, value_name = "FILE")]
    output: Vec<PathBuf>,
    /// Method: reference, or another to run without an asset
    #[arg(long, default_value = "reference")]
    method: String,
    /// Leave out the measurement of the error
    #[arg(long)]
    no_measure: bool,
    #[command(flatten)]
    options: BakeOptions,
}

pub(super) fn run(args: &ReferenceArgs, console: &Console) -> Result<ExitCode> {
    let method = methods::named(&args.method)?;
    let settings = args.options.resolve(method)?;
    output::check(&args.output, &["ply"], console)?;
    let lights = args.lights.load(console)?;
    let loaded = args.model.load(console)?;
    let asset = Arc::new(baking::bake(method, loaded, &settings, console)?);
    let mut evaluator = console.stage("prepare", || method.open(asset))?;
    let measure = if args.no_measure { Measure::No } else { Measure::Yes };
    let asked = Some(settings.max_rms);
    let result = finish(evaluator.as_mut(), method.name(), lights, &args.output, measure, asked, console)?;
    let verdict = judge(&result, console);
    report::print(console, "reference", &result)?;
    verdict
}
