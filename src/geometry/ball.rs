//! Triangles cut by balls around the origin.

use glam::{DVec2, DVec3};

/// Area of the parts of a triangle (mm) inside balls around the origin, given by their squared radii in mm^2, and the integral of
/// r^2 over them: mm^2, mm^4. In closed form: edge after edge, as sums over the angle around the foot of the perpendicular.
pub fn triangle_in_balls(corners: [DVec3; 3], squared_radii: &[f64]) -> impl Iterator<Item = [f64; 2]> {
    let [a, b, c] = corners;
    let normal = (b - a).cross(c - a).normalize_or_zero();
    let height = normal.dot(a);
    let axis = (b - a).normalize_or_zero();
    let in_plane = |p: DVec3| DVec2::new(axis.dot(p), normal.cross(axis).dot(p));
    let flat = corners.map(in_plane);
    let edges: [Edge; 3] = std::array::from_fn(|k| Edge::new(flat[k], flat[(k + 1) % 3]));
    let height2 = height * height;
    squared_radii.iter().map(move |&square| {
        let mut sums = [0.0; 2];
        for edge in &edges {
            edge.add(height2, (square - height2).max(0.0), &mut sums);
        }
        sums.map(|sum| sum.max(0.0))
    })
}

/// An edge as the foot of the perpendicular sees it, mm.
struct Edge {
    /// Distance of the edge's line from the foot, and the side of the line, 1 or -1, on which the foot is.
    distance: f64,
    side: f64,
    /// Coordinates of the ends along the line, and their angles seen from the foot, in radians.
    ends: [f64; 2],
    angles: [f64; 2],
}

impl Edge {
    fn new(from: DVec2, to: DVec2) -> Self {
        let along = (to - from).normalize_or_zero();
        let signed = from.perp_dot(along);
        let (distance, ends) = (signed.abs(), [from.dot(along), to.dot(along)]);
        Self { distance, side: signed.signum(), ends, angles: ends.map(|t| t.atan2(distance)) }
    }

    /// Adds the sector between the foot and the edge, inside a circle with this squared radius.
    fn add(&self, height2: f64, circle2: f64, [area, moment]: &mut [f64; 2]) {
        let ([from, to], [first, last], d) = (self.ends, self.angles, self.distance);
        let inside2 = circle2 - d * d;
        let (mut arc, mut low, mut high) = (last - first, 0.0, 0.0);
        if inside2 > 0.0 {
            let half = inside2.sqrt();
            (low, high) = (from.max(-half), to.min(half));
            if low < high {
                let angle = |t: f64, end: f64, known: f64| if t == end { known } else { t.atan2(d) };
                arc -= angle(high, to, last) - angle(low, from, first);
            } else {
                (low, high) = (0.0, 0.0);
            }
        }
        let length = high - low;
        let cubes = (high * high * high - low * low * low) / 3.0;
        *area += 0.5 * self.side * (d * length + circle2 * arc);
        let straight = d * (0.25 * (d * d * length + cubes) + 0.5 * height2 * length);
        *moment += self.side * (straight + circle2 * (0.25 * circle2 + 0.5 * height2) * arc);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Area and moment inside a ball, as sums over midpoints of small triangles.
    fn by_points([a, b, c]: [DVec3; 3], square: f64) -> [f64; 2] {
        const SIDE: usize = 400;
        let cell = 0.5 * (b - a).cross(c - a).length() / (SIDE * SIDE) as f64;
        let at = |i: f64, j: f64| a + (b - a) * (i / SIDE as f64) + (c - a) * (j / SIDE as f64);
        let mut sums = [0.0; 2];
        for i in 0..SIDE {
            for j in 0..SIDE - i {
                let (x, y) = (i as f64, j as f64);
                let upper = (i + j + 1 < SIDE).then_some(at(x + 2.0 / 3.0, y + 2.0 / 3.0));
                for p in [Some(at(x + 1.0 / 3.0, y + 1.0 / 3.0)), upper].into_iter().flatten() {
                    let r2 = p.length_squared();
                    if r2 < square {
                        sums[0] += cell;
                        sums[1] += cell * r2;
                    }
                }
            }
        }
        sums
    }

    #[test]
    fn sums_over_midpoints_agree() {
        let triangles = [
            [DVec3::new(0.0, 0.0, 0.0), DVec3::new(1.0, 0.0, 0.0), DVec3::new(0.2, 0.9, 0.3)],
            [DVec3::new(-0.4, -0.3, 0.2), DVec3::new(1.0, 0.1, 0.3), DVec3::new(0.1, 1.1, 0.1)],
            [DVec3::new(0.5, 0.2, -0.1), DVec3::new(1.4, 0.1, 0.0), DVec3::new(0.7, 1.0, 0.4)],
            [DVec3::new(-1.0, 0.0, 0.0), DVec3::new(1.0, 0.0, 0.0), DVec3::new(0.0, 0.6, 0.0)],
        ];
        for corners in triangles {
            for turned in [corners, [corners[1], corners[0], corners[2]], [corners[2], corners[0], corners[1]]] {
                let squares = [0.01, 0.1, 0.3, 0.8, 1.5, 9.0];
                for (square, exact) in squares.iter().zip(triangle_in_balls(turned, &squares)) {
                    let points = by_points(turned, *square);
                    for (a, b) in exact.iter().zip(points) {
                        assert!((a - b).abs() < 2e-3 * b.max(0.01), "{turned:?} {square}: {exact:?} {points:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_ball_that_holds_the_triangle_gives_its_area_and_moment() {
        let [a, b, c] = [DVec3::new(3.0, 1.0, 2.0), DVec3::new(4.0, 1.5, 2.5), DVec3::new(3.2, 2.0, 1.0)];
        let area = 0.5 * (b - a).cross(c - a).length();
        // Quadratic functions: midpoints of the edges.
        let moment = area / 3.0 * [a + b, b + c, c + a].map(|s| 0.25 * s.length_squared()).iter().sum::<f64>();
        let Some([whole, square]) = triangle_in_balls([a, b, c], &[100.0]).next() else { panic!("one ball") };
        assert!((whole / area - 1.0).abs() < 1e-12 && (square / moment - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_corner_at_the_centre_is_a_sector_and_nothing_of_a_line_is_inside() {
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let Some([area, moment]) = triangle_in_balls(corners, &[0.25]).next() else { panic!("one ball") };
        let sector = std::f64::consts::FRAC_PI_2;
        assert!((area - 0.5 * sector * 0.25).abs() < 1e-15 && (moment - 0.25 * sector * 0.0625).abs() < 1e-15);
        let line = [DVec3::ZERO, DVec3::X, 2.0 * DVec3::X];
        assert_eq!(triangle_in_balls(line, &[4.0]).next(), Some([0.0; 2]));
    }
}
