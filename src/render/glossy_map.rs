//! An environment blurred to any width, for glossy reflections: a cube map and its halvings.
//!
//! A sampled reflection represents a solid angle of about `1 / (samples * density)`; the mean over that solid angle
//! instead of one direction removes the noise (Krivanek and Colbert 2008, "Real-time shading with filtered importance
//! sampling").

use std::f64::consts::{PI, TAU};

use glam::{DVec3, Vec4};

use crate::light::environment::EnvironmentMap;
use crate::math::cube_map::{FACES, FRAMES, centre, position_of, texel_of};
use crate::parallel::*;

/// Largest number of texels along an edge of a face, a third of a degree each.
const MAX_SIDE: usize = 256;
/// Least number of pieces of a pixel per width of a texel.
const PIECES_PER_TEXEL: usize = 3;
/// Number of bands of rows that are summed separately, so that sums do not depend on the number of threads.
const BANDS: usize = 4;
/// Halvings by which look-ups are blurred beyond the spacing of the samples, so that their footprints overlap. The
/// authors take 1; interpolation between texels blurs as well, and half of that moves highlights half as far to texel
/// centres.
const OVERLAP: f32 = 0.5;

/// A cube map at one resolution: faces of `(side + 2)^2` texels, the outer ones copied from the neighbouring faces, so
/// that interpolation crosses the edges of the cube.
struct PaddedCubeMap {
    side: usize,
    texels: Vec<Vec4>,
}

/// A pyramid of cube maps in the map's own orientation.
pub(super) struct GlossyMap {
    /// Cube maps, the finest first; the last has one texel per face.
    levels: Vec<PaddedCubeMap>,
}

impl GlossyMap {
    pub(super) fn new(map: &EnvironmentMap) -> Self {
        let side = (map.width() / 4).next_power_of_two().clamp(1, MAX_SIDE);
        let mut faces = means(map, side);
        let mut levels = vec![PaddedCubeMap::new(side, &faces)];
        let mut side = side;
        while side > 1 {
            faces = halved(side, &faces);
            side /= 2;
            levels.push(PaddedCubeMap::new(side, &faces));
        }
        Self { levels }
    }

    /// Mean radiance around a unit direction over about `solid_angle_sr`.
    #[inline]
    pub(super) fn radiance(&self, direction: DVec3, solid_angle_sr: f64) -> DVec3 {
        let (face, s, t) = position_of(direction);
        let side = self.levels[0].side as f64;
        let stretch = 1.0 + s * s + t * t;
        let texel_sr = 4.0 / (side * side * stretch * stretch.sqrt());
        let last = self.levels.len() - 1;
        let level = (0.5 * rough_log2((solid_angle_sr / texel_sr) as f32) + OVERLAP).clamp(0.0, last as f32);
        let (lower, fraction) = (level as usize, level.fract());
        let mut value = self.levels[lower].bilinear(face, s as f32, t as f32);
        if fraction > 0.0 {
            let next = self.levels[(lower + 1).min(last)].bilinear(face, s as f32, t as f32);
            value += (next - value) * fraction;
        }
        value.truncate().as_dvec3()
    }
}

/// The logarithm to within 0.09, continuous and increasing, for the choice of a blur only.
#[inline]
fn rough_log2(x: f32) -> f32 {
    let x = x.clamp(f32::MIN_POSITIVE, f32::MAX);
    (x.to_bits() as f32) * (1.0 / 8_388_608.0) - 127.0
}

impl PaddedCubeMap {
    fn new(side: usize, faces: &[Vec4]) -> Self {
        let padded = side + 2;
        let mut texels = vec![Vec4::ZERO; FACES * padded * padded];
        for (face, frame) in FRAMES.iter().enumerate() {
            for y in 0..padded {
                for x in 0..padded {
                    let inside = (1..=side).contains(&x) && (1..=side).contains(&y);
                    let from = if inside {
                        (face * side + y - 1) * side + x - 1
                    } else {
                        let beyond = |i: usize| centre(side, i) - 2.0 / side as f64;
                        texel_of(side, frame.direction(beyond(x), beyond(y)))
                    };
                    texels[(face * padded + y) * padded + x] = faces[from];
                }
            }
            // Beyond a corner of the cube there is no texel: the three that meet there share one value.
            for (y, inner_y) in [(0, 1), (side + 1, side)] {
                for (x, inner_x) in [(0, 1), (side + 1, side)] {
                    let at = |x: usize, y: usize| (face * padded + y) * padded + x;
                    let sum = texels[at(inner_x, inner_y)] + texels[at(x, inner_y)] + texels[at(inner_x, y)];
                    texels[at(x, y)] = sum / 3.0;
                }
            }
        }
        Self { side, texels }
    }

    #[inline]
    fn bilinear(&self, face: usize, s: f32, t: f32) -> Vec4 {
        let half = 0.5 * self.side as f32;
        // The first padding texel has its centre at 0.
        let place = |u: f32| ((u + 1.0) * half + 0.5).clamp(0.0, self.side as f32 + 0.999);
        let (x, y) = (place(s), place(t));
        let (x0, y0) = ((x as usize).min(self.side), (y as usize).min(self.side));
        let (fx, fy) = (x - x0 as f32, y - y0 as f32);
        let padded = self.side + 2;
        let at = (face * padded + y0) * padded + x0;
        let row = |at: usize| self.texels[at] + (self.texels[at + 1] - self.texels[at]) * fx;
        let (top, bottom) = (row(at), row(at + padded));
        top + (bottom - top) * fy
    }
}

