//! Durations of frames.

use serde::Serialize;

use crate::math::statistics::Quantiles;

use crate::render::camera::Resolution;

/// Identifies the shape of the file of timings.
pub const SCHEMA: &str = "translux-relight-timings/1";

/// The adapter that drew.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Adapter {
    /// Name from the driver.
    pub name: String,
    /// `graphics` or `software`.
    pub kind: &'static str,
    /// The graphics interface.
    pub backend: String,
}

/// Milliseconds of one frame.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FrameTime {
    /// File name of its picture.
    pub file: String,
    /// Milliseconds from the lights to the irradiance at the start of the transport.
    pub light_ms: f64,
    /// Milliseconds from the irradiance to radiosity.
    pub transport_ms: f64,
    /// Milliseconds from radiosity to a picture in memory.
    pub draw_ms: f64,
    /// Milliseconds in total.
    pub total_ms: f64,
}

/// Quantiles over the frames, in milliseconds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// Milliseconds from the lights to the irradiance at the start of the transport.
    pub light_ms: Quantiles,
    /// Milliseconds from the irradiance to radiosity.
    pub transport_ms: Quantiles,
    /// Milliseconds from radiosity to a picture in memory.
    pub draw_ms: Quantiles,
    /// Milliseconds in total.
    pub total_ms: Quantiles,
}

impl Summary {
    /// The quantiles over some frames.
    pub fn of(frames: &[FrameTime]) -> Self {
        let over = |value: fn(&FrameTime) -> f64| Quantiles::of(frames.iter().map(value));
        Self {
            light_ms: over(|f| f.light_ms),
            transport_ms: over(|f| f.transport_ms),
            draw_ms: over(|f| f.draw_ms),
            total_ms: over(|f| f.total_ms),
        }
    }
}

/// Timings of an animation.
#[derive(Clone, Debug, PartialEq, Serialize)]
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
    pub summary: Summary,
    /// Times of each frame.
    pub frames: Vec<FrameTime>,
}
