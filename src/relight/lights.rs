//! Turning lights: about the vertical axis for an animation, and by hand in azimuth, elevation and brightness.

use std::sync::Arc;

use glam::{DMat3, DVec3};

use crate::geometry::mesh::Mesh;
use crate::light::Light;
use crate::light::environment::Rotation;

/// Largest change of a light's brightness, in stops.
pub const MAX_STOPS: f64 = 10.0;

/// The pivot of turning lights, on the vertical axis through the middle of the mesh's bounding box, in world mm.
pub fn pivot_mm(mesh: &Mesh) -> DVec3 {
    let [min, max] = mesh.bounds_local_mm();
    mesh.origin_mm + 0.5 * (min + max)
}

/// A light turned by `degrees` about +Y through `pivot_mm`, counter-clockwise seen from above.
pub fn turned(light: &Light, degrees: f64, pivot_mm: DVec3) -> Light {
    let turn = Rotation::from_degrees(degrees);
    let mut light = light.clone();
    rotate(&mut light, pivot_mm, |v| turn.to_world(v), |v| turn.to_world(v));
    if let Light::Environment { rotate_degrees, .. } = &mut light {
        *rotate_degrees = (*rotate_degrees + degrees).rem_euclid(360.0);
    }
    light
}

/// Rotates what a light has in space about a pivot: places by `turn`, unit vectors by `direction`.
fn rotate(light: &mut Light, pivot_mm: DVec3, turn: impl Fn(DVec3) -> DVec3, direction: impl Fn(DVec3) -> DVec3) {
    match light {
        Light::Constant { .. } | Light::Environment { .. } => {}
        Light::Directional { from, .. } => *from = direction(*from),
        Light::Point { at_mm, .. } => *at_mm = pivot_mm + turn(*at_mm - pivot_mm),
        Light::Spot { at_mm, cone, .. } => {
            *at_mm = pivot_mm + turn(*at_mm - pivot_mm);
            cone.to_mm = pivot_mm + turn(cone.to_mm - pivot_mm);
        }
        Light::Area { at_mm, normal, u, .. } => {
            *at_mm = pivot_mm + turn(*at_mm - pivot_mm);
            (*normal, *u) = (direction(*normal), direction(*u));
        }
    }
}

/// Azimuth from +Z towards +X and elevation above the horizon of a direction, in degrees.
pub fn angles_degrees(direction: DVec3) -> (f64, f64) {
    let across = direction.x.hypot(direction.z);
    (direction.x.atan2(direction.z).to_degrees(), direction.y.atan2(across).to_degrees())
}

/// Unit direction of these angles.
pub fn direction_of_degrees(azimuth: f64, elevation: f64) -> DVec3 {
    let ((sin_a, cos_a), (sin_e, cos_e)) = (azimuth.to_radians().sin_cos(), elevation.to_radians().sin_cos());
    DVec3::new(sin_a * cos_e, sin_e, cos_a * cos_e)
}

/// A light with its manual changes.
#[derive(Clone, Debug, PartialEq)]
pub struct AdjustedLight {
    /// The light as it was given.
    pub base: Light,
    /// Azimuth of the light as seen from the pivot, or the rotation of an environment.
    pub azimuth_degrees: f64,
    /// Elevation of the light above the horizon; none where it has no direction or can only turn.
    pub elevation_degrees: Option<f64>,
    /// Brightness relative to the light as it was given, in stops.
    pub stops: f64,
    /// Whether the light is on.
    pub on: bool,
}

impl AdjustedLight {
    /// An entry for a light without changes.
    pub fn new(base: Light, pivot_mm: DVec3) -> Self {
        let (azimuth_degrees, elevation_degrees) = match &base {
            Light::Environment { rotate_degrees, .. } => (*rotate_degrees, None),
            Light::Constant { .. } => (0.0, None),
            Light::Directional { .. } | Light::Point { .. } | Light::Spot { .. } | Light::Area { .. } => {
                let (azimuth, elevation) = angles_degrees(base_direction(&base, pivot_mm));
                (azimuth, Some(elevation))
            }
        };
        Self { base, azimuth_degrees, elevation_degrees, stops: 0.0, on: true }
    }

