//! The paper's Table 1: what a bake takes, what an asset weighs, how fast a turned environment lights it.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use glam::DVec3;
use translux::error::Result;
use translux::geometry::mesh::Scale;
use translux::geometry::parts::PartsRule;
use translux::io::obj::read_obj;
use translux::medium::material::Medium;
use translux::progress::{Progress, Silent};
use translux::scene::Scene;

use crate::bench::{DEFAULT_RMS, Map, bake, open, recipe, under};
use crate::common::bench::{
    Context, Recipe, SIZE_MM, bytes_per_vertex, copy_bandwidth, met, noted, properties, scene_of, table,
};
use crate::common::finer::longest_edges_cut;
use crate::common::runner::summary;

/// Turns that are timed, and the environment.
const TIMED: usize = 200;
const ENVIRONMENT: &str = "debevec_grace_256.hdr";

/// Vertices of the paper's bunny, and its samples.
const PAPER_VERTICES: usize = 72_000;
const PAPER_SAMPLES: usize = 300_000;

/// What is wanted of that bunny: seconds of both passes, frames a second.
const WANTED_SECONDS: f64 = 45.0;
const WANTED_FRAMES: f64 = 500.0;

/// Bytes of a vertex's result.
const RESULT_BYTES: usize = size_of::<DVec3>();

/// The paper's own form.
const PAPER: &[(&str, &str)] = &[("basis", "haar"), ("selection", "magnitude"), ("transform", "texels")];

/// Seconds of each stage.
#[derive(Default)]
struct Stages(Mutex<Clock>);

