//! The window: turn lights and environments, edit materials, look at errors, save pictures, drop files.

mod app;
mod colours;
mod desk;
mod editing;
mod jobs;
mod panel;
mod placing;
mod screen;
mod worker;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use rayon::ThreadPool;
use serde::Serialize;
use winit::event_loop::EventLoop;

use super::choice::DeviceChoice;
use super::timings::Adapter;
use crate::error::{Error, Result};
use crate::evaluate::Evaluator;
use crate::light::Light;
use crate::math::statistics::Quantiles;
use crate::medium::profiles::model::{LoadedProfile, ProfileModel};
use crate::render::background::Background;
use crate::render::camera::Resolution;
use crate::render::camera_text::CameraSpec;
use crate::render::film::Exposure;
use crate::render::texture::spec::TextureSpec;

/// Opens the asset of a path as it was baked, with another radial profile in the dipole's place where one is given.
pub type OpenModel = Arc<dyn Fn(&Path, Option<&LoadedProfile>) -> Result<Box<dyn Evaluator>> + Send + Sync>;

/// What to show, and how to start.
pub struct Session {
    /// Path of the asset.
    pub model: PathBuf,
    /// Its evaluator, with the media and the profile in force.
    pub evaluator: Box<dyn Evaluator>,
    /// The profile in force.
    pub profile: ProfileModel,
    /// Opens assets: the same one again, and dropped ones.
    pub open: OpenModel,
    /// Lights to start with.
    pub lights: Vec<Light>,
    /// Where the transport runs.
    pub choice: DeviceChoice,
    /// The eye to start with.
    pub camera: CameraSpec,
    /// Size of the window.
    pub resolution: Resolution,
    /// Brightness to start with.
    pub exposure: Exposure,
    /// Reflection to start with.
    pub specular: crate::render::frame::Specular,
    /// What scattered light is multiplied by.
    pub texture: TextureSpec,
    /// What is seen beside the object.
    pub background: Background,
    /// Whether the lights turn.
    pub turn: Turn,
    /// Closes the window after this many seconds.
    pub quit_after_s: Option<f64>,
    /// Threads that work.
    pub pool: Arc<ThreadPool>,
}

/// Whether the lights turn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turn {
    /// They stand still until somebody turns them.
    Still,
    /// They turn about the object.
    Turning,
}

/// How fast the window was.
#[derive(Clone, Debug, Serialize)]
pub struct WindowReport {
    /// What drew.
    pub adapter: Adapter,
    /// Where the transport ran.
    pub transport: String,
    /// Pixels of the window when it closed.
    pub resolution: Resolution,
    /// Source vertices.
    pub vertices: usize,
    /// Surface samples.
    pub samples: usize,
    /// From the first frame to the last one.
    pub seconds: f64,
    /// Frames that were drawn.
    pub frames: usize,
    /// Frames in a second.
    pub frames_per_second: f64,
    /// States of the lights that were computed and shown.
    pub light_updates: usize,
    /// The same in a second.
    pub light_updates_per_second: f64,
    /// From one frame to the next, in milliseconds.
    pub frame_ms: Quantiles,
    /// From lights to what the transport starts from.
    pub light_ms: Quantiles,
    /// From there to radiosity in the device's memory.
    pub transport_ms: Quantiles,
}

/// What a message of winit says beside the place in its source, "os error at FILE:LINE: ".
fn cause(message: &str) -> &str {
    match message.strip_prefix("os error at ").and_then(|rest| rest.split_once(": ")) {
        Some((_, cause)) => cause.trim_end_matches('.'),
        None => message,
    }
}

/// Shows a window until it is closed. Must run on the main thread.
///
/// # Errors
/// No display, no adapter (exit 5), a lost device (exit 4).
pub fn run(session: Session) -> Result<WindowReport> {
    let advice = "use --headless --frames N --out DIR, or `translux render`";
    let event_loop = EventLoop::<()>::with_user_event()
        .build()
        .map_err(|e| Error::unsupported(format!("no window can be opened ({}); {advice}", cause(&e.to_string()))))?;
    let mut app = app::App::new(session, event_loop.create_proxy());
    event_loop.run_app(&mut app).map_err(|e| Error::unsupported(format!("the window failed ({e}); {advice}")))?;
    app.report()
}

#[cfg(test)]
mod tests {
    #[test]
    fn causes_are_told_without_places_in_a_source() {
        assert_eq!(super::cause("os error at a/b.rs:765: no DISPLAY is set."), "no DISPLAY is set");
        assert_eq!(super::cause("not supported"), "not supported");
    }
}
