//! The application: its state, its end, and the files that handle its events.

mod actions;
mod events;
mod frame;
mod log;
mod shown;
mod staging;

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use glam::DVec3;
use winit::event_loop::{ActiveEventLoop, EventLoopProxy};
use winit::keyboard::ModifiersState;

use self::log::Log;
use self::shown::Shown;
use super::session::Session;
use crate::error::{Error, Result};
use crate::relight::choice::DeviceChoice;
use crate::relight::timings::WindowReport;
use crate::render::camera::Resolution;
use crate::render::camera_text::CameraSpec;
use crate::render::texture::spec::TextureSpec;

/// The object of a drag.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Drag {
    Camera,
    Light,
}

/// The application: the open window, the state that its events change, and its end.
pub(super) struct App {
    /// The session with which the window is opened; taken at that moment.
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
    /// Resolution of the picture beside the panel.
    viewport: Resolution,
}

/// The settings of the session that outlast its opening.
struct Settings {
    quit_after_s: Option<f64>,
    camera: CameraSpec,
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

    /// The report on the speed of the window.
    pub(super) fn report(self) -> Result<WindowReport> {
        match (self.failure, self.report) {
            (Some(error), _) => Err(error),
            (None, Some(report)) => Ok(report),
            (None, None) => Err(Error::runtime("the window closed before its first frame")),
        }
    }

    /// Ends the window where something failed.
    fn expect(&mut self, event_loop: &ActiveEventLoop, result: Result<()>) {
        if let Err(error) = result {
            self.failure.get_or_insert(error);
            event_loop.exit();
        }
    }

    fn wake(&self) -> impl Fn() + Send + Sync + 'static {
        let proxy = Mutex::new(self.proxy.clone());
        // A loop that has ended needs no waking.
        move || {
            let _ = proxy.lock().unwrap_or_else(PoisonError::into_inner).send_event(());
        }
    }
}
