//! Equirectangular environment maps: pixels, directions, solid angles, look-ups.
//!
//! The convention is that of OpenEXR's latitude-longitude maps: +Y is up, row 0 touches +Y, the centre looks along +Z,
//! the left quarter (u = 1/4) along +X. With u, v in [0, 1] from the upper left corner,
//! latitude = pi (1/2 - v), longitude = 2 pi (1/2 - u), direction = (sin lon cos lat, sin lat, cos lon cos lat).

use std::f64::consts::{PI, TAU};
use std::fmt;

use glam::DVec3;

use crate::error::{Error, Result};

/// Negative energy above this share of the positive energy is refused, below it is cut off.
pub const MAX_NEGATIVE_SHARE: f64 = 0.05;

/// An equirectangular picture of the light from far away: finite, not negative, linear sRGB radiance.
#[derive(Clone, Debug, PartialEq)]
pub struct EnvironmentMap {
    width: usize,
    height: usize,
    pixels: Vec<[f32; 3]>,
}

/// Negative values that were set to 0 when a map was made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClampedNegatives {
    /// Number of pixels with a negative channel.
    pub pixels: usize,
    /// The most negative value.
    pub lowest: f32,
    /// Their energy (sum over channels) over the energy of everything positive.
    pub share_of_energy: f64,
}

impl fmt::Display for ClampedNegatives {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} pixels have negative values (lowest {}, {:.2e} of the energy); they were set to 0",
            self.pixels, self.lowest, self.share_of_energy
        )
    }
}

impl EnvironmentMap {
    /// A map of `width` x `height` pixels, row by row from the top.
    ///
    /// # Errors
    /// An empty picture, a wrong number of pixels, a value that is negative or not finite (exit 3).
    pub fn new(width: usize, height: usize, pixels: Vec<[f32; 3]>) -> Result<Self> {
        let map = Self::finite(width, height, pixels)?;
        match map.pixels.iter().position(|p| p.iter().any(|c| *c < 0.0)) {
            Some(index) => Err(Error::input(format!("{} is negative", map.place(index)))),
            None => Ok(map),
        }
    }

    /// As [`EnvironmentMap::new`], but sets small negative values (filters and colour conversions leave them) to 0 and
    /// says so.
    ///
    /// # Errors
    /// Those of `new`; negative energy above [`MAX_NEGATIVE_SHARE`] of the positive energy (exit 3).
    pub fn with_negatives_clamped(
        width: usize,
        height: usize,
        pixels: Vec<[f32; 3]>,
    ) -> Result<(Self, Option<ClampedNegatives>)> {
        let mut map = Self::finite(width, height, pixels)?;
        let (mut positive, mut negative) = (0.0, 0.0);
        let mut found = ClampedNegatives { pixels: 0, lowest: 0.0, share_of_energy: 0.0 };
        for row in 0..height {
            let solid_angle = map.pixel_solid_angle_sr(row);
            for pixel in &mut map.pixels[row * width..(row + 1) * width] {
                found.pixels += usize::from(pixel.iter().any(|c| *c < 0.0));
                for channel in pixel {
                    let energy = f64::from(*channel) * solid_angle;
                    if *channel < 0.0 {
                        negative -= energy;
                        found.lowest = found.lowest.min(*channel);
                    } else {
                        positive += energy;
                    }
                    // max with a positive zero also turns -0 into 0.
                    *channel = if *channel > 0.0 { *channel } else { 0.0 };
                }
            }
        }
        if found.pixels == 0 {
            return Ok((map, None));
        }
        if negative > MAX_NEGATIVE_SHARE * positive {
            return Err(Error::input(format!(
                "the environment has {} pixels with negative values (lowest {}), too much to cut off; \
                 export it as linear radiance without negative values",
                found.pixels, found.lowest
            )));
        }
        found.share_of_energy = if positive > 0.0 { negative / positive } else { 0.0 };
        Ok((map, Some(found)))
    }

    /// A map whose pixels the caller computed as finite and not negative.
    pub(super) fn from_valid(width: usize, height: usize, pixels: Vec<[f32; 3]>) -> Self {
        debug_assert_eq!(pixels.len(), width * height);
        Self { width, height, pixels }
    }

