//! `translux render A.tlux --light L -o I.exr -o I.png`.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use serde::Serialize;

use super::console::{Console, percent, significant};
use super::lights::{LightArgs, ResolvedLights};
use super::opened::{AssetArgs, Opened};
use super::{output, report};
use crate::asset::Input;
use crate::error::{ExitCode, Result};
use crate::evaluate::{Cost, Evaluator};
use crate::io::atomic;
use crate::render::background::Background;
use crate::render::camera::Resolution;
use crate::render::camera_text::CameraSpec;
use crate::render::exit::ExitFresnel;
use crate::render::film::{Exposure, PngBackground, to_exr, to_png};
use crate::render::frame::{
    DEFAULT_SAMPLES_PER_PIXEL, Frame, MAX_SAMPLES_PER_PIXEL, RenderSettings, memory_bytes, render,
};

/// Share of hits on back sides above which a picture needs an explanation.
const BACK_FACING_WARNING: f64 = 0.01;

#[derive(Clone, Debug, Args)]
pub(super) struct RenderArgs {
    #[command(flatten)]
    asset: AssetArgs,
    #[command(flatten)]
    lights: LightArgs,
    #[command(flatten)]
    picture: PictureArgs,
    /// Picture to write (.exr: linear radiance with auxiliary layers; .png: exposed), `-` for OpenEXR on standard output;
    /// repeatable
    #[arg(short, long, required = true, value_name = "FILE")]
    output: Vec<PathBuf>,
}

/// How a picture is made.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Picture")]
pub(super) struct PictureArgs {
    /// Eye, target, up and vertical degrees, in mm, as at=0,8,75:look=0,0,0:up=0,1,0:fov=28; every key may be left out
    /// (default: the whole object from the front, slightly above)
    #[arg(long, value_name = "CAMERA")]
    camera: Option<CameraSpec>,
    /// Pixels
    #[arg(long, value_name = "WIDTHxHEIGHT", default_value = "1024x1024")]
    resolution: Resolution,
    /// Eye rays through each pixel
    #[arg(long, value_name = "N", default_value_t = DEFAULT_SAMPLES_PER_PIXEL,
        value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_SAMPLES_PER_PIXEL)))]
    samples_per_pixel: u32,
    /// Brightness of PNG pictures: auto (the 99.5th percentile of the object becomes white) or stops
    #[arg(long, value_name = "auto|EV", default_value = "auto", allow_hyphen_values = true)]
    exposure: Exposure,
    /// Normalisation of the exit Fresnel factor
    #[arg(long, default_value = "normalised")]
    exit_fresnel: ExitFresnelArg,
    /// What is seen beside the object: env (environments and constant lights), none (transparent in PNG) or R,G,B
    #[arg(long, value_name = "env|none|RGB", default_value = "env")]
    background: Background,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum ExitFresnelArg {
    /// All that leaves adds up to the radiosity
    Normalised,
    /// As in the papers (C = 1): darker
    Paper,
}

/// Figures of a picture.
#[derive(Serialize)]
pub(super) struct RenderReport {
    method: String,
    materials: Vec<String>,
    lights: Vec<String>,
    inputs: Vec<Input>,
    outputs: Vec<PathBuf>,
    /// As it would be typed.
    camera: String,
    resolution: Resolution,
    samples_per_pixel: u32,
    exit_fresnel: ExitFresnel,
    background: String,
    /// As asked for, and the factor that it became; PNG only.
    exposure: String,
    exposure_factor: f64,
    /// Share of the picture that the object covers.
    coverage: f64,
    /// Share of the hits on back sides, which are black.
    back_facing_share: f64,
    cost: Cost,
}

pub(super) fn run(args: &RenderArgs, console: &Console) -> Result<ExitCode> {
    output::check(&args.output, &["exr", "png"], console)?;
    args.picture.check_memory(console)?;
    let lights = args.lights.load(console)?;
    let Opened { method, mut evaluator, .. } = args.asset.open(console)?;
    let result = finish(evaluator.as_mut(), method.name(), lights, &args.picture, &args.output, console)?;
    report::print(console, "render", &result)?;
    Ok(ExitCode::Ok)
}

impl PictureArgs {
    /// The defaults at a resolution.
    pub(super) fn at(resolution: Resolution) -> Self {
        Self {
            camera: None,
            resolution,
            samples_per_pixel: DEFAULT_SAMPLES_PER_PIXEL,
            exposure: Exposure::Auto,
            exit_fresnel: ExitFresnelArg::Normalised,
            background: Background::Environment,
        }
    }

    fn check_memory(&self, console: &Console) -> Result<()> {
        let needed = memory_bytes(self.resolution);
        let share = (console.max_memory as f64 / needed as f64).sqrt();
        let side = |n: usize| ((n as f64 * share) as usize).max(1);
        let fitting = format!("{}x{}", side(self.resolution.width), side(self.resolution.height));
        console.check_memory(needed, &format!("--resolution {fitting} would fit, or raise --max-memory"))
    }

