//! Environments for the shaders: a sharp one for the background, and ones blurred by the lobes of ever rougher
//! surfaces.

use std::f64::consts::{FRAC_1_PI, PI, TAU};

use glam::DVec3;

use crate::light::environment::{EnvironmentMap, direction_of};
use crate::math::random::radical_inverse_2;
use crate::parallel::*;
use crate::render::blinn_phong;
use crate::render::frame::Specular;
use crate::render::highlight::HighlightShape;

/// Width of the finest blurred level in pixels; its height is half of it.
pub(super) const GLOSSY_WIDTH: usize = 256;
/// Number of levels: the first is sharp, the last has roughness 1.
pub(super) const LEVELS: usize = 6;
/// Widest background in pixels.
pub(super) const MAX_BACKDROP_WIDTH: usize = 2048;
/// Number of directions that are averaged for a blurred pixel.
const DIRECTIONS: u32 = 96;

/// An environment in latitude and longitude: `width` columns and half as many rows.
#[derive(Clone)]
pub(super) struct LatLongImage {
    pub(super) width: usize,
    pub(super) pixels: Vec<DVec3>,
}

impl LatLongImage {
    pub(super) fn height(&self) -> usize {
        (self.width / 2).max(1)
    }

    fn bilinear(&self, direction: DVec3) -> DVec3 {
        let (u, v) = crate::light::environment::position_of(direction);
        let (width, height) = (self.width as f64, self.height() as f64);
        let (x, y) = (u * width - 0.5, (v * height - 0.5).clamp(0.0, height - 1.0));
        let (fx, fy) = (x - x.floor(), y - y.floor());
        let column = |x: f64| x.rem_euclid(width) as usize % self.width;
        let (x0, x1) = (column(x.floor()), column(x.floor() + 1.0));
        let row = |y: f64| {
            let start = (y as usize).min(self.height() - 1) * self.width;
            self.pixels[start + x0] * (1.0 - fx) + self.pixels[start + x1] * fx
        };
        row(y.floor()) * (1.0 - fy) + row(y.floor() + 1.0) * fy
    }

    /// The image at half the size, pixels weighted by their solid angle.
    fn halved(&self) -> Self {
        let (width, height) = (self.width / 2, self.height() / 2);
        let weight = |row: usize| ((row as f64 + 0.5) * PI / self.height() as f64).sin();
        let pixel = |x: usize, y: usize| {
            let row = |r: usize| self.pixels[r * self.width + 2 * x] + self.pixels[r * self.width + 2 * x + 1];
            let (a, b) = (weight(2 * y), weight(2 * y + 1));
            (row(2 * y) * a + row(2 * y + 1) * b) / (2.0 * (a + b))
        };
        Self { width, pixels: (0..width * height).map(|i| pixel(i % width, i / width)).collect() }
    }
}

/// The map at another size: means over the area of a pixel, or interpolated where that is less than a pixel of the map.
pub(super) fn resized(map: &EnvironmentMap, width: usize) -> LatLongImage {
    let height = (width / 2).max(1);
    if map.width() < width || map.height() < height {
        let at = |i: usize| centre_of(i, width, height);
        return LatLongImage {
            width,
            pixels: (0..width * height).into_par_iter().map(|i| map.radiance_bilinear(at(i))).collect(),
        };
    }
    let mut level = LatLongImage { width, pixels: vec![DVec3::ZERO; width * height] };
    level.pixels.par_chunks_mut(width).enumerate().for_each(|(row, pixels)| {
        let mut weights = vec![0.0; width];
        for y in row * map.height() / height..(row + 1) * map.height() / height {
            let angle = map.pixel_solid_angle_sr(y);
            for x in 0..map.width() {
                let column = x * width / map.width();
                pixels[column] += map.pixel(x, y) * angle;
                weights[column] += angle;
            }
        }
        pixels.iter_mut().zip(weights).for_each(|(pixel, weight)| *pixel /= weight);
    });
    level
}

/// Direction of the middle of a pixel.
fn centre_of(index: usize, width: usize, height: usize) -> DVec3 {
    let (x, y) = ((index % width) as f64 + 0.5, (index / width) as f64 + 0.5);
    direction_of(x / width as f64, y / height as f64)
}

