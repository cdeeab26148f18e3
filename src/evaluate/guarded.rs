//! Evaluators whose results are held against the light that they are given: whatever an asset has stored, nothing leaves that no light
//! could have brought in.

#[cfg(feature = "gpu")]
use std::sync::Arc;
use std::sync::{Arc as Shared, OnceLock};

use glam::DVec3;

use super::capabilities::SingleScattering;
#[cfg(feature = "gpu")]
use super::device::adapter::Device;
#[cfg(feature = "gpu")]
use super::evaluator::DeviceEvaluator;
use super::evaluator::{Evaluator, Refined};
use super::exitance::Exitance;
use super::forward::forward_scene;
use super::single_scattering::TowardsEye;
use crate::error::{Error, Result};
use crate::geometry::mesh::Mesh;
use crate::light::Light;
use crate::light::environment::EnvironmentMap;
use crate::medium::material::Medium;
use crate::medium::profiles::model::LoadedProfile;
use crate::progress::Progress;

/// Radiosity over the largest irradiance from which on an asset is damaged. Light that enters leaves again but once, and neither kernels
/// that gather from curved surfaces nor interpolation make a tenth of this of it.
const MOST_GAIN: f64 = 1e3;

/// An evaluator with a guard on its radiosity.
pub(super) struct Guarded {
    inner: Box<dyn Evaluator>,
    lights: Vec<Light>,
    /// Largest irradiance of the lights in force, found when it is needed.
    irradiance: OnceLock<f64>,
    /// The last environment, and its largest radiance.
    environment: Option<(Shared<EnvironmentMap>, f64)>,
}

impl Guarded {
    pub(super) fn of(inner: Box<dyn Evaluator>) -> Box<dyn Evaluator> {
        Box::new(Self { inner, lights: Vec::new(), irradiance: OnceLock::new(), environment: None })
    }

    fn take(&mut self, lights: &[Light]) {
        self.lights = lights.to_vec();
        self.irradiance = OnceLock::new();
    }

    /// Refuses values beyond what the lights in force could make.
    fn checked(&mut self, values: Vec<DVec3>, what: &str) -> Result<Vec<DVec3>> {
        let largest = values.iter().fold(0.0_f64, |most, v| {
            let [x, y, z] = v.to_array().map(f64::abs);
            // Not `max`, which passes over what is no number.
            [x, y, z].into_iter().fold(most, |most, x| if x <= most { most } else { x })
        });
        let Self { inner, lights, irradiance, environment } = self;
        let irradiance = *irradiance
            .get_or_init(|| lights.iter().map(|light| most_irradiance(light, &inner.scene().mesh, environment)).sum());
        if largest <= MOST_GAIN * irradiance {
            return Ok(values);
        }
        Err(Error::input(format!(
            "{what} of {largest:.3e} under light of at most {irradiance:.3e}: the asset is damaged; bake it again"
        )))
    }
}

/// Largest irradiance of a surface of the mesh under a light, any channel; infinite where the light may touch it.
fn most_irradiance(light: &Light, mesh: &Mesh, known: &mut Option<(Shared<EnvironmentMap>, f64)>) -> f64 {
    use std::f64::consts::PI;
    match light {
        Light::Constant { radiance } | Light::Area { radiance, .. } => PI * radiance.max_element(),
        Light::Directional { irradiance, .. } => irradiance.max_element(),
        Light::Point { at_mm, intensity } | Light::Spot { at_mm, intensity, .. } => {
            let [min, max] = mesh.bounds_local_mm();
            let local = *at_mm - mesh.origin_mm;
            let squared = local.distance_squared(local.clamp(min, max));
            if squared > 0.0 { intensity.max_element() / squared } else { f64::INFINITY }
        }
        Light::Environment { map, scale, .. } => {
            let largest = match known {
                Some((last, largest)) if Shared::ptr_eq(last, map) => *largest,
                _ => {
                    let largest = map.pixels().iter().flatten().fold(0.0_f32, |a, b| a.max(*b)).into();
                    *known = Some((Shared::clone(map), largest));
                    largest
                }
            };
            PI * largest * scale.max_element()
        }
    }
}

impl Evaluator for Guarded {
    forward_scene!(inner);

    fn set_lights(&mut self, lights: Vec<Light>, progress: &dyn Progress) -> Result<()> {
        self.take(&lights);
        self.inner.set_lights(lights, progress)
    }

    fn move_lights(&mut self, lights: Vec<Light>, progress: &dyn Progress) -> Result<()> {
        self.take(&lights);
        self.inner.move_lights(lights, progress)
    }

    fn set_media(&mut self, media: Vec<Medium>) -> Result<()> {
        self.inner.set_media(media)
    }

    fn set_profile(&mut self, profile: LoadedProfile) -> Result<()> {
        self.inner.set_profile(profile)
    }

    fn prepare_for_edits(&mut self, progress: &dyn Progress) {
        self.inner.prepare_for_edits(progress);
    }

    fn remember_lights(&mut self, count: usize) {
        self.inner.remember_lights(count);
    }

    fn answer_at_once(&mut self) {
        self.inner.answer_at_once();
    }

    fn refine(&mut self) -> Result<Refined> {
        self.inner.refine()
    }

    fn radiosity(&mut self, progress: &dyn Progress) -> Result<Vec<DVec3>> {
        let values = self.inner.radiosity(progress)?;
        self.checked(values, "radiosity")
    }

    fn radiosity_of(&mut self, vertices: &[u32], progress: &dyn Progress) -> Result<Vec<DVec3>> {
        let values = self.inner.radiosity_of(vertices, progress)?;
        self.checked(values, "radiosity")
    }

    fn single_scattering(&mut self, progress: &dyn Progress) -> Result<Option<Vec<DVec3>>> {
        let values = self.inner.single_scattering(progress)?;
        values.map(|values| self.checked(values, "single scattering")).transpose()
    }

    fn single_scattering_is(&self) -> SingleScattering {
        self.inner.single_scattering_is()
    }

    fn towards_eye(&self) -> Result<Option<Box<dyn TowardsEye + '_>>> {
        self.inner.towards_eye()
    }

    fn set_eye(&mut self, at_mm: DVec3) -> bool {
        self.inner.set_eye(at_mm)
    }

    fn prepare_points(&mut self, progress: &dyn Progress) -> Result<()> {
        self.inner.prepare_points(progress)
    }

    fn exitance_at_points(&self) -> Option<Box<dyn Exitance + '_>> {
        self.inner.exitance_at_points()
    }

    fn all_pairs(&mut self, progress: &dyn Progress) -> Result<Vec<DVec3>> {
        self.inner.all_pairs(progress)
    }

    #[cfg(feature = "gpu")]
    fn on_device(self: Box<Self>, device: &Arc<Device>) -> Result<Box<dyn DeviceEvaluator>> {
        self.inner.on_device(device)
    }
}
