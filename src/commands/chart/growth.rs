//! `translux chart --scale -o DIR`: growth of bake time, memory, bytes and relight time with vertices, samples and
//! size.

mod point;

use std::path::PathBuf;

use serde::Serialize;

use self::point::{Measurer, Place, Shape};
use super::arguments::ChartArgs;
use super::subject::machine;
use super::timing::Repetitions;
use crate::commands::console::{Console, in_range};
use crate::commands::lights::LightArgs;
use crate::commands::media::tell;
use crate::commands::model::PlacementArgs;
use crate::error::{Error, ExitCode, Result};
use crate::evaluate::Method;
use crate::import::file::Input;
use crate::import::materials::AskedLook;
use crate::io::atomic;
use crate::light::Light;
use crate::measure::growth::draw::{cost_text, size_text};
use crate::measure::growth::page::finding_text;
use crate::measure::growth::surface::{DESCRIPTION, glb, scene, surface};
use crate::measure::growth::{Axis, Growth, Limits, Point, Quantity, SCHEMA};
use crate::medium::inversion::Reflector;
use crate::medium::material_file::Chosen;
use crate::progress::Progress;
use crate::report;
use crate::report::text::duration;

/// The sizes that are measured, and the effort.
struct Extent {
    /// Vertices of the surface, ascending.
    vertices: &'static [usize],
    /// Surface samples, ascending.
    samples: &'static [usize],
    /// Diagonal over the shortest mean free path, ascending.
    ratios: &'static [f64],
    /// Vertices where another size is varied.
    fixed_vertices: usize,
    /// Surface samples where they are not varied; none where the method chooses.
    fixed_samples: Option<usize>,
    /// Repetitions of a new light.
    repetitions: Repetitions,
    /// Longest bake that is started, s.
    limit_seconds: f64,
}

const WHOLE: Extent = Extent {
    vertices: &[10_000, 30_000, 100_000, 300_000, 1_000_000],
    samples: &[1 << 14, 1 << 15, 1 << 16, 1 << 17, 1 << 18, 1 << 19, 1 << 20],
    ratios: &[1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0],
    fixed_vertices: 30_000,
    fixed_samples: None,
    repetitions: Repetitions { most: 7, patience: 3.0 },
    limit_seconds: 120.0,
};

const QUICK: Extent = Extent {
    vertices: &[10_000, 30_000, 100_000],
    samples: &[1 << 12, 1 << 13, 1 << 14],
    ratios: &[1.0, 30.0, 1000.0],
    fixed_vertices: 10_000,
    fixed_samples: Some(1 << 14),
    repetitions: Repetitions { most: 3, patience: 0.5 },
    limit_seconds: 20.0,
};

/// Diagonal of the surface in mm, where it is not varied.
const SIZE_MM: f64 = 30.0;

/// The light that is timed by default.
const LIGHT: &str = "directional:from=0.3,0.8,0.5:irradiance=3";

