//! Single scattering under lights at points of the surface, by samples along the path inside.

use std::f64::consts::{FRAC_1_PI, PI, TAU};

use glam::DVec3;

use super::depths::{self, Density, Depth};
use super::interface::Form;
use super::interior::{Coefficients, Crossings, ExitPoint, Interior, Optics, inside_towards};
use super::radiosity_factor;
use crate::error::{Error, Result};
use crate::geometry::bvh::Bvh;
use crate::light::Light;
use crate::light::strata::StrataSettings;
use crate::math::random::{radical_inverse_2, uniform};
use crate::medium::fresnel::transmittance;
use crate::medium::phase::HenyeyGreenstein;
use crate::parallel::*;
use crate::progress::Progress;
use crate::transport::domain::Domain;
use crate::transport::irradiance::around;
use crate::transport::prepared_light::{Prepared, Rectangle, Stratum};

/// Choice of distances along the path.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum DepthSampling {
    /// Stratified at random, drawn from a density.
    Random(u32, Density),
    /// The paper's `xi = (i - 0.5) / N` by the luminance.
    Deterministic(u32),
}

/// The direction of the path inside.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Path {
    /// Along the refracted direction of the eye.
    #[default]
    Refracted,
    /// Along the inverse normal, whatever the eye: the approximation that can be baked.
    InverseNormal,
}

/// Settings of single scattering.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// The integrand.
    pub form: Form,
    /// Surfaces between the point where light enters and the light.
    pub crossings: Crossings,
    /// Coefficients and phase function: reduced and isotropic, or the medium's own.
    pub coefficients: Coefficients,
    /// Distances along the path, for each directional and point light.
    pub depths: DepthSampling,
    /// Directions of each constant, area and environment light, with a distance each.
    pub directions: u32,
}

impl Settings {
    /// The settings of the truth: 128 distances, 2048 directions.
    pub const REFERENCE: Self = Self {
        form: Form::Physical,
        crossings: Crossings::Occluded,
        coefficients: Coefficients::Reduced,
        depths: DepthSampling::Random(128, Density::Channels),
        directions: 2048,
    };
    /// The paper's settings: 16 deterministic distances.
    pub const PAPER: Self = Self { depths: DepthSampling::Deterministic(16), ..Self::REFERENCE };
}

/// A part of the samples of an answer: the mean over all parts, each with a key of its own, is as good as the whole.
///
/// The eye rays of a pixel share the samples of the pixel: strata of distances and directions are dealt out among them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Share {
    index: u32,
    of: u32,
}

impl Share {
    /// All samples.
    pub const WHOLE: Self = Self { index: 0, of: 1 };

    /// One of `of` parts, at least one; every number is brought into the range.
    pub fn new(index: u32, of: u32) -> Self {
        let of = of.max(1);
        Self { index: index % of, of }
    }

    /// The strata of this part, of `count` or so many more that every part has as many.
    fn strata(self, count: u32) -> (impl ExactSizeIterator<Item = u32>, u32) {
        let all = count.max(1).next_multiple_of(self.of);
        ((self.index..all).step_by(self.of as usize), all)
    }
}

/// Candidate directions in each stratum of an environment.
const CANDIDATES: usize = 64;

/// Share of the directions of a constant light that come from the cosine around the normal; the rest from the sphere.
const FROM_COSINE: f64 = 0.75;

/// Points of one task.
const CHUNK: usize = 16;

const STAGE_DEPTH: u64 = 0x51_0001;
const STAGE_DIRECTION: u64 = 0x51_0002;

/// Single scattering of a scene under some lights.
pub struct SingleScattering<'a> {
    interior: Interior<'a>,
    lights: Vec<Prepared<Vec<Stratum>>>,
    settings: Settings,
}

/// The path inside below one point.
struct Line<'a> {
    point: &'a ExitPoint,
    optics: &'a Optics,
    start: DVec3,
    direction: DVec3,
    reach_mm: f64,
    phase: HenyeyGreenstein,
    /// Direction `w_o'` inside, outward.
    towards_eye: DVec3,
    key: u64,
    share: Share,
    dense: bool,
}

