//! The hybrid method (section 4 of the paper): R_d is divided into a global part, which the shared samples sum, and a local part, which is
//! gathered in an image of the irradiance as the light sees it.

use std::f64::consts::TAU;
use std::sync::Arc;

use glam::DVec3;
use rayon::prelude::*;

use super::settings::Local;
use crate::error::{Error, Result};
use crate::geometry::bvh::{Bvh, Ray};
use crate::light::Light;
use crate::math::quadrature::integrate;
use crate::medium::fresnel;
use crate::medium::profile::Profile;
use crate::scene::Scene;
use crate::transport::kernel::medium::MediumKernel;
use crate::transport::receivers::Receivers;

/// The weight of the local part, W_l: 1 at the receiver, 1/2 at R_p. (The paper prints another sign in the exponent inside R_p.)
fn local_weight(r_mm: f64, middle_mm: f64, sharpness: f64) -> f64 {
    let beyond = (r_mm - middle_mm) * sharpness;
    if beyond <= 0.0 { 1.0 - 0.5 * beyond.exp() } else { 0.5 * (-beyond).exp() }
}

/// R_p, mm: the largest distance at which 2 pi r R_d(r) of some channel is the lower bound; 0 where none is as important.
fn middle_mm(profiles: &[Arc<dyn Profile>; 3], importance: f64) -> f64 {
    let of = |profile: &Arc<dyn Profile>| {
        let at = |r: f64| TAU * r * profile.reflectance(r) - importance;
        // From far away inwards, in steps of 2 %.
        let mut outer = profile.range_mm(1e-9).min(1e12);
        let least = 1e-6 * outer;
        while outer > least {
            let inner = outer / 1.02;
            if at(inner) >= 0.0 {
                let (mut low, mut high) = (inner, outer);
                for _ in 0..40 {
                    let middle = 0.5 * (low + high);
                    if at(middle) >= 0.0 { low = middle } else { high = middle }
                }
                return low;
            }
            outer = inner;
        }
        0.0
    };
    profiles.iter().map(of).fold(0.0, f64::max)
}

/// The global part R_d W_g of a profile.
struct Global {
    whole: Arc<dyn Profile>,
    middle_mm: f64,
    sharpness: f64,
    range_mm: f64,
}

impl Profile for Global {
    fn reflectance(&self, r_mm: f64) -> f64 {
        self.whole.reflectance(r_mm) * (1.0 - local_weight(r_mm, self.middle_mm, self.sharpness))
    }

    /// The tail of the whole less that of the local part.
    fn tail(&self, r_mm: f64) -> f64 {
        let local = |r: f64| r * self.whole.reflectance(r) * local_weight(r, self.middle_mm, self.sharpness);
        let tolerance = 1e-9 * self.whole.tail(0.0).max(f64::MIN_POSITIVE);
        let cut = self.middle_mm.clamp(r_mm, self.range_mm.max(r_mm));
        let inside = integrate(local, r_mm, cut, tolerance) + integrate(local, cut, self.range_mm.max(cut), tolerance);
        (self.whole.tail(r_mm) - inside).max(0.0)
    }
}

/// Steps of a [`LocalPart`]'s tables.
const STEPS: usize = 4096;

/// The local part of a medium: its profiles in a table, and the circles of the samples.
struct LocalPart {
    /// R_d W_l, RGB, at equal steps of the distance.
    table: Vec<DVec3>,
    step_mm: f64,
    /// Radius of each circle, mm, and the density of samples there, 1/mm^2; the first is the sample in the middle.
    circles: Vec<(f64, f64)>,
}

impl LocalPart {
    fn new(profiles: &[Arc<dyn Profile>; 3], middle_mm: f64, local: &Local) -> Self {
        let range = range_mm(profiles, middle_mm, local);
        let step_mm = range / STEPS as f64;
        let at = |step: usize| {
            let r = step as f64 * step_mm;
            let weight = local_weight(r, middle_mm, local.sharpness);
            DVec3::from_array(profiles.each_ref().map(|p| weight * p.reflectance(r)))
        };
        let table: Vec<DVec3> = (0..=STEPS).map(at).collect();
        // Share of the local part inside each step, all channels.
        let mut inside = vec![0.0];
        for step in 0..STEPS {
            let ring = (step as f64 + 0.5) * step_mm * TAU * step_mm;
            inside.push(inside[step] + ring * 0.5 * (table[step] + table[step + 1]).element_sum());
        }
        let total = inside[STEPS];
        let samples = f64::from(local.rings * local.of_ring + 1);
        let density = |r: f64, table: &[DVec3]| look_up(table, step_mm, r).element_sum() / total.max(f64::MIN_POSITIVE);
        let mut circles = vec![(0.0, density(0.0, &table))];
        for ring in 0..local.rings {
            let wanted = total * (1.0 + f64::from(local.of_ring) * (f64::from(ring) + 0.5)) / samples;
            let step = inside.partition_point(|share| *share < wanted).clamp(1, STEPS);
            let (before, after) = (inside[step - 1], inside[step]);
            let share = if after > before { (wanted - before) / (after - before) } else { 0.5 };
            let r = (step as f64 - 1.0 + share) * step_mm;
            circles.push((r, density(r, &table)));
        }
        Self { table, step_mm, circles }
    }
}

