//! `translux bake MODEL -o A.tlux`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::{Args, ValueEnum};
use serde::Serialize;

use super::baking::{self, BakeOptions, WalkOptions};
use super::caching::{BakeCache, CacheOptions};
use super::configuration::FileOptions;
use super::console::Console;
use super::model::ModelArgs;
use super::output;
use super::planning::{self, PlanOptions};
use super::rebuild::{self, BuildOptions};
use super::shards::{self, Computed, Merged, ShardOptions};
use crate::asset::{Asset, Provenance, REQUEST};
use crate::error::{Error, ExitCode, Result};
use crate::evaluate::division::Shard;
use crate::evaluate::{BakeSettings, Recipe, StageCache};
use crate::geometry::check::MeshCheck;
use crate::import::Imported;
use crate::io::atomic;
use crate::medium::inversion::Reflector;
use crate::plan::{self, Plan, Request};
use crate::report::bake::BakeReport;
use crate::report::quality::missed_quality;
use crate::report::sizes::sizes;
use crate::report::text::{duration, megabytes};
use crate::report::validation::examine;

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
    /// What the asset holds although it could be made again from the mesh in less than a second
    #[arg(long, value_name = "WHAT")]
    store: Option<Stored>,
    #[command(flatten)]
    plan: PlanOptions,
    /// Model of the light inside that the kernels follow (default: calibrated where --method auto chooses, dipole for a method that is
    /// named, as its paper has it)
    #[arg(long = "model", id = "inside", value_name = "WHICH", help_heading = "Model of the light inside")]
    inside: Option<Inside>,
    #[command(flatten, next_help_heading = "Model of the light inside")]
    walks: WalkOptions,
    #[command(flatten)]
    pub(super) build: BuildOptions,
    #[command(flatten)]
    cache: CacheOptions,
    #[command(flatten)]
    pub(super) shards: ShardOptions,
    #[command(flatten)]
    pub(super) files: FileOptions,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Inside {
    /// The dipole of the papers, made for a half space
    Dipole,
    /// The dipole, calibrated by a few walks through each closed part: two_pass, editable, quantized_lights, all_frequency
    Calibrated,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Stored {
    /// The samples of the surface: for readers that do not know the rule by which they are made
    Samples,
}

impl Inside {
    /// What looks are inverted through.
    fn reflector(self) -> Reflector {
        match self {
            Self::Dipole => Reflector::default(),
            Self::Calibrated => Reflector::Volume,
        }
    }
}

impl BakeArgs {
    /// The model of the light inside.
    fn inside(&self) -> Inside {
        let of_method = if self.method == planning::AUTO { Inside::Calibrated } else { Inside::Dipole };
        self.inside.unwrap_or(of_method)
    }
}

/// Refuses what is wrong with the options themselves, before anything is read or written.
///
/// # Errors
/// The command line.
pub(super) fn check(args: &BakeArgs, console: &Console) -> Result<()> {
    resolve(args, console).map(drop)
}

/// The method with its settings.
fn resolve(args: &BakeArgs, console: &Console) -> Result<What> {
    let model = match args.inside() {
        Inside::Dipole => args.walks.dipole(),
        Inside::Calibrated => args.walks.calibrated(),
    };
    Ok(match args.method.as_str() {
        planning::AUTO => {
            let request = args.plan.resolve(&args.options, model?)?;
            What::Planned(Request { samples_stored: args.store.is_some(), ..request })
        }
        method => {
            args.plan.refuse_for(method)?;
            let mut recipe = args.options.resolve(method, model?, console)?;
            recipe.settings.samples_stored = args.store.is_some();
            What::Named(recipe)
        }
    })
}

pub(super) fn run(args: &BakeArgs, console: &Console) -> Result<ExitCode> {
    let what = resolve(args, console)?;
    let shard = args.shards.shard;
    let suffix = if shard.is_some() { shards::SUFFIX } else { "tlux" };
    output::check(std::slice::from_ref(&args.output), &[suffix], console)?;
    args.plan.check_report(&args.output)?;
    args.build.check(&args.output)?;
    let request = rebuild::request(&args.model, &what.of_method());
    if let Some(shard) = shard {
        return share(args, (what, &request), shard, console);
    }
    if args.build.is_current(&args.output, &request, &args.model, console)? {
        return current(args, console);
    }
    let cache = if args.build.dry_run { None } else { args.cache.open()? };
    let stages = BakeCache::for_stages(&cache);
    if args.build.dry_run {
        let imported = args.model.load(args.inside().reflector(), console)?;
        return forecast(&what, imported, console);
    }
    let found = baked(args, what, (&request, stages), console)?;
    cache.iter().for_each(|cache| cache.tell(console));
    finish(args, found, console)
}

/// What came of a bake: the asset, if there is one, the check of its mesh, and the plan, if there was one.
struct Baked {
    asset: Option<Asset>,
    mesh: MeshCheck,
    plan: Option<Plan>,
}

/// Reads the model and bakes it.
fn baked(args: &BakeArgs, what: What, (request, stages): (&str, StageCache), console: &Console) -> Result<Baked> {
    let imported = args.model.load(args.inside().reflector(), console)?;
    let mesh = imported.check.clone();
    let (mut asset, plan) = match what {
        What::Named(mut recipe) => {
            recipe.settings.cache = stages;
            (Some(baking::bake(recipe, imported, console)?), None)
        }
        What::Planned(wanted) => {
            let (plan, asset) = planning::bake(&wanted, imported, (request.to_owned(), stages), console)?;
            (asset, Some(plan))
        }
    };
    // A plan's asset has it already, whose size is part of the plan.
    if let Some(asset) = &mut asset {
        asset.provenance.settings.insert(REQUEST.to_owned(), request.to_owned());
    }
    Ok(Baked { asset, mesh, plan })
}

/// Computes the blocks of a shard and writes them.
fn share(args: &BakeArgs, (what, request): (What, &str), shard: Shard, console: &Console) -> Result<ExitCode> {
    match &what {
        What::Named(recipe) if recipe.form.divides() => {}
        What::Named(recipe) => {
            return Err(Error::unsupported(format!(
                "--shard: a bake of `{}` with these settings has nothing that processes could share",
                recipe.method
            )));
        }
        What::Planned(_) => {
            return Err(Error::command_line(
                "--shard: --method auto bakes, measures and may bake again; name the method that it chose (inspect says which)",
            ));
        }
    }
    if args.output == Path::new("-") {
        return Err(Error::command_line("-o -: a shard needs a file"));
    }
    let inputs = rebuild::inputs(&args.model)?;
    let before = args.shards.from_shard.as_deref();
    let computed = Computed::new((shard, before), &args.output, (request, &inputs))?;
    let stages = StageCache::default().divided(computed.clone());
    match baked(args, what, (request, stages), console) {
        Err(_) if computed.is_done() => computed.write(&args.output, &args.shards, (request, &inputs), console),
        Err(error) => Err(error),
        Ok(_) => Err(Error::runtime("the bake ended without the blocks of a shard")),
    }
}

/// Bakes with the blocks that shards left.
///
/// # Errors
/// Errors of the bake; shards that are of another one.
pub(super) fn merged(args: &BakeArgs, shards: Arc<Merged>, console: &Console) -> Result<ExitCode> {
    let what = resolve(args, console)?;
    let request = rebuild::request(&args.model, &what.of_method());
    shards.check(&request, &rebuild::inputs(&args.model)?)?;
    let stages = StageCache::default().divided(shards.clone());
    let found = baked(args, what, (&request, stages), console)?;
    shards.check_used()?;
    finish(args, found, console)
}

/// What is baked.
enum What {
    Named(Recipe),
    Planned(Request),
}

impl What {
    /// All of its settings as text.
    fn of_method(&self) -> String {
        match self {
            Self::Named(Recipe { method, texts, settings, .. }) => {
                let BakeSettings { samples, samples_stored, max_rms, for_lights, model, .. } = settings;
                format!("{method} {texts:?} {samples:?} {samples_stored} {max_rms} {for_lights:?} {model:?}")
            }
            Self::Planned(request) => format!("{request:?}"),
        }
    }
}

/// The report of a bake with the plan that it followed; without an asset the plan alone.
#[derive(Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct BakedReport<'a> {
    #[serde(flatten)]
    bake: Option<BakeReport>,
    #[serde(skip_serializing_if = "Option::is_none")]
    plan: Option<&'a Plan>,
    /// Whether the output is new: not where it misses what was asked for.
    written: bool,
}

