//! The vertex error of the whole project: relative, area-weighted, worst channel; and quantiles of timings.

use glam::DVec3;

/// Errors of per-vertex values relative to the reference's RMS of the channel; the worst channel of each figure.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct VertexError {
    /// Area-weighted root mean square of the difference.
    pub rms: f64,
    /// Area-weighted mean of the difference, signed, of the channel where it is largest.
    pub bias: f64,
    /// 99.9th percentile of the absolute difference.
    pub p999: f64,
    /// Largest absolute difference.
    pub worst: f64,
    /// Area-weighted root mean square of the difference where the reference is dark (the mean of its channels below a tenth of that of
    /// all), relative to the reference's mean there.
    pub dark: f64,
}

impl VertexError {
    /// Every figure times a factor.
    #[must_use]
    pub fn scaled(self, factor: f64) -> Self {
        let Self { rms, bias, p999, worst, dark } = self;
        Self { rms: rms * factor, bias: bias * factor, p999: p999 * factor, worst: worst * factor, dark: dark * factor }
    }

    /// The error, or zero where it is infinite because the reference is black and the values are not.
    #[must_use]
    pub fn or_none(self) -> Self {
        if self.rms.is_finite() { self } else { Self::default() }
    }

    /// Sum of two independent errors.
    #[must_use]
    pub fn beside(self, other: Self) -> Self {
        Self {
            rms: self.rms.hypot(other.rms),
            bias: self.bias + other.bias,
            p999: self.p999.hypot(other.p999),
            worst: self.worst.hypot(other.worst),
            dark: self.dark.hypot(other.dark),
        }
    }

    /// The larger of each figure.
    #[must_use]
    pub fn max(self, other: Self) -> Self {
        Self {
            rms: self.rms.max(other.rms),
            bias: if self.bias.abs() >= other.bias.abs() { self.bias } else { other.bias },
            p999: self.p999.max(other.p999),
            worst: self.worst.max(other.worst),
            dark: self.dark.max(other.dark),
        }
    }
}

/// Quantiles by nearest rank.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Quantiles {
    /// A tenth is below.
    pub p10: f64,
    /// Half is below.
    pub median: f64,
    /// A tenth is above.
    pub p90: f64,
}

