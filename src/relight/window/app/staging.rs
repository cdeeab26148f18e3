//! Puts evaluators on the screen: the first one, those of other models, and those with other profiles.

use std::sync::Arc;

use super::{App, Shown};
use crate::error::Result;
use crate::evaluate::DeviceEvaluator;
use crate::relight::raster::Raster;
use crate::relight::raster::canvas::Finish;
use crate::relight::window::desk::KnownError;
use crate::relight::window::editing::ProfileInForce;
use crate::relight::window::jobs::{Outcome, Profiled};
use crate::relight::window::placing::locked;
use crate::relight::window::screen::Screen;
use crate::relight::window::worker::Worker;
use crate::render::texture::Texture;

/// An evaluator that works and what it is drawn with.
pub(super) struct Staged {
    pub(super) raster: Raster,
    pub(super) worker: Worker,
    pub(super) transport: String,
    pub(super) vertices: usize,
    pub(super) samples: usize,
}

impl Shown {
    fn put(&mut self, staged: Staged) {
        let Staged { raster, worker, transport, vertices, samples } = staged;
        self.raster = raster;
        // To wait for what it does now would hold up the picture.
        let before = std::mem::replace(&mut self.worker, worker);
        before.retire();
        self.retired.push(before);
        (self.transport, self.vertices, self.samples) = (transport, vertices, samples);
    }
}

impl App {
    /// Has an evaluator work and draws what it does.
    pub(super) fn stage(
        &self,
        screen: &Screen,
        evaluator: Box<dyn DeviceEvaluator>,
        texture: Option<&Texture>,
    ) -> Result<Staged> {
        let mesh = &evaluator.scene().mesh;
        let albedo = texture.map_or_else(Vec::new, |texture| texture.of_vertices(mesh));
        let (vertices, samples) = (mesh.local_mm.len(), evaluator.cost().samples);
        let mut raster = Raster::new(evaluator.as_ref(), &[screen.finish, Finish::PICTURE])?;
        let transport = evaluator.transport();
        raster.set_texture(texture)?;
        let (shown, pool) = (raster.shown().clone(), Arc::clone(&self.settings.pool));
        let worker = Worker::start(evaluator, shown, albedo, pool, self.wake())?;
        Ok(Staged { raster, worker, transport, vertices, samples })
    }

    /// Takes in what a job has done.
    pub(super) fn finish(&mut self, outcome: Outcome) {
        let Some(mut shown) = self.shown.take() else { return };
        match outcome {
            Outcome::Saved(paths) => {
                let names: Vec<String> =
                    paths.iter().map(|p| p.strip_prefix(".").unwrap_or(p).display().to_string()).collect();
                shown.desk.say(format!("saved {}", names.join(" and ")));
            }
            Outcome::Error(field) => {
                shown.raster.set_errors(&field.values);
                let (serial, rms, worst, scale) = (field.serial, field.rms, field.worst, field.scale);
                shown.desk.error = Some(KnownError { serial, rms, worst, scale });
            }
            Outcome::Environment { map, warnings } => {
                shown.desk.replace_environment(map);
                match warnings.first() {
                    Some(warning) => shown.desk.complain(warning.clone()),
                    None => shown.desk.say("the environment is in place"),
                }
            }
            Outcome::Model { path, evaluator, note } => {
                if let Err(error) = self.replace_model(&mut shown, &path, evaluator, note) {
                    shown.desk.complain(error.message());
                }
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

    /// What there was stays where there is an error.
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
        let profile = ProfileInForce::dipole(locked(capabilities, self.settings.choice));
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
