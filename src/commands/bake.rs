//! `translux bake MODEL -o A.tlux`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::baking::{self, BakeOptions, WalkOptions};
use super::console::Console;
use super::model::ModelArgs;
use super::output;
use crate::error::{ExitCode, Result};
use crate::io::atomic;
use crate::report::bake::BakeReport;
use crate::report::sizes::sizes;

#[derive(Clone, Debug, Args)]
pub(super) struct BakeArgs {
    #[command(flatten)]
    model: ModelArgs,
    /// Asset to write (.tlux)
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Method (see `translux methods`)
    #[arg(long, default_value = "editable")]
    method: String,
    #[command(flatten)]
    options: BakeOptions,
    /// Model of the light inside that the kernels follow
    #[arg(
        long = "model",
        id = "inside",
        default_value = "dipole",
        value_name = "WHICH",
        help_heading = "Model of the light inside"
    )]
    inside: Inside,
    #[command(flatten, next_help_heading = "Model of the light inside")]
    walks: WalkOptions,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Inside {
    /// The dipole of the papers, made for a half space
    Dipole,
    /// The dipole, calibrated by a few walks through each closed part: two_pass, editable, quantized_lights, all_frequency
    Calibrated,
}

pub(super) fn run(args: &BakeArgs, console: &Console) -> Result<ExitCode> {
    let model = match args.inside {
        Inside::Dipole => args.walks.dipole(),
        Inside::Calibrated => args.walks.calibrated(),
    };
    let recipe = args.options.resolve(&args.method, model?, console)?;
    let asked = Some(recipe.settings.max_rms);
    output::check(std::slice::from_ref(&args.output), &["tlux"], console)?;
    let imported = args.model.load(console)?;
    let mesh = imported.check.clone();
    let asset = baking::bake(recipe, imported, console)?;
    let sizes = console.stage("write", || -> Result<_> {
        let bytes = asset.to_bytes()?;
        let sizes = sizes(&bytes)?;
        atomic::write(&args.output, &bytes)?;
        Ok(sizes)
    })?;
    let result = BakeReport::new(args.output.clone(), asset, &sizes, mesh);
    console.note(&result.summary(console.seconds()));
    let verdict = console.judge(result.ledger.total_rms_without_environment(), asked);
    console.report("bake", &result)?;
    verdict
}
