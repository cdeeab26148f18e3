//! `translux evaluate A.tlux --light L -o B.ply`.

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use glam::DVec3;
use serde::Serialize;

use super::console::{Console, Strictness, duration, percent};
use super::device::DeviceArg;
use super::lights::{LightArgs, ResolvedLights};
use super::on_mesh::OtherMesh;
use super::opened::{AssetArgs, Opened};
use super::{output, report};
use crate::compress::ledger::Ledger;
use crate::error::{Error, ExitCode, Result};
use crate::evaluate::{Cost, Evaluator, SingleScattering};
use crate::geometry::mesh::Mesh;
use crate::import::file::Input;
use crate::io::atomic;
use crate::io::colour::srgb_from_linear;
use crate::io::ply::{RadiosityPly, write_ply};
use crate::measure::probes::unseen;
use crate::transport::scene::Scene;

#[derive(Clone, Debug, Args)]
pub(super) struct EvaluateArgs {
    #[command(flatten)]
    asset: AssetArgs,
    #[command(flatten)]
    lights: LightArgs,
    /// PLY to write, `-` for standard output; repeatable
    #[arg(short, long, required = true, value_name = "FILE")]
    output: Vec<PathBuf>,
    /// Another mesh of the same object in the same units, such as a coarser level of detail: radiosity is gathered at its
    /// vertices. For assets that hold no transport (two_pass, reference)
    #[arg(long, value_name = "MODEL")]
    on: Option<PathBuf>,
    /// Where to compute
    #[arg(long, default_value = "cpu")]
    device: DeviceArg,
    /// Measure the error and report it
    #[arg(long)]
    measure: bool,
}

/// Whether to spend time on measuring the error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Measure {
    Yes,
    No,
}

/// Figures of an evaluation.
#[derive(Serialize)]
pub(super) struct EvaluationReport {
    pub(super) method: String,
    pub(super) lights: Vec<String>,
    pub(super) inputs: Vec<Input>,
    #[serde(serialize_with = "report::paths")]
    pub(super) outputs: Vec<PathBuf>,
    pub(super) vertices: usize,
    /// Vertices without transferring area, whose radiosity is 0.
    pub(super) vertices_without_area: usize,
    pub(super) mean_radiosity: [f64; 3],
    pub(super) max_radiosity: [f64; 3],
    /// Beside the radiosity, where the method has it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) mean_single_scattering: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) max_single_scattering: Option<[f64; 3]>,
    pub(super) cost: Cost,
    pub(super) asked_rms: Option<f64>,
    pub(super) measured: Ledger,
}

pub(super) fn run(args: &EvaluateArgs, console: &Console) -> Result<ExitCode> {
    output::check(&args.output, &["ply"], console)?;
    let lights = args.lights.load(console)?;
    let Opened { provenance, evaluator } = args.asset.open(console)?;
    if let Some(model) = &args.on {
        let other = OtherMesh { model, device: args.device, measure: args.measure };
        return other.run(evaluator, &provenance, (lights, &args.output), console);
    }
    let mut evaluator = args.device.place(evaluator, console)?;
    let asked = provenance.settings.get("max-rms").and_then(|t| t.parse().ok());
    let measure = if args.measure { Measure::Yes } else { Measure::No };
    let result = finish(evaluator.as_mut(), &provenance.method, lights, &args.output, measure, asked, console)?;
    let verdict = judge(&result, console);
    report::print(console, "evaluate", &result)?;
    verdict
}

/// Comment of files whose radiosity has single scattering in it.
pub(super) const SINGLE_INCLUDED: &str = "b includes single scattering along the inverse normal";

/// Lights an evaluator, writes its radiosity and measures its error.
pub(super) fn finish(
    evaluator: &mut dyn Evaluator,
    method: &str,
    lights: ResolvedLights,
    outputs: &[PathBuf],
    measure: Measure,
    asked_rms: Option<f64>,
    console: &Console,
) -> Result<EvaluationReport> {
    evaluator.set_lights(lights.lights, console)?;
    let radiosity = evaluator.radiosity(console)?;
    check_range("radiosity", &radiosity)?;
    let single = single_scattering(evaluator, console)?;
    let ply = console.stage("write", || {
        let scene = evaluator.scene();
        let media: Vec<&str> = scene.media.iter().map(|m| m.name.as_str()).collect();
        let mut comments = vec![format!("translux {method}"), format!("material {}", media.join(", "))];
        comments.extend(lights.text.iter().map(|t| format!("light {t}")));
        if single.is_some() {
            comments.push("s is single scattering along the inverse normal, b does without it".to_owned());
        }
        if evaluator.single_scattering_is() == SingleScattering::Included {
            comments.push(SINGLE_INCLUDED.to_owned());
        }
        radiosity_ply(&scene.mesh, &radiosity, single.as_deref(), comments)
    });
    console.stage("write", || -> Result<()> {
        let bytes = write_ply(&ply)?;
        outputs.iter().try_for_each(|path| atomic::write(path, &bytes))
    })?;
    let measured = match measure {
        Measure::Yes => evaluator.measured_error(&unseen(&evaluator.scene().mesh), console)?,
        Measure::No => Ledger::default(),
    };
    for entry in &measured.entries {
        console.note(&format!(
            "{} error: {} RMS, {} worst vertex ({})",
            entry.stage,
            percent(entry.error.rms),
            percent(entry.error.worst),
            entry.note
        ));
    }
    let scene = evaluator.scene();
    let without_area = without_area(scene);
    if without_area > 0 {
        console.note(&format!("{without_area} vertices have no translucent area around them; their radiosity is 0"));
    }
    let (mean, max) = mean_and_max(&radiosity);
    let (mean_single, max_single) = single.as_deref().map(mean_and_max).unzip();
    Ok(EvaluationReport {
        method: method.to_owned(),
        lights: lights.text,
        inputs: lights.inputs,
        outputs: outputs.to_vec(),
        vertices: radiosity.len(),
        vertices_without_area: without_area,
        mean_radiosity: mean,
        max_radiosity: max,
        mean_single_scattering: mean_single,
        max_single_scattering: max_single,
        cost: evaluator.cost(),
        asked_rms,
        measured,
    })
}

