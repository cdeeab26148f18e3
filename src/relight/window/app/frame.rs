//! One frame: from the user's changes to an evaluated state, and from results to pixels.

use std::sync::Arc;
use std::time::{Duration, Instant};

use winit::event_loop::{ActiveEventLoop, ControlFlow};

use super::App;
use super::log::Log;
use super::shown::Shown;
use crate::error::Result;
use crate::relight::window::desk::Asked;
use crate::relight::window::panel::{self, Figures};
use crate::relight::window::worker::{Done, Wanted};
use crate::render::camera::Resolution;

/// Interval at which automatic exposure is renewed while something changes.
const EXPOSURE_EVERY: Duration = Duration::from_millis(500);

impl App {
    /// Collects the results of the threads.
    fn collect(&mut self) {
        let Some(shown) = &mut self.shown else { return };
        while let Some(done) = shown.staged.worker.answer() {
            take_in(shown, &mut self.log, done);
        }
        shown.retired.retain(|worker| !worker.has_ended());
        while let Some(answer) = shown.colours.answer() {
            shown.desk.take_answer(answer);
        }
        match shown.jobs.ended() {
            None => {}
            Some(Err(error)) => shown.desk.complain(error.message()),
            Some(Ok(outcome)) => self.finish(outcome),
        }
    }

    /// Draws one frame, and requests the evaluation of the newest state.
    pub(super) fn frame(&mut self, event_loop: &ActiveEventLoop) -> Result<()> {
        self.collect();
        let now = Instant::now();
        let seconds = self.last_frame.map_or(0.0, |last| (now - last).as_secs_f64()).min(0.25);
        self.last_frame = Some(now);
        let figures = self.figures(now);
        let Some(shown) = &mut self.shown else { return Ok(()) };
        shown.desk.pass(seconds);
        let input = shown.screen.input.take_egui_input(&shown.screen.window);
        let (mut asked, mut rest) = (Asked::default(), egui::Rect::NOTHING);
        let desk = &mut shown.desk;
        let textured = desk.shows_texture();
        let context = shown.screen.context.clone();
        let interface = context.run_ui(input, |ui| {
            asked = panel::show(ui, desk, &figures);
            rest = ui.available_rect_before_wrap();
        });
        if let Some(question) = shown.desk.question() {
            shown.colours.ask(question);
        }
        let window = Arc::clone(&shown.screen.window);
        shown.screen.input.handle_platform_output(&window, interface.platform_output.clone());
        let scale = f64::from(interface.pixels_per_point);
        let whole = shown.screen.resolution();
        let side = |points: f32, most: usize| ((f64::from(points) * scale) as usize).clamp(1, most);
        self.viewport =
            Resolution { width: side(rest.right(), whole.width), height: side(rest.bottom(), whole.height) };
        let camera = shown.desk.orbit.camera()?;
        if shown.desk.shows_texture() != textured {
            // Nothing is computed anew but the exposure.
            self.posted = 0;
        }
        let eye_mm = camera.at_mm();
        if shown.desk.serial != self.posted || shown.follows_eye && self.posted_eye_mm != eye_mm {
            let due = self.last_exposure.is_none_or(|last| now - last > EXPOSURE_EVERY) || !shown.desk.turning;
            let expose_for = (shown.desk.auto_exposure && due).then_some(camera);
            self.last_exposure = if expose_for.is_some() { Some(now) } else { self.last_exposure };
            self.posted = shown.desk.serial;
            self.posted_eye_mm = eye_mm;
            shown.staged.worker.ask(Wanted {
                lights: shown.desk.lights(),
                media: shown.desk.media.clone(),
                eye_mm,
                expose_for,
                textured: shown.desk.shows_texture(),
            });
        }
        let view = shown.desk.view(camera, self.viewport);
        shown.staged.raster.set_media(&shown.desk.accepted, view.specular);
        let repaint = interface.viewport_output.get(&egui::ViewportId::ROOT).map(|v| v.repaint_delay);
        if shown.screen.draw(&shown.staged.raster, &view, interface)? {
            self.log.frame(now);
        }
        shown.desk.expect(shown.screen.device.check());
        let moving = shown.desk.turning || shown.desk.is_adapting();
        self.act(asked);
        self.schedule(event_loop, moving, repaint.unwrap_or(Duration::MAX), now);
        Ok(())
    }

    fn schedule(&mut self, event_loop: &ActiveEventLoop, moving: bool, repaint: Duration, now: Instant) {
        let Some(shown) = &self.shown else { return };
        let first = self.log.first();
        let ends = self.settings.quit_after_s.zip(first).map(|(s, first)| first + Duration::from_secs_f64(s));
        if ends.is_some_and(|end| now >= end) {
            event_loop.exit();
            return;
        }
        if moving || repaint.is_zero() {
            event_loop.set_control_flow(ControlFlow::Poll);
            shown.screen.window.request_redraw();
            return;
        }
        let busy = shown.jobs.running().map(|_| now + Duration::from_millis(200));
        let later = now.checked_add(repaint.min(Duration::from_secs(3600)));
        let next = [ends, busy, later].into_iter().flatten().min();
        event_loop.set_control_flow(next.map_or(ControlFlow::Wait, ControlFlow::WaitUntil));
    }

    fn figures(&self, now: Instant) -> Figures {
        let Some(shown) = &self.shown else { return Figures::default() };
        Figures {
            adapter: shown.screen.device.describe(),
            transport: shown.staged.transport.clone(),
            job: shown.jobs.running(),
            is_rough: shown.is_rough,
            ..self.log.figures(now)
        }
    }
}

fn take_in(shown: &mut Shown, log: &mut Log, done: Done) {
    log.update(done.light_ms, done.transport_ms);
    shown.follows_eye = done.follows_eye;
    shown.is_rough = done.is_rough;
    shown.desk.expect(shown.staged.raster.set_lights(&done.lights));
    shown.desk.expect(done.failed.map_or(Ok(()), Err));
    if let Some(white) = done.white {
        shown.desk.adapt(white);
    }
    shown.desk.settle_media(done.media, done.refused.map(|e| e.message().to_owned()));
}
