//! A rectangle seen from a point, as a cube map: the share that it fills of each texel's solid angle, Haar transformed.
//!
//! Coverage is exact up to the variation of solid angle inside a texel: the rectangle is clipped to each face's pyramid, and the
//! polygon on the face to every texel that its edges cross.

use glam::DVec3;

use super::Light;
use super::cube_light::Transform;
use crate::error::{Error, Result};
use crate::math::cube_map::{FACES, FRAMES, centre};
use crate::math::haar::Haar;

/// A one-sided rectangle around the origin whose half diagonal is 1, in world axes: an area light without its place,
/// size and radiance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UnitRectangle {
    /// Unit vectors along the first edge, along the second, and along the normal of the side that emits.
    axes: [DVec3; 3],
    /// Half lengths of the edges.
    half: [f64; 2],
}

impl UnitRectangle {
    /// The unit rectangle of an area light, and half the light's diagonal in mm.
    ///
    /// # Errors
    /// Another kind of light; edges too long for double precision, or too different (exit 5).
    pub fn of(light: &Light) -> Result<(Self, f64)> {
        let Light::Area { normal, u, size_mm, .. } = light else {
            return Err(Error::unsupported(format!("{} lights are no rectangles", light.kind().name())));
        };
        let half_diagonal_mm = 0.5 * size_mm[0].hypot(size_mm[1]);
        let half = size_mm.map(|s| 0.5 * s / half_diagonal_mm);
        if !half_diagonal_mm.is_normal() || !half.iter().all(|h| h.is_normal()) {
            return Err(Error::unsupported(format!(
                "a light of {} x {} mm has no source radiance field: its edges are too long or too different",
                size_mm[0], size_mm[1]
            )));
        }
        Ok((Self { axes: [*u, normal.cross(*u), *normal], half }, half_diagonal_mm))
    }

    /// Unit vectors along the first and the second edge and along the normal.
    pub fn axes(&self) -> [DVec3; 3] {
        self.axes
    }

    /// Corners one after the other.
    pub fn corners(&self) -> [DVec3; 4] {
        let [u, v, _] = self.axes;
        let [a, b] = self.half;
        [-a * u - b * v, a * u - b * v, a * u + b * v, b * v - a * u]
    }

    /// Solid angle in sr from a point in front; 0 behind. All digits at any distance (Van Oosterom and Strackee 1983, two
    /// triangles: their determinants are those of the edges and the height, which do not cancel).
    pub fn solid_angle(&self, at: DVec3) -> f64 {
        let height = at.dot(self.axes[2]);
        if height <= 0.0 {
            return 0.0;
        }
        let corners = self.corners().map(|c| c - at);
        let determinant = 4.0 * self.half[0] * self.half[1] * height;
        let triangle = |a: DVec3, b: DVec3, c: DVec3| {
            let [la, lb, lc] = [a.length(), b.length(), c.length()];
            2.0 * determinant.atan2(la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb)
        };
        triangle(corners[0], corners[1], corners[2]) + triangle(corners[0], corners[2], corners[3])
    }
}

/// Corners of a polygon at most: four, and one more for each plane that it is clipped by.
const MOST_CORNERS: usize = 16;

/// A convex polygon.
#[derive(Clone, Copy)]
struct Polygon<const D: usize> {
    corners: [[f64; D]; MOST_CORNERS],
    count: usize,
}

impl<const D: usize> Polygon<D> {
    const EMPTY: Self = Self { corners: [[0.0; D]; MOST_CORNERS], count: 0 };

    fn push(&mut self, corner: [f64; D]) {
        if let Some(slot) = self.corners.get_mut(self.count) {
            *slot = corner;
            self.count += 1;
        }
    }

    fn corners(&self) -> &[[f64; D]] {
        &self.corners[..self.count]
    }

