//! Light of the lights on matte surfaces: opaque parts, and the ground under the object. With shadows, and without what
//! leaves the object.
//!
//! Directional, point and spot lights: a shadow ray. Area lights: points of the light, uniform in solid angle. Environments and
//! constant lights: directions by the light's own energy and by the cosine, joined by the balance heuristic. Points and
//! directions are stratified over the eye rays of a pixel.

use std::f64::consts::{FRAC_1_PI, PI, TAU};

use glam::{DVec2, DVec3};

use super::lights::{Rectangle, ShadowRays, Sharp, Start};
use super::pixel_samples::{PixelSamples, Stream};
use crate::geometry::bvh::Bvh;
use crate::light::Light;
use crate::light::environment::{EnvironmentMap, Rotation, direction_of};
use crate::math::spherical_rectangle::SphericalRectangle;

/// Points of each extended light for one eye ray.
const POINTS: usize = 4;

/// A point of a matte surface on the eye's side.
#[derive(Clone, Copy, Debug)]
pub(super) struct MattePoint {
    /// The point in the mesh's local coordinates, mm.
    pub at_mm: DVec3,
    /// The triangle that it is on, whose own shadow is none; `u32::MAX` for none.
    pub triangle: u32,
    /// Geometric unit normal.
    pub geometric: DVec3,
    /// Shading unit normal.
    pub normal: DVec3,
    /// Pixel, and the number of its eye ray.
    pub pixel: u64,
    pub sample: u32,
}

/// Irradiance at a spot, RGB: with everything that stands in the way, and without.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Irradiance {
    pub lit: DVec3,
    pub open: DVec3,
}

/// An environment with the distribution of its energy over directions.
struct Sky {
    map: std::sync::Arc<EnvironmentMap>,
    rotation: Rotation,
    scale: DVec3,
    /// Sums of the energy of rows, and of the pixels of each row, from 0 on; RGB together.
    rows: Vec<f64>,
    columns: Vec<f64>,
}

/// Lights prepared for matte surfaces.
pub(super) struct MatteLights {
    sharp: Vec<Sharp>,
    rectangles: Vec<Rectangle>,
    constant: DVec3,
    skies: Vec<Sky>,
    samples: PixelSamples,
}

impl MattePoint {
    /// Adds a shadow ray, and what it gains if nothing stands in the way.
    fn look(
        &self,
        (index, out): (usize, &mut [Irradiance]),
        rays: &mut ShadowRays,
        towards: (DVec3, f64),
        gain: DVec3,
    ) {
        if rays.push(index, Start::new(self.at_mm, self.geometric, self.triangle), towards, gain) {
            out[index].open += gain;
        }
    }

    /// Cosine of a direction with the shading normal; 0 below the triangle or the surface.
    fn cosine(&self, to_light: DVec3) -> f64 {
        if self.geometric.dot(to_light) <= 0.0 { 0.0 } else { self.normal.dot(to_light).max(0.0) }
    }

    /// A direction with density cosine / pi about the shading normal.
    fn diffuse(&self, u: DVec2) -> DVec3 {
        let (x, y) = self.normal.any_orthonormal_pair();
        let (radius, (sin, cos)) = (u.x.sqrt(), (TAU * u.y).sin_cos());
        x * (radius * cos) + y * (radius * sin) + self.normal * (1.0 - u.x).max(0.0).sqrt()
    }
}

impl Sky {
    fn new(map: &std::sync::Arc<EnvironmentMap>, rotate_degrees: f64, scale: DVec3) -> Self {
        let (width, height) = (map.width(), map.height());
        let mut columns = Vec::with_capacity((width + 1) * height);
        let mut rows = vec![0.0; height + 1];
        for y in 0..height {
            let mut sum = 0.0;
            columns.push(0.0);
            for x in 0..width {
                sum += (map.pixel(x, y) * scale).element_sum().max(0.0);
                columns.push(sum);
            }
            rows[y + 1] = rows[y] + sum * map.pixel_solid_angle_sr(y);
        }
        let map = std::sync::Arc::clone(map);
        Self { map, rotation: Rotation::from_degrees(rotate_degrees), scale, rows, columns }
    }

    /// Energy of the whole map, RGB together.
    fn energy(&self) -> f64 {
        self.rows.last().copied().unwrap_or(0.0)
    }

    /// Radiance from a direction in the world, and its density in 1/sr.
    fn seen(&self, direction: DVec3) -> (DVec3, f64) {
        let radiance = self.scale * self.map.radiance(self.rotation.to_map(direction));
        (radiance, radiance.element_sum().max(0.0) / self.energy())
    }

    /// A direction in the world by the map's energy.
    fn direction(&self, u: DVec2) -> DVec3 {
        let (width, height) = (self.map.width(), self.map.height());
        let (y, v) = inverted(&self.rows, u.x);
        let (x, across) = inverted(&self.columns[y * (width + 1)..][..=width], u.y);
        // Uniform over the solid angle of the pixel: in the cosine of the polar angle.
        let [above, below] = [y, y + 1].map(|row| (PI * row as f64 / height as f64).cos());
        let polar = (above + (below - above) * v).clamp(-1.0, 1.0).acos();
        self.rotation.to_world(direction_of((x as f64 + across) / width as f64, polar * FRAC_1_PI))
    }
}

