//! Work besides the evaluation, on a thread of its own with its own evaluator: errors, pictures, files.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};

use rayon::ThreadPool;

use super::answering::spawn;
use super::desk::KnownError;
use super::placing::Placing;
use crate::error::{Error, Result};
use crate::evaluate::DeviceEvaluator;
use crate::evaluate::Evaluator;
use crate::evaluate::measured::{Measured, Truth, measured};
use crate::io::atomic;
use crate::io::environment::load_environment;
use crate::light::Light;
use crate::light::environment::EnvironmentMap;
use crate::math::statistics::relative_errors;
use crate::medium::material::Medium;
use crate::medium::profiles::model::{LoadedProfile, ProfileModel};
use crate::progress::Progress;
use crate::relight::headless::png;
use crate::relight::raster::picture::LinearPicture;
use crate::render::background::Background;
use crate::render::film::{ColourType, to_exr, to_png};
use crate::render::frame::{RenderSettings, render};
use crate::render::single::Scattered;
use crate::render::texture::Texture;

/// A job.
pub(super) enum Job {
    /// Measure the error of the transport in a state.
    Error(State),
    /// Render a picture, as EXR and PNG.
    Render { state: State, settings: Box<RenderSettings>, texture: Option<Arc<Texture>>, exposure: f64, stem: PathBuf },
    /// Save an existing picture as PNG.
    Png { picture: LinearPicture, background: Background, path: PathBuf },
    /// Open another model.
    Model(PathBuf),
    /// Open the same model with another profile.
    Profile { model: PathBuf, media: Vec<Medium>, profile: ProfileModel },
    /// Read an environment.
    Environment(PathBuf),
}

/// A state to measure or render.
pub(super) struct State {
    pub(super) model: PathBuf,
    pub(super) lights: Vec<Light>,
    pub(super) media: Vec<Medium>,
    /// Names of the media for reports.
    pub(super) names: Vec<String>,
    /// The profile in place of the dipole.
    pub(super) profile: Option<Arc<LoadedProfile>>,
    pub(super) serial: u64,
}

/// The outcome of a job.
pub(super) enum Outcome {
    Error(ErrorField),
    Saved(Vec<PathBuf>),
    Model {
        path: PathBuf,
        evaluator: Box<dyn DeviceEvaluator>,
        note: Option<String>,
    },
    /// The evaluator with the profile, or the reason why there is none.
    Profile(Result<Profiled>),
    Environment {
        map: Arc<EnvironmentMap>,
        warnings: Vec<String>,
    },
}

/// An evaluator with another profile.
pub(super) struct Profiled {
    pub(super) model: ProfileModel,
    pub(super) loaded: Arc<LoadedProfile>,
    pub(super) evaluator: Box<dyn DeviceEvaluator>,
    pub(super) note: Option<String>,
}

/// Errors at all vertices.
pub(super) struct ErrorField {
    pub(super) known: KnownError,
    /// Largest error of the channels at each vertex, relative to the channel's RMS.
    pub(super) values: Vec<f32>,
}

/// The running job, and the one that ended.
pub(super) struct Jobs {
    running: Option<(&'static str, Arc<Meter>)>,
    ended: Receiver<Result<Outcome>>,
    sender: Sender<Result<Outcome>>,
    pool: Arc<ThreadPool>,
    placing: Placing,
    wake: Arc<dyn Fn() + Send + Sync>,
}

impl Jobs {
    pub(super) fn new(pool: Arc<ThreadPool>, placing: Placing, wake: Arc<dyn Fn() + Send + Sync>) -> Self {
        let (sender, ended) = channel();
        Self { running: None, ended, sender, pool, placing, wake }
    }

    /// Name and progress of the running job.
    pub(super) fn running(&self) -> Option<(&'static str, f32)> {
        self.running.as_ref().map(|(name, meter)| (*name, meter.share()))
    }

    /// Starts a job.
    ///
    /// # Errors
    /// Another job is running, or no thread can be started.
    pub(super) fn start(&mut self, name: &'static str, job: Job) -> Result<()> {
        if let Some((running, _)) = &self.running {
            return Err(Error::runtime(format!("wait for: {running}")));
        }
        let meter = Arc::new(Meter::default());
        let (sender, pool, placing, wake) =
            (self.sender.clone(), Arc::clone(&self.pool), self.placing.clone(), Arc::clone(&self.wake));
        let progress = Arc::clone(&meter);
        let work = move || {
            let result = pool.install(|| run(job, &placing, progress.as_ref()));
            let _ = sender.send(result);
            wake();
        };
        spawn("job", work)?;
        self.running = Some((name, meter));
        Ok(())
    }