/// Single scattering of each vertex, where there is any; says what it took.
fn single_scattering(evaluator: &mut dyn Evaluator, console: &Console) -> Result<Option<Vec<DVec3>>> {
    let started = Instant::now();
    let single = evaluator.single_scattering(console)?;
    match &single {
        Some(values) => {
            check_range("single scattering", values)?;
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

pub(super) fn mean_and_max(values: &[DVec3]) -> ([f64; 3], [f64; 3]) {
    let mean = values.iter().sum::<DVec3>() / values.len().max(1) as f64;
    (mean.to_array(), values.iter().fold(DVec3::ZERO, |a, &b| a.max(b)).to_array())
}

/// Refuses what a 32-bit file cannot hold; sums beyond its range may have become NaN on the way.
pub(super) fn check_range(quantity: &str, values: &[DVec3]) -> Result<()> {
    match values.iter().position(|b| !b.as_vec3().is_finite()) {
        Some(v) => Err(Error::runtime(format!(
            "the {quantity} of vertex {v} is beyond 32-bit floats: a light is too bright, or too near a surface; \
             scale the lights down or move them"
        ))),
        None => Ok(()),
    }
}

/// Warns, or fails where `--strict` asks for it, if the measured error is above the asked one.
pub(super) fn judge(result: &EvaluationReport, console: &Console) -> Result<ExitCode> {
    judge_error(result.measured.total_rms(), result.asked_rms, console)
}

/// The same for any relative RMS.
pub(super) fn judge_error(measured: f64, asked: Option<f64>, console: &Console) -> Result<ExitCode> {
    match asked {
        Some(asked) if measured > asked => {
            let line = format!("measured error {} is above the asked {}", percent(measured), percent(asked));
            if console.strictness == Strictness::Fail {
                return Err(Error::new(ExitCode::QualityNotMet, line));
            }
            console.warn(&line);
            Ok(ExitCode::Ok)
        }
        _ => Ok(ExitCode::Ok),
    }
}

fn without_area(scene: &Scene) -> usize {
    let mut used = vec![false; scene.mesh.local_mm.len()];
    for (triangle, &part) in scene.mesh.triangles.iter().zip(&scene.parts.triangle_part) {
        if scene.parts.parts[part as usize].transfers() {
            for &v in triangle {
                used[v as usize] = true;
            }
        }
    }
    used.iter().filter(|u| !**u).count()
}

/// The PLY of per-vertex radiosity, and of single scattering that is beside it.
pub(super) fn radiosity_ply(
    mesh: &Mesh,
    radiosity: &[DVec3],
    single: Option<&[DVec3]>,
    comments: Vec<String>,
) -> RadiosityPly {
    let narrow = |values: &[DVec3]| -> Vec<[f32; 3]> { values.iter().map(|v| v.as_vec3().to_array()).collect() };
    let colors = match single {
        Some(single) => colours(&radiosity.iter().zip(single).map(|(b, s)| *b + *s).collect::<Vec<_>>()),
        None => colours(radiosity),
    };
    RadiosityPly {
        positions: (0..radiosity.len() as u32).map(|v| mesh.position_mm(v).as_vec3().to_array()).collect(),
        colors,
        b: narrow(radiosity),
        s: single.map(narrow),
        triangles: mesh.triangles.clone(),
        comments,
    }
}

/// Colours for viewers, sRGB: the 99.5th percentile of the brightest channel over lit vertices is white.
fn colours(radiosity: &[DVec3]) -> Vec<[u8; 3]> {
    let mut brightest: Vec<f64> = radiosity.iter().map(|b| b.max_element()).filter(|&b| b > 0.0).collect();
    brightest.sort_unstable_by(f64::total_cmp);
    let rank = (brightest.len() as f64 * 0.995) as usize;
    let white = brightest.get(rank.min(brightest.len().saturating_sub(1))).copied().unwrap_or(1.0);
    let code = |v: f64| (255.0 * srgb_from_linear((v / white).clamp(0.0, 1.0))).round() as u8;
    radiosity.iter().map(|b| b.to_array().map(code)).collect()
}
