//! `translux chart MODEL... -o DIR`: every method at a ladder of settings, against one reference; with `--scale` how cost grows.

mod adapter;
mod growth;
mod model;
mod output;
mod row;
mod truth;

use std::path::{Path, PathBuf};

use clap::Args;

use self::adapter::Adapter;
use super::console::{Console, Format, Verbosity, duration, percent};
use super::lights::LightArgs;
use super::model::PlacementArgs;
use super::{output::print_line, report};
use crate::error::{Error, ExitCode, Result};
use crate::evaluate::Method;
use crate::light::Light;
use crate::measure::chart::{Chart, Machine, Row, SCHEMA};

#[derive(Clone, Debug, Args)]
pub(super) struct ChartArgs {
    /// OBJ, glTF or GLB files
    #[arg(required_unless_present = "growth", conflicts_with = "growth", value_name = "MODEL")]
    models: Vec<PathBuf>,
    /// Folder for the page, the charts, the tables and what is needed to go on after an interruption
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// A measured material or a TOML file; repeatable
    #[arg(long, value_name = "MATERIAL", default_value = "marble")]
    material: Vec<String>,
    #[command(flatten)]
    lights: LightArgs,
    /// Methods, separated by commas (default: all)
    #[arg(long, value_delimiter = ',', value_name = "NAMES")]
    methods: Vec<String>,
    /// Two settings of each method, and fewer repetitions; with --scale fewer and smaller sizes
    #[arg(long)]
    quick: bool,
    /// How cost grows with vertices, samples and size, on a surface of its own in place of models
    #[arg(long = "scale")]
    growth: bool,
    /// With --scale: do not start a bake or a new light that is predicted to take longer than this (default: 120, with
    /// --quick 20); end a bake after twice as long
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    limit_seconds: Option<f64>,
    /// Surface samples of the reference
    #[arg(long, value_name = "N", default_value_t = 1 << 19, conflicts_with = "growth")]
    reference_samples: usize,
    /// Where shaders are timed beside the processor: on a graphics adapter if there is one (auto; a software adapter is none),
    /// on whatever adapter there is (gpu), nowhere (cpu)
    #[arg(long, value_enum, default_value = "auto", conflicts_with = "growth")]
    device: DeviceArg,
    #[command(flatten)]
    placement: PlacementArgs,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum DeviceArg {
    Auto,
    Cpu,
    Gpu,
}

/// How much is measured.
#[derive(Clone, Copy, Debug)]
struct Extent {
    /// Settings of each method.
    rungs: usize,
    /// Repetitions of what is timed, at most.
    repeats: usize,
    /// No repetition begins after this long, s.
    patience: f64,
}

const QUICK: Extent = Extent { rungs: 2, repeats: 5, patience: 0.5 };
const WHOLE: Extent = Extent { rungs: usize::MAX, repeats: 9, patience: 20.0 };

/// A model in one material, with what every method is measured by.
struct Subject<'a> {
    model: &'a Path,
    material: &'a str,
    /// Options of `bake` that place the model.
    placement: &'a [String],
    lights: &'a [(String, Light)],
    extent: Extent,
    folder: &'a Path,
    adapter: &'a Adapter,
    console: &'a Console,
}

#[derive(serde::Serialize)]
struct ChartReport<'a> {
    chart: &'a Chart,
}

pub(super) fn run(args: &ChartArgs, console: &Console) -> Result<ExitCode> {
    let extent = if args.quick { QUICK } else { WHOLE };
    let methods: Vec<&'static dyn Method> = match args.methods.as_slice() {
        [] => console.registry.methods().to_vec(),
        names => names.iter().map(|name| console.registry.method(name)).collect::<Result<_>>()?,
    };
    if args.growth {
        return growth::run(args, &methods, console);
    }
    if args.limit_seconds.is_some() {
        return Err(Error::command_line("--limit-seconds: only with --scale"));
    }
    if !(1..=1 << 28).contains(&args.reference_samples) {
        return Err(Error::command_line("--reference-samples: a number from 1 to 268435456 is needed"));
    }
    let work = args.output.join("work");
    std::fs::create_dir_all(&work).map_err(|e| Error::io(&work, &e))?;
    let resolved = args.lights.load(console)?;
    let lights: Vec<(String, Light)> = match args.lights.light.as_slice() {
        [] => Vec::new(),
        _ => resolved.text.into_iter().zip(resolved.lights).collect(),
    };
    let placement = args.placement.words();
    let adapter = Adapter::open(args.device)?;
    let mut chart = Chart {
        schema: SCHEMA.to_owned(),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        machine: machine(),
        truths: Vec::new(),
        rows: Vec::new(),
    };
    let mut pictures = Vec::new();
    for model in &args.models {
        for material in &args.material {
            let subject = Subject {
                model,
                material,
                placement: &placement,
                lights: &lights,
                extent,
                folder: &work,
                adapter: &adapter,
                console,
            };
            let truth = truth::of(&subject, args.reference_samples)?;
            for method in &methods {
                for rung in method.ladder().iter().take(extent.rungs) {
                    let (row, shown) = row::of(&subject, *method, rung, &truth)?;
                    say(&row, console);
                    pictures.push(shown);
                    chart.rows.push(row);
                }
            }
            chart.truths.push(truth.entry);
        }
    }
    let files = console.stage("write", || output::write(&chart, &pictures, &args.output))?;
    if console.format == Format::Text && console.verbosity == Verbosity::Normal {
        print_line(&format!("{} (after {})", files.page.display(), duration(console.seconds())))?;
    }
    report::print(console, "chart", &ChartReport { chart: &chart })?;
    Ok(ExitCode::Ok)
}

fn say(row: &Row, console: &Console) {
    let setting = if row.setting.is_empty() { "defaults" } else { &row.setting };
    console.note(&format!(
        "{} {} {} {setting}: {} RMS, {} worst vertex, {:.0} bytes/vertex, relight {:.1} ms, bake {}",
        row.model,
        row.material,
        row.method,
        percent(row.error.rms),
        percent(row.error.worst),
        row.bytes_per_vertex,
        row.relight_ms.median,
        duration(row.bake_seconds)
    ));
}

/// Processor, threads and load.
fn machine() -> Machine {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = info.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    let load = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    Machine {
        processor: name.map_or_else(|| std::env::consts::ARCH.to_owned(), |(_, name)| name.trim().to_owned()),
        threads: rayon::current_num_threads(),
        load: load.split_whitespace().next().and_then(|l| l.parse().ok()),
    }
}