impl<'a> SingleScattering<'a> {
    /// Prepares lights.
    ///
    /// # Errors
    /// No sample or no direction at all; an environment that cannot be cut (exit 3).
    pub fn new(domain: Domain<'a>, bvh: &'a Bvh, lights: &[Light], settings: Settings) -> Result<Self> {
        let (DepthSampling::Random(samples, _) | DepthSampling::Deterministic(samples)) = settings.depths;
        if samples == 0 || settings.directions == 0 {
            return Err(Error::input("single scattering needs at least one sample along the path and one direction"));
        }
        let origin = domain.mesh.origin_mm;
        let cut = StrataSettings { strata: settings.directions as usize, candidates: CANDIDATES };
        let prepare = |light| Prepared::new(light, origin, cut, |strata, _| strata);
        let interior = Interior::new(domain, bvh, settings.form, settings.crossings, settings.coefficients);
        Ok(Self { interior, lights: lights.iter().map(prepare).collect::<Result<_>>()?, settings })
    }

    /// `L1(x_o, w_o)` towards a unit vector, RGB. `key` numbers the point and turns its random numbers; the samples of a pixel
    /// need different ones. 0 behind the surface and where the part has no medium.
    pub fn radiance(&self, point: &ExitPoint, to_eye: DVec3, path: Path, key: u64) -> DVec3 {
        self.share_of_radiance(point, to_eye, path, key, Share::WHOLE)
    }

    /// [`Self::radiance`] by some of its samples, whose mean over all shares with different keys is unbiased.
    pub fn share_of_radiance(&self, point: &ExitPoint, to_eye: DVec3, path: Path, key: u64, share: Share) -> DVec3 {
        let Some(optics) = self.interior.optics(point.part) else { return DVec3::ZERO };
        let eta = optics.eta_inside_over_outside;
        let Some(towards_eye) = inside_towards(eta, to_eye, point) else { return DVec3::ZERO };
        let along = match path {
            Path::Refracted => -towards_eye,
            Path::InverseNormal => -point.normal,
        };
        let draw = (key, share);
        transmittance(eta, point.normal.dot(to_eye)) * self.before_exit(point, optics, along, towards_eye, draw)
    }

    /// `s = pi C L1 / F_t(w_o)` along the inverse normal, seen from straight above, RGB, in the unit of radiosity.
    pub fn per_point(&self, point: &ExitPoint, key: u64) -> DVec3 {
        let Some(optics) = self.interior.optics(point.part) else { return DVec3::ZERO };
        let factor = radiosity_factor(optics.eta_inside_over_outside);
        factor * self.before_exit(point, optics, -point.normal, point.normal, (key, Share::WHOLE))
    }

    /// [`Self::per_point`] of many points, each numbered by its position.
    pub fn per_points(&self, points: &[ExitPoint], progress: &dyn Progress) -> Vec<DVec3> {
        let numbered: Vec<(u64, ExitPoint)> = (0..).zip(points.iter().copied()).collect();
        self.per_numbered_points(&numbered, progress)
    }

    /// [`Self::per_point`] of many points with their keys.
    pub fn per_numbered_points(&self, points: &[(u64, ExitPoint)], progress: &dyn Progress) -> Vec<DVec3> {
        progress.start("single scattering", points.len() as u64);
        let mut result = vec![DVec3::ZERO; points.len()];
        result.par_chunks_mut(CHUNK).zip(points.par_chunks(CHUNK)).for_each(|(out, points)| {
            for (out, (key, point)) in out.iter_mut().zip(points) {
                *out = self.per_point(point, *key);
            }
            progress.advance(points.len() as u64);
        });
        progress.finish();
        result
    }

