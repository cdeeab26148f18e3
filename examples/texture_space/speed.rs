//! Times: pairs a second beside those of exact sums, the error of a new light's radiosity at equal time beside `two_pass`, and the sums on an
//! adapter.

use std::time::Instant;

use translux::error::Result;
use translux::evaluate::Evaluator;
#[cfg(feature = "gpu")]
use translux::evaluate::device::Device;
use translux::methods;
use translux::progress::Silent;

use crate::bench::{Compared, baked, lights, with_count};
use crate::common::bench::{Context, Recipe, bake_for, table};
use crate::common::lit::opened;
use translux::light::LightKind;

const COUNTS: [u32; 5] = [100, 400, 1600, 6400, 25_600];
const RUNS: usize = 5;

/// Samples of the exact sums whose pairs are timed, and those on the adapter.
const EXACT: usize = 6400;
#[cfg(feature = "gpu")]
const ON_ADAPTER: [u32; 2] = [400, 1600];

/// Medians of some runs: seconds of a new light, and of a new material under it.
fn seconds(evaluator: &mut dyn Evaluator) -> Result<[f64; 2]> {
    let (mut light, mut material) = (Vec::new(), Vec::new());
    let media = evaluator.scene().media.clone();
    let mut other = media.clone();
    other.iter_mut().for_each(|m| m.properties.sigma_a_per_mm *= 1.01);
    for run in 0..RUNS {
        let start = Instant::now();
        evaluator.set_lights(vec![lights()[run % 2].clone()], &Silent)?;
        evaluator.radiosity(&Silent)?;
        light.push(start.elapsed().as_secs_f64());
        let start = Instant::now();
        evaluator.set_media(if run % 2 == 0 { other.clone() } else { media.clone() })?;
        evaluator.radiosity(&Silent)?;
        material.push(start.elapsed().as_secs_f64());
    }
    evaluator.set_media(media)?;
    Ok([light, material].map(|mut times| {
        times.sort_by(f64::total_cmp);
        times[RUNS / 2]
    }))
}

fn ms(seconds: f64) -> String {
    format!("{:.1}", 1e3 * seconds)
}

/// The time of exact sums over all pairs of samples and vertices under a light that is known: the limit of pairs a second.
fn exact_row(evaluator: &mut dyn Evaluator, receivers: f64) -> Result<Vec<String>> {
    evaluator.set_lights(vec![lights()[0].clone()], &Silent)?;
    evaluator.all_pairs(&Silent)?;
    let samples = evaluator.cost().samples as f64;
    let mut times = Vec::new();
    for _ in 0..RUNS {
        let start = Instant::now();
        evaluator.all_pairs(&Silent)?;
        times.push(start.elapsed().as_secs_f64());
    }
    times.sort_by(f64::total_cmp);
    let median = times[RUNS / 2];
    let rate = format!("{:.0}", 1e-6 * receivers * samples / median);
    let none = || "-".to_owned();
    Ok(vec![format!("exact sums, {samples} samples"), none(), ms(median), rate, none()])
}

pub(crate) fn run(context: &Context) -> Result<String> {
    let (model, size) = if context.quick { ("bunny_3k", 30.0) } else { ("bunny_closed", 30.0) };
    let compared = Compared::new(context, context.sized_scene(model, "marble", size)?)?;
    let receivers = compared.scene.mesh.local_mm.len() as f64;
    let mut rows = Vec::new();
    let mut add = |name: String, pairs: Option<f64>, evaluator: &mut dyn Evaluator| -> Result<()> {
        let [light, material] = seconds(evaluator)?;
        let errors = compared.errors_of(evaluator)?;
        let row = vec![
            name,
            ms(light),
            ms(material),
            pairs.map_or("-".to_owned(), |pairs| format!("{:.0}", 1e-6 * pairs / material)),
            format!("{:.2}", 100.0 * errors.vertices),
        ];
        context.say(&row.join(", "));
        rows.push(row);
        Ok(())
    };
    for sampling in ["shared", "clusters", "product"] {
        let asset = baked(&compared.scene, &[("sampling", sampling)], 1)?;
        for count in context.some(&COUNTS, 3) {
            let mut evaluator = opened(&with_count(&asset, count)?)?;
            add(format!("{sampling}, {count}"), Some(receivers * f64::from(count)), evaluator.as_mut())?;
        }
    }
    for max_rms in [0.04, 0.01, 0.005, 0.001] {
        let method = methods::built_in().method("two_pass")?;
        let recipe = Recipe { samples: None, max_rms, set: &[] };
        let asset = bake_for(LightKind::Directional, method, &compared.scene, &recipe, &Silent)?;
        add(format!("two_pass, {} % asked", 100.0 * max_rms), None, opened(&asset)?.as_mut())?;
    }
    let method = methods::built_in().method("two_pass")?;
    let recipe = Recipe { samples: Some(EXACT), max_rms: 0.01, set: &[] };
    let asset = bake_for(LightKind::Directional, method, &compared.scene, &recipe, &Silent)?;
    rows.push(exact_row(opened(&asset)?.as_mut(), receivers)?);
    #[cfg(feature = "gpu")]
    if let Ok(device) = Device::open() {
        for sampling in ["shared", "product"] {
            let asset = baked(&compared.scene, &[("sampling", sampling)], 1)?;
            for count in context.some(&ON_ADAPTER, 1) {
                let mut evaluator = opened(&with_count(&asset, count)?)?.on_device(&device)?;
                let [light, material] = seconds(evaluator.as_mut())?;
                let rate = 1e-6 * receivers * f64::from(count) / material;
                let name = format!("{sampling}, {count}, on {}", device.describe());
                let row = vec![name, ms(light), ms(material), format!("{rate:.0}"), "-".to_owned()];
                context.say(&row.join(", "));
                rows.push(row);
            }
        }
    }
    let head = [model, "new light, ms", "new material, ms", "million pairs a second", "vertex RMS, %"];
    Ok(table(&head, &rows))
}
