//! `translux reference MODEL --light L -o B.ply`: the truth without an asset, or any method in memory; with the dipole,
//! or with a random walk through the volume.

use std::path::PathBuf;
use std::time::Instant;

use clap::{Args, ValueEnum};

use super::baking::{self, BakeOptions, WalkOptions};
use super::console::{Console, in_range};
use super::evaluate::{Radiosity, finish};
use super::lights::{LightArgs, warn_of_places};
use super::media::ProfileArg;
use super::model::ModelArgs;
use super::{opening, output};
use crate::error::{Error, ExitCode, Result};
use crate::evaluate::Model;
use crate::evaluate::keys::share;
use crate::geometry::check::MeshCheck;
use crate::geometry::parts::Closure;
use crate::import::Imported;
use crate::medium::inversion::Reflector;
use crate::report::evaluation::{RadiosityReport, WalkReport};
use crate::report::radiosity_ply::{RANDOM_WALK, Single, comments, model_of, radiosity_ply};
use crate::report::text::{percent, significant};
use crate::scene::Scene;
use crate::transport::random_walk::exitance::{self, Effort, Exitance, MOST_PHOTONS};
use crate::transport::random_walk::tally::{Budget, NONE};

/// Default noise of a random walk.
const DEFAULT_NOISE: f64 = 0.05;

/// Share of lost flux above which a warning is given.
const WORTH_A_WARNING: f64 = 1e-6;

#[derive(Clone, Debug, Args)]
pub(super) struct ReferenceArgs {
    #[command(flatten)]
    model: ModelArgs,
    #[command(flatten)]
    profile: ProfileArg,
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
    walk: WalkArgs,
    #[command(flatten)]
    options: BakeOptions,
}

