//! The filters of FLIP, all of them products of one-dimensional ones: contrast sensitivity at a viewing distance, one
//! filter for each opponent channel, and detectors of edges and points.

use std::f64::consts::PI;

use crate::math::simd::{InstructionSet, multiversion};

/// One-dimensional weights around a pixel, `2 * radius + 1` of them.
#[derive(Clone, Debug)]
pub(super) struct Taps {
    radius: usize,
    weights: Vec<f64>,
}

impl Taps {
    fn new(radius: usize, weight: impl Fn(f64) -> f64) -> Self {
        let mut weights: Vec<f64> = (0..=radius).rev().map(|i| weight(-(i as f64))).collect();
        weights.extend((1..=radius).map(|i| weight(i as f64)));
        Self { radius, weights }
    }

    /// Scales positive weights to a sum of 1, negative ones to -1.
    fn normalised(mut self) -> Self {
        let sum = |sign: f64| self.weights.iter().map(|w| (w * sign).max(0.0)).sum::<f64>();
        let (positive, negative) = (sum(1.0), sum(-1.0));
        for w in &mut self.weights {
            let total = if *w > 0.0 { positive } else { negative };
            if total > 0.0 {
                *w /= total;
            }
        }
        self
    }
}

/// A Gaussian of a contrast sensitivity function: `a sqrt(pi / b) exp(-pi^2 x^2 / b)`, x in degrees.
struct Sensitivity {
    a: f64,
    b: f64,
}

const ACHROMATIC: Sensitivity = Sensitivity { a: 1.0, b: 0.0047 };
const RED_GREEN: Sensitivity = Sensitivity { a: 1.0, b: 0.0053 };
const BLUE_YELLOW: [Sensitivity; 2] = [Sensitivity { a: 34.1, b: 0.04 }, Sensitivity { a: 13.5, b: 0.025 }];

impl Sensitivity {
    /// The normalised filter, and its weight (its sum over the plane) beside others.
    fn taps(&self, radius: usize, pixels_per_degree: f64) -> (Taps, f64) {
        let at = |x: f64| (-(PI * x / pixels_per_degree).powi(2) / self.b).exp();
        let taps = Taps::new(radius, at);
        let sum: f64 = taps.weights.iter().sum();
        (taps.normalised(), self.a * (PI / self.b).sqrt() * sum * sum)
    }
}

/// All filters for one viewing distance.
#[derive(Clone, Debug)]
pub(super) struct Filters {
    pub(super) achromatic: Taps,
    pub(super) red_green: Taps,
    /// The two Gaussians of the blue-yellow filter with their shares.
    pub(super) blue_yellow: [(Taps, f64); 2],
    /// One-dimensional filters of edges and points: smoothing, first and second derivative.
    pub(super) smooth: Taps,
    pub(super) slope: Taps,
    pub(super) bend: Taps,
}

impl Filters {
    /// Filters for a positive number of pixels in a degree.
    pub(super) fn new(pixels_per_degree: f64) -> Self {
        /// Width of a feature, in degrees.
        const FEATURE_DEG: f64 = 0.082;
        let [wide, narrow] = BLUE_YELLOW;
        // Three standard deviations of the widest Gaussian, for all of them.
        let radius = (3.0 * (wide.b / (2.0 * PI * PI)).sqrt() * pixels_per_degree).ceil() as usize;
        let (wide, narrow) = (wide.taps(radius, pixels_per_degree), narrow.taps(radius, pixels_per_degree));
        let weight = wide.1 + narrow.1;
        let sigma = 0.5 * FEATURE_DEG * pixels_per_degree;
        let gaussian = |x: f64| (-x * x / (2.0 * sigma * sigma)).exp();
        let feature_radius = (3.0 * sigma).ceil() as usize;
        Self {
            achromatic: ACHROMATIC.taps(radius, pixels_per_degree).0,
            red_green: RED_GREEN.taps(radius, pixels_per_degree).0,
            blue_yellow: [(wide.0, wide.1 / weight), (narrow.0, narrow.1 / weight)],
            smooth: Taps::new(feature_radius, gaussian).normalised(),
            slope: Taps::new(feature_radius, |x| -x * gaussian(x)).normalised(),
            bend: Taps::new(feature_radius, |x| (x * x / (sigma * sigma) - 1.0) * gaussian(x)).normalised(),
        }
    }