    /// Returns whether turning the light changes anything.
    pub fn turns(&self) -> bool {
        !matches!(self.base, Light::Constant { .. })
    }

    /// The light with its changes, turned by `turn_degrees` more.
    pub fn light(&self, turn_degrees: f64, pivot_mm: DVec3) -> Light {
        let mut light = self.base.clone();
        if let Some(elevation) = self.elevation_degrees {
            let (azimuth_0, elevation_0) = angles_degrees(base_direction(&light, pivot_mm));
            let rotation = DMat3::from_rotation_y(self.azimuth_degrees.to_radians())
                * DMat3::from_rotation_x((elevation_0 - elevation).to_radians())
                * DMat3::from_rotation_y(-azimuth_0.to_radians());
            rotate(&mut light, pivot_mm, |v| rotation * v, |v| (rotation * v).normalize());
        } else if let Light::Environment { rotate_degrees, .. } = &mut light {
            *rotate_degrees = self.azimuth_degrees;
        }
        scale(&mut light, self.stops.clamp(-MAX_STOPS, MAX_STOPS).exp2());
        if turn_degrees == 0.0 { light } else { turned(&light, turn_degrees, pivot_mm) }
    }

    /// Turns the light by hand.
    pub fn turn(&mut self, azimuth_degrees: f64, elevation_degrees: f64) {
        if self.turns() {
            self.azimuth_degrees = (self.azimuth_degrees + azimuth_degrees + 180.0).rem_euclid(360.0) - 180.0;
        }
        if let Some(elevation) = &mut self.elevation_degrees {
            *elevation = (*elevation + elevation_degrees).clamp(-90.0, 90.0);
        }
    }
}

fn base_direction(light: &Light, pivot_mm: DVec3) -> DVec3 {
    match light {
        Light::Directional { from, .. } => *from,
        Light::Point { at_mm, .. } | Light::Spot { at_mm, .. } | Light::Area { at_mm, .. } => *at_mm - pivot_mm,
        Light::Constant { .. } | Light::Environment { .. } => DVec3::Z,
    }
}

fn scale(light: &mut Light, factor: f64) {
    let colour = match light {
        Light::Constant { radiance } | Light::Area { radiance, .. } => radiance,
        Light::Directional { irradiance, .. } => irradiance,
        Light::Point { intensity, .. } | Light::Spot { intensity, .. } => intensity,
        Light::Environment { scale, .. } => scale,
    };
    // A light at the end of the range of its numbers stays there.
    *colour = (*colour * factor).min(DVec3::splat(f64::MAX));
}

