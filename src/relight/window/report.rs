//! The report of a window that was closed.

use serde::Serialize;

use crate::math::statistics::Quantiles;
use crate::relight::timings::Adapter;
use crate::render::camera::Resolution;

/// How fast the window was.
#[derive(Clone, Debug, Serialize)]
pub struct WindowReport {
    /// The adapter that drew.
    pub adapter: Adapter,
    /// Where the transport ran.
    pub transport: String,
    /// Pixels of the window when it closed.
    pub resolution: Resolution,
    /// Source vertices.
    pub vertices: usize,
    /// Surface samples.
    pub samples: usize,
    /// Seconds from the first frame to the last one.
    pub seconds: f64,
    /// Frames that were drawn.
    pub frames: usize,
    /// Frames in a second.
    pub frames_per_second: f64,
    /// States of the lights that were computed and shown.
    pub light_updates: usize,
    /// States of the lights in a second.
    pub light_updates_per_second: f64,
    /// Milliseconds from one frame to the next.
    pub frame_ms: Quantiles,
    /// Milliseconds from lights to the irradiance that the transport starts from.
    pub light_ms: Quantiles,
    /// Milliseconds from there to radiosity in the device's memory.
    pub transport_ms: Quantiles,
}
