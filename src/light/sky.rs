//! The built-in sky: blue gradient, soft warm sun behind the object on the left, dark ground.
//!
//! Only +, -, *, / and square roots, so every platform makes the same pixels.

use std::f64::consts::PI;

use glam::DVec3;

use super::environment::EnvironmentMap;

const WIDTH: usize = 256;
const HEIGHT: usize = 128;

/// Direction of the sun: behind (-Z, the default camera looks from +Z), left (-X), about 30 degrees high.
const SUN: DVec3 = DVec3::new(-0.6, 0.6, -0.85);
const SUN_RADIANCE: DVec3 = DVec3::new(60.0, 46.0, 30.0);
/// Column and row of the pixel that [`sky_with_sun`] adds: 30 degrees to the right of the camera's back, 15 degrees high.
const LOW_SUN: (usize, usize) = (106, 53);
/// 1 - cos of the angle at which the sun's core falls to a sixteenth.
const SUN_WIDTH: f64 = 0.012;
const GLOW_RADIANCE: DVec3 = DVec3::new(0.9, 0.6, 0.35);
const GLOW_WIDTH: f64 = 0.2;
const ZENITH: DVec3 = DVec3::new(0.16, 0.27, 0.55);
const HORIZON: DVec3 = DVec3::new(0.55, 0.62, 0.70);
const GROUND: DVec3 = DVec3::new(0.045, 0.04, 0.035);
/// Half the height (in direction.y) over which ground and sky blend.
const HORIZON_BLEND: f64 = 0.03;

/// The built-in sky, 256 x 128 pixels.
pub fn sky() -> EnvironmentMap {
    let mut pixels = Vec::with_capacity(WIDTH * HEIGHT);
    for y in 0..HEIGHT {
        let (sin_polar, cos_polar) = sin_cos((y as f64 + 0.5) / HEIGHT as f64 * PI);
        for x in 0..WIDTH {
            let (sin_longitude, cos_longitude) = sin_cos((0.5 - (x as f64 + 0.5) / WIDTH as f64) * 2.0 * PI);
            let direction = DVec3::new(sin_longitude * sin_polar, cos_polar, cos_longitude * sin_polar);
            pixels.push(radiance(direction).to_array().map(|c| c as f32));
        }
    }
    EnvironmentMap::from_valid(WIDTH, HEIGHT, pixels)
}

/// The built-in sky with a sun of one pixel beside it, low and in front on the right, that sends about as much light as all
/// the rest.
pub fn sky_with_sun() -> EnvironmentMap {
    let sky = sky();
    let (column, row) = LOW_SUN;
    let irradiance = sky.energy();
    let radiance = irradiance / sky.pixel_solid_angle_sr(row);
    let mut pixels = sky.pixels().to_vec();
    pixels[row * WIDTH + column] = radiance.to_array().map(|c| c as f32);
    EnvironmentMap::from_valid(WIDTH, HEIGHT, pixels)
}

fn radiance(direction: DVec3) -> DVec3 {
    let above = smooth_step((direction.y + HORIZON_BLEND) / (2.0 * HORIZON_BLEND));
    let height = 1.0 - direction.y.max(0.0);
    let gradient = ZENITH + (HORIZON - ZENITH) * (height * height * height);
    let from_sun = 1.0 - direction.dot(SUN) / SUN.dot(SUN).sqrt();
    let sun = SUN_RADIANCE * lobe(from_sun / SUN_WIDTH) + GLOW_RADIANCE * lobe(from_sun / GLOW_WIDTH);
    GROUND * (1.0 - above) + (gradient + sun) * above
}

/// A lobe that falls from 1 at 0 to 1/16 at 1.
fn lobe(t: f64) -> f64 {
    let base = 1.0 / (1.0 + t.max(0.0));
    (base * base) * (base * base)
}

fn smooth_step(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Sine and cosine of `angle` in [-pi, pi] from their power series at an eighth of the angle, doubled three times.
fn sin_cos(angle: f64) -> (f64, f64) {
    let x = angle / 8.0;
    let x2 = x * x;
    let mut sin = x * (1.0 - x2 / 6.0 * (1.0 - x2 / 20.0 * (1.0 - x2 / 42.0 * (1.0 - x2 / 72.0 * (1.0 - x2 / 110.0)))));
    let mut cos = 1.0 - x2 / 2.0 * (1.0 - x2 / 12.0 * (1.0 - x2 / 30.0 * (1.0 - x2 / 56.0 * (1.0 - x2 / 90.0))));
    for _ in 0..3 {
        (sin, cos) = (2.0 * sin * cos, cos * cos - sin * sin);
    }
    (sin, cos)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn series_agrees_with_the_library() {
        for i in -1000..=1000 {
            let angle = PI * f64::from(i) / 1000.0;
            let (sin, cos) = sin_cos(angle);
            assert!((sin - angle.sin()).abs() < 1e-11 && (cos - angle.cos()).abs() < 1e-11, "{angle}");
        }
    }

    #[test]
    fn sky_is_a_valid_map_with_its_sun_behind_on_the_left_and_a_dark_ground() {
        let map = sky();
        let checked = EnvironmentMap::new(map.width(), map.height(), map.pixels().to_vec()).expect("finite");
        assert_eq!(checked, map);
        let brightest = (0..WIDTH * HEIGHT)
            .max_by(|a, b| map.pixels()[*a][0].total_cmp(&map.pixels()[*b][0]))
            .map(|i| map.pixel_direction(i % WIDTH, i / WIDTH))
            .expect("pixels");
        assert!(brightest.dot(SUN.normalize()) > 0.999, "{brightest}");
        assert!(map.radiance(DVec3::NEG_Y).max_element() < 0.05);
        assert!(map.radiance(DVec3::Y).z > 0.3);
        // The sun's core carries a good part of the light, but not all of it.
        let energy = map.energy();
        let core: f64 = (0..WIDTH * HEIGHT)
            .filter(|i| map.pixel_direction(i % WIDTH, i / WIDTH).dot(SUN.normalize()) > 0.95)
            .map(|i| f64::from(map.pixels()[i][0]) * map.pixel_solid_angle_sr(i / WIDTH))
            .sum();
        assert!((0.2..0.8).contains(&(core / energy.x)), "{}", core / energy.x);
    }
}
