//! Irradiance of the samples under a set of lights: E = Int L V F_t(eta, n.w) max(0, n.w) dw, shadows by ray casting.

use std::f64::consts::{PI, TAU};

use glam::DVec3;
use rayon::prelude::*;

use super::scene::Surface;
use crate::error::Result;
use crate::geometry::bvh::{Ray, offset_origin};
use crate::geometry::samples::{Facet, area, bisect};
use crate::light::Light;
use crate::light::environment::Rotation;
use crate::light::strata::{Candidate, Strata, StrataSettings};
use crate::math::random::{bits, radical_inverse_2, uniform};
use crate::math::spherical_rectangle::SphericalRectangle;
use crate::medium::fresnel::{self, CosineTransmittance};
use crate::progress::Progress;

/// How finely lights and shadows are sampled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightSampling {
    /// Points of a patch that see a directional or a point light, a power of two.
    pub points_per_patch: u32,
    /// Directions of a constant light and strata of an environment, for each patch.
    pub directions: u32,
    /// Strata of an area light along each edge, for each patch.
    pub area_side: u32,
}

impl LightSampling {
    /// For the truth.
    pub const REFERENCE: Self = Self { points_per_patch: 16, directions: 512, area_side: 16 };
    /// Shadow boundaries to a quarter of a patch, soft light to about 1 % of each patch, which scattering averages.
    pub const FAST: Self = Self { points_per_patch: 4, directions: 256, area_side: 8 };
}

/// Seeds of the stages that draw numbers.
const STAGE_CONSTANT: u64 = 1;
const STAGE_AREA: u64 = 2;
const STAGE_ENVIRONMENT: u64 = 3;

/// A point light comes no nearer to a sample than the square root of this, so that E stays finite.
const LEAST_DISTANCE2_MM2: f64 = 1e-30;

/// Irradiance at most: its sums over a surface stay finite.
const MOST: f64 = 1e280;

/// Candidate directions in each stratum of an environment.
const CANDIDATES: usize = 64;

/// Strata with more than this share of an environment's energy are seen from every point of a patch.
const BRIGHT_SHARE: f64 = 0.02;

/// A light with what all patches share precomputed.
enum Prepared<'a> {
    Constant { radiance: DVec3 },
    Directional { from: DVec3, irradiance: DVec3 },
    Point { at: DVec3, intensity: DVec3 },
    Area(&'a Light),
    Environment { strata: Vec<StratumRays> },
}

/// Directions of one stratum of an environment.
struct StratumRays {
    candidates: Vec<Candidate>,
    /// Whether every point of a patch looks there: a sun's shadow is as sharp as a directional light's.
    points: PointsUsed,
}

/// Which points of a patch look at a stratum.
#[derive(Clone, Copy, PartialEq)]
enum PointsUsed {
    One,
    All,
}

/// A point of a patch.
#[derive(Clone, Copy, Debug, Default)]
struct SurfacePoint {
    at: DVec3,
    normal: DVec3,
    triangle: u32,
}

/// Lights prepared for a surface.
pub struct Illumination<'a> {
    surface: &'a Surface<'a>,
    lights: Vec<Prepared<'a>>,
    sampling: LightSampling,
    entrance: Vec<(f64, CosineTransmittance)>,
}

impl<'a> Illumination<'a> {
    /// Prepares lights; `etas` is the relative index of refraction of each medium of the scene.
    ///
    /// # Errors
    /// A sampling that environments do not take.
    pub fn new(surface: &'a Surface<'a>, lights: &'a [Light], etas: &[f64], sampling: LightSampling) -> Result<Self> {
        let origin = surface.scene.mesh.origin_mm;
        let prepare = |light: &'a Light| -> Result<Prepared<'a>> {
            Ok(match light {
                Light::Constant { radiance } => Prepared::Constant { radiance: *radiance },
                Light::Directional { from, irradiance } => {
                    Prepared::Directional { from: *from, irradiance: *irradiance }
                }
                Light::Point { at_mm, intensity } => Prepared::Point { at: *at_mm - origin, intensity: *intensity },
                Light::Area { .. } => Prepared::Area(light),
                Light::Environment { map, rotate_degrees, scale } => {
                    let settings = StrataSettings { strata: sampling.directions as usize, candidates: CANDIDATES };
                    let strata = Strata::new(map, settings)?;
                    let rotation = Rotation::from_degrees(*rotate_degrees);
                    let turned = |c: &Candidate| Candidate {
                        direction: rotation.to_world(c.direction),
                        weight: c.weight * *scale,
                    };
                    let total = strata.energy().element_sum();
                    let rays = strata.strata().iter().enumerate().map(|(i, stratum)| {
                        let share = stratum.energy.element_sum() / total;
                        StratumRays {
                            candidates: strata.candidates(i).iter().map(turned).collect(),
                            points: if share > BRIGHT_SHARE { PointsUsed::All } else { PointsUsed::One },
                        }
                    });
                    Prepared::Environment { strata: rays.collect() }
                }
            })
        };
        Ok(Self {
            surface,
            lights: lights.iter().map(prepare).collect::<Result<_>>()?,
            sampling,
            entrance: etas.iter().map(|&eta| (eta, CosineTransmittance::new(eta))).collect(),
        })
    }

