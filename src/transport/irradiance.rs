//! Irradiance of the samples under a set of lights: E = Int L V F_t(eta, n.w) max(0, n.w) dw, shadows by ray casting.

#[cfg(feature = "gpu")]
pub mod packed;
mod points;
mod sharp;
mod surface_point;

use std::f64::consts::{PI, TAU};
use std::ops::RangeInclusive;

use glam::DVec3;

use self::sharp::{Focus, Sharp, pieces};
use super::prepared_light::{Prepared, Rectangle, Stratum};
use super::surface::Surface;
use crate::error::{Error, Result};
use crate::geometry::bvh::{Bvh, Ray};
use crate::light::strata::{Candidate, StrataSettings};
use crate::light::{Light, refuse_fields};
use crate::math::random::{bits, radical_inverse_2, uniform};
use crate::medium::fresnel::{self, CosineTransmittance};
use crate::parallel::*;
use crate::progress::Progress;

pub use self::sharp::{Pieces, Uneven};
pub use self::surface_point::SurfacePoint;
pub(super) use self::surface_point::{around, direction_key};

/// Numbers of directions and points by which lights and shadows are sampled.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct LightSampling {
    /// Points of a patch that see a directional or a point light, a power of two.
    pub points_per_patch: u32,
    /// Strata of an environment, for each patch; a constant light takes a quarter as many directions.
    pub directions: u32,
    /// Strata of an area light along each edge, for each patch.
    pub area_side: u32,
}

impl LightSampling {
    /// Refuses settings out of range.
    ///
    /// # Errors
    /// Invalid input.
    pub fn validate(&self) -> Result<()> {
        let Self { points_per_patch, directions, area_side } = *self;
        let fits = points_per_patch.is_power_of_two() && points_per_patch <= 64;
        if !(fits && (1..=65536).contains(&directions) && (1..=256).contains(&area_side)) {
            return Err(Error::input(format!(
                "{points_per_patch} points of a patch, {directions} directions and {area_side} cells of an area light's edge"
            )));
        }
        Ok(())
    }

    /// The sampling of the truth.
    pub const REFERENCE: Self = Self { points_per_patch: 16, directions: 512, area_side: 16 };
    /// Shadow boundaries within a quarter of a patch, soft light within about 1 % a patch, which scattering averages.
    pub const FAST: Self = Self { points_per_patch: 4, directions: 256, area_side: 8 };

    /// The same with as many directions as give all of some patches so many together, within bounds: neighbouring patches look at other
    /// directions of the same strata, and scattering averages over them.
    #[must_use]
    pub fn with_directions_of_all(self, together: usize, patches: usize, bounds: RangeInclusive<u32>) -> Self {
        let share = u32::try_from(together / patches.max(1)).unwrap_or(u32::MAX);
        Self { directions: share.clamp(*bounds.start(), *bounds.end()), ..self }
    }

    /// Pieces of a patch that a shadow boundary crosses.
    pub fn pieces_of_uneven(self) -> u32 {
        UNEVEN_REFINEMENT * self.points_per_patch.next_power_of_two()
    }
}

/// Seeds of the stages that draw numbers.
const STAGE_CONSTANT: u64 = 1;
const STAGE_AREA: u64 = 2;
const STAGE_ENVIRONMENT: u64 = 3;

/// Largest irradiance: its sums over a surface stay finite.
const MOST: f64 = 1e280;

/// Only visibility varies between the directions of a constant light, so that it takes this many times fewer.
const CONSTANT_SAVES: u32 = 4;

/// A patch that a shadow boundary of a sharp light crosses is looked at from this many times as many points, a power of two.
const UNEVEN_REFINEMENT: u32 = 8;

/// Distance of the first points of a patch from its centroid, over that of the corners: off the edges, where neighbours
/// would shadow them.
const PROBE_REACH: f64 = 0.9;

/// Weights of these three points and the centroid that integrate quadratic functions exactly.
const PROBE_WEIGHTS: [f64; 4] = {
    let corner = 1.0 / (12.0 * PROBE_REACH * PROBE_REACH);
    [corner, corner, corner, 1.0 - 3.0 * corner]
};

/// Shadow rays of one patch, in an order that keeps neighbouring directions together, and the irradiance that each
/// brings unoccluded.
#[derive(Default)]
struct Bundle {
    rays: Vec<Ray>,
    skip: Vec<u32>,
    gains: Vec<DVec3>,
    occluded: Vec<bool>,
}

impl Bundle {
    fn push(&mut self, p: &SurfacePoint, (direction, distance): (DVec3, f64), gain: DVec3) {
        self.rays.push(p.shadow_ray(direction, distance));
        self.skip.push(p.triangle);
        self.gains.push(gain);
    }