/// Returns whether two states of the lights are the same; environments are compared by the address of their picture,
/// which is quick.
pub fn are_same(a: &[Light], b: &[Light]) -> bool {
    let same = |(a, b): (&Light, &Light)| match (a, b) {
        (
            Light::Environment { map: a, rotate_degrees: turn_a, scale: scale_a },
            Light::Environment { map: b, rotate_degrees: turn_b, scale: scale_b },
        ) => Arc::ptr_eq(a, b) && turn_a == turn_b && scale_a == scale_b,
        (a, b) => a == b,
    };
    a.len() == b.len() && a.iter().zip(b).all(same)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {

    use super::*;
    use crate::light::sky::sky;

    const PIVOT: DVec3 = DVec3::new(10.0, 2.0, -3.0);

    fn all() -> Vec<Light> {
        vec![
            Light::constant(DVec3::ONE).unwrap(),
            Light::directional(DVec3::new(0.3, 0.8, 0.5), DVec3::splat(3.0)).unwrap(),
            Light::point(PIVOT + DVec3::new(0.0, 10.0, 30.0), DVec3::splat(900.0)).unwrap(),
            Light::area(PIVOT + DVec3::X * 9.0, DVec3::new(-1.0, 0.2, 0.0), [2.0, 3.0], DVec3::ONE, None).unwrap(),
            Light::environment(Arc::new(sky()), 33.0, DVec3::ONE).unwrap(),
        ]
    }

    /// What turning changes.
    fn vectors(light: &Light) -> Vec<DVec3> {
        match light {
            Light::Constant { .. } => vec![],
            Light::Directional { from, .. } => vec![*from],
            Light::Point { at_mm, .. } => vec![*at_mm],
            Light::Spot { at_mm, cone, .. } => vec![*at_mm, cone.to_mm],
            Light::Area { at_mm, normal, u, .. } => vec![*at_mm, *normal, *u],
            Light::Environment { rotate_degrees, .. } => vec![DVec3::splat(*rotate_degrees)],
        }
    }

    fn close(a: &Light, b: &Light) {
        assert_eq!(a.kind(), b.kind());
        assert!(vectors(a).iter().zip(vectors(b)).all(|(a, b)| (*a - b).length() < 1e-9), "{a} {b}");
    }

    #[test]
    fn a_full_turn_and_steps_of_it_come_back() {
        for light in all() {
            close(&turned(&light, 360.0, PIVOT), &light);
            let stepped = (0..8).fold(light.clone(), |l, _| turned(&l, 45.0, PIVOT));
            close(&stepped, &light);
        }
        let quarter = turned(&Light::directional(DVec3::Z, DVec3::ONE).unwrap(), 90.0, PIVOT);
        close(&quarter, &Light::directional(DVec3::X, DVec3::ONE).unwrap());
        let point = turned(&Light::point(PIVOT + DVec3::Z, DVec3::ONE).unwrap(), 90.0, PIVOT);
        close(&point, &Light::point(PIVOT + DVec3::X, DVec3::ONE).unwrap());
    }

    #[test]
    fn an_entry_is_its_light_until_somebody_turns_it() {
        for light in all() {
            let mut entry = AdjustedLight::new(light.clone(), PIVOT);
            close(&entry.light(0.0, PIVOT), &light);
            close(&entry.light(77.0, PIVOT), &turned(&light, 77.0, PIVOT));
            let before = entry.light(0.0, PIVOT);
            entry.turn(30.0, 0.0);
            close(&entry.light(0.0, PIVOT), &turned(&before, 30.0, PIVOT));
        }
    }

    #[test]
    fn height_and_brightness() {
        let mut entry = AdjustedLight::new(all()[1].clone(), PIVOT);
        entry.turn(0.0, 500.0);
        entry.stops = 1.0;
        let Light::Directional { from, irradiance } = entry.light(0.0, PIVOT) else { panic!("kind") };
        assert!((from - DVec3::Y).length() < 1e-9 && irradiance == DVec3::splat(6.0));
        entry.elevation_degrees = Some(10.0);
        let (_, elevation) = angles_degrees(match entry.light(0.0, PIVOT) {
            Light::Directional { from, .. } => from,
            _ => DVec3::ZERO,
        });
        assert!((elevation - 10.0).abs() < 1e-9);
    }

    #[test]
    fn equal_states_are_told_from_others() {
        let lights = all();
        assert!(are_same(&lights, &lights.clone()));
        assert!(!are_same(&lights, &lights[1..]));
        for i in 1..lights.len() {
            let mut other = lights.clone();
            other[i] = turned(&other[i], 1.0, PIVOT);
            assert!(!are_same(&lights, &other), "{i}");
        }
        let twin = Light::environment(Arc::new(sky()), 33.0, DVec3::ONE).unwrap();
        assert!(!are_same(&lights[4..], &[twin]));
    }

    #[test]
    fn angles_and_directions_are_inverse() {
        for (azimuth, elevation) in [(0.0, 0.0), (90.0, 30.0), (-120.0, -45.0), (179.0, 80.0)] {
            let (a, e) = angles_degrees(direction_of_degrees(azimuth, elevation));
            assert!((a - azimuth).abs() < 1e-9 && (e - elevation).abs() < 1e-9);
        }
    }
}
