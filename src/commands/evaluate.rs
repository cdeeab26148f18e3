//! `translux evaluate A.tlux --light L -o B.ply`.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use glam::DVec3;

use super::console::Console;
use super::device::DeviceArg;
use super::light_map::{LightMap, SIDE, check_side};
use super::lights::{LightArgs, ResolvedLights, warn_of_places};
use super::media::without_transport;
use super::opening::AssetArgs;
use super::{on_mesh, output};
use crate::asset::Asset;
use crate::compress::ledger::Ledger;
use crate::error::{Error, ExitCode, Result};
use crate::evaluate::{Evaluator, SingleScattering};
use crate::import::file::suffix;
use crate::measure::probes::by_stage;
use crate::measure::trust::{Subject, Trust, trust};
use crate::report::evaluation::{EvaluationReport, RadiosityReport, mean_and_max};
use crate::report::export::radiosity_attributes;
use crate::report::radiosity_ply::{
    CALIBRATED, DIPOLE, SINGLE_INCLUDED, Single, comments, model_of, radiosity_ply_with,
};
use crate::report::text::{duration, percent};
use crate::report::trust::{TrustReport, columns, comments as of_trust};

/// What to do where the memory limit does not allow exact sums.
pub(super) const TOO_MUCH: &str =
    "the exact sums that errors are measured against take it; raise --max-memory, or measure a smaller asset";

#[derive(Clone, Debug, Args)]
pub(super) struct EvaluateArgs {
    #[command(flatten)]
    asset: AssetArgs,
    #[command(flatten)]
    lights: LightArgs,
    /// PLY to write, `-` for standard output, or OpenEXR with a texture of the surface; repeatable
    #[arg(short, long, required = true, value_name = "FILE")]
    output: Vec<PathBuf>,
    #[arg(long, value_name = "N", help = format!("Texels of a side of the texture [default: {SIDE}]"))]
    texture: Option<u32>,
    #[arg(long, value_name = "MODEL", help = format!("Another mesh of the same object in the same units, such as a coarser \
        level of detail: radiosity is gathered at its vertices. {}", without_transport()))]
    on: Option<PathBuf>,
    /// Where to compute
    #[arg(long, default_value = "cpu")]
    device: DeviceArg,
    /// Measure the error and report it
    #[arg(long)]
    measure: bool,
    /// Write where the asset is wrong beside the radiosity: columns trust_* with the error of each vertex under probe lights
    #[arg(long)]
    trust: bool,
}

/// Where radiosity goes, and what its error is held against.
pub(super) struct Radiosity<'a> {
    pub(super) method: &'a str,
    /// Model of the light inside.
    pub(super) model: &'a str,
    pub(super) outputs: &'a [PathBuf],
    /// Texels of a side of the texture, if one is written.
    pub(super) texture: Option<u32>,
    /// Whether the error is measured.
    pub(super) measure: bool,
    pub(super) asked_rms: Option<f64>,
    /// Where the asset is wrong, if that is written beside it.
    pub(super) trust: Option<Trust>,
}

pub(super) fn run(args: &EvaluateArgs, console: &Console) -> Result<ExitCode> {
    output::check(&args.output, if args.on.is_some() { &["ply"] } else { &["ply", "exr"] }, console)?;
    let texture = args.output.iter().any(|path| is_texture(path)).then(|| args.texture.unwrap_or(SIDE));
    match (texture, args.texture) {
        (Some(side), _) => check_side("--texture", side, console)?,
        (None, Some(_)) => return Err(Error::command_line("--texture: no -o is a texture (.exr)")),
        (None, None) => {}
    }
    let lights = args.lights.load(console)?;
    if let Some(model) = &args.on {
        if args.device != DeviceArg::Cpu {
            return Err(Error::unsupported("--on: other meshes are evaluated on the CPU; use --device cpu"));
        }
        if args.trust {
            return Err(Error::command_line("--trust: the map is of the asset's own vertices; leave out --on"));
        }
        if args.measure {
            return Err(Error::command_line("--measure: with --on, errors of the other mesh are always measured"));
        }
        let opened = args.asset.open(console)?;
        return on_mesh::run(model, opened.evaluator, &opened.provenance, (lights, &args.output), console);
    }
    let (mut opened, asset) = args.asset.open_beside(console)?;
    let trust = args.trust.then(|| map(&args.asset, &asset, opened.evaluator.as_mut(), console)).transpose()?;
    drop(asset);
    let (provenance, asked_rms) = (opened.provenance.clone(), opened.asked_rms());
    let (method, model) = (provenance.method.as_str(), model_of(&provenance));
    let mut evaluator = args.device.place(opened.evaluator, console)?;
    let wanted = Radiosity { method, model, outputs: &args.output, texture, measure: args.measure, asked_rms, trust };
    finish("evaluate", evaluator.as_mut(), lights, &wanted, console)
}

fn is_texture(path: &Path) -> bool {
    suffix(path) == "exr"
}