impl Quantiles {
    /// Quantiles of some values, zero where there are none.
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

/// Share of the brightest channel's RMS below which a channel's own RMS is not used as the unit.
const CHANNEL_FLOOR: f64 = 1e-3;

/// Share of the mean of all below which a place is dark.
const DARK: f64 = 0.1;

/// Error of `values` against `reference`; `weights` are areas (any unit), all slices of one length.
/// Zero everywhere for an empty or black reference that the values equal; infinite where a black one differs.
pub fn vertex_error(values: &[DVec3], reference: &[DVec3], weights: &[f64]) -> VertexError {
    vertex_error_of_some(values, reference, weights, values.len())
}

/// [`vertex_error`] of some places that stand for `all`: the 99.9th percentile and the worst are those expected of all, by
/// `beyond`.
pub fn vertex_error_of_some(values: &[DVec3], reference: &[DVec3], weights: &[f64], all: usize) -> VertexError {
    let total: f64 = weights.iter().sum();
    if total <= 0.0 || values.is_empty() {
        return VertexError::default();
    }
    let mean = |f: &dyn Fn(usize) -> f64| weights.iter().enumerate().map(|(i, w)| w * f(i)).sum::<f64>() / total;
    let units = units(reference, weights);
    let mut result = VertexError { dark: dark_error(values, reference, weights), ..VertexError::default() };
    for channel in 0..3 {
        let unit = units[channel];
        let difference = |i: usize| values[i][channel] - reference[i][channel];
        let relative = |d: f64| {
            if d == 0.0 {
                0.0
            } else if unit > 0.0 {
                d / unit
            } else {
                f64::INFINITY.copysign(d)
            }
        };
        let mut absolute: Vec<f64> = (0..values.len()).map(|i| difference(i).abs()).collect();
        absolute.sort_unstable_by(f64::total_cmp);
        let rank = ((absolute.len() as f64 * 0.999).ceil() as usize).clamp(1, absolute.len()) - 1;
        let (mut p999, mut worst) = (absolute[rank], absolute[absolute.len() - 1]);
        if all > absolute.len() {
            p999 = p999.max(beyond(&absolute, 1e-3));
            worst = worst.max(beyond(&absolute, 1.0 / all as f64)).max(p999);
        }
        result = result.max(VertexError {
            rms: relative(mean(&|i| difference(i).powi(2)).sqrt()),
            bias: relative(mean(&difference)),
            p999: relative(p999),
            worst: relative(worst),
            dark: 0.0,
        });
    }
    result
}

/// Share of the largest values that the tail is fitted to.
const TAIL: f64 = 0.1;

/// The value that a share of all is above, from some values in ascending order, where they are too few to tell: the largest tenth of them
/// is taken to be of an exponential tail, whose mean excess is its only parameter. Tails that are heavier at the end have larger
/// values, those of sums of many errors smaller ones.
fn beyond(ascending: &[f64], share: f64) -> f64 {
    let count = ascending.len();
    let members = ((TAIL * count as f64) as usize).clamp(1, count.max(1));
    let Some(&threshold) = count.checked_sub(members + 1).and_then(|i| ascending.get(i)) else {
        return ascending.last().copied().unwrap_or(0.0);
    };
    let of_tail = &ascending[count - members..];
    let excess = of_tail.iter().map(|v| v - threshold).sum::<f64>() / members as f64;
    threshold + excess * (members as f64 / count as f64 / share).max(1.0).ln()
}

/// Error of each value, largest channel, in the unit of [`vertex_error`], for pictures of the error.
pub fn relative_errors(values: &[DVec3], reference: &[DVec3], weights: &[f64]) -> Vec<f32> {
    let unit = units(reference, weights).max(DVec3::splat(f64::MIN_POSITIVE));
    let error = |(b, t): (&DVec3, &DVec3)| (((*b - *t) / unit).abs().max_element() as f32).min(f32::MAX);
    values.iter().zip(reference).map(error).collect()
}

/// Unit of the errors of each channel: its RMS, or [`CHANNEL_FLOOR`] of that of the brightest channel if larger.
pub(crate) fn units(reference: &[DVec3], weights: &[f64]) -> DVec3 {
    let squares: DVec3 = reference.iter().zip(weights).map(|(b, w)| *w * (*b * *b)).sum();
    units_of((squares / weights.iter().sum::<f64>().max(f64::MIN_POSITIVE)).map(f64::sqrt))
}

/// Unit of the errors of each channel of an RMS.
pub(crate) fn units_of(rms: DVec3) -> DVec3 {
    rms.max(DVec3::splat(CHANNEL_FLOOR * rms.max_element()))
}

/// See [`VertexError::dark`]; each channel's unit is at least a thousandth of the brightest channel's mean over all
/// vertices, so that black is no unit.
fn dark_error(values: &[DVec3], reference: &[DVec3], weights: &[f64]) -> f64 {
    let all = || values.iter().zip(reference).zip(weights);
    let (area, sum) = all().fold((0.0, DVec3::ZERO), |(area, sum), ((_, b), w)| (area + w, sum + *w * *b));
    let brightness = |b: DVec3| b.element_sum() / 3.0;
    let mean = sum / area;
    let dark = || all().filter(|((_, b), _)| brightness(**b) < DARK * brightness(mean));
    let (area, sum, squares) = dark().fold((0.0, DVec3::ZERO, DVec3::ZERO), |(area, sum, squares), ((v, b), w)| {
        (area + w, sum + *w * *b, squares + *w * (*v - *b).powf(2.0))
    });
    if area <= 0.0 {
        return 0.0;
    }
    let unit = (sum / area).max(DVec3::splat(CHANNEL_FLOOR * mean.max_element()));
    ((squares / area).powf(0.5) / unit).max_element()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uniform_scaling_is_its_own_error() {
        let reference: Vec<DVec3> = (1..=100).map(|i| DVec3::new(f64::from(i), 1.0, 0.5)).collect();
        let values: Vec<DVec3> = reference.iter().map(|v| *v * 1.01).collect();
        let e = vertex_error(&values, &reference, &vec![2.0; 100]);
        assert!((e.rms - 0.01).abs() < 1e-12, "{e:?}");
        assert!((e.bias - 0.01).abs() < 1e-12, "{e:?}");
    }

    #[test]
    fn weights_count_and_the_worst_channel_wins() {
        let reference = [DVec3::ONE; 2];
        let values = [DVec3::new(1.1, 1.0, 1.0), DVec3::ONE];
        let e = vertex_error(&values, &reference, &[1.0, 3.0]);
        assert!((e.rms - 0.05).abs() < 1e-12 && (e.worst - 0.1).abs() < 1e-12, "{e:?}");
    }

    #[test]
    fn a_tenth_of_a_tail_tells_what_is_beyond_it() {
        use crate::math::random::uniform;
        // Exponential, normal (as the sum of twelve) and of a tenth power: one of each tail.
        let kinds: [fn(u64) -> f64; 3] = [
            |i| -uniform(1, i, 0).max(1e-300).ln(),
            |i| ((0..12).map(|d| uniform(2, i, d)).sum::<f64>() - 6.0).abs(),
            |i| uniform(3, i, 0).max(1e-300).powf(-0.1) - 1.0,
        ];
        for (kind, value) in kinds.iter().enumerate() {
            let all = 20_000u64;
            let mut ratios = Vec::new();
            for run in 0..20 {
                let values: Vec<f64> = (0..all).map(|i| value(run * all + i)).collect();
                let worst = values.iter().copied().fold(0.0, f64::max);
                let some: Vec<DVec3> = values.iter().step_by(100).map(|v| DVec3::splat(1.0 + v)).collect();
                let truth = vec![DVec3::ONE; some.len()];
                let e = vertex_error_of_some(&some, &truth, &vec![1.0; some.len()], all as usize);
                assert!(e.p999 <= e.worst && vertex_error(&some, &truth, &vec![1.0; some.len()]).worst <= e.worst);
                ratios.push(e.worst / worst);
            }
            let mean = ratios.iter().sum::<f64>() / ratios.len() as f64;
            assert!((0.6..1.6).contains(&mean), "{kind}: {ratios:?}");
        }
    }

    #[test]
    fn dark_channels_are_measured_against_the_brightest() {
        let reference = [DVec3::new(1.0, 1e-9, 0.0)];
        let e = vertex_error(&[DVec3::new(1.0, 2e-9, 0.0)], &reference, &[1.0]);
        assert!((e.rms - 1e-6).abs() < 1e-12, "{e:?}");
    }

    #[test]
    fn the_dark_part_is_judged_by_its_own_mean() {
        let reference = [DVec3::ONE, DVec3::ONE, DVec3::splat(0.05), DVec3::splat(0.03)];
        let values = [DVec3::ONE, DVec3::ONE, DVec3::splat(0.07), DVec3::splat(0.05)];
        let e = vertex_error(&values, &reference, &[1.0; 4]);
        assert!((e.dark - 0.02 / 0.04).abs() < 1e-12 && e.rms < 0.03, "{e:?}");
        assert_eq!(vertex_error(&[DVec3::splat(1.1); 2], &[DVec3::ONE; 2], &[1.0; 2]).dark, 0.0);
        let black = vertex_error(&[DVec3::ONE, DVec3::splat(1e-3)], &[DVec3::ONE, DVec3::ZERO], &[1.0; 2]);
        assert!((black.dark - 2.0).abs() < 1e-12, "{black:?}");
    }

    #[test]
    fn a_field_of_errors_is_relative_to_the_rms_of_each_channel() {
        let truth = [DVec3::new(1.0, 2.0, 0.0), DVec3::new(1.0, 2.0, 0.0)];
        let values = [DVec3::new(1.1, 2.0, 0.0), DVec3::new(1.0, 1.0, 0.0)];
        let found = relative_errors(&values, &truth, &[1.0, 3.0]);
        assert!((found[0] - 0.1).abs() < 1e-6 && (found[1] - 0.5).abs() < 1e-6, "{found:?}");
        assert!(relative_errors(&truth, &[DVec3::ZERO; 2], &[0.0; 2]).iter().all(|e| e.is_finite()));
    }

    #[test]
    fn a_black_reference_is_safe() {
        assert_eq!(vertex_error(&[DVec3::ZERO], &[DVec3::ZERO], &[1.0]), VertexError::default());
        let infinite = vertex_error(&[DVec3::ONE], &[DVec3::ZERO], &[1.0]);
        assert!(infinite.rms.is_infinite());
        assert_eq!(infinite.or_none(), VertexError::default());
        assert_eq!(vertex_error(&[], &[], &[]), VertexError::default());
    }

    #[test]
    fn quantiles_are_by_nearest_rank() {
        let q = Quantiles::of((1..=10).rev().map(f64::from));
        assert_eq!(q, Quantiles { p10: 1.0, median: 5.0, p90: 9.0 });
        assert_eq!(Quantiles::of([7.0]), Quantiles { p10: 7.0, median: 7.0, p90: 7.0 });
        assert_eq!(Quantiles::of([]), Quantiles::default());
    }
}
