//! A new light with `quantized_lights`, in one process: weights of the light, and radiosity of every vertex.
//!
//! `cargo bench --bench quantized_lights -- ASSET.tlux`; medians of many runs, wall-clock, all threads. Bytes are those that one
//! evaluation reads and writes; over the time they are a bandwidth, beside that of a copy of memory.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;
use translux::asset::Asset;
use translux::light::Light;
use translux::methods;
use translux::progress::Silent;

const RUNS: usize = 201;

/// Bytes of the copy that shows the bandwidth.
const COPY: usize = 256 << 20;

fn main() {
    let Some(path) = std::env::args().skip(1).find(|a| !a.starts_with('-')) else {
        println!("SKIPPED: name an asset of quantized_lights");
        return;
    };
    if let Err(error) = measure(Path::new(&path)) {
        println!("{}", error.message());
        std::process::exit(1);
    }
}

/// Median, least and largest of some times in ms; returns the median.
fn report(what: &str, mut times: Vec<f64>) -> f64 {
    times.sort_by(f64::total_cmp);
    let median = times[times.len() / 2];
    println!("{what:<44} {median:8.3} ms  ({:.3} to {:.3})", times[0], times[times.len() - 1]);
    median
}

fn timed<T>(work: impl FnOnce() -> T) -> (f64, T) {
    let start = Instant::now();
    let value = work();
    (1e3 * start.elapsed().as_secs_f64(), value)
}

/// Bytes per second of a copy on all threads, read and written.
fn copy_bandwidth() -> f64 {
    use rayon::prelude::*;
    let from = vec![1u8; COPY];
    let mut to = vec![0u8; COPY];
    let copy = |_| {
        let (time, ()) = timed(|| {
            to.par_chunks_mut(1 << 20).zip(from.par_chunks(1 << 20)).for_each(|(to, from)| to.copy_from_slice(from));
        });
        time
    };
    let best = (0..5).map(copy).fold(f64::MAX, f64::min);
    2.0 * COPY as f64 / (1e-3 * best)
}

fn measure(path: &Path) -> translux::error::Result<()> {
    let asset = Arc::new(Asset::read(path)?);
    let vertices = asset.scene.mesh.local_mm.len();
    let (open, evaluator) = timed(|| methods::built_in().open(Arc::clone(&asset)));
    let mut evaluator = evaluator?;
    report("open the evaluator", vec![open]);
    let (mut light_times, mut times) = (Vec::new(), Vec::new());
    for i in 0..RUNS {
        let angle = 0.7 * i as f64;
        let light = Light::directional(DVec3::new(angle.sin(), 0.4, angle.cos()), DVec3::ONE)?;
        let (time, result) = timed(|| evaluator.set_lights(vec![light], &Silent));
        result?;
        light_times.push(time);
        let (time, result) = timed(|| evaluator.radiosity(&Silent));
        result?;
        times.push(time);
    }
    let whole: Vec<f64> = light_times.iter().zip(&times).map(|(a, b)| a + b).collect();
    report("weights of a directional light", light_times);
    report("radiosity of every vertex", times);
    let median = report("both", whole);
    println!("{:<44} {:8.1} M vertices/s", "rate", vertices as f64 / median * 1e-3);
    // What is resident, and 24 bytes for each vertex of the result.
    let bytes = evaluator.cost().resident_bytes + 24 * vertices;
    let used = bytes as f64 / (1e-3 * median);
    let copied = copy_bandwidth();
    println!(
        "{:<44} {:8.1} GB/s of {:.1} GB/s that a copy reaches, {:.0} %",
        "bandwidth",
        used * 1e-9,
        copied * 1e-9,
        100.0 * used / copied
    );
    Ok(())
}
