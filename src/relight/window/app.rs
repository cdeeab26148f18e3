//! The application: its state, its end, and the files that handle its events.

mod actions;
mod events;
mod frame;
mod log;
mod shown;
mod staging;

use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use glam::DVec3;
use winit::event_loop::{ActiveEventLoop, EventLoopProxy};
use winit::keyboard::ModifiersState;

use self::log::Log;
use self::shown::Shown;
use super::session::{Session, Settings};
use crate::error::{Error, Result};
use crate::relight::timings::WindowReport;
use crate::render::camera::Resolution;

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

impl App {
    pub(super) fn new(session: Session, proxy: EventLoopProxy<()>) -> Self {
        Self {
            viewport: session.resolution,
            settings: session.settings.clone(),
            session: Some(session),
            proxy,
            shown: None,
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