pub(super) fn run(args: &ChartArgs, methods: &[&'static dyn Method], console: &Console) -> Result<ExitCode> {
    let extent = if args.quick { &QUICK } else { &WHOLE };
    let seconds = in_range("--limit-seconds", args.limit_seconds.unwrap_or(extent.limit_seconds), 1e-3..=1e6)?;
    let limits = Limits { seconds, memory_bytes: console.max_memory };
    if args.placement.words() != PlacementArgs::default().words() {
        return Err(Error::command_line("--scale bakes a surface of its own: options that place a model do not apply"));
    }
    let [material_text] = args.material.as_slice() else {
        return Err(Error::command_line("--scale measures one --material"));
    };
    let Chosen { material, look } = Chosen::from_argument(material_text, &Reflector::default())?;
    tell(&look.map(|found| AskedLook { name: material.name.clone(), found }).into_iter().collect::<Vec<_>>(), console);
    let free_path = material.properties.mean_free_path_mm().min_element();
    if !(free_path.is_finite() && free_path > 0.0) {
        return Err(Error::input(format!(
            "{material_text}: a medium without a mean free path has no size in free paths"
        )));
    }
    let (text, light, light_inputs) = light(args, console)?;
    let work = args.output.join("work");
    std::fs::create_dir_all(&work).map_err(|e| Error::io(&work, &e))?;
    let mut growth = Growth {
        schema: SCHEMA.to_owned(),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        machine: machine(),
        limits,
        material: material_text.clone(),
        light: text,
        surface: DESCRIPTION.to_owned(),
        fixed_samples: extent.fixed_samples,
        points: Vec::new(),
        growing: Vec::new(),
    };
    let places = places(extent, free_path);
    // Each place weighs what the samples of a bake cost and what its vertices do.
    let weight = |p: &Place| (p.vertices + p.samples.unwrap_or(1 << 17)) as u64 / 1000;
    console.start("growth", places.iter().map(weight).sum::<u64>() * methods.len() as u64);
    let measurer = Measurer {
        material_text,
        free_path_mm: free_path,
        light: &light,
        // What a cached time depends on beside its command.
        context: format!("{:?} {} {:?} {:?}", growth.machine.processor, growth.machine.threads, material, light_inputs),
        light_text: &growth.light,
        limits,
        repetitions: extent.repetitions,
        work: &work,
        console,
    };
    let mut shapes: Vec<Shape> = Vec::new();
    let mut points: Vec<Point> = Vec::new();
    for place in &places {
        let shape = match shapes.iter().position(|s| s.asked == place.vertices) {
            Some(known) => &shapes[known],
            None => {
                shapes.push(shape(place.vertices, &work)?);
                &shapes[shapes.len() - 1]
            }
        };
        // For estimates.
        let scene = scene(&shape.model, place.size_mm, &material)?;
        for method in methods {
            let point = measurer.point(place, shape, &scene, *method, &points)?;
            say(&point, console);
            points.push(point);
            console.advance(weight(place));
        }
    }
    console.finish();
    let order = |p: &Point| methods.iter().position(|m| m.name() == p.method);
    points.sort_by_key(|p| (p.axis, order(p)));
    growth.points = points;
    growth.fit();
    let page = console.stage("write", || report::chart::write_growth(&growth, &args.output))?;
    for finding in growth.findings() {
        console.note(&format!("faster than size: {}", finding_text(finding)));
    }
    console.say(&format!("{} (after {})", page.display(), duration(console.seconds())))?;
    console.report("chart", &GrowthReport { growth: &growth })
}

/// Report of how figures grow with the size of the model.
#[derive(Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(in crate::commands) struct GrowthReport<'a> {
    growth: &'a Growth,
}

/// The light that is timed: its text form, the light, and its files.
fn light(args: &ChartArgs, console: &Console) -> Result<(String, Light, Vec<Input>)> {
    let asked = match args.lights.light.as_slice() {
        [] => LightArgs { light: vec![LIGHT.to_owned()] },
        _ => args.lights.clone(),
    };
    let resolved = asked.load(console)?;
    match (asked.light.as_slice(), <[_; 1]>::try_from(resolved.lights)) {
        ([text], Ok([light])) => Ok((text.clone(), light, resolved.inputs)),
        _ => Err(Error::command_line("--scale times one --light")),
    }
}

/// Every size of every axis.
fn places(extent: &Extent, free_path_mm: f64) -> Vec<Place> {
    let place = |axis, size, vertices, samples, size_mm| Place { axis, size, vertices, samples, size_mm };
    let (vertices, samples) = (extent.fixed_vertices, extent.fixed_samples);
    let of_vertices = extent.vertices.iter().map(|&n| place(Axis::Vertices, n as f64, n, samples, SIZE_MM));
    let of_samples = extent.samples.iter().map(|&n| place(Axis::Samples, n as f64, vertices, Some(n), SIZE_MM));
    let of_ratios = extent.ratios.iter().map(|&r| place(Axis::Ratio, r, vertices, samples, r * free_path_mm));
    of_vertices.chain(of_samples).chain(of_ratios).collect()
}

/// Makes the surface and its file; an identical file that exists is kept.
fn shape(asked: usize, work: &std::path::Path) -> Result<Shape> {
    let model = surface(asked);
    let path: PathBuf = work.join(format!("knot-{asked}.glb"));
    let bytes = glb(&model)?;
    if std::fs::read(&path).ok().is_none_or(|there| there != bytes) {
        atomic::write(&path, &bytes)?;
    }
    Ok(Shape { asked, vertices: model.positions.len(), hash: blake3::hash(&bytes).to_hex().to_string(), path, model })
}

fn say(point: &Point, console: &Console) {
    let Point { axis, method, size, .. } = point;
    let what = |quantity: Quantity| match quantity.of(point) {
        Some(value) => cost_text(quantity, value),
        None => "nothing".to_owned(),
    };
    let measured = match point.costs {
        None => String::new(),
        Some(_) => {
            let all = [Quantity::BakeSeconds, Quantity::PeakMemoryBytes, Quantity::Bytes, Quantity::RelightMs];
            let [bake, peak, bytes, relight] = all.map(what);
            format!(": bake {bake}, {peak}; {bytes} on disk; relight {relight}")
        }
    };
    let skipped = point.skipped.as_ref().map_or_else(String::new, |s| format!("; no {}: {}", s.what.name(), s.reason));
    console.note(&format!("{method}, {} {}{measured}{skipped}", size_text(*axis, *size), axis.unit()));
}
