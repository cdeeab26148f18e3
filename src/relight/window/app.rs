//! The events of the window: from input to states that are evaluated, and from what is done to frames.

mod input;
mod log;

use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use winit::application::ApplicationHandler;
use winit::dpi::{LogicalSize, PhysicalSize};
use winit::event::{MouseScrollDelta, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoopProxy};
use winit::keyboard::ModifiersState;
use winit::window::{Window, WindowId};

use self::input::Drag;
use self::log::Log;
use super::desk::{Desk, KnownError};
use super::jobs::{Job, Jobs, Outcome, State, folder};
use super::panel::{self, Asked, Figures};
use super::screen::Screen;
use super::worker::{Done, Wanted, Worker};
use super::{Session, Turn, WindowReport};
use crate::error::{Error, Result};
use crate::evaluate::Evaluator;
use crate::relight::choice;
use crate::relight::files::{Dropped, free_picture};
use crate::relight::raster::Raster;
use crate::relight::raster::target::{Finish, Picture};
use crate::relight::raster::view::{Textured, View, Wires};
use crate::render::camera::{Camera, Resolution};
use crate::render::frame::RenderSettings;
use crate::render::texture::Texture;
use crate::render::texture::spec::TextureSpec;

/// Smallest window that everything is readable in.
const LEAST_SIZE: LogicalSize<f64> = LogicalSize::new(640.0, 480.0);
/// How often automatic exposure looks anew while something changes.
const EXPOSURE_EVERY: Duration = Duration::from_millis(500);
/// The window and what it shows.
struct Shown {
    screen: Screen,
    raster: Raster,
    worker: Worker,
    jobs: Jobs,
    desk: Desk,
    texture: Option<Arc<Texture>>,
    transport: String,
    vertices: usize,
    samples: usize,
}

/// An evaluator that works and what it is drawn with.
struct Placed {
    raster: Raster,
    worker: Worker,
    transport: String,
    vertices: usize,
    samples: usize,
    texture: Option<Arc<Texture>>,
    /// Why there is no texture.
    untextured: Option<Error>,
}

/// The application.
pub(super) struct App {
    /// What is needed to open the window; taken by that.
    session: Option<Session>,
    proxy: EventLoopProxy<()>,
    shown: Option<Shown>,
    settings: Settings,
    log: Log,
    failure: Option<Error>,
    report: Option<WindowReport>,
    cursor: (f64, f64),
    drag: Option<Drag>,
    modifiers: ModifiersState,
    posted: u64,
    last_frame: Option<Instant>,
    last_exposure: Option<Instant>,
    /// Pixels beside the panel.
    viewport: Resolution,
}

/// What stays of the session.
struct Settings {
    quit_after_s: Option<f64>,
    camera: crate::render::camera_text::CameraSpec,
    choice: choice::DeviceChoice,
    texture: TextureSpec,
    open: super::OpenModel,
    pool: Arc<rayon::ThreadPool>,
}

impl App {
    pub(super) fn new(session: Session, proxy: EventLoopProxy<()>) -> Self {
        let settings = Settings {
            quit_after_s: session.quit_after_s,
            camera: session.camera,
            choice: session.choice,
            texture: session.texture.clone(),
            open: Arc::clone(&session.open),
            pool: Arc::clone(&session.pool),
        };
        Self {
            viewport: session.resolution,
            session: Some(session),
            proxy,
            shown: None,
            settings,
            log: Log::default(),
            failure: None,
            report: None,
            cursor: (0.0, 0.0),
            drag: None,
            modifiers: ModifiersState::empty(),
            posted: 0,
            last_frame: None,
            last_exposure: None,
        }
    }

    /// How fast the window was.
    pub(super) fn report(self) -> Result<WindowReport> {
        match (self.failure, self.report) {
            (Some(error), _) => Err(error),
            (None, Some(report)) => Ok(report),
            (None, None) => Err(Error::runtime("the window closed before its first frame")),
        }
    }

    fn fail(&mut self, event_loop: &ActiveEventLoop, error: Error) {
        self.failure.get_or_insert(error);
        event_loop.exit();
    }

