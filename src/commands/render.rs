//! `translux render A.tlux --light L -o I.exr -o I.png`.

use std::path::PathBuf;

use clap::{Args, FromArgMatches, ValueEnum};
use glam::DVec3;

use super::console::Console;
use super::evaluate::map;
use super::exitance::ExitanceArg;
use super::lights::{LightArgs, ResolvedLights, warn_of_places};
use super::opening::{AssetArgs, Opened};
use super::output;
use super::view::{ViewArgs, check_memory};
use crate::error::{Error, ExitCode, Result};
use crate::evaluate::Evaluator;
use crate::evaluate::exitance::Exitance;
use crate::import::file::{Input, suffix};
use crate::measure::trust::Trust;
use crate::medium::look::parse_colour;
use crate::render::camera::Resolution;
use crate::render::exit::ExitFresnel;
use crate::render::film::{ColourType, to_exr_with, to_toned_png};
use crate::render::frame::{
    DEFAULT_OPAQUE, DEFAULT_SAMPLES_PER_PIXEL, ExitanceAt, Frame, Ground, MAX_SAMPLES_PER_PIXEL, RenderSettings, render,
};
use crate::render::single::{Scattered, Single};
use crate::render::texture::Texture;
use crate::render::tone::Tone;
use crate::report::picture::RenderReport;
use crate::report::text::{percent, significant};
use crate::report::trust::TrustReport;
use crate::report::trust_picture::TrustPicture;

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
    /// repeatable [default: NAME.render.png in this folder, by the name of the asset]
    #[arg(short, long, value_name = "FILE")]
    output: Vec<PathBuf>,
    /// A further layer: trust, what is expected of the error of each place under probe lights. PNG then shows its false colours, with a
    /// legend
    #[arg(long, value_name = "LAYER")]
    aov: Option<Aov>,
}

/// Layers that are made when they are asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Aov {
    /// Where the asset is wrong
    Trust,
}

/// How a picture is made.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Picture")]
pub(super) struct PictureArgs {
    #[command(flatten)]
    view: ViewArgs,
    /// Pixels
    #[arg(long, value_name = "WIDTHxHEIGHT", default_value = "1024x1024")]
    resolution: Resolution,
    /// Eye rays through each pixel
    #[arg(long, value_name = "N", default_value_t = DEFAULT_SAMPLES_PER_PIXEL,
        value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_SAMPLES_PER_PIXEL)))]
    samples_per_pixel: u32,
    #[command(flatten)]
    exitance: ExitanceArg,
    /// Normalisation of the exit Fresnel factor
    #[arg(long, default_value = "normalised")]
    exit_fresnel: ExitFresnel,
    /// Tone curve of PNG: none (what is brighter than white is cut off), filmic (Hable's), agx (bright colours turn pale).
    /// OpenEXR stays linear
    #[arg(long, value_name = "none|filmic|agx", default_value_t)]
    tone: Tone,
    /// Colour of opaque parts: '#808080' (sRGB), or linear R,G,B [default: 0.5]; the base colours of a --texture with a file
    /// take its place
    #[arg(long, value_name = "COLOR", value_parser = parse_colour)]
    opaque_color: Option<DVec3>,
    /// A level plane under the object that catches its shadow: the background is darkened by the share of the light that the
    /// object takes away. It sends no light to the object
    #[arg(long)]
    ground: bool,
    /// Add light that crosses thin parts without being scattered: skies and area lights seen through the object, refracted; a layer
    /// `straight` in OpenEXR
    #[arg(long)]
    straight_through: bool,
    /// How OpenEXR pictures store colours; data (normal, depth, coverage, part) always have 32 bits
    #[arg(long, value_name = "TYPE", default_value = "half")]
    exr_type: ColourType,
    /// Files that the asset was made from, for the header of OpenEXR pictures.
    #[arg(skip)]
    sources: Vec<Input>,
    /// Where the asset is wrong, if that is shown.
    #[arg(skip)]
    trust: Option<Trust>,
}