    fn settings(&self, evaluator: &dyn Evaluator) -> Result<RenderSettings> {
        let spec = self.camera.unwrap_or_default();
        Ok(RenderSettings {
            camera: spec.resolve(&evaluator.scene().mesh, self.resolution)?,
            resolution: self.resolution,
            samples_per_pixel: self.samples_per_pixel,
            exit_fresnel: match self.exit_fresnel {
                ExitFresnelArg::Normalised => ExitFresnel::Normalised,
                ExitFresnelArg::Paper => ExitFresnel::Paper,
            },
            background: self.background,
        })
    }
}

/// Lights an evaluator, renders it and writes the pictures.
pub(super) fn finish(
    evaluator: &mut dyn Evaluator,
    method: &str,
    lights: ResolvedLights,
    picture: &PictureArgs,
    outputs: &[PathBuf],
    console: &Console,
) -> Result<RenderReport> {
    let settings = picture.settings(evaluator)?;
    evaluator.set_lights(lights.lights.clone(), console)?;
    let radiosity = evaluator.radiosity(console)?;
    let frame = render(evaluator, &radiosity, &lights.lights, &settings, console)?;
    let result = RenderReport {
        method: method.to_owned(),
        materials: evaluator.scene().media.iter().map(|m| m.name.clone()).collect(),
        lights: lights.text,
        inputs: lights.inputs,
        outputs: outputs.to_vec(),
        camera: settings.camera.to_string(),
        resolution: settings.resolution,
        samples_per_pixel: settings.samples_per_pixel,
        exit_fresnel: settings.exit_fresnel,
        background: settings.background.to_string(),
        exposure: picture.exposure.to_string(),
        exposure_factor: picture.exposure.factor(&frame),
        coverage: frame.pixels.iter().map(|p| f64::from(p.coverage)).sum::<f64>() / frame.pixels.len() as f64,
        back_facing_share: frame.back_facing_share,
        cost: evaluator.cost(),
    };
    explain(&result, console);
    console.stage("write", || write(&frame, &settings, &result, outputs))?;
    Ok(result)
}

/// What a person should know about a picture that may not look as expected.
fn explain(result: &RenderReport, console: &Console) {
    console.note(&format!("CAMERA {} | exposure {}", result.camera, significant(result.exposure_factor)));
    if result.coverage == 0.0 {
        console.warn("the camera does not see the object; leave --camera out to see the whole of it");
    }
    if result.back_facing_share > BACK_FACING_WARNING {
        console.warn(&format!(
            "{} of what the camera sees of the object is its inside, which is black: the camera stands in it, or the mesh is open",
            percent(result.back_facing_share)
        ));
    }
}

/// Writes the picture in the format of each name; each format is encoded once.
fn write(frame: &Frame, settings: &RenderSettings, result: &RenderReport, outputs: &[PathBuf]) -> Result<()> {
    let is_png = |path: &&PathBuf| output::suffix(path) == "png";
    let (png, exr): (Vec<&PathBuf>, Vec<&PathBuf>) = outputs.iter().partition(is_png);
    let background = match settings.background {
        Background::None => PngBackground::Transparent,
        Background::Environment | Background::Colour(_) => PngBackground::Shown,
    };
    write_all(&exr, || to_exr(frame, attributes(result)))?;
    write_all(&png, || to_png(frame, result.exposure_factor, background))
}

fn write_all(paths: &[&PathBuf], encode: impl FnOnce() -> Result<Vec<u8>>) -> Result<()> {
    if paths.is_empty() {
        return Ok(());
    }
    let bytes = encode()?;
    paths.iter().try_for_each(|path: &&PathBuf| atomic::write(Path::new(path), &bytes))
}

/// Text attributes of an OpenEXR picture: all that determines it, no time and no path of the asset.
fn attributes(result: &RenderReport) -> Vec<(String, String)> {
    let exit_fresnel = match result.exit_fresnel {
        ExitFresnel::Normalised => "normalised",
        ExitFresnel::Paper => "paper",
    };
    [
        ("software", format!("translux {}", env!("CARGO_PKG_VERSION"))),
        ("method", result.method.clone()),
        ("material", result.materials.join("; ")),
        ("lights", result.lights.join("; ")),
        ("camera", result.camera.clone()),
        ("samplesPerPixel", result.samples_per_pixel.to_string()),
        ("exitFresnel", exit_fresnel.to_owned()),
        ("background", result.background.clone()),
        ("units", "radiance: linear sRGB; depth: mm along the viewing axis, infinite beside the object".to_owned()),
    ]
    .into_iter()
    .map(|(name, value)| (name.to_owned(), value))
    .collect()
}
