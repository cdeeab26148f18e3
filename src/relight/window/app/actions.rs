//! Actions of the panel and the keys: saving pictures, measuring errors, other profiles and dropped files.

use std::path::{Path, PathBuf};

use super::App;
use super::shown::Shown;
use crate::error::Result;
use crate::relight::files::{Dropped, free_picture};
use crate::relight::raster::picture::Picture;
use crate::relight::window::desk::{Asked, Desk};
use crate::relight::window::jobs::{Job, State};
use crate::render::camera::{Camera, Resolution};
use crate::render::frame::RenderSettings;

impl App {
    /// Carries out the requests of the panel.
    pub(super) fn act(&mut self, asked: Asked) {
        if asked.save_png {
            self.save_png();
        }
        if asked.save_render {
            self.save_render();
        }
        if let (Some(profile), Some(shown)) = (asked.profile, &mut self.shown) {
            shown.desk.profile.refused = None;
            let (model, media) = (shown.desk.model.clone(), shown.desk.accepted.clone());
            start(shown, "changing the profile", Job::Profile { model, media, profile });
        }
        if asked.measure_error
            && let Some(shown) = &mut self.shown
        {
            shown.desk.turning = false;
            shown.desk.error = None;
            let job = Job::Error(state(&shown.desk));
            start(shown, "measuring the error", job);
        }
    }

    pub(super) fn save_png(&mut self) {
        self.save("saving", &["png"], |shown, camera, viewport, stem| {
            let picture = Picture::new(&shown.screen.device, viewport)?;
            let picture = picture.take(&shown.staged.raster, &shown.desk.view(camera, viewport))?;
            Ok(Job::Png { picture, background: shown.desk.background, path: stem.with_extension("png") })
        });
    }

    fn save_render(&mut self) {
        self.save("rendering", &["png", "exr"], |shown, camera, viewport, stem| {
            let exposure = shown.desk.exposure_factor();
            let settings = Box::new(RenderSettings {
                background: shown.desk.background,
                specular: shown.desk.specular(),
                white: exposure.recip(),
                ..RenderSettings::new(camera, viewport)
            });
            let texture = shown.texture.clone().filter(|_| shown.desk.shows_texture());
            Ok(Job::Render { state: state(&shown.desk), settings, texture, exposure, stem })
        });
    }

    /// Starts a job that saves the view to a free name with these suffixes.
    fn save(
        &mut self,
        name: &'static str,
        suffixes: &[&str],
        job: impl FnOnce(&Shown, Camera, Resolution, PathBuf) -> Result<Job>,
    ) {
        let Some(shown) = &mut self.shown else { return };
        let Some(stem) = free_picture(Path::new("."), suffixes) else {
            return shown.desk.complain("every name from picture-001.png on is taken");
        };
        let job = shown.desk.orbit.camera().and_then(|camera| job(shown, camera, self.viewport, stem));
        let started = job.and_then(|job| shown.jobs.start(name, job));
        shown.desk.expect(started);
    }

    pub(super) fn dropped(&mut self, path: &Path) {
        let Some(shown) = &mut self.shown else { return };
        match Dropped::new(path) {
            Dropped::Asset(path) => start(shown, "opening the model", Job::Model(path)),
            Dropped::Environment(path) => start(shown, "reading the environment", Job::Environment(path)),
            Dropped::Other(message) => shown.desk.complain(message),
        }
    }
}

fn start(shown: &mut Shown, name: &'static str, job: Job) {
    let started = shown.jobs.start(name, job);
    shown.desk.expect(started);
}

fn state(desk: &Desk) -> State {
    State {
        model: desk.model.clone(),
        lights: desk.lights(),
        names: desk.profile.names(&desk.accepted),
        media: desk.accepted.clone(),
        profile: desk.profile.in_place(),
        serial: desk.serial,
    }
}
