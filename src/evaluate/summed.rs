//! Radiosity and single scattering in one sum, for renderers.

use glam::DVec3;

use super::capabilities::SingleScattering;
use super::evaluator::Evaluator;
use super::forward::forward_scene;
use super::single_scattering::{SeenPoint, TowardsEye};
use crate::error::Result;
use crate::light::Light;
use crate::medium::fresnel::transmittance;
use crate::medium::material::Medium;
use crate::medium::profiles::model::LoadedProfile;
use crate::parallel::*;
use crate::progress::Progress;
use crate::scene::Scene;
use crate::transport::single_scattering::radiance::Share;
use crate::transport::single_scattering::{ExitPoint, radiosity_factor, vertex_points};

/// Least cosine between normal and eye: beyond a corner's horizon, where its triangle may still be visible, single
/// scattering is that of this angle.
const HORIZON: f64 = 0.05;

/// An evaluator that adds single scattering to the radiosity: isotropic, or looked up for the phase function towards
/// the eye.
pub struct Summed {
    evaluator: Box<dyn Evaluator>,
    /// Position of the eye, mm, where there is one and single scattering depends on it.
    eye_mm: Option<DVec3>,
    /// Exit point of every source vertex.
    exits: Vec<ExitPoint>,
    /// Radiosity of every source vertex, RGB, under the lights and media in force, without single scattering towards
    /// the eye.
    radiosity: Option<Vec<DVec3>>,
}

impl Summed {
    /// Wraps an evaluator, or returns it where there is nothing to add. Single scattering traced by rays is left out: a
    /// new place of the eye would need new rays.
    pub fn of(evaluator: Box<dyn Evaluator>) -> Box<dyn Evaluator> {
        match evaluator.single_scattering_is() {
            SingleScattering::PerVertex | SingleScattering::TowardsEye => {
                let exits = vertex_points(evaluator.scene().domain());
                Box::new(Self { evaluator, eye_mm: None, exits, radiosity: None })
            }
            SingleScattering::None | SingleScattering::Included | SingleScattering::TracedTowardsEye => evaluator,
        }
    }

    fn with_single(&mut self, mut radiosity: Vec<DVec3>, progress: &dyn Progress) -> Result<Vec<DVec3>> {
        if let Some(single) = self.evaluator.single_scattering(progress)? {
            radiosity.iter_mut().zip(single).for_each(|(sum, s)| *sum += s);
        } else if let (Some(eye_mm), Some(seen)) = (self.eye_mm, self.evaluator.towards_eye()?) {
            let scene = self.evaluator.scene();
            let corners = corners(scene);
            let exits = self.exits.par_iter().zip(&corners);
            radiosity.par_iter_mut().zip(exits).for_each(|(sum, (exit, corner))| {
                *sum += corner.map_or(DVec3::ZERO, |corner| towards(seen.as_ref(), scene, exit, corner, eye_mm));
            });
        }
        Ok(radiosity)
    }
}

/// A triangle of every source vertex, and the vertex's corner of it.
fn corners(scene: &Scene) -> Vec<Option<(u32, usize)>> {
    let mut result = vec![None; scene.mesh.local_mm.len()];
    for (index, triangle) in scene.mesh.triangles.iter().enumerate() {
        for (corner, &vertex) in triangle.iter().enumerate() {
            if let Some(slot) = result.get_mut(vertex as usize) {
                *slot = Some((index as u32, corner));
            }
        }
    }
    result
}

/// Single scattering of a vertex towards the eye as the radiosity of equal appearance: `pi C L / F_t(w_o)`.
fn towards(
    seen: &dyn TowardsEye,
    scene: &Scene,
    exit: &ExitPoint,
    (triangle, corner): (u32, usize),
    eye_mm: DVec3,
) -> DVec3 {
    let medium = scene.parts.parts.get(exit.part as usize).and_then(|part| part.medium);
    let Some(medium) = medium.and_then(|m| scene.media.get(m as usize)) else { return DVec3::ZERO };
    let eta = medium.properties.eta_inside_over_outside;
    let to_eye = (eye_mm - scene.mesh.origin_mm - exit.at_mm).normalize_or_zero();
    let missing = (HORIZON - exit.normal.dot(to_eye)).max(0.0);
    let to_eye = (to_eye + missing * exit.normal).normalize_or_zero();
    let leaves = transmittance(eta, exit.normal.dot(to_eye));
    if leaves <= 0.0 {
        return DVec3::ZERO;
    }
    let mut weights = [0.0; 3];
    weights[corner] = 1.0;
    let point = SeenPoint { exit: *exit, triangle, weights, to_eye, key: 0, share: Share::new(0, 1) };
    seen.radiance(&point) * (radiosity_factor(eta) / leaves)
}

impl Evaluator for Summed {
    forward_scene!(evaluator);

    fn set_lights(&mut self, lights: Vec<Light>, progress: &dyn Progress) -> Result<()> {
        self.radiosity = None;
        self.evaluator.set_lights(lights, progress)
    }

    fn move_lights(&mut self, lights: Vec<Light>, progress: &dyn Progress) -> Result<()> {
        self.radiosity = None;
        self.evaluator.move_lights(lights, progress)
    }

    fn set_media(&mut self, media: Vec<Medium>) -> Result<()> {
        self.radiosity = None;
        self.evaluator.set_media(media)
    }

    fn set_profile(&mut self, profile: LoadedProfile) -> Result<()> {
        self.radiosity = None;
        self.evaluator.set_profile(profile)
    }

    fn prepare_for_edits(&mut self, progress: &dyn Progress) {
        self.evaluator.prepare_for_edits(progress);
    }

    fn remember_lights(&mut self, count: usize) {
        self.evaluator.remember_lights(count);
    }

    fn set_eye(&mut self, at_mm: DVec3) -> bool {
        let follows = self.evaluator.single_scattering_is() == SingleScattering::TowardsEye;
        self.eye_mm = Some(at_mm).filter(|_| follows);
        follows
    }

    fn radiosity(&mut self, progress: &dyn Progress) -> Result<Vec<DVec3>> {
        let radiosity = match self.radiosity.take() {
            Some(known) => known,
            None => self.evaluator.radiosity(progress)?,
        };
        if self.eye_mm.is_some() {
            self.radiosity = Some(radiosity.clone());
        }
        self.with_single(radiosity, progress)
    }

    fn single_scattering_is(&self) -> SingleScattering {
        SingleScattering::Included
    }

    fn all_pairs(&mut self, progress: &dyn Progress) -> Result<Vec<DVec3>> {
        let radiosity = self.evaluator.all_pairs(progress)?;
        self.with_single(radiosity, progress)
    }

    #[cfg(feature = "gpu")]
    fn on_device(
        self: Box<Self>,
        _: &std::sync::Arc<super::device::adapter::Device>,
    ) -> Result<Box<dyn super::evaluator::DeviceEvaluator>> {
        Err(crate::error::Error::unsupported(
            "single scattering beside the radiosity is added to it on the CPU: --device cpu, or bake it as a part of the radiosity \
             (--set single-scattering=folded)",
        ))
    }
}
