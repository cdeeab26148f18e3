//! Durations of frames.

use serde::Serialize;

#[cfg(feature = "gpu")]
use crate::evaluate::device::Device;
use crate::math::statistics::Quantiles;
use crate::render::camera::Resolution;

/// Identifies the shape of the file of timings.
pub const SCHEMA: &str = "translux.relight-timings.v1";

/// The adapter that drew.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Adapter {
    /// Name from the driver.
    pub name: String,
    /// `graphics` or `software`.
    pub kind: &'static str,
    /// The graphics interface.
    pub backend: String,
}

#[cfg(feature = "gpu")]
impl Adapter {
    /// The adapter of a device.
    pub fn of(device: &Device) -> Self {
        Self {
            name: device.info.name.clone(),
            kind: if device.is_software() { "software" } else { "graphics" },
            backend: device.info.backend.to_string(),
        }
    }
}

/// A figure in milliseconds for each stage of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Stages<T> {
    /// Milliseconds from the lights to the irradiance at the start of the transport.
    pub light_ms: T,
    /// Milliseconds from the irradiance to radiosity.
    pub transport_ms: T,
    /// Milliseconds from radiosity to a picture in memory.
    pub draw_ms: T,
    /// Milliseconds in total.
    pub total_ms: T,
}

/// Milliseconds of one frame.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct FrameTime {
    /// File name of its picture.
    pub file: String,
    /// Its times.
    #[serde(flatten)]
    pub times: Stages<f64>,
}

impl Stages<Quantiles> {
    /// The quantiles over some frames.
    pub fn of(frames: &[FrameTime]) -> Self {
        let over = |value: fn(&Stages<f64>) -> f64| Quantiles::of(frames.iter().map(|frame| value(&frame.times)));
        Self {
            light_ms: over(|t| t.light_ms),
            transport_ms: over(|t| t.transport_ms),
            draw_ms: over(|t| t.draw_ms),
            total_ms: over(|t| t.total_ms),
        }
    }
}

/// Timings of an animation.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Timings {
    /// Always [`SCHEMA`].
    pub schema: &'static str,
    /// Version of this program.
    pub version: &'static str,
    /// The adapter that drew; none where the CPU did.
    pub adapter: Option<Adapter>,
    /// Where the transport ran, in words.
    pub transport: String,
    /// Method of the asset.
    pub method: String,
    /// Number of source vertices.
    pub vertices: usize,
    /// Number of surface samples.
    pub samples: usize,
    /// Size of the pictures.
    pub resolution: Resolution,
    /// The camera as it would be typed.
    pub camera: String,
    /// Lights of the first frame.
    pub lights: Vec<String>,
    /// Factor on radiance, the same for all frames.
    pub exposure_factor: f64,
    /// Quantiles over the frames.
    pub summary: Stages<Quantiles>,
    /// Times of each frame.
    pub frames: Vec<FrameTime>,
}

/// Speed of the window.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct WindowReport {
    /// The adapter that drew.
    pub adapter: Adapter,
    /// Where the transport ran, in words.
    pub transport: String,
    /// Size of the window when it closed.
    pub resolution: Resolution,
    /// Number of source vertices.
    pub vertices: usize,
    /// Number of surface samples.
    pub samples: usize,
    /// Seconds from the first frame to the last one.
    pub seconds: f64,
    /// Number of frames drawn.
    pub frames: usize,
    /// Frames per second.
    pub frames_per_second: f64,
    /// Number of states of the lights that were computed and shown.
    pub light_updates: usize,
    /// States of the lights per second.
    pub light_updates_per_second: f64,
    /// Milliseconds from one frame to the next.
    pub frame_ms: Quantiles,
    /// Milliseconds from lights to the irradiance at the start of the transport.
    pub light_ms: Quantiles,
    /// Milliseconds from the irradiance to radiosity in the device's memory.
    pub transport_ms: Quantiles,
}