    fn finite(width: usize, height: usize, pixels: Vec<[f32; 3]>) -> Result<Self> {
        if width == 0 || height == 0 {
            return Err(Error::input(format!("the environment has {width} x {height} pixels; it needs one at least")));
        }
        if width.checked_mul(height) != Some(pixels.len()) {
            return Err(Error::input(format!(
                "the environment has {} pixels where {width} x {height} need {} of them",
                pixels.len(),
                width.saturating_mul(height)
            )));
        }
        let map = Self { width, height, pixels };
        match map.pixels.iter().position(|p| p.iter().any(|c| !c.is_finite())) {
            Some(index) => {
                Err(Error::input(format!("{} is not finite; repair the picture or export it again", map.place(index))))
            }
            None => Ok(map),
        }
    }

    fn place(&self, index: usize) -> String {
        let [r, g, b] = self.pixels[index];
        format!("environment pixel ({}, {}) = ({r}, {g}, {b})", index % self.width, index / self.width)
    }

    /// Pixels in a row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Radiance, row by row from the top, `width * height` pixels.
    pub fn pixels(&self) -> &[[f32; 3]] {
        &self.pixels
    }

    /// Radiance of the pixel in column `x` and row `y`; the last one where too large.
    pub fn pixel(&self, x: usize, y: usize) -> DVec3 {
        let [r, g, b] = self.pixels[y.min(self.height - 1) * self.width + x.min(self.width - 1)];
        DVec3::new(f64::from(r), f64::from(g), f64::from(b))
    }

    /// Exact solid angle in sr of any pixel of `row`: 2 pi / width (cos t0 - cos t1).
    pub fn pixel_solid_angle_sr(&self, row: usize) -> f64 {
        let step = PI / self.height as f64;
        let middle = (row as f64 + 0.5) * step;
        // The product form of cos a - cos b keeps its digits near the poles.
        TAU / self.width as f64 * 2.0 * middle.sin() * (0.5 * step).sin()
    }

    /// Direction of the centre of the pixel in column `x` and row `y`.
    pub fn pixel_direction(&self, x: usize, y: usize) -> DVec3 {
        direction_of((x as f64 + 0.5) / self.width as f64, (y as f64 + 0.5) / self.height as f64)
    }

    /// Radiance that arrives from `direction` (any length but zero), constant over each pixel.
    pub fn radiance(&self, direction: DVec3) -> DVec3 {
        let (u, v) = position_of(direction);
        self.pixel((u * self.width as f64) as usize, (v * self.height as f64) as usize)
    }

    /// Radiance that arrives from `direction`, interpolated between pixel centres; wraps around, ends at the poles.
    pub fn radiance_bilinear(&self, direction: DVec3) -> DVec3 {
        let (u, v) = position_of(direction);
        let x = u * self.width as f64 - 0.5;
        let y = (v * self.height as f64 - 0.5).clamp(0.0, (self.height - 1) as f64);
        let (x_floor, y_floor) = (x.floor(), y.floor());
        let (fx, fy) = (x - x_floor, y - y_floor);
        let x0 = if x_floor < 0.0 { self.width - 1 } else { (x_floor as usize).min(self.width - 1) };
        let x1 = (x0 + 1) % self.width;
        let y0 = y_floor as usize;
        let row = |y: usize| self.pixel(x0, y) * (1.0 - fx) + self.pixel(x1, y) * fx;
        row(y0) * (1.0 - fy) + row(y0 + 1) * fy
    }

    /// Integral of the radiance over the sphere, RGB.
    pub fn energy(&self) -> DVec3 {
        (0..self.height)
            .map(|row| (0..self.width).map(|x| self.pixel(x, row)).sum::<DVec3>() * self.pixel_solid_angle_sr(row))
            .sum()
    }
}