/// Distance beyond which the local part is less than a millionth of the largest value.
fn range_mm(profiles: &[Arc<dyn Profile>; 3], middle_mm: f64, local: &Local) -> f64 {
    let far = profiles.iter().map(|p| p.range_mm(1e-6)).fold(0.0, f64::max);
    far.min(middle_mm + 14.0 / local.sharpness).max(f64::MIN_POSITIVE.sqrt())
}

fn look_up(table: &[DVec3], step_mm: f64, r_mm: f64) -> DVec3 {
    let place = r_mm / step_mm;
    let index = place as usize;
    match table.get(index..index + 2) {
        Some([a, b]) => a.lerp(*b, place - index as f64),
        _ => DVec3::ZERO,
    }
}

/// The division of R_d of every medium.
pub(super) struct Division {
    settings: Local,
    parts: Vec<LocalPart>,
}

impl Division {
    /// Divides the kernels of the media; the second are those of the global parts, over an object of a diagonal.
    pub(super) fn new(settings: &Local, kernels: &[MediumKernel], diagonal_mm: f64) -> (Self, Vec<MediumKernel>) {
        let (mut parts, mut global) = (Vec::new(), Vec::new());
        for kernel in kernels {
            let middle_mm = middle_mm(kernel.profiles(), settings.importance);
            let range_mm = range_mm(kernel.profiles(), middle_mm, settings);
            parts.push(LocalPart::new(kernel.profiles(), middle_mm, settings));
            let sharpness = settings.sharpness;
            let profiles = kernel.profiles().each_ref().map(|whole| {
                Arc::new(Global { whole: Arc::clone(whole), middle_mm, sharpness, range_mm }) as Arc<dyn Profile>
            });
            global.push(MediumKernel::of_profiles(profiles, diagonal_mm));
        }
        (Self { settings: *settings, parts }, global)
    }
}

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

/// Least cosine between light and normal at which a pixel is a piece of its triangle's plane; below it all of the pixel has one depth.
const LEAST_COSINE: f64 = 0.2;

/// The direction or the place that sharp light comes from, relative to the mesh's origin.
#[derive(Clone, Copy)]
enum From {
    Direction(DVec3),
    Place(DVec3),
}

/// The surface as a directional or point light sees it.
pub(super) struct LightView {
    from: From,
    colour: DVec3,
    /// Axes across the view, and the direction from the object to the light.
    axes: [DVec3; 3],
    /// Middle of the image and half of its edge: in mm, or as tangents for a point.
    middle: [f64; 2],
    half: f64,
    pixels: u32,
    seen: Vec<Option<Seen>>,
    planes: Vec<Plane>,
}

/// Nearest point lights over the radius of the object: nearer ones see half of a space.
const NEAREST: f64 = 1.05;