/// The step of ascending sums in which a fraction of the last one lies, and where in it.
fn inverted(sums: &[f64], fraction: f64) -> (usize, f64) {
    let wanted = fraction * sums.last().copied().unwrap_or(0.0);
    let step = sums.partition_point(|sum| *sum <= wanted).clamp(1, sums.len() - 1) - 1;
    let width = sums[step + 1] - sums[step];
    (step, if width > 0.0 { ((wanted - sums[step]) / width).clamp(0.0, 1.0) } else { 0.5 })
}

impl MatteLights {
    /// Prepares the lights; `origin_mm` is the world position of the mesh's local origin.
    pub(super) fn new(lights: &[Light], origin_mm: DVec3, samples_per_pixel: u32) -> Self {
        let samples = PixelSamples::new(samples_per_pixel.saturating_mul(POINTS as u32));
        let mut all =
            Self { sharp: Vec::new(), rectangles: Vec::new(), constant: DVec3::ZERO, skies: Vec::new(), samples };
        for light in lights {
            all.sharp.extend(Sharp::new(light, origin_mm));
            all.rectangles.extend(Rectangle::new(light, origin_mm));
            match light {
                Light::Constant { radiance } => all.constant += *radiance,
                Light::Environment { map, rotate_degrees, scale } => {
                    all.skies.push(Sky::new(map, *rotate_degrees, *scale));
                }
                Light::Directional { .. } | Light::Point { .. } | Light::Spot { .. } | Light::Area { .. } => {}
            }
        }
        all.skies.retain(|sky| sky.energy() > 0.0);
        all
    }

    /// Irradiance at spots, which are in the order of their pixels.
    pub(super) fn irradiance(&self, bvh: &Bvh, spots: &[MattePoint], rays: &mut ShadowRays) -> Vec<Irradiance> {
        let mut out = vec![Irradiance::default(); spots.len()];
        for light in &self.sharp {
            for (index, spot) in spots.iter().enumerate() {
                let (to_light, distance, irradiance) = light.seen_from(spot.at_mm);
                if distance > 0.0 {
                    let gain = spot.cosine(to_light) * irradiance;
                    spot.look((index, &mut out), rays, (to_light, distance), gain);
                }
            }
            rays.resolve(bvh, |index, gain| out[index].lit += gain);
        }
        if self.rectangles.is_empty() && self.skies.is_empty() && self.constant == DVec3::ZERO {
            return out;
        }
        for (first, of_pixel) in by_pixel(spots) {
            let pixel = of_pixel[0].pixel;
            let own: Vec<DVec2> = self.samples.of_pixel(Stream::MatteLight, pixel).collect();
            let diffuse: Vec<DVec2> = self.samples.of_pixel(Stream::MatteLobe, pixel).collect();
            for (index, spot) in of_pixel.iter().enumerate() {
                let points = POINTS * spot.sample as usize..POINTS * (spot.sample as usize + 1);
                for (own, diffuse) in own[points.clone()].iter().zip(&diffuse[points]) {
                    self.sample(first + index, spot, [*own, *diffuse], rays, &mut out);
                }
            }
            rays.resolve(bvh, |index, gain| out[index].lit += gain);
        }
        out
    }

    /// Adds one point of each extended light.
    fn sample(
        &self,
        index: usize,
        spot: &MattePoint,
        [own, diffuse]: [DVec2; 2],
        rays: &mut ShadowRays,
        out: &mut [Irradiance],
    ) {
        let share = 1.0 / POINTS as f64;
        for light in &self.rectangles {
            if (spot.at_mm - light.corner).dot(light.normal) <= 0.0 {
                continue;
            }
            let [u, v] = light.edges;
            let seen = SphericalRectangle::new(spot.at_mm, light.corner, u, v, light.lengths);
            let solid_angle = seen.solid_angle();
            let offset = seen.sample(own.x, own.y) - spot.at_mm;
            let distance = offset.length();
            if solid_angle > 0.0 && distance > 0.0 {
                let to_light = offset / distance;
                let gain = light.radiance * (share * solid_angle * spot.cosine(to_light));
                spot.look((index, &mut *out), rays, (to_light, distance), gain);
            }
        }
        let to_light = spot.diffuse(diffuse);
        // Cosine over density is pi.
        let mut afar = self.constant * PI;
        let density = spot.normal.dot(to_light).max(0.0) * FRAC_1_PI;
        for sky in &self.skies {
            let (radiance, of_sky) = sky.seen(to_light);
            afar += radiance * (PI * density / (density + of_sky).max(f64::MIN_POSITIVE));
        }
        if spot.geometric.dot(to_light) > 0.0 {
            spot.look((index, &mut *out), rays, (to_light, f64::INFINITY), afar * share);
        }
        for sky in &self.skies {
            let to_light = sky.direction(own);
            let cosine = spot.cosine(to_light);
            let (radiance, of_sky) = sky.seen(to_light);
            let density = of_sky + spot.normal.dot(to_light).max(0.0) * FRAC_1_PI;
            if cosine > 0.0 && of_sky > 0.0 {
                spot.look((index, &mut *out), rays, (to_light, f64::INFINITY), radiance * (share * cosine / density));
            }
        }
    }
}

