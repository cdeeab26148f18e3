//! Entrance of photons into a scene: points uniform over the surface, directions by the light, weights by irradiance.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

use super::boundary::MeshBoundary;
use super::walk::{Start, Stream};
use crate::error::Result;
use crate::geometry::bvh::{Bvh, Ray, offset_origin};
use crate::geometry::mesh::Mesh;
use crate::light::strata::StrataSettings;
use crate::light::{Light, refuse_fields};
use crate::medium::fresnel::{self, CosineTransmittance};
use crate::transport::domain::Domain;
use crate::transport::prepared_light::{LEAST_DISTANCE2_MM2, Prepared, Stratum};

/// Cut of an environment: 2^18 directions, each with the energy around it.
const ENVIRONMENT: StrataSettings = StrataSettings { strata: 4096, candidates: 64 };

/// Cells of the space-filling curve along the longest side of the bounding box.
const CURVE_CELLS: f64 = 65_535.0;

/// A photon that may enter.
#[derive(Clone, Copy, Debug)]
pub struct Candidate {
    /// Place and direction in which it would start.
    pub start: Start,
    /// Part that it enters.
    pub part: u32,
    /// Irradiance behind the surface that it stands for where nothing is in the way, RGB: its mean over candidates is the mean
    /// irradiance of the unshadowed surface.
    pub irradiance: DVec3,
    shadow: Ray,
    triangle: u32,
}

/// A light, an environment as its strata and the energy up to and including each.
type Source = Prepared<(Vec<Stratum>, Vec<f64>)>;

/// The strata of an environment and the energy up to and including each.
fn cumulated(strata: Vec<Stratum>, _: f64) -> (Vec<Stratum>, Vec<f64>) {
    let energy_so_far = |sum: &mut f64, stratum: &Stratum| {
        *sum += stratum.energy;
        Some(*sum)
    };
    let cumulative = strata.iter().scan(0.0, energy_so_far).collect();
    (strata, cumulative)
}

/// Light towards a point: its direction, its distance, and the irradiance behind the surface over the entrance's
/// `F_t cos`, or including it.
struct Arrival {
    towards: DVec3,
    distance: f64,
    gain: DVec3,
    includes_entrance: bool,
}

/// The lit surface of a scene.
pub struct Entries<'a> {
    domain: Domain<'a>,
    bvh: &'a Bvh,
    sources: Vec<Source>,
    entrance: Vec<CosineTransmittance>,
    /// Triangles of parts that transfer, part after part and along a curve that keeps neighbours together (photons that
    /// follow each other then walk through the same memory), and the area up to and including each.
    triangles: Vec<u32>,
    cumulative_mm2: Vec<f64>,
}

impl<'a> Entries<'a> {
    /// Prepares the lit surface; `bvh` holds the occluders, all triangles of the scene.
    ///
    /// # Errors
    /// Those of cutting an environment; a light that asks for a source radiance field (exit 5).
    pub fn new(domain: Domain<'a>, bvh: &'a Bvh, lights: &[Light]) -> Result<Self> {
        refuse_fields(lights)?;
        let part_of = |t: u32| domain.parts.triangle_part.get(t as usize).copied().unwrap_or(u32::MAX);
        let transfers = |t: &u32| domain.parts.parts.get(part_of(*t) as usize).is_some_and(|p| p.transfers());
        let bounds = domain.mesh.bounds_local_mm();
        let mut triangles: Vec<u32> = (0..domain.mesh.triangles.len() as u32).filter(transfers).collect();
        triangles.sort_by_cached_key(|&t| (part_of(t), along_curve(domain.mesh, bounds, t)));
        let area_so_far = |sum: &mut f64, &t: &u32| {
            *sum += domain.mesh.area_mm2(t);
            Some(*sum)
        };
        let cumulative_mm2 = triangles.iter().scan(0.0, area_so_far).collect();
        let prepare = |light| Source::new(light, domain.mesh.origin_mm, ENVIRONMENT, cumulated);
        let sources = lights.iter().map(prepare).collect::<Result<_>>()?;
        let eta = |m: &crate::medium::material::Medium| m.properties.eta_inside_over_outside;
        let entrance = domain.media.iter().map(|m| CosineTransmittance::new(eta(m))).collect();
        Ok(Self { domain, bvh, sources, entrance, triangles, cumulative_mm2 })
    }

    /// Area that light can enter through, mm^2.
    pub fn area_mm2(&self) -> f64 {
        self.cumulative_mm2.last().copied().unwrap_or(0.0)
    }