    /// Each corner with the next.
    fn edges(&self) -> impl Iterator<Item = ([f64; D], [f64; D])> + '_ {
        let corners = self.corners();
        corners.iter().zip(corners.iter().cycle().skip(1)).map(|(a, b)| (*a, *b))
    }

    /// The part where a linear function is not negative (Sutherland and Hodgman).
    fn clipped(&self, function: impl Fn(&[f64; D]) -> f64) -> Self {
        let mut kept = Self::EMPTY;
        for (a, b) in self.edges() {
            let (at_a, at_b) = (function(&a), function(&b));
            if at_a >= 0.0 {
                kept.push(a);
            }
            if (at_a > 0.0 && at_b < 0.0) || (at_a < 0.0 && at_b > 0.0) {
                let share = at_a / (at_a - at_b);
                kept.push(std::array::from_fn(|i| a[i] + (b[i] - a[i]) * share));
            }
        }
        kept
    }

    fn range(&self, axis: usize) -> (f64, f64) {
        let start = (f64::INFINITY, f64::NEG_INFINITY);
        self.corners().iter().fold(start, |(low, high), c| (low.min(c[axis]), high.max(c[axis])))
    }
}

impl Polygon<2> {
    /// Range of `s` in which the line `t` crosses the polygon; empty (from infinity) where it does not.
    fn across(&self, t: f64) -> (f64, f64) {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        let mut take = |s: f64| (low, high) = (low.min(s), high.max(s));
        for (a, b) in self.edges() {
            if (a[1] <= t && b[1] >= t) || (b[1] <= t && a[1] >= t) {
                let height = b[1] - a[1];
                if height == 0.0 {
                    take(a[0]);
                    take(b[0]);
                } else {
                    take(a[0] + (b[0] - a[0]) * ((t - a[1]) / height));
                }
            }
        }
        (low, high)
    }

    /// Area of the polygon, and the solid angle in sr of a unit of area at its centroid.
    fn measure(&self) -> (f64, f64) {
        let corners = self.corners();
        let Some(first) = corners.first() else { return (0.0, 0.0) };
        let (mut area, mut moment) = (0.0, [0.0; 2]);
        for pair in corners.windows(2) {
            let [a, b] = [pair[0], pair[1]].map(|c| [c[0] - first[0], c[1] - first[1]]);
            let twice = a[0] * b[1] - a[1] * b[0];
            area += twice;
            (0..2).for_each(|i| moment[i] += twice * (a[i] + b[i]));
        }
        if area == 0.0 {
            return (0.0, 0.0);
        }
        let [s, t] = [0, 1].map(|i| first[i] + moment[i] / (3.0 * area));
        (0.5 * area.abs(), density(s, t))
    }
}

/// Solid angle in sr of a unit of area of a face at `(s, t)`.
fn density(s: f64, t: f64) -> f64 {
    let square = 1.0 + s * s + t * t;
    1.0 / (square * square.sqrt())
}

/// Map of a rectangle: the result and the memory of one thread.
pub struct Seen {
    /// Haar coefficients of the coverage times the square root of the texels' solid angles, in the order of
    /// [`crate::math::cube_map`].
    pub coefficients: Vec<f32>,
    /// Faces on which there is anything.
    pub lit: [bool; FACES],
    scratch: Vec<f32>,
}

/// Transform and factors shared by all maps of one side.
pub struct RectangleMaps {
    side: usize,
    haar: Haar,
    factors: Vec<f32>,
}

impl RectangleMaps {
    /// Maps with faces of `side` x `side` texels.
    ///
    /// # Errors
    /// Another side than a power of two (exit 5).
    pub fn new(side: usize) -> Result<Self> {
        let (haar, factors) = Transform::SolidAngle.of_transport(side)?;
        Ok(Self { side, haar, factors })
    }

    /// Texels along an edge of a face.
    pub fn side(&self) -> usize {
        self.side
    }

    /// Memory for [`Self::see`].
    pub fn memory(&self) -> Seen {
        let face = self.side * self.side;
        Seen { coefficients: vec![0.0; FACES * face], lit: [false; FACES], scratch: vec![0.0; face] }
    }

    /// The map of a rectangle seen from a point in front of it, which is not in its plane.
    pub fn see(&self, rectangle: &UnitRectangle, at: DVec3, seen: &mut Seen) {
        self.cover(rectangle, at, seen);
        let Seen { coefficients, lit, scratch } = seen;
        for (picture, _) in coefficients.chunks_exact_mut(self.factors.len()).zip(lit).filter(|(_, lit)| **lit) {
            picture.iter_mut().zip(&self.factors).for_each(|(value, factor)| *value *= factor);
            self.haar.forward(picture, scratch);
        }
    }

