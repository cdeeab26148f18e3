//! The medium and the profile: presets, coefficients, or a colour and a radius.

use egui::{Color32, ComboBox, DragValue, Slider, SliderClamping, Ui};
use glam::DVec3;

use crate::evaluate::MaterialEdit;
use crate::medium::inversion::{Inversion, Radius, Target};
use crate::medium::material::{ETA_RANGE, OpticalProperties, presets};
use crate::medium::profiles::layers::THICKNESSES_MM;
use crate::medium::profiles::model::ProfileModel;
use crate::relight::window::desk::{Asked, Desk};
use crate::relight::window::editing::{By, ProfileInForce};

/// Colour of what is wrong.
pub(super) const BAD: Color32 = Color32::from_rgb(240, 120, 100);
/// Largest mean cosine of the slider: changes close to 1 are invisible.
const LARGEST_G: f64 = 0.95;
/// Profiles that are chosen by name; slabs have a thickness, files a path.
const NAMED: [&str; 7] =
    ["dipole", "better-dipole", "photon-beam", "burley", "burley:fit=diffuse", "burley:fit=dmfp", "gaussians:skin"];
/// Meaning of the colours.
const COLOUR: &str =
    "what a flat body scatters back under white light from everywhere, its highlight left out; linear sRGB";
const CHANNELS: [&str; 3] = ["R", "G", "B"];

/// Shows the material of the object; `free` tells whether a job may start.
pub(super) fn show(ui: &mut Ui, desk: &mut Desk, free: bool, asked: &mut Asked) {
    ui.strong("Material");
    let editable = desk.material == MaterialEdit::Any;
    if !editable {
        ui.weak("baked in: this asset's method fixes the material; bake with --method editable to change it");
    }
    choose_medium(ui, desk);
    ui.add_enabled_ui(editable, |ui| preset(ui, desk));
    ui.collapsing("optical properties", |ui| {
        ui.add_enabled_ui(editable, |ui| {
            ui.horizontal(|ui| {
                ui.selectable_value(&mut desk.editing.by, By::Coefficients, "coefficients");
                ui.selectable_value(&mut desk.editing.by, By::Colour, "colour + radius");
            });
            match desk.editing.by {
                By::Coefficients => {
                    desk.editing.restart();
                    coefficients(ui, desk);
                }
                By::Colour => colour(ui, desk),
            }
            phase_and_index(ui, desk);
        });
    });
    if let Some(reason) = &desk.refused {
        ui.colored_label(BAD, format!("not possible: {reason}"));
    }
    profile(ui, &mut desk.profile, free, asked);
}

fn choose_medium(ui: &mut Ui, desk: &mut Desk) {
    if desk.media.len() < 2 {
        return;
    }
    ui.horizontal_wrapped(|ui| {
        for (index, medium) in desk.media.iter().enumerate() {
            let label = format!("{} {}", index + 1, medium.name);
            if ui.selectable_label(desk.editing.selected == index, label).clicked() {
                desk.editing.select(index);
            }
        }
    });
}

fn preset(ui: &mut Ui, desk: &mut Desk) {
    let index = desk.editing.selected;
    let Some(name) = desk.media.get(index).map(|medium| medium.name.clone()) else { return };
    let mut chosen = None;
    ComboBox::from_id_salt("preset").selected_text(&name).width(140.0).show_ui(ui, |ui| {
        for preset in presets() {
            if ui.selectable_label(name == preset.name, preset.name).clicked() {
                chosen = Some(preset);
            }
        }
    });
    if let Some(preset) = chosen {
        desk.choose_preset(index, preset);
    }
}

/// Changes the selected medium; returns whether it changed.
fn edit(desk: &mut Desk, change: impl FnOnce(&mut OpticalProperties) -> bool) {
    let changed = desk.media.get_mut(desk.editing.selected).is_some_and(|medium| change(&mut medium.properties));
    if changed {
        desk.edited();
    }
}

