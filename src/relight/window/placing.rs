//! Opens models and puts their evaluators where they run: work for threads that nobody waits for.

use std::path::Path;
use std::sync::Arc;

use super::{OpenModel, Profiles};
use crate::error::Result;
use crate::evaluate::device::{Device, DeviceEvaluator};
use crate::evaluate::{Evaluator, MaterialEdit};
use crate::medium::profiles::model::LoadedProfile;
use crate::relight::choice::{self, DeviceChoice};
use crate::transport::scene::Medium;

/// The device of the window and what is asked of it.
#[derive(Clone)]
pub(super) struct Placing {
    pub(super) device: Arc<Device>,
    pub(super) choice: DeviceChoice,
    pub(super) open: OpenModel,
}

impl Placing {
    /// An evaluator of the CPU with a profile in the dipole's place, and with these media.
    ///
    /// # Errors
    /// Those of the file, the profile and the media.
    pub(super) fn evaluator(
        &self,
        model: &Path,
        profile: Option<&LoadedProfile>,
        media: &[Medium],
    ) -> Result<Box<dyn Evaluator>> {
        let mut evaluator = (self.open)(model, profile)?.evaluator;
        if evaluator.scene().media != media {
            evaluator.set_media(media.to_vec())?;
        }
        Ok(evaluator)
    }

    /// Puts an evaluator of a model on the device; beside it what a person should know.
    ///
    /// # Errors
    /// As [`choice::on`].
    pub(super) fn place(
        &self,
        model: &Path,
        profile: Option<&LoadedProfile>,
        evaluator: Box<dyn Evaluator>,
    ) -> Result<(Box<dyn DeviceEvaluator>, Option<String>)> {
        let media = evaluator.scene().media.clone();
        let again = || self.evaluator(model, profile, &media);
        choice::on(&self.device, self.choice, evaluator, &again)
    }
}

/// Why a window has no other profile than the one in force.
pub(super) fn locked(profiles: Profiles, material: MaterialEdit, choice: DeviceChoice) -> Option<&'static str> {
    match (profiles, material, choice) {
        (_, MaterialEdit::None, _) => {
            Some("baked in with the material; bake with --method two_pass for other profiles")
        }
        (Profiles::Dipole, ..) => Some(
            "the transport in this asset is that of dipoles; bake with --method two_pass, which stores none, for other profiles",
        ),
        (Profiles::Any, _, DeviceChoice::Gpu) => {
            Some("the shaders know the dipole alone; leave out --device gpu for other profiles")
        }
        (Profiles::Any, ..) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn profiles_are_for_samples_that_the_cpu_gathers() {
        let of = |profiles, choice| locked(profiles, MaterialEdit::Any, choice);
        assert_eq!(of(Profiles::Any, DeviceChoice::Auto), None);
        assert_eq!(of(Profiles::Any, DeviceChoice::Cpu), None);
        assert!(of(Profiles::Any, DeviceChoice::Gpu).is_some_and(|reason| reason.contains("--device gpu")));
        assert!(of(Profiles::Dipole, DeviceChoice::Cpu).is_some_and(|reason| reason.contains("two_pass")));
        let baked = locked(Profiles::Dipole, MaterialEdit::None, DeviceChoice::Auto);
        assert!(baked.is_some_and(|reason| reason.contains("baked in")));
    }
}
