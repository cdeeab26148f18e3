//! Power laws through measured points: cost = factor * size^exponent, by least squares in logarithms.

use serde::{Deserialize, Serialize};

/// A fitted power law.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct PowerLaw {
    /// Exponent.
    pub exponent: f64,
    /// Its standard error from the scatter about the line.
    pub standard_error: f64,
    /// Cost at size 1.
    pub factor: f64,
    /// Number of points that were fitted.
    pub points: usize,
}

impl PowerLaw {
    /// The law's cost at a size.
    pub fn at(&self, size: f64) -> f64 {
        self.factor * size.powf(self.exponent)
    }
}

/// Line through points of a plane: slope, height at 0, sum of squared distances, sum of squares of x about its mean.
struct Line {
    slope: f64,
    height: f64,
    residual: f64,
    spread: f64,
}

/// Logarithms of the points whose coordinates are positive and finite.
fn logarithms(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let usable = |v: f64| v.is_finite() && v > 0.0;
    points.iter().filter(|(x, y)| usable(*x) && usable(*y)).map(|(x, y)| (x.ln(), y.ln())).collect()
}

/// Least-squares line; none where all x are the same.
fn line(points: &[(f64, f64)]) -> Option<Line> {
    let count = points.len() as f64;
    let mean = |f: fn(&(f64, f64)) -> f64| points.iter().map(f).sum::<f64>() / count;
    let (x0, y0) = (mean(|p| p.0), mean(|p| p.1));
    let spread: f64 = points.iter().map(|(x, _)| (x - x0).powi(2)).sum();
    // Sizes that differ by less than a part in 10^4 are one size.
    if spread.is_nan() || spread <= 1e-8 {
        return None;
    }
    let slope = points.iter().map(|(x, y)| (x - x0) * (y - y0)).sum::<f64>() / spread;
    let height = y0 - slope * x0;
    let residual = points.iter().map(|(x, y)| (y - height - slope * x).powi(2)).sum();
    Some(Line { slope, height, residual, spread })
}

/// The law of at least three points (size, cost); points that are not positive are left out. None for fewer or for one
/// size alone.
pub fn power_law(points: &[(f64, f64)]) -> Option<PowerLaw> {
    let places = logarithms(points);
    if places.len() < 3 {
        return None;
    }
    let Line { slope, height, residual, spread } = line(&places)?;
    let variance = residual / (places.len() - 2) as f64;
    Some(PowerLaw {
        exponent: slope,
        standard_error: (variance / spread).sqrt(),
        factor: height.exp(),
        points: places.len(),
    })
}

/// Exponent between the last two points.
pub fn end_slope(points: &[(f64, f64)]) -> Option<f64> {
    let places = logarithms(points);
    line(places.get(places.len().checked_sub(2)?..)?).map(|l| l.slope)
}

/// Predicts the cost at a larger size from the points so far (by ascending size): the larger of the extrapolations from
/// all points and from the last two; a single point grows with the `assumed` exponent. None without points.
pub fn predict(points: &[(f64, f64)], size: f64, assumed: f64) -> Option<f64> {
    let places = logarithms(points);
    let (last_x, last_y) = *places.last()?;
    let x = size.ln();
    let from = |slope: f64, height: f64| (height + slope * x).exp();
    let last_two = places.len().checked_sub(2).and_then(|at| line(places.get(at..)?));
    match (line(&places), last_two) {
        (Some(all), Some(two)) => Some(from(all.slope, all.height).max((last_y + two.slope * (x - last_x)).exp())),
        _ => Some((last_y + assumed * (x - last_x)).exp()),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn an_exact_law_is_found() {
        for exponent in [-0.5, 0.0, 1.0, 2.0] {
            let points: Vec<(f64, f64)> = [1e4, 3e4, 1e5, 1e6].map(|x: f64| (x, 0.02 * x.powf(exponent))).into();
            let law = power_law(&points).unwrap();
            assert!((law.exponent - exponent).abs() < 1e-12 && law.standard_error < 1e-12, "{law:?}");
            assert!((law.factor / 0.02 - 1.0).abs() < 1e-10 && law.points == 4, "{law:?}");
            assert!((law.at(2e5) / (0.02 * 2e5f64.powf(exponent)) - 1.0).abs() < 1e-10);
            assert!((end_slope(&points).unwrap() - exponent).abs() < 1e-12);
        }
    }

    #[test]
    fn the_standard_error_is_that_of_the_textbook() {
        // ln x = 0, 1, 2, 3; ln y = 0 + e, 1 - e, 2 - e, 3 + e: the slope stays 1, the residuals stay e, and
        // SE = sqrt(4 e^2 / 2 / 5).
        let e = 0.1f64;
        let points: Vec<(f64, f64)> = [(0.0, e), (1.0, 1.0 - e), (2.0, 2.0 - e), (3.0, 3.0 + e)]
            .map(|(x, y): (f64, f64)| (x.exp(), y.exp()))
            .into();
        let law = power_law(&points).unwrap();
        assert!((law.exponent - 1.0).abs() < 1e-12, "{law:?}");
        assert!((law.standard_error - (4.0 * e * e / 2.0 / 5.0).sqrt()).abs() < 1e-12, "{law:?}");
    }

    #[test]
    fn too_little_has_no_law() {
        assert_eq!(power_law(&[(1.0, 1.0), (2.0, 2.0)]), None);
        assert_eq!(power_law(&[(1.0, 1.0), (2.0, 2.0), (3.0, 0.0), (f64::NAN, 1.0), (4.0, f64::INFINITY)]), None);
        assert_eq!(power_law(&[(5.0, 1.0), (5.0, 2.0), (5.0, 3.0)]), None);
        assert_eq!((end_slope(&[]), end_slope(&[(1.0, 1.0)])), (None, None));
    }

    #[test]
    fn predictions_follow_the_steeper_of_the_whole_and_the_end() {
        assert_eq!(predict(&[], 10.0, 1.0), None);
        let near = |a: Option<f64>, b: f64| assert!((a.unwrap() / b - 1.0).abs() < 1e-9, "{a:?} {b}");
        near(predict(&[(10.0, 3.0)], 100.0, 1.0), 30.0);
        near(predict(&[(10.0, 3.0)], 100.0, 0.0), 3.0);
        near(predict(&[(10.0, 3.0), (100.0, 300.0)], 1000.0, 1.0), 30_000.0);
        // Flat, then quadratic: the end decides.
        near(predict(&[(1.0, 1.0), (10.0, 1.0), (100.0, 100.0)], 1000.0, 1.0), 10_000.0);
        // Two points of one size: the assumed exponent.
        near(predict(&[(10.0, 3.0), (10.0, 4.0)], 100.0, 1.0), 40.0);
    }
}
