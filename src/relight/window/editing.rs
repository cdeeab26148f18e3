//! How a person edits a medium: by its coefficients, or by its colour and radius through the profile in use.

use std::sync::Arc;

use super::colours::{Answer, Question, Task};
use super::desk::Desk;
use crate::medium::inversion::{Inversion, Radius, Target};
use crate::medium::material::{Medium, Preset};
use crate::medium::profiles::model::{LoadedProfile, ProfileModel};

/// Name of a medium that somebody made here.
const CUSTOM: &str = "custom";

/// What a person moves.
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
    /// As it is typed.
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

    /// What an evaluator is given: nothing for the dipole, which it has in closed form.
    pub(super) fn in_place(&self) -> Option<Arc<LoadedProfile>> {
        (self.model != ProfileModel::Dipole).then(|| Arc::clone(&self.loaded))
    }

    /// Media as reports name them.
    pub(super) fn names(&self, media: &[Medium]) -> Vec<String> {
        let suffix = self.suffix();
        media.iter().map(|medium| format!("{}{suffix}", medium.name)).collect()
    }

    /// What the command line adds to the names of media.
    fn suffix(&self) -> String {
        if self.model == ProfileModel::Dipole { String::new() } else { format!(" ({})", self.model) }
    }

    /// Media without it: here the profile has a line of its own.
    pub(super) fn plain(&self, media: &[Medium]) -> Vec<Medium> {
        let suffix = self.suffix();
        let name = |m: &Medium| m.name.strip_suffix(&suffix).unwrap_or(&m.name).to_owned();
        media.iter().map(|m| Medium { name: name(m), properties: m.properties }).collect()
    }
}

/// Whose colour by which profile is asked.
type Asked = (usize, ProfileModel, Task);

/// The medium that is edited.
#[derive(Default)]
pub(super) struct Editing {
    pub(super) selected: usize,
    pub(super) by: By,
    pub(super) radius: Radius,
    /// The colour and radius that are asked for; none until those of the medium are known.
    pub(super) target: Option<Target>,
    /// What the profile says to it.
    pub(super) answer: Option<Result<Inversion, String>>,
    asked: Option<Asked>,
    /// Of the newest question, and of the one that `answer` is for.
    ticket: u64,
    answered: u64,
}

impl Editing {
    /// From the medium as it is.
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
            // What the profile says to that is here, and to look at a medium does not change it.
            *task = Task::MediumOf(target);
            self.target = Some(target);
        }
    }
}

impl Desk {
    /// Another medium.
    pub(super) fn select_medium(&mut self, index: usize) {
        self.editing.selected = index;
        self.editing.answer = None;
        self.editing.restart();
    }

    /// Somebody has changed the selected medium.
    pub(super) fn edited(&mut self) {
        if let Some(medium) = self.media.get_mut(self.editing.selected) {
            CUSTOM.clone_into(&mut medium.name);
        }
        self.refused = None;
        self.serial += 1;
    }

    /// A preset in place of a medium.
    pub(super) fn choose_preset(&mut self, medium: usize, preset: &Preset) {
        if let Some(medium) = self.media.get_mut(medium) {
            *medium = Medium { name: preset.name.to_owned(), properties: preset.properties() };
            self.refused = None;
            self.serial += 1;
            self.editing.restart();
        }
    }

    /// The media in force; drafts that were refused are forgotten. Why they were is told until the next edit.
    pub(super) fn settle_media(&mut self, accepted: Vec<Medium>, refused: Option<String>) {
        if let Some(reason) = refused {
            self.refused = Some(reason);
            self.media.clone_from(&accepted);
            self.editing.restart();
        }
        self.accepted = accepted;
    }

    /// Another profile is in force.
    pub(super) fn replace_profile(&mut self, model: ProfileModel, loaded: Arc<LoadedProfile>) {
        self.profile = ProfileInForce {
            typed: std::mem::take(&mut self.profile.typed),
            ..ProfileInForce::new(model, loaded, self.profile.locked)
        };
        self.error = None;
        self.serial += 1;
    }

