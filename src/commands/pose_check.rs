//! `translux pose-check POSES... A.tlux`.

use std::path::{Path, PathBuf};

use clap::Args;

use super::console::{Console, in_range};
use super::evaluate::TOO_MUCH;
use super::lights::{LightArgs, ResolvedLights, long_help, warn_of_places};
use super::opening::AssetArgs;
use crate::error::{Error, ExitCode, Result};
use crate::evaluate::Evaluator;
use crate::evaluate::keys::share;
use crate::import::file::{Input, files_of};
use crate::import::poses::{Pose, load_poses};
use crate::io::atomic;
use crate::io::gltf::PoseSampling;
use crate::measure::exact_sums::MOST_SAMPLES;
use crate::measure::pose::{Asked, Lighting, PoseCheck, default_lights, pose_check};
use crate::measure::trust::Subject;
use crate::report::pose_check::{PoseCheckReport, pose_ply};
use crate::report::quality::promised_rms;
use crate::report::radiosity_ply::model_of;
use crate::report::text::percent;

/// Distance between vertices at one place of the rest pose, over the diagonal, above which a pose tears the surface.
const TORN: f64 = 1e-4;

#[derive(Clone, Debug, Args)]
pub(super) struct PoseCheckArgs {
    /// Poses: files of the same mesh with its vertices elsewhere (.obj, .gltf, .glb); of a glTF file with an animation, poses of that
    #[arg(required = true, value_name = "POSES")]
    poses: Vec<PathBuf>,
    #[command(flatten)]
    asset: AssetArgs,
    /// A light; repeatable. Without any, a few directions and light from everywhere, each alone
    #[arg(long = "light", value_name = "LIGHT", help_heading = "Light",
        long_help = long_help("Without any, four directions and light from everywhere, each alone."))]
    light: Vec<String>,
    /// Poses of an animation, evenly from its first key to its last
    #[arg(long, value_name = "N", default_value_t = 8, help_heading = "Poses")]
    frames: usize,
    /// Animation, by its name or its number from 0 (default: the first)
    #[arg(long, value_name = "NAME", help_heading = "Poses")]
    animation: Option<String>,
    /// Exit with 6 if a pose is off by more, RMS, such as 2% (default: judge by what the asset promises, and fail with --strict alone)
    #[arg(long, value_name = "E", help_heading = "Poses")]
    max_rms: Option<String>,
    /// Judge what is left with the light of each pose, not what the rest pose shows
    #[arg(long, help_heading = "Poses")]
    relit: bool,
    /// Vertices that are measured at most, evenly spread (default: 512, or all with -o)
    #[arg(long, value_name = "N", help_heading = "Poses")]
    vertices: Option<usize>,
    /// Pieces of the surface that exact sums are over (default: 32,768 to 65,536, or twice the samples of the asset)
    #[arg(long, value_name = "N", help_heading = "Poses")]
    samples: Option<usize>,
    /// Folder for a PLY of each pose with the error of every vertex; made where it is not there
    #[arg(short, long, value_name = "DIR", help_heading = "Poses")]
    output: Option<PathBuf>,
}

/// Vertices that are measured where nobody says how many.
const VERTICES: usize = 512;