    fn wake(&self) -> impl Fn() + Send + Sync + 'static {
        let proxy = Mutex::new(self.proxy.clone());
        // A loop that has ended needs no waking.
        move || {
            let _ = proxy.lock().unwrap_or_else(PoisonError::into_inner).send_event(());
        }
    }

    fn open(&mut self, event_loop: &ActiveEventLoop, session: Session) -> Result<Shown> {
        let Resolution { width, height } = session.resolution;
        let name = session.model.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
        let attributes = Window::default_attributes()
            .with_title(format!("translux - {name}"))
            .with_inner_size(PhysicalSize::new(width as u32, height as u32))
            .with_min_inner_size(LEAST_SIZE);
        let window = event_loop
            .create_window(attributes)
            .map_err(|e| Error::unsupported(format!("no window can be opened: {e}; use --headless")))?;
        let screen = Screen::new(event_loop, Arc::new(window))?;
        let camera = session.camera.resolve(&session.evaluator.scene().mesh, screen.resolution())?;
        let material = session.evaluator.capabilities().material;
        let mut desk = Desk::new(session.model, session.evaluator.scene(), material, session.lights, &camera);
        desk.set_exposure(session.exposure);
        desk.set_specular(session.specular);
        desk.background = session.background;
        desk.turning = session.turn == Turn::Turning;
        let placed = self.place(&screen, session.evaluator, &mut desk)?;
        if let Some(error) = placed.untextured {
            return Err(error);
        }
        let jobs = Jobs::new(Arc::clone(&self.settings.pool), Arc::clone(&self.settings.open), Arc::new(self.wake()));
        let Placed { raster, worker, transport, vertices, samples, texture, .. } = placed;
        Ok(Shown { screen, raster, worker, jobs, desk, texture, transport, vertices, samples })
    }

    /// Puts an evaluator on the screen's device.
    fn place(&self, screen: &Screen, evaluator: Box<dyn Evaluator>, desk: &mut Desk) -> Result<Placed> {
        let media = evaluator.scene().media.clone();
        let (model, open) = (desk.model.clone(), Arc::clone(&self.settings.open));
        let again = || {
            let mut evaluator = open(&model)?;
            if evaluator.scene().media != media {
                evaluator.set_media(media.clone())?;
            }
            Ok(evaluator)
        };
        let (evaluator, note) = choice::on(&screen.device, self.settings.choice, evaluator, &again)?;
        note.into_iter().for_each(|note| desk.say(note));
        let mesh = &evaluator.scene().mesh;
        let (texture, untextured) = match Texture::new(&self.settings.texture, mesh) {
            Ok(texture) => (texture.map(Arc::new), None),
            Err(error) => (None, Some(error)),
        };
        let albedo = texture.as_ref().map_or_else(Vec::new, |texture| texture.of_vertices(mesh));
        let (vertices, samples) = (mesh.local_mm.len(), evaluator.cost().samples);
        let mut raster = Raster::new(evaluator.as_ref(), &[screen.finish, Finish::PICTURE])?;
        let transport = evaluator.transport();
        raster.set_texture(texture.as_deref())?;
        desk.has_texture = texture.is_some();
        let (shown, pool) = (raster.shown().clone(), Arc::clone(&self.settings.pool));
        let worker = Worker::start(evaluator, shown, albedo, pool, self.wake())?;
        Ok(Placed { raster, worker, transport, vertices, samples, texture, untextured })
    }

    /// Takes in what threads have done.
    fn collect(&mut self) {
        let Some(shown) = &mut self.shown else { return };
        while let Some(done) = shown.worker.done() {
            take_in(shown, &mut self.log, done);
        }
        match shown.jobs.ended() {
            None => {}
            Some(Err(error)) => shown.desk.complain(error.message()),
            Some(Ok(outcome)) => self.finish(outcome),
        }
    }

    fn finish(&mut self, outcome: Outcome) {
        let Some(mut shown) = self.shown.take() else { return };
        match outcome {
            Outcome::Saved(paths) => {
                let names: Vec<String> =
                    paths.iter().map(|p| p.strip_prefix(".").unwrap_or(p).display().to_string()).collect();
                shown.desk.say(format!("saved {}", names.join(" and ")));
            }
            Outcome::Error(field) => {
                shown.raster.set_errors(&field.values);
                let (serial, rms, worst, scale) = (field.serial, field.rms, field.worst, field.scale);
                shown.desk.error = Some(KnownError { serial, rms, worst, scale });
            }
            Outcome::Environment { map, warnings } => {
                shown.desk.replace_environment(map);
                match warnings.first() {
                    Some(warning) => shown.desk.complain(warning.clone()),
                    None => shown.desk.say("the environment is in place"),
                }
            }
            Outcome::Model { path, evaluator } => {
                let camera = self.settings.camera.resolve(&evaluator.scene().mesh, self.viewport);
                let placed = camera.and_then(|camera| {
                    let material = evaluator.capabilities().material;
                    shown.desk.replace_model(path.clone(), evaluator.scene(), material, &camera);
                    self.place(&shown.screen, evaluator, &mut shown.desk)
                });
                match placed {
                    Ok(placed) => {
                        (shown.raster, shown.worker) = (placed.raster, placed.worker);
                        (shown.texture, shown.transport) = (placed.texture, placed.transport);
                        (shown.vertices, shown.samples) = (placed.vertices, placed.samples);
                        match placed.untextured {
                            Some(error) => shown.desk.complain(error.message()),
                            None => shown.desk.say(format!("{} is in place", path.display())),
                        }
                    }
                    Err(error) => shown.desk.complain(error.message()),
                }
            }
        }
        self.shown = Some(shown);
    }

    /// One frame.
    fn frame(&mut self, event_loop: &ActiveEventLoop) -> Result<()> {
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
        let textured = desk.texture();
        let context = shown.screen.context.clone();
        let interface = context.run_ui(input, |ui| {
            asked = panel::show(ui, desk, &figures);
            rest = ui.available_rect_before_wrap();
        });
        let window = Arc::clone(&shown.screen.window);
        shown.screen.input.handle_platform_output(&window, interface.platform_output.clone());
        let scale = f64::from(interface.pixels_per_point);
        let whole = shown.screen.resolution();
        let side = |points: f32, most: usize| ((f64::from(points) * scale) as usize).clamp(1, most);
        self.viewport =
            Resolution { width: side(rest.right(), whole.width), height: side(rest.bottom(), whole.height) };
        let camera = shown.desk.orbit.camera()?;
        if shown.desk.texture() != textured {
            // Nothing is computed anew but the exposure.
            self.posted = 0;
        }
        if shown.desk.serial != self.posted {
            let due = self.last_exposure.is_none_or(|last| now - last > EXPOSURE_EVERY) || !shown.desk.turning;
            let expose_for = (shown.desk.auto_exposure && due).then_some(camera);
            self.last_exposure = if expose_for.is_some() { Some(now) } else { self.last_exposure };
            self.posted = shown.desk.serial;
            shown.worker.post(Wanted {
                serial: shown.desk.serial,
                lights: shown.desk.lights(),
                media: shown.desk.media.clone(),
                expose_for,
                textured: shown.desk.texture(),
            });
        }
        let view = view(&shown.desk, camera, self.viewport);
        shown.raster.set_media(&shown.desk.accepted, view.specular);
        let repaint = interface.viewport_output.get(&egui::ViewportId::ROOT).map(|v| v.repaint_delay);
        if shown.screen.draw(&shown.raster, &view, interface)? {
            self.log.frame(now);
        }
        if let Err(error) = shown.screen.device.check() {
            shown.desk.complain(error.message());
        }
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
        let [frames_per_second, updates_per_second, light_ms, transport_ms] = self.log.now(now);
        Figures {
            frames_per_second,
            updates_per_second,
            light_ms,
            transport_ms,
            adapter: shown.screen.device.describe(),
            transport: shown.transport.clone(),
            job: shown.jobs.running(),
        }
    }

    /// Does what was asked for.
    fn act(&mut self, asked: Asked) {
        if asked.save_png {
            self.save_png();
        }
        if asked.save_render {
            self.save_render();
        }
        if asked.measure_error
            && let Some(shown) = &mut self.shown
        {
            shown.desk.turning = false;
            shown.desk.error = None;
            let job = Job::Error(state(&shown.desk));
            start(shown, "measuring the error", job);
        }
    }

    fn save_png(&mut self) {
        let Some(shown) = &mut self.shown else { return };
        let Some(stem) = free_picture(folder(), &["png"]) else {
            return shown.desk.complain("every name from picture-001.png on is taken");
        };
        let picture = shown.desk.orbit.camera().and_then(|camera| {
            let picture = Picture::new(&shown.screen.device, self.viewport)?;
            picture.take(&shown.raster, &view(&shown.desk, camera, self.viewport))
        });
        match picture {
            Ok(picture) => {
                let job = Job::Png { picture, background: shown.desk.background, path: stem.with_extension("png") };
                start(shown, "saving", job);
            }
            Err(error) => shown.desk.complain(error.message()),
        }
    }

    fn save_render(&mut self) {
        let Some(shown) = &mut self.shown else { return };
        let Some(stem) = free_picture(folder(), &["png", "exr"]) else {
            return shown.desk.complain("every name from picture-001.png on is taken");
        };
        match shown.desk.orbit.camera() {
            Ok(camera) => {
                let mut settings = Box::new(RenderSettings::new(camera, self.viewport));
                settings.background = shown.desk.background;
                settings.specular = shown.desk.specular();
                let exposure = shown.desk.exposure_factor();
                settings.white = exposure.recip();
                let texture = shown.texture.clone().filter(|_| shown.desk.texture() == Textured::Yes);
                let job = Job::Render { state: state(&shown.desk), settings, texture, exposure, stem };
                start(shown, "rendering", job);
            }
            Err(error) => shown.desk.complain(error.message()),
        }
    }

    fn dropped(&mut self, path: &std::path::Path) {
        let Some(shown) = &mut self.shown else { return };
        match Dropped::new(path) {
            Dropped::Asset(path) => start(shown, "opening the model", Job::Model(path)),
            Dropped::Environment(path) => start(shown, "reading the environment", Job::Environment(path)),
            Dropped::Other(message) => shown.desk.complain(message),
        }
    }
}

