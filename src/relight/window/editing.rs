//! Editing of a medium: by its coefficients, or by its colour and radius through the profile in force.

use std::sync::Arc;

use super::colours::{Answer, Question, Task};
use crate::evaluate::ProfileEdit;
use crate::medium::inversion::{Inversion, Radius, Reflector, Target};
use crate::medium::material::{Medium, OpticalProperties};
use crate::medium::profiles::model::{LoadedProfile, ProfileModel};

/// The set of sliders in use.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum By {
    #[default]
    Coefficients,
    Colour,
}

/// The profile in force and whether it may change.
pub(super) struct ProfileInForce {
    pub(super) model: ProfileModel,
    pub(super) loaded: Arc<LoadedProfile>,
    /// What tells the colours of media.
    pub(super) reflector: Reflector,
    /// Reason why the profile cannot be changed.
    pub(super) locked: Option<&'static str>,
    /// Reason why the last requested profile is not in force.
    pub(super) refused: Option<String>,
    /// Text in the profile field.
    pub(super) typed: String,
    /// Thickness of the next slab, mm.
    pub(super) slab_mm: f64,
}

impl ProfileInForce {
    pub(super) fn new(model: ProfileModel, loaded: Arc<LoadedProfile>, locked: Option<&'static str>) -> Self {
        let slab_mm = if let ProfileModel::Slab(thickness) = model { thickness } else { 2.0 };
        let reflector = Reflector::Profile(Arc::clone(&loaded));
        Self { model, loaded, reflector, locked, refused: None, typed: String::new(), slab_mm }
    }

    /// The same where kernels that walks have calibrated tell colours.
    pub(super) fn of_kernels(self, profile: ProfileEdit) -> Self {
        match profile {
            ProfileEdit::Calibrated => Self { reflector: Reflector::Volume, ..self },
            _ => self,
        }
    }

    pub(super) fn dipole(locked: Option<&'static str>) -> Self {
        Self::new(ProfileModel::Dipole, Arc::new(LoadedProfile::OfMedium(ProfileModel::Dipole)), locked)
    }

    /// The profile to set on an evaluator; none for the dipole, which it has in closed form.
    pub(super) fn in_place(&self) -> Option<Arc<LoadedProfile>> {
        (self.model != ProfileModel::Dipole).then(|| Arc::clone(&self.loaded))
    }

    /// The names of media in reports.
    pub(super) fn names(&self, media: &[Medium]) -> Vec<String> {
        let suffix = self.suffix();
        media.iter().map(|medium| format!("{}{suffix}", medium.name)).collect()
    }

    /// The text that the command line adds to the names of media.
    fn suffix(&self) -> String {
        if self.model == ProfileModel::Dipole { String::new() } else { format!(" ({})", self.model) }
    }

    /// Media without that suffix: the panel has a line of its own for the profile.
    pub(super) fn plain(&self, media: &[Medium]) -> Vec<Medium> {
        let suffix = self.suffix();
        let name = |m: &Medium| m.name.strip_suffix(&suffix).unwrap_or(&m.name).to_owned();
        media.iter().map(|m| Medium { name: name(m), properties: m.properties }).collect()
    }
}

/// Index of the medium, profile and task of a question.
type Asked = (usize, ProfileModel, Task);

/// The medium that is edited.
#[derive(Default)]
pub(super) struct Editing {
    pub(super) selected: usize,
    pub(super) by: By,
    pub(super) radius: Radius,
    /// The asked colour and radius; none until those of the medium are known.
    pub(super) target: Option<Target>,
    /// The medium that the profile gives for the target, or the reason why there is none.
    pub(super) answer: Option<Result<Inversion, String>>,
    asked: Option<Asked>,
    /// Ticket of the newest question.
    ticket: u64,
    /// Ticket of the question of `answer`.
    answered: u64,
}

impl Editing {
    /// Discards the target: the next one is the colour of the medium as it is.
    pub(super) fn restart(&mut self) {
        self.target = None;
    }

    /// Makes the medium's own colour and radius the target, once they are known.
    fn adopt(&mut self) {
        let is_known = self.by == By::Colour && self.target.is_none() && self.answered == self.ticket;
        if let (true, Some(Ok(found)), Some((_, _, task @ Task::ColourOf(_)))) =
            (is_known, &self.answer, &mut self.asked)
        {
            let target = Target::of_medium(&found.properties, self.radius, found.achieved, found.achieved);
            // The answer to that is here already, and to look at a medium does not change it.
            *task = Task::MediumOf(target);
            self.target = Some(target);
        }
    }

    /// Selects another medium.
    pub(super) fn select(&mut self, index: usize) {
        self.selected = index;
        self.answer = None;
        self.restart();
    }

    /// The next question about the selected medium with these properties, if it has not been asked yet.
    pub(super) fn question(&mut self, properties: OpticalProperties, profile: &ProfileInForce) -> Option<Question> {
        let task = match (self.by, self.target) {
            (By::Colour, Some(target)) => {
                let (g, eta_inside_over_outside) = (properties.g, properties.eta_inside_over_outside);
                Task::MediumOf(Target { g, eta_inside_over_outside, ..target })
            }
            _ => Task::ColourOf(properties),
        };
        let asked = Some((self.selected, profile.model.clone(), task));
        if self.asked == asked {
            self.adopt();
            return None;
        }
        self.asked = asked;
        self.ticket += 1;
        Some(Question { ticket: self.ticket, reflector: profile.reflector.clone(), task })
    }

    /// Handles an answer; returns the medium whose properties it changes. Late answers to older questions are ignored.
    pub(super) fn take_answer(&mut self, Answer { ticket, result }: Answer) -> Option<(usize, OpticalProperties)> {
        if ticket != self.ticket {
            return None;
        }
        let found = match (&result, &self.asked) {
            (Ok(found), Some((index, _, Task::MediumOf(_)))) => Some((*index, found.properties)),
            _ => None,
        };
        self.answer = Some(result.map_err(|error| error.message().to_owned()));
        self.answered = ticket;
        self.adopt();
        found
    }
}
