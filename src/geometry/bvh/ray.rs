//! Rays, and the data that a traversal derives from one.

use glam::{DVec3, Vec3};

use super::build::Tree;

/// A ray with an open range of distances.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Start, in mm.
    pub origin: Vec3,
    /// Direction, of unit length (any other length scales the distances).
    pub direction: Vec3,
    /// Hits at this distance or nearer do not count.
    pub t_min: f32,
    /// Hits at this distance or farther do not count; infinity is fine.
    pub t_max: f32,
}

impl Ray {
    /// A ray from `origin` without end.
    pub fn new(origin: Vec3, direction: Vec3) -> Self {
        Self { origin, direction, t_min: 0.0, t_max: f32::INFINITY }
    }
}

/// Half the distance from 1 to the next larger `f32`: the largest relative error of one rounding.
const ROUNDING: f32 = 1.0 / 16_777_216.0;

/// Moves a surface point along the geometric normal, out of reach of the rounding of its own coordinates, so that a
/// ray from there does not meet the surface it leaves.
///
/// The step is 2^-19 of the largest coordinate (16 units in its last place or more), and rounding never takes any of
/// it back. A normal of zero length moves nothing.
pub fn offset_origin(point: Vec3, geometric_normal: Vec3) -> Vec3 {
    offset_along(point, geometric_normal.as_dvec3().normalize_or_zero())
}

/// [`offset_origin`] with a unit normal.
pub fn offset_along(point: Vec3, unit: DVec3) -> Vec3 {
    let distance = f64::from(32.0 * ROUNDING) * point.as_dvec3().abs().max_element();
    let moved = point.as_dvec3() + unit * distance;
    round_along(moved, unit)
}

/// Rounds to 32 bits without giving back any of a move along `direction`.
fn round_along(point: DVec3, direction: DVec3) -> Vec3 {
    // Farther by what rounding to the nearest takes back at most, on either side of a power of two. Which way it rounds cannot be
    // foreseen: a branch would cost more.
    const BACK: f64 = 1.001 * ROUNDING as f64;
    let away = |x: f64, d: f64| {
        let sign = f64::from(u8::from(d > 0.0)) - f64::from(u8::from(d < 0.0));
        (x + sign * BACK * x.abs()) as f32
    };
    Vec3::new(away(point.x, direction.x), away(point.y, direction.y), away(point.z, direction.z))
}

/// A ray made ready for boxes and triangles.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Query {
    /// Origin of the shear; moved along the ray to the scene where the ray starts far away from it.
    pub origin: [f32; 3],
    /// Axes in the order (x, y, z) of the shear; the direction is largest along the last.
    pub axes: [usize; 3],
    /// Shear in x and in y.
    pub shear: [f32; 2],
    /// Direction along the last axis.
    pub direction_z: f64,
    /// Reciprocal of the direction, its components held away from zero.
    pub inverse: [f32; 3],
    /// The origin moved forth by the growth of boxes, for the planes where the ray enters.
    pub near_origin: [f32; 3],
    /// The origin moved back by it, for the planes where the ray leaves.
    pub far_origin: [f32; 3],
    /// `inverse` times `near_origin`.
    pub near_offset: [f32; 3],
    /// `inverse` times `far_origin`.
    pub far_offset: [f32; 3],
    /// For each axis, true if the direction points down it.
    pub negative: [bool; 3],
    /// Range for boxes, from `origin`.
    pub box_range: [f32; 2],
    /// Range for hits, from the ray's own origin, ends excluded.
    pub range: [f64; 2],
    /// Distance from the ray's own origin to `origin`.
    pub start: f64,
}

impl Query {
    /// None where the ray can meet nothing: values that are not finite, no direction, no range, no triangles.
    #[inline]
    pub(super) fn new(ray: &Ray, tree: &Tree) -> Option<Self> {
        let length = ray.direction.abs().max_element();
        let valid = ray.direction.is_finite() && ray.origin.is_finite() && length > 0.0 && ray.t_min < ray.t_max;
        if !valid || tree.nodes.is_empty() {
            return None;
        }
        let range = [f64::from(ray.t_min), f64::from(ray.t_max)];
        let away = (tree.low - ray.origin).max(ray.origin - tree.high).max_element();
        if away > 4.0 * tree.extent {
            // Rounding errors grow with the distance to the vertices, so a far ray starts over beside the scene. It
            // gains on any axis by at most `length` for each unit of t, hence cannot be inside the scene before.
            let start = f64::from(away - tree.extent) / f64::from(length);
            let moved = (ray.origin.as_dvec3() + start * ray.direction.as_dvec3()).as_vec3();
            if moved.is_finite() {
                return Some(Self::from_origin(ray, moved, length, start, range, tree));
            }
        }
        Some(Self::from_origin(ray, ray.origin, length, 0.0, range, tree))
    }

    #[inline]
    fn from_origin(ray: &Ray, origin: Vec3, length: f32, start: f64, range: [f64; 2], tree: &Tree) -> Self {
        let d = ray.direction.to_array();
        let o = origin.to_array();
        let z = ray.direction.abs().max_position();
        let axes = [[1, 2, 0], [2, 0, 1], [0, 1, 2]][z];
        let grow = 32.0 * ROUNDING * tree.magnitude.max(origin.abs().max_element());
        // 2^-30 of the largest component moves the ray by far less than the boxes grow, and keeps infinities out.
        let least = length * 9.313_226e-10;
        let mut query = Self {
            origin: o,
            axes,
            direction_z: f64::from(d[z]),
            box_range: [(range[0] - start) as f32, (range[1] - start) as f32],
            range,
            start,
            ..Self::default()
        };
        for axis in 0..3 {
            let inverse = 1.0 / d[axis].abs().max(least).copysign(d[axis]);
            let grow = grow.copysign(inverse);
            query.inverse[axis] = inverse;
            query.near_origin[axis] = o[axis] + grow;
            query.far_origin[axis] = o[axis] - grow;
            query.near_offset[axis] = query.near_origin[axis] * inverse;
            query.far_offset[axis] = query.far_origin[axis] * inverse;
            query.negative[axis] = inverse < 0.0;
        }
        query.shear = [d[axes[0]] * query.inverse[z], d[axes[1]] * query.inverse[z]];
        query
    }

    /// For each axis, the planes where the ray enters and where it leaves a box, as in `Node::planes`.
    #[inline(always)]
    pub(super) fn planes(&self) -> ([usize; 3], [usize; 3]) {
        let [x, y, z] = self.negative.map(|negative| 3 * usize::from(negative));
        ([x, 1 + y, 2 + z], [3 - x, 4 - y, 5 - z])
    }
}