impl LightView {
    /// Looks at the scene from a light.
    ///
    /// # Errors
    /// Unsupported: light that does not come from one direction or place, or from within the object's sphere.
    pub(super) fn new((scene, bvh): (&Scene, &Bvh), light: &Light, local: &Local) -> Result<Self> {
        let [low, high] = scene.mesh.bounds_local_mm();
        let (centre, radius) = (0.5 * (low + high), 0.5 * (high - low).length());
        let (from, colour) = match light {
            Light::Directional { from, irradiance } => (From::Direction(from.normalize_or(DVec3::Y)), *irradiance),
            Light::Point { at_mm, intensity } => (From::Place(*at_mm - scene.mesh.origin_mm), *intensity),
            other => {
                let kind = other.kind().name();
                return Err(Error::unsupported(format!(
                    "sampling=hybrid sees directional and point lights, not {kind}; --set sampling=product takes all"
                )));
            }
        };
        let (towards, half) = match from {
            From::Direction(direction) => (direction, radius),
            From::Place(place) => {
                let distance = place.distance(centre);
                if distance < NEAREST * radius {
                    return Err(Error::unsupported(
                        "sampling=hybrid takes point lights outside the sphere around the object; --set sampling=product takes all",
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
        let plane = |triangle: u32| {
            let normal = scene.mesh.normal(triangle);
            (normal, normal.dot(scene.mesh.corners_local_mm(triangle)[0]))
        };
        let planes = (0..scene.mesh.triangles.len() as u32).map(plane).collect();
        let (half, pixels) = (half * 1.001, local.image);
        let mut view = Self { from, colour, axes, middle, half, pixels, seen: Vec::new(), planes };
        let start = centre.dot(towards) + 1.01 * radius;
        let row = |row: u32| -> Vec<Option<Seen>> {
            (0..view.pixels).map(|column| view.look((scene, bvh), [column, row], start)).collect()
        };
        view.seen = (0..view.pixels).into_par_iter().flat_map_iter(row).collect();
        Ok(view)
    }

    fn look(&self, (scene, bvh): (&Scene, &Bvh), pixel: [u32; 2], start: f64) -> Option<Seen> {
        let at =
            |i: usize| self.middle[i] + self.half * (2.0 * (f64::from(pixel[i]) + 0.5) / f64::from(self.pixels) - 1.0);
        let [u, v, towards] = self.axes;
        let (origin, direction) = match self.from {
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
        let entering = if cosine > 0.0 { fresnel::transmittance(eta, cosine) as f32 } else { 0.0 };
        let at_mm = (1.0 - s - t) * a + s * b + t * c;
        let depth = match self.from {
            From::Direction(direction) => at_mm.dot(direction),
            From::Place(place) => (place - at_mm).dot(towards),
        };
        Some(Seen { triangle: hit.triangle, part, depth: depth as f32, entering })
    }

    /// The ray of light through a place: its origin and its step, to which a parameter belongs.
    fn ray(&self, place: DVec3) -> (DVec3, DVec3) {
        match self.from {
            From::Direction(direction) => (place - place.dot(direction) * direction, direction),
            From::Place(light) => {
                let step = place - light;
                (light, step / -step.dot(self.axes[2]))
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
        let [u, v, towards] = self.axes;
        let (x, y, irradiance) = match self.from {
            From::Direction(_) => (place.dot(u), place.dot(v), self.colour),
            From::Place(light) => {
                let d = place - light;
                let depth = -d.dot(towards);
                if depth <= 0.0 {
                    return None;
                }
                // The circles lie in the plane through the receiver that faces the light.
                let gain = light.distance(receiver) / d.length().powi(3);
                (d.dot(u) / depth, d.dot(v) / depth, gain * self.colour)
            }
        };
        let pixel = |x: f64, i: usize| 0.5 * f64::from(self.pixels) * ((x - self.middle[i]) / self.half + 1.0);
        let (column, row) = (pixel(x, 0), pixel(y, 1));
        let most = f64::from(self.pixels);
        let inside = (0.0..most).contains(&column) && (0.0..most).contains(&row);
        let index = (row.max(0.0) as usize) * self.pixels as usize + column.max(0.0) as usize;
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
        let to_light = match self.from {
            From::Direction(direction) => direction,
            From::Place(place) => (place - at).normalize_or(self.axes[2]),
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

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::medium::dipole::Dipole;
    use crate::medium::material::preset;

    fn dipole() -> Arc<dyn Profile> {
        // The red channel of skim milk, Figure 3 of the paper.
        let milk = preset("skimmilk").map(|milk| milk.properties().dipoles(fresnel::BoundaryFit::Published));
        let [red, ..]: [Dipole; 3] = milk.unwrap();
        Arc::new(red)
    }

    #[test]
    fn the_parts_add_up_and_are_equal_in_the_middle() {
        let whole = dipole();
        let profiles = [0; 3].map(|_| Arc::clone(&whole));
        let middle = middle_mm(&profiles, 1e-3);
        assert!((TAU * middle * whole.reflectance(middle) - 1e-3).abs() < 1e-9);
        assert!(TAU * 1.01 * middle * whole.reflectance(1.01 * middle) < 1e-3);
        assert_eq!(middle_mm(&profiles, 1e9), 0.0);
        assert!((local_weight(middle, middle, 1.5) - 0.5).abs() < 1e-12);
        let global =
            Global { whole: Arc::clone(&whole), middle_mm: middle, sharpness: 1.5, range_mm: whole.range_mm(1e-9) };
        for r in [0.0, 0.3 * middle, middle, 2.0 * middle] {
            let share = global.reflectance(r) / whole.reflectance(r);
            assert!((share + local_weight(r, middle, 1.5) - 1.0).abs() < 1e-12, "{r}: {share}");
            let by_hand = integrate(|s| s * global.reflectance(s), r, whole.range_mm(1e-12), 1e-10);
            assert!((global.tail(r) - by_hand).abs() < 1e-6 * whole.tail(0.0), "{r}: {} {by_hand}", global.tail(r));
        }
    }
}
