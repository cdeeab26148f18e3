//! The default encoding from end to end: bytes and image error against `reference`, and the paper's Table I with times of a new light.

use std::time::Instant;

use glam::DVec3;
use translux::asset::Asset;
use translux::error::Result;
use translux::evaluate::Evaluator;
use translux::methods;

use crate::bench::{
    Context, Recipe, all_lit, bake, bytes_per_vertex, copy_bandwidth, lit, met, method, noted, open, random_direction,
    summary, table, thousandths, truth,
};
use crate::encodings::cells;
use crate::views::{ImageRms, Spread, Views};

/// Model, material and the errors that are asked for.
const LADDERS: [(&str, &str, &[f64]); 6] = [
    ("bunny_closed", "marble", &[0.03, 0.02, 0.018, 0.015, 0.01]),
    ("bunny_closed", "skin1", &[0.03, 0.02, 0.015]),
    ("horse", "marble", &[0.02, 0.015]),
    ("horse", "skin1", &[0.02]),
    ("dragon_50k", "marble", &[0.03, 0.025, 0.023, 0.02]),
    ("dragon_50k", "skin1", &[0.03, 0.02]),
];

/// What else Table I has: a model and keys.
const OTHERS: &[(&str, &[(&str, &str)])] =
    &[("santa", &[]), ("buddha_50k", &[]), ("horse", &[("lights", "200")]), ("dragon_50k", &[("lights", "200")])];

/// The error that Table I's assets are asked for: the method's default.
const DEFAULT_RMS: f64 = 0.02;

/// New lights that are timed.
const TIMED: usize = 200;

/// Random numbers of the lights that are timed.
const STAGE: u64 = 0x7469_6d65_6400;

/// Bytes of the paper's uncompressed values, RGB.
const PAPER_BYTES: f64 = 600.0;

/// What is wanted: image RMS, bytes a vertex, Mvertices/s.
const WANTED_RMS: f64 = 4e-3;
const WANTED_BYTES: f64 = 20.0;
const WANTED_RATE: f64 = 200.0;

/// Bytes of a vertex's result.
const RESULT_BYTES: usize = size_of::<DVec3>();

/// Best and median seconds of a new parallel light.
fn relight(evaluator: &mut dyn Evaluator) -> Result<[f64; 2]> {
    let mut times = Vec::with_capacity(TIMED);
    for index in 0..TIMED {
        let from = random_direction(STAGE, index as u64);
        let start = Instant::now();
        let values = lit(evaluator, from)?;
        times.push(start.elapsed().as_secs_f64());
        drop(values);
    }
    times.sort_unstable_by(f64::total_cmp);
    Ok([0, TIMED / 2].map(|i| times.get(i).copied().unwrap_or(f64::NAN)))
}

/// One row of Table I, and the median rate.
fn row(model: &str, material: &str, asset: &Asset, bandwidth: f64) -> Result<(Vec<String>, f64)> {
    let mut evaluator = open(asset, None)?;
    let [best, median] = relight(evaluator.as_mut())?;
    let vertices = asset.scene.mesh.local_mm.len();
    let bytes = bytes_per_vertex(asset)?;
    let touched = evaluator.cost().resident_bytes + vertices * RESULT_BYTES;
    let rate = |seconds: f64| format!("{:.0}", vertices as f64 / seconds / 1e6);
    let cells = vec![
        format!("{model}, {material}"),
        vertices.to_string(),
        noted(asset, "of them").map_or("?".to_owned(), |n| n.to_string()),
        format!("{bytes:.1}"),
        format!("{:.0}", PAPER_BYTES / bytes),
        format!("{:.0}, {:.0}", 1.0 / best, 1.0 / median),
        format!("{}, {}", rate(best), rate(median)),
        format!("{:.0} %", 100.0 * touched as f64 / best / bandwidth),
    ];
    Ok((cells, vertices as f64 / median / 1e6))
}

/// Model and material, bytes a vertex, image RMS against `reference`, and under all lights.
type Reached = (String, f64, f64, Spread);

/// From the slowest to the fastest asset, and how many are as fast as wanted.
fn rates_in_short(rates: &[f64]) -> String {
    let (least, most) = rates.iter().fold((f64::INFINITY, 0.0f64), |(low, high), r| (low.min(*r), high.max(*r)));
    let fast = rates.iter().filter(|r| **r >= WANTED_RATE).count();
    let all = fast == rates.len() && fast > 0;
    format!("{least:.0} to {most:.0}, {fast} of {} assets as wanted; {}", rates.len(), met(all))
}

