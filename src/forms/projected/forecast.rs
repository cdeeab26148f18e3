//! What transport at reference points over a basis of the light is expected to cost: fits to bakes of bunny_3k in skin1 at 50 mm
//! (`examples/plan_costs`).

use crate::evaluate::forecast::{Body, Forecast, relight_of_kinds};
use crate::evaluate::{BakeSettings, MaterialEdit, Model};
use crate::forms::density::Density;
use crate::scene::Scene;

/// Area over squared mean free path of the body that costs were fitted to, and the power that errors of sharp light go with: the
/// blurrier a body is, the fewer functions its light needs.
const AREA_OF_FIT: f64 = 5150.0;
const SHARPER: f64 = 0.25;

/// A basis of the light.
#[derive(Clone, Copy)]
pub(super) struct Basis {
    /// Error under parallel light that the largest basis leaves on the body of the fit.
    pub(super) sharp_rms: f64,
    /// Bytes at an error of 1 % there.
    pub(super) bytes: f64,
    /// Seconds of the bake there.
    pub(super) bake_s: f64,
    /// Error over the asked one where the basis is large enough: under soft light, and under parallel light.
    pub(super) keeps: [f64; 2],
}

/// The forecast of a basis for an asked error; `sharp` where parallel light is among what is asked for.
pub(super) fn forecast(
    scene: &Scene,
    settings: &BakeSettings,
    density: Density,
    basis: Basis,
    sharp: bool,
) -> Forecast {
    let (body, max_rms) = (Body::of(scene), settings.max_rms);
    let vertices = body.vertices as f64;
    let least = basis.sharp_rms * (body.area_over_path_squared.max(1.0) / AREA_OF_FIT).powf(SHARPER);
    let [soft, parallel] = basis.keeps.map(|keeps| keeps * max_rms);
    Forecast {
        samples: None,
        baked_samples: (settings.model != Model::Dipole).then(|| density.count(scene, settings.samples)),
        rms: if sharp { parallel.max(least) } else { soft },
        dark_over_rms: 300.0,
        // Reference points are vertices.
        bytes: 2e3 + basis.bytes * (0.01 / max_rms).powf(0.7) * (vertices / 3000.0).min(1.0),
        bake_s: basis.bake_s * (0.01 / max_rms).sqrt() + 2e-5 * vertices,
        relight_ms: relight_of_kinds(|_| 0.5 + 2e-5 * vertices),
        material: MaterialEdit::None,
    }
}