    /// Writes the covered share of every texel to `seen.coefficients`.
    fn cover(&self, rectangle: &UnitRectangle, at: DVec3, seen: &mut Seen) {
        let corners = rectangle.corners().map(|c| c - at);
        let pictures = seen.coefficients.chunks_exact_mut(self.factors.len()).zip(&mut seen.lit);
        for ((picture, lit), frame) in pictures.zip(&FRAMES) {
            if *lit {
                picture.fill(0.0);
            }
            *lit = false;
            let mut polygon = Polygon::EMPTY;
            corners.iter().for_each(|c| polygon.push([frame.forward, frame.right, frame.down].map(|a| a.dot(*c))));
            for axis in [1, 2] {
                polygon = polygon.clipped(|c| c[0] - c[axis]).clipped(|c| c[0] + c[axis]);
            }
            if polygon.count < 3 {
                continue;
            }
            let mut flat = Polygon::EMPTY;
            for [forward, right, down] in polygon.corners() {
                // What is clipped lies in front of the face, but for rounding.
                let forward = forward.max(f64::MIN_POSITIVE);
                flat.push([right, down].map(|x| (x / forward).clamp(-1.0, 1.0)));
            }
            *lit = true;
            self.fill(&flat, picture);
        }
    }

    /// Texels between two places on an edge of a face.
    fn texels(&self, (low, high): (f64, f64)) -> std::ops::Range<usize> {
        let cell = |x: f64| (0.5 * (x + 1.0) * self.side as f64).clamp(0.0, self.side as f64);
        cell(low).floor() as usize..cell(high).ceil() as usize
    }

