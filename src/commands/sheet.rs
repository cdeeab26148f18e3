//! `translux sheet MODEL --materials A,B --sizes 10,30 -o sheet.png`: a contact sheet from one bake whose material and size are
//! free.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use serde::Serialize;

use super::console::Console;
use super::exitance::ExitanceArg;
use super::lights::{LightArgs, ResolvedLights};
use super::media::tell;
use super::model::{self, PlacementArgs};
use super::opening::within_memory;
use super::view::{ViewArgs, check_memory};
use super::{baking, output};
use crate::asset::Asset;
use crate::error::{Error, ExitCode, Result};
use crate::evaluate::Evaluator;
use crate::evaluate::exitance::Exitance;
use crate::geometry::mesh::Scale;
use crate::import::Source;
use crate::import::file::suffix;
use crate::import::materials::{AskedLook, MaterialChoice};
use crate::light::Light;
use crate::medium::inversion::Reflector;
use crate::medium::material::Medium;
use crate::medium::material_file::Chosen;
use crate::render::camera::Resolution;
use crate::render::film::to_toned_png;
use crate::render::frame::{DEFAULT_OPAQUE, ExitanceAt, Frame, Ground, RenderSettings, render};
use crate::render::single::Scattered;
use crate::render::tone::Tone;
use crate::report::materials::MediumReport;
use crate::report::sheet::{LARGEST, Sheet};
use crate::report::sizes::sizes;
use crate::report::text::{megabytes, percent, significant};
use glam::DVec3;

/// The method whose assets hold samples alone.
const METHOD: &str = "editable";

/// Eye rays through each pixel of a cell where nothing is said.
const SAMPLES_PER_PIXEL: u32 = 8;

#[derive(Clone, Debug, Args)]
pub(super) struct SheetArgs {
    /// OBJ, glTF or GLB file; all parts that are not opaque get each material
    model: PathBuf,
    /// Materials of the rows, separated by commas: names (see `translux materials`) or TOML files
    #[arg(long, required = true, value_delimiter = ',', value_name = "MATERIALS")]
    materials: Vec<String>,
    /// Sizes of the columns, separated by commas: diagonals in mm (default: that of --unit, --size-mm or the file)
    #[arg(long, value_delimiter = ',', value_name = "MM")]
    sizes: Vec<f64>,
    /// Lights of a group of columns, separated by `;`, each as --light of other commands; repeatable, a group each (default: the
    /// built-in sky). Lights in mm stay where they are, whatever the size
    #[arg(long, value_name = "LIGHTS")]
    lights: Vec<String>,
    /// Pixels of each picture
    #[arg(long, value_name = "WIDTHxHEIGHT", default_value = "320x320")]
    resolution: Resolution,
    /// Eye rays through each pixel
    #[arg(long, value_name = "N", default_value_t = SAMPLES_PER_PIXEL, value_parser = clap::value_parser!(u32).range(1..=4096))]
    samples_per_pixel: u32,
    /// Tone curve: none, filmic or agx, as in `render`
    #[arg(long, value_name = "none|filmic|agx", default_value_t)]
    tone: Tone,
    /// A level plane under the object that catches its shadow, as in `render`
    #[arg(long)]
    ground: bool,
    #[command(flatten)]
    exitance: ExitanceArg,
    #[command(flatten)]
    view: ViewArgs,
    #[command(flatten)]
    placement: PlacementArgs,
    /// Sheet to write: .png, or .html with the pictures inside; repeatable
    #[arg(short, long, required = true, value_name = "FILE")]
    output: Vec<PathBuf>,
}

/// A picture of a sheet.
#[derive(Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
struct CellReport {
    material: String,
    size_mm: f64,
    lights: Vec<String>,
    /// Where exitance was evaluated.
    exitance: ExitanceAt,
    /// Mean radiosity over the vertices, RGB.
    mean_radiosity: [f64; 3],
}

#[derive(Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct SheetReport {
    outputs: Vec<PathBuf>,
    method: &'static str,
    /// The materials of the rows.
    media: Vec<MediumReport>,
    sizes_mm: Vec<f64>,
    /// Row by row.
    cells: Vec<CellReport>,
    samples: usize,
    bytes: u64,
    bytes_per_vertex: f64,
    /// Error of the bake: largest relative RMS of radiosity, without environments and with them.
    rms: f64,
    rms_with_environments: f64,
    tone: Tone,
    /// Factor on radiance in the pictures of each group of lights.
    exposure_factors: Vec<f64>,
}

/// A row: a material under its name.
struct Row {
    name: String,
    medium: Medium,
}

