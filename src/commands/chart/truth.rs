//! The reference of one model and material.

use std::sync::Arc;

use glam::DVec3;

use super::model;
use super::subject::{Baked, Subject};
use crate::asset::Asset;
use crate::error::{Error, Result};
use crate::evaluate::Evaluator;
use crate::light::Light;
use crate::light::sky::sky;
use crate::measure::chart::Truth;
use crate::measure::probes;
use crate::progress::Silent;
use crate::render::background::Background;
use crate::render::camera::{Camera, Resolution};
use crate::render::frame::{Frame, RenderSettings, Specular, render};
use crate::transport::random_walk::exitance::Exitance;

/// Resolution of the pictures that are compared.
const PICTURE: Resolution = Resolution { width: 320, height: 320 };
const SAMPLES_PER_PIXEL: u32 = 4;

/// Radiosity and pictures that every row of a model and material is compared with.
pub(super) struct Reference {
    pub(super) entry: Truth,
    /// Lights as they would be typed.
    pub(super) lights: Vec<(String, Light)>,
    /// Radiosity of every vertex under each light.
    pub(super) radiosity: Vec<Vec<DVec3>>,
    /// What leaves the volume under each light; empty where none can be walked.
    pub(super) walks: Vec<Exitance>,
    /// Area around each vertex, mm^2.
    pub(super) areas: Vec<f64>,
    /// Views, each with its picture under each light.
    pub(super) views: Vec<(RenderSettings, Vec<Frame>)>,
}

/// Bakes the reference, lights it and measures its own error.
pub(super) fn of(subject: &Subject, samples: usize) -> Result<Reference> {
    let console = subject.console;
    let Baked { path, command, .. } = subject.bake("reference", &format!("--samples {samples}"))?;
    let asset = Arc::new(Asset::read(&path)?);
    let mut evaluator = console.registry.open(Arc::clone(&asset))?;
    let lights = match subject.lights {
        [] => defaults(evaluator.as_ref()),
        lights => lights.to_vec(),
    };
    let mut radiosity = Vec::with_capacity(lights.len());
    let mut own_rms = 0.0f64;
    for (text, light) in &lights {
        evaluator.set_lights(vec![light.clone()], console)?;
        let values = evaluator.radiosity(console)?;
        if !values.iter().all(|b| b.is_finite()) {
            return Err(Error::runtime(format!("the reference under {text} is not finite")));
        }
        own_rms = own_rms.max(evaluator.measured_error(&[], console)?.total_rms());
        radiosity.push(values);
    }
    let views = views(evaluator.as_ref(), &radiosity)?;
    let walked = model::errors(subject, evaluator.scene(), &lights, &radiosity);
    let ((model_errors, walks), no_model_errors) = match walked {
        Ok(walked) => (walked, None),
        Err(error) => {
            console.warn(&format!("the model's own error is left out: {error}"));
            (Default::default(), Some(error.to_string()))
        }
    };
    Ok(Reference {
        entry: Truth {
            model: subject.name(),
            material: subject.material.to_owned(),
            samples: asset.samples.len(),
            own_rms,
            command,
            model_errors,
            no_model_errors,
        },
        areas: evaluator.scene().vertex_areas_mm2(),
        lights,
        radiosity,
        walks,
        views,
    })
}

/// Default lights: two directions, a point and the sky, none of which a bake sees.
fn defaults(evaluator: &dyn Evaluator) -> Vec<(String, Light)> {
    let mesh = &evaluator.scene().mesh;
    let sky = Light::Environment { map: Arc::new(sky()), rotate_degrees: 63.0, scale: DVec3::ONE };
    let near = probes::unseen(mesh).into_iter().map(|light| (light.to_string(), light));
    near.chain([("sky:rotate=63".to_owned(), sky)]).collect()
}

/// The views: from the front, and from the other side and above.
fn views(evaluator: &dyn Evaluator, radiosity: &[Vec<DVec3>]) -> Result<Vec<(RenderSettings, Vec<Frame>)>> {
    let mesh = &evaluator.scene().mesh;
    let front = Camera::framing(mesh, PICTURE)?;
    let direction = DVec3::new(0.8, 0.6, -1.0).normalize();
    let back = Camera::framing_from(mesh, PICTURE, direction, front.look_mm(), DVec3::Y, front.fov_degrees())?;
    let of_camera = |camera: Camera| {
        let settings = RenderSettings {
            samples_per_pixel: SAMPLES_PER_PIXEL,
            background: Background::None,
            specular: Specular::Off,
            ..RenderSettings::new(camera, PICTURE)
        };
        let frames = radiosity.iter().map(|b| render(evaluator, b, &[], &settings, &Silent)).collect::<Result<_>>()?;
        Ok((settings, frames))
    };
    [front, back].into_iter().map(of_camera).collect()
}