    /// Sum of the gains of the rays that meet nothing; empties the bundle.
    fn trace(&mut self, bvh: &Bvh) -> DVec3 {
        self.occluded.clear();
        self.occluded.resize(self.rays.len(), false);
        bvh.occluded_many(&self.rays, &self.skip, &mut self.occluded);
        let seen = self.gains.iter().zip(&self.occluded).filter(|(_, occluded)| !**occluded);
        let sum = seen.map(|(gain, _)| *gain).sum();
        self.rays.clear();
        self.skip.clear();
        self.gains.clear();
        sum
    }
}

/// Candidate directions in each stratum of an environment.
const CANDIDATES: usize = 64;

/// Strata with more than this share of an environment's energy are seen from every point of a patch.
const BRIGHT_SHARE: f64 = 0.02;

/// Directions of one stratum of an environment.
struct StratumRays {
    candidates: Vec<Candidate>,
    /// True where all points of a patch look there, because its shadow may be as sharp as a sun's; else one does.
    bright: bool,
}

/// The strata of an environment, neighbours side by side.
fn rays_of(strata: Vec<Stratum>, total: f64) -> Vec<StratumRays> {
    let rays = |Stratum { candidates, energy }| StratumRays { candidates, bright: energy / total > BRIGHT_SHARE };
    let mut all: Vec<StratumRays> = strata.into_iter().map(rays).collect();
    all.sort_by_cached_key(|rays| direction_key(rays.candidates[0].direction));
    all
}

/// Rays that go from one point of a patch before the next point's: as many as one bundle of the ray caster takes.
const RUN: usize = 16;

/// Lights prepared for a surface.
pub struct Illumination<'a> {
    surface: &'a Surface<'a>,
    lights: Vec<Prepared<Vec<StratumRays>>>,
    sampling: LightSampling,
    entrance: Vec<(f64, CosineTransmittance)>,
}

impl<'a> Illumination<'a> {
    /// Prepares lights; `etas` is the relative index of refraction of each medium of the scene.
    ///
    /// # Errors
    /// A sampling that environments do not take; a light that asks for a source radiance field (exit 5).
    pub fn new(surface: &'a Surface<'a>, lights: &[Light], etas: &[f64], sampling: LightSampling) -> Result<Self> {
        refuse_fields(lights)?;
        let origin_mm = surface.domain.mesh.origin_mm;
        let cut = StrataSettings { strata: sampling.directions as usize, candidates: CANDIDATES };
        let prepare = |light: &Light| Prepared::new(light, origin_mm, cut, rays_of);
        Ok(Self {
            surface,
            lights: lights.iter().map(prepare).collect::<Result<_>>()?,
            sampling,
            entrance: etas.iter().map(|&eta| (eta, CosineTransmittance::new(eta))).collect(),
        })
    }

    /// Irradiance of every patch, RGB.
    pub fn all(&self, progress: &dyn Progress) -> Vec<DVec3> {
        self.all_with_pieces(progress).0
    }

    /// Irradiance of every patch, RGB, and of the pieces of those that are not lit evenly.
    pub fn all_with_pieces(&self, progress: &dyn Progress) -> (Vec<DVec3>, Pieces) {
        const CHUNK: usize = 256;
        let patches = self.surface.samples.len();
        progress.start("irradiance", patches as u64);
        let mut result = vec![DVec3::ZERO; patches];
        let uneven: Vec<Vec<Uneven>> = result
            .par_chunks_mut(CHUNK)
            .enumerate()
            .map(|(chunk, out)| {
                let uneven = self.range(chunk * CHUNK, out);
                progress.advance(out.len() as u64);
                uneven
            })
            .collect();
        progress.finish();
        let count = self.sampling.pieces_of_uneven() as usize;
        (result, Pieces::new(patches, count, uneven.into_iter().flatten()))
    }