fn coefficients(ui: &mut Ui, desk: &mut Desk) {
    edit(desk, |properties| {
        ui.label("scattering σs' per mm");
        let scattering = sliders(ui, &mut properties.sigma_s_reduced_per_mm, 1e-2, 100.0, 1e-4);
        ui.label("absorption σa per mm");
        sliders(ui, &mut properties.sigma_a_per_mm, 1e-4, 100.0, 1e-4) || scattering
    });
    if let Some(found) = found(ui, &desk.editing.answer) {
        swatch(ui, "colour", found.achieved);
    }
}

/// The medium that the profile gives; shows why there is none, or that it is not known yet.
fn found<'a>(ui: &mut Ui, answer: &'a Option<Result<Inversion, String>>) -> Option<&'a Inversion> {
    match answer {
        Some(Ok(found)) => return Some(found),
        Some(Err(reason)) => ui.colored_label(BAD, reason),
        None => ui.weak("..."),
    };
    None
}

fn colour(ui: &mut Ui, desk: &mut Desk) {
    let editing = &mut desk.editing;
    if !desk.profile.reflector.follows_medium() {
        ui.colored_label(
            BAD,
            "this profile is the same whatever the medium: it has no other colour and no other radius",
        );
        return;
    }
    let Some(target) = &mut editing.target else {
        return match &editing.answer {
            Some(Err(reason)) => drop(ui.colored_label(BAD, reason)),
            _ => drop(ui.weak("...")),
        };
    };
    asked_colour(ui, target);
    if let Some(found) = found(ui, &editing.answer) {
        swatch(ui, "achieved colour", found.achieved);
        if !found.is_reached() {
            let gap = found.gap();
            let worst = (0..3).max_by(|a, b| gap[*a].abs().total_cmp(&gap[*b].abs())).unwrap_or(0);
            let (channel, gap) = (CHANNELS[worst], gap[worst]);
            ui.colored_label(BAD, format!("out of the profile's reach: {channel} is off by {gap:+.3}"));
        }
    }
    let mut radius = editing.radius;
    ComboBox::from_id_salt("radius").selected_text(format!("{} mm", radius.name())).width(150.0).show_ui(ui, |ui| {
        for kind in Radius::ALL {
            ui.selectable_value(&mut radius, kind, kind.name());
        }
    });
    sliders(ui, &mut target.radius_mm, 1e-3, 1e3, 1e-6);
    if radius != editing.radius {
        editing.radius = radius;
        // The other length is the medium's own, and nothing changes.
        editing.restart();
    }
}

/// A button that opens a colour picker, and three numbers.
fn asked_colour(ui: &mut Ui, target: &mut Target) {
    ui.label("asked colour").on_hover_text(COLOUR);
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 4.0;
        let mut rgb = target.colour.as_vec3().to_array();
        if ui.color_edit_button_rgb(&mut rgb).changed() {
            target.colour = glam::Vec3::from_array(rgb).as_dvec3().clamp(DVec3::ZERO, DVec3::ONE);
        }
        for value in target.colour.as_mut() {
            ui.add(DragValue::new(value).speed(0.002).range(0.0..=1.0).fixed_decimals(3));
        }
    });
}

/// A colour as it looks in white light, with its numbers.
fn swatch(ui: &mut Ui, title: &str, colour: DVec3) {
    ui.label(title).on_hover_text(COLOUR);
    ui.horizontal(|ui| {
        let (rect, _) = ui.allocate_exact_size(ui.spacing().interact_size, egui::Sense::hover());
        ui.painter().rect_filled(rect, 2.0, shade(colour));
        let [r, g, b] = colour.to_array();
        ui.label(format!("{r:.3}  {g:.3}  {b:.3}"));
    });
}

/// Converts a linear colour to sRGB.
fn shade(colour: DVec3) -> Color32 {
    let [r, g, b] = colour.clamp(DVec3::ZERO, DVec3::ONE).as_vec3().to_array();
    egui::Rgba::from_rgb(r, g, b).into()
}

fn phase_and_index(ui: &mut Ui, desk: &mut Desk) {
    edit(desk, |properties| {
        let g = &mut properties.g;
        let range = g.min(-LARGEST_G)..=g.max(LARGEST_G);
        let phase = ui.add(plain(g, range).fixed_decimals(2).text("g"));
        let phase = phase.on_hover_text("mean cosine; keeps σs', so that only single scattering changes").changed();
        let eta = &mut properties.eta_inside_over_outside;
        let range = eta.min(ETA_RANGE.start().max(1.0))..=eta.max(ETA_RANGE.end().min(2.0));
        ui.add(plain(eta, range).fixed_decimals(2).text("η")).changed() || phase
    });
}

