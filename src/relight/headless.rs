//! An animation without a window: the lights turn once about the object; every frame becomes a picture and is timed.

use std::path::{Path, PathBuf};
use std::time::Instant;

use super::choice::Place;
use super::files::frame_name;
use super::lights::{pivot_mm, turned};
#[cfg(feature = "gpu")]
use super::raster::{
    Raster,
    canvas::Finish,
    picture::{LinearPicture, Picture},
    view::View,
};
use super::timings::{Adapter, FrameTime, SCHEMA, Stages, Timings};
use crate::error::{Error, Result};
use crate::evaluate::Evaluator;
use crate::evaluate::exitance::Exitance;
use crate::io::atomic;
use crate::light::Light;
use crate::progress::{Progress, Silent};
#[cfg(feature = "gpu")]
use crate::render::background::Background;
#[cfg(feature = "gpu")]
use crate::render::camera::Resolution;
use crate::render::film::{Exposure, MAX_STOPS, to_png};
use crate::render::frame::{RenderSettings, render};
use crate::render::single::Scattered;
use crate::render::texture::Texture;

/// Samples per pixel of a frame.
pub const SAMPLES_PER_PIXEL: u32 = 4;
/// Largest number of frames.
pub const MAX_FRAMES: usize = 100_000;

/// An animation.
#[derive(Clone, Debug)]
pub struct Animation {
    /// Number of pictures of a whole turn.
    pub frames: usize,
    /// Folder of the pictures; created if its parent exists.
    pub folder: PathBuf,
    /// Camera, size, surface and background of the pictures; the samples are those of pictures on the CPU.
    pub settings: RenderSettings,
    /// Brightness; automatic exposure is that of the first frame, so that nothing flickers.
    pub exposure: Exposure,
    /// The texture that multiplies scattered light.
    pub texture: Option<Texture>,
    /// Whether what moving lights leave is kept from frame to frame.
    pub reuse: bool,
    /// Lights of the first frame.
    pub lights: Vec<Light>,
    /// Method of the asset, for the file of timings.
    pub method: String,
}

/// Draws the frames of a whole turn, writes them as PNG, and their timings as `timings.json`.
///
/// # Errors
/// A folder or file that cannot be written (exit 2), lights that the asset does not carry (exit 5), failures of the
/// work.
pub fn run(place: Place, animation: &Animation, progress: &dyn Progress) -> Result<Timings> {
    make_folder(&animation.folder)?;
    let mut painter = Painter::new(place, animation)?;
    let pivot = pivot_mm(&painter.evaluator().scene().mesh);
    let settings = &animation.settings;
    let lights_of = |frame: usize| -> Vec<Light> {
        let degrees = 360.0 * frame as f64 / animation.frames as f64;
        animation.lights.iter().map(|l| if frame == 0 { l.clone() } else { turned(l, degrees, pivot) }).collect()
    };
    let exposure = painter.exposure(animation, progress)?;
    progress.start("frames", animation.frames as u64);
    let mut frames = Vec::with_capacity(animation.frames);
    for frame in 0..animation.frames {
        let file = frame_name(frame, animation.frames);
        let (times, png) = painter.frame(animation, lights_of(frame), exposure)?;
        atomic::write(&animation.folder.join(&file), &png)?;
        frames.push(FrameTime { file, times });
        progress.advance(1);
    }
    progress.finish();
    let (adapter, transport) = painter.drawn_by();
    let evaluator = painter.evaluator();
    let timings = Timings {
        schema: SCHEMA,
        version: env!("CARGO_PKG_VERSION"),
        adapter,
        transport,
        method: animation.method.clone(),
        vertices: evaluator.scene().mesh.local_mm.len(),
        samples: evaluator.cost().samples,
        resolution: settings.resolution,
        camera: settings.camera.to_string(),
        lights: animation.lights.iter().map(ToString::to_string).collect(),
        exposure_factor: exposure,
        summary: Stages::of(&frames),
        frames,
    };
    let text = serde_json::to_string_pretty(&timings).map_err(|e| Error::runtime(format!("timings: {e}")))?;
    atomic::write(&animation.folder.join("timings.json"), format!("{text}\n").as_bytes())?;
    Ok(timings)
}

fn make_folder(folder: &Path) -> Result<()> {
    match std::fs::create_dir(folder) {
        Err(_) if folder.is_dir() => Ok(()),
        made => made.map_err(|e| Error::io(folder, &e)),
    }
}

/// Draws frames on the evaluator's device.
enum Painter {
    Cpu(Box<dyn Evaluator>),
    #[cfg(feature = "gpu")]
    Device(Box<OnDevice>),
}

#[cfg(feature = "gpu")]
struct OnDevice {
    evaluator: Box<dyn crate::evaluate::DeviceEvaluator>,
    raster: Raster,
    picture: Picture,
    shadows: super::raster::shadows::Shadows,
}

impl Painter {
    fn new(place: Place, animation: &Animation) -> Result<Self> {
        #[cfg(not(feature = "gpu"))]
        let _ = animation;
        match place {
            Place::Cpu(evaluator) => Ok(Self::Cpu(evaluator)),
            #[cfg(feature = "gpu")]
            Place::Device(evaluator) => {
                let mut raster = Raster::new(evaluator.as_ref(), &[Finish::PICTURE])?;
                raster.set_media(&evaluator.scene().media, animation.settings.specular);
                raster.set_texture(animation.texture.as_ref())?;
                let picture = Picture::new(raster.device(), animation.settings.resolution)?;
                let shadows = super::raster::shadows::Shadows::new(evaluator.scene());
                Ok(Self::Device(Box::new(OnDevice { evaluator, raster, picture, shadows })))
            }
        }
    }