    /// Writes the irradiance of the patches from `first` on to `out`; returns those that are not lit evenly.
    pub fn range(&self, first: usize, out: &mut [DVec3]) -> Vec<Uneven> {
        let rays = out.len() * self.sampling.points_per_patch as usize;
        let mut sharp: Vec<Sharp> = self.lights.iter().filter_map(|light| Sharp::new(light, rays)).collect();
        let mut points = Vec::new();
        let mut done = 0;
        while done < out.len() {
            let part = self.surface.samples.part_offsets.partition_point(|&p| p as usize <= first + done) - 1;
            let end = out.len().min(self.surface.samples.part(part).end - first);
            self.some_of_part(part, first + done, &mut out[done..end], (done, &mut sharp));
            done = end;
        }
        for light in &mut sharp {
            light.trace(self.surface.bvh);
        }
        // Where a shadow boundary or the edge of a cone crosses a patch or a light is near to it, more rays tell more; for each light on its own, so that
        // lights add up.
        let mut fine: Vec<Sharp> = self.lights.iter().filter_map(|light| Sharp::new(light, 0)).collect();
        let patches = &self.surface.patches[first..first + out.len()];
        let close: Vec<Vec<Option<Focus>>> =
            sharp.iter().map(|light| patches.iter().map(|patch| light.focus(patch)).collect()).collect();
        let mut crossed: Vec<Vec<bool>> = sharp.iter().map(|light| light.crossed(out.len())).collect();
        for (crossed, close) in crossed.iter_mut().zip(&close) {
            crossed.iter_mut().zip(close).for_each(|(crossed, close)| *crossed |= close.is_some());
        }
        let single = |i: usize| self.surface.samples.patch(first + i).len() == 1;
        let crossed = |light: usize, i: usize| crossed[light][i] && single(i);
        let mut uneven = Vec::new();
        for i in (0..out.len()).filter(|&i| (0..sharp.len()).any(|light| crossed(light, i))) {
            points.clear();
            self.pieces_as_points(first + i, self.sampling.pieces_of_uneven(), &mut points);
            let part = self.surface.samples.part_offsets.partition_point(|&p| p as usize <= first + i) - 1;
            let medium = self.surface.domain.parts.parts[part].medium.unwrap_or(0) as usize;
            let share = 1.0 / points.len() as f64;
            let eta = self.entrance[medium].0;
            for (index, light) in fine.iter_mut().enumerate().filter(|(light, _)| crossed(*light, i)) {
                match close[index][i] {
                    None => light.collect(i, eta, &points, |point| (point, share)),
                    Some(focus) => {
                        let (points, of) = self.graded_points(first + i, self.sampling.pieces_of_uneven(), focus);
                        light.collect(i, eta, &points, |point| of[point]);
                    }
                }
            }
            uneven.push(Uneven { patch: (first + i) as u32, deviations: Vec::new(), corners: Vec::new() });
        }
        for light in &mut fine {
            light.trace(self.surface.bvh);
        }
        for Uneven { patch, deviations, corners } in &mut uneven {
            let index = *patch as usize;
            deviations.resize(self.sampling.pieces_of_uneven() as usize, DVec3::ZERO);
            fine.iter().for_each(|light| light.add_to_pieces(index - first, deviations));
            let mean = deviations.iter().sum::<DVec3>() / deviations.len() as f64;
            deviations.iter_mut().for_each(|e| *e = (*e - mean).clamp(DVec3::splat(-MOST), DVec3::splat(MOST)));
            let centre = self.surface.patches[index].centre_mm;
            if let [facet] = self.surface.samples.patch(index) {
                let whole = facet.corners_local_mm(self.surface.domain.mesh);
                pieces(whole, self.sampling.pieces_of_uneven(), &mut |piece| {
                    corners.push(piece.map(|c| (c - centre).as_vec3().to_array()));
                });
            }
        }
        for (index, (coarse, fine)) in sharp.iter().zip(&fine).enumerate() {
            coarse.add(out, |i| !crossed(index, i));
            fine.add(out, |_| true);
        }
        for e in out {
            *e = e.min(DVec3::splat(MOST));
        }
        uneven
    }

    /// Writes the soft light on patches of one part and collects the rays towards sharp lights; `before` patches of the
    /// range come before them.
    fn some_of_part(&self, part: usize, first: usize, out: &mut [DVec3], (before, sharp): (usize, &mut [Sharp])) {
        let medium = self.surface.domain.parts.parts[part].medium.unwrap_or(0) as usize;
        let eta = self.entrance[medium].0;
        let soft = sharp.len() < self.lights.len();
        let offsets = &self.surface.samples.patch_offsets[first..=first + out.len()];
        let facets = offsets[0] as usize..offsets[out.len()] as usize;
        if !soft && self.sampling.points_per_patch == 1 && facets.len() == out.len() {
            let patches = &self.surface.patches[first..first + out.len()];
            let facets = &self.surface.samples.facets[facets];
            sharp.iter_mut().for_each(|light| light.collect_centres(before, eta, patches, facets));
            out.fill(DVec3::ZERO);
            return;
        }
        let (mut points, mut bundle) = (Vec::new(), Bundle::default());
        for (i, e) in out.iter_mut().enumerate() {
            let patch = first + i;
            points.clear();
            if !soft && !self.is_faced(patch, sharp) {
                *e = DVec3::ZERO;
                continue;
            }
            let probe = if sharp.is_empty() { None } else { self.corners_and_centroid(patch) };
            if soft || probe.is_none() {
                self.points_of(patch, &mut points);
            }
            for light in sharp.iter_mut() {
                match &probe {
                    Some(probe) => light.collect(before + i, eta, probe, |k| (k, PROBE_WEIGHTS[k])),
                    None => light.collect(before + i, eta, &points, |k| (k, 1.0 / points.len() as f64)),
                }
            }
            let soft = self.lights.iter().filter(|light| !light.is_sharp());
            *e = soft.map(|light| self.irradiance(light, medium, patch, &points, &mut bundle)).sum();
        }
    }