    /// Radiance before the exit, `L1 / F_t(w_o)`, RGB.
    fn before_exit(
        &self,
        point: &ExitPoint,
        optics: &Optics,
        direction: DVec3,
        towards_eye: DVec3,
        (key, share): (u64, Share),
    ) -> DVec3 {
        let finite = point.at_mm.is_finite() && point.normal.is_finite() && direction.is_finite();
        if !finite || point.normal == DVec3::ZERO || direction == DVec3::ZERO {
            return DVec3::ZERO;
        }
        let start = self.interior.start(point);
        let dense = self.interior.is_dense(optics);
        let reach_mm = if dense { f64::INFINITY } else { self.interior.reach(start, direction, point.part) };
        let g = match self.settings.coefficients {
            Coefficients::Reduced => 0.0,
            Coefficients::Unreduced => self.medium_g(point.part),
        };
        let phase = HenyeyGreenstein::new(g);
        let line = Line { point, optics, start, direction, reach_mm, phase, towards_eye, key, share, dense };
        let sum: DVec3 = (0u64..).zip(&self.lights).map(|(i, light)| self.of_light(i, light, &line)).sum();
        if sum.is_finite() { sum } else { DVec3::ZERO }
    }

    fn medium_g(&self, part: u32) -> f64 {
        let domain = self.interior.domain;
        let medium = domain.parts.parts.get(part as usize).and_then(|p| p.medium);
        medium.and_then(|m| domain.media.get(m as usize)).map_or(0.0, |m| m.properties.g)
    }

    /// Distances for directional and point lights.
    fn depths(&self, line: &Line) -> Vec<Depth> {
        match self.settings.depths {
            DepthSampling::Deterministic(count) => {
                depths::deterministic(line.optics, line.reach_mm, Density::Luminance, count)
            }
            DepthSampling::Random(count, density) => {
                let (strata, all) = line.share.strata(count);
                let at = |i: u32| (f64::from(i) + uniform(STAGE_DEPTH, line.key, i.into())) / f64::from(all);
                depths::sampled(line.optics, line.reach_mm, density, strata.map(at))
            }
        }
    }

    /// A distance for each of many directions; the paper's distances one after the other where those are asked for.
    fn paired(&self, line: &Line, light: u64, count: usize) -> Vec<Depth> {
        let turn = uniform(STAGE_DEPTH, line.key, 1 << 32 | light);
        let (density, position): (_, Box<dyn Fn(u32) -> f64>) = match self.settings.depths {
            DepthSampling::Random(_, density) => (density, Box::new(|i| (radical_inverse_2(i) + turn).fract())),
            DepthSampling::Deterministic(n) => {
                let cell = move |i: u32| ((radical_inverse_2(i) + turn).fract() * f64::from(n)).floor();
                (Density::Luminance, Box::new(move |i| (cell(i) + 0.5) / f64::from(n)))
            }
        };
        depths::sampled(line.optics, line.reach_mm, density, (0..count as u32).map(position))
    }

    fn of_light(&self, index: u64, light: &Prepared<Vec<Stratum>>, line: &Line) -> DVec3 {
        match light {
            Prepared::Directional { from, irradiance } => {
                let depths = self.depths(line);
                *irradiance * depths.iter().map(|d| self.scattered(line, d, *from, f64::INFINITY).0).sum::<DVec3>()
            }
            Prepared::Point { at, intensity, falloff } => {
                let depths = self.depths(line);
                let of = |d: &Depth| {
                    let to_light = *at - line.at(d);
                    let distance = to_light.length();
                    let direction = to_light.normalize_or_zero();
                    let share = falloff.at(direction);
                    if share == 0.0 {
                        return DVec3::ZERO;
                    }
                    let (value, straight) = self.scattered(line, d, direction, distance);
                    // Irradiance is that of the place where the light enters.
                    let outside = (distance - straight).max(1e-15);
                    value * (share / (outside * outside))
                };
                *intensity * depths.iter().map(of).sum::<DVec3>()
            }
            Prepared::Constant { radiance } => *radiance * self.constant(index, line),
            Prepared::Area(light) => self.area(index, light, line),
            Prepared::Environment(strata) => {
                let mine = || strata.iter().enumerate().skip(line.share.index as usize).step_by(line.share.of as usize);
                let depths = self.paired(line, index, mine().len());
                let of = |((i, Stratum { candidates, .. }), depth): ((usize, &Stratum), &Depth)| {
                    let chosen = uniform(STAGE_DIRECTION, line.key, index << 32 | i as u64) * candidates.len() as f64;
                    let candidate = candidates.get(chosen as usize).or(candidates.last());
                    candidate
                        .map_or(DVec3::ZERO, |c| c.weight * self.scattered(line, depth, c.direction, f64::INFINITY).0)
                };
                // Each stratum has one sample, the distances are dealt out among them; another share has the other strata.
                let factor = f64::from(line.share.of) * mine().len() as f64;
                factor * mine().zip(&depths).map(of).sum::<DVec3>()
            }
        }
    }

