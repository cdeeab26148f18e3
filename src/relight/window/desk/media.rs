//! The media that the user edits, and the profile in force.

use std::sync::Arc;

use super::Desk;
use crate::medium::material::{Medium, Preset};
use crate::medium::profiles::model::{LoadedProfile, ProfileModel};
use crate::relight::window::colours::{Answer, Question};
use crate::relight::window::editing::ProfileInForce;

/// Name of a medium made in the window.
const CUSTOM: &str = "custom";

impl Desk {
    /// Renames the selected medium after a change of its coefficients, and counts a new state.
    pub(in crate::relight::window) fn edited(&mut self) {
        if let Some(medium) = self.media.get_mut(self.editing.selected) {
            CUSTOM.clone_into(&mut medium.name);
        }
        self.refused = None;
        self.serial += 1;
    }

    /// Replaces a medium by a preset.
    pub(in crate::relight::window) fn choose_preset(&mut self, medium: usize, preset: &Preset) {
        if let Some(medium) = self.media.get_mut(medium) {
            *medium = Medium { name: preset.name.to_owned(), properties: preset.properties() };
            self.refused = None;
            self.serial += 1;
            self.editing.restart();
        }
    }

    /// Adopts the media in force and discards refused drafts. The reason is shown until the next edit.
    pub(in crate::relight::window) fn settle_media(&mut self, accepted: Vec<Medium>, refused: Option<String>) {
        if let Some(reason) = refused {
            self.refused = Some(reason);
            self.media.clone_from(&accepted);
            self.editing.restart();
        }
        self.accepted = accepted;
    }

    /// Puts a profile in force.
    pub(in crate::relight::window) fn replace_profile(&mut self, model: ProfileModel, loaded: Arc<LoadedProfile>) {
        self.profile = ProfileInForce {
            typed: std::mem::take(&mut self.profile.typed),
            ..ProfileInForce::new(model, loaded, self.profile.locked)
        };
        self.error = None;
        self.serial += 1;
    }

    /// A question about the selected medium that has not been asked yet.
    pub(in crate::relight::window) fn question(&mut self) -> Option<Question> {
        let properties = self.media.get(self.editing.selected)?.properties;
        self.editing.question(properties, &self.profile)
    }

    /// Handles an answer; late answers to older questions are ignored.
    pub(in crate::relight::window) fn take_answer(&mut self, answer: Answer) {
        let Some((index, properties)) = self.editing.take_answer(answer) else { return };
        let changed = self.media.get_mut(index).filter(|m| m.properties != properties);
        if let Some(medium) = changed {
            *medium = Medium { name: CUSTOM.to_owned(), properties };
            self.refused = None;
            self.serial += 1;
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use glam::{DVec3, Vec3Swizzles};

    use super::super::tests::desk;
    use super::*;
    use crate::medium::fresnel::diffuse_transmittance;
    use crate::medium::inversion::{Inversion, Radius};
    use crate::medium::material::preset;
    use crate::relight::window::editing::By;

    /// Answers all questions; returns their number.
    fn settle(desk: &mut Desk) -> usize {
        let mut count = 0;
        while let Some(question) = desk.question() {
            count += 1;
            let result = question.answered();
            desk.take_answer(Answer { ticket: question.ticket, result });
        }
        count
    }

    /// A desk whose medium is edited by its colour.
    fn by_colour() -> Desk {
        let mut desk = desk();
        desk.editing.by = By::Colour;
        assert_eq!(settle(&mut desk), 1);
        desk
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
        let published = diffuse_transmittance(1.5) * DVec3::new(0.83, 0.79, 0.75);
        assert!((told - published).abs().max_element() < 0.02, "{told}");
        desk.editing.by = By::Colour;
        assert_eq!(settle(&mut desk), 0);
        assert_eq!(desk.editing.target.unwrap().colour, told);
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
        let mut desk = by_colour();
        let medium = desk.media[0].clone();
        let target = desk.editing.target.unwrap();
        let off = target.radius_mm / medium.properties.mean_free_path_mm() - 1.0;
        assert!(off.abs().max_element() < 1e-12 && medium.name == "marble");
        // Another colour.
        let serial = desk.serial;
        desk.editing.target.as_mut().unwrap().colour = DVec3::new(0.85, 0.2, 0.4);
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
        assert!((desk.editing.target.unwrap().colour.x - 0.41).abs() < 0.02 && desk.media[0].name == "skin1");
    }

    #[test]
    fn a_colour_stays_where_the_profile_changes_and_what_is_missing_is_told() {
        let mut desk = by_colour();
        desk.editing.target.as_mut().unwrap().colour = DVec3::new(0.90, 0.5, 0.1);
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
        let mut desk = by_colour();
        let (old, colour) = (desk.media.clone(), desk.editing.target.unwrap());
        desk.editing.target.as_mut().unwrap().colour = DVec3::splat(0.3);
        settle(&mut desk);
        desk.settle_media(old.clone(), Some("out of range".into()));
        settle(&mut desk);
        assert_eq!((&desk.media, desk.editing.target), (&old, Some(colour)));
        assert_eq!(desk.refused.as_deref(), Some("out of range"));
    }

    #[test]
    fn late_answers_move_nothing() {
        let mut desk = by_colour();
        desk.editing.target.as_mut().unwrap().colour = DVec3::splat(0.3);
        let late = desk.question().unwrap();
        desk.choose_preset(0, preset("cream").unwrap());
        let newer = desk.question().unwrap();
        desk.take_answer(Answer { ticket: late.ticket, result: late.answered() });
        assert_eq!((desk.media[0].name.as_str(), desk.editing.target), ("cream", None));
        desk.take_answer(Answer { ticket: newer.ticket, result: newer.answered() });
        assert!(desk.editing.target.unwrap().colour.x > 0.85);
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