    fn fill(&self, polygon: &Polygon<2>, picture: &mut [f32]) {
        let (side, width) = (self.side, 2.0 / self.side as f64);
        let edge = |texel: usize| texel as f64 * width - 1.0;
        for y in self.texels(polygon.range(1)) {
            let (t0, t1) = (edge(y), edge(y + 1));
            let strip = polygon.clipped(|c| c[1] - t0).clipped(|c| t1 - c[1]);
            // Between these the polygon fills the row, because it is convex.
            let (above, below) = (polygon.across(t0), polygon.across(t1));
            let full = (above.0.max(below.0), above.1.min(below.1));
            for x in self.texels(strip.range(0)) {
                let (s0, s1) = (edge(x), edge(x + 1));
                let Some(value) = picture.get_mut(y * side + x) else { continue };
                if full.0 <= s0 && s1 <= full.1 {
                    *value = 1.0;
                    continue;
                }
                let (area, angle) = strip.clipped(|c| c[0] - s0).clipped(|c| s1 - c[0]).measure();
                let whole = width * width * density(centre(side, x), centre(side, y));
                *value = (area * angle / whole).min(1.0) as f32;
            }
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::math::cube_map::{direction, solid_angles_sr};
    use crate::math::random::uniform;
    use crate::math::spherical_rectangle::SphericalRectangle;

    fn rectangle(index: u64) -> UnitRectangle {
        let n = |d: u64| uniform(41, index, d) - 0.5;
        let (normal, size) = (DVec3::new(n(0), n(1), n(2)), [0.2 + n(3).abs(), 0.1 + 3.0 * n(4).abs()]);
        UnitRectangle::of(&Light::area(DVec3::ZERO, normal, size, DVec3::ONE, None).unwrap()).unwrap().0
    }

    /// A point in front, at `distance`.
    fn front(rectangle: &UnitRectangle, index: u64, distance: f64) -> DVec3 {
        let n = |d: u64| uniform(42, index, d) - 0.5;
        let way = DVec3::new(n(0), n(1), n(2)).normalize();
        let way = if way.dot(rectangle.axes[2]) < 0.0 { -way } else { way };
        distance * (way + 0.02 * rectangle.axes[2])
    }

    #[test]
    fn solid_angles_are_those_of_the_other_formula_and_of_far_points() {
        for i in 0..200 {
            let shape = rectangle(i);
            let at = front(&shape, i, [0.3, 1.0, 3.0, 20.0][i as usize % 4]);
            let [u, v, _] = shape.axes();
            let [corner, ..] = shape.corners();
            let other = SphericalRectangle::new(at, corner, u, v, shape.half.map(|h| 2.0 * h)).solid_angle();
            assert!((shape.solid_angle(at) - other).abs() < 1e-12, "{i}: {} {other}", shape.solid_angle(at));
            assert_eq!(shape.solid_angle(-at), 0.0);
            let far = front(&shape, i, 1e6);
            let area = 4.0 * shape.half[0] * shape.half[1];
            let expected = area * far.dot(shape.axes[2]) / far.length().powi(3);
            assert!((shape.solid_angle(far) / expected - 1.0).abs() < 1e-9);
        }
        assert!(rectangle(1).solid_angle(DVec3::splat(1e200)) >= 0.0);
    }

    #[test]
    fn covered_texels_hold_the_solid_angle() {
        for side in [8, 32, 64] {
            let (maps, angles) = (RectangleMaps::new(side).unwrap(), solid_angles_sr(side));
            let mut seen = maps.memory();
            for i in 0..100 {
                let shape = rectangle(i);
                let at = front(&shape, i, [0.02, 0.5, 1.0, 3.0, 50.0][i as usize % 5]);
                maps.cover(&shape, at, &mut seen);
                let sum: f64 =
                    seen.coefficients.iter().zip(angles.iter().cycle()).map(|(c, a)| f64::from(*c) * a).sum();
                let exact = shape.solid_angle(at);
                let tolerance = if side == 8 { 2e-2 } else { 2e-3 };
                assert!((sum / exact - 1.0).abs() < tolerance, "{side} {i}: {sum} {exact}");
            }
        }
    }

    #[test]
    fn texels_are_covered_where_rays_hit() {
        const FINE: usize = 16;
        let maps = RectangleMaps::new(16).unwrap();
        let mut seen = maps.memory();
        for i in 0..12 {
            let shape = rectangle(i);
            let at = front(&shape, i, [0.6, 2.0, 5.0][i as usize % 3]);
            maps.cover(&shape, at, &mut seen);
            let [u, v, n] = shape.axes();
            for (texel, share) in seen.coefficients.iter().enumerate() {
                let (face, y, x) = (texel / 256, texel / 16 % 16, texel % 16);
                let hits = (0..FINE * FINE).filter(|k| {
                    let d = direction(16 * FINE, face, x * FINE + k % FINE, y * FINE + k / FINE);
                    let hit = at - d * (at.dot(n) / d.dot(n));
                    d.dot(n) < 0.0 && hit.dot(u).abs() <= shape.half[0] && hit.dot(v).abs() <= shape.half[1]
                });
                let counted = hits.count() as f64 / (FINE * FINE) as f64;
                assert!((f64::from(*share) - counted).abs() < 0.08, "{i}, texel {texel}: {share} {counted}");
            }
        }
    }

    #[test]
    fn coefficients_keep_products_and_memory_is_cleared() {
        let maps = RectangleMaps::new(32).unwrap();
        let (mut seen, mut fresh) = (maps.memory(), maps.memory());
        let angles = solid_angles_sr(32);
        for i in 0..8 {
            let (shape, near) = (rectangle(i), rectangle(i + 100));
            maps.see(&near, front(&near, i, 0.1), &mut seen);
            let at = front(&shape, i, 1.7);
            maps.see(&shape, at, &mut seen);
            maps.see(&shape, at, &mut fresh);
            assert!(seen.coefficients == fresh.coefficients && seen.lit == fresh.lit);
            // The sum over the sphere is that of the first coefficients.
            let constant: f64 = seen.coefficients.chunks_exact(1024).map(|face| f64::from(face[0])).sum();
            let sum = constant * (angles.iter().sum::<f64>()).sqrt();
            assert!((sum / shape.solid_angle(at) - 1.0).abs() < 2e-3);
            fresh = maps.memory();
        }
        assert!(RectangleMaps::new(12).is_err());
    }

    #[test]
    fn lights_without_a_shape_are_refused() {
        assert!(UnitRectangle::of(&Light::constant(DVec3::ONE).unwrap()).is_err());
        for size in [[1.7e308, 1.7e308], [1e-320, 1e-320], [1e-300, 1e300]] {
            let light = Light::area(DVec3::ZERO, DVec3::Y, size, DVec3::ONE, None).unwrap();
            assert!(UnitRectangle::of(&light).is_err(), "{size:?}");
        }
    }
}
