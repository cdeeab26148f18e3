//! The events of the window: from input to states that are evaluated, and from what is done to frames.

mod actions;
mod events;
mod input;
mod log;
mod staging;

use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use glam::DVec3;
use winit::dpi::{LogicalSize, PhysicalSize};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoopProxy};
use winit::keyboard::ModifiersState;
use winit::window::Window;

use self::input::Drag;
use self::log::Log;
use self::staging::Staged;
use super::colours::Colours;
use super::desk::Desk;
use super::editing::ProfileInForce;
use super::jobs::Jobs;
use super::panel::{self, Asked, Figures};
use super::placing::{Placing, locked};
use super::screen::Screen;
use super::worker::{Done, Wanted, Worker};
use super::{Session, Turn, WindowReport};
use crate::error::{Error, Result};
use crate::relight::choice::DeviceChoice;
use crate::relight::raster::Raster;
use crate::relight::raster::view::{View, Wires};
use crate::render::camera::{Camera, Resolution};
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
    /// Those that finish what they do for nobody.
    retired: Vec<Worker>,
    colours: Colours,
    jobs: Jobs,
    desk: Desk,
    texture: Option<Arc<Texture>>,
    transport: String,
    vertices: usize,
    samples: usize,
    follows_eye: bool,
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
    posted_eye_mm: DVec3,
    last_frame: Option<Instant>,
    last_exposure: Option<Instant>,
    /// Pixels beside the panel.
    viewport: Resolution,
}

/// What stays of the session.
struct Settings {
    quit_after_s: Option<f64>,
    camera: crate::render::camera_text::CameraSpec,
    choice: DeviceChoice,
    texture: TextureSpec,
    pool: Arc<rayon::ThreadPool>,
}

impl App {
    pub(super) fn new(session: Session, proxy: EventLoopProxy<()>) -> Self {
        let settings = Settings {
            quit_after_s: session.quit_after_s,
            camera: session.camera,
            choice: session.choice,
            texture: session.texture.clone(),
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
            posted_eye_mm: DVec3::ZERO,
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
        let capabilities = session.evaluator.capabilities();
        let (material, locked) = (capabilities.material, locked(capabilities, session.choice));
        let profile = ProfileInForce::new(session.profile.clone(), Arc::new(session.profile.load()?), locked);
        let in_place = profile.in_place();
        let scene = session.evaluator.scene();
        let mut desk = Desk::new(session.model.clone(), scene, material, profile, session.lights, &camera);
        desk.set_exposure(session.exposure);
        desk.set_specular(session.specular);
        desk.background = session.background;
        desk.turning = session.turn == Turn::Turning;
        let placing = Placing { device: Arc::clone(&screen.device), choice: session.choice, open: session.open };
        let (evaluator, note) = placing.place(&session.model, in_place.as_deref(), session.evaluator)?;
        note.into_iter().for_each(|note| desk.say(note));
        let texture = Texture::new(&self.settings.texture, &evaluator.scene().mesh)?.map(Arc::new);
        let Staged { raster, worker, transport, vertices, samples } =
            self.stage(&screen, evaluator, texture.as_deref())?;
        desk.has_texture = texture.is_some();
        let colours = Colours::start(self.wake())?;
        let jobs = Jobs::new(Arc::clone(&self.settings.pool), placing, Arc::new(self.wake()));
        let retired = Vec::new();
        Ok(Shown {
            screen,
            raster,
            worker,
            retired,
            colours,
            jobs,
            desk,
            texture,
            transport,
            vertices,
            samples,
            follows_eye: false,
        })
    }

    /// Takes in what threads have done.
    fn collect(&mut self) {
        let Some(shown) = &mut self.shown else { return };
        while let Some(done) = shown.worker.done() {
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
        if shown.desk.texture() != textured {
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
            shown.worker.post(Wanted {
                serial: shown.desk.serial,
                lights: shown.desk.lights(),
                media: shown.desk.media.clone(),
                eye_mm,
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
}

fn take_in(shown: &mut Shown, log: &mut Log, done: Done) {
    log.update(done.light_ms, done.transport_ms);
    shown.follows_eye = done.follows_eye;
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