    fn evaluator(&mut self) -> &mut dyn Evaluator {
        match self {
            Self::Cpu(evaluator) => evaluator.as_mut(),
            #[cfg(feature = "gpu")]
            Self::Device(on) => on.evaluator.as_mut(),
        }
    }

    /// The adapter, if one draws, and where the transport runs.
    fn drawn_by(&self) -> (Option<Adapter>, String) {
        match self {
            Self::Cpu(_) => (None, "CPU".to_owned()),
            #[cfg(feature = "gpu")]
            Self::Device(on) => (Some(Adapter::of(on.raster.device())), on.evaluator.transport()),
        }
    }

    /// Exposure factor of all frames; automatic exposure is the renderer's for the first frame.
    fn exposure(&mut self, animation: &Animation, progress: &dyn Progress) -> Result<f64> {
        if let Exposure::Stops(stops) = animation.exposure {
            return Ok(stops.clamp(-MAX_STOPS, MAX_STOPS).exp2());
        }
        let evaluator = self.evaluator();
        evaluator.set_lights(animation.lights.clone(), progress)?;
        evaluator.set_eye(animation.settings.camera.at_mm());
        let radiosity = evaluator.radiosity(progress)?;
        let scattered = scattered(&radiosity, animation);
        let frame = render(evaluator, scattered, &animation.lights, &animation.settings, progress)?;
        Ok(animation.exposure.factor(&frame))
    }

    /// Times of a frame, and its PNG.
    fn frame(&mut self, animation: &Animation, lights: Vec<Light>, exposure: f64) -> Result<(Stages<f64>, Vec<u8>)> {
        match self {
            Self::Cpu(evaluator) => {
                let start = Instant::now();
                take_lights(evaluator.as_mut(), &lights, animation.reuse)?;
                evaluator.set_eye(animation.settings.camera.at_mm());
                let lit = Instant::now();
                let radiosity = evaluator.radiosity(&Silent)?;
                let transported = Instant::now();
                let scattered = scattered(&radiosity, animation);
                let frame = render(evaluator.as_ref(), scattered, &lights, &animation.settings, &Silent)?;
                let drawn = Instant::now();
                let png = to_png(&frame, exposure, animation.settings.background)?;
                Ok((times([start, lit, transported, drawn]), png))
            }
            #[cfg(feature = "gpu")]
            Self::Device(on) => on.frame(animation, lights, exposure),
        }
    }
}

#[cfg(feature = "gpu")]
impl OnDevice {
    fn frame(&mut self, animation: &Animation, lights: Vec<Light>, exposure: f64) -> Result<(Stages<f64>, Vec<u8>)> {
        let (settings, start) = (&animation.settings, Instant::now());
        take_lights(self.evaluator.as_mut(), &lights, animation.reuse)?;
        self.evaluator.set_eye(animation.settings.camera.at_mm());
        let visibility = match settings.specular.shape() {
            Some(_) => self.shadows.visibility(self.evaluator.bvh(), &lights),
            None => Vec::new(),
        };
        let lit = Instant::now();
        self.evaluator.update(&Silent)?;
        self.raster.shown().publish(self.evaluator.as_ref(), &visibility)?;
        self.raster.device().wait()?;
        let transported = Instant::now();
        self.raster.set_lights(&lights)?;
        let view = View {
            specular: settings.specular,
            background: settings.background,
            ..View::new(settings.camera, settings.resolution, exposure)
        };
        let picture = self.picture.take(&self.raster, &view)?;
        let drawn = Instant::now();
        Ok((times([start, lit, transported, drawn]), png(&picture, settings.background)?))
    }
}

/// The PNG of a picture, transparent where the background is empty.
#[cfg(feature = "gpu")]
pub(super) fn png(picture: &LinearPicture, background: Background) -> Result<Vec<u8>> {
    let Resolution { width, height } = picture.resolution;
    let opaque = background != Background::None;
    let colour = |[r, g, b, a]: [f32; 4]| match a {
        _ if opaque => [r, g, b],
        a if a > 0.0 => [r / a, g / a, b / a],
        _ => [0.0; 3],
    };
    let rgb: Vec<[f32; 3]> = picture.pixels.iter().map(|p| colour(*p)).collect();
    let alpha: Option<Vec<f32>> = (!opaque).then(|| picture.pixels.iter().map(|p| p[3]).collect());
    crate::io::png::encode_png(width, height, &rgb, alpha.as_deref())
}

/// Lights of the next frame.
fn take_lights<E: Evaluator + ?Sized>(evaluator: &mut E, lights: &[Light], reuse: bool) -> Result<()> {
    if reuse { evaluator.move_lights(lights.to_vec(), &Silent) } else { evaluator.set_lights(lights.to_vec(), &Silent) }
}

fn scattered<'a>(exitance: &'a dyn Exitance, animation: &'a Animation) -> Scattered<'a> {
    Scattered { texture: animation.texture.as_ref(), ..Scattered::from(exitance) }
}

/// The times between the four moments of a frame.
fn times(moments: [Instant; 4]) -> Stages<f64> {
    let ms = |lap: usize| (moments[lap + 1] - moments[lap]).as_secs_f64() * 1e3;
    let (light_ms, transport_ms, draw_ms) = (ms(0), ms(1), ms(2));
    Stages { light_ms, transport_ms, draw_ms, total_ms: light_ms + transport_ms + draw_ms }
}
