//! The initial model, lights and settings of a window.

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

/// Opens the asset at a path as it was baked, with another radial profile in place of the dipole where one is given.
pub type OpenModel = Arc<dyn Fn(&Path, Option<&LoadedProfile>) -> Result<Box<dyn Evaluator>> + Send + Sync>;

/// The initial model, lights and settings of a window.
pub struct Session {
    /// Path of the asset.
    pub model: PathBuf,
    /// Its evaluator, with the media and the profile in force.
    pub evaluator: Box<dyn Evaluator>,
    /// The profile in force.
    pub profile: ProfileModel,
    /// Opens assets: this one again, and dropped ones.
    pub open: OpenModel,
    /// Initial lights.
    pub lights: Vec<Light>,
    /// Size of the window.
    pub resolution: Resolution,
    /// Initial exposure.
    pub exposure: Exposure,
    /// Initial specular reflection.
    pub specular: Specular,
    /// The background beside the object.
    pub background: Background,
    /// Whether the lights turn about the object at first.
    pub turning: bool,
    /// What outlasts the opening.
    pub settings: Settings,
}

/// The settings of a window that outlast its opening.
#[derive(Clone)]
pub struct Settings {
    /// Device choice for the transport.
    pub choice: DeviceChoice,
    /// Camera of every model at first.
    pub camera: CameraSpec,
    /// The texture that multiplies scattered light.
    pub texture: TextureSpec,
    /// Whether what moving lights leave is kept from frame to frame.
    pub reuse: bool,
    /// Seconds after which the window closes; none to stay open.
    pub quit_after_s: Option<f64>,
    /// Worker threads.
    pub pool: Arc<ThreadPool>,
}
