//! How a person edits a medium: by its coefficients, or by its colour and radius through the profile in force.

use std::sync::Arc;

use super::colours::{Answer, Question, Task};
use crate::medium::inversion::{Inversion, Radius, Target};
use crate::medium::material::{Medium, OpticalProperties};
use crate::medium::profiles::model::{LoadedProfile, ProfileModel};

/// The sliders that a person moves.
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
    /// Why there can be no other one.
    pub(super) locked: Option<&'static str>,
    /// Why the last one that was asked for is not in force.
    pub(super) refused: Option<String>,
    /// The text in the field of profiles.
    pub(super) typed: String,
    /// Thickness (mm) of the next slab.
    pub(super) slab_mm: f64,
}

impl ProfileInForce {
    pub(super) fn new(model: ProfileModel, loaded: Arc<LoadedProfile>, locked: Option<&'static str>) -> Self {
        let slab_mm = if let ProfileModel::Slab(thickness) = model { thickness } else { 2.0 };
        Self { model, loaded, locked, refused: None, typed: String::new(), slab_mm }
    }

    pub(super) fn dipole(locked: Option<&'static str>) -> Self {
        Self::new(ProfileModel::Dipole, Arc::new(LoadedProfile::OfMedium(ProfileModel::Dipole)), locked)
    }

    /// The profile that an evaluator is given: none for the dipole, which it has in closed form.
    pub(super) fn in_place(&self) -> Option<Arc<LoadedProfile>> {
        (self.model != ProfileModel::Dipole).then(|| Arc::clone(&self.loaded))
    }

    /// The names of media as reports have them.
    pub(super) fn names(&self, media: &[Medium]) -> Vec<String> {
        let suffix = self.suffix();
        media.iter().map(|medium| format!("{}{suffix}", medium.name)).collect()
    }

    /// The text that the command line adds to the names of media.
    fn suffix(&self) -> String {
        if self.model == ProfileModel::Dipole { String::new() } else { format!(" ({})", self.model) }
    }

    /// Media without that text: the panel has a line of its own for the profile.
    pub(super) fn plain(&self, media: &[Medium]) -> Vec<Medium> {
        let suffix = self.suffix();
        let name = |m: &Medium| m.name.strip_suffix(&suffix).unwrap_or(&m.name).to_owned();
        media.iter().map(|m| Medium { name: name(m), properties: m.properties }).collect()
    }
}

/// The index of a medium, the profile and the task of a question.
type Asked = (usize, ProfileModel, Task);

/// The medium that is edited.
#[derive(Default)]
pub(super) struct Editing {
    pub(super) selected: usize,
    pub(super) by: By,
    pub(super) radius: Radius,
    /// The colour and radius that are asked for; none until those of the medium are known.
    pub(super) target: Option<Target>,
    /// The medium that the profile finds for it, or why there is none.
    pub(super) answer: Option<Result<Inversion, String>>,
    asked: Option<Asked>,
    /// Ticket of the newest question.
    ticket: u64,
    /// Ticket of the question that `answer` is for.
    answered: u64,
}

impl Editing {
    /// Forgets the target: the next one is the colour of the medium as it is.
    pub(super) fn restart(&mut self) {
        self.target = None;
    }

    /// Takes the medium's own colour and radius as the target, as soon as they are known.
    fn adopt(&mut self) {
        let is_known = self.by == By::Colour && self.target.is_none() && self.answered == self.ticket;
        if let (true, Some(Ok(found)), Some((_, _, task @ Task::ColourOf(_)))) =
            (is_known, &self.answer, &mut self.asked)
        {
            let target = Target::of_medium(&found.properties, self.radius, found.achieved);
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

    /// The question about the selected medium, of these properties, that is not asked yet.
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
        Some(Question { ticket: self.ticket, profile: Arc::clone(&profile.loaded), task })
    }

    /// Takes in an answer; gives the medium that gets other properties by it. Answers to older questions are late.
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
