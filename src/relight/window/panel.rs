//! The panel beside the picture, and the text over it.

mod material;

use egui::{Align2, Color32, RichText, ScrollArea, Slider, Ui};

use self::material::BAD;
use super::desk::{Asked, Desk};
use crate::light::Light;
use crate::relight::lights::{AdjustedLight, MAX_STOPS};
use crate::relight::raster::view::{ERROR_COLOURS, Look};
use crate::render::blinn_phong::EXPONENTS;
use crate::render::highlight::HighlightShape;

/// Width in points, suitable also for a window of 640 points.
const WIDTH: f32 = 250.0;
/// Numbers shown in the window.
#[derive(Clone, Debug, Default)]
pub(super) struct Figures {
    pub(super) frames_per_second: f64,
    pub(super) updates_per_second: f64,
    pub(super) light_ms: f64,
    pub(super) transport_ms: f64,
    pub(super) adapter: String,
    pub(super) transport: String,
    /// Name and progress of the running job.
    pub(super) job: Option<(&'static str, f32)>,
    /// Whether the picture has dipoles while kernels are calibrated.
    pub(super) is_rough: bool,
}

/// Shows everything; returns the user's requests. The rest of `ui` is for the picture.
pub(super) fn show(ui: &mut Ui, desk: &mut Desk, figures: &Figures) -> Asked {
    let mut asked = Asked::default();
    let mut open = desk.panel_open;
    egui::Panel::right("panel").default_size(WIDTH).show_collapsible(ui, &mut open, |ui| {
        ScrollArea::vertical().auto_shrink([false, false]).show(ui, |ui| {
            ui.spacing_mut().slider_width = (ui.available_width() - 125.0).clamp(60.0, 400.0);
            let before = desk.serial;
            lights(ui, desk);
            ui.separator();
            let free = figures.job.is_none();
            material::show(ui, desk, free, &mut asked);
            ui.separator();
            picture(ui, desk);
            ui.separator();
            views(ui, desk, figures, &mut asked);
            ui.separator();
            ui.horizontal_wrapped(|ui| {
                asked.save_png |= ui.add_enabled(free, egui::Button::new("Save PNG")).clicked();
                asked.save_render |= ui.add_enabled(free, egui::Button::new("Render EXR + PNG")).clicked();
            });
            ui.separator();
            help(ui);
            debug_assert!(desk.serial >= before);
        });
    });
    desk.panel_open = open;
    overlays(ui, desk, figures);
    asked
}

fn lights(ui: &mut Ui, desk: &mut Desk) {
    ui.horizontal(|ui| {
        ui.strong("Lights");
        ui.checkbox(&mut desk.turning, "turn");
        if ui.small_button("reset").clicked() {
            desk.turn_degrees = 0.0;
            desk.serial += 1;
        }
    });
    if desk.entries.is_empty() {
        ui.weak("none; drop a .hdr or .exr file here");
    }
    let mut changed = false;
    for (index, entry) in desk.entries.iter_mut().enumerate() {
        ui.push_id(index, |ui| {
            ui.horizontal(|ui| {
                changed |= ui.checkbox(&mut entry.on, "").changed();
                let name = format!("{} {}", index + 1, entry.base.kind().name());
                if ui.selectable_label(desk.selected == index, name).clicked() {
                    desk.selected = index;
                }
            });
            if desk.selected == index {
                changed |= light(ui, entry);
            }
        });
    }
    desk.serial += u64::from(changed);
}

fn light(ui: &mut Ui, entry: &mut AdjustedLight) -> bool {
    let mut changed = false;
    let mut slider = |ui: &mut Ui, slider: Slider| changed |= ui.add(slider).changed();
    if entry.turns() {
        let text = if matches!(entry.base, Light::Environment { .. }) { "rotate" } else { "azimuth" };
        let range = if entry.azimuth_degrees > 180.0 { 0.0..=360.0 } else { -180.0..=180.0 };
        slider(ui, Slider::new(&mut entry.azimuth_degrees, range).suffix("°").fixed_decimals(0).text(text));
    }
    if let Some(elevation) = &mut entry.elevation_degrees {
        slider(ui, Slider::new(elevation, -90.0..=90.0).suffix("°").fixed_decimals(0).text("height"));
    }
    slider(ui, Slider::new(&mut entry.stops, -MAX_STOPS..=MAX_STOPS).fixed_decimals(1).text("stops"));
    changed
}

fn picture(ui: &mut Ui, desk: &mut Desk) {
    ui.strong("Picture");
    ui.horizontal(|ui| {
        ui.label("exposure");
        let factor = desk.exposure_factor();
        if ui.checkbox(&mut desk.auto_exposure, "auto").changed() && !desk.auto_exposure {
            desk.stops = factor.log2();
        }
    });
    ui.add_enabled(
        !desk.auto_exposure,
        Slider::new(&mut desk.stops, -16.0..=16.0).clamping(egui::SliderClamping::Edits).fixed_decimals(1).text("EV"),
    );
    ui.checkbox(&mut desk.reflects, "reflection");
    ui.add_enabled_ui(desk.reflects, |ui| highlights(ui, desk));
    if desk.has_texture {
        ui.checkbox(&mut desk.textured, "texture");
    }
    ui.checkbox(&mut desk.wires, "wireframe");
}

fn highlights(ui: &mut Ui, desk: &mut Desk) {
    ui.horizontal(|ui| {
        ui.selectable_value(&mut desk.highlights, HighlightShape::Ggx, "GGX");
        ui.selectable_value(&mut desk.highlights, HighlightShape::BlinnPhong, "Blinn-Phong");
    });
    ui.add(match desk.highlights {
        HighlightShape::Ggx => Slider::new(&mut desk.roughness, 0.0..=1.0).fixed_decimals(2).text("roughness"),
        HighlightShape::BlinnPhong => {
            Slider::new(&mut desk.exponent, EXPONENTS).logarithmic(true).fixed_decimals(0).text("exponent")
        }
    });
}

fn views(ui: &mut Ui, desk: &mut Desk, figures: &Figures, asked: &mut Asked) {
    ui.horizontal_wrapped(|ui| {
        ui.strong("View");
        ui.selectable_value(&mut desk.look, Look::Picture, "picture");
        ui.selectable_value(&mut desk.look, Look::Radiosity, "radiosity");
        ui.selectable_value(&mut desk.look, Look::Error, "error");
    });
    if desk.look == Look::Error {
        ui.label("The asset's transport against all pairs of its own samples, relative to the RMS.");
        let label = if desk.error.is_some() { "Measure again" } else { "Measure (stops the lights)" };
        asked.measure_error |= ui.add_enabled(figures.job.is_none(), egui::Button::new(label)).clicked();
        if let Some(error) = desk.error {
            ui.label(format!("{:.3} % RMS, worst vertex {:.2} %", 100.0 * error.rms, 100.0 * error.worst));
            if error.serial != desk.serial {
                ui.colored_label(BAD, "stale: light or material changed since");
            }
        }
    }
}

fn help(ui: &mut Ui) {
    ui.collapsing("Mouse and keys", |ui| {
        for line in [
            "drag: turn the camera; wheel: nearer, farther",
            "right drag or Shift + drag: turn the light",
            "arrows: turn the light; + and -: its brightness",
            "space: lights turn; W: wireframe; Tab: this panel",
            "1 picture, 2 radiosity, 3 error; S: save a PNG",
            "drop .tlux: model; .hdr or .exr: environment",
        ] {
            ui.small(line);
        }
    });
}

fn overlays(ui: &mut Ui, desk: &mut Desk, figures: &Figures) {
    let rect = ui.available_rect_before_wrap();
    let area = |name: &'static str, align: Align2| {
        let position = align.pos_in_rect(&rect.shrink(8.0));
        egui::Area::new(egui::Id::unique(name)).pivot(align).fixed_pos(position).order(egui::Order::Background)
    };
    let frame = egui::Frame::new().fill(Color32::from_black_alpha(170)).inner_margin(6).corner_radius(4);
    let width = (rect.width() - 40.0).clamp(80.0, 520.0);
    area("figures", Align2::LEFT_BOTTOM).interactable(false).show(ui.ctx(), |ui| {
        frame.show(ui, |ui| {
            ui.set_max_width(width);
            if let Some(message) = &desk.message {
                let colour = if message.bad { BAD } else { Color32::WHITE };
                ui.label(RichText::new(&message.text).color(colour));
            }
            if let Some((name, share)) = figures.job {
                ui.label(format!("{name} ... {:.0} %", 100.0 * share));
            }
            if figures.is_rough {
                ui.label("the dipole for now: walks through the body calibrate the kernels");
            }
            ui.label(format!(
                "{:.0} fps | {:.0} light updates/s | light {:.1} ms, transport {:.1} ms",
                figures.frames_per_second, figures.updates_per_second, figures.light_ms, figures.transport_ms
            ));
            ui.small(format!("transport on {}, drawn by {}", figures.transport, figures.adapter));
        });
    });
    if !desk.panel_open {
        area("open", Align2::RIGHT_TOP).show(ui.ctx(), |ui| {
            if ui.button("panel (Tab)").clicked() {
                desk.panel_open = true;
            }
        });
    }
    if desk.look == Look::Error {
        area("legend", Align2::LEFT_TOP).interactable(false).show(ui.ctx(), |ui| {
            frame.show(ui, |ui| match desk.error {
                Some(error) => legend(ui, error.scale),
                None => drop(ui.label("not measured yet")),
            });
        });
    }
}

/// The colour legend from 0 to the end of the scale.
fn legend(ui: &mut Ui, scale: f64) {
    let (rect, _) = ui.allocate_exact_size(egui::vec2(200.0, 12.0), egui::Sense::hover());
    let colour = |c: [f32; 3]| Color32::from_rgb((c[0] * 255.0) as u8, (c[1] * 255.0) as u8, (c[2] * 255.0) as u8);
    let mut mesh = egui::Mesh::default();
    for (i, stop) in ERROR_COLOURS.iter().enumerate() {
        let x = rect.left() + rect.width() * i as f32 / (ERROR_COLOURS.len() - 1) as f32;
        mesh.colored_vertex(egui::pos2(x, rect.top()), colour(*stop));
        mesh.colored_vertex(egui::pos2(x, rect.bottom()), colour(*stop));
        if i > 0 {
            let first = 2 * (i as u32 - 1);
            mesh.add_triangle(first, first + 1, first + 2);
            mesh.add_triangle(first + 1, first + 2, first + 3);
        }
    }
    ui.painter().add(mesh);
    ui.horizontal(|ui| {
        ui.set_width(rect.width());
        ui.small("0 %");
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            ui.small(format!("{:.2} % and more", 100.0 * scale));
        });
    });
}