    /// What is not known yet about the selected medium.
    pub(super) fn question(&mut self) -> Option<Question> {
        let properties = self.media.get(self.editing.selected)?.properties;
        let editing = &mut self.editing;
        let task = match (editing.by, editing.target) {
            (By::Colour, Some(target)) => {
                let (g, eta_inside_over_outside) = (properties.g, properties.eta_inside_over_outside);
                Task::MediumOf(Target { g, eta_inside_over_outside, ..target })
            }
            _ => Task::ColourOf(properties),
        };
        let asked = Some((editing.selected, self.profile.model.clone(), task));
        if editing.asked == asked {
            editing.adopt();
            return None;
        }
        editing.asked = asked;
        editing.ticket += 1;
        Some(Question { ticket: editing.ticket, profile: Arc::clone(&self.profile.loaded), task })
    }

    /// Takes in what is known now; answers to older questions are late.
    pub(super) fn take_answer(&mut self, Answer { ticket, result }: Answer) {
        if ticket != self.editing.ticket {
            return;
        }
        if let (Ok(found), Some((index, _, Task::MediumOf(_)))) = (&result, &self.editing.asked) {
            let changed = self.media.get_mut(*index).filter(|m| m.properties != found.properties);
            if let Some(medium) = changed {
                *medium = Medium { name: CUSTOM.to_owned(), properties: found.properties };
                self.refused = None;
                self.serial += 1;
            }
        }
        self.editing.answer = Some(result.map_err(|error| error.message().to_owned()));
        self.editing.answered = ticket;
        self.editing.adopt();
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use glam::{DVec3, Vec3Swizzles};

    use super::*;
    use crate::medium::material::preset;
    use crate::relight::window::desk::tests::desk;

    /// Answers all questions; how many there were.
    fn settle(desk: &mut Desk) -> usize {
        let mut count = 0;
        while let Some(question) = desk.question() {
            count += 1;
            let result = question.answered();
            desk.take_answer(Answer { ticket: question.ticket, result });
        }
        count
    }

    fn put(desk: &mut Desk, text: &str) {
        let model = ProfileModel::parse(text).unwrap();
        let loaded = Arc::new(model.load().unwrap());
        desk.replace_profile(model, loaded);
    }

    fn found(desk: &Desk) -> Inversion {
        desk.editing.answer.clone().unwrap().unwrap()
    }

    #[test]
    fn a_refused_material_goes_back_and_says_why() {
        let mut desk = desk();
        let old = desk.media.clone();
        desk.choose_preset(0, preset("skin1").unwrap());
        desk.settle_media(old.clone(), Some("no".into()));
        assert_eq!((&desk.media, desk.refused.as_deref()), (&old, Some("no")));
        // Lights that turn on do not take the reason away.
        desk.settle_media(old.clone(), None);
        assert_eq!((&desk.media, desk.refused.as_deref()), (&old, Some("no")));
        desk.choose_preset(0, preset("skin1").unwrap());
        let new = desk.media.clone();
        desk.settle_media(new.clone(), None);
        assert_eq!((&desk.accepted, &desk.refused), (&new, &None));
        // An answer to an older state does not move the sliders.
        desk.choose_preset(0, preset("cream").unwrap());
        desk.settle_media(old, None);
        assert_eq!(desk.media[0].name, "cream");
    }

    #[test]
    fn the_colour_of_a_medium_is_told_and_to_look_at_it_changes_nothing() {
        let mut desk = desk();
        let (before, serial) = (desk.media.clone(), desk.serial);
        assert_eq!(settle(&mut desk), 1);
        let told = found(&desk).achieved;
        assert!((told - DVec3::new(0.83, 0.79, 0.75)).abs().max_element() < 0.02, "{told}");
        desk.editing.by = By::Colour;
        assert_eq!(settle(&mut desk), 0);
        assert_eq!(desk.editing.target.unwrap().reflectance, told);
        // The other length.
        desk.editing.radius = Radius::DiffusionLength;
        desk.editing.restart();
        assert_eq!(settle(&mut desk), 1);
        assert_eq!(desk.editing.target.unwrap().radius_mm, before[0].properties.diffusion_length_mm());
        // And back.
        desk.editing.by = By::Coefficients;
        desk.editing.restart();
        settle(&mut desk);
        assert_eq!((&desk.media, desk.serial), (&before, serial));
    }

    #[test]
    fn a_medium_follows_its_colour_and_radius() {
        let mut desk = desk();
        desk.editing.by = By::Colour;
        assert_eq!(settle(&mut desk), 1);
        let medium = desk.media[0].clone();
        let target = desk.editing.target.unwrap();
        let off = target.radius_mm / medium.properties.mean_free_path_mm() - 1.0;
        assert!(off.abs().max_element() < 1e-12 && medium.name == "marble");
        // Another colour.
        let serial = desk.serial;
        desk.editing.target.as_mut().unwrap().reflectance = DVec3::new(0.9, 0.2, 0.4);
        assert_eq!(settle(&mut desk), 1);
        assert_eq!((desk.media[0].name.as_str(), desk.serial), ("custom", serial + 1));
        assert_eq!(desk.media[0].properties, found(&desk).properties);
        assert!(found(&desk).is_reached());
        // Another index: the same colour needs another albedo.
        let red = desk.media[0].properties.sigma_a_per_mm.x;
        desk.media[0].properties.eta_inside_over_outside = 1.1;
        desk.edited();
        assert_eq!(settle(&mut desk), 1);
        assert!(found(&desk).is_reached() && desk.media[0].properties.eta_inside_over_outside == 1.1);
        assert!((desk.media[0].properties.sigma_a_per_mm.x / red - 1.0).abs() > 0.1);
        // The colour of a preset takes the place of the one that was asked for.
        desk.choose_preset(0, preset("skin1").unwrap());
        assert_eq!(settle(&mut desk), 1);
        assert!((desk.editing.target.unwrap().reflectance.x - 0.44).abs() < 0.02 && desk.media[0].name == "skin1");
    }

    #[test]
    fn a_colour_stays_where_the_profile_changes_and_what_is_missing_is_told() {
        let mut desk = desk();
        desk.editing.by = By::Colour;
        settle(&mut desk);
        desk.editing.target.as_mut().unwrap().reflectance = DVec3::new(0.99, 0.5, 0.1);
        settle(&mut desk);
        let dipole = desk.media[0].properties;
        put(&mut desk, "photon-beam");
        assert_eq!(settle(&mut desk), 1);
        let told = found(&desk);
        assert!(desk.media[0].properties != dipole && !told.is_reached());
        assert!(told.gap().x < -0.01 && told.gap().yz().abs().max_element() < 1e-6, "{}", told.gap());
        // A profile that no medium changes: the medium stays as it is.
        let (before, serial) = (desk.media.clone(), desk.serial);
        put(&mut desk, "gaussians:skin");
        assert_eq!(settle(&mut desk), 1);
        assert!(desk.editing.answer.as_ref().unwrap().as_ref().is_err_and(|e| e.contains("whatever the medium")));
        assert_eq!((&desk.media, desk.serial), (&before, serial + 1));
        put(&mut desk, "dipole");
        settle(&mut desk);
        assert!(found(&desk).is_reached());
    }

    #[test]
    fn a_refused_colour_goes_back_to_that_of_the_medium_in_force() {
        let mut desk = desk();
        desk.editing.by = By::Colour;
        settle(&mut desk);
        let (old, colour) = (desk.media.clone(), desk.editing.target.unwrap());
        desk.editing.target.as_mut().unwrap().reflectance = DVec3::splat(0.3);
        settle(&mut desk);
        desk.settle_media(old.clone(), Some("out of range".into()));
        settle(&mut desk);
        assert_eq!((&desk.media, desk.editing.target), (&old, Some(colour)));
        assert_eq!(desk.refused.as_deref(), Some("out of range"));
    }

    #[test]
    fn late_answers_move_nothing() {
        let mut desk = desk();
        desk.editing.by = By::Colour;
        settle(&mut desk);
        desk.editing.target.as_mut().unwrap().reflectance = DVec3::splat(0.3);
        let late = desk.question().unwrap();
        desk.choose_preset(0, preset("cream").unwrap());
        let newer = desk.question().unwrap();
        desk.take_answer(Answer { ticket: late.ticket, result: late.answered() });
        assert_eq!((desk.media[0].name.as_str(), desk.editing.target), ("cream", None));
        desk.take_answer(Answer { ticket: newer.ticket, result: newer.answered() });
        assert!(desk.editing.target.unwrap().reflectance.x > 0.9);
    }

    #[test]
    fn names_tell_the_profile_as_the_command_line_does() {
        let mut desk = desk();
        assert_eq!(desk.profile.names(&desk.media), ["marble"]);
        assert!(desk.profile.in_place().is_none());
        put(&mut desk, "better-dipole");
        let names = desk.profile.names(&desk.media);
        assert_eq!(names, ["marble (better-dipole)"]);
        let named = [Medium { name: names[0].clone(), ..desk.media[0].clone() }];
        assert_eq!(desk.profile.plain(&named), desk.media);
        assert!(desk.profile.in_place().is_some());
    }
}
