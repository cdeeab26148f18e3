//! The hat functions of near rings: their radii, areas on them, and near parts of profiles as sums of them.

use glam::DVec3;

use crate::geometry::ball::triangle_in_balls;
use crate::math::quadrature::gauss_legendre_cached;
use crate::medium::profile::Profile;
use crate::medium::softened::Softened;
use crate::transport::near_rule::three_points;

/// The k-th radius grows as this power of k: dense media are peaked at the receiver.
pub(super) const DENSER: i32 = 3;

/// Hat functions. With them and [`DENSER`] a shadow boundary anywhere costs at most 1e-3 of the light of a lit plane, waves of light
/// 2e-4, for free paths of 0.03 to 4 spacings of the samples and a split radius of 6.
pub(super) const RINGS: usize = 20;

/// Columns: the hats, that at the split radius, where near parts vanish, and light on `u = r^2 - split^2` and its
/// square, of the pieces of uneven samples, of which the far field has the mean.
pub(super) const COLUMNS: usize = WINDOWS * WIDTH;
pub(super) const SLOPE: usize = RINGS + 1;
pub(super) const CURVATURE: usize = RINGS + 2;

/// Columns side by side: a window.
pub(super) const WIDTH: usize = 8;
pub(super) const WINDOWS: usize = (RINGS + 3).div_ceil(WIDTH);

/// Points of a quadrature over an e-fold of the squared distance.
const ORDER: usize = 8;

/// Squared radii at which hats peak, mm^2, and last the split radius, where near parts end.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Rings(pub(super) [f64; RINGS + 1]);

impl Rings {
    pub(super) fn new(split_mm: f64) -> Self {
        Self(std::array::from_fn(|k| (split_mm * (k as f64 / RINGS as f64).powi(DENSER)).powi(2)))
    }

    /// Place of a squared distance: the hat before it, and the share of a point that falls on the next hat.
    pub(super) fn place(&self, r2: f64) -> Option<(usize, f64)> {
        let next = self.0.partition_point(|s| *s <= r2);
        let (from, to) = (*self.0.get(next.checked_sub(1)?)?, *self.0.get(next)?);
        Some((next - 1, (r2 - from) / (to - from)))
    }

    /// Adds an area at a point.
    pub(super) fn point(&self, r2: f64, area: f64, out: &mut Areas) {
        if let Some((first, t)) = self.place(r2) {
            out[first] += (area * (1.0 - t)) as f32;
            out[first + 1] += (area * t) as f32;
        }
    }

    /// Adds a triangle (relative to the receiver, mm) by its area; the part beyond the split radius is on no hat.
    pub(super) fn triangle(&self, corners: [DVec3; 3], out: &mut Areas) {
        let mut before = [0.0; 2];
        for (k, now) in triangle_in_balls(corners, &self.0[1..]).enumerate() {
            let (area, moment) = (now[0] - before[0], now[1] - before[1]);
            let (from, to) = (self.0[k], self.0[k + 1]);
            // f64::min turns what is no number into the bound.
            let beyond = ((moment - from * area) / (to - from)).max(0.0).min(area.max(0.0));
            out[k] += (area - beyond).max(0.0) as f32;
            out[k + 1] += beyond as f32;
            before = now;
        }
    }

    /// Adds a triangle as three points, by the near-field rule.
    pub(super) fn three_points(&self, corners: [DVec3; 3], out: &mut Areas) {
        let (points, third) = three_points(corners);
        for point in points {
            self.point(point.length_squared(), third, out);
        }
    }

    /// Coefficients of the columns of one channel, of a profile that is smooth inside a depth, mm.
    pub(super) fn coefficients(&self, profile: &dyn Profile, smooth_mm: f64) -> [f32; COLUMNS] {
        let far = Softened::new(profile, self.0[RINGS].sqrt());
        let near = |r2: f64| {
            let value = far.less(profile, r2);
            if value.is_finite() { value } else { 0.0 }
        };
        let (mut diagonal, mut beside, mut right) = ([0.0; RINGS + 1], [0.0; RINGS + 1], [0.0; RINGS + 1]);
        let scale2 = (smooth_mm * smooth_mm).max(1e-9 * self.0[1]);
        let rule = gauss_legendre_cached(ORDER);
        for k in 0..RINGS {
            let (from, to) = (self.0[k], self.0[k + 1]);
            let width = to - from;
            diagonal[k] += width / 3.0;
            diagonal[k + 1] += width / 3.0;
            beside[k] += width / 6.0;
            // Even in the logarithm of r^2 + s^2, s the scale on which the profile is smooth.
            let (low, high) = ((from + scale2).ln(), (to + scale2).ln());
            let pieces = (high - low).ceil().max(1.0);
            let half = 0.5 * (high - low) / pieces;
            for piece in 0..pieces as usize {
                let middle = low + (2.0 * piece as f64 + 1.0) * half;
                for node in rule {
                    let x = (middle + half * node.position).exp();
                    let r2 = (x - scale2).clamp(from, to);
                    let (weighted, t) = (node.weight * half * x * near(r2), (r2 - from) / width);
                    right[k] += weighted * (1.0 - t);
                    right[k + 1] += weighted * t;
                }
            }
        }
        // Thomas' algorithm: diagonally dominant. Nothing is left at the split radius.
        for k in 1..RINGS {
            let factor = beside[k - 1] / diagonal[k - 1];
            diagonal[k] -= factor * beside[k - 1];
            right[k] -= factor * right[k - 1];
        }
        let mut next = 0.0;
        let mut result = [0.0; COLUMNS];
        for k in (0..RINGS).rev() {
            let above = if k + 1 < RINGS { beside[k] * next } else { 0.0 };
            next = (right[k] - above) / diagonal[k];
            result[k] = next as f32;
        }
        let [_, slope, curvature] = far.polynomial();
        result[SLOPE] = slope as f32;
        result[CURVATURE] = curvature as f32;
        result
    }
}

/// Areas on the hats and, the last one, at the split radius, mm^2.
pub(super) type Areas = [f32; RINGS + 1];
