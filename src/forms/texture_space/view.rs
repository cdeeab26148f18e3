//! The local part of the hybrid method: an image of the irradiance as a light sees it, gathered on circles around each place.

use std::f64::consts::TAU;

use glam::DVec3;

use super::hybrid::{Division, LocalPart, look_up};
use super::settings::Local;
use crate::error::{Error, Result};
use crate::geometry::bvh::{Bvh, Ray};
use crate::light::Light;
use crate::light::cone::ConeFalloff;
use crate::medium::fresnel;
use crate::parallel::*;
use crate::scene::Scene;
use crate::transport::receivers::Receivers;

/// What a pixel of the light's image sees.
#[derive(Clone, Copy)]
struct Seen {
    triangle: u32,
    part: u32,
    /// Parameter of the ray through the middle of the pixel, see [`LightView::ray`].
    depth: f32,
    /// Transmittance of the surface there.
    entering: f32,
}

/// Plane of a triangle: its unit normal, and the distance from the mesh's origin along it.
type Plane = (DVec3, f64);

/// The plane of a triangle.
pub(super) fn plane(scene: &Scene, triangle: u32) -> Plane {
    let normal = scene.mesh.normal(triangle);
    (normal, normal.dot(scene.mesh.corners_local_mm(triangle)[0]))
}

/// Least cosine between light and normal at which a pixel is a piece of its triangle's plane; below it all of the pixel has one depth.
pub(super) const LEAST_COSINE: f64 = 0.2;

/// The direction or the place that sharp light comes from, relative to the mesh's origin.
#[derive(Clone, Copy)]
pub(super) enum From {
    Direction(DVec3),
    Place(DVec3),
}

/// How a directional, point or spot light looks at the object.
#[derive(Clone, Copy)]
pub(super) struct Frame {
    pub(super) from: From,
    /// Irradiance or intensity.
    pub(super) colour: DVec3,
    pub(super) falloff: ConeFalloff,
    /// Axes across the view, and the direction from the object to the light.
    pub(super) axes: [DVec3; 3],
    /// Middle of the image and half of its edge: in mm, or as tangents for a point.
    pub(super) middle: [f64; 2],
    pub(super) half: f64,
    /// Coordinate along the last axis from which parallel light starts, mm.
    pub(super) start: f64,
    pub(super) pixels: u32,
}

/// The surface as a directional or point light sees it.
pub(super) struct LightView {
    frame: Frame,
    seen: Vec<Option<Seen>>,
    planes: Vec<Plane>,
}

/// Nearest point lights over the radius of the object: nearer ones see half of a space.
const NEAREST: f64 = 1.05;

impl Frame {
    /// How a light looks at a scene.
    ///
    /// # Errors
    /// Unsupported: light that does not come from one direction or place, or from within the object's sphere.
    pub(super) fn new(scene: &Scene, light: &Light, local: &Local) -> Result<Self> {
        let [low, high] = scene.mesh.bounds_local_mm();
        let (centre, radius) = (0.5 * (low + high), 0.5 * (high - low).length());
        let (from, colour, falloff) = match (light, light.from_place()) {
            (Light::Directional { from, irradiance }, _) => {
                (From::Direction(from.normalize_or(DVec3::Y)), *irradiance, ConeFalloff::NONE)
            }
            (_, Some((at_mm, intensity, falloff))) => (From::Place(at_mm - scene.mesh.origin_mm), intensity, falloff),
            (other, None) => {
                let kind = other.kind().name();
                return Err(Error::unsupported(format!(
                    "sampling=hybrid sees directional, point and spot lights, not {kind}; --set sampling=product takes all"
                )));
            }
        };
        let (towards, half) = match from {
            From::Direction(direction) => (direction, radius),
            From::Place(place) => {
                let distance = place.distance(centre);
                if distance < NEAREST * radius {
                    return Err(Error::unsupported(
                        "sampling=hybrid takes point and spot lights outside the sphere around the object; --set sampling=product takes all",
                    ));
                }
                ((place - centre).normalize_or(DVec3::Y), radius / (distance * distance - radius * radius).sqrt())
            }
        };
        let (u, v) = towards.any_orthonormal_pair();
        let axes = [u, v, towards];
        let middle = match from {
            From::Direction(_) => [centre.dot(u), centre.dot(v)],
            From::Place(_) => [0.0; 2],
        };
        let start = centre.dot(towards) + 1.01 * radius;
        Ok(Self { from, colour, falloff, axes, middle, half: half * 1.001, start, pixels: local.image })
    }
}

impl LightView {
    /// Looks at the scene from a light.
    ///
    /// # Errors
    /// As [`Frame::new`].
    pub(super) fn new((scene, bvh): (&Scene, &Bvh), light: &Light, local: &Local) -> Result<Self> {
        let frame = Frame::new(scene, light, local)?;
        let planes = (0..scene.mesh.triangles.len() as u32).map(|triangle| plane(scene, triangle)).collect();
        let mut view = Self { frame, seen: Vec::new(), planes };
        let row = |row: u32| -> Vec<Option<Seen>> {
            (0..frame.pixels).map(|column| view.look((scene, bvh), [column, row])).collect()
        };
        view.seen = (0..frame.pixels).into_par_iter().flat_map_iter(row).collect();
        Ok(view)
    }

