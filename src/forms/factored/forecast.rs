//! What `factored` is expected to cost: fits to bakes of bunny_3k and horse in skin1 at 50 mm with 32,768 and 131,072 samples
//! (`examples/plan_costs`).

use super::settings::Factored;
use crate::evaluate::forecast::{Body, Forecast, light_ms, relight_of_kinds, samples_bytes};
use crate::evaluate::{BakeSettings, MaterialEdit};
use crate::forms::environment_rows::EnvironmentRows;
use crate::light::LightKind;
use crate::scene::Scene;

/// Error from end to end over the largest of the shares that the stages are asked for.
const KEEPS: f64 = 0.9;

pub(super) fn forecast(form: &Factored, scene: &Scene, settings: &BakeSettings) -> Forecast {
    let body = Body::of(scene);
    let samples = form.density.count(scene, settings.samples);
    let (n, vertices) = (samples as f64, body.vertices as f64);
    let finer = 0.01 / settings.max_rms;
    let far = 1.85e6 * (n / 32768.0).powf(0.47) * finer.powf(0.6) * (vertices / 3000.0).min(1.0);
    let mut bytes = samples_bytes(samples, body, (true, settings.samples_stored)) + far;
    let mut bake_s = 0.5 + 7e-5 * n * finer.sqrt() + 1e-5 * vertices;
    let rows = form.environment.filter(|_| settings.is_for(LightKind::Environment));
    if let Some(rows) = rows {
        bytes += rows.expected_bytes(samples);
        bake_s += 0.5 + 6e-5 * n + 4e-5 * vertices;
    }
    let sums_ms = 0.5 + 1.5e-4 * n + 5e-4 * vertices;
    Forecast {
        samples: Some(samples),
        baked_samples: None,
        rms: KEEPS * form.truncation.max(form.interpolation) + rows.map_or(0.0, |_| EnvironmentRows::EXPECTED_RMS),
        dark_over_rms: 60.0,
        bytes,
        bake_s,
        relight_ms: relight_of_kinds(|kind| light_ms(samples, form.sampling, rows.is_some(), kind) + sums_ms),
        material: MaterialEdit::Any,
    }
}
