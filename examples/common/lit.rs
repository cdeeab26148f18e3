//! Evaluators under a light: their values, errors and pictures.

use std::sync::Arc;

use glam::DVec3;
use translux::asset::Asset;
use translux::error::Result;
use translux::evaluate::Evaluator;
use translux::light::{Light, LightKind};
use translux::math::statistics::vertex_error;
use translux::methods;
use translux::progress::Silent;
use translux::render::background::Background;
use translux::render::camera::{Camera, Resolution};
use translux::render::film::Exposure;
use translux::render::frame::{Frame, Pixel, RenderSettings, Specular, render};
use translux::scene::Scene;

use super::bench::{Context, Recipe, bake_for};

/// Samples of the truth.
const TRUTH_SAMPLES: usize = 131_072;
const QUICK_TRUTH_SAMPLES: usize = 32_768;

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