/// A slider that neither clamps nor rounds the value it shows: viewing a medium does not change it.
fn plain(value: &mut f64, range: std::ops::RangeInclusive<f64>) -> Slider<'_> {
    Slider::new(value, range).clamping(SliderClamping::Edits)
}

fn sliders(ui: &mut Ui, value: &mut DVec3, least: f64, most: f64, smallest: f64) -> bool {
    let mut changed = false;
    for (name, channel) in CHANNELS.into_iter().zip(value.as_mut()) {
        let range = channel.min(least)..=channel.max(most);
        let slider = plain(channel, range).logarithmic(true).smallest_positive(smallest).max_decimals(4);
        changed |= ui.add(slider.text(name)).changed();
    }
    changed
}

fn profile(ui: &mut Ui, profile: &mut ProfileInForce, free: bool, asked: &mut Asked) {
    ui.horizontal(|ui| {
        ui.label("profile");
        let enabled = profile.locked.is_none() && free;
        ui.add_enabled_ui(enabled, |ui| {
            let shown = short(&profile.model);
            ComboBox::from_id_salt("profile").selected_text(shown).width(150.0).show_ui(ui, |ui| {
                let slab = ProfileModel::Slab(profile.slab_mm);
                let models = NAMED.iter().filter_map(|name| ProfileModel::parse(name).ok()).chain([slab]);
                for model in models {
                    if ui.selectable_label(profile.model == model, model.to_string()).clicked() {
                        asked.profile = Some(model);
                    }
                }
            });
        });
    });
    if let Some(reason) = profile.locked {
        ui.weak(reason);
        return;
    }
    ui.add_enabled_ui(free, |ui| {
        if let ProfileModel::Slab(_) = profile.model {
            let value = DragValue::new(&mut profile.slab_mm).speed(0.05).range(THICKNESSES_MM).suffix(" mm");
            let row = ui.horizontal(|ui| {
                ui.label("thickness");
                ui.add(value)
            });
            let slab = ProfileModel::Slab(profile.slab_mm);
            if (row.inner.drag_stopped() || row.inner.lost_focus()) && slab != profile.model {
                asked.profile = Some(slab);
            }
        }
        ui.collapsing("profile from a file", |ui| {
            let hint = "layers:path=FILE.toml";
            let text = ui.add(egui::TextEdit::singleline(&mut profile.typed).hint_text(hint));
            text.clone()
                .on_hover_text("as --profile takes it: layers, measured or gaussians with a path, or any other");
            if text.lost_focus() && ui.input(|input| input.key_pressed(egui::Key::Enter)) {
                match ProfileModel::parse(&profile.typed) {
                    Ok(model) => asked.profile = Some(model),
                    Err(error) => profile.refused = Some(error.message().to_owned()),
                }
            }
        });
    });
    if let Some(reason) = &profile.refused {
        ui.colored_label(BAD, format!("not possible: {reason}"));
    }
}

/// The profile's name, shortened to the end of a long path.
fn short(model: &ProfileModel) -> String {
    let text = model.to_string();
    let count = text.chars().count();
    if count <= 24 { text } else { format!("...{}", text.chars().skip(count - 21).collect::<String>()) }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn every_name_is_a_profile_and_long_ones_keep_their_end() {
        for name in NAMED {
            assert_eq!(ProfileModel::parse(name).unwrap().to_string(), name);
        }
        let long = ProfileModel::parse("measured:path=/some/where/far/away/marble.csv").unwrap();
        assert_eq!(short(&long), "...e/far/away/marble.csv");
    }

    #[test]
    fn swatches_are_gamma_encoded() {
        assert_eq!(shade(DVec3::ONE), Color32::WHITE);
        let [r, g, b, a] = shade(DVec3::new(0.5, 0.0, -1.0)).to_array();
        assert!(r.abs_diff(188) <= 1 && (g, b, a) == (0, 0, 255), "{r}");
    }
}