pub(super) fn run(args: &SheetArgs, console: &Console) -> Result<ExitCode> {
    output::check(&args.output, &["png", "html"], console)?;
    args.view.specular()?;
    args.view.camera()?;
    let rows = rows(&args.materials, console)?;
    let groups = groups(&args.lights, console)?;
    let Resolution { width, height } = args.resolution;
    let cell = [width, height].map(|side| side as u32);
    let letters = rows.iter().map(|row| row.name.chars().count()).max().unwrap_or(0);
    let columns = groups.len() * args.sizes.len().max(1);
    if args.output.iter().any(|path| suffix(path) == "png")
        && Sheet::size(cell, [rows.len(), columns], letters, CAPTION_LINES).is_none()
    {
        return Err(Error::command_line(format!(
            "{} rows and {columns} columns of {width}x{height} are more than {LARGEST} pixels: say a smaller --resolution, or write .html",
            rows.len()
        )));
    }
    check_memory(args.resolution, rows.len() * columns, console)?;
    let asset = Arc::new(bake(args, &rows, &groups, console)?);
    let bytes = sizes(&asset.to_bytes()?)?;
    let sizes_mm = match args.sizes.as_slice() {
        [] => vec![asset.scene.mesh.diagonal_mm()],
        given => given.to_vec(),
    };
    let (frames, cells) = pictures(args, &asset, (&rows, &groups, &sizes_mm), console)?;
    let group_of = |index: usize| index % columns / sizes_mm.len();
    let factor = |group: usize| {
        let shown: Vec<&Frame> =
            frames.iter().enumerate().filter(|(i, _)| group_of(*i) == group).map(|(_, f)| f).collect();
        args.view.exposure.factor_of_all(&shown)
    };
    let exposure_factors: Vec<f64> = (0..groups.len()).map(factor).collect();
    let vertices = asset.scene.mesh.local_mm.len().max(1);
    let report = SheetReport {
        outputs: args.output.clone(),
        method: METHOD,
        media: rows.iter().map(|row| MediumReport::of(&row.medium)).collect(),
        sizes_mm: sizes_mm.clone(),
        cells,
        samples: asset.samples.len(),
        bytes: bytes.file,
        bytes_per_vertex: bytes.stored_without_mesh as f64 / vertices as f64,
        rms: asset.ledger.total_rms_without_environment(),
        rms_with_environments: asset.ledger.total_rms(),
        tone: args.tone,
        exposure_factors: exposure_factors.clone(),
    };
    let caption = caption(&report, &args.model);
    caption.iter().for_each(|line| console.note(line));
    let encode = |(index, frame): (usize, &Frame)| {
        to_toned_png(frame, (exposure_factors[group_of(index)], args.tone), args.view.background)
    };
    let heads = groups.iter().flat_map(|_| sizes_mm.iter().map(|size| format!("{} mm", significant(*size))));
    let sheet = Sheet {
        caption,
        rows: rows.iter().map(|row| row.name.clone()).collect(),
        groups: match args.lights.as_slice() {
            [] => groups.iter().map(|group| group.text.join("; ")).collect(),
            typed => typed.iter().map(|text| without_folders(text)).collect(),
        },
        columns: heads.collect(),
        cells: frames.iter().enumerate().map(encode).collect::<Result<_>>()?,
        cell,
    };
    let (png, html): (Vec<&PathBuf>, Vec<&PathBuf>) = args.output.iter().partition(|path| suffix(path) == "png");
    output::write(&png, console, || sheet.to_png())?;
    let title = args.model.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    output::write(&html, console, || Ok(sheet.to_html(&title).into_bytes()))?;
    console.report("sheet", &report)
}

/// The materials by their names, looks inverted through the dipole.
fn rows(materials: &[String], console: &Console) -> Result<Vec<Row>> {
    let row = |text: &String| {
        let Chosen { material, look } = Chosen::from_argument(text.trim(), &Reflector::default())?;
        let looks: Vec<AskedLook> =
            look.map(|found| AskedLook { name: material.name.clone(), found }).into_iter().collect();
        tell(&looks, console);
        Ok(Row { name: material.name.clone(), medium: material.into() })
    };
    materials.iter().map(row).collect()
}

/// The lights of each group of columns.
fn groups(lights: &[String], console: &Console) -> Result<Vec<ResolvedLights>> {
    let group = |text: &String| {
        let light: Vec<String> =
            text.split(';').map(|one| one.trim().to_owned()).filter(|one| !one.is_empty()).collect();
        if light.is_empty() {
            return Err(Error::command_line(format!("--lights `{text}`: there is no light in it")));
        }
        LightArgs { light }.load(console)
    };
    match lights {
        [] => Ok(vec![LightArgs::default().load(console)?]),
        groups => groups.iter().map(group).collect(),
    }
}

/// Lights as they were typed, files by their names alone.
fn without_folders(lights: &str) -> String {
    let short = |light: &str| match Path::new(light).file_name() {
        Some(name) if !light.contains(':') => name.to_string_lossy().into_owned(),
        _ => light.to_owned(),
    };
    lights.split(';').map(|light| short(light.trim())).collect::<Vec<String>>().join("; ")
}