    /// The outcome of a job that ended.
    pub(super) fn ended(&mut self) -> Option<Result<Outcome>> {
        let result = self.ended.try_recv().ok()?;
        self.running = None;
        Some(result)
    }
}

fn run(job: Job, placing: &Placing, progress: &dyn Progress) -> Result<Outcome> {
    match job {
        Job::Error(state) => error_field(&state, placing, progress).map(Outcome::Error),
        Job::Render { state, settings, texture, exposure, stem } => {
            let mut evaluator = evaluator_in(&state, placing, progress)?;
            evaluator.set_eye(settings.camera.at_mm());
            let radiosity = evaluator.radiosity(progress)?;
            let scattered = Scattered { texture: texture.as_deref(), ..Scattered::from(&radiosity) };
            let frame = render(evaluator.as_ref(), scattered, &state.lights, &settings, progress)?;
            let paths = ["exr", "png"].map(|suffix| stem.with_extension(suffix));
            let text = |name: &str, text: String| (name.to_owned(), text);
            let mut attributes = vec![
                text("software", format!("translux {}", env!("CARGO_PKG_VERSION"))),
                text("camera", settings.camera.to_string()),
                text("lights", state.lights.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")),
                text("material", state.names.join("; ")),
            ];
            attributes.extend(texture.map(|texture| text("texture", texture.to_string())));
            atomic::write(&paths[0], &to_exr(&frame, ColourType::default(), attributes)?)?;
            atomic::write(&paths[1], &to_png(&frame, exposure, settings.background)?)?;
            Ok(Outcome::Saved(paths.to_vec()))
        }
        Job::Png { picture, background, path } => {
            atomic::write(&path, &png(&picture, background)?)?;
            Ok(Outcome::Saved(vec![path]))
        }
        Job::Model(path) => {
            let evaluator = (placing.open)(&path, None)?;
            let (evaluator, note) = placing.place(&path, None, evaluator)?;
            Ok(Outcome::Model { path, evaluator, note })
        }
        Job::Profile { model, media, profile } => Ok(Outcome::Profile(profiled(&model, &media, profile, placing))),
        Job::Environment(path) => {
            let loaded = load_environment(&path)?;
            Ok(Outcome::Environment { map: Arc::new(loaded.value), warnings: loaded.warnings })
        }
    }
}

/// Opens the model again with a profile, and with the same media.
fn profiled(path: &Path, media: &[Medium], model: ProfileModel, placing: &Placing) -> Result<Profiled> {
    let loaded = Arc::new(model.load()?);
    // The closed form of the dipole is what every evaluator has.
    let profile = (model != ProfileModel::Dipole).then_some(loaded.as_ref());
    let evaluator = placing.evaluator(path, profile, media)?;
    let (evaluator, note) = placing.place(path, profile, evaluator)?;
    Ok(Profiled { model, loaded, evaluator, note })
}

fn evaluator_in(state: &State, placing: &Placing, progress: &dyn Progress) -> Result<Box<dyn Evaluator>> {
    let mut evaluator = placing.evaluator(&state.model, state.profile.as_deref(), &state.media)?;
    evaluator.set_lights(state.lights.clone(), progress)?;
    Ok(evaluator)
}

fn error_field(state: &State, placing: &Placing, progress: &dyn Progress) -> Result<ErrorField> {
    let mut evaluator = evaluator_in(state, placing, progress)?;
    let Measured { radiosity, truth, areas_mm2: areas, error } =
        measured(evaluator.as_mut(), Truth::OwnSamples, progress)?;
    let values = relative_errors(&radiosity, &truth, &areas);
    let mut sorted: Vec<f32> = values.iter().zip(&areas).filter(|(_, a)| **a > 0.0).map(|(v, _)| *v).collect();
    sorted.sort_unstable_by(f32::total_cmp);
    let scale = sorted.get(sorted.len() * 99 / 100).copied().map_or(0.0, f64::from);
    let (rms, worst, scale) = (error.rms, error.worst, scale.max(1e-9));
    Ok(ErrorField { known: KnownError { serial: state.serial, rms, worst, scale }, values })
}

/// Progress of a job.
#[derive(Default)]
pub(super) struct Meter {
    total: AtomicU64,
    done: AtomicU64,
}

impl Meter {
    /// Share of the stage that is done.
    fn share(&self) -> f32 {
        let (done, total) = (self.done.load(Ordering::Relaxed), self.total.load(Ordering::Relaxed));
        if total == 0 { 0.0 } else { (done as f32 / total as f32).min(1.0) }
    }
}

impl Progress for Meter {
    fn start(&self, _stage: &'static str, total: u64) {
        self.total.store(total, Ordering::Relaxed);
        self.done.store(0, Ordering::Relaxed);
    }

    fn advance(&self, units: u64) {
        self.done.fetch_add(units, Ordering::Relaxed);
    }

    fn finish(&self) {}
}
