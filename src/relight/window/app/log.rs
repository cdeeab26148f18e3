//! Speed of the window.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use super::shown::Shown;
use crate::math::statistics::Quantiles;
use crate::relight::timings::{Adapter, WindowReport};
use crate::relight::window::panel::Figures;

/// Period over which the shown rates are measured.
const RATE_OVER: Duration = Duration::from_secs(1);

/// Number of recent events for quantiles, limited so that a window may stay open for days.
const KEPT: usize = 1 << 14;

/// Times and durations of events.
#[derive(Default)]
pub(super) struct Log {
    first: Option<Instant>,
    frame_count: usize,
    update_count: usize,
    frames: VecDeque<Instant>,
    updates: VecDeque<Instant>,
    light_ms: VecDeque<f64>,
    transport_ms: VecDeque<f64>,
}

fn keep<T>(values: &mut VecDeque<T>, value: T) {
    if values.len() == KEPT {
        values.pop_front();
    }
    values.push_back(value);
}

/// Events per second, over the last second.
fn rate(times: &VecDeque<Instant>, now: Instant) -> f64 {
    let recent = times.iter().rev().take_while(|t| now.saturating_duration_since(**t) < RATE_OVER).count();
    recent as f64 / RATE_OVER.as_secs_f64()
}

impl Log {
    /// Records that a frame was drawn.
    pub(super) fn frame(&mut self, now: Instant) {
        self.first.get_or_insert(now);
        self.frame_count += 1;
        keep(&mut self.frames, now);
    }

    /// Records that a state was computed.
    pub(super) fn update(&mut self, light_ms: f64, transport_ms: f64) {
        self.update_count += 1;
        keep(&mut self.updates, Instant::now());
        keep(&mut self.light_ms, light_ms);
        keep(&mut self.transport_ms, transport_ms);
    }

    /// Time at which the first frame was drawn.
    pub(super) fn first(&self) -> Option<Instant> {
        self.first
    }

    /// Frames and states per second, and the times of the last state.
    pub(super) fn figures(&self, now: Instant) -> Figures {
        let last = |values: &VecDeque<f64>| values.back().copied().unwrap_or(0.0);
        Figures {
            frames_per_second: rate(&self.frames, now),
            updates_per_second: rate(&self.updates, now),
            light_ms: last(&self.light_ms),
            transport_ms: last(&self.transport_ms),
            ..Figures::default()
        }
    }

    /// The final report; none without a frame.
    pub(super) fn report(&self, shown: &Shown) -> Option<WindowReport> {
        let (frames, updates) = (self.frame_count, self.update_count);
        let seconds = match (self.first, self.frames.back()) {
            (Some(first), Some(last)) => (*last - first).as_secs_f64(),
            _ => return None,
        };
        let rate = |count: usize| if seconds > 0.0 { count as f64 / seconds } else { 0.0 };
        let gaps = self.frames.iter().zip(self.frames.iter().skip(1)).map(|(a, b)| (*b - *a).as_secs_f64() * 1e3);
        Some(WindowReport {
            adapter: Adapter::of(&shown.screen.device),
            transport: shown.staged.transport.clone(),
            resolution: shown.screen.resolution(),
            vertices: shown.staged.vertices,
            samples: shown.staged.samples,
            seconds,
            frames,
            frames_per_second: rate(frames.saturating_sub(1)),
            light_updates: updates,
            light_updates_per_second: rate(updates),
            frame_ms: Quantiles::of(gaps),
            light_ms: Quantiles::of(self.light_ms.iter().copied()),
            transport_ms: Quantiles::of(self.transport_ms.iter().copied()),
        })
    }
}
