//! Frames of a light that turns: times and errors with and without what is kept between them.

use std::time::Instant;

use glam::DVec3;
use translux::error::Result;
use translux::evaluate::Evaluator;
#[cfg(feature = "gpu")]
use translux::evaluate::device::Device;
use translux::light::Light;
use translux::progress::Silent;

use crate::bench::{baked, with_count};
use crate::common::bench::{Context, parallel, table};
use crate::common::lit::{opened, rms};

/// Degrees from frame to frame, and frames.
const STEPS: [f64; 3] = [0.5, 2.0, 8.0];
const FRAMES: usize = 24;
#[cfg(feature = "gpu")]
const FRAMES_ON_ADAPTER: usize = 5;

fn light(degrees: f64) -> Light {
    let (sine, cosine) = degrees.to_radians().sin_cos();
    parallel(DVec3::new(0.3 * cosine + 0.8 * sine, 0.5, 0.8 * cosine - 0.3 * sine))
}

fn median(mut times: Vec<f64>) -> f64 {
    times.sort_by(f64::total_cmp);
    times.get(times.len() / 2).copied().unwrap_or_default()
}

/// Radiosity of each frame, and the median of their times, s.
fn turned(evaluator: &mut dyn Evaluator, reuse: bool, step: f64, frames: usize) -> Result<(Vec<Vec<DVec3>>, f64)> {
    let (mut values, mut times) = (Vec::new(), Vec::new());
    for frame in 0..=frames {
        let lights = vec![light(step * frame as f64)];
        let start = Instant::now();
        match reuse {
            true => evaluator.move_lights(lights, &Silent)?,
            false => evaluator.set_lights(lights, &Silent)?,
        }
        let radiosity = evaluator.radiosity(&Silent)?;
        // The first one has nothing to keep.
        if frame > 0 {
            times.push(start.elapsed().as_secs_f64());
            values.push(radiosity);
        }
    }
    Ok((values, median(times)))
}

pub(crate) fn run(context: &Context) -> Result<String> {
    let model = if context.quick { "bunny_3k" } else { "bunny_closed" };
    let scene = context.sized_scene(model, "marble", 30.0)?;
    let mut rows = Vec::new();
    let mut measure = |name: &str, evaluator: &mut dyn Evaluator, step: f64, frames: usize| -> Result<()> {
        let (anew, seconds) = turned(evaluator, false, step, frames)?;
        let (kept, seconds_kept) = turned(evaluator, true, step, frames)?;
        let off = |(kept, anew): (&Vec<DVec3>, &Vec<DVec3>)| rms(&scene, kept, anew);
        let worst = kept.iter().zip(&anew).map(off).fold(0.0, f64::max);
        let row = vec![
            name.to_owned(),
            format!("{step}"),
            format!("{:.1}", 1e3 * seconds),
            format!("{:.1}", 1e3 * seconds_kept),
            format!("{:.3}", 100.0 * worst),
        ];
        context.say(&row.join(", "));
        rows.push(row);
        Ok(())
    };
    for (sampling, count) in [("product", 400), ("clusters", 400), ("shared", 400), ("shared", 100)] {
        let asset = with_count(&baked(&scene, &[("sampling", sampling)], 1)?, count)?;
        let mut evaluator = opened(&asset)?;
        for step in context.some(&STEPS, 1) {
            measure(&format!("{sampling}, {count}"), evaluator.as_mut(), step, FRAMES)?;
        }
    }
    #[cfg(feature = "gpu")]
    if let Ok(device) = Device::open() {
        for (sampling, count) in [("product", 400), ("shared", 100)] {
            let asset = with_count(&baked(&scene, &[("sampling", sampling)], 1)?, count)?;
            let mut evaluator = opened(&asset)?.on_device(&device)?;
            let name = format!("{sampling}, {count}, on {}", device.describe());
            measure(&name, evaluator.as_mut(), 2.0, FRAMES_ON_ADAPTER)?;
        }
    }
    let head = [model, "degrees a frame", "all anew, ms", "kept, ms", "worst RMS between them, %"];
    Ok(table(&head, &rows))
}
