//! A light that turns: how far vertices jump in a tenth of a degree, beyond what the truth itself does.

use glam::DVec3;
use translux::error::Result;
use translux::evaluate::Evaluator;
use translux::light::quantised::interpolation::Scheme;
use translux::methods;

use crate::bench::{Context, Recipe, TRUTH, bake, encoded, lit, met, method, open, summary, table};

/// The mesh: steps are many, and each takes radiosity of all vertices.
const MODEL: &str = "bunny_3k";

/// Steps of a tenth of a degree.
const STEPS: usize = 300;

/// Samples of the truth.
const SAMPLES: usize = 131_072;

/// The height of the light's circle.
const HEIGHT: f64 = 0.35;

/// Largest motion of a vertex in each step, in full scales.
fn motions(evaluator: &mut dyn Evaluator, steps: usize, full: Option<f64>) -> Result<(Vec<f64>, f64)> {
    let direction = |step: usize| {
        let (sin, cos) = (0.1 * step as f64).to_radians().sin_cos();
        DVec3::new(cos, HEIGHT, sin).normalize()
    };
    let mut before = lit(evaluator, direction(0))?;
    let full = full.unwrap_or_else(|| {
        let mut all: Vec<f64> = before.iter().map(|v| v.max_element()).collect();
        all.sort_unstable_by(f64::total_cmp);
        all.get(all.len() * 995 / 1000).copied().unwrap_or(1.0)
    });
    let mut found = Vec::with_capacity(steps);
    for step in 1..=steps {
        let now = lit(evaluator, direction(step))?;
        let largest = now.iter().zip(&before).map(|(a, b)| (*a - *b).abs().max_element()).fold(0.0, f64::max);
        found.push(largest / full);
        before = now;
    }
    Ok((found, full))
}

/// The table.
pub(crate) fn run(context: &Context) -> Result<String> {
    let steps = if context.quick { 20 } else { STEPS };
    let scene = context.scene(MODEL, "marble")?;
    let recipe = Recipe { samples: Some(SAMPLES), max_rms: TRUTH.1, set: &[] };
    let (truth, full) = motions(method("two_pass", &scene, &recipe)?.as_mut(), steps, None)?;
    let largest = |all: &[f64]| all.iter().copied().fold(0.0, f64::max);
    let percent = |v: f64| format!("{:.2} %", 100.0 * v);
    context.say("sweep: the truth");
    let raw = encoded(&scene, &[("encoding", "raw")])?;
    let mut rows = Vec::new();
    let mut entered = |name: String, mut evaluator: Box<dyn Evaluator>| -> Result<f64> {
        let (found, _) = motions(evaluator.as_mut(), steps, Some(full))?;
        let beyond = found.iter().zip(&truth).map(|(f, t)| f - t).fold(0.0, f64::max);
        rows.push(vec![name, percent(largest(&found)), percent(beyond)]);
        Ok(beyond)
    };
    let mut nearest = 0.0;
    for scheme in Scheme::ALL {
        let beyond = entered(format!("200 lights, {}", scheme.name()), open(&raw, Some(scheme))?)?;
        nearest = if scheme == Scheme::Nearest4 { beyond } else { nearest };
    }
    let components = bake(
        methods::built_in().method("quantized_lights")?,
        &scene,
        &Recipe { samples: None, max_rms: 0.02, set: &[] },
    )?;
    let beyond = entered("the default, 2 % asked".to_owned(), open(&components, None)?)?;
    let line = summary(
        "light sweep, jump in 0.1 degrees beyond the truth's own, of full scale",
        "-",
        "<= 0.5 % with the default",
        &format!("{}; `nearest4` {}; {}", percent(beyond), percent(nearest), met(beyond <= 5e-3)),
    );
    context.say("sweep: done");
    let head = ["", "largest motion of a vertex in 0.1 degrees", "beyond the truth's in the same step"];
    Ok(format!(
        "{line}{MODEL}, marble, {} degrees in steps of 0.1, as a share of full scale; the truth's own largest motion is {}.\n\n{}",
        steps / 10,
        percent(largest(&truth)),
        table(&head, &rows)
    ))
}
