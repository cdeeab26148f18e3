//! Specular reflection of the lights to the eye.
//!
//! Directional and point lights: the model itself times the irradiance, with a shadow ray. Area lights: one point of
//! the light and one reflection for each eye ray, joined by the balance heuristic, with shadow rays. Environments and
//! constant lights: one sampled reflection for each eye ray, with a filtered look-up and without shadows: where the
//! object stands in its own way, the reflection is too bright.

use glam::{DVec2, DVec3};

use super::glossy_map::GlossyMap;
use super::highlight::Highlight;
use super::lights::{Rectangle, ShadowRays, Sharp, Start};
use super::specular::{Reflected, terminator};
use crate::geometry::bvh::Bvh;
use crate::light::Light;
use crate::light::environment::Rotation;
use crate::math::spherical_rectangle::SphericalRectangle;

/// A point of the surface that an eye ray sees from its front.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    /// The point in the mesh's local coordinates, mm.
    pub point: DVec3,
    pub triangle: u32,
    /// Geometric unit normal, on the eye's side.
    pub geometric: DVec3,
    /// Shading unit normal, on the eye's side.
    pub normal: DVec3,
    /// Unit vector to the eye.
    pub to_eye: DVec3,
    /// Boundary of the medium.
    pub highlight: Highlight,
    /// Uniform random numbers that choose the reflection.
    pub lobe: DVec2,
    /// Uniform random numbers that choose the point of a light.
    pub light: DVec2,
}

impl Place {
    fn start(&self) -> Start {
        Start::new(self.point, self.geometric, self.triangle)
    }

    /// Radiance for an irradiance of 1 on a surface that faces `to_light`; 0 below the triangle or the surface.
    #[inline]
    fn response(&self, to_light: DVec3) -> f64 {
        let (cos_geometric, cos_shading) = (self.geometric.dot(to_light), self.normal.dot(to_light));
        if cos_geometric <= 0.0 || cos_shading <= 0.0 {
            return 0.0;
        }
        let softened = terminator(cos_geometric, cos_shading, self.normal.dot(self.geometric));
        self.highlight.brdf(self.normal, to_light, self.to_eye) * cos_shading * softened
    }

    /// The sampled reflection; none below the triangle or the surface.
    #[inline]
    fn reflection(&self) -> Option<Reflected> {
        let sample = self.highlight.sample(self.normal, self.to_eye, self.lobe)?;
        let (cos_geometric, cos_shading) = (self.geometric.dot(sample.to_light), self.normal.dot(sample.to_light));
        let softened = terminator(cos_geometric, cos_shading, self.normal.dot(self.geometric));
        (softened > 0.0).then_some(Reflected { weight: sample.weight * softened, ..sample })
    }
}

impl Rectangle {
    /// Distance along a unit direction to the emitting side, if it is met.
    #[inline]
    fn distance(&self, from: DVec3, direction: DVec3) -> Option<f64> {
        let towards = -direction.dot(self.normal);
        let height = (from - self.corner).dot(self.normal);
        if towards <= 0.0 || height <= 0.0 {
            return None;
        }
        let distance = height / towards;
        let offset = from + direction * distance - self.corner;
        let inside = |axis: usize| (0.0..=self.lengths[axis]).contains(&offset.dot(self.edges[axis]));
        (distance.is_finite() && inside(0) && inside(1)).then_some(distance)
    }
}

/// Lights prepared for specular reflection.
pub(super) struct GlossyLights {
    sharp: Vec<Sharp>,
    rectangles: Vec<Rectangle>,
    constant: DVec3,
    maps: Vec<(GlossyMap, Rotation, DVec3)>,
    /// Number of reflections of each pixel, which together sample the whole lobe.
    samples_per_pixel: f64,
}

