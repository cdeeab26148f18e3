//! Functions of the direction as values on the texels of a cube map.

use glam::DVec3;

use crate::math::cube_map::{FACES, FRAMES, centre, position_of, texel_of};

/// Texels along an edge of a face.
pub const SIDE: usize = 16;

/// A few functions of the direction, interpolated between the texels of a cube map.
#[derive(Clone, Debug, PartialEq)]
pub struct DirectionMaps {
    terms: usize,
    values: Vec<f64>,
}

impl DirectionMaps {
    /// The functions with these values, `[texel][term]` in the order of [`crate::math::cube_map`] with [`SIDE`] texels along an
    /// edge; what is missing counts as 0.
    pub fn new(terms: usize, mut values: Vec<f64>) -> Self {
        values.resize(FACES * SIDE * SIDE * terms, 0.0);
        Self { terms, values }
    }

    /// Number of functions.
    pub fn terms(&self) -> usize {
        self.terms
    }

    /// Their values, `[texel][term]`.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// The functions at a direction of any length; fills as much of `out` as there are.
    pub fn evaluate(&self, at: DVec3, out: &mut [f64]) {
        let count = self.terms.min(out.len());
        let out = &mut out[..count];
        out.fill(0.0);
        if !at.is_finite() || at == DVec3::ZERO {
            return;
        }
        let (face, s, t) = position_of(at);
        let cell = |u: f64| 0.5 * (u + 1.0) * SIDE as f64 - 0.5;
        let (x, y) = (cell(s), cell(t));
        for (dx, wx) in [(0.0, 1.0 - (x - x.floor())), (1.0, x - x.floor())] {
            for (dy, wy) in [(0.0, 1.0 - (y - y.floor())), (1.0, y - y.floor())] {
                let (x, y) = (x.floor() + dx, y.floor() + dy);
                let inside = |u: f64| (0.0..SIDE as f64).contains(&u);
                let texel = if inside(x) && inside(y) {
                    (face * SIDE + y as usize) * SIDE + x as usize
                } else {
                    // Beyond the edge of the face, the texel of the next one in that direction.
                    let beyond = |u: f64| centre(SIDE, 0) + 2.0 * u / SIDE as f64;
                    texel_of(SIDE, FRAMES[face].direction(beyond(x), beyond(y)))
                };
                let map = &self.values[texel * self.terms..][..count];
                out.iter_mut().zip(map).for_each(|(sum, value)| *sum += wx * wy * value);
            }
        }
    }
}
