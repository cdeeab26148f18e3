//! A piece of a triangle, its bisection, and the points at which it is sampled.

use super::vector::{V3, add, cross, distance, hash, length, mul, normalised, sub, unit};

/// Part of a mesh triangle, in the same plane and with the same orientation.
#[derive(Clone, Copy, Debug)]
pub struct Patch {
    pub corners: [V3; 3],
    pub centroid: V3,
    pub normal: V3,
    /// Farthest corner from the centroid, mm.
    pub radius: f64,
    /// Longest edge, mm.
    pub size: f64,
    pub area: f64,
}

/// Radon's rule: seven barycentric points with weights that sum to one, exact for degree five.
#[inline]
pub fn radon_rule() -> [([f64; 3], f64); 7] {
    let root = 15.0_f64.sqrt();
    let mut rule = [([1.0 / 3.0; 3], 0.225); 7];
    for (family, sign) in [(0, -1.0), (1, 1.0)] {
        let a = (6.0 + sign * root) / 21.0;
        let w = (155.0 + sign * root) / 1200.0;
        for k in 0..3 {
            let mut barycentric = [a; 3];
            barycentric[k] = 1.0 - 2.0 * a;
            rule[1 + 3 * family + k] = (barycentric, w);
        }
    }
    rule
}

/// Sixteen barycentric points, one at random in each of the congruent triangles that two rounds of midpoint cuts give.
///
/// Centroids would do for most scenes, but a shadow edge along a regular grid meets all patches in the same place:
/// the error of a share of such points has one sign, that of random ones averages out.
pub fn sixteen_points(key: u64) -> [[f64; 3]; 16] {
    let mut points = [[0.0; 3]; 16];
    let mut k = 0;
    for i in 0..4 {
        for j in 0..4 - i {
            for turned in [false, true] {
                if turned && i + j == 3 {
                    continue;
                }
                let (s, t) = (unit(hash(key, 2 * k as u64)), unit(hash(key, 2 * k as u64 + 1)));
                let (s, t) = if s + t > 1.0 { (1.0 - s, 1.0 - t) } else { (s, t) };
                let (s, t) = if turned { (1.0 - s, 1.0 - t) } else { (s, t) };
                let (a, b) = ((f64::from(i) + s) / 4.0, (f64::from(j) + t) / 4.0);
                points[k] = [a, b, 1.0 - a - b];
                k += 1;
            }
        }
    }
    points
}

impl Patch {
    pub fn new(corners: [V3; 3]) -> Self {
        let n = cross(sub(corners[1], corners[0]), sub(corners[2], corners[0]));
        Self::in_plane(corners, normalised(n))
    }

    #[inline]
    fn in_plane(corners: [V3; 3], normal: V3) -> Self {
        let centroid = mul(add(add(corners[0], corners[1]), corners[2]), 1.0 / 3.0);
        let radius = corners.iter().map(|&c| distance(c, centroid)).fold(0.0, f64::max);
        let size = super::medium::longest_edge(corners);
        let area = 0.5 * length(cross(sub(corners[1], corners[0]), sub(corners[2], corners[0])));
        Self { corners, centroid, normal, radius, size, area }
    }

    #[inline]
    pub fn point(&self, barycentric: [f64; 3]) -> V3 {
        let [a, b, c] = self.corners;
        add(add(mul(a, barycentric[0]), mul(b, barycentric[1])), mul(c, barycentric[2]))
    }

    /// A hash of where the patch is, so that its random points depend on nothing else.
    pub fn key(&self) -> u64 {
        self.centroid.iter().chain([&self.size]).fold(0, |h, c| hash(h, c.to_bits()))
    }

    /// The two halves on either side of the middle of the longest edge.
    #[inline]
    pub fn bisected(&self) -> [Self; 2] {
        let c = self.corners;
        let lengths = [distance(c[0], c[1]), distance(c[1], c[2]), distance(c[2], c[0])];
        let mut k = 0;
        for i in 1..3 {
            if lengths[i] > lengths[k] {
                k = i;
            }
        }
        let (a, b, opposite) = (c[k], c[(k + 1) % 3], c[(k + 2) % 3]);
        let middle = mul(add(a, b), 0.5);
        [Self::in_plane([a, middle, opposite], self.normal), Self::in_plane([middle, b, opposite], self.normal)]
    }
}
