//! `translux demo`: a built-in model under a built-in sky, from one bake to pictures in several materials, and the
//! commands to try next.

use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;

use super::console::Console;
use super::lights::LightArgs;
use super::render::{self, PictureArgs};
use super::{baking, model, opening};
use crate::asset::Asset;
use crate::compress::ledger::{Entry, Ledger};
use crate::error::{Error, ExitCode, Result};
use crate::evaluate::Evaluator;
use crate::geometry::mesh::Scale;
use crate::geometry::shapes;
use crate::import::materials::MaterialChoice;
use crate::import::{ImportOptions, Source};
use crate::io::atomic;
use crate::measure::probes::by_stage;
use crate::medium::inversion::Reflector;
use crate::medium::material_file::Chosen;
use crate::render::background::Background;
use crate::render::film::{side_by_side, to_png};
use crate::render::frame::Frame;
use crate::report::materials::MediumReport;
use crate::report::picture::RenderReport;
use crate::report::sizes::sizes;
use crate::report::text::{duration, megabytes, percent, significant};
use crate::scene::Scene;

#[derive(Clone, Debug, Args)]
pub(super) struct DemoArgs {
    /// Folder to write to; made if there is none
    #[arg(short, long, value_name = "DIR", default_value = "translux-demo")]
    output: PathBuf,
}

/// Diagonal of the built-in model, mm: small enough for light to cross its ears.
const SIZE_MM: f64 = 60.0;

/// Materials of the pictures; the bake is in the first.
const MATERIALS: [&str; 3] = ["skin1", "marble", "apple"];

/// The sky, dimmed, and a lamp behind the model.
const LIGHTS: [&str; 2] = ["sky:scale=0.5", "point:at=20,34,-35:intensity=9000,7500,5500"];

const CAMERA: &str = "at=-38,30,108:look=0,19.8,2:fov=22.5";

/// Size of the picture of one material.
const RESOLUTION: &str = "480x480";

const METHOD: &str = "editable";

/// Number of surface samples, a little above the number of the model's triangles.
const SAMPLES: usize = 3 << 14;

/// Results of one material.
#[derive(Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct Shown {
    medium: MediumReport,
    /// Errors under the lights of the pictures and under others, measured by the evaluator.
    measured: Ledger,
    picture: RenderReport,
}

#[derive(Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct DemoReport {
    #[serde(serialize_with = "crate::report::path")]
    #[cfg_attr(test, schemars(with = "String"))]
    asset: PathBuf,
    #[serde(serialize_with = "crate::report::path")]
    #[cfg_attr(test, schemars(with = "String"))]
    picture: PathBuf,
    bytes: u64,
    bytes_per_vertex: f64,
    environment_bytes_per_vertex: f64,
    vertices: usize,
    samples: usize,
    /// Among the stages as well.
    #[serde(skip)]
    bake_seconds: f64,
    /// Errors of the bake, for all materials and lights that the asset is made for.
    ledger: Ledger,
    materials: Vec<Shown>,
}

pub(super) fn run(args: &DemoArgs, console: &Console) -> Result<ExitCode> {
    std::fs::create_dir_all(&args.output).map_err(|e| Error::io(&args.output, &e))?;
    let file = |name: &str| args.output.join(name);
    let start = console.seconds();
    let (path, bytes) = (file("demo.tlux"), bake(console)?);
    let bake_seconds = console.seconds() - start;
    let sizes = sizes(&bytes)?;
    atomic::write(&path, &bytes)?;
    // What the pictures show comes from the file, as for every user of it.
    let asset = Asset::read(&path)?;
    let (vertices, samples) = (asset.scene.mesh.local_mm.len(), asset.samples.len());
    let ledger = asset.ledger.clone();
    let mut evaluator = opening::baked(asset, console)?;
    let (mut materials, mut frames) = (Vec::new(), Vec::new());
    for name in MATERIALS {
        let (shown, frame) = show(evaluator.as_mut(), name, &args.output, console)?;
        frames.push((frame, shown.picture.exposure_factor));
        materials.push(shown);
    }
    let picture = file("demo.png");
    atomic::write(&picture, &to_png(&side_by_side(&frames)?, 1.0, Background::Environment)?)?;
    let per_vertex = |bytes: u64| bytes as f64 / vertices.max(1) as f64;
    let result = DemoReport {
        asset: path,
        picture,
        bytes: bytes.len() as u64,
        bytes_per_vertex: per_vertex(sizes.stored_without_mesh),
        environment_bytes_per_vertex: per_vertex(sizes.stored_environment),
        vertices,
        samples,
        bake_seconds,
        ledger,
        materials,
    };
    console.say(&summary(&result, args, console))?;
    console.report("demo", &result)
}