pub(super) fn run(args: &RenderArgs, console: &Console) -> Result<ExitCode> {
    let mut outputs = args.output.clone();
    if outputs.is_empty() {
        // Not NAME.png, which may be the texture of a model.
        let name = args.asset.asset.file_stem().unwrap_or_default().to_string_lossy();
        outputs.push(format!("{name}.render.png").into());
    }
    output::check(&outputs, &["exr", "png"], console)?;
    check_memory(args.picture.resolution, 1, console)?;
    args.picture.view.specular()?;
    args.picture.view.camera()?;
    let lights = args.lights.load(console)?;
    let (Opened { provenance, mut evaluator }, asset) = args.asset.open_beside(console)?;
    let trust = match args.aov {
        Some(Aov::Trust) => Some(map(&args.asset, &asset, evaluator.as_mut(), console)?),
        None => None,
    };
    drop(asset);
    let texture = args.picture.view.texture(args.asset.base_colours());
    let view = args.picture.view.with_texture(texture);
    let picture = PictureArgs { view, sources: provenance.origin.inputs.clone(), trust, ..args.picture.clone() };
    let (result, _) = finish(evaluator.as_mut(), &provenance.method, lights, &picture, &outputs, console)?;
    if args.output.is_empty() {
        outputs.iter().for_each(|path| console.note(&format!("{}", path.display())));
    }
    console.report("render", &result)
}

impl PictureArgs {
    /// The arguments as they would be typed, the others by default.
    pub(super) fn of(words: [&str; 4]) -> Result<Self> {
        let command = Self::augment_args(clap::Command::new("picture").no_binary_name(true));
        let matches = command.try_get_matches_from(words);
        let parsed = matches.and_then(|matches| Self::from_arg_matches(&matches));
        parsed.map_err(|e| Error::runtime(format!("picture: {e}")))
    }

    fn settings(&self, evaluator: &dyn Evaluator) -> Result<RenderSettings> {
        let (samples_per_pixel, exit_fresnel) = (self.samples_per_pixel, self.exit_fresnel);
        let settings = self.view.settings(&evaluator.scene().mesh, self.resolution)?;
        let opaque = Some(self.opaque_color.unwrap_or(DVec3::splat(DEFAULT_OPAQUE)));
        let ground = if self.ground { Ground::Shadow } else { Ground::None };
        let straight = self.straight_through;
        Ok(RenderSettings { samples_per_pixel, exit_fresnel, opaque, ground, straight, ..settings })
    }
}

/// Lights an evaluator, renders it and writes the pictures; returns the report and the picture.
pub(super) fn finish(
    evaluator: &mut dyn Evaluator,
    method: &str,
    lights: ResolvedLights,
    picture: &PictureArgs,
    outputs: &[PathBuf],
    console: &Console,
) -> Result<(RenderReport, Frame)> {
    let mut settings = picture.settings(evaluator)?;
    let texture = picture.view.load_texture(&evaluator.scene().mesh, console)?;
    warn_of_places(evaluator.scene(), &lights.lights, evaluator.cost().samples, console);
    evaluator.set_lights(lights.lights.clone(), console)?;
    let coarseness = picture.exitance.measure(evaluator, console)?;
    let at = coarseness.prepare(evaluator, console)?;
    coarseness.tell(at, console);
    let of_vertices = match at {
        ExitanceAt::Vertices => Some(evaluator.radiosity(console)?),
        ExitanceAt::Pixels => None,
    };
    let shown = outputs.iter().any(|path| suffix(path) == "png");
    let is_seen = evaluator.towards_eye()?.is_some();
    let per_vertex = if is_seen { None } else { evaluator.single_scattering(console)? };
    let towards_eye = evaluator.towards_eye()?;
    let single = match (&towards_eye, &per_vertex) {
        (Some(eye), _) => Single::TowardsEye(eye.as_ref()),
        (None, Some(values)) => Single::PerVertex(values),
        (None, None) => Single::None,
    };
    let exitance: Box<dyn Exitance> = match of_vertices {
        Some(values) => Box::new(values),
        None => evaluator.exitance_at_points().ok_or_else(|| Error::runtime("exitance at points is missing"))?,
    };
    let scattered = Scattered { exitance: exitance.as_ref(), single, texture: texture.as_ref() };
    if shown {
        settings.white = picture.tone.white() * picture.view.exposure.white(evaluator, scattered, &settings)?;
    }
    let frame = render(evaluator, scattered, &lights.lights, &settings, console)?;
    let single_scattering_paths = towards_eye.as_ref().map(|eye| eye.paths_per_pixel(settings.samples_per_pixel));
    if let Some(paths) = single_scattering_paths.filter(|paths| *paths > 0) {
        console.note(&cost_of_single(&frame, paths));
    }
    drop((towards_eye, exitance));
    let mut result = RenderReport {
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
        highlights: settings.specular.model().map(|model| model.to_string()),
        roughness: settings.specular.roughness(),
        texture: texture.as_ref().map(ToString::to_string),
        exitance: frame.exitance,
        between_vertices: coarseness.between,
        single_scattering: frame.single,
        single_scattering_paths,
        exr_type: picture.exr_type,
        tone: picture.tone,
        ground: picture.ground,
        straight_through: frame.has_straight,
        exposure: picture.view.exposure.to_string(),
        exposure_factor: picture.view.exposure.factor(&frame),
        coverage: frame.pixels.iter().map(|p| f64::from(p.coverage)).sum::<f64>() / frame.pixels.len() as f64,
        back_facing_share: frame.back_facing_share,
        cost: evaluator.cost(),
        trust: picture.trust.as_ref().map(TrustReport::new),
        header: Vec::new(),
    };
    let image = texture.as_ref().and_then(Texture::path).map(Input::read).transpose()?;
    result.header = result.attributes(evaluator.scene(), &picture.sources, image.as_ref());
    result.inputs.extend(image);
    explain(&result, &frame, console);
    let trust = picture.trust.as_ref().map(|trust| TrustPicture::new(trust, evaluator, &settings));
    write((&frame, trust.as_ref()), &settings, &result, outputs, console)?;
    Ok((result, frame))
}

