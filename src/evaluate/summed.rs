//! Radiosity and isotropic single scattering as one, for who draws what leaves the surface.

use glam::DVec3;

use super::forward::forward_scene;
use super::{Evaluator, SingleScattering};
use crate::error::Result;
use crate::light::Light;
use crate::progress::Progress;
use crate::transport::scene::Medium;

/// An evaluator whose radiosity has in it what another has beside it.
pub struct Summed {
    evaluator: Box<dyn Evaluator>,
}

impl Summed {
    /// Of an evaluator; itself where it has nothing to add.
    pub fn of(evaluator: Box<dyn Evaluator>) -> Box<dyn Evaluator> {
        match evaluator.single_scattering_is() {
            SingleScattering::PerVertex => Box::new(Self { evaluator }),
            SingleScattering::None | SingleScattering::Included | SingleScattering::TowardsEye => evaluator,
        }
    }

    fn with_single(&mut self, mut radiosity: Vec<DVec3>, progress: &dyn Progress) -> Result<Vec<DVec3>> {
        let single = self.evaluator.single_scattering(progress)?.unwrap_or_default();
        radiosity.iter_mut().zip(single).for_each(|(sum, s)| *sum += s);
        Ok(radiosity)
    }
}

impl Evaluator for Summed {
    forward_scene!(evaluator);

    fn set_lights(&mut self, lights: Vec<Light>, progress: &dyn Progress) -> Result<()> {
        self.evaluator.set_lights(lights, progress)
    }

    fn set_media(&mut self, media: Vec<Medium>) -> Result<()> {
        self.evaluator.set_media(media)
    }

    fn radiosity(&mut self, progress: &dyn Progress) -> Result<Vec<DVec3>> {
        let radiosity = self.evaluator.radiosity(progress)?;
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
        _: &std::sync::Arc<super::device::Device>,
    ) -> Result<Box<dyn super::device::DeviceEvaluator>> {
        Err(crate::error::Error::unsupported(
            "single scattering beside the radiosity is added to it on the CPU: --device cpu, or bake it as a part of the radiosity \
             (--set single-scattering=folded)",
        ))
    }
}