/// Unit direction of the position (u, v) in [0, 1]^2, from the upper left corner.
pub fn direction_of(u: f64, v: f64) -> DVec3 {
    let (sin_polar, cos_polar) = (PI * v).sin_cos();
    let (sin_longitude, cos_longitude) = (TAU * (0.5 - u)).sin_cos();
    DVec3::new(sin_longitude * sin_polar, cos_polar, cos_longitude * sin_polar)
}

/// Position (u, v) of `direction`, u in [0, 1), v in [0, 1]; the inverse of [`direction_of`].
pub fn position_of(direction: DVec3) -> (f64, f64) {
    let polar = direction.x.hypot(direction.z).atan2(direction.y);
    let u = 0.5 - direction.x.atan2(direction.z) / TAU;
    (if u < 1.0 { u.max(0.0) } else { 0.0 }, polar / PI)
}

/// A turn about +Y, counter-clockwise seen from above: 90 degrees move +Z to +X.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rotation {
    sin: f64,
    cos: f64,
}

impl Rotation {
    /// A turn by `degrees`; multiples of 90 are exact.
    pub fn from_degrees(degrees: f64) -> Self {
        let turned = degrees.rem_euclid(360.0);
        let quarter = (turned / 90.0).floor();
        let (sin, cos) = (turned - 90.0 * quarter).to_radians().sin_cos();
        match quarter as u8 {
            0 => Self { sin, cos },
            1 => Self { sin: cos, cos: -sin },
            2 => Self { sin: -sin, cos: -cos },
            3 => Self { sin: -cos, cos: sin },
            // rem_euclid of a tiny negative angle rounds to 360.
            _ => Self { sin: 0.0, cos: 1.0 },
        }
    }

    /// Turns a direction from the map's frame to the world.
    pub fn to_world(self, direction: DVec3) -> DVec3 {
        let DVec3 { x, y, z } = direction;
        DVec3::new(self.cos * x + self.sin * z, y, self.cos * z - self.sin * x)
    }