/// The rows of the page's first table.
fn in_short(reached: &[Reached], rates: &[f64]) -> String {
    let mut names: Vec<&str> = Vec::new();
    for (name, ..) in reached {
        if !names.contains(&name.as_str()) {
            names.push(name);
        }
    }
    let (mut under_first, mut under_all, mut parts) = (true, true, Vec::new());
    for name in names {
        let own = || reached.iter().filter(|r| r.0 == name);
        let least = own().filter(|r| r.2 <= WANTED_RMS).min_by(|a, b| a.1.total_cmp(&b.1));
        under_first &= least.is_some_and(|r| r.1 <= WANTED_BYTES);
        under_all &= own().any(|r| r.3.worst.with_background <= WANTED_RMS && r.1 <= WANTED_BYTES);
        parts.push(least.map_or_else(
            || format!("{name} not reached by what was asked"),
            |r| format!("{name} {:.1} ({})", r.1, thousandths(r.3.worst.with_background)),
        ));
    }
    let some = !reached.is_empty();
    let measured = format!(
        "{}; under one light {}, under the worst of 8 {}",
        parts.join(", "),
        met(under_first && some),
        met(under_all && some)
    );
    let bytes = summary(
        "bytes/vertex, RGB, at image RMS <= 4e-3 end to end against `reference`, one light, with background (in brackets the worst of 8 lights there, 1e-3)",
        "46 (18 to 27 grey), before the interpolation's error",
        "<= 20",
        &measured,
    );
    let rate = summary(
        "new parallel light, RGB, default, CPU with 2 cores, Mvertices/s, median of 200 lights",
        "1.2",
        ">= 200",
        &rates_in_short(rates),
    );
    bytes + &rate
}

/// End to end, and Table I.
pub(crate) fn run(context: &Context) -> Result<String> {
    let bandwidth = copy_bandwidth();
    context.say(&format!("components: copies {:.1} GB/s", bandwidth / 1e9));
    let quick: &[(&str, &str, &[f64])] = &[("bunny_3k", "marble", &[0.03, 0.02])];
    let lights = context.lights();
    let (mut rows, mut times) = (Vec::new(), Vec::new());
    let (mut reached, mut rates) = (Vec::new(), Vec::new());
    for (model, material, asked) in if context.quick { quick } else { &LADDERS } {
        let scene = context.scene(model, material)?;
        let views = Views::new(&scene, context.views())?;
        let first = lights.first().copied().unwrap_or(DVec3::Z);
        let none = Recipe { samples: None, max_rms: DEFAULT_RMS, set: &[] };
        let brute = views.reference(&lit(method("reference", &scene, &none)?.as_mut(), first)?);
        let all = all_lit(truth(&scene)?.as_mut(), &lights)?;
        let expected: Vec<_> = all.iter().map(|b| views.reference(b)).collect();
        let own = all.first().map_or(f64::NAN, |b| views.worst(b, &brute).with_background);
        context.say(&format!("components: {model}, {material}, reference ({} to two_pass)", thousandths(own)));
        for &max_rms in *asked {
            let start = Instant::now();
            let asset = bake(methods::built_in().method("quantized_lights")?, &scene, &Recipe { max_rms, ..none })?;
            let seconds = start.elapsed().as_secs_f64();
            let found = all_lit(open(&asset, None)?.as_mut(), &lights)?;
            let errors: Vec<ImageRms> = found.iter().zip(&expected).map(|(b, r)| views.worst(b, r)).collect();
            let against = found.first().map_or_else(ImageRms::default, |b| views.worst(b, &brute));
            let error = Spread::of(&errors);
            let bytes = bytes_per_vertex(&asset)?;
            let series = format!("{model}, {material}");
            reached.push((series.clone(), bytes, against.with_background, error));
            let [with_background, covered, one] = cells(error);
            let text = |figure: Option<f64>| figure.map_or("?".to_owned(), |n| n.to_string());
            rows.push(vec![
                series,
                format!("{} %", (1000.0 * max_rms).round() / 10.0),
                text(noted(&asset, "directions, under")),
                text(noted(&asset, "of them")),
                format!("{bytes:.1}"),
                format!("{}, {}", thousandths(against.with_background), thousandths(against.covered)),
                with_background,
                covered,
                one,
                format!("{seconds:.0}"),
            ]);
            context.say(&format!("components: {model}, {material}, {max_rms}: {bytes:.1} bytes/vertex"));
            if max_rms == DEFAULT_RMS {
                let (cells, rate) = row(model, material, &asset, bandwidth)?;
                times.push(cells);
                rates.push(rate);
            }
        }
    }
    for (model, set) in if context.quick { &[][..] } else { OTHERS } {
        let scene = context.scene(model, "marble")?;
        let asset = bake(
            methods::built_in().method("quantized_lights")?,
            &scene,
            &Recipe { samples: None, max_rms: DEFAULT_RMS, set },
        )?;
        let name = set.iter().fold("marble".to_owned(), |name, (key, value)| format!("{name}, {key}={value}"));
        let (cells, rate) = row(model, &name, &asset, bandwidth)?;
        times.push(cells);
        rates.push(rate);
        context.say(&format!("components: {model}, times"));
    }
    let head = [
        "model, material",
        "asked",
        "directions",
        "reference points",
        "bytes/vertex",
        "against `reference`, one light: with background, covered",
        "8 lights, with background: median, worst",
        "covered",
        "one exposure",
        "bake, s",
    ];
    let table_i = [
        "model, material",
        "vertices",
        "reference points",
        "bytes/vertex, RGB",
        "compression of 600 bytes",
        "new lights a second: best, median",
        "Mvertices/s: best, median",
        "of the bandwidth",
    ];
    Ok(format!(
        "{}{}\n### Table I\n\n@table-i@ A copy moves {:.1} GB/s \
         here, read and written.\n\n{}",
        in_short(&reached, &rates),
        table(&head, &rows),
        bandwidth / 1e9,
        table(&table_i, &times)
    ))
}