    fn irradiance(
        &self,
        light: &Prepared<Vec<StratumRays>>,
        medium: usize,
        patch: usize,
        points: &[SurfacePoint],
        bundle: &mut Bundle,
    ) -> DVec3 {
        let eta = self.entrance[medium].0;
        match light {
            Prepared::Constant { radiance } => *radiance * self.constant(medium, patch, points, bundle),
            // Sharp lights come in bundles of many patches.
            Prepared::Directional { .. } | Prepared::Point { .. } => DVec3::ZERO,
            Prepared::Area(light) => self.area(light, eta, patch, points, bundle),
            Prepared::Environment(strata) => self.environment(strata, eta, patch, points, bundle),
        }
    }

    /// Int V F_t cos: directions with density F_t cos, so that only visibility varies.
    fn constant(&self, medium: usize, patch: usize, points: &[SurfacePoint], bundle: &mut Bundle) -> f64 {
        let (_, entrance) = &self.entrance[medium];
        let count = self.sampling.directions.div_ceil(CONSTANT_SAVES);
        let (turn_u, turn_v) = (uniform(STAGE_CONSTANT, patch as u64, 0), uniform(STAGE_CONSTANT, patch as u64, 1));
        let gain = DVec3::X / f64::from(count);
        for k in 0..count {
            let p = &points[(k as usize / RUN + patch) % points.len()];
            let mu = entrance.sample_entrance_cosine((radical_inverse_2(k) + turn_u).fract());
            let azimuth = TAU * (f64::from(k) + turn_v) / f64::from(count);
            bundle.push(p, (around(p.normal, mu, azimuth), f64::INFINITY), gain);
        }
        PI * entrance.diffuse_transmittance() * bundle.trace(self.surface.bvh).x
    }

    fn area(&self, light: &Rectangle, eta: f64, patch: usize, points: &[SurfacePoint], bundle: &mut Bundle) -> DVec3 {
        let side = self.sampling.area_side;
        for (index, p) in points.iter().enumerate() {
            if !light.is_before(p.at, p.normal) {
                continue;
            }
            let Some(rectangle) = light.seen_from(p.at) else { continue };
            let cells = (index as u32..side * side).step_by(points.len());
            let share = rectangle.solid_angle() / (cells.len().max(1) * points.len()) as f64;
            for cell in cells {
                let key = patch as u64 * u64::from(side * side) + u64::from(cell);
                let s = (f64::from(cell % side) + uniform(STAGE_AREA, key, 0)) / f64::from(side);
                let t = (f64::from(cell / side) + uniform(STAGE_AREA, key, 1)) / f64::from(side);
                let to_light = rectangle.sample(s, t) - p.at;
                let distance = to_light.length();
                let direction = to_light / distance.max(f64::MIN_POSITIVE);
                let cosine = p.normal.dot(direction);
                if cosine > 0.0 {
                    let gain = share * fresnel::transmittance(eta, cosine) * cosine;
                    bundle.push(p, (direction, distance), DVec3::splat(gain));
                }
            }
        }
        light.radiance * bundle.trace(self.surface.bvh)
    }

    fn environment(
        &self,
        strata: &[StratumRays],
        eta: f64,
        patch: usize,
        points: &[SurfacePoint],
        bundle: &mut Bundle,
    ) -> DVec3 {
        let turn = (patch as u32).reverse_bits() >> (32 - CANDIDATES.ilog2());
        for (index, stratum) in strata.iter().enumerate() {
            // Neighbouring patches take different candidates of each stratum; scattering averages over them.
            let shift = bits(STAGE_ENVIRONMENT, index as u64, 0) as usize ^ turn as usize;
            let mut look = |p: &SurfacePoint, k: usize, share: f64| {
                let Candidate { direction, weight } = stratum.candidates[(shift ^ k) & (CANDIDATES - 1)];
                let cosine = p.normal.dot(direction);
                if cosine > 0.0 {
                    let gain = weight * (share * fresnel::transmittance(eta, cosine) * cosine);
                    bundle.push(p, (direction, f64::INFINITY), gain);
                }
            };
            if stratum.bright {
                let share = 1.0 / points.len() as f64;
                points.iter().enumerate().for_each(|(k, p)| look(p, k, share));
            } else {
                look(&points[(index / RUN + patch) % points.len()], 0, 1.0);
            }
        }
        bundle.trace(self.surface.bvh)
    }
}

#[cfg(test)]
#[path = "irradiance_tests.rs"]
mod tests;