/// Runs of spots of one pixel, each with the index of its first.
fn by_pixel(spots: &[MattePoint]) -> impl Iterator<Item = (usize, &[MattePoint])> {
    let mut first = 0;
    spots.chunk_by(|a, b| a.pixel == b.pixel).map(move |run| {
        first += run.len();
        (first - run.len(), run)
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::geometry::mesh::{Mesh, Placement};
    use crate::geometry::shapes;

    /// A ball of radius 1 at the origin.
    fn ball() -> Bvh {
        let mesh = Mesh::from_source(shapes::icosphere(1.0, 4), &Placement { mm_per_unit: 1.0 }).unwrap().0;
        Bvh::new(&mesh)
    }

    /// Mean irradiance at a point of the plane y = -1, over some pixels.
    fn mean(lights: &[Light], at: DVec3, pixels: u64) -> Irradiance {
        let lights = MatteLights::new(lights, DVec3::ZERO, 4);
        let spot = |i: u64| MattePoint {
            at_mm: at,
            triangle: u32::MAX,
            geometric: DVec3::Y,
            normal: DVec3::Y,
            pixel: i / 4,
            sample: (i % 4) as u32,
        };
        let spots: Vec<MattePoint> = (0..4 * pixels).map(spot).collect();
        let all = lights.irradiance(&ball(), &spots, &mut ShadowRays::default());
        let share = 1.0 / all.len() as f64;
        all.iter().fold(Irradiance::default(), |sum, one| Irradiance {
            lit: sum.lit + share * one.lit,
            open: sum.open + share * one.open,
        })
    }

    #[test]
    fn irradiance_on_a_plane_is_the_closed_form_and_the_ball_hides_its_share() {
        let point = DVec3::new(2.0, -1.0, 0.0);
        let distance = (point - DVec3::ZERO).length();
        // A ball at angle theta from the normal, whole above the horizon: its form factor is cos(theta) (r / d)^2.
        let hidden = (1.0 / distance) * (1.0 / distance).powi(2);
        let map = EnvironmentMap::new(16, 8, vec![[1.0, 2.0, 0.5]; 128]).unwrap();
        let sky = Light::Environment { map: Arc::new(map), rotate_degrees: 30.0, scale: DVec3::ONE };
        let constant = Light::Constant { radiance: DVec3::new(1.0, 2.0, 0.5) };
        for light in [constant, sky] {
            let Irradiance { lit, open } = mean(&[light], point, 400);
            let colour = DVec3::new(1.0, 2.0, 0.5) * PI;
            assert!((open / colour - 1.0).abs().max_element() < 0.01, "{open}");
            assert!((lit / colour - (1.0 - hidden)).abs().max_element() < 0.01, "{lit} {hidden}");
        }
    }

    #[test]
    fn a_sun_in_a_map_lights_as_a_sun() {
        // One bright pixel, 30 degrees and more above the horizon.
        let (width, height) = (64, 32);
        let mut pixels = vec![[0.0; 3]; width * height];
        pixels[10 * width + 40] = [1000.0; 3];
        let map = EnvironmentMap::new(width, height, pixels).unwrap();
        let (towards, solid_angle) = (map.pixel_direction(40, 10), map.pixel_solid_angle_sr(10));
        let sky = Light::Environment { map: Arc::new(map), rotate_degrees: 0.0, scale: DVec3::ONE };
        let far = DVec3::new(40.0, -1.0, 0.0);
        let Irradiance { lit, open } = mean(std::slice::from_ref(&sky), far, 200);
        let expected = 1000.0 * solid_angle * towards.y;
        assert!((open / expected - 1.0).abs().max_element() < 0.01 && lit == open, "{open} {expected}");
        // In the ball's shadow, and of a directional light from there.
        let shaded = -towards / towards.y;
        assert_eq!(mean(&[sky], shaded, 20).lit, DVec3::ZERO);
        let sun = Light::Directional { from: towards, irradiance: DVec3::ONE };
        let Irradiance { lit, open } = mean(std::slice::from_ref(&sun), shaded, 1);
        assert!(lit == DVec3::ZERO && (open - towards.y).abs().max_element() < 1e-12);
        assert_eq!(mean(&[sun], far, 1).lit, open);
    }

    #[test]
    fn rectangles_and_points_light_by_their_distance() {
        let at = DVec3::new(5.0, -1.0, 0.0);
        let lamp = DVec3::new(5.0, 9.0, 0.0);
        let area = Light::area(lamp, -DVec3::Y, [0.1, 0.1], DVec3::ONE, None).unwrap();
        let point = Light::Point { at_mm: lamp, intensity: DVec3::splat(0.01) };
        for light in [area, point] {
            let found = mean(&[light], at, 4);
            assert!((found.lit / 1e-4 - 1.0).abs().max_element() < 1e-3 && found.lit == found.open, "{found:?}");
        }
    }
}