#[derive(Default)]
struct Clock {
    done: Vec<(&'static str, f64)>,
    current: Option<(&'static str, Instant)>,
}

impl Stages {
    fn clock(&self) -> MutexGuard<'_, Clock> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Of all runs of a stage.
    fn seconds(&self, stage: &str) -> f64 {
        self.clock().done.iter().filter(|(name, _)| *name == stage).map(|(_, seconds)| seconds).sum()
    }
}

impl Progress for Stages {
    fn start(&self, stage: &'static str, _: u64) {
        self.clock().current = Some((stage, Instant::now()));
    }

    fn advance(&self, _: u64) {}

    fn finish(&self) {
        let mut clock = self.clock();
        if let Some((stage, start)) = clock.current.take() {
            clock.done.push((stage, start.elapsed().as_secs_f64()));
        }
    }
}

/// The closed bunny with as many vertices as the paper's.
fn fine_bunny(context: &Context, material: &str) -> Result<Scene> {
    let source = read_obj(&context.data.join("meshes/bunny_closed.obj"))?;
    let medium = Medium { name: material.to_owned(), properties: properties(material)? };
    scene_of(longest_edges_cut(source, PAPER_VERTICES), Scale::DiagonalMm(SIZE_MM), PartsRule::Auto, medium)
}

/// With single scattering, and with the paper's four terms of a phase function.
const ISOTROPIC: &[(&str, &str)] = &[("single-scattering", "isotropic")];
const FOLDED: &[(&str, &str)] = &[("single-scattering", "folded")];
const FOUR_TERMS: &[(&str, &str)] = &[("single-scattering", "phase"), ("phase-terms", "4")];

/// What is wanted of single scattering on that bunny, s.
const WANTED_SINGLE_SECONDS: f64 = 60.0;

/// What one asset takes.
struct Taken {
    cells: Vec<String>,
    passes: f64,
    single: f64,
    frames: f64,
}

fn take(context: &Context, name: &str, scene: &Scene, recipe: &Recipe, map: &Map, bandwidth: f64) -> Result<Taken> {
    let stages = Stages::default();
    let start = Instant::now();
    let asset = bake(scene, recipe, &stages)?;
    let seconds = start.elapsed().as_secs_f64();
    let (first, second) = (stages.seconds("irradiance rows"), stages.seconds("transfer"));
    let single = stages.seconds("single scattering");
    let vertices = scene.mesh.local_mm.len();
    let bytes = bytes_per_vertex(&asset)?;
    let harmonics = noted(&asset, "of order").map_or("-".to_owned(), |n| n.to_string());
    let mut evaluator = open(asset)?;
    let resident = evaluator.cost().resident_bytes;
    let timed = if context.quick { TIMED / 10 } else { TIMED };
    let mut times = Vec::with_capacity(timed);
    for turn in 0..timed {
        let light = [map.light(360.0 * turn as f64 / timed as f64)];
        let start = Instant::now();
        let values = under(evaluator.as_mut(), &light)?;
        let beside = evaluator.single_scattering(&Silent)?;
        let seen = if beside.is_none() { evaluator.towards_eye()? } else { None };
        times.push(start.elapsed().as_secs_f64());
        drop((values, seen));
    }
    times.sort_unstable_by(f64::total_cmp);
    let [best, median] = [0, timed / 2].map(|i| times.get(i).copied().unwrap_or(f64::NAN));
    let read = (resident + vertices * RESULT_BYTES) as f64 / median;
    context.say(&format!("table: {name}: {seconds:.0} s, {bytes:.1} bytes, {:.2} ms", 1e3 * median));
    let cells = vec![
        name.to_owned(),
        vertices.to_string(),
        asset_samples(recipe),
        format!("{seconds:.0}"),
        format!("{first:.0} + {second:.0}"),
        if single > 0.0 { format!("{single:.0}") } else { "-".to_owned() },
        harmonics,
        format!("{bytes:.1}, {:.0}", resident as f64 / vertices as f64),
        format!("{:.2}, {:.2}", 1e3 * best, 1e3 * median),
        format!("{:.0}", 1.0 / median),
        format!("{:.1} ({:.0} %)", read / 1e9, 100.0 * read / bandwidth),
    ];
    Ok(Taken { cells, passes: first + second, single, frames: 1.0 / median })
}

fn asset_samples(recipe: &Recipe) -> String {
    recipe.samples.map_or("as the error asks".to_owned(), |n| n.to_string())
}

/// The table.
pub(crate) fn run(context: &Context) -> Result<String> {
    let bandwidth = copy_bandwidth();
    let map = Map::load(context, ENVIRONMENT)?;
    let (mut rows, mut line) = (Vec::new(), String::new());
    if context.quick {
        let scene = context.scene(context.model(), "marble")?;
        for (name, set) in [("bunny_3k, marble", &[][..]), ("bunny_3k, marble, the paper's form", PAPER)] {
            let recipe = recipe(context, set);
            rows.push(take(context, name, &scene, &recipe, &map, bandwidth)?.cells);
        }
    } else {
        let scene = fine_bunny(context, "marble")?;
        let default = Recipe { samples: Some(PAPER_SAMPLES), max_rms: DEFAULT_RMS, set: &[] };
        let taken = take(context, "bunny, marble", &scene, &default, &map, bandwidth)?;
        line = in_short(&taken);
        rows.push(taken.cells);
        let isotropic =
            take(context, "bunny, marble, isotropic", &scene, &Recipe { set: ISOTROPIC, ..default }, &map, bandwidth)?;
        line += &summary(
            "isotropic single scattering of that bunny",
            "42 min",
            "<= 60 s",
            &format!("{:.0} s; {}", isotropic.single, met(isotropic.single <= WANTED_SINGLE_SECONDS)),
        );
        rows.push(isotropic.cells);
        for (name, set) in [("bunny, marble, folded", FOLDED), ("bunny, marble, four terms", FOUR_TERMS)] {
            rows.push(take(context, name, &scene, &Recipe { set, ..default }, &map, bandwidth)?.cells);
        }
        let haar = Recipe { set: PAPER, ..default };
        rows.push(take(context, "bunny, marble, the paper's form", &scene, &haar, &map, bandwidth)?.cells);
        for (model, material) in
            [("bunny_closed", "marble"), ("bunny_closed", "skin1"), ("buddha_50k", "marble"), ("dragon_50k", "marble")]
        {
            let scene = context.scene(model, material)?;
            let recipe = recipe(context, &[]);
            rows.push(take(context, &format!("{model}, {material}"), &scene, &recipe, &map, bandwidth)?.cells);
        }
    }
    let head = [
        "asset",
        "vertices",
        "samples",
        "bake, s",
        "pass 1 + pass 2, s",
        "single scattering, s",
        "harmonics",
        "bytes/vertex, resident",
        "turned environment, ms: best, median",
        "a second",
        "read, GB/s",
    ];
    Ok(format!(
        "{line}{}\n@paper-table@\n\nA copy moves {:.1} GB/s here, read and written.\n",
        table(&head, &rows),
        bandwidth / 1e9
    ))
}

fn in_short(taken: &Taken) -> String {
    summary(
        "both passes, 72,000 vertices, 300,000 samples, 6 x 32 x 32 (marble)",
        "26 min",
        "<= 45 s",
        &format!("{:.0} s; {}", taken.passes, met(taken.passes <= WANTED_SECONDS)),
    ) + &summary(
        "a turned environment, that asset, CPU, a second",
        "12",
        ">= 500",
        &format!("{:.0}; {}", taken.frames, met(taken.frames >= WANTED_FRAMES)),
    )
}