pub(super) fn run(args: &PoseCheckArgs, console: &Console) -> Result<ExitCode> {
    let max_rms = args.max_rms.as_deref().map(|text| share(text, "--max-rms")).transpose()?;
    let vertices = args.vertices.map(|count| in_range("--vertices", count, 1..=u32::MAX as usize)).transpose()?;
    let samples = args.samples.map(|count| in_range("--samples", count, 1..=MOST_SAMPLES)).transpose()?;
    if args.output.is_some() && vertices.is_some() {
        return Err(Error::command_line("-o: files have the error of every vertex; leave out --vertices"));
    }
    let frames = in_range("--frames", args.frames, 1..=10_000)?;
    let sampling = PoseSampling { frames, animation: args.animation.as_deref() };
    let asked_lights = match args.light.is_empty() {
        true => None,
        false => Some(LightArgs { light: args.light.clone() }.load(console)?),
    };
    let (mut opened, asset) = args.asset.open_beside(console)?;
    if opened.provenance.origin.is_refined() {
        return Err(Error::unsupported(format!(
            "{}: the mesh of the asset was refined and has more vertices than the poses of its model: bake without --refine",
            args.asset.asset.display()
        )));
    }
    let good_below = max_rms.unwrap_or_else(|| {
        promised_rms(&opened.provenance.origin.notes, &asset.ledger, opened.asked_rms().unwrap_or(0.0))
    });
    let evaluator = opened.evaluator.as_mut();
    let (poses, mut inputs) = args.load(evaluator, opened.provenance.origin.mm_per_source_unit, sampling, console)?;
    if let Some(lights) = &asked_lights {
        inputs.extend(lights.inputs.iter().cloned());
    }
    let lights = lightings(asked_lights, evaluator, console)?;
    let materials: Vec<String> = evaluator.scene().media.iter().map(|medium| medium.name.clone()).collect();
    let rest = evaluator.scene().mesh.clone();
    let admit = |more: u64| console.check_memory(more, TOO_MUCH);
    let subject = Subject { evaluator, asset: &asset, profile: args.asset.loaded_profile()?, admit: &admit };
    let (keeps_vertices, most) = match args.output {
        Some(_) => (true, None),
        None => (false, Some(vertices.unwrap_or(VERTICES))),
    };
    let positions: Vec<_> = poses.iter().map(|pose| (pose.name(), pose.positions.clone())).collect();
    let asked = Asked { good_below, vertices: most, samples, keeps_vertices };
    let check = pose_check(subject, &positions, &lights, asked, console)?;
    for (pose, error) in poses.iter().zip(&check.poses) {
        let torn = error.deformation.torn_mm;
        if torn > TORN * rest.diagonal_mm() {
            let name = pose.name();
            console.warn(&format!(
                "{name}: the pose tears the surface: vertices at one place are {torn:.3} mm apart in it"
            ));
        }
    }
    let outputs = args.output.as_deref().map_or(Ok(Vec::new()), |folder| {
        console.stage("write", || {
            let write = |(index, pose): (usize, &Pose)| -> Result<PathBuf> {
                let path = folder.join(format!("{index:03}_{}.ply", stem(&pose.file)));
                let of_pose = check.poses.get(index).map(|error| &error.vertices);
                let of_pose = of_pose.ok_or_else(|| Error::runtime("a pose that was not measured"))?;
                let mesh = rest.in_pose(&pose.positions);
                atomic::write(&path, &pose_ply(&mesh, (&pose.name(), &check.lights), of_pose)?)?;
                Ok(path)
            };
            std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, &e))?;
            poses.iter().enumerate().map(write).collect::<Result<Vec<_>>>()
        })
    })?;
    let origin = (opened.provenance.method.clone(), model_of(&opened.provenance).to_owned(), materials);
    let report = PoseCheckReport::new(&check, &poses, origin, inputs, &outputs);
    console.show("pose-check", &report)?;
    args.judge(&check, &report, max_rms, console)
}

impl PoseCheckArgs {
    /// Reads all poses in the unit of the asset's source, and the files that they are from.
    fn load(
        &self,
        evaluator: &dyn Evaluator,
        mm_per_unit: f64,
        sampling: PoseSampling<'_>,
        console: &Console,
    ) -> Result<(Vec<Pose>, Vec<Input>)> {
        let mesh = &evaluator.scene().mesh;
        let (mut poses, mut inputs) = (Vec::new(), Vec::new());
        for file in &self.poses {
            let read = load_poses(file, (mesh, mm_per_unit), sampling, console)?;
            let name = file.display();
            read.warnings.iter().for_each(|warning| console.warn(&format!("{name}: {warning}")));
            if let Some(animation) = &read.animation {
                console.note(&format!("{name}: {} poses of the animation '{animation}'", read.poses.len()));
            }
            for file in files_of(file)? {
                inputs.push(Input::read(&file)?);
            }
            poses.extend(read.poses);
        }
        Ok((poses, inputs))
    }

    /// Fails where a pose is off by more than was asked for, or with `--strict` by more than the asset promises.
    fn judge(
        &self,
        check: &PoseCheck,
        report: &PoseCheckReport,
        max_rms: Option<f64>,
        console: &Console,
    ) -> Result<ExitCode> {
        let rms =
            |index: usize| check.poses.get(index).map_or(0.0, |p| if self.relit { p.relit.rms } else { p.shown.rms });
        let worst = (0..check.poses.len()).reduce(|a, b| if rms(b) > rms(a) { b } else { a });
        let Some((worst, name)) = worst.and_then(|index| Some((index, &report.poses.get(index)?.name))) else {
            return Ok(ExitCode::Ok);
        };
        let fails = max_rms.is_some() || console.global.strict;
        if !fails || rms(worst) <= check.good_below {
            return Ok(ExitCode::Ok);
        }
        let (off, how) = (percent(rms(worst)), if self.relit { "with its own light" } else { "as shown" });
        let limit = percent(check.good_below);
        Err(Error::new(ExitCode::QualityNotMet, format!("{name} is {off} off {how}, more than {limit}")))
    }
}

/// The lights of the command line together, or the default ones each alone.
fn lightings(asked: Option<ResolvedLights>, evaluator: &mut dyn Evaluator, console: &Console) -> Result<Vec<Lighting>> {
    if let Some(ResolvedLights { lights, text, .. }) = asked {
        warn_of_places(evaluator.scene(), &lights, evaluator.cost().samples, console);
        return Ok(vec![Lighting { name: text.join(" "), lights }]);
    }
    let mut refused = Vec::new();
    let lights = default_lights(evaluator, &mut refused)?;
    if !refused.is_empty() {
        console.note(&format!("not tried, since the asset does not carry it: {}", refused.join(", ")));
    }
    Ok(lights)
}

/// Name of a file without its folder and its suffix.
fn stem(path: &Path) -> String {
    path.file_stem().map_or_else(|| "pose".to_owned(), |stem| stem.to_string_lossy().into_owned())
}
