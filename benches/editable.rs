//! Times of `editable` in one process: after a change of light, after a change of material.
//!
//! `cargo bench --bench editable -- ASSET.tlux [MATERIAL...]`; medians of several runs, wall-clock, all threads; every published
//! material where none is named.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;
use translux::asset::Asset;
use translux::light::Light;
use translux::medium::material::PRESETS;
use translux::methods;
use translux::progress::Silent;
use translux::transport::scene::Medium;

const RUNS: usize = 9;

fn main() {
    let mut names = std::env::args().skip(1).filter(|a| !a.starts_with('-'));
    let Some(path) = names.next() else {
        println!("SKIPPED: name an asset");
        return;
    };
    if let Err(error) = measure(Path::new(&path), &names.collect::<Vec<_>>()) {
        println!("{}", error.message());
        std::process::exit(1);
    }
}

/// Median, least and largest of some times in ms.
fn report(what: &str, mut times: Vec<f64>) {
    times.sort_by(f64::total_cmp);
    println!("{what:<44} {:8.2} ms  ({:.2} to {:.2})", times[times.len() / 2], times[0], times[times.len() - 1]);
}

fn timed<T>(work: impl FnOnce() -> T) -> (f64, T) {
    let start = Instant::now();
    let value = work();
    (1e3 * start.elapsed().as_secs_f64(), value)
}

fn measure(path: &Path, materials: &[String]) -> translux::error::Result<()> {
    let mut loads = Vec::new();
    for _ in 0..3 {
        let (time, asset) = timed(|| Asset::read(path));
        asset?;
        loads.push(time);
    }
    report("read and verify the file", loads);
    let asset = Arc::new(Asset::read(path)?);
    let (time, evaluator) = timed(|| methods::built_in().open(Arc::clone(&asset)));
    let mut evaluator = evaluator?;
    report("open the evaluator", vec![time]);
    let (time, ()) = timed(|| evaluator.prepare_for_edits(&Silent));
    report("prepare for edits", vec![time]);
    println!("resident {:.1} MB", evaluator.cost().resident_bytes as f64 / 1e6);
    let radius = asset.scene.mesh.diagonal_mm();
    let around = |i: usize| {
        let angle = 0.7 * i as f64;
        DVec3::new(angle.sin(), 0.4, angle.cos()).normalize()
    };
    let wanted = |name: &str| materials.is_empty() || materials.iter().any(|m| m == name);
    for preset in PRESETS.iter().filter(|preset| wanted(preset.name)) {
        let media =
            vec![Medium { name: preset.name.to_owned(), properties: preset.properties() }; asset.scene.media.len()];
        evaluator.set_media(media.clone())?;
        for kind in ["directional", "point", "red and a blue directional"] {
            let mut times = Vec::new();
            for i in 0..RUNS {
                let lights = match kind {
                    "directional" => vec![Light::directional(around(i), DVec3::ONE)?],
                    "point" => vec![Light::point(asset.scene.mesh.origin_mm + radius * around(i), DVec3::ONE)?],
                    _ => vec![Light::directional(around(i), DVec3::X)?, Light::directional(around(i + 3), DVec3::Z)?],
                };
                let (time, result) = timed(|| {
                    evaluator.set_lights(lights, &Silent)?;
                    evaluator.radiosity(&Silent)
                });
                result?;
                times.push(time);
            }
            report(&format!("{}: new {kind} light", preset.name), times);
        }
        for with_light in [false, true] {
            let mut times = Vec::new();
            for i in 0..RUNS {
                let mut media = media.clone();
                media.iter_mut().for_each(|m| m.properties.sigma_a_per_mm *= 1.0 + 0.01 * i as f64);
                let light = Light::directional(around(i), DVec3::ONE)?;
                let (time, result) = timed(|| {
                    evaluator.set_media(media)?;
                    if with_light {
                        evaluator.set_lights(vec![light], &Silent)?;
                    }
                    evaluator.radiosity(&Silent)
                });
                result?;
                times.push(time);
            }
            let what = if with_light { "material and directional light" } else { "material, near field included" };
            report(&format!("{}: new {what}", preset.name), times);
        }
    }
    Ok(())
}
