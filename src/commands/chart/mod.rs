//! `translux chart MODEL... -o DIR`: every method at a ladder of settings, against one reference; with `--scale` the
//! growth of cost.

mod adapter;
mod arguments;
mod child;
mod growth;
mod model;
mod row;
mod subject;
mod timing;
mod truth;

use serde::Serialize;

use self::adapter::Adapter;
pub(super) use self::arguments::ChartArgs;
#[cfg(test)]
pub(super) use self::growth::GrowthReport;
use self::subject::{Subject, machine};
use self::timing::Repetitions;
use super::console::{Console, in_range};
use crate::error::{Error, ExitCode, Result};
use crate::evaluate::Method;
use crate::light::Light;
use crate::measure::chart::{Chart, Row, SCHEMA};
use crate::report;
use crate::report::text::{duration, percent};

pub(super) fn run(args: &ChartArgs, console: &Console) -> Result<ExitCode> {
    // Settings of each method, and repetitions of relights and edits.
    let (rungs, repetitions) = match args.quick {
        true => (2, Repetitions { most: 5, patience: 0.5 }),
        false => (usize::MAX, Repetitions { most: 9, patience: 20.0 }),
    };
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
    in_range("--reference-samples", args.reference_samples, 1..=1 << 28)?;
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
                repetitions,
                folder: &work,
                adapter: &adapter,
                console,
            };
            let truth = truth::of(&subject, args.reference_samples)?;
            for method in &methods {
                for rung in method.about().ladder.iter().take(rungs) {
                    let (row, shown) = row::of(&subject, *method, rung, &truth)?;
                    say(&row, console);
                    pictures.push(shown);
                    chart.rows.push(row);
                }
            }
            chart.truths.push(truth.entry);
        }
    }
    let page = console.stage("write", || report::chart::write(&chart, &pictures, &args.output))?;
    console.say(&format!("{} (after {})", page.display(), duration(console.seconds())))?;
    console.report("chart", &ChartReport { chart: &chart })
}

/// Report of a chart.
#[derive(Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct ChartReport<'a> {
    chart: &'a Chart,
}

fn say(row: &Row, console: &Console) {
    let setting = if row.setting.is_empty() { "defaults" } else { &row.setting };
    let volume = row.volume_rms.map_or_else(String::new, |[rms, _]| format!(" ({} off the volume)", percent(rms)));
    let Row { model, material, method, bytes_per_vertex, .. } = row;
    let [rms, worst] = [row.error.rms, row.error.worst].map(percent);
    let (relight_ms, bake) = (row.relight_ms.median, duration(row.bake_seconds));
    console.note(&format!(
        "{model} {material} {method} {setting}: {rms} RMS{volume}, {worst} worst vertex, {bytes_per_vertex:.0} bytes/vertex, \
         relight {relight_ms:.1} ms, bake {bake}"
    ));
}