/// Which model of the light inside.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Model of the light inside")]
struct WalkArgs {
    /// What the exitance is computed by. A random walk writes every order of scattering to b_* and the first to s_*
    #[arg(long = "model", id = "physics", default_value = "dipole", value_name = "WHICH")]
    physics: Physics,
    #[command(flatten)]
    walks: WalkOptions,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Physics {
    /// The dipole, or another --profile, over all pairs of samples and vertices
    Dipole,
    /// The dipole calibrated by a few walks through each closed part: orders of scattering from 1 on, the shape of the body and the
    /// direction of entrance included; over all pairs
    Calibrated,
    /// A random walk through the volume: closed parts only, no light from one part to another
    MonteCarlo,
}

impl ReferenceArgs {
    /// What looks are inverted through.
    fn reflector(&self) -> Result<Reflector> {
        match self.walk.physics {
            Physics::Dipole => self.profile.reflector(),
            Physics::Calibrated | Physics::MonteCarlo => Ok(Reflector::Volume),
        }
    }
}

pub(super) fn run(args: &ReferenceArgs, console: &Console) -> Result<ExitCode> {
    match args.walk.physics {
        Physics::Dipole => summed(args, args.walk.walks.dipole()?, console),
        Physics::Calibrated | Physics::MonteCarlo if args.profile.is_given() => {
            Err(Error::command_line("--profile: walks have no profile; leave it out, or use --model dipole"))
        }
        Physics::Calibrated => summed(args, args.walk.walks.calibrated()?, console),
        Physics::MonteCarlo => monte_carlo(args, console),
    }
}

fn summed(args: &ReferenceArgs, model: Model, console: &Console) -> Result<ExitCode> {
    let mut recipe = args.options.resolve(&args.method, model, console)?;
    // Nothing is left of the ledger but what is measured.
    recipe.settings.tells_model = !args.no_measure;
    let asked_rms = Some(recipe.settings.max_rms);
    output::check(&args.output, &["ply"], console)?;
    let lights = args.lights.load(console)?;
    let asset = baking::bake(recipe, args.model.load(args.reflector()?, console)?, console)?;
    let provenance = asset.provenance.clone();
    let (method, model) = (provenance.method.as_str(), model_of(&provenance));
    let mut evaluator = opening::baked(asset, console)?;
    args.profile.put(evaluator.as_mut())?;
    let measure = !args.no_measure;
    let wanted = Radiosity { method, model, outputs: &args.output, texture: None, measure, asked_rms, trust: None };
    finish("reference", evaluator.as_mut(), lights, &wanted, console)
}

fn monte_carlo(args: &ReferenceArgs, console: &Console) -> Result<ExitCode> {
    let effort = args.effort()?;
    output::check(&args.output, &["ply"], console)?;
    let lights = args.lights.load(console)?;
    let Imported { scene, check, .. } = args.model.load(args.reflector()?, console)?;
    check_closed(&scene, &check).map_err(|e| e.in_file(&args.model.model))?;
    console.check_memory(exitance::memory(scene.domain()), "raise --max-memory")?;
    // Photons start from points of the surface, not from samples of it.
    warn_of_places(&scene, &lights.lights, 0, console);
    let started = Instant::now();
    let walked = exitance::exitance(scene.domain(), &lights.lights, effort, args.walk.walks.seed, console)?;
    let rate = walked.budget.iter().map(|b| b.collisions).sum::<u64>() as f64 / started.elapsed().as_secs_f64();
    let radiosity = walked.hats.to_vertices(&walked.total);
    output::write(&args.output, console, || {
        let mut comments = comments(RANDOM_WALK, &scene, &lights.text);
        comments.push(format!("noise {} of the RMS", percent(walked.noise())));
        comments.push("s is what left after one scattering event, b includes it".to_owned());
        let single = walked.hats.to_vertices(&walked.single);
        radiosity_ply(&scene.mesh, &radiosity, Single::Within(&single), comments)
    })?;
    tell(&walked, rate, console);
    let asked_noise = match effort {
        Effort::Noise(asked) => Some(asked),
        Effort::Photons(_) => None,
    };
    let verdict = console.judge(walked.noise(), asked_noise);
    let without_area = walked.hats.of_vertex.iter().filter(|&&s| s == NONE).count();
    let result = WalkReport {
        model: "monte-carlo",
        radiosity: RadiosityReport::new((lights.text, lights.inputs), &args.output, &radiosity, without_area),
        seed: args.walk.walks.seed,
        photons: walked.photons,
        budget: walked.budget,
        noise: walked.relative_noise().to_array(),
        asked_noise,
    };
    console.report("reference", &result)?;
    verdict
}

/// Refuses parts that enclose no volume.
fn check_closed(scene: &Scene, check: &MeshCheck) -> Result<()> {
    for (entry, part) in scene.parts.parts.iter().zip(&check.parts).filter(|(entry, _)| entry.transfers()) {
        if part.part.closure == Closure::Open {
            return Err(Error::unsupported(format!(
                "part `{}` is open, and a random walk needs a volume: close it, name it with --opaque or --skip, or use \
                 --model dipole",
                entry.name
            )));
        }
        if part.part.volume_mm3.is_some_and(|v| v <= 0.0) {
            return Err(Error::input(format!(
                "part `{}` encloses no volume: its surface is turned inside out or folds into itself",
                entry.name
            )));
        }
    }
    Ok(())
}

impl ReferenceArgs {
    /// The effort of the walk; refuses options that a walk does not have.
    fn effort(&self) -> Result<Effort> {
        let unfit = [
            (self.method != "reference", "--method"),
            (self.options.samples.is_some(), "--samples"),
            (!self.options.set.is_empty(), "--set"),
            (self.options.for_lights != "all", "--for-lights"),
            (self.no_measure, "--no-measure"),
        ];
        if let Some((_, flag)) = unfit.iter().find(|(given, _)| *given) {
            return Err(Error::command_line(format!(
                "{flag} is for --model dipole; a random walk takes --photons, --max-rms and --seed"
            )));
        }
        match (self.walk.walks.photons, &self.options.max_rms) {
            (Some(_), Some(_)) => Err(Error::command_line("--photons and --max-rms: a random walk takes one of them")),
            (Some(photons), _) => in_range("--photons", photons, 1..=MOST_PHOTONS).map(Effort::Photons),
            (None, Some(text)) => Ok(Effort::Noise(share(text, "--max-rms")?)),
            (None, None) => Ok(Effort::Noise(DEFAULT_NOISE)),
        }
    }
}

/// Prints notes and warnings about a walk.
fn tell(walked: &Exitance, rate: f64, console: &Console) {
    let noise = walked.relative_noise().to_array().map(percent);
    let collisions: u64 = walked.budget.iter().map(|b| b.collisions).sum();
    let (noise, photons) = (noise.join(", "), walked.photons.iter().sum::<u64>());
    let [collisions, rate] = [collisions as f64, rate].map(|n| significant(n * 1e-6));
    console.note(&format!(
        "noise {noise} RMS (RGB) from {photons} photons; {collisions} million collisions, {rate} million a second"
    ));
    let of = |f: fn(&Budget) -> f64| walked.budget.map(|b| percent(b.share(f(&b)))).join(" ");
    let (once, more, unscattered) = (of(|b| b.left_once), of(|b| b.left_more), of(|b| b.left_unscattered));
    console.note(&format!(
        "of what enters (RGB): {once} leaves after one scattering, {more} after more, {unscattered} unscattered"
    ));
    if walked.lost_share() > WORTH_A_WARNING {
        console.warn(&format!("{} of the light was lost through the surface", percent(walked.lost_share())));
    }
    let trapped = walked.budget.iter().map(|b| b.share(b.trapped)).fold(0.0, f64::max);
    if trapped > 0.0 {
        console
            .note(&format!("{} of the light never leaves a clear medium: total reflection keeps it", percent(trapped)));
    }
}