/// Bakes the model; returns the bytes of the asset.
fn bake(console: &Console) -> Result<Vec<u8>> {
    let mut recipe = console.registry.method(METHOD)?.default_recipe()?;
    recipe.settings.samples = Some(SAMPLES);
    let model = console.stage("model", shapes::demo_model);
    let options = ImportOptions {
        scale: Some(Scale::DiagonalMm(SIZE_MM)),
        materials: MaterialChoice::plain(MATERIALS[0]),
        ..ImportOptions::default()
    };
    let mut imported = model::import(Source { model, inputs: Vec::new() }, &options, None, console)?;
    imported.origin.source_unit = "built-in model".to_owned();
    baking::bake(recipe, imported, console)?.to_bytes()
}

/// Makes pictures of one material and measures their error.
fn show(evaluator: &mut dyn Evaluator, name: &str, folder: &Path, console: &Console) -> Result<(Shown, Frame)> {
    evaluator.set_media(vec![Chosen::from_argument(name, &Reflector::default())?.material.into()])?;
    let lights = LightArgs { light: LIGHTS.map(str::to_owned).into() }.load(console)?;
    let files = ["png", "exr"].map(|suffix| folder.join(format!("{name}.{suffix}")));
    let picture = PictureArgs::of(["--camera", CAMERA, "--resolution", RESOLUTION])?;
    let (picture, frame) = render::finish(evaluator, METHOD, lights, &picture, &files, console)?;
    let measured = by_stage(evaluator, console)?;
    let Scene { media, .. } = evaluator.scene();
    let medium = MediumReport::of(&media[0]);
    Ok((Shown { medium, measured, picture }, frame))
}

fn summary(r: &DemoReport, args: &DemoArgs, console: &Console) -> String {
    let shown = |path: &Path| path.display().to_string();
    let asset = shown(&r.asset);
    let DemoReport { vertices, samples, .. } = r;
    let (size, bake) = (megabytes(r.bytes), duration(r.bake_seconds));
    let mut lines = vec![
        format!("{asset}: {size}, {vertices} vertices, {samples} samples, baked in {bake}"),
        format!(
            "  {} bytes/vertex without the mesh, {:.0} more for environments; error of the bake {} RMS, {} more under \
             environments",
            significant(r.bytes_per_vertex),
            r.environment_bytes_per_vertex,
            percent(r.ledger.total_rms_without_environment()),
            percent(r.ledger.total_rms() - r.ledger.total_rms_without_environment()),
        ),
    ];
    for (name, Shown { measured, .. }) in MATERIALS.iter().zip(&r.materials) {
        let stage = |e: &Entry| format!("{} {}", e.stage, percent(e.error.rms));
        let stages: Vec<String> = measured.entries.iter().map(stage).collect();
        let (total, stages) = (percent(measured.total_rms()), stages.join(", "));
        lines.push(format!("  {name}: error in these lights {total} RMS ({stages})"));
    }
    lines.push(format!(
        "{}: {} from one bake, each beside it as .png and .exr (all after {})",
        shown(&r.picture),
        MATERIALS.join(", "),
        duration(console.seconds())
    ));
    let beside = |name: &str| shown(&args.output.join(name));
    let window = if cfg!(feature = "gui") {
        format!("translux relight {asset}")
    } else {
        format!("translux relight {asset} --headless --frames 12 --out {}", beside("turn"))
    };
    lines.push(format!(
        "next:\n  translux render {asset} --material ketchup --light sky:rotate=180 -o {}\n  \
         translux evaluate {asset} --material wholemilk --light directional:from=1,0.3,-0.5:irradiance=3 -o {}\n  \
         translux inspect {asset}\n  \
         {window}\n  \
         translux bake MODEL.glb --material skin1 -o MODEL.tlux",
        beside("ketchup.png"),
        beside("side.ply"),
    ));
    lines.join("\n")
}
