//! How long frames take.

use serde::Serialize;

use crate::render::camera::Resolution;

/// Identifies the shape of the file of timings.
pub const SCHEMA: &str = "translux-relight-timings/1";

/// What drew.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Adapter {
    /// As the driver calls it.
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
    /// From the lights to what the transport starts from.
    pub light_ms: f64,
    /// From there to radiosity.
    pub transport_ms: f64,
    /// From radiosity to a picture in memory.
    pub draw_ms: f64,
    /// All of them.
    pub total_ms: f64,
}

/// Quantiles by nearest rank.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Quantiles {
    /// A tenth is below.
    pub p10: f64,
    /// Half is below.
    pub median: f64,
    /// A tenth is above.
    pub p90: f64,
}

impl Quantiles {
    /// Of some values, zero where there are none.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Self {
        let mut sorted: Vec<f64> = values.into_iter().collect();
        sorted.sort_unstable_by(f64::total_cmp);
        let at = |share: f64| {
            let rank = (share * sorted.len() as f64).ceil() as usize;
            sorted.get(rank.saturating_sub(1)).copied().unwrap_or(0.0)
        };
        Self { p10: at(0.1), median: at(0.5), p90: at(0.9) }
    }
}

/// Quantiles over the frames, in milliseconds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// From the lights to what the transport starts from.
    pub light_ms: Quantiles,
    /// From there to radiosity.
    pub transport_ms: Quantiles,
    /// From radiosity to a picture in memory.
    pub draw_ms: Quantiles,
    /// All of them.
    pub total_ms: Quantiles,
}

impl Summary {
    /// Of some frames.
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
    /// Of this program.
    pub version: &'static str,
    /// What drew; none where the CPU did.
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
    /// As it would be typed.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_by_nearest_rank() {
        let q = Quantiles::of((1..=10).rev().map(f64::from));
        assert_eq!(q, Quantiles { p10: 1.0, median: 5.0, p90: 9.0 });
        assert_eq!(Quantiles::of([7.0]), Quantiles { p10: 7.0, median: 7.0, p90: 7.0 });
        assert_eq!(Quantiles::of([]), Quantiles::default());
    }
}
