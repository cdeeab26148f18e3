//! A camera that the user turns about the object and moves nearer and farther.

use glam::DVec3;

use super::lights::{angles_degrees, direction_of_degrees};
use crate::error::Result;
use crate::render::camera::Camera;

/// Largest elevation, up or down: straight above, +Y would no longer be up in the picture.
const MAX_ELEVATION_DEGREES: f64 = 89.0;
/// Degrees for a drag over the height of the picture.
const DEGREES_PER_HEIGHT: f64 = 180.0;
/// Nearest and farthest distance relative to the first one.
const DISTANCES: std::ops::RangeInclusive<f64> = 0.05..=50.0;

/// A camera on a sphere about its target; +Y is up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Orbit {
    look_mm: DVec3,
    first_distance_mm: f64,
    distance_mm: f64,
    azimuth_degrees: f64,
    elevation_degrees: f64,
    fov_degrees: f64,
}

impl Orbit {
    /// The orbit that `camera` is on.
    pub fn of(camera: &Camera) -> Self {
        let offset = camera.at_mm() - camera.look_mm();
        let (azimuth_degrees, elevation_degrees) = angles_degrees(offset);
        Self {
            look_mm: camera.look_mm(),
            first_distance_mm: offset.length(),
            distance_mm: offset.length(),
            azimuth_degrees,
            elevation_degrees: elevation_degrees.clamp(-MAX_ELEVATION_DEGREES, MAX_ELEVATION_DEGREES),
            fov_degrees: camera.fov_degrees(),
        }
    }

    /// The current camera.
    ///
    /// # Errors
    /// As [`Camera::new`].
    pub fn camera(&self) -> Result<Camera> {
        let direction = direction_of_degrees(self.azimuth_degrees, self.elevation_degrees);
        Camera::new(self.look_mm + direction * self.distance_mm, self.look_mm, DVec3::Y, self.fov_degrees)
    }

    /// Turns by a drag, in shares of the picture's height: right and down are positive.
    pub fn drag(&mut self, right: f64, down: f64) {
        let step = |share: f64| if share.is_finite() { share * DEGREES_PER_HEIGHT } else { 0.0 };
        self.azimuth_degrees = (self.azimuth_degrees - step(right)).rem_euclid(360.0);
        self.elevation_degrees =
            (self.elevation_degrees + step(down)).clamp(-MAX_ELEVATION_DEGREES, MAX_ELEVATION_DEGREES);
    }

    /// Moves nearer for positive `notches` of a wheel.
    pub fn zoom(&mut self, notches: f64) {
        if notches.is_finite() {
            let (nearest, farthest) =
                (DISTANCES.start() * self.first_distance_mm, DISTANCES.end() * self.first_distance_mm);
            self.distance_mm = (self.distance_mm * (-0.1 * notches.clamp(-50.0, 50.0)).exp()).clamp(nearest, farthest);
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        Camera::new(DVec3::new(1.0, 8.0, 75.0), DVec3::new(1.0, 2.0, 3.0), DVec3::Y, 28.0).unwrap()
    }

    #[test]
    fn an_orbit_starts_at_its_camera() {
        let orbit = Orbit::of(&camera());
        assert!((orbit.camera().unwrap().at_mm() - camera().at_mm()).length() < 1e-9);
    }

    #[test]
    fn drags_keep_the_distance_and_stop_at_the_poles() {
        let mut orbit = Orbit::of(&camera());
        let distance = (camera().at_mm() - camera().look_mm()).length();
        for (right, down) in [(0.25, 0.1), (3.0, 9.0), (-7.0, -40.0), (f64::NAN, f64::INFINITY)] {
            orbit.drag(right, down);
            let now = orbit.camera().unwrap();
            assert!(((now.at_mm() - now.look_mm()).length() / distance - 1.0).abs() < 1e-9);
            assert_eq!(now.look_mm(), camera().look_mm());
        }
    }

    #[test]
    fn dragging_right_shows_the_left_side() {
        let mut orbit = Orbit::of(&Camera::new(DVec3::Z * 9.0, DVec3::ZERO, DVec3::Y, 28.0).unwrap());
        orbit.drag(0.5, 0.0);
        assert!((orbit.camera().unwrap().at_mm() - DVec3::NEG_X * 9.0).length() < 1e-9);
    }

    #[test]
    fn zooming_has_ends_and_comes_back() {
        let mut orbit = Orbit::of(&camera());
        let start = orbit;
        orbit.zoom(4.0);
        orbit.zoom(-4.0);
        assert!((orbit.distance_mm / start.distance_mm - 1.0).abs() < 1e-12);
        for notches in [1e9, f64::INFINITY, f64::NAN, -1e9] {
            (0..20).for_each(|_| orbit.zoom(notches));
            assert!(orbit.camera().is_ok());
        }
    }
}
