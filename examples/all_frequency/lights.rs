//! The default asset under every environment of the data and its turns, and under suns.

use translux::error::Result;
use translux::light::Light;
use translux::progress::Silent;

use crate::bench::{DEFAULT_RMS, Found, Map, Spread, Truth, bake, half_in, open, percent, recipe, sun, under};
use crate::common::bench::{Context, bytes_per_vertex, met, table};
use crate::common::runner::summary;

/// Turns of each environment, and suns.
const TURNS: usize = 32;
const FEW: usize = 4;

/// What is wanted: under environments, with half of the energy in a sun, bytes for each vertex on disk and in memory.
const WANTED: f64 = 0.01;
const WANTED_HALF: f64 = 0.02;
const WANTED_BYTES: f64 = 100.0;
const WANTED_RESIDENT: f64 = 200.0;

pub(crate) fn marble(context: &Context) -> Result<String> {
    run(context, "marble")
}

pub(crate) fn skin1(context: &Context) -> Result<String> {
    run(context, "skin1")
}

fn run(context: &Context, material: &str) -> Result<String> {
    let scene = context.scene(context.model(), material)?;
    let asset = bake(&scene, &recipe(context, &[]), &Silent)?;
    let bytes = bytes_per_vertex(&asset)?;
    let mut evaluator = open(asset)?;
    let resident = evaluator.cost().resident_bytes as f64 / scene.mesh.local_mm.len() as f64;
    let mut truth = Truth::new(context, &scene)?;
    let count = if context.quick { FEW } else { TURNS };
    let row = |name: &str, spread: Spread| {
        vec![name.to_owned(), percent(spread.mean), percent(spread.worst), percent(spread.noise)]
    };
    let (mut rows, mut all) = (Vec::new(), Vec::new());
    for map in Map::all(context)? {
        let mut found = Vec::new();
        for turn in 0..count {
            let light = [map.light(360.0 * turn as f64 / count as f64)];
            let expected = truth.under(&light)?;
            found.push(truth.error(&under(evaluator.as_mut(), &light)?, &expected));
        }
        let spread = Spread::of(&found);
        context.say(&format!(
            "lights: {material}, {}: {}, worst {}",
            map.name,
            percent(spread.mean),
            percent(spread.worst)
        ));
        rows.push(row(&map.name, spread));
        all.extend(found);
    }
    let environments = Spread::of(&all);
    rows.push(row("all of them", environments));
    let constant = truth.under(&[Light::Constant { radiance: glam::DVec3::ONE }])?;
    let (mut alone, mut half): (Vec<Found>, Vec<Found>) = (Vec::new(), Vec::new());
    for index in 0..count {
        let light = sun(index, count);
        let expected = truth.under(std::slice::from_ref(&light))?;
        alone.push(truth.error(&under(evaluator.as_mut(), std::slice::from_ref(&light))?, &expected));
        let mixed = constant.plus(&expected, crate::bench::SPHERE);
        half.push(truth.error(&under(evaluator.as_mut(), &half_in(&light))?, &mixed));
    }
    let half = Spread::of(&half);
    rows.push(row("half of the energy in a sun, half constant", half));
    rows.push(row("a sun alone", Spread::of(&alone)));
    let ok = environments.worst <= WANTED && half.worst <= WANTED_HALF;
    let small = bytes <= WANTED_BYTES && resident <= WANTED_RESIDENT;
    let line = summary(
        &format!(
            "relative RMS, {material}, every map of the data and {count} turns each; with half of the energy in a sun: mean, worst"
        ),
        "not given (\"unnoticeable\")",
        "<= 1 %; <= 2 %",
        &format!(
            "{}, {}; {}, {}; {}",
            percent(environments.mean),
            percent(environments.worst),
            percent(half.mean),
            percent(half.worst),
            met(ok)
        ),
    ) + &summary(
        &format!("bytes/vertex of that asset on disk, resident ({material})"),
        "653",
        "<= 100, <= 200",
        &format!("{bytes:.1}, {resident:.0}; {}", met(small)),
    );
    let head = ["light", "RMS, mean", "worst", "noise of the truth"];
    Ok(format!(
        "{line}\n### {material}\n\n{}, {} asked, {bytes:.1} bytes/vertex on disk, {resident:.0} resident; {count} turns or suns.\n\n{}\n",
        context.model(),
        percent(DEFAULT_RMS),
        table(&head, &rows),
    ))
}
