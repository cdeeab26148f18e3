//! Mouse and keys.

use winit::event::{ElementState, KeyEvent, MouseButton};
use winit::keyboard::{Key, NamedKey};

use super::{App, Drag};
use crate::relight::raster::view::Look;

/// Degrees that a drag over the height of the picture turns a light.
const LIGHT_DEGREES_PER_HEIGHT: f64 = 180.0;
/// Degrees that an arrow key turns a light.
const LIGHT_DEGREES_PER_KEY: f64 = 5.0;

impl App {
    pub(super) fn key(&mut self, event: &KeyEvent) {
        let Some(shown) = &mut self.shown else { return };
        if event.state != ElementState::Pressed || shown.screen.context.egui_wants_keyboard_input() {
            return;
        }
        let desk = &mut shown.desk;
        let step = LIGHT_DEGREES_PER_KEY;
        match &event.logical_key {
            Key::Named(NamedKey::ArrowLeft) => desk.turn_selected(-step, 0.0),
            Key::Named(NamedKey::ArrowRight) => desk.turn_selected(step, 0.0),
            Key::Named(NamedKey::ArrowUp) => desk.turn_selected(0.0, step),
            Key::Named(NamedKey::ArrowDown) => desk.turn_selected(0.0, -step),
            Key::Named(NamedKey::Space) => desk.turning = !desk.turning,
            Key::Named(NamedKey::Tab) => desk.panel_open = !desk.panel_open,
            Key::Character(text) => match text.to_lowercase().as_str() {
                "+" | "=" => desk.brighten_selected(0.5),
                "-" => desk.brighten_selected(-0.5),
                "w" => desk.wires = !desk.wires,
                "1" => desk.look = Look::Picture,
                "2" => desk.look = Look::Radiosity,
                "3" => desk.look = Look::Error,
                "s" => self.save_png(),
                _ => {}
            },
            _ => {}
        }
    }

    pub(super) fn moved(&mut self, x: f64, y: f64) {
        let (dx, dy) = (x - self.cursor.0, y - self.cursor.1);
        self.cursor = (x, y);
        let (Some(drag), Some(shown)) = (self.drag, &mut self.shown) else { return };
        let height = self.viewport.height as f64;
        match drag {
            Drag::Camera => shown.desk.orbit.drag(dx / height, dy / height),
            Drag::Light => {
                let degrees = LIGHT_DEGREES_PER_HEIGHT / height;
                shown.desk.turn_selected(dx * degrees, -dy * degrees);
            }
        }
    }

    pub(super) fn pressed(&mut self, state: ElementState, button: MouseButton) {
        let inside = self.cursor.0 < self.viewport.width as f64 && self.cursor.1 < self.viewport.height as f64;
        self.drag = match (state, button) {
            (ElementState::Released, _) => None,
            (ElementState::Pressed, MouseButton::Left) if inside && self.modifiers.shift_key() => Some(Drag::Light),
            (ElementState::Pressed, MouseButton::Left) if inside => Some(Drag::Camera),
            (ElementState::Pressed, MouseButton::Right) if inside => Some(Drag::Light),
            _ => self.drag,
        };
    }
}
