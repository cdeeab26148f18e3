//! Exact enough tests between triangles: distance, and crossings of a ray.

use glam::DVec3;

/// A triangle by its corners.
pub(crate) type Corners = [DVec3; 3];

/// True if two triangles intersect or come within `distance` of each other, coplanar overlap included.
///
/// Two triangles are nearest at two edges or at a corner and a face, unless an edge of one pierces the other.
pub(crate) fn within(a: &Corners, b: &Corners, distance: f64) -> bool {
    let limit = distance * distance;
    let edges = |t: &Corners| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]];
    let (edges_a, edges_b) = (edges(a), edges(b));
    edges_a.iter().any(|e| pierces(e, b))
        || edges_b.iter().any(|e| pierces(e, a))
        || edges_a.iter().any(|e| edges_b.iter().any(|f| segment_distance2(e, f) <= limit))
        || a.iter().any(|&p| face_distance2(p, b).is_some_and(|d| d <= limit))
        || b.iter().any(|&p| face_distance2(p, a).is_some_and(|d| d <= limit))
}

/// True if a segment passes through the interior of a triangle; contact within rounding is left to the distances.
fn pierces(segment: &[DVec3; 2], triangle: &Corners) -> bool {
    let direction = segment[1] - segment[0];
    matches!(crossing(segment[0], direction, triangle), Crossing::At { t, .. } if t <= 1.0)
}

/// Squared distance of a point from a triangle, if its foot lies inside the triangle.
fn face_distance2(p: DVec3, [a, b, c]: &Corners) -> Option<f64> {
    let normal = (b - a).cross(c - a);
    let scale = normal.length_squared();
    if scale == 0.0 {
        return None;
    }
    let inside = |u: DVec3, v: DVec3| (v - u).cross(p - u).dot(normal) >= 0.0;
    if inside(*a, *b) && inside(*b, *c) && inside(*c, *a) {
        let height = (p - a).dot(normal);
        Some(height * height / scale)
    } else {
        None
    }
}

/// Squared distance between two segments (Ericson, Real-Time Collision Detection, section 5.1.9).
fn segment_distance2(p: &[DVec3; 2], q: &[DVec3; 2]) -> f64 {
    let (d1, d2, r) = (p[1] - p[0], q[1] - q[0], p[0] - q[0]);
    let (a, e, f) = (d1.length_squared(), d2.length_squared(), d2.dot(r));
    let unit = |x: f64| x.clamp(0.0, 1.0);
    let (s, t) = if a == 0.0 && e == 0.0 {
        (0.0, 0.0)
    } else if a == 0.0 {
        (0.0, unit(f / e))
    } else {
        let c = d1.dot(r);
        if e == 0.0 {
            (unit(-c / a), 0.0)
        } else {
            let b = d1.dot(d2);
            let denominator = a * e - b * b;
            let s = if denominator > 0.0 { unit((b * f - c * e) / denominator) } else { 0.0 };
            let t = (b * s + f) / e;
            if t < 0.0 {
                (unit(-c / a), 0.0)
            } else if t > 1.0 {
                (unit((b - c) / a), 1.0)
            } else {
                (s, t)
            }
        }
    };
    (p[0] + d1 * s - q[0] - d2 * t).length_squared()
}

/// Crossing of a ray with a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Crossing {
    /// No crossing at t > 0.
    None,
    /// Inside the triangle at `t`; `outward` if the ray leaves through the back of the face.
    At { t: f64, outward: bool },
    /// The ray passes through an edge or a corner, or along the face, as far as rounding can tell.
    Unclear,
}