    /// The candidate at the fraction `along` (in [0, 1)) of the area; none where no light arrives.
    pub fn candidate(&self, along: f64, stream: &mut Stream) -> Option<Candidate> {
        let wanted = along * self.area_mm2();
        let index = self.cumulative_mm2.partition_point(|&a| a <= wanted).min(self.triangles.len().checked_sub(1)?);
        let triangle = self.triangles[index];
        let normal = self.domain.mesh.normal(triangle);
        let [a, b, c] = self.domain.mesh.corners_local_mm(triangle);
        let (r, s) = (stream.uniform().sqrt(), stream.uniform());
        let at = a * (1.0 - r) + b * (r * (1.0 - s)) + c * (r * s);
        let part = *self.domain.parts.triangle_part.get(triangle as usize)?;
        let medium = self.domain.parts.parts.get(part as usize)?.medium? as usize;
        let entrance = self.entrance.get(medium)?;
        let choice = (stream.uniform() * self.sources.len() as f64) as usize;
        let arrival = arrival(self.sources.get(choice)?, at, normal, entrance, stream)?;
        let (eta, cosine) = (entrance.eta_inside_over_outside(), arrival.towards.dot(normal));
        let cos_inside = fresnel::refracted_cosine(eta, cosine)?;
        let entering = if arrival.includes_entrance { 1.0 } else { fresnel::transmittance(eta, cosine) * cosine };
        let direction = -((arrival.towards - cosine * normal) / eta + cos_inside * normal).normalize_or_zero();
        let shadow = Ray {
            origin: offset_origin(at.as_vec3(), normal.as_vec3()),
            direction: arrival.towards.as_vec3(),
            t_min: 0.0,
            t_max: arrival.distance as f32,
        };
        let irradiance = arrival.gain * (entering * self.sources.len() as f64);
        let start = Start { at_mm: MeshBoundary::just_inside(at, normal), direction };
        (irradiance.max_element() > 0.0).then_some(Candidate { start, part, irradiance, shadow, triangle })
    }

    /// True if nothing is between a candidate and its light.
    pub fn is_lit(&self, candidate: &Candidate) -> bool {
        !self.bvh.occluded(&candidate.shadow, candidate.triangle)
    }
}

/// Position of a triangle's first corner along a space-filling curve through the bounding box (Morton's).
pub(in crate::transport) fn along_curve(mesh: &Mesh, [low, high]: [DVec3; 2], triangle: u32) -> u64 {
    let [corner, ..] = mesh.corners_local_mm(triangle);
    let scaled = (corner - low) * (CURVE_CELLS / (high - low).max_element().max(f64::MIN_POSITIVE));
    let spread = |x: f64| (0..16).fold(0, |code, bit| code | (x as u64 >> bit & 1) << (3 * bit));
    spread(scaled.x) | spread(scaled.y) << 1 | spread(scaled.z) << 2
}

/// A direction of a light for a point; none where it does not reach the front.
fn arrival(
    source: &Source,
    at: DVec3,
    normal: DVec3,
    entrance: &CosineTransmittance,
    stream: &mut Stream,
) -> Option<Arrival> {
    let plain = |towards, distance, gain| Arrival { towards, distance, gain, includes_entrance: false };
    let arrival = match source {
        Source::Constant { radiance } => {
            let mu = entrance.sample_entrance_cosine(stream.uniform());
            let (sin, cos) = (TAU * stream.uniform()).sin_cos();
            let (t, b) = normal.any_orthonormal_pair();
            let towards = mu * normal + (1.0 - mu * mu).max(0.0).sqrt() * (cos * t + sin * b);
            let gain = *radiance * (PI * entrance.diffuse_transmittance());
            Arrival { towards, distance: f64::INFINITY, gain, includes_entrance: true }
        }
        Source::Directional { from, irradiance } => plain(*from, f64::INFINITY, *irradiance),
        Source::Point { at: light, intensity, falloff } => {
            let way = *light - at;
            let square = way.length_squared().max(LEAST_DISTANCE2_MM2);
            let towards = way.normalize_or_zero();
            plain(towards, square.sqrt(), *intensity * (falloff.at(towards) / square))
        }
        Source::Area(light) => {
            let rectangle = light.seen_from(at)?;
            let way = rectangle.sample(stream.uniform(), stream.uniform()) - at;
            plain(way.normalize_or_zero(), way.length(), light.radiance * rectangle.solid_angle())
        }
        Source::Environment((strata, cumulative)) => {
            let total = cumulative.last().copied().filter(|total| *total > 0.0)?;
            let wanted = stream.uniform() * total;
            let index = cumulative.partition_point(|&e| e <= wanted).min(cumulative.len() - 1);
            let Stratum { candidates, energy } = strata.get(index)?;
            let candidate = candidates.get((stream.uniform() * candidates.len() as f64) as usize)?;
            plain(candidate.direction, f64::INFINITY, candidate.weight / (energy / total))
        }
    };
    (arrival.towards.dot(normal) > 0.0 && arrival.gain.is_finite()).then_some(arrival)
}

#[cfg(test)]
#[path = "entry_tests.rs"]
mod tests;
