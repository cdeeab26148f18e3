//! The events of the window system, mouse and keys among them.

use winit::application::ApplicationHandler;
use winit::event::{ElementState, KeyEvent, MouseButton, MouseScrollDelta, StartCause, WindowEvent};
use winit::event_loop::ActiveEventLoop;
use winit::keyboard::{Key, NamedKey};
use winit::window::WindowId;

use super::{App, Drag};
use crate::relight::raster::view::Look;

/// Degrees that a drag over the height of the picture turns a light.
const LIGHT_DEGREES_PER_HEIGHT: f64 = 180.0;
/// Degrees that an arrow key turns a light.
const LIGHT_DEGREES_PER_KEY: f64 = 5.0;

impl ApplicationHandler for App {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        let Some(session) = self.session.take() else { return };
        let opened = self.open(event_loop, session).map(|shown| {
            shown.screen.window.request_redraw();
            self.shown = Some(shown);
        });
        self.expect(event_loop, opened);
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let Some(shown) = &mut self.shown else { return };
        let response = shown.screen.input.on_window_event(&shown.screen.window, &event);
        if response.repaint && !matches!(event, WindowEvent::RedrawRequested) {
            shown.screen.window.request_redraw();
        }
        match event {
            WindowEvent::CloseRequested => event_loop.exit(),
            WindowEvent::Resized(size) if size.width > 0 && size.height > 0 => {
                let resized = shown.screen.resize(size.width, size.height);
                self.expect(event_loop, resized);
            }
            WindowEvent::RedrawRequested => {
                let drawn = self.frame(event_loop);
                self.expect(event_loop, drawn);
            }
            WindowEvent::CursorMoved { position, .. } => self.moved(position.x, position.y),
            WindowEvent::MouseInput { state, button, .. } => self.pressed(state, button),
            WindowEvent::MouseWheel { delta, .. } => {
                let notches = match delta {
                    MouseScrollDelta::LineDelta(_, lines) => f64::from(lines),
                    MouseScrollDelta::PixelDelta(pixels) => pixels.y / 40.0,
                };
                if self.cursor.0 < self.viewport.width as f64 {
                    shown.desk.orbit.zoom(notches);
                }
            }
            WindowEvent::ModifiersChanged(modifiers) => self.modifiers = modifiers.state(),
            WindowEvent::KeyboardInput { event, .. } => self.key(&event),
            WindowEvent::DroppedFile(path) => self.dropped(&path),
            _ => {}
        }
    }

    fn user_event(&mut self, _: &ActiveEventLoop, (): ()) {
        if let Some(shown) = &self.shown {
            shown.screen.window.request_redraw();
        }
    }

    fn new_events(&mut self, _: &ActiveEventLoop, cause: StartCause) {
        if let (StartCause::ResumeTimeReached { .. }, Some(shown)) = (cause, &self.shown) {
            shown.screen.window.request_redraw();
        }
    }

    fn exiting(&mut self, _: &ActiveEventLoop) {
        self.report = self.shown.take().and_then(|shown| self.log.report(&shown));
    }
}

impl App {
    fn key(&mut self, event: &KeyEvent) {
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

    fn moved(&mut self, x: f64, y: f64) {
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

    fn pressed(&mut self, state: ElementState, button: MouseButton) {
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
