//! Opens the window and stages evaluators on its screen: the first one, those of other models, and those with other
//! profiles.

use std::sync::Arc;

use winit::dpi::{LogicalSize, PhysicalSize};
use winit::event_loop::ActiveEventLoop;
use winit::window::Window;

use super::App;
use super::shown::{Shown, Staged};
use crate::error::{Error, Result};
use crate::evaluate::DeviceEvaluator;
use crate::relight::raster::Raster;
use crate::relight::raster::canvas::Finish;
use crate::relight::window::colours;
use crate::relight::window::desk::Desk;
use crate::relight::window::editing::ProfileInForce;
use crate::relight::window::jobs::{Jobs, Outcome, Profiled};
use crate::relight::window::placing::{Placing, locked};
use crate::relight::window::screen::Screen;
use crate::relight::window::session::Session;
use crate::relight::window::worker;
use crate::render::camera::Resolution;
use crate::render::texture::Texture;

/// Smallest window in which everything is readable.
const LEAST_SIZE: LogicalSize<f64> = LogicalSize::new(640.0, 480.0);

impl App {
    /// Opens the window of a session.
    pub(super) fn open(&mut self, event_loop: &ActiveEventLoop, session: Session) -> Result<Shown> {
        let Resolution { width, height } = session.resolution;
        let name = session.model.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
        let attributes = Window::default_attributes()
            .with_title(format!("translux - {name}"))
            .with_inner_size(PhysicalSize::new(width as u32, height as u32))
            .with_min_inner_size(LEAST_SIZE);
        let window = event_loop
            .create_window(attributes)
            .map_err(|e| Error::unsupported(format!("no window can be opened: {e}; use --headless")))?;
        let screen = Screen::new(event_loop, Arc::new(window))?;
        let camera = self.settings.camera.resolve(&session.evaluator.scene().mesh, screen.resolution())?;
        let capabilities = session.evaluator.capabilities();
        let (material, locked) = (capabilities.material, locked(capabilities, self.settings.choice));
        let profile = ProfileInForce::new(session.profile.clone(), Arc::new(session.profile.load()?), locked)
            .of_kernels(capabilities.profile);
        let in_place = profile.in_place();
        let scene = session.evaluator.scene();
        let mut desk = Desk::new(session.model.clone(), scene, material, profile, session.lights, &camera);
        desk.set_exposure(session.exposure);
        desk.set_specular(session.specular);
        desk.background = session.background;
        desk.turning = session.turning;
        let placing = Placing { device: Arc::clone(&screen.device), choice: self.settings.choice, open: session.open };
        let (evaluator, note) = placing.place(&session.model, in_place.as_deref(), session.evaluator)?;
        note.into_iter().for_each(|note| desk.say(note));
        let texture = Texture::new(&self.settings.texture, &evaluator.scene().mesh)?.map(Arc::new);
        let staged = self.stage(&screen, evaluator, texture.as_deref())?;
        desk.has_texture = texture.is_some();
        let colours = colours::start(self.wake())?;
        let jobs = Jobs::new(Arc::clone(&self.settings.pool), placing, Arc::new(self.wake()));
        Ok(Shown {
            screen,
            staged,
            retired: Vec::new(),
            colours,
            jobs,
            desk,
            texture,
            follows_eye: false,
            is_rough: false,
        })
    }

    /// Starts an evaluator's worker, and a raster that draws its radiosity.
    fn stage(&self, screen: &Screen, evaluator: Box<dyn DeviceEvaluator>, texture: Option<&Texture>) -> Result<Staged> {
        let mesh = &evaluator.scene().mesh;
        let albedo = texture.map_or_else(Vec::new, |texture| texture.of_vertices(mesh));
        let (vertices, samples) = (mesh.local_mm.len(), evaluator.cost().samples);
        let mut raster = Raster::new(evaluator.as_ref(), &[screen.finish, Finish::PICTURE])?;
        let transport = evaluator.transport();
        raster.set_texture(texture)?;
        let (shown, pool) = (raster.shown().clone(), Arc::clone(&self.settings.pool));
        let worker = worker::start((evaluator, self.settings.reuse), shown, albedo, pool, self.wake())?;
        Ok(Staged { raster, worker, transport, vertices, samples })
    }

    /// Handles the outcome of a job.
    pub(super) fn finish(&mut self, outcome: Outcome) {
        let Some(mut shown) = self.shown.take() else { return };
        match outcome {
            Outcome::Saved(paths) => {
                let names: Vec<String> =
                    paths.iter().map(|p| p.strip_prefix(".").unwrap_or(p).display().to_string()).collect();
                shown.desk.say(format!("saved {}", names.join(" and ")));
            }
            Outcome::Error(field) => {
                shown.staged.raster.set_errors(&field.values);
                shown.desk.error = Some(field.known);
            }
            Outcome::Environment { map, warnings } => {
                shown.desk.replace_environment(map);
                match warnings.first() {
                    Some(warning) => shown.desk.complain(warning.clone()),
                    None => shown.desk.say("the environment is in place"),
                }
            }
            Outcome::Model { path, evaluator, note } => {
                let replaced = self.replace_model(&mut shown, &path, evaluator, note);
                shown.desk.expect(replaced);
            }
            Outcome::Profile(profiled) => {
                let replaced = profiled.and_then(|profiled| self.replace_profile(&mut shown, profiled));
                if let Err(error) = replaced {
                    shown.desk.profile.refused = Some(error.message().to_owned());
                }
            }
        }
        self.shown = Some(shown);
    }

    /// Replaces the model that is shown, which stays in case of an error.
    fn replace_model(
        &self,
        shown: &mut Shown,
        path: &std::path::Path,
        evaluator: Box<dyn DeviceEvaluator>,
        note: Option<String>,
    ) -> Result<()> {
        let scene = evaluator.scene().clone();
        let capabilities = evaluator.capabilities();
        let material = capabilities.material;
        let camera = self.settings.camera.resolve(&scene.mesh, self.viewport)?;
        let (texture, untextured) = match Texture::new(&self.settings.texture, &scene.mesh) {
            Ok(texture) => (texture.map(Arc::new), None),
            Err(error) => (None, Some(error)),
        };
        shown.put(self.stage(&shown.screen, evaluator, texture.as_deref())?);
        let profile =
            ProfileInForce::dipole(locked(capabilities, self.settings.choice)).of_kernels(capabilities.profile);
        shown.desk.replace_model(path.to_owned(), &scene, material, profile, &camera);
        shown.desk.has_texture = texture.is_some();
        shown.texture = texture;
        match (untextured, note) {
            (Some(error), _) => shown.desk.complain(error.message()),
            (None, Some(note)) => shown.desk.say(note),
            (None, None) => shown.desk.say(format!("{} is in place", path.display())),
        }
        Ok(())
    }

    fn replace_profile(&self, shown: &mut Shown, profiled: Profiled) -> Result<()> {
        let Profiled { model, loaded, evaluator, note } = profiled;
        shown.put(self.stage(&shown.screen, evaluator, shown.texture.as_deref())?);
        shown.desk.replace_profile(model, loaded);
        if let Some(note) = note {
            shown.desk.say(note);
        }
        Ok(())
    }
}
