//! The piece of a triangle in a texel, as a polygon on the surface.

use glam::{DVec2, DVec3, Vec2};

use super::cut;

/// Corners of a convex, flat piece of the surface, in their order around it.
#[derive(Clone, Copy, Debug)]
pub struct Outline {
    corners: [DVec3; 8],
    count: usize,
}

impl Outline {
    /// The piece of a triangle with these corners (mm) and texture coordinates in the texel `(x, y)`; a triangle without
    /// area in the map is whole.
    pub fn new(corners_mm: [DVec3; 3], uvs: [Vec2; 3], texel: [u32; 2], resolution: u32) -> Self {
        let mut result = Self { corners: [DVec3::ZERO; 8], count: 0 };
        let codes = uvs.map(super::code);
        let [a, b, c] = cut::in_texels(&codes, resolution);
        let doubled = DVec2::perp_dot(b - a, c - a);
        let on_surface = |p: DVec2| {
            let weights = [(b - p).perp_dot(c - p), (c - p).perp_dot(a - p), (a - p).perp_dot(b - p)];
            corners_mm.iter().zip(weights).map(|(corner, weight)| *corner * (weight / doubled)).sum::<DVec3>()
        };
        let mut push = |corner: DVec3| {
            result.corners[result.count] = corner;
            result.count += 1;
        };
        match cut::piece_in(&codes, resolution, texel) {
            Some(piece) => piece.corners().iter().for_each(|p| push(on_surface(*p))),
            None => corners_mm.into_iter().for_each(push),
        }
        result
    }

    /// The corners, mm.
    pub fn corners(&self) -> &[DVec3] {
        &self.corners[..self.count]
    }

    /// The piece as a fan of triangles.
    pub fn triangles(&self) -> impl Iterator<Item = [DVec3; 3]> {
        let [first, rest @ ..] = &self.corners;
        rest[..self.count.saturating_sub(1)].windows(2).map(move |pair| [*first, pair[0], pair[1]])
    }
}
