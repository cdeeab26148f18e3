//! Functions of direction like those that a light set is to interpolate: clamped cosines with shadow edges, both blurred.

use std::f64::consts::{PI, SQRT_2, TAU};

use glam::DVec3;

use crate::math::random::uniform;
use crate::math::sphere::random_direction;

/// Normal distribution function; the error function by the series of Abramowitz & Stegun 7.1.5 and the fraction of 7.1.14.
fn normal_cdf(x: f64) -> f64 {
    let t = (x / SQRT_2).abs();
    let upper = if t < 2.5 {
        let (mut term, mut sum) = (t, t);
        for n in 1..60 {
            term *= -t * t / f64::from(n);
            sum += term / f64::from(2 * n + 1);
        }
        0.5 - sum / PI.sqrt()
    } else {
        let fraction = (1..60).rev().fold(t, |f, k| t + 0.5 * f64::from(k) / f);
        0.5 * (-t * t).exp() / (PI.sqrt() * fraction)
    };
    if x > 0.0 { 1.0 - upper } else { upper }
}

/// max(0, n.w) times up to two shadow edges, each blurred by a Gaussian of its own width.
pub(super) struct Lit {
    normal: DVec3,
    width: f64,
    edges: Vec<(DVec3, f64, f64)>,
}

impl Lit {
    /// The `index`-th function, with widths (standard deviations) between these angles in degrees.
    pub(super) fn new(index: u64, narrowest: f64, widest: f64) -> Self {
        let width = |k| (narrowest * (widest / narrowest).powf(uniform(12, index, k))).to_radians();
        let edges = (uniform(13, index, 0) * 3.0) as u64;
        let edge = |e| (random_direction(14, 4 * index + e), 0.8 * uniform(15, index, e) - 0.6, width(5 + e));
        Self { normal: random_direction(11, index), width: width(0), edges: (0..edges).map(edge).collect() }
    }

    pub(super) fn at(&self, direction: DVec3) -> f64 {
        let t = self.normal.dot(direction) / self.width;
        let cosine = self.width * ((-0.5 * t * t).exp() / TAU.sqrt() + t * normal_cdf(t));
        cosine * self.edges.iter().map(|(d, at, width)| normal_cdf((d.dot(direction) - at) / width)).product::<f64>()
    }

    /// The function at the surface point `place` of the unit ball, lit by a point light at `direction / inverse` of the intensity
    /// that gives an irradiance of 1 at the centre.
    pub(super) fn at_point(&self, place: DVec3, direction: DVec3, inverse: f64) -> f64 {
        let to_light = direction - inverse * place;
        self.at(to_light.normalize()) / to_light.length_squared()
    }
}

#[test]
fn the_distribution_function_has_its_tabulated_values() {
    let table = [(0.0, 0.5), (1.0, 0.841_344_746_068_543), (2.0, 0.977_249_868_051_821), (4.0, 0.999_968_328_758_167)];
    for (x, value) in table {
        assert!((normal_cdf(x) - value).abs() < 1e-12 && (normal_cdf(-x) - 1.0 + value).abs() < 1e-12);
    }
}
