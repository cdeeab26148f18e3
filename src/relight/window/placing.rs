//! Opens models and places their evaluators on devices, as background work.

use std::path::Path;
use std::sync::Arc;

use super::session::OpenModel;
use crate::error::Result;
use crate::evaluate::{Capabilities, Evaluator, MaterialEdit, ProfileEdit};
use crate::evaluate::{DeviceEvaluator, device::Device};
use crate::medium::material::Medium;
use crate::medium::profiles::model::LoadedProfile;
use crate::progress::Silent;
use crate::relight::choice::{self, DeviceChoice};

/// The device of the window and its settings.
#[derive(Clone)]
pub(super) struct Placing {
    pub(super) device: Arc<Device>,
    pub(super) choice: DeviceChoice,
    pub(super) open: OpenModel,
}

impl Placing {
    /// A CPU evaluator with these media and with a profile in place of the dipole.
    ///
    /// # Errors
    /// Errors of the file, the profile and the media.
    pub(super) fn evaluator(
        &self,
        model: &Path,
        profile: Option<&LoadedProfile>,
        media: &[Medium],
    ) -> Result<Box<dyn Evaluator>> {
        let mut evaluator = (self.open)(model, profile)?;
        if evaluator.scene().media != media {
            evaluator.set_media(media.to_vec())?;
        }
        Ok(evaluator)
    }

    /// Places a model's evaluator on the device; returns it with a note for the user.
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
        let (mut evaluator, note) = choice::on(&self.device, self.choice, evaluator, &again)?;
        evaluator.prepare_for_edits(&Silent);
        Ok((evaluator, note))
    }
}

/// Reason why a window cannot change the profile.
pub(super) fn locked(capabilities: Capabilities, choice: DeviceChoice) -> Option<&'static str> {
    match (capabilities.profile, capabilities.material, choice) {
        (ProfileEdit::None, MaterialEdit::None, _) => {
            Some("baked in with the material; bake with --method editable for other profiles")
        }
        (ProfileEdit::None, ..) => Some(
            "the transport in this asset is that of dipoles; bake without --set transport=stored for other profiles",
        ),
        (ProfileEdit::Calibrated, ..) => {
            Some("the kernels are calibrated by walks, which have no profile; bake with --model dipole for profiles")
        }
        (ProfileEdit::OnCpu, _, DeviceChoice::Gpu) => Some(
            "the shaders of this method know the dipole alone; leave out --device gpu, or bake with --method editable",
        ),
        (ProfileEdit::OnCpu | ProfileEdit::Any, ..) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::SourceFields;

    #[test]
    fn profiles_are_for_samples_without_transport() {
        let of = |profile, choice| {
            locked(Capabilities { material: MaterialEdit::Any, profile, source_fields: SourceFields::None }, choice)
        };
        for choice in [DeviceChoice::Auto, DeviceChoice::Cpu, DeviceChoice::Gpu] {
            assert_eq!(of(ProfileEdit::Any, choice), None);
            assert_eq!(of(ProfileEdit::OnCpu, choice).is_some(), choice == DeviceChoice::Gpu);
            assert!(of(ProfileEdit::Calibrated, choice).is_some_and(|reason| reason.contains("--model dipole")));
            assert!(of(ProfileEdit::None, choice).is_some_and(|reason| reason.contains("transport=stored")));
        }
        let baked = Capabilities {
            material: MaterialEdit::None,
            profile: ProfileEdit::None,
            source_fields: SourceFields::None,
        };
        let baked = locked(baked, DeviceChoice::Auto);
        assert!(baked.is_some_and(|reason| reason.contains("baked in")));
    }
}