    fn look(&self, (scene, bvh): (&Scene, &Bvh), pixel: [u32; 2]) -> Option<Seen> {
        let start = self.frame.start;
        let at = |i: usize| {
            self.frame.middle[i]
                + self.frame.half * (2.0 * (f64::from(pixel[i]) + 0.5) / f64::from(self.frame.pixels) - 1.0)
        };
        let [u, v, towards] = self.frame.axes;
        let (origin, direction) = match self.frame.from {
            From::Direction(direction) => (at(0) * u + at(1) * v + start * direction, -direction),
            From::Place(place) => (place, (at(0) * u + at(1) * v - towards).normalize()),
        };
        let hit = bvh.closest(&Ray::new(origin.as_vec3(), direction.as_vec3()))?;
        let part = *scene.parts.triangle_part.get(hit.triangle as usize)?;
        let medium = scene.parts.parts.get(part as usize)?.medium?;
        let cosine = -scene.mesh.normal(hit.triangle).dot(direction);
        let eta = scene.media.get(medium as usize)?.properties.eta_inside_over_outside;
        let [a, b, c] = scene.mesh.corners_local_mm(hit.triangle);
        let (s, t) = (f64::from(hit.u), f64::from(hit.v));
        let of_cone = self.frame.falloff.at(-direction);
        let entering = if cosine > 0.0 { (fresnel::transmittance(eta, cosine) * of_cone) as f32 } else { 0.0 };
        let at_mm = (1.0 - s - t) * a + s * b + t * c;
        let depth = match self.frame.from {
            From::Direction(direction) => at_mm.dot(direction),
            From::Place(place) => (place - at_mm).dot(towards),
        };
        Some(Seen { triangle: hit.triangle, part, depth: depth as f32, entering })
    }

    /// The ray of light through a place: its origin and its step, to which a parameter belongs.
    fn ray(&self, place: DVec3) -> (DVec3, DVec3) {
        match self.frame.from {
            From::Direction(direction) => (place - place.dot(direction) * direction, direction),
            From::Place(light) => {
                let step = place - light;
                (light, step / -step.dot(self.frame.axes[2]))
            }
        }
    }

    /// Where the ray through a place meets the surface that a pixel sees.
    fn meets(&self, seen: &Seen, place: DVec3) -> DVec3 {
        let (origin, step) = self.ray(place);
        let depth = match self.planes.get(seen.triangle as usize) {
            Some((normal, distance)) if normal.dot(step).abs() >= LEAST_COSINE * step.length() => {
                (distance - normal.dot(origin)) / normal.dot(step)
            }
            _ => f64::from(seen.depth),
        };
        origin + depth * step
    }

    /// What the light sees towards a place, and its irradiance on a surface there that faces the receiver's side of the light.
    fn towards(&self, place: DVec3, receiver: DVec3) -> Option<(Seen, DVec3)> {
        let [u, v, towards] = self.frame.axes;
        let (x, y, irradiance) = match self.frame.from {
            From::Direction(_) => (place.dot(u), place.dot(v), self.frame.colour),
            From::Place(light) => {
                let d = place - light;
                let depth = -d.dot(towards);
                if depth <= 0.0 {
                    return None;
                }
                // The circles lie in the plane through the receiver that faces the light.
                let gain = light.distance(receiver) / d.length().powi(3);
                (d.dot(u) / depth, d.dot(v) / depth, gain * self.frame.colour)
            }
        };
        let pixel = |x: f64, i: usize| {
            0.5 * f64::from(self.frame.pixels) * ((x - self.frame.middle[i]) / self.frame.half + 1.0)
        };
        let (column, row) = (pixel(x, 0), pixel(y, 1));
        let most = f64::from(self.frame.pixels);
        let inside = (0.0..most).contains(&column) && (0.0..most).contains(&row);
        let index = (row.max(0.0) as usize) * self.frame.pixels as usize + column.max(0.0) as usize;
        let seen = if inside { self.seen.get(index).copied().flatten()? } else { return None };
        Some((seen, irradiance))
    }

    /// Adds the local part at every receiver.
    pub(super) fn add(&self, scene: &Scene, division: &Division, receivers: &Receivers, out: &mut [DVec3]) {
        let mut parts = vec![u32::MAX; receivers.len()];
        receivers.groups.iter().for_each(|group| parts[group.run.range()].fill(group.part));
        out.par_iter_mut().zip(&receivers.positions).zip(&parts).with_min_len(64).for_each(|((out, at), part)| {
            let medium = scene.parts.parts.get(*part as usize).and_then(|p| p.medium);
            let Some(local) = medium.and_then(|m| division.parts.get(m as usize)) else { return };
            *out += self.local(local, &division.settings, *at, *part);
        });
    }

    fn local(&self, local: &LocalPart, settings: &Local, at: DVec3, part: u32) -> DVec3 {
        let to_light = match self.frame.from {
            From::Direction(direction) => direction,
            From::Place(place) => (place - at).normalize_or(self.frame.axes[2]),
        };
        let (u, v) = to_light.any_orthonormal_pair();
        let mut sum = DVec3::ZERO;
        for (index, (radius, density)) in local.circles.iter().enumerate() {
            let samples = if index == 0 { 1 } else { settings.of_ring };
            // Neighbouring circles are turned by half a step.
            let turn = if index % 2 == 0 { 0.0 } else { 0.5 };
            for k in 0..samples {
                let (sine, cosine) = (TAU * (f64::from(k) + turn) / f64::from(samples)).sin_cos();
                let place = at + *radius * (cosine * u + sine * v);
                let Some((seen, irradiance)) = self.towards(place, at) else {
                    continue;
                };
                if seen.part == part {
                    let distance = self.meets(&seen, place).distance(at);
                    let entering = f64::from(seen.entering);
                    sum += entering / density * irradiance * look_up(&local.table, local.step_mm, distance);
                }
            }
        }
        sum / f64::from(settings.rings * settings.of_ring + 1)
    }
}