/// Place of a reflection among the levels of [`blurred`], from 0 to 1: the roughness, or the one at which a lobe of GGX is
/// as wide near its middle, `alpha^2 = 2 / (n + 2)`.
pub(super) fn level_of(specular: Specular) -> f64 {
    match specular {
        Specular::Off => 1.0,
        Specular::Rough(roughness) => roughness.value(),
        Specular::BlinnPhong(exponent) => (2.0 / (exponent.value() + 2.0)).sqrt().sqrt(),
    }
}

/// The exponent whose place among the levels is that of a roughness.
fn exponent_of(roughness: f64) -> f64 {
    2.0 / roughness.powi(4) - 2.0
}

/// Levels for roughness 0, 0.2, ... 1, each of half the size of the one before: mean radiance over the lobe of this shape
/// about a mirror direction, for a surface seen from above (Karis 2013, "Real shading in Unreal Engine 4").
pub(super) fn blurred(map: &EnvironmentMap, shape: HighlightShape) -> Vec<LatLongImage> {
    let mut sources = vec![resized(map, GLOSSY_WIDTH)];
    while sources.last().is_some_and(|l| l.width > 4) {
        let next = sources.last().map(LatLongImage::halved);
        sources.extend(next);
    }
    (0..LEVELS)
        .map(|level| {
            let width = GLOSSY_WIDTH >> level;
            match level {
                0 => sources[0].clone(),
                _ => blur(&sources, width, level as f64 / (LEVELS - 1) as f64, shape),
            }
        })
        .collect()
}

fn blur(sources: &[LatLongImage], width: usize, roughness: f64, shape: HighlightShape) -> LatLongImage {
    let lobe = lobe(roughness, shape, 4.0 * PI / (GLOSSY_WIDTH * GLOSSY_WIDTH / 2) as f64, sources.len());
    let height = width / 2;
    let pixel = |i: usize| {
        let normal = centre_of(i, width, height);
        let (a, b) = normal.any_orthonormal_pair();
        let (mut sum, mut weights) = (DVec3::ZERO, 0.0);
        for &(direction, source) in &lobe {
            let world = a * direction.x + b * direction.y + normal * direction.z;
            sum += sources[source].bilinear(world) * direction.z;
            weights += direction.z;
        }
        sum / weights
    };
    LatLongImage { width, pixels: (0..width * height).into_par_iter().map(pixel).collect() }
}

/// Directions of the lobe about +Z, each with the source whose pixels are about as large as its share of the lobe.
fn lobe(roughness: f64, shape: HighlightShape, pixel_sr: f64, sources: usize) -> Vec<(DVec3, usize)> {
    let alpha = roughness * roughness;
    let (a2, exponent) = (alpha * alpha, exponent_of(roughness));
    let direction = |i: u32| {
        let xi = (f64::from(i) + 0.5) / f64::from(DIRECTIONS);
        let (sin_phi, cos_phi) = (TAU * radical_inverse_2(i)).sin_cos();
        let cos2 = match shape {
            HighlightShape::Ggx => (1.0 - xi) / (1.0 + (a2 - 1.0) * xi),
            HighlightShape::BlinnPhong => blinn_phong::sampled_cosine(exponent, xi).powi(2),
        };
        let (cos, sin) = (cos2.sqrt(), (1.0 - cos2).max(0.0).sqrt());
        let half = DVec3::new(sin * cos_phi, sin * sin_phi, cos);
        let light = half * (2.0 * cos) - DVec3::Z;
        // Seen from above, D cos_half / (4 cos_difference) is a quarter of D.
        let density = match shape {
            HighlightShape::Ggx => {
                let t = 1.0 + (a2 - 1.0) * cos2;
                0.25 * FRAC_1_PI * a2 / (t * t)
            }
            HighlightShape::BlinnPhong => 0.25 * blinn_phong::distribution(exponent, cos),
        };
        let share_sr = 1.0 / (f64::from(DIRECTIONS) * density);
        let level = (0.5 * (share_sr / pixel_sr).log2() + 0.5).clamp(0.0, (sources - 1) as f64);
        (light, level as usize)
    };
    (0..DIRECTIONS).map(direction).filter(|(light, _)| light.z > 0.0).collect()
}