/// Judges an asset, writes it where it is what was asked for, and reports it.
fn finish(args: &BakeArgs, Baked { asset, mesh, plan }: Baked, console: &Console) -> Result<ExitCode> {
    let encoded = asset.map(|asset| console.stage("write", || Ok((asset.to_bytes()?, asset)))).transpose()?;
    let mut verdict = plan.as_ref().map_or(Ok(ExitCode::Ok), planning::verdict);
    if let (Some((bytes, asset)), Ok(_)) = (&encoded, &verdict) {
        verdict = judged(args, bytes, asset, console);
    }
    let mut written = false;
    if let Some((bytes, _)) = encoded.as_ref().filter(|_| verdict.is_ok() || args.build.keep_on_fail) {
        console.stage("write", || atomic::write(&args.output, bytes))?;
        args.build.write(&args.output, &args.model)?;
        written = true;
    }
    let of_asset = |(bytes, asset): (Vec<u8>, Asset)| {
        let report = BakeReport::new(args.output.clone(), asset, &sizes(&bytes)?, mesh);
        console.note(&report.summary(console.seconds()));
        Ok(report)
    };
    let bake = encoded.map(of_asset).transpose()?;
    if let Some(plan) = &plan {
        plan.summary().iter().for_each(|line| console.note(line));
        args.plan.write(plan)?;
    }
    let is_there = bake.is_some();
    console.report("bake", &BakedReport { bake, plan: plan.as_ref(), written })?;
    verdict.map_err(|e| match is_there && !written {
        true => Error::new(
            e.code(),
            format!("{}; {} is left as it was (--keep-on-fail writes it)", e.message(), args.output.display()),
        ),
        false => e,
    })
}