fn take_in(shown: &mut Shown, log: &mut Log, done: Done) {
    log.update(done.light_ms, done.transport_ms);
    if let Err(error) = shown.raster.set_lights(&done.lights) {
        shown.desk.complain(error.message());
    }
    if let Some(error) = done.failed {
        shown.desk.complain(error.message());
    }
    if let Some(white) = done.white {
        shown.desk.adapt(white);
    }
    let newest = done.serial == shown.desk.serial || !shown.worker.is_behind();
    if newest || done.refused.is_some() {
        shown.desk.settle_media(done.media, done.refused.map(|e| e.message().to_owned()));
    } else {
        shown.desk.accepted = done.media;
    }
}

fn start(shown: &mut Shown, name: &'static str, job: Job) {
    if let Err(error) = shown.jobs.start(name, job) {
        shown.desk.complain(error.message());
    }
}

fn state(desk: &Desk) -> State {
    State { model: desk.model.clone(), lights: desk.lights(), media: desk.accepted.clone(), serial: desk.serial }
}

fn view(desk: &Desk, camera: Camera, resolution: Resolution) -> View {
    View {
        specular: desk.specular(),
        look: desk.look,
        background: desk.background,
        texture: desk.texture(),
        wires: if desk.wires { Wires::Shown } else { Wires::Hidden },
        worst_error: desk.error.map(|e| e.scale),
        ..View::new(camera, resolution, desk.exposure_factor())
    }
}

impl ApplicationHandler for App {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        let Some(session) = self.session.take() else { return };
        match self.open(event_loop, session) {
            Ok(shown) => {
                shown.screen.window.request_redraw();
                self.shown = Some(shown);
            }
            Err(error) => self.fail(event_loop, error),
        }
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
                if let Err(error) = shown.screen.resize(size.width, size.height) {
                    self.fail(event_loop, error);
                }
            }
            WindowEvent::RedrawRequested => {
                if let Err(error) = self.frame(event_loop) {
                    self.fail(event_loop, error);
                }
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

    fn new_events(&mut self, _: &ActiveEventLoop, cause: winit::event::StartCause) {
        if let (winit::event::StartCause::ResumeTimeReached { .. }, Some(shown)) = (cause, &self.shown) {
            shown.screen.window.request_redraw();
        }
    }

    fn exiting(&mut self, _: &ActiveEventLoop) {
        self.report = self.shown.take().and_then(|shown| self.log.report(&shown));
    }
}
