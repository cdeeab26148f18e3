//! What the parts share: lights, bakes, errors, pictures.

use std::sync::Arc;

use glam::DVec3;
use translux::asset::Asset;
use translux::error::Result;
use translux::evaluate::Evaluator;
use translux::light::sky::sky;
use translux::light::{Light, LightKind};
use translux::math::statistics::vertex_error;
use translux::methods;
use translux::progress::Silent;
use translux::render::background::Background;
use translux::render::camera::{Camera, Resolution};
use translux::render::film::Exposure;
use translux::render::frame::{Frame, Pixel, RenderSettings, Specular, render};
use translux::scene::Scene;

use crate::common::bench::{Context, Recipe, SIZE_MM, bake_for, parallel};

/// Samples of the truth.
const TRUTH_SAMPLES: usize = 131_072;
const QUICK_TRUTH_SAMPLES: usize = 32_768;

/// Four suns and two point lights, none of which a fit has seen.
pub(crate) fn six_lights(scene: &Scene) -> Result<Vec<(&'static str, Light)>> {
    let point = |x: f64, y: f64, z: f64| {
        let offset = DVec3::new(x, y, z).normalize() * 0.75 * SIZE_MM;
        Light::point(scene.mesh.origin_mm + offset, DVec3::splat(offset.length_squared()))
    };
    Ok(vec![
        ("sun from the front", parallel(DVec3::new(0.2, 0.3, 1.0))),
        ("sun from above", parallel(DVec3::new(0.1, 1.0, 0.2))),
        ("sun from the side", parallel(DVec3::new(1.0, 0.2, 0.1))),
        ("sun from behind", parallel(DVec3::new(-0.5, 0.4, -0.9))),
        ("point light, front left", point(-1.0, 0.6, 0.8)?),
        ("point light, low right", point(1.0, -0.2, 0.5)?),
    ])
}

/// Light from an area and from all around.
pub(crate) fn wide_lights(scene: &Scene) -> Result<Vec<(&'static str, Light)>> {
    let from = DVec3::new(-0.6, 0.9, 0.7).normalize();
    Ok(vec![
        (
            "area light",
            Light::area(scene.mesh.origin_mm + from * SIZE_MM, -from, [0.5 * SIZE_MM; 2], DVec3::splat(5.0), None)?,
        ),
        ("sky", Light::Environment { map: Arc::new(sky()), rotate_degrees: 63.0, scale: DVec3::ONE }),
        ("constant light", Light::Constant { radiance: DVec3::ONE }),
    ])
}

pub(crate) fn baked(scene: &Scene, set: &[(&str, &str)]) -> Result<Asset> {
    let method = methods::built_in().method("filtered_normals")?;
    bake_for(LightKind::Directional, method, scene, &Recipe { samples: Some(32_768), max_rms: 0.05, set }, &Silent)
}

pub(crate) fn opened(asset: &Asset) -> Result<Box<dyn Evaluator>> {
    methods::built_in().open(Arc::new(asset.clone()))
}

pub(crate) fn truth(context: &Context, scene: &Scene) -> Result<Box<dyn Evaluator>> {
    let samples = Some(if context.quick { QUICK_TRUTH_SAMPLES } else { TRUTH_SAMPLES });
    let method = methods::built_in().method("two_pass")?;
    opened(&bake_for(LightKind::Directional, method, scene, &Recipe { samples, max_rms: 0.005, set: &[] }, &Silent)?)
}

pub(crate) fn under(evaluator: &mut dyn Evaluator, light: &Light) -> Result<Vec<DVec3>> {
    evaluator.set_lights(vec![light.clone()], &Silent)?;
    evaluator.radiosity(&Silent)
}

pub(crate) fn rms(scene: &Scene, values: &[DVec3], expected: &[DVec3]) -> f64 {
    vertex_error(values, expected, &scene.vertex_areas_mm2()).rms
}

pub(crate) fn percent(share: f64) -> String {
    format!("{:.1}", 100.0 * share)
}

/// The diffuse picture from the default eye.
pub(crate) fn picture(evaluator: &dyn Evaluator, radiosity: &[DVec3], side: usize) -> Result<Frame> {
    let resolution = Resolution::new(side, side)?;
    let mut settings = RenderSettings::new(Camera::framing(&evaluator.scene().mesh, resolution)?, resolution);
    settings.samples_per_pixel = 9;
    settings.specular = Specular::Off;
    settings.background = Background::None;
    render(evaluator, &radiosity.to_vec(), &[], &settings, &Silent)
}

/// On white, at an exposure.
pub(crate) fn shown(frame: &Frame, factor: f64) -> Vec<[f32; 3]> {
    let pixel =
        |p: &Pixel| p.diffuse.map(|c| (f64::from(c) * factor + f64::from(1.0 - p.coverage)).clamp(0.0, 1.0) as f32);
    frame.pixels.iter().map(pixel).collect()
}

pub(crate) fn exposure(frame: &Frame) -> f64 {
    Exposure::Auto.factor(frame)
}
