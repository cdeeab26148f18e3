//! The error of the model itself: what an evaluator says against random walks through the volume that it never used.

use glam::DVec3;

use super::evaluator::Evaluator;
use super::exitance::MeshPoint;
use crate::compress::ledger::{Ledger, MODEL};
use crate::error::{ExitCode, Result};
use crate::light::Light;
use crate::math::statistics::VertexError;
use crate::progress::Progress;
use crate::scene::Scene;
use crate::transport::random_walk::exitance::{Effort, Exitance, Walkable};
use crate::transport::random_walk::model_error::{over_places, points_of_a_triangle, project, project_points};
use crate::transport::random_walk::tally::Hats;

/// Photons of each channel, light and half, at most.
const PHOTONS: u64 = 40_000;

/// Places of the surface that light is compared at: few, so that few walks are enough.
const PLACES: usize = 256;

/// Seeds of the halves; calibrations have others.
const SEEDS: [u64; 2] = [0x6d6f_6465_6c00, 0x6d6f_6465_6c01];

/// Points of the surface at which light is looked at where triangles are few: what is linear between their corners is no model's error.
const POINTS: usize = 8192;

/// Walks through a scene under a light from one direction and one from all around, two independent halves of each.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelWalks(Vec<(Light, [Exitance; 2])>);

impl ModelWalks {
    /// Walks through a scene, of no more photons than the calibration that they judge; none where a part lets light out, which walks refuse.
    ///
    /// # Errors
    /// Failures of the walks.
    pub fn new(scene: &Scene, photons: u64, progress: &dyn Progress) -> Result<Option<Self>> {
        let photons = photons.min(PHOTONS);
        let sun = Light::Directional { from: DVec3::new(0.5, 0.8, 0.4).normalize(), irradiance: DVec3::ONE };
        let walkable = Walkable::new(scene.domain());
        let mut all = Vec::new();
        for light in [sun, Light::Constant { radiance: DVec3::ONE }] {
            let walk =
                |seed: u64| walkable.exitance(std::slice::from_ref(&light), Effort::Photons(photons), seed, progress);
            match (walk(SEEDS[0]), walk(SEEDS[1])) {
                (Ok(first), Ok(second)) => all.push((light, [first, second])),
                (Err(error), _) | (_, Err(error)) if error.code() == ExitCode::InvalidInput => return Ok(None),
                (Err(error), _) | (_, Err(error)) => return Err(error),
            }
        }
        Ok(Some(Self(all)))
    }

    /// Error of an evaluator of the same scene under the worse of the lights. Where triangles are few, at points of them, if the
    /// evaluator serves any.
    ///
    /// # Errors
    /// Failures of the evaluator.
    pub fn error(&self, evaluator: &mut dyn Evaluator, progress: &dyn Progress) -> Result<VertexError> {
        let triangles = evaluator.scene().mesh.triangles.len().max(1);
        let cuts = (POINTS / triangles).isqrt() as u32;
        let mut worst = VertexError::default();
        for (light, walks) in &self.0 {
            let hats = &walks[0].hats;
            evaluator.set_lights(vec![light.clone()], progress)?;
            let serves_points = cuts > 1 && evaluator.prepare_points(progress).is_ok();
            let at_points = serves_points.then(|| at_points(evaluator, hats, cuts, progress)).flatten();
            let projected = match at_points {
                Some(projected) => projected,
                None => project(hats, &evaluator.radiosity(progress)?)?,
            };
            let [first, second] = walks;
            let error = over_places(evaluator.scene().domain(), [first, second], &projected, PLACES);
            if error.rms >= worst.rms {
                worst = error;
            }
        }
        Ok(worst)
    }

    /// Enters the error of an evaluator.
    ///
    /// # Errors
    /// Failures of the evaluator.
    pub fn enter(&self, evaluator: &mut dyn Evaluator, ledger: &mut Ledger, progress: &dyn Progress) -> Result<()> {
        let error = self.error(evaluator, progress)?;
        let note = format!("against random walks through the volume over {PLACES} places, scattering orders from 1 on");
        ledger.add(MODEL, error, note);
        Ok(())
    }
}

/// What leaves at points of every triangle, projected on the hat functions; nothing where the evaluator serves no points.
fn at_points(evaluator: &dyn Evaluator, hats: &Hats, cuts: u32, progress: &dyn Progress) -> Option<Vec<DVec3>> {
    let exitance = evaluator.exitance_at_points()?;
    let mesh = &evaluator.scene().mesh;
    let all = (0..mesh.triangles.len() as u32).flat_map(|t| points_of_a_triangle(cuts).map(move |at| (t, at)));
    // One value for each, black where a triangle has no area.
    let points: Vec<Option<MeshPoint>> = all.map(|(t, at)| MeshPoint::new(mesh, t, at)).collect();
    let known: Vec<MeshPoint> = points.iter().flatten().copied().collect();
    let mut values = exitance.at_each(&known, progress).into_iter();
    let value = |point: &Option<MeshPoint>| point.and_then(|_| values.next()).unwrap_or_default();
    Some(project_points(hats, cuts, &points.iter().map(value).collect::<Vec<DVec3>>()))
}