/// Measures where an asset is wrong, with the materials and the profile of the command line.
pub(super) fn map(args: &AssetArgs, asset: &Asset, evaluator: &mut dyn Evaluator, console: &Console) -> Result<Trust> {
    let admit = |more: u64| console.check_memory(more, TOO_MUCH);
    trust(Subject { evaluator, asset, profile: args.loaded_profile()?, admit: &admit }, console)
}

/// Lights an evaluator, writes its radiosity, measures its error, and reports it all for a command.
pub(super) fn finish(
    command: &str,
    evaluator: &mut dyn Evaluator,
    lights: ResolvedLights,
    wanted: &Radiosity,
    console: &Console,
) -> Result<ExitCode> {
    let &Radiosity { method, model, outputs, texture, measure, asked_rms, ref trust } = wanted;
    if texture.is_some() && evaluator.single_scattering_is() != SingleScattering::None {
        return Err(Error::unsupported(
            "-o: single scattering is a value of its own at each vertex, which a texture has not; `export --as lightmap` writes the sum",
        ));
    }
    warn_of_places(evaluator.scene(), &lights.lights, evaluator.cost().samples, console);
    evaluator.set_lights(lights.lights, console)?;
    let radiosity = evaluator.radiosity(console)?;
    let single = single_scattering(evaluator, console)?;
    let (textures, tables): (Vec<&PathBuf>, Vec<&PathBuf>) = outputs.iter().partition(|path| is_texture(path));
    output::write(&tables, console, || {
        let scene = evaluator.scene();
        let mut comments = comments(method, scene, &lights.text);
        if model != DIPOLE {
            comments.push(CALIBRATED.to_owned());
        }
        if single.is_some() {
            comments.push("s is single scattering along the inverse normal, b does without it".to_owned());
        }
        if evaluator.single_scattering_is() == SingleScattering::Included {
            comments.push(SINGLE_INCLUDED.to_owned());
        }
        comments.extend(trust.iter().flat_map(of_trust));
        let single = single.as_deref().map_or(Single::None, Single::Beside);
        radiosity_ply_with(&scene.mesh, (&radiosity, single), trust.as_ref().map(columns).unwrap_or_default(), comments)
    })?;
    let texture = texture.map(|side| LightMap::new(evaluator, side, console)).transpose()?;
    let materials: Vec<String> = evaluator.scene().media.iter().map(|medium| medium.name.clone()).collect();
    if let Some(lit) = &texture {
        output::write(&textures, console, || lit.map.to_exr(radiosity_attributes(method, &materials, &lights.text)))?;
    }
    let texture = texture.as_ref().map(LightMap::report);
    if let Some(texture) = &texture {
        console.note(&texture.line());
        if !texture.own_coordinates {
            console.note("`export --as lightmap` writes these coordinates, with the model and the same texture");
        }
    }
    let trust = trust.as_ref().map(TrustReport::new);
    trust.iter().for_each(|trust| console.note(&trust.line()));
    // Errors are relative to the radiosity: where that is black there is none to tell.
    let black = radiosity.iter().all(|b| *b == DVec3::ZERO);
    if black {
        console.note("no light arrives: the radiosity is 0 everywhere");
    }
    let measured = if measure && !black { by_stage(evaluator, console)? } else { Ledger::default() };
    for entry in &measured.entries {
        let [rms, worst] = [entry.error.rms, entry.error.worst].map(percent);
        console.note(&format!("{} error: {rms} RMS, {worst} worst vertex ({})", entry.stage, entry.note));
    }
    let areas = evaluator.scene().vertex_areas_mm2();
    let without_area = areas.iter().filter(|area| **area == 0.0).count();
    if without_area > 0 {
        console.note(&format!("{without_area} vertices have no translucent area around them; their radiosity is 0"));
    }
    let (mean_single, max_single) = single.as_deref().map(mean_and_max).unzip();
    let verdict = console.judge(measured.total_rms(), asked_rms);
    let report = EvaluationReport {
        method: method.to_owned(),
        model: model.to_owned(),
        radiosity: RadiosityReport::new((lights.text, lights.inputs), outputs, &radiosity, without_area),
        mean_single_scattering: mean_single,
        max_single_scattering: max_single,
        cost: evaluator.cost(),
        asked_rms,
        measured,
        trust,
        texture,
    };
    console.report(command, &report)?;
    verdict
}

/// Single scattering of each vertex, where there is any; reports the time it took.
fn single_scattering(evaluator: &mut dyn Evaluator, console: &Console) -> Result<Option<Vec<DVec3>>> {
    let started = Instant::now();
    let single = evaluator.single_scattering(console)?;
    match &single {
        Some(values) => {
            let took = duration(started.elapsed().as_secs_f64());
            console.note(&format!("single scattering of {} vertices: {took}", values.len()));
        }
        None if evaluator.towards_eye()?.is_some() => {
            console.note(
                "single scattering depends on the eye here (g is not 0): it is in pictures, and not in this file",
            );
        }
        None => {}
    }
    Ok(single)
}