/// The verdict on an asset: with `--strict` that of `validate --strict`, else a warning where its errors are too large.
fn judged(args: &BakeArgs, bytes: &[u8], asset: &Asset, console: &Console) -> Result<ExitCode> {
    if console.global.strict {
        let found = console.with_limits("raise --max-memory, or leave --strict out", |limits| {
            examine(&args.output, bytes, (&console.registry, limits), console)
        })?;
        let messages: Vec<&str> = found.findings.iter().map(|finding| finding.message.as_str()).collect();
        return match messages.as_slice() {
            [] => Ok(ExitCode::Ok),
            some => Err(Error::new(ExitCode::QualityNotMet, some.join("; "))),
        };
    }
    let Provenance { settings, origin, .. } = &asset.provenance;
    let asked = settings.get("max-rms").and_then(|text| text.parse().ok());
    let missed = asked.and_then(|asked| missed_quality(&origin.notes, &asset.ledger, asked));
    missed.iter().for_each(|line| console.warn(line));
    Ok(ExitCode::Ok)
}

/// Report of a bake that was not needed.
#[derive(Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct CurrentReport<'a> {
    #[serde(serialize_with = "crate::report::path")]
    #[cfg_attr(test, schemars(with = "String"))]
    output: &'a Path,
    written: bool,
}

/// Nothing is to be done, but for the verdict of `--strict`.
fn current(args: &BakeArgs, console: &Console) -> Result<ExitCode> {
    args.build.write(&args.output, &args.model)?;
    console.note(&format!("{}: of the same request and files; nothing to do", args.output.display()));
    if console.global.strict {
        let bytes = std::fs::read(&args.output).map_err(|e| Error::io(&args.output, &e))?;
        judged(args, &bytes, &Asset::from_bytes_within(&bytes, console.budget())?, console)?;
    }
    console.report("bake", &CurrentReport { output: &args.output, written: false })
}

/// What a bake is expected to take.
#[derive(Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct ForecastReport {
    dry_run: bool,
    method: String,
    settings: BTreeMap<String, String>,
    /// Largest memory of the bake.
    memory_bytes: u64,
    /// Size of the file; none where the form cannot tell.
    bytes: Option<f64>,
    /// Time on two cores of an AMD EPYC (Zen 5), the choice of a plan apart; none where the form cannot tell.
    seconds: Option<f64>,
}

/// Says what a bake is expected to take.
fn forecast(what: &What, imported: Imported, console: &Console) -> Result<ExitCode> {
    let Imported { scene, origin, .. } = imported;
    let chosen;
    let (recipe, memory_bytes) = match what {
        What::Named(recipe) => (recipe, recipe.bake_memory(&scene)),
        What::Planned(request) => {
            chosen = planning::choose(request, &scene, origin.into(), console)?;
            (&chosen.0, chosen.1)
        }
    };
    let expected = recipe.form.forecast(&scene, &recipe.settings);
    let mesh = plan::mesh_bytes(&scene)?;
    let report = ForecastReport {
        dry_run: true,
        method: recipe.method.to_owned(),
        settings: recipe.texts.clone(),
        memory_bytes,
        bytes: expected.as_ref().map(|expected| mesh as f64 + expected.bytes),
        seconds: expected.as_ref().map(|expected| expected.bake_s),
    };
    let known = |text: Option<String>| text.unwrap_or_else(|| "unknown".to_owned());
    console.say(&format!(
        "{}: about {} of memory, a file of {}, {} on two cores of an AMD EPYC (Zen 5)",
        report.method,
        megabytes(report.memory_bytes),
        known(report.bytes.map(|bytes| megabytes(bytes as u64))),
        known(report.seconds.map(duration)),
    ))?;
    console.report("bake", &report)
}
