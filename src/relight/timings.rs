//! How long frames take.

use serde::Serialize;

use crate::math::statistics::Quantiles;

use crate::render::camera::Resolution;

/// Identifies the shape of the file of timings.
pub const SCHEMA: &str = "translux-relight-timings/1";

/// The adapter that drew.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Adapter {
    /// The name that the driver has for it.
    pub name: String,
    /// `graphics` or `software`.
    pub kind: &'static str,
    /// The interface that it was opened with.
    pub backend: String,
}

/// Milliseconds of one frame.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FrameTime {
    /// Name of its picture.
    pub file: String,
    /// Milliseconds from the lights to the irradiance that the transport starts from.
    pub light_ms: f64,
    /// Milliseconds from there to radiosity.
    pub transport_ms: f64,
    /// Milliseconds from radiosity to a picture in memory.
    pub draw_ms: f64,
    /// All of them.
    pub total_ms: f64,
}

/// Quantiles over the frames, in milliseconds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// Milliseconds from the lights to the irradiance that the transport starts from.
    pub light_ms: Quantiles,
    /// Milliseconds from there to radiosity.
    pub transport_ms: Quantiles,
    /// Milliseconds from radiosity to a picture in memory.
    pub draw_ms: Quantiles,
    /// All of them.
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
    /// [`SCHEMA`].
    pub schema: &'static str,
    /// Version of this program.
    pub version: &'static str,
    /// The adapter that drew; none where the CPU did.
    pub adapter: Option<Adapter>,
    /// Where the transport ran.
    pub transport: String,
    /// Method of the asset.
    pub method: String,
    /// Source vertices.
    pub vertices: usize,
    /// Surface samples.
    pub samples: usize,
    /// Pixels.
    pub resolution: Resolution,
    /// The camera as it would be typed.
    pub camera: String,
    /// Lights of the first frame.
    pub lights: Vec<String>,
    /// Factor on radiance, the same for all frames.
    pub exposure_factor: f64,
    /// Over the frames.
    pub summary: Summary,
    /// Each frame.
    pub frames: Vec<FrameTime>,
}