    /// Turns a direction from the world to the map's frame.
    pub fn to_map(self, direction: DVec3) -> DVec3 {
        let DVec3 { x, y, z } = direction;
        DVec3::new(self.cos * x - self.sin * z, y, self.cos * z + self.sin * x)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random;

    fn random_map(width: usize, height: usize) -> EnvironmentMap {
        let pixels = (0..width * height)
            .map(|i| std::array::from_fn(|c| random::uniform(11, i as u64, c as u64) as f32 * 3.0))
            .collect();
        EnvironmentMap::new(width, height, pixels).expect("valid")
    }

    #[test]
    fn solid_angles_sum_to_the_sphere() {
        for (width, height) in [(1, 1), (2, 1), (7, 3), (64, 32), (256, 2048)] {
            let map = EnvironmentMap::new(width, height, vec![[1.0; 3]; width * height]).expect("valid");
            let sum: f64 = (0..height).map(|row| map.pixel_solid_angle_sr(row) * width as f64).sum();
            assert!((sum / (4.0 * PI) - 1.0).abs() < 1e-13, "{width}x{height}: {sum}");
            assert!((map.energy() / (4.0 * PI) - 1.0).abs().max_element() < 1e-12);
        }
    }

    #[test]
    fn orientation_follows_the_table() {
        let table = [
            ((0.5, 0.5), DVec3::Z),
            ((0.25, 0.5), DVec3::X),
            ((0.75, 0.5), DVec3::NEG_X),
            ((0.0, 0.5), DVec3::NEG_Z),
            ((1.0, 0.5), DVec3::NEG_Z),
            ((0.3, 0.0), DVec3::Y),
            ((0.3, 1.0), DVec3::NEG_Y),
            ((0.5, 0.25), DVec3::new(0.0, 0.5_f64.sqrt(), 0.5_f64.sqrt())),
        ];
        for ((u, v), direction) in table {
            assert!((direction_of(u, v) - direction).length() < 1e-15, "({u}, {v})");
        }
    }

    #[test]
    fn positions_and_directions_are_inverse() {
        for i in 0..10_000 {
            let (u, v) = (random::uniform(1, i, 0), 0.001 + 0.998 * random::uniform(1, i, 1));
            let (u2, v2) = position_of(direction_of(u, v) * 3.0);
            assert!((u - u2).abs() < 1e-12 && (v - v2).abs() < 1e-12, "({u}, {v}) -> ({u2}, {v2})");
        }
    }

    #[test]
    fn ninety_degrees_move_the_centre_to_x() {
        let quarter = Rotation::from_degrees(90.0);
        assert_eq!(quarter.to_world(DVec3::Z), DVec3::X);
        assert_eq!(quarter.to_world(DVec3::X), DVec3::NEG_Z);
        assert_eq!(quarter.to_map(DVec3::X), DVec3::Z);
        assert_eq!(Rotation::from_degrees(-270.0), quarter);
        assert_eq!(Rotation::from_degrees(360.0 + 90.0), quarter);
        assert_eq!(Rotation::from_degrees(-1e-30).to_world(DVec3::X), DVec3::X);
        for degrees in [-1234.5, 0.0, 17.0, 179.9, 301.0] {
            let turn = Rotation::from_degrees(degrees);
            let (sin, cos) = degrees.to_radians().sin_cos();
            assert!((turn.to_world(DVec3::Z) - DVec3::new(sin, 0.0, cos)).length() < 1e-12);
            let d = DVec3::new(0.3, -0.5, 0.7);
            assert!((turn.to_map(turn.to_world(d)) - d).length() < 1e-15);
        }
    }

    #[test]
    fn every_pixel_is_found_at_its_centre() {
        let map = random_map(13, 7);
        for y in 0..7 {
            for x in 0..13 {
                let direction = map.pixel_direction(x, y);
                assert_eq!(map.radiance(direction), map.pixel(x, y));
                assert!((map.radiance_bilinear(direction) - map.pixel(x, y)).length() < 1e-12);
            }
        }
    }

    #[test]
    fn bilinear_wraps_around_and_averages_between_neighbours() {
        let map = random_map(8, 4);
        let seam = map.radiance_bilinear(direction_of(0.0, 1.5 / 4.0));
        assert!((seam - 0.5 * (map.pixel(7, 1) + map.pixel(0, 1))).length() < 1e-12);
        let pole = map.radiance_bilinear(direction_of(0.5 / 8.0, 0.0));
        assert!(pole.is_finite());
        let one = random_map(1, 1);
        assert_eq!(one.radiance_bilinear(DVec3::new(0.1, 0.2, -0.3)), one.pixel(0, 0));
    }

    #[test]
    fn look_ups_never_panic() {
        let map = random_map(5, 3);
        for d in [DVec3::ZERO, DVec3::NAN, DVec3::INFINITY, DVec3::NEG_Z, DVec3::new(-0.0, 0.0, -1.0), DVec3::NEG_Y] {
            let _ = map.radiance(d);
            let _ = map.radiance_bilinear(d);
        }
    }

    #[test]
    fn bad_pixels_are_refused_or_clamped() {
        let with = |value: f32| {
            let mut pixels = vec![[1.0_f32; 3]; 32];
            pixels[9][1] = value;
            pixels
        };
        for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let error = EnvironmentMap::with_negatives_clamped(8, 4, with(value)).expect_err("not finite");
            assert!(error.message().contains("(1, 1)"), "{error}");
        }
        assert!(EnvironmentMap::new(8, 4, with(-0.1)).is_err());
        let (map, found) = EnvironmentMap::with_negatives_clamped(8, 4, with(-0.1)).expect("small");
        assert_eq!(map.pixels()[9], [1.0, 0.0, 1.0]);
        let found = found.expect("reported");
        assert_eq!((found.pixels, found.lowest), (1, -0.1));
        assert!(EnvironmentMap::with_negatives_clamped(8, 4, with(-1000.0)).is_err());
        assert!(EnvironmentMap::new(8, 5, with(1.0)).is_err());
        assert!(EnvironmentMap::new(0, 4, Vec::new()).is_err());
        assert!(EnvironmentMap::new(usize::MAX, 2, Vec::new()).is_err());
        let (_, none) = EnvironmentMap::with_negatives_clamped(8, 4, with(2.0)).expect("valid");
        assert!(none.is_none());
    }
}
