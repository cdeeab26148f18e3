//! Frames of a light that turns: processor time and errors with and without what is kept between them.

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
const FRAMES: usize = 16;
#[cfg(feature = "gpu")]
const FRAMES_ON_ADAPTER: usize = 3;

/// Samples of `product` that errors are measured against.
const OF_TRUTH: u32 = 6400;

/// Ticks of the processor's time in a second, on Linux.
const TICKS: f64 = 100.0;

fn light(degrees: f64) -> Light {
    let (sine, cosine) = degrees.to_radians().sin_cos();
    parallel(DVec3::new(0.3 * cosine + 0.8 * sine, 0.5, 0.8 * cosine - 0.3 * sine))
}

/// Processor time of all threads so far, s; none where the system does not tell. Unlike the time on a clock it says something where others are at
/// work.
fn processor_seconds() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/self/stat").ok()?;
    let fields: Vec<&str> = text.rsplit(')').next()?.split_whitespace().collect();
    let ticks = |index: usize| fields.get(index)?.parse::<f64>().ok();
    Some((ticks(11)? + ticks(12)?) / TICKS)
}

/// Radiosity of each frame, and the mean processor time of one, ms.
fn turned(evaluator: &mut dyn Evaluator, reuse: bool, step: f64, frames: usize) -> Result<(Vec<Vec<DVec3>>, f64)> {
    let (mut values, mut start) = (Vec::new(), None);
    for frame in 0..=frames {
        let lights = vec![light(step * frame as f64)];
        match reuse {
            true => evaluator.move_lights(lights, &Silent)?,
            false => evaluator.set_lights(lights, &Silent)?,
        }
        let radiosity = evaluator.radiosity(&Silent)?;
        // The first one has nothing to keep.
        match frame {
            0 => start = processor_seconds(),
            _ => values.push(radiosity),
        }
    }
    let seconds = processor_seconds().zip(start).map_or(f64::NAN, |(end, start)| end - start);
    Ok((values, 1e3 * seconds / frames as f64))
}

pub(crate) fn run(context: &Context) -> Result<String> {
    let model = context.model();
    let scene = context.sized_scene(model, "marble", 30.0)?;
    let asset = |sampling: &str, count: u32| with_count(&baked(&scene, &[("sampling", sampling)], 1)?, count);
    let mut rows = Vec::new();
    let mut measure =
        |name: &str, evaluator: &mut dyn Evaluator, truth: Option<&mut dyn Evaluator>, (step, frames)| -> Result<()> {
            let (anew, before) = turned(evaluator, false, step, frames)?;
            let (kept, after) = turned(evaluator, true, step, frames)?;
            let apart = kept.iter().zip(&anew).map(|(kept, anew)| rms(&scene, kept, anew)).fold(0.0, f64::max);
            let truth = match truth {
                Some(truth) => turned(truth, false, step, frames)?.0,
                None => Vec::new(),
            };
            let error = |values: &[Vec<DVec3>]| {
                let squares = values.iter().zip(&truth).map(|(values, truth)| rms(&scene, values, truth).powi(2));
                let mean = squares.sum::<f64>() / truth.len().max(1) as f64;
                if truth.is_empty() { "-".to_owned() } else { format!("{:.2}", 100.0 * mean.sqrt()) }
            };
            let row = vec![
                name.to_owned(),
                format!("{step}"),
                format!("{before:.0}"),
                format!("{after:.0}"),
                format!("{:.3}", 100.0 * apart),
                error(&anew),
                error(&kept),
            ];
            context.say(&row.join(", "));
            rows.push(row);
            Ok(())
        };
    let mut truth = opened(&asset("product", OF_TRUTH)?)?;
    for (sampling, count) in [("product", 400), ("shared", 100), ("shared", 400)] {
        let mut evaluator = opened(&asset(sampling, count)?)?;
        for step in context.some(&STEPS, 1) {
            let name = format!("{sampling}, {count}");
            measure(&name, evaluator.as_mut(), Some(truth.as_mut()), (step, FRAMES))?;
        }
    }
    #[cfg(feature = "gpu")]
    if let Ok(device) = Device::open() {
        for sampling in ["product", "shared"] {
            let mut evaluator = opened(&asset(sampling, 100)?)?.on_device(&device)?;
            let name = format!("{sampling}, 100, on {}", device.describe());
            measure(&name, evaluator.as_mut(), None, (2.0, FRAMES_ON_ADAPTER))?;
        }
    }
    let head = [
        model,
        "degrees a frame",
        "all anew, ms of a processor",
        "kept, ms",
        "worst RMS between them, %",
        "RMS anew, %",
        "kept, %",
    ];
    Ok(table(&head, &rows))
}
