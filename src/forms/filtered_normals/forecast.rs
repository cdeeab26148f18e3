//! What `filtered_normals` is expected to cost: fits to bakes of bunny_3k and horse in skin1 at 50 mm (`examples/plan_costs`).

use super::settings::FilteredNormals;
use crate::evaluate::MaterialEdit;
use crate::evaluate::forecast::{Body, Forecast, relight_of_kinds};
use crate::light::LightKind;
use crate::scene::Scene;

/// Error of the approximation, about.
const APPROXIMATION: f64 = 0.3;

pub(super) fn forecast(form: &FilteredNormals, scene: &Scene) -> Forecast {
    let vertices = Body::of(scene).vertices as f64;
    Forecast {
        samples: None,
        baked_samples: None,
        rms: APPROXIMATION,
        dark_over_rms: 10.0,
        bytes: 2e4 + 0.9 * f64::from(form.rungs) * vertices,
        bake_s: 0.9 + 2e-5 * vertices,
        relight_ms: relight_of_kinds(|kind| {
            let of_vertex = if kind == LightKind::Area { 9e-4 } else { 2e-4 };
            let soft = if kind == LightKind::Environment { 5.0 } else { 0.3 };
            soft + of_vertex * vertices
        }),
        material: MaterialEdit::Any,
    }
}