/// One asset for all rows and columns: of the largest size and the material with the shortest mean free path, which need the most
/// samples.
fn bake(args: &SheetArgs, rows: &[Row], groups: &[ResolvedLights], console: &Console) -> Result<Asset> {
    let shortest = |row: &&Row| row.medium.properties.mean_free_path_mm().min_element();
    let densest = rows.iter().min_by(|a, b| shortest(a).total_cmp(&shortest(b)));
    let at = rows.iter().zip(&args.materials).find(|(row, _)| densest.is_some_and(|d| std::ptr::eq(*row, d)));
    let text = at.map_or("", |(_, text)| text.trim());
    let mut options = args.placement.options(MaterialChoice::plain(text));
    if let Some(largest) = args.sizes.iter().copied().max_by(f64::total_cmp) {
        if options.scale.is_some() {
            return Err(Error::command_line(
                "--sizes and one of --unit, --size-mm, --height-mm both say how large the object is: leave one out",
            ));
        }
        options.scale = Some(Scale::DiagonalMm(largest));
    }
    let source = Source::read(&args.model, &options.materials, console)?;
    let imported = model::import(source, &options, None, console).map_err(|e| e.in_file(&args.model))?;
    let mut recipe = console.registry.method(METHOD)?.default_recipe()?;
    // Rows for environments take most of the time, where there are none.
    recipe.settings.for_lights = groups.iter().flat_map(|group| group.lights.iter().map(Light::kind)).collect();
    baking::bake(recipe, imported, console)
}

/// All pictures, row by row.
fn pictures(
    args: &SheetArgs,
    asset: &Arc<Asset>,
    (rows, groups, sizes_mm): (&[Row], &[ResolvedLights], &[f64]),
    console: &Console,
) -> Result<(Vec<Frame>, Vec<CellReport>)> {
    let texture = args.view.load_texture(&asset.scene.mesh, console)?;
    let columns = groups.len() * sizes_mm.len();
    let mut coarse = Vec::new();
    let mut all: Vec<Option<(Frame, CellReport)>> = (0..rows.len() * columns).map(|_| None).collect();
    for (of_size, &size_mm) in sizes_mm.iter().enumerate() {
        let resized = Arc::new(Asset::clone(asset).resized(size_mm)?);
        let mut evaluator = within_memory(console)(&resized, &args.model)?;
        let settings = settings(args, evaluator.as_ref())?;
        for (row, Row { name, medium }) in rows.iter().enumerate() {
            evaluator.set_media(vec![medium.clone(); resized.scene.media.len()])?;
            let coarseness = args.exitance.measure(evaluator.as_ref(), console)?;
            coarse.extend(coarseness.between.map(|error| error.rms));
            for (of_group, group) in groups.iter().enumerate() {
                evaluator.set_lights(group.lights.clone(), console)?;
                let radiosity = evaluator.radiosity(console)?;
                let at = coarseness.prepare(evaluator.as_mut(), console)?;
                let at_points = match at {
                    ExitanceAt::Vertices => None,
                    ExitanceAt::Pixels => evaluator.exitance_at_points(),
                };
                let exitance: &dyn Exitance = at_points.as_deref().unwrap_or(&radiosity);
                let scattered = Scattered { texture: texture.as_ref(), ..exitance.into() };
                let frame = render(evaluator.as_ref(), scattered, &group.lights, &settings, console)?;
                let mean = radiosity.iter().sum::<DVec3>() / radiosity.len().max(1) as f64;
                let (material, lights) = (name.clone(), group.text.clone());
                let report =
                    CellReport { material, size_mm, lights, exitance: frame.exitance, mean_radiosity: mean.to_array() };
                all[row * columns + of_group * sizes_mm.len() + of_size] = Some((frame, report));
            }
        }
    }
    if let Some(worst) = coarse.iter().copied().reduce(f64::max) {
        console.note(&format!(
            "exitance at pixels in {} of {} pictures: linear over each triangle, light would be up to {} off between vertices, under a few \
             probe lights; --exitance vertices takes less time",
            coarse.len() * groups.len(),
            rows.len() * columns,
            percent(worst)
        ));
    }
    Ok(all.into_iter().flatten().unzip())
}

/// The settings of every picture of a size.
fn settings(args: &SheetArgs, evaluator: &dyn Evaluator) -> Result<RenderSettings> {
    Ok(RenderSettings {
        samples_per_pixel: args.samples_per_pixel,
        opaque: Some(DVec3::splat(DEFAULT_OPAQUE)),
        ground: if args.ground { Ground::Shadow } else { Ground::None },
        ..args.view.settings(&evaluator.scene().mesh, args.resolution)?
    })
}

/// Lines below a sheet at most, where each word has one of its own: told before the bake.
const CAPTION_LINES: usize = 40;

/// What stands below a sheet.
fn caption(report: &SheetReport, model: &Path) -> Vec<String> {
    let name = model.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    let SheetReport { samples, bytes, bytes_per_vertex, rms, rms_with_environments, exposure_factors, tone, .. } =
        report;
    let stops: Vec<String> = exposure_factors.iter().map(|factor| format!("{:.2}", factor.log2())).collect();
    let stops = stops.join(", ");
    vec![
        format!(
            "{name}: one bake ({METHOD}), {samples} samples, {} or {bytes_per_vertex:.0} bytes/vertex; error {} RMS, {} with environments",
            megabytes(*bytes),
            percent(*rms),
            percent(*rms_with_environments)
        ),
        format!("exposure {stops} stops, one for each group of lights; tone {tone}"),
    ]
}
