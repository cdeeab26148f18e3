//! The thread that evaluates: it always takes the newest state, so that the window never waits.

use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;
use rayon::ThreadPool;

use super::answering::{Answering, Asked, Rest};
use crate::error::{Error, Result};
use crate::evaluate::{DeviceEvaluator, Refined};
use crate::light::Light;
use crate::medium::material::Medium;
use crate::progress::Silent;
use crate::relight::lights::are_same;
use crate::relight::raster::Shown;
use crate::relight::raster::shadows::Shadows;
use crate::render::camera::Camera;
use crate::render::film::white_of;

/// A requested state.
#[derive(Clone)]
pub(super) struct Wanted {
    pub(super) lights: Vec<Light>,
    pub(super) media: Vec<Medium>,
    /// Position of the eye, mm.
    pub(super) eye_mm: DVec3,
    /// The camera for which automatic exposure is measured, where it is wanted.
    pub(super) expose_for: Option<Camera>,
    /// Whether the texture is included in that measurement.
    pub(super) textured: bool,
}

/// The state that is shown now.
pub(super) struct Done {
    pub(super) lights: Vec<Light>,
    pub(super) media: Vec<Medium>,
    /// Reason why the wanted media are not in force.
    pub(super) refused: Option<Error>,
    /// Reason why nothing changed.
    pub(super) failed: Option<Error>,
    /// Whether the radiosity changes with the eye's position.
    pub(super) follows_eye: bool,
    /// Whether work in the background will bring better kernels.
    pub(super) is_rough: bool,
    /// Radiance that becomes white.
    pub(super) white: Option<f64>,
    pub(super) light_ms: f64,
    pub(super) transport_ms: f64,
}

/// The thread that evaluates states.
pub(super) type Worker = Answering<Wanted, Done>;

/// Starts the thread; `wake` is called after every state. `albedo` is the texture's at each source vertex; empty without
/// a texture.
pub(super) fn start(
    evaluator: Box<dyn DeviceEvaluator>,
    shown: Shown,
    albedo: Vec<DVec3>,
    pool: Arc<ThreadPool>,
    wake: impl Fn() + Send + 'static,
) -> Result<Worker> {
    let prepare = move || {
        let mut bench = pool.install(|| Bench::new(evaluator, shown, albedo));
        bench.evaluator.answer_at_once();
        let mut last = None;
        move |asked| {
            pool.install(|| match asked {
                Asked::Question(wanted) => {
                    last = Some(Wanted::clone(&wanted));
                    (Some(bench.work(wanted)), Rest::More)
                }
                Asked::Nothing => bench.refine(last.clone()),
            })
        }
    };
    Answering::start_restless("evaluate", prepare, wake)
}

/// The evaluator and its state, owned by the thread.
struct Bench {
    evaluator: Box<dyn DeviceEvaluator>,
    shown: Shown,
    albedo: Vec<DVec3>,
    shadows: Shadows,
    /// Visibility of the lights from each source vertex.
    visibility: Vec<u32>,
    is_lit: bool,
    lights: Vec<Light>,
    media: Vec<Medium>,
    is_rough: bool,
}

impl Bench {
    fn new(evaluator: Box<dyn DeviceEvaluator>, shown: Shown, albedo: Vec<DVec3>) -> Self {
        let shadows = Shadows::new(evaluator.scene());
        let media = evaluator.scene().media.clone();
        Self {
            evaluator,
            shown,
            albedo,
            shadows,
            visibility: Vec::new(),
            is_lit: false,
            lights: Vec::new(),
            media,
            is_rough: false,
        }
    }

    /// Brings what an answer at once left out, and answers the last question again where that has changed something.
    fn refine(&mut self, last: Option<Wanted>) -> (Option<Done>, Rest) {
        match self.evaluator.refine() {
            Ok(Refined::Done) => (None, Rest::Over),
            Ok(Refined::Working) if self.is_rough => (None, Rest::More),
            Ok(Refined::Working) => {
                self.is_rough = true;
                (last.map(|wanted| self.work(wanted)), Rest::More)
            }
            Ok(Refined::Changed) => {
                self.is_rough = false;
                (last.map(|wanted| self.work(wanted)), Rest::More)
            }
            Err(error) => (last.map(|wanted| Done { failed: Some(error), ..self.work(wanted) }), Rest::Over),
        }
    }

    fn work(&mut self, wanted: Wanted) -> Done {
        let start = Instant::now();
        let mut refused = None;
        if wanted.media != self.media {
            match self.evaluator.set_media(wanted.media.clone()) {
                Ok(()) => self.media = wanted.media,
                Err(error) => {
                    refused = Some(error);
                    // Whatever was done halfway.
                    let _ = self.evaluator.set_media(self.media.clone());
                }
            }
        }
        let mut failed = None;
        if !self.is_lit || !are_same(&wanted.lights, &self.lights) {
            match self.evaluator.set_lights(wanted.lights.clone(), &Silent) {
                Ok(()) => self.lights = wanted.lights,
                Err(error) => {
                    failed = Some(error);
                    // As they were before.
                    let _ = self.evaluator.set_lights(self.lights.clone(), &Silent);
                }
            }
            self.visibility = self.shadows.visibility(self.evaluator.bvh(), &self.lights);
            self.is_lit = true;
        }
        let follows_eye = self.evaluator.set_eye(wanted.eye_mm);
        let lit = Instant::now();
        let result =
            self.evaluator.update(&Silent).and_then(|()| self.shown.publish(self.evaluator.as_ref(), &self.visibility));
        let white = match (&result, wanted.expose_for) {
            (Ok(()), Some(camera)) => self.white(&camera, wanted.textured),
            _ => Ok(None),
        };
        let ended = Instant::now();
        let failed = failed.or(result.err()).or(white.as_ref().err().cloned());
        Done {
            lights: self.lights.clone(),
            media: self.media.clone(),
            refused,
            failed,
            follows_eye,
            is_rough: self.is_rough,
            white: white.ok().flatten(),
            light_ms: (lit - start).as_secs_f64() * 1e3,
            transport_ms: (ended - lit).as_secs_f64() * 1e3,
        }
    }

    /// The radiance of the vertices that face the eye, at the percentile that automatic exposure makes white.
    fn white(&self, camera: &Camera, textured: bool) -> Result<Option<f64>> {
        let held = self.evaluator.held();
        let bytes = held.device.read(held.radiosity, held.radiosity.size())?;
        let values: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&bytes);
        let eye = (camera.at_mm() - self.evaluator.scene().mesh.origin_mm).as_vec3();
        let scale = held.scale / std::f64::consts::PI;
        let albedo = |vertex: usize| self.albedo.get(vertex).filter(|_| textured).copied().unwrap_or(DVec3::ONE);
        let radiance = |(vertex, (receiver, (point, normal))): (usize, (&u32, &(glam::Vec3, glam::Vec3)))| {
            let [r, g, b, _] = values.get(*receiver as usize)?;
            let value = (DVec3::new((*r).into(), (*g).into(), (*b).into()) * albedo(vertex)).max_element() * scale;
            (normal.dot(eye - *point) > 0.0 && value.is_finite()).then_some(value)
        };
        let receivers = held.receiver_of_vertex.iter();
        let seen = receivers.zip(self.shadows.starts()).enumerate().filter_map(radiance).collect();
        Ok(white_of(seen).filter(|white| *white >= f64::from(f32::MIN_POSITIVE)))
    }
}
