//! Cube maps: faces +X -X +Y -Y +Z -Z, row 0 at the top, in the orientation of the usual graphics interfaces.
//!
//! A direction lies on the face of its largest component, at `s` (to the right) and `t` (downwards) in [-1, 1];
//! `forward + s * right + t * down` points there. Texel `(x, y)` of face `f` with `side` texels along each edge has the
//! index `(f * side + y) * side + x` and its centre at `s = (2 x + 1) / side - 1`, `t = (2 y + 1) / side - 1`.

use std::f64::consts::PI;

use glam::DVec3;

/// Number of faces.
pub const FACES: usize = 6;

/// The axes of a face.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Axis through the centre of the face.
    pub forward: DVec3,
    /// Axis along which `s` grows.
    pub right: DVec3,
    /// Axis along which `t` grows.
    pub down: DVec3,
}

/// Axes of every face, in order.
pub const FRAMES: [Frame; FACES] = [
    Frame { forward: DVec3::X, right: DVec3::NEG_Z, down: DVec3::NEG_Y },
    Frame { forward: DVec3::NEG_X, right: DVec3::Z, down: DVec3::NEG_Y },
    Frame { forward: DVec3::Y, right: DVec3::X, down: DVec3::Z },
    Frame { forward: DVec3::NEG_Y, right: DVec3::X, down: DVec3::NEG_Z },
    Frame { forward: DVec3::Z, right: DVec3::X, down: DVec3::NEG_Y },
    Frame { forward: DVec3::NEG_Z, right: DVec3::NEG_X, down: DVec3::NEG_Y },
];

impl Frame {
    /// Direction of a point of the face, not normalised.
    #[inline]
    pub fn direction(&self, s: f64, t: f64) -> DVec3 {
        self.forward + s * self.right + t * self.down
    }
}

/// `s` or `t` of the centre of a texel.
#[inline]
pub fn centre(side: usize, texel: usize) -> f64 {
    (2 * texel + 1) as f64 / side as f64 - 1.0
}

/// Unit direction of the centre of a texel.
#[inline]
pub fn direction(side: usize, face: usize, x: usize, y: usize) -> DVec3 {
    FRAMES[face % FACES].direction(centre(side, x), centre(side, y)).normalize()
}

/// Face, `s` and `t` of a direction of any length; where two components are equal, the face of the first axis.
#[inline]
pub fn position_of(direction: DVec3) -> (usize, f64, f64) {
    let DVec3 { x, y, z } = direction;
    let [ax, ay, az] = [x.abs(), y.abs(), z.abs()];
    let (axis, along, length) = if ax >= ay && ax >= az {
        (0, x, ax)
    } else if ay >= az {
        (2, y, ay)
    } else {
        (4, z, az)
    };
    let face = axis + usize::from(along < 0.0);
    let frame = FRAMES[face];
    (face, frame.right.dot(direction) / length, frame.down.dot(direction) / length)
}

/// Index of the texel that a direction falls on.
pub fn texel_of(side: usize, direction: DVec3) -> usize {
    let (face, s, t) = position_of(direction);
    let cell = |u: f64| ((0.5 * (u + 1.0) * side as f64) as usize).min(side - 1);
    (face * side + cell(t)) * side + cell(s)
}

/// Solid angle in sr of the rectangle from the centre of a face to `(s, t)`.
fn corner_solid_angle(s: f64, t: f64) -> f64 {
    (s * t).atan2((s * s + t * t + 1.0).sqrt())
}

/// Exact solid angles in sr of the texels of one face, row by row; the six faces are alike.
pub fn solid_angles_sr(side: usize) -> Vec<f64> {
    let edge = |i: usize| 2.0 * i as f64 / side as f64 - 1.0;
    let mut angles = vec![0.0; side * side];
    for y in 0..side {
        for x in 0..side {
            // Texels mirrored across the axes and the diagonal get the same bits.
            let (a, b) = (x.min(side - 1 - x), y.min(side - 1 - y));
            let (a, b) = (a.min(b), a.max(b));
            let [s0, s1, t0, t1] = [edge(a), edge(a + 1), edge(b), edge(b + 1)];
            let positive = corner_solid_angle(s1, t1) + corner_solid_angle(s0, t0);
            angles[y * side + x] = positive - corner_solid_angle(s0, t1) - corner_solid_angle(s1, t0);
        }
    }
    // Differences lose some digits; the sum is known.
    let factor = 4.0 * PI / 6.0 / angles.iter().sum::<f64>();
    angles.iter_mut().for_each(|a| *a *= factor);
    angles
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::uniform;

    #[test]
    fn frames_are_the_table_of_the_format() {
        let (s, t) = (0.25, -0.5);
        let table = [
            DVec3::new(1.0, -t, -s),
            DVec3::new(-1.0, -t, s),
            DVec3::new(s, 1.0, t),
            DVec3::new(s, -1.0, -t),
            DVec3::new(s, -t, 1.0),
            DVec3::new(-s, -t, -1.0),
        ];
        for (frame, expected) in FRAMES.iter().zip(table) {
            assert_eq!(frame.direction(s, t), expected);
        }
    }

    #[test]
    fn positions_and_directions_are_inverse() {
        for side in [1, 4, 32, 64] {
            for index in 0..FACES * side * side {
                let (face, y, x) = (index / side / side, index / side % side, index % side);
                let d = direction(side, face, x, y);
                let (f, s, t) = position_of(d * 3.0);
                assert!(f == face && (s - centre(side, x)).abs() < 1e-14 && (t - centre(side, y)).abs() < 1e-14);
                assert_eq!(texel_of(side, d), index);
            }
        }
        for d in [DVec3::ONE, -DVec3::ONE, DVec3::ZERO, DVec3::NAN, DVec3::INFINITY] {
            assert!(texel_of(8, d) < FACES * 64);
        }
    }

    #[test]
    fn solid_angles_sum_to_the_sphere_and_agree_with_counting() {
        for side in [1, 2, 32, 64, 128] {
            let angles = solid_angles_sr(side);
            assert!((6.0 * angles.iter().sum::<f64>() - 4.0 * PI).abs() < 1e-12);
            for (i, angle) in angles.iter().enumerate().filter(|_| side >= 32) {
                let (s, t) = (centre(side, i % side), centre(side, i / side));
                let middle = 4.0 / (side * side) as f64 / (1.0 + s * s + t * t).powf(1.5);
                assert!((angle / middle - 1.0).abs() < 1e-3);
            }
        }
        let (angles, count) = (solid_angles_sr(4), 400_000);
        let mut hits = [0.0; 16];
        for i in 0..count {
            let (z, a) = (2.0 * uniform(1, i, 0) - 1.0, 2.0 * PI * uniform(1, i, 1));
            let r = (1.0 - z * z).sqrt();
            hits[texel_of(4, DVec3::new(r * a.cos(), r * a.sin(), z)) % 16] += 4.0 * PI / count as f64 / 6.0;
        }
        for (hit, angle) in hits.iter().zip(&angles) {
            assert!((hit / angle - 1.0).abs() < 0.04, "{hit} {angle}");
        }
    }
}