/// Mean radiance of the texels: every pixel is cut in pieces, and each piece goes to the texel it falls on.
fn means(map: &EnvironmentMap, side: usize) -> Vec<Vec4> {
    let (width, height) = (map.width(), map.height());
    let across = (4 * side * PIECES_PER_TEXEL).div_ceil(width);
    let down = (2 * side * PIECES_PER_TEXEL).div_ceil(height);
    let turns: Vec<(f64, f64)> =
        (0..width * across).map(|i| (TAU * (0.5 - (i as f64 + 0.5) / (width * across) as f64)).sin_cos()).collect();
    let band = |index: usize| {
        let mut sums = vec![Vec4::ZERO; FACES * side * side];
        for row in index * height / BANDS * down..(index + 1) * height / BANDS * down {
            let (sin, cos) = (PI * (row as f64 + 0.5) / (height * down) as f64).sin_cos();
            let pixels = &map.pixels()[row / down * width..][..width];
            for (&[r, g, b], pieces) in pixels.iter().zip(turns.chunks_exact(across)) {
                // The fourth number counts, so that a texel's mean is one of whole pieces.
                let energy = Vec4::new(r, g, b, 1.0) * sin as f32;
                for &(sin_longitude, cos_longitude) in pieces {
                    sums[texel_of(side, DVec3::new(sin * sin_longitude, cos, sin * cos_longitude))] += energy;
                }
            }
        }
        sums
    };
    let bands: Vec<Vec<Vec4>> = (0..BANDS).into_par_iter().map(band).collect();
    let mean = |texel: usize| {
        let sum = bands.iter().fold(Vec4::ZERO, |sum, band| sum + band[texel]);
        if sum.w > 0.0 {
            return sum / sum.w;
        }
        let (face, x, y) = (texel / (side * side), texel % side, texel / side % side);
        let direction = FRAMES[face].direction(centre(side, x), centre(side, y));
        map.radiance(direction).as_vec3().extend(1.0)
    };
    (0..FACES * side * side).map(mean).map(|v| v.min(Vec4::splat(f32::MAX))).collect()
}

/// Means over two by two texels, by their solid angles.
fn halved(side: usize, faces: &[Vec4]) -> Vec<Vec4> {
    let half = side / 2;
    let weight = |x: usize, y: usize| {
        let (s, t) = (centre(side, x), centre(side, y));
        let stretch = 1.0 + s * s + t * t;
        (1.0 / (stretch * stretch.sqrt())) as f32
    };
    let mean = |texel: usize| {
        let (face, x, y) = (texel / (half * half), 2 * (texel % half), 2 * (texel / half % half));
        let (mut sum, mut total) = (Vec4::ZERO, 0.0);
        for (x, y) in [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)] {
            let w = weight(x, y);
            sum += faces[(face * side + y) * side + x] * w;
            total += w;
        }
        sum / total
    };
    (0..FACES * half * half).map(mean).collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::light::sky::sky;
    use crate::math::random::uniform;
    use crate::math::sphere::random_direction;

    fn directions(count: u64) -> impl Iterator<Item = DVec3> {
        (0..count).map(|i| random_direction(1, i))
    }

    #[test]
    fn a_constant_map_is_constant_at_every_blur() {
        for (width, height) in [(1, 1), (3, 2), (64, 32), (2048, 1024)] {
            let map = EnvironmentMap::new(width, height, vec![[0.25, 1.0, 4.0]; width * height]).unwrap();
            let glossy = GlossyMap::new(&map);
            for (i, direction) in directions(500).enumerate() {
                let value = glossy.radiance(direction, 1e-7 * 4f64.powi(i as i32 % 16));
                assert!((value / DVec3::new(0.25, 1.0, 4.0) - 1.0).abs().max_element() < 1e-5, "{width}: {value}");
            }
        }
    }

    #[test]
    fn sharp_look_ups_are_the_map_and_wide_ones_its_mean() {
        let map = sky();
        let glossy = GlossyMap::new(&map);
        let (mut difference, mut scale) = (0.0, 0.0);
        for direction in directions(3000) {
            // So small that even the overlap leaves the finest level.
            let value = glossy.radiance(direction, 1e-9);
            difference += (value - map.radiance_bilinear(direction)).length();
            scale += map.radiance_bilinear(direction).length();
        }
        assert!(difference / scale < 0.03, "{}", difference / scale);
        let mean: DVec3 = directions(2000).map(|d| glossy.radiance(d, 4.0 * PI)).sum::<DVec3>() / 2000.0;
        let exact = map.energy() / (4.0 * PI);
        assert!((mean / exact - 1.0).abs().max_element() < 0.1, "{mean} {exact}");
    }

    #[test]
    fn nothing_jumps_at_the_edges_of_the_cube() {
        let map = sky();
        let glossy = GlossyMap::new(&map);
        for solid_angle in [1e-4, 1e-2, 0.1, 1.0] {
            for i in 0..200 {
                let v = uniform(5, i, 0) - 0.5;
                let (a, b) = (DVec3::new(1.0, v, 1.0 - 1e-7), DVec3::new(1.0 - 1e-7, v, 1.0));
                let (a, b) = (glossy.radiance(a.normalize(), solid_angle), glossy.radiance(b.normalize(), solid_angle));
                assert!((a - b).length() < 0.06 * (a + b).length(), "{solid_angle} {v}: {a} {b}");
            }
        }
    }

    #[test]
    fn odd_directions_and_angles_stay_finite() {
        let glossy = GlossyMap::new(&sky());
        for direction in [DVec3::X, DVec3::NEG_Y, DVec3::ONE.normalize(), DVec3::new(-1.0, -1.0, 1.0).normalize()] {
            for solid_angle in [0.0, 1e-300, 1e300, f64::INFINITY] {
                assert!(glossy.radiance(direction, solid_angle).is_finite());
            }
        }
    }
}
