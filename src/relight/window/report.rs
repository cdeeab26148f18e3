//! The report of a window after it was closed.

use serde::Serialize;

use crate::math::statistics::Quantiles;
use crate::relight::timings::Adapter;
use crate::render::camera::Resolution;

/// Speed of the window.
#[derive(Clone, Debug, Serialize)]
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