impl GlossyLights {
    /// Prepares the lights; `origin_mm` is the world position of the mesh's local origin.
    pub(super) fn new(lights: &[Light], origin_mm: DVec3, samples_per_pixel: u32) -> Self {
        let mut all = Self {
            sharp: Vec::new(),
            rectangles: Vec::new(),
            constant: DVec3::ZERO,
            maps: Vec::new(),
            samples_per_pixel: f64::from(samples_per_pixel),
        };
        for light in lights {
            all.sharp.extend(Sharp::new(light, origin_mm));
            all.rectangles.extend(Rectangle::new(light, origin_mm));
            match light {
                Light::Constant { radiance } => all.constant += *radiance,
                Light::Environment { map, rotate_degrees, scale } => {
                    all.maps.push((GlossyMap::new(map), Rotation::from_degrees(*rotate_degrees), *scale));
                }
                Light::Directional { .. } | Light::Point { .. } | Light::Spot { .. } | Light::Area { .. } => {}
            }
        }
        all
    }

    /// Returns whether a light needs [`Place::lobe`] or [`Place::light`].
    pub(super) fn are_sampled(&self) -> bool {
        self.constant != DVec3::ZERO || !self.maps.is_empty() || !self.rectangles.is_empty()
    }

    /// Adds to `out` the radiance that each place reflects to its eye.
    pub(super) fn add(&self, bvh: &Bvh, places: &[Place], shadow: &mut ShadowRays, out: &mut [DVec3]) {
        for light in &self.sharp {
            for (index, place) in places.iter().enumerate() {
                let (to_light, distance, irradiance) = light.seen_from(place.point);
                // A light in the surface itself has no direction.
                let gain = if distance > 0.0 { place.response(to_light) * irradiance } else { DVec3::ZERO };
                shadow.push(index, place.start(), (to_light, distance), gain);
            }
            shadow.resolve(bvh, |index, gain| out[index] += gain);
        }
        if !self.are_sampled() {
            return;
        }
        for (index, place) in places.iter().enumerate() {
            let reflection = place.reflection();
            if let Some(sample) = &reflection {
                out[index] += self.of_afar(sample);
            }
            for rectangle in &self.rectangles {
                self.of_rectangle(rectangle, index, place, reflection.as_ref(), shadow);
            }
        }
        shadow.resolve(bvh, |index, gain| out[index] += gain);
    }

    /// Radiance from the lights at infinity by a sampled reflection.
    #[inline]
    fn of_afar(&self, sample: &Reflected) -> DVec3 {
        let solid_angle = 1.0 / (self.samples_per_pixel * sample.density_per_sr);
        let seen = |(map, rotation, scale): &(GlossyMap, Rotation, DVec3)| {
            *scale * map.radiance(rotation.to_map(sample.to_light), solid_angle)
        };
        sample.weight * (self.constant + self.maps.iter().map(seen).sum::<DVec3>())
    }

    fn of_rectangle(
        &self,
        light: &Rectangle,
        index: usize,
        place: &Place,
        reflection: Option<&Reflected>,
        shadow: &mut ShadowRays,
    ) {
        if (place.point - light.corner).dot(light.normal) <= 0.0 {
            return;
        }
        let [u, v] = light.edges;
        let seen = SphericalRectangle::new(place.point, light.corner, u, v, light.lengths);
        let solid_angle = seen.solid_angle();
        if solid_angle <= 0.0 || !solid_angle.is_finite() {
            return;
        }
        let offset = seen.sample(place.light.x, place.light.y) - place.point;
        let distance = offset.length();
        if distance > 0.0 {
            let to_light = offset / distance;
            let density = place.highlight.density_per_sr(place.normal, to_light, place.to_eye);
            // The light's density is 1 / solid_angle: L f cos / density times the balance heuristic.
            let gain = light.radiance * (place.response(to_light) * solid_angle / (1.0 + density * solid_angle));
            shadow.push(index, place.start(), (to_light, distance), gain);
        }
        if let Some(sample) = reflection
            && let Some(distance) = light.distance(place.point, sample.to_light)
        {
            let share = sample.density_per_sr * solid_angle;
            let gain = light.radiance * (sample.weight * share / (1.0 + share));
            shadow.push(index, place.start(), (sample.to_light, distance), gain);
        }
    }
}
