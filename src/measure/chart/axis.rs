//! Logarithmic axes with marks in every decade that is visible, whole or in part.

use std::ops::Range;

use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint, Ranged};

/// Multiples of a power of ten that are marked, finest first.
const MULTIPLES: [&[f64]; 3] = [&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0], &[1.0, 2.0, 5.0], &[1.0]];

/// A logarithmic axis between two positive numbers.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::measure) struct LogAxis {
    ends: Range<f64>,
}

impl LogAxis {
    /// An axis from the smaller to the larger of two numbers.
    pub(in crate::measure) fn new((low, high): (f64, f64)) -> Self {
        Self { ends: low..high }
    }

    /// Marks at some multiples of every power of ten.
    fn marks(&self, multiples: &[f64]) -> Vec<f64> {
        let Range { start, end } = self.ends;
        let decades = start.log10().floor() as i32..=end.log10().floor() as i32;
        let all = decades.flat_map(|k| multiples.iter().map(move |m| m * 10f64.powi(k)));
        all.filter(|mark| (start..=end).contains(mark)).collect()
    }
}

impl Ranged for LogAxis {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, (from, to): (i32, i32)) -> i32 {
        let share = (value / self.ends.start).ln() / (self.ends.end / self.ends.start).ln();
        from + (f64::from(to - from) * share).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        // Labels at 7, 8 and 9 would run into each other.
        let finest = usize::from(!hint.weight().allow_light_points() && self.marks(MULTIPLES[1]).len() > 1);
        let fits = |multiples: &&[f64]| self.marks(multiples).len() <= hint.max_num_points();
        if let Some(multiples) = MULTIPLES[finest..].iter().copied().find(fits) {
            return self.marks(multiples);
        }
        let decades = self.marks(&[1.0]);
        let step = decades.len().div_ceil(hint.max_num_points().max(1));
        decades.into_iter().step_by(step.max(1)).collect()
    }

    fn range(&self) -> Range<f64> {
        self.ends.clone()
    }
}

#[cfg(test)]
mod tests {
    use plotters::coord::ranged1d::BoldPoints;

    use super::*;

    fn labels(low: f64, high: f64, most: usize) -> Vec<f64> {
        let round = |mark: f64| (mark * 1e9).round() / 1e9;
        LogAxis::new((low, high)).key_points(BoldPoints(most)).into_iter().map(round).collect()
    }

    #[test]
    fn a_decade_that_is_seen_in_part_has_marks() {
        assert_eq!(labels(0.0011, 0.065, 10), [0.002, 0.005, 0.01, 0.02, 0.05]);
        assert_eq!(labels(0.0013, 0.0089, 10), [0.002, 0.005]);
        assert_eq!(labels(0.0021, 0.0061, 10), [0.003, 0.004, 0.005, 0.006]);
        assert_eq!(labels(20.0, 30_000.0, 10), [20.0, 50.0, 100.0, 200.0, 500.0, 1e3, 2e3, 5e3, 1e4, 2e4]);
        assert_eq!(labels(20.0, 30_000.0, 5), [100.0, 1000.0, 10_000.0]);
        assert_eq!(labels(0.5, 2e8, 4), [1.0, 1e3, 1e6]);
    }

    #[test]
    fn places_are_even_in_the_logarithm() {
        let axis = LogAxis::new((0.1, 1000.0));
        assert_eq!([0.1, 1.0, 10.0, 1000.0].map(|v| axis.map(&v, (0, 400))), [0, 100, 200, 400]);
        assert_eq!([0.1, 1000.0].map(|v| axis.map(&v, (500, 100))), [500, 100]);
    }
}