/// Intersects the ray `origin + t direction`, t > 0, with a triangle (Moeller and Trumbore 1997).
pub(crate) fn crossing(origin: DVec3, direction: DVec3, [a, b, c]: &Corners) -> Crossing {
    const EDGE: f64 = 1e-10;
    let (e1, e2) = (b - a, c - a);
    let p = direction.cross(e2);
    let det = e1.dot(p);
    let scale = e1.length() * e2.length() * direction.length();
    let s = origin - a;
    if det.abs() <= EDGE * scale {
        // Parallel to the face: only a ray in its plane can meet it.
        let height = s.dot(e1.cross(e2)).abs();
        let near = height <= EDGE * e1.cross(e2).length() * (s.length() + e1.length() + e2.length());
        return if near { Crossing::Unclear } else { Crossing::None };
    }
    let q = s.cross(e1);
    let (u, v, t) = (s.dot(p) / det, direction.dot(q) / det, e2.dot(q) / det);
    let w = 1.0 - u - v;
    let least = u.min(v).min(w);
    if least < -EDGE || t <= 0.0 {
        Crossing::None
    } else if least <= EDGE {
        Crossing::Unclear
    } else {
        Crossing::At { t, outward: det < 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::uniform;

    fn triangle(points: [[f64; 3]; 3]) -> Corners {
        points.map(DVec3::from)
    }

    const BASE: [[f64; 3]; 3] = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]];

    #[test]
    fn known_pairs_touch_or_do_not() {
        let base = triangle(BASE);
        let cases = [
            ([[1.0, 1.0, -1.0], [1.0, 1.0, 1.0], [9.0, 9.0, 0.5]], true, "pierces"),
            ([[0.5, 0.5, 0.0], [1.0, 0.5, 0.0], [0.5, 1.0, 0.0]], true, "coplanar inside"),
            ([[5.0, 5.0, 0.0], [6.0, 5.0, 0.0], [5.0, 6.0, 0.0]], false, "coplanar outside"),
            ([[4.0, 0.0, 0.0], [6.0, 0.0, 0.0], [6.0, 1.0, 3.0]], true, "corner on corner"),
            ([[1.0, 1.0, 1e-7], [1.0, 1.0, 1.0], [2.0, 1.0, 1.0]], true, "corner above face within tolerance"),
            ([[1.0, 1.0, 1e-3], [1.0, 1.0, 1.0], [2.0, 1.0, 1.0]], false, "corner above face"),
            ([[1.0, 1.0, 0.5], [2.0, 1.0, 0.5], [1.0, 2.0, 0.5]], false, "parallel above"),
            ([[2.0, -1.0, 0.0], [2.0, 0.0, 0.0], [3.0, -1.0, 0.0]], true, "corner on edge"),
        ];
        for (points, expected, name) in cases {
            let other = triangle(points);
            assert_eq!(within(&base, &other, 1e-6), expected, "{name}");
            assert_eq!(within(&other, &base, 1e-6), expected, "{name}, swapped");
        }
    }

    #[test]
    fn the_distance_agrees_with_dense_sampling() {
        let random = |i: u64| [0, 1, 2].map(|k| [0, 1, 2].map(|d| uniform(i, k, d) * 2.0)).map(DVec3::from);
        let points = |t: &Corners| {
            let t = *t;
            (0..=24).flat_map(move |i| {
                (0..=24 - i)
                    .map(move |j| t[0] + (t[1] - t[0]) * f64::from(i) / 24.0 + (t[2] - t[0]) * f64::from(j) / 24.0)
            })
        };
        for i in 0..40 {
            let (a, b) = (random(2 * i), random(2 * i + 1));
            let mut nearest = f64::INFINITY;
            for p in points(&a) {
                for q in points(&b) {
                    nearest = nearest.min(p.distance(q));
                }
            }
            assert!(within(&a, &b, nearest + 1e-12), "the true distance is at most the sampled one");
            let error = 4.0 / 24.0;
            if nearest > error {
                assert!(!within(&a, &b, nearest - error));
            }
        }
    }

    #[test]
    fn rays_report_side_and_doubt() {
        let base = triangle(BASE);
        let down = DVec3::NEG_Z;
        assert_eq!(crossing(DVec3::new(1.0, 1.0, 2.0), down, &base), Crossing::At { t: 2.0, outward: false });
        assert_eq!(crossing(DVec3::new(1.0, 1.0, -2.0), -down, &base), Crossing::At { t: 2.0, outward: true });
        assert_eq!(crossing(DVec3::new(1.0, 0.0, 2.0), down, &base), Crossing::Unclear);
        assert_eq!(crossing(DVec3::new(9.0, 0.0, 2.0), down, &base), Crossing::None);
        assert_eq!(crossing(DVec3::new(1.0, 1.0, -2.0), down, &base), Crossing::None);
        assert_eq!(crossing(DVec3::new(-1.0, 1.0, 0.0), DVec3::X, &base), Crossing::Unclear);
        assert_eq!(crossing(DVec3::new(-1.0, 1.0, 1.0), DVec3::X, &base), Crossing::None);
    }
}
