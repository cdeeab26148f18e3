//! `translux bake MODEL -o A.tlux`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use serde::Serialize;

use super::baking::{self, BakeOptions, WalkOptions};
use super::console::Console;
use super::model::ModelArgs;
use super::output;
use super::planning::{self, PlanOptions};
use crate::asset::Asset;
use crate::error::{ExitCode, Result};
use crate::evaluate::Model;
use crate::geometry::check::MeshCheck;
use crate::io::atomic;
use crate::plan::Plan;
use crate::report::bake::BakeReport;
use crate::report::sizes::sizes;

#[derive(Clone, Debug, Args)]
pub(super) struct BakeArgs {
    #[command(flatten)]
    model: ModelArgs,
    /// Asset to write (.tlux)
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Method (see `translux methods`); auto: the smallest asset that meets what is asked for, measured after the bake
    #[arg(long, default_value = planning::AUTO)]
    method: String,
    #[command(flatten)]
    options: BakeOptions,
    #[command(flatten)]
    plan: PlanOptions,
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
    if args.method == planning::AUTO {
        return planned(args, model?, console);
    }
    args.plan.refuse_for(&args.method)?;
    let recipe = args.options.resolve(&args.method, model?, console)?;
    let asked = Some(recipe.settings.max_rms);
    output::check(std::slice::from_ref(&args.output), &["tlux"], console)?;
    let imported = args.model.load(console)?;
    let mesh = imported.check.clone();
    let asset = baking::bake(recipe, imported, console)?;
    let result = write(args, asset, mesh, console)?;
    let verdict = console.judge(result.ledger.total_rms_without_environment(), asked);
    console.report("bake", &result)?;
    verdict
}

/// The report of a bake with the plan that it followed; without an asset the plan alone.
#[derive(Serialize)]
struct PlannedReport<'a> {
    #[serde(flatten)]
    bake: Option<BakeReport>,
    plan: &'a Plan,
}

/// A plan, its asset if there is one, and its report; an error where the request is not met.
fn planned(args: &BakeArgs, model: Model, console: &Console) -> Result<ExitCode> {
    let request = args.plan.resolve(&args.options, model)?;
    output::check(std::slice::from_ref(&args.output), &["tlux"], console)?;
    args.plan.check_report(&args.output)?;
    let imported = args.model.load(console)?;
    let mesh = imported.check.clone();
    let (plan, asset) = planning::bake(&request, imported, console)?;
    let bake = asset.map(|asset| write(args, asset, mesh, console)).transpose()?;
    plan.summary().iter().for_each(|line| console.note(line));
    args.plan.write(&plan)?;
    console.report("bake", &PlannedReport { bake, plan: &plan })?;
    planning::verdict(&plan)
}

/// Writes an asset and says what it is.
fn write(args: &BakeArgs, asset: Asset, mesh: MeshCheck, console: &Console) -> Result<BakeReport> {
    let sizes = console.stage("write", || -> Result<_> {
        let bytes = asset.to_bytes()?;
        let sizes = sizes(&bytes)?;
        atomic::write(&args.output, &bytes)?;
        Ok(sizes)
    })?;
    let result = BakeReport::new(args.output.clone(), asset, &sizes, mesh);
    console.note(&result.summary(console.seconds()));
    Ok(result)
}