/// Largest value that [`packed`] holds.
pub(super) const MAX_PACKED: f64 = 65408.0;

/// Three numbers of 9 bits with a common exponent (the texture format Rgb9e5Ufloat).
pub(super) fn packed(colour: DVec3) -> u32 {
    let c = colour.clamp(DVec3::ZERO, DVec3::splat(MAX_PACKED));
    let largest = c.max_element();
    if largest.is_nan() || largest < 1e-9 {
        return 0;
    }
    let mut exponent = (largest.log2().floor() as i32).max(-16) + 16;
    let unit = |exponent: i32| f64::from(exponent - 24).exp2();
    if (largest / unit(exponent)).round() > 511.0 {
        exponent += 1;
    }
    let mantissa = |v: f64| ((v / unit(exponent)).round() as u32).min(511);
    mantissa(c.x) | mantissa(c.y) << 9 | mantissa(c.z) << 18 | (exponent as u32) << 27
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::light::sky::sky;

    const SHAPES: [HighlightShape; 2] = [HighlightShape::Ggx, HighlightShape::BlinnPhong];

    fn unpacked(bits: u32) -> DVec3 {
        let unit = f64::from((bits >> 27) as i32 - 24).exp2();
        DVec3::new(f64::from(bits & 511), f64::from(bits >> 9 & 511), f64::from(bits >> 18 & 511)) * unit
    }

    #[test]
    fn shared_exponents_keep_eight_bits() {
        for i in 0..2000 {
            let v = 1e-3 * 1.01f64.powi(i % 1500);
            let colour = DVec3::new(v, 0.7 * v, 0.02 * v).min(DVec3::splat(6e4));
            let back = unpacked(packed(colour));
            assert!((back - colour).abs().max_element() <= colour.max_element() / 500.0, "{colour} {back}");
        }
        assert_eq!(packed(DVec3::ZERO), 0);
        assert_eq!(unpacked(packed(DVec3::splat(f64::INFINITY))), DVec3::splat(MAX_PACKED));
        assert_eq!(packed(DVec3::splat(f64::NAN)), 0);
    }

    #[test]
    fn blurring_a_constant_changes_nothing_and_energy_survives_resizing() {
        let grey = EnvironmentMap::new(8, 4, vec![[2.0, 1.0, 0.5]; 32]).unwrap();
        for level in SHAPES.into_iter().flat_map(|shape| blurred(&grey, shape)) {
            assert_eq!(level.pixels.len(), level.width * level.width / 2);
            assert!(level.pixels.iter().all(|p| (*p - DVec3::new(2.0, 1.0, 0.5)).length() < 1e-12));
        }
        let map = sky();
        let mean = |level: &LatLongImage| {
            let height = level.pixels.len() / level.width;
            let weight = |i: usize| (((i / level.width) as f64 + 0.5) * PI / height as f64).sin();
            let sum: f64 = (0..level.pixels.len()).map(weight).sum();
            level.pixels.iter().enumerate().map(|(i, p)| *p * weight(i)).sum::<DVec3>() / sum
        };
        let expected = map.energy() / (4.0 * PI);
        assert!(((mean(&resized(&map, 64)) - expected) / expected).abs().max_element() < 0.02);
        for level in SHAPES.into_iter().flat_map(|shape| blurred(&map, shape)) {
            assert!(((mean(&level) - expected) / expected).abs().max_element() < 0.1, "{}", level.width);
        }
    }

    #[test]
    fn levels_hold_the_exponents_that_they_are_looked_up_for() {
        for exponent in [1.0, 20.0, 1e4] {
            let level = level_of(Specular::BlinnPhong(blinn_phong::Exponent::new(exponent).unwrap()));
            assert!((0.0..=1.0).contains(&level) && (exponent_of(level) / exponent - 1.0).abs() < 1e-9, "{exponent}");
        }
    }
}
