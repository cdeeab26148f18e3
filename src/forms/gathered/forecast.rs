//! What `gathered` is expected to cost: fits to bakes of bunny_3k, horse and igea_full in skin1 at 50 mm with 8,192 to 131,072 samples
//! (`examples/plan_costs`), within a third of them.

use super::settings::{Far, Gathered};
use crate::evaluate::forecast::{Body, Forecast, light_ms, relight_of_kinds, samples_bytes};
use crate::evaluate::{BakeSettings, MaterialEdit};
use crate::forms::environment_rows::EnvironmentRows;
use crate::light::LightKind;
use crate::scene::Scene;

/// Bytes of the numbers of nets.
const NETS_BYTES: f64 = 250.0;

/// Error of nets and hierarchies over what they are asked for: their tuning stays below it.
const NETS_KEEP: f64 = 0.8;
const HIERARCHY_KEEPS: f64 = 0.8;

pub(super) fn forecast(form: &Gathered, scene: &Scene, settings: &BakeSettings) -> Option<Forecast> {
    let Far::Hierarchical { error, .. } = form.far else { return None };
    let body = Body::of(scene);
    let samples = form.density.count(scene, settings.samples);
    let (n, vertices) = (samples as f64, body.vertices as f64);
    let rows = form.environment.filter(|_| settings.is_for(LightKind::Environment));
    let ordered = form.nets.is_some() || rows.is_some();
    let mut bytes = samples_bytes(samples, body, (ordered, settings.samples_stored));
    let mut bake_s = 0.02 + 4e-7 * (body.triangles as f64 + n);
    let sums_ms = match form.nets {
        Some(_) => {
            bytes += NETS_BYTES;
            // Clusters of triangles are cut for the nets once for each of the materials that these are chosen by.
            let coarse = (body.triangles as f64 / n).clamp(1.0, 4.0);
            bake_s += (0.6 + 1.5e-5 * n + 2e-5 * vertices) * coarse;
            0.7 + 1.4e-4 * n + 5e-4 * vertices
        }
        // Clusters of triangles make a poor tree.
        None => (15.0 + 8e-4 * n + 8e-4 * vertices) * (body.triangles as f64 / (3.0 * n)).clamp(1.0, 6.0),
    };
    if let Some(rows) = rows {
        bytes += rows.expected_bytes(samples);
        bake_s += 0.5 + 6e-5 * n + 4e-5 * vertices;
    }
    Some(Forecast {
        samples: Some(samples),
        baked_samples: None,
        rms: form.nets.map_or(HIERARCHY_KEEPS * error, |asked| NETS_KEEP * asked)
            + rows.map_or(0.0, |_| EnvironmentRows::EXPECTED_RMS),
        dark_over_rms: if form.nets.is_some() { 30.0 } else { 25.0 },
        bytes,
        bake_s,
        relight_ms: relight_of_kinds(|kind| light_ms(samples, form.sampling, rows.is_some(), kind) + sums_ms),
        material: MaterialEdit::Any,
    })
}