    fn constant(&self, index: u64, line: &Line) -> DVec3 {
        let (strata, count) = line.share.strata(self.settings.directions);
        let depths = self.paired(line, index, strata.len());
        let (u, v) =
            (uniform(STAGE_DIRECTION, line.key, index << 8), uniform(STAGE_DIRECTION, line.key, index << 8 | 1));
        let normal = line.point.normal;
        let mut sum = DVec3::ZERO;
        for (i, depth) in strata.zip(&depths) {
            // The azimuth is stratified by the golden ratio, so that it is independent of the other two.
            let along = (f64::from(i) + u).rem_euclid(f64::from(count)) / f64::from(count);
            let azimuth = TAU * (f64::from(i) * 0.618_033_988_749_894_9 + v).fract();
            let cosine = if along < FROM_COSINE {
                (along / FROM_COSINE).sqrt()
            } else {
                2.0 * (along - FROM_COSINE) / (1.0 - FROM_COSINE) - 1.0
            };
            let direction = around(normal, cosine, azimuth);
            let density = FROM_COSINE * cosine.max(0.0) * FRAC_1_PI + (1.0 - FROM_COSINE) / (4.0 * PI);
            sum += self.scattered(line, depth, direction, f64::INFINITY).0 / density;
        }
        sum
    }

    fn area(&self, index: u64, light: &Rectangle, line: &Line) -> DVec3 {
        let (strata, count) = line.share.strata(self.settings.directions);
        let depths = self.paired(line, index, strata.len());
        let turn = |d: u64| uniform(STAGE_DIRECTION, line.key, index << 8 | d);
        let mut sum = DVec3::ZERO;
        for (i, depth) in strata.zip(&depths) {
            let at = line.at(depth);
            let Some(rectangle) = light.seen_from(at) else { continue };
            let s = ((f64::from(i) + 0.5) / f64::from(count) + turn(0)).fract();
            let t = (f64::from(i) * 0.618_033_988_749_894_9 + turn(1)).fract();
            let to_light = rectangle.sample(s, t) - at;
            let value = self.scattered(line, depth, to_light.normalize_or_zero(), to_light.length()).0;
            sum += value * rectangle.solid_angle();
        }
        light.radiance * sum
    }

    /// The radiance that light of unit `L dw` from one direction adds, and the length of its straight way inside.
    fn scattered(&self, line: &Line, depth: &Depth, to_light: DVec3, distance: f64) -> (DVec3, f64) {
        let none = (DVec3::ZERO, 0.0);
        let eta = line.optics.eta_inside_over_outside;
        let (incident, (ray, skip)) = if line.dense {
            // A plane through the point; the path is at most some ten-thousandths of what single precision resolves.
            let below = -depth.s_mm * line.direction.dot(line.point.normal);
            let cosine = line.point.normal.dot(to_light);
            if cosine <= 0.0 {
                return none;
            }
            let incident = self.interior.incident_at(below / cosine, line.point.normal, to_light, eta);
            (incident, self.interior.beyond_flat(line.point, to_light, distance))
        } else {
            let Some(leaving) = self.interior.leave(line.at(depth), to_light, line.point.part) else { return none };
            let incident = self.interior.incident(&leaving, to_light, eta);
            (incident, self.interior.beyond(&leaving, distance))
        };
        let Some(incident) = incident else { return none };
        if incident.straight_mm >= distance {
            return none;
        }
        let attenuated = (-line.optics.sigma_t_per_mm * incident.path_mm).map(f64::exp);
        let value =
            depth.weight * attenuated * (incident.gain * line.phase.density(-incident.inside.dot(line.towards_eye)));
        if value == DVec3::ZERO {
            return none;
        }
        (value * self.interior.transmitted(&ray, skip), incident.straight_mm)
    }
}

impl Line<'_> {
    fn at(&self, depth: &Depth) -> DVec3 {
        self.start + depth.s_mm * self.direction
    }
}