/// The work of single scattering towards the eye, as a number that does not depend on the machine.
fn cost_of_single(frame: &Frame, paths_per_pixel: u64) -> String {
    let covered = frame.pixels.iter().filter(|p| p.coverage > 0.0).count() as f64;
    format!(
        "single scattering: {paths_per_pixel} paths for each of {covered} pixels, {} million in all, one or two rays each",
        significant(covered * paths_per_pixel as f64 * 1e-6)
    )
}

/// Prints notes and warnings about a picture that may not look as expected.
fn explain(result: &RenderReport, frame: &Frame, console: &Console) {
    result.trust.iter().for_each(|trust| console.note(&trust.line()));
    let (camera, factor, stops) = (&result.camera, result.exposure_factor, result.exposure_factor.log2());
    console.note(&format!("CAMERA {camera} | exposure {} (--exposure {stops:.2} keeps it)", significant(factor)));
    if result.coverage == 0.0 {
        console.warn("the camera does not see the object; leave --camera out to see the whole of it");
    }
    if result.back_facing_share > BACK_FACING_WARNING {
        console.warn(&format!(
            "{} of what the camera sees of the object is its inside, which is black: the camera stands in it, or the mesh is open",
            percent(result.back_facing_share)
        ));
    }
    let cut = result.exr_type.cut_pixels(frame);
    if cut > 0 && result.outputs.iter().any(|path| suffix(path) != "png") {
        let pixels = if cut == 1 { "1 pixel has".to_owned() } else { format!("{cut} pixels have") };
        console.warn(&format!("{pixels} colours above 65504, which 16 bits cut there; --exr-type float keeps them"));
    }
}

/// Writes the picture in the format of each name; each format is encoded once. With a map of where the asset is wrong OpenEXR has its
/// layer, and PNG shows it.
fn write(
    (frame, trust): (&Frame, Option<&TrustPicture>),
    settings: &RenderSettings,
    result: &RenderReport,
    outputs: &[PathBuf],
    console: &Console,
) -> Result<()> {
    let (png, exr): (Vec<&PathBuf>, Vec<&PathBuf>) = outputs.iter().partition(|path| suffix(path) == "png");
    output::write(&exr, console, || {
        let more = trust.map(TrustPicture::layer).into_iter().collect();
        to_exr_with(frame, result.exr_type, result.header.clone(), more)
    })?;
    output::write(&png, console, || match trust {
        Some(trust) => trust.to_png(),
        None => to_toned_png(frame, (result.exposure_factor, result.tone), settings.background),
    })
}
