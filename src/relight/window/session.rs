//! The model, lights and settings that a window starts with.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use rayon::ThreadPool;

use crate::error::Result;
use crate::evaluate::Evaluator;
use crate::light::Light;
use crate::medium::profiles::model::{LoadedProfile, ProfileModel};
use crate::relight::choice::DeviceChoice;
use crate::render::background::Background;
use crate::render::camera::Resolution;
use crate::render::camera_text::CameraSpec;
use crate::render::film::Exposure;
use crate::render::frame::Specular;
use crate::render::texture::spec::TextureSpec;

/// Opens the asset of a path as it was baked, with another radial profile in the dipole's place where one is given.
pub type OpenModel = Arc<dyn Fn(&Path, Option<&LoadedProfile>) -> Result<Box<dyn Evaluator>> + Send + Sync>;

/// The model, lights and settings that a window starts with.
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
    pub specular: Specular,
    /// The texture that scattered light is multiplied by.
    pub texture: TextureSpec,
    /// The background that is seen beside the object.
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
