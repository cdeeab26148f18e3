//! `translux demo`: a built-in model under a built-in sky, from bake to picture, and what to type next.

use std::path::PathBuf;
use std::sync::Arc;

use clap::Args;
use serde::Serialize;

use super::baking;
use super::console::{Console, Format, Verbosity, duration, megabytes, percent};
use super::lights::LightArgs;
use super::media::MediumReport;
use super::model::{self, Prepare};
use super::render::{self, PictureArgs, RenderReport};
use super::{inspect, output, report};
use crate::asset::Asset;
use crate::compress::ledger::Ledger;
use crate::error::{Error, ExitCode, Result};
use crate::evaluate::BakeSettings;
use crate::geometry::mesh::Scale;
use crate::geometry::parts::{MaterialRoles, PartsRule};
use crate::geometry::shapes;
use crate::measure::probes::unseen;
use crate::medium::material::Material;
use crate::methods;
use crate::methods::settings::resolve;
use crate::render::camera::Resolution;
use crate::transport::scene::Medium;

#[derive(Clone, Debug, Args)]
pub(super) struct DemoArgs {
    /// Folder to write to; made if there is none
    #[arg(short, long, value_name = "DIR", default_value = "translux-demo")]
    output: PathBuf,
}

/// Diagonal of the built-in model, mm: small enough for light to cross its ears.
const SIZE_MM: f64 = 60.0;

/// Material of the built-in model.
const MATERIAL: &str = "skin2";

/// Method that bakes it.
const METHOD: &str = "two_pass";

/// Relative error to reach.
const MAX_RMS: f64 = 0.005;

#[derive(Serialize)]
struct DemoReport {
    asset: PathBuf,
    bytes: u64,
    bytes_per_vertex: f64,
    vertices: usize,
    samples: usize,
    media: Vec<MediumReport>,
    measured: Ledger,
    picture: RenderReport,
}

pub(super) fn run(args: &DemoArgs, console: &Console) -> Result<ExitCode> {
    std::fs::create_dir_all(&args.output).map_err(|e| Error::io(&args.output, &e))?;
    let file = |name: &str| args.output.join(name);
    let method = methods::named(METHOD)?;
    let settings = BakeSettings { max_rms: MAX_RMS, ..BakeSettings::new(method, resolve(method, &[])?) };
    let source = console.stage("model", shapes::demo_model);
    let Material { name, properties } = Material::from_argument(MATERIAL)?;
    let loaded = model::prepare(
        Prepare {
            scale: Some(Scale::DiagonalMm(SIZE_MM)),
            unit: "built-in model",
            roles: MaterialRoles::single(source.materials.len()),
            media: vec![Medium { name, properties }],
            rule: PartsRule::Auto,
            inputs: Vec::new(),
        },
        source,
        console,
    )?;
    let asset = Arc::new(baking::bake(method, loaded, &settings, console)?);
    let path = file("demo.tlux");
    let bytes = asset.to_bytes()?;
    let sizes = inspect::sizes(&bytes)?;
    crate::io::atomic::write(&path, &bytes)?;
    // What the picture shows comes from the file, as for every user of it.
    let asset = Arc::new(Asset::read(&path)?);
    let mut evaluator = method.open(Arc::clone(&asset))?;
    let lights = LightArgs::default().load(console)?;
    let pictures = [file("demo.png"), file("demo.exr")];
    let picture = PictureArgs::at(Resolution::new(768, 768)?);
    let picture = render::finish(evaluator.as_mut(), METHOD, lights, &picture, &pictures, console)?;
    let measured = evaluator.measured_error(&unseen(&asset.scene.mesh), console)?;
    let vertices = asset.scene.mesh.local_mm.len();
    let result = DemoReport {
        asset: path,
        bytes: bytes.len() as u64,
        bytes_per_vertex: sizes.stored_without_mesh as f64 / vertices.max(1) as f64,
        vertices,
        samples: asset.samples.len(),
        media: asset.scene.media.iter().map(MediumReport::of).collect(),
        measured,
        picture,
    };
    if console.format == Format::Text && console.verbosity == Verbosity::Normal {
        output::print_line(&summary(&result, args, console))?;
    }
    report::print(console, "demo", &result)?;
    Ok(ExitCode::Ok)
}

fn summary(r: &DemoReport, args: &DemoArgs, console: &Console) -> String {
    let shown = |path: &PathBuf| path.display().to_string();
    let mut lines = vec![format!(
        "{}: {} ({:.1} bytes/vertex without the mesh), {} vertices, {} samples",
        shown(&r.asset),
        megabytes(r.bytes),
        r.bytes_per_vertex,
        r.vertices,
        r.samples
    )];
    for entry in &r.measured.entries {
        lines.push(format!("error of {}: {} RMS ({})", entry.stage, percent(entry.error.rms), entry.note));
    }
    let pictures: Vec<String> = ["demo.png", "demo.exr"].iter().map(|n| shown(&args.output.join(n))).collect();
    lines.push(format!("pictures: {} (after {})", pictures.join(", "), duration(console.seconds())));
    let asset = shown(&r.asset);
    let marble = shown(&args.output.join("marble.png"));
    let ply = shown(&args.output.join("side.ply"));
    lines.push(format!(
        "next:\n  translux render {asset} --material marble --light sky:rotate=180 -o {marble}\n  \
         translux evaluate {asset} --light directional:from=1,0.3,-0.5:irradiance=3 -o {ply}\n  \
         translux inspect {asset}\n  \
         translux bake MODEL.glb --material skin1 -o MODEL.tlux"
    ));
    lines.join("\n")
}
