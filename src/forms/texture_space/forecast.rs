//! What `texture_space` is expected to cost: fits to bakes of bunny_3k and horse in skin1 at 50 mm (`examples/plan_costs`).

use super::bake;
use super::settings::TextureSpace;
use crate::evaluate::forecast::{Body, Forecast, rays_ms, relight_of_kinds};
use crate::evaluate::{BakeSettings, Form, MaterialEdit};
use crate::scene::Scene;
use crate::transport::irradiance::LightSampling;

/// Error of the texture at the resolution that the form chooses.
const TEXTURE: f64 = 0.009;

/// Share of the texels that the surface covers.
const COVERED: f64 = 0.65;

pub(super) fn forecast(form: &TextureSpace, scene: &Scene, settings: &BakeSettings) -> Forecast {
    let body = Body::of(scene);
    let (vertices, triangles) = (body.vertices as f64, body.triangles as f64);
    let texels = (COVERED * f64::from(bake::resolution(form, scene)).powi(2)).max(triangles);
    let LightSampling { points_per_patch, directions, area_side } = form.rays(texels as usize);
    let rays = (points_per_patch, directions, area_side.pow(2));
    Forecast {
        samples: None,
        baked_samples: None,
        rms: TEXTURE + bake::OF_SAMPLES * settings.max_rms,
        dark_over_rms: 8.0,
        bytes: 5e3 + 2.4 * vertices,
        bake_s: 1.2 + 1e-4 * vertices,
        relight_ms: relight_of_kinds(|kind| 35.0 + 4.5e-4 * texels + rays_ms(texels as usize, rays, kind)),
        material: MaterialEdit::Any,
    }
    .served(Form::kinds(form))
}