    /// Radius of the widest filter, in pixels.
    pub(super) fn reach(&self) -> usize {
        self.blue_yellow[0].0.radius.max(self.smooth.radius)
    }
}

/// Rows of numbers with a margin on all sides, as wide as the widest filter reaches.
#[derive(Clone, Debug)]
pub(super) struct Plane {
    /// Columns without the margin.
    width: usize,
    /// Rows without the margin.
    height: usize,
    reach: usize,
    level: InstructionSet,
    values: Vec<f64>,
}

impl Plane {
    /// A plane of zeros.
    pub(super) fn new(width: usize, height: usize, reach: usize) -> Self {
        let values = vec![0.0; (width + 2 * reach) * (height + 2 * reach)];
        Self { width, height, reach, level: InstructionSet::detect(), values }
    }

    /// All values with the margin, `width + 2 * reach` in a row.
    pub(super) fn values_mut(&mut self) -> &mut [f64] {
        &mut self.values
    }

    /// The plane filtered along the rows by one filter and along the columns by the other, without a margin.
    pub(super) fn filtered(&self, along_rows: &Taps, along_columns: &Taps) -> Vec<f64> {
        self.across(along_rows).down(along_columns)
    }

    /// Filters rows; the margin above and below stays.
    pub(super) fn across(&self, taps: &Taps) -> Filtered {
        let pitch = self.width + 2 * self.reach;
        let mut values = vec![0.0; self.width * (self.height + 2 * self.reach)];
        for (out, source) in values.chunks_exact_mut(self.width).zip(self.values.chunks_exact(pitch)) {
            filter(self.level, out, &taps.weights, source.get(self.reach - taps.radius..).unwrap_or(&[]), 1);
        }
        Filtered { width: self.width, height: self.height, reach: self.reach, level: self.level, values }
    }
}

/// A plane after the filter along its rows.
pub(super) struct Filtered {
    width: usize,
    height: usize,
    reach: usize,
    level: InstructionSet,
    values: Vec<f64>,
}

impl Filtered {
    /// Filters columns.
    pub(super) fn down(&self, taps: &Taps) -> Vec<f64> {
        let mut values = vec![0.0; self.width * self.height];
        for (row, out) in values.chunks_exact_mut(self.width).enumerate() {
            let first = row + self.reach - taps.radius;
            filter(self.level, out, &taps.weights, self.values.get(first * self.width..).unwrap_or(&[]), self.width);
        }
        values
    }
}

/// Values whose sums are kept in registers at a time.
const TOGETHER: usize = 16;

/// Sums of the weighted values of all taps, in their order; the value of a tap is `step` after that of the one before.
#[inline(always)]
fn filter_body(out: &mut [f64], weights: &[f64], source: &[f64], step: usize) {
    let mut start = 0;
    let mut blocks = out.chunks_exact_mut(TOGETHER);
    for block in &mut blocks {
        let mut sums = [0.0; TOGETHER];
        for (tap, weight) in weights.iter().enumerate() {
            let Some(values) = source.get(tap * step + start..).and_then(|s| s.first_chunk::<TOGETHER>()) else {
                return;
            };
            for lane in 0..TOGETHER {
                sums[lane] += weight * values[lane];
            }
        }
        block.copy_from_slice(&sums);
        start += TOGETHER;
    }
    for (i, out) in blocks.into_remainder().iter_mut().enumerate() {
        let values = source.get(start + i..).unwrap_or(&[]).iter().step_by(step);
        *out = weights.iter().zip(values).map(|(weight, value)| weight * value).sum();
    }
}

multiversion! {
    /// One row filtered along or across.
    fn filter(out: &mut [f64], weights: &[f64], source: &[f64], step: usize) => filter_body
}