    /// Irradiance of every patch, RGB.
    pub fn all(&self, progress: &dyn Progress) -> Vec<DVec3> {
        const CHUNK: usize = 256;
        let count = self.surface.samples.len();
        progress.start("irradiance", count as u64);
        let mut result = vec![DVec3::ZERO; count];
        result.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, out)| {
            self.range(chunk * CHUNK, out);
            progress.advance(out.len() as u64);
        });
        progress.finish();
        result
    }

    /// Irradiance of the patches from `first` on.
    pub fn range(&self, first: usize, out: &mut [DVec3]) {
        let mut part = self.surface.samples.part_offsets.partition_point(|&p| p as usize <= first).saturating_sub(1);
        let mut points = Vec::new();
        for (i, e) in out.iter_mut().enumerate() {
            let patch = first + i;
            while patch >= self.surface.samples.part(part).end {
                part += 1;
            }
            points.clear();
            self.points_of(patch, &mut points);
            let medium = self.surface.scene.parts.parts[part].medium.unwrap_or(0) as usize;
            let sum: DVec3 = self.lights.iter().map(|light| self.irradiance(light, medium, patch, &points)).sum();
            *e = sum.min(DVec3::splat(MOST));
        }
    }

    fn irradiance(&self, light: &Prepared, medium: usize, patch: usize, points: &[SurfacePoint]) -> DVec3 {
        let eta = self.entrance[medium].0;
        match light {
            Prepared::Constant { radiance } => *radiance * self.constant(medium, patch, points),
            Prepared::Directional { from, irradiance } => {
                let total: f64 = points.iter().map(|p| self.direct(p, *from, f64::INFINITY, eta)).sum();
                *irradiance * (total / points.len() as f64)
            }
            Prepared::Point { at, intensity } => {
                let total: f64 = points
                    .iter()
                    .map(|p| {
                        let (d, distance) = ((*at - p.at).normalize_or_zero(), at.distance(p.at));
                        self.direct(p, d, distance, eta) / (distance * distance).max(LEAST_DISTANCE2_MM2)
                    })
                    .sum();
                *intensity * (total / points.len() as f64)
            }
            Prepared::Area(light) => self.area(light, eta, patch, points),
            Prepared::Environment { strata } => self.environment(strata, eta, patch, points),
        }
    }

    /// F_t cos of one direction, zero in shadow.
    fn direct(&self, p: &SurfacePoint, to_light: DVec3, distance: f64, eta: f64) -> f64 {
        let cosine = p.normal.dot(to_light);
        if cosine <= 0.0 {
            return 0.0;
        }
        let arriving = fresnel::transmittance(eta, cosine) * cosine;
        if arriving > 0.0 && self.visible(p, to_light, distance) { arriving } else { 0.0 }
    }

    fn visible(&self, p: &SurfacePoint, direction: DVec3, distance: f64) -> bool {
        let ray = Ray {
            origin: offset_origin(p.at.as_vec3(), p.normal.as_vec3()),
            direction: direction.as_vec3(),
            t_min: 0.0,
            t_max: distance as f32,
        };
        !self.surface.bvh.occluded(&ray, p.triangle)
    }

    /// Int V F_t cos: directions with density F_t cos, so that only visibility varies.
    fn constant(&self, medium: usize, patch: usize, points: &[SurfacePoint]) -> f64 {
        let (_, entrance) = &self.entrance[medium];
        let count = self.sampling.directions;
        let (turn_u, turn_v) = (uniform(STAGE_CONSTANT, patch as u64, 0), uniform(STAGE_CONSTANT, patch as u64, 1));
        let mut seen = 0u32;
        for k in 0..count {
            let p = &points[k as usize % points.len()];
            let mu = entrance.sample_entrance_cosine((f64::from(k) + turn_u) / f64::from(count));
            let azimuth = TAU * (radical_inverse_2(k) + turn_v);
            seen += u32::from(self.visible(p, around(p.normal, mu, azimuth), f64::INFINITY));
        }
        PI * entrance.diffuse_transmittance() * f64::from(seen) / f64::from(count)
    }

    fn area(&self, light: &Light, eta: f64, patch: usize, points: &[SurfacePoint]) -> DVec3 {
        let Light::Area { at_mm, normal, u, size_mm, radiance } = light else { return DVec3::ZERO };
        let v = normal.cross(*u);
        let centre = *at_mm - self.surface.scene.mesh.origin_mm;
        let corner = centre - 0.5 * size_mm[0] * *u - 0.5 * size_mm[1] * v;
        let side = self.sampling.area_side;
        let mut total = 0.0;
        for (index, p) in points.iter().enumerate() {
            if (p.at - centre).dot(*normal) <= 0.0 {
                continue;
            }
            let rectangle = SphericalRectangle::new(p.at, corner, *u, v, *size_mm);
            let mut sum = 0.0;
            let mut cells = 0;
            for cell in (index as u32..side * side).step_by(points.len()) {
                let key = patch as u64 * u64::from(side * side) + u64::from(cell);
                let s = (f64::from(cell % side) + uniform(STAGE_AREA, key, 0)) / f64::from(side);
                let t = (f64::from(cell / side) + uniform(STAGE_AREA, key, 1)) / f64::from(side);
                let to_light = rectangle.sample(s, t) - p.at;
                let distance = to_light.length();
                sum += self.direct(p, to_light / distance.max(f64::MIN_POSITIVE), distance, eta);
                cells += 1;
            }
            total += sum * rectangle.solid_angle() / f64::from(cells.max(1));
        }
        *radiance * (total / points.len() as f64)
    }

    fn environment(&self, strata: &[StratumRays], eta: f64, patch: usize, points: &[SurfacePoint]) -> DVec3 {
        let turn = (patch as u32).reverse_bits() >> (32 - CANDIDATES.ilog2());
        let mut total = DVec3::ZERO;
        for (stratum, rays) in strata.iter().enumerate() {
            // Neighbouring patches take different candidates of each stratum; scattering averages over them.
            let shift = bits(STAGE_ENVIRONMENT, stratum as u64, 0) as usize;
            let candidate = |k: usize| rays.candidates[(turn as usize ^ shift ^ k) & (CANDIDATES - 1)];
            if rays.points == PointsUsed::All {
                let share = 1.0 / points.len() as f64;
                for (k, p) in points.iter().enumerate() {
                    let Candidate { direction, weight } = candidate(k);
                    total += weight * (share * self.direct(p, direction, f64::INFINITY, eta));
                }
                continue;
            }
            let p = &points[stratum % points.len()];
            let Candidate { direction, weight } = candidate(0);
            total += weight * self.direct(p, direction, f64::INFINITY, eta);
        }
        total
    }

    /// Points that stand for equal areas of a patch.
    fn points_of(&self, patch: usize, out: &mut Vec<SurfacePoint>) {
        let mesh = &self.surface.scene.mesh;
        let facets = self.surface.samples.patch(patch);
        let count = self.sampling.points_per_patch.next_power_of_two();
        if let [facet] = facets {
            let normal = mesh.cross_mm2(facet.triangle).normalize_or_zero();
            let centroid = |corners: [DVec3; 3]| corners.iter().sum::<DVec3>() / 3.0;
            pieces(facet.corners_local_mm(mesh), count, &mut |corners| {
                out.push(SurfacePoint { at: centroid(corners), normal, triangle: facet.triangle });
            });
            return;
        }
        let areas: Vec<f64> = facets.iter().map(|f| area(f.corners_local_mm(mesh))).collect();
        let total: f64 = areas.iter().sum();
        let (mut index, mut passed) = (0, 0.0);
        for k in 0..count.max(facets.len().min(16) as u32) {
            let wanted = total * (f64::from(k) + 0.5) / f64::from(count.max(facets.len().min(16) as u32));
            while index + 1 < facets.len() && passed + areas[index] < wanted {
                passed += areas[index];
                index += 1;
            }
            let Facet { triangle, .. } = facets[index];
            let corners = facets[index].corners_local_mm(mesh);
            let normal = mesh.cross_mm2(triangle).normalize_or_zero();
            out.push(SurfacePoint { at: corners.iter().sum::<DVec3>() / 3.0, normal, triangle });
        }
    }
}

/// Visits `count` (a power of two) congruent-area pieces of a triangle.
fn pieces(corners: [DVec3; 3], count: u32, visit: &mut impl FnMut([DVec3; 3])) {
    if count <= 1 {
        visit(corners);
        return;
    }
    for half in bisect(corners) {
        pieces(half, count / 2, visit);
    }
}

/// The direction at cosine `mu` and azimuth around an axis.
fn around(axis: DVec3, mu: f64, azimuth: f64) -> DVec3 {
    let (t, b) = axis.any_orthonormal_pair();
    let radius = (1.0 - mu * mu).max(0.0).sqrt();
    axis * mu + t * (radius * azimuth.cos()) + b * (radius * azimuth.sin())
}

#[cfg(test)]
#[path = "irradiance_tests.rs"]
mod tests;
