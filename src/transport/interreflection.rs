//! Light that leaves the surface by subsurface scattering, crosses the outside in a straight line and falls on the surface
//! again.
//!
//! A radiosity B leaves as the radiance `F_t(eta, mu) B / (pi C)`, `C = 2 Int_0^1 F_t mu dmu`, and arrives at a sample as
//! irradiance behind the surface, `E'(x) = Int V F_t(eta, mu) mu L dw`. Directions with density `F_t mu / (pi C)` make that
//! the mean of `C F_t' B' / C'` over the rays that meet the outer side of a part with a medium; the other rays bring
//! nothing: they leave the scene, end at an opaque part, or inside another body. Mirror reflections are not followed.
//!
//! The geometric factor is in the rays, so that no pair of points near each other, as in a crease, has a weight that
//! grows beyond bounds. The same hits serve every light: they are kept as a sparse matrix from vertices to samples,
//! whose rows are empty where a body is convex.

use std::f64::consts::TAU;

use glam::DVec3;

use super::irradiance::{around, direction_key};
use super::surface::Surface;
use crate::geometry::bvh::{Hit, Ray, offset_origin};
use crate::geometry::samples::{Facet, area};
use crate::math::random::{bits, radical_inverse_2};
use crate::math::simd::{InstructionSet, multiversion};
use crate::medium::fresnel::{CosineTransmittance, transmittance};
use crate::parallel::*;
use crate::progress::{Progress, in_tasks};
use crate::transport::domain::Domain;

/// Fewest and most rays of a sample, powers of two.
pub const LEAST_RAYS: u32 = 8;
/// See [`LEAST_RAYS`].
pub const MOST_RAYS: u32 = 1024;

/// Seed of the points that rays start from.
const STAGE_POINTS: u64 = 0x696e_7472;

/// Samples whose rays are cast together, ordered by direction: enough for bundles of rays that are alike.
const BLOCK: usize = 64;

/// Samples of one task of a sum.
const SAMPLES_OF_A_TASK: usize = 1024;

/// Stored value of a corner's weight of 1.
const WHOLE: u16 = u16::MAX;

/// Shift of the set of directions from one sample to the next: any run of samples, which are neighbours, has shifts
/// spread evenly over the square (the Kronecker sequence of the root of x^3 = x + 1). With random shifts the mean over
/// a surface is off by several times as much with 64 rays.
const TURNS: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_3];

/// Step between the places of successive rays along the facets of a sample.
const FACET_STEP: f64 = 0.618_033_988_749_894_9;

/// Rays of each sample that are used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rays {
    /// All rays.
    All,
    /// The first half, itself well spread.
    FirstHalf,
}

/// A ray that met a surface from which light leaves.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Arrival {
    triangle: u32,
    /// Weights of the second and the third corner, in units of 1 / [`WHOLE`]; they add up to that at most.
    corners: [u16; 2],
    /// Irradiance for a radiosity of 1 there, if all rays met such a surface.
    share: f32,
}

impl Arrival {
    /// Weights of the three corners; they add up to 1.
    fn weights(self) -> [f64; 3] {
        let [b, c] = self.corners;
        let a = WHOLE.saturating_sub(b.saturating_add(c));
        [a, b, c].map(|w| f64::from(w) / f64::from(WHOLE))
    }
}

/// The sparse matrix from radiosity at vertices to the irradiance that it makes at samples.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct InterReflection {
    rays: u32,
    /// Two for each sample: ends of the arrivals of the first half of its rays, and of the second.
    ends: Vec<usize>,
    arrivals: Vec<Arrival>,
    /// For each triangle, the rows of the values at its corners.
    rows: Vec<[u32; 3]>,
}

impl InterReflection {
    /// Casts `rays` (made a power of two from [`LEAST_RAYS`] to [`MOST_RAYS`]) from every sample; `etas` is the relative index of
    /// refraction of each medium. The same on any number of threads.
    pub fn new(surface: &Surface, etas: &[f64], rays: u32, progress: &dyn Progress) -> Self {
        let rays = rays.clamp(LEAST_RAYS, MOST_RAYS).next_power_of_two();
        let caster = Caster {
            surface,
            optics: etas.iter().map(|&eta| Optics::new(eta)).collect(),
            directions: (0..rays).map(|k| [radical_inverse_2(k), second_inverse_2(k)]).collect(),
        };
        let samples = surface.samples.len();
        let blocks = in_tasks(progress, "inter-reflection", (samples, BLOCK), |range| caster.block(range));
        let mut ends = Vec::with_capacity(2 * samples);
        let mut arrivals = Vec::with_capacity(blocks.iter().map(|b| b.arrivals.len()).sum());
        for block in blocks {
            ends.extend(block.ends.iter().map(|end| end + arrivals.len()));
            arrivals.extend(block.arrivals);
        }
        Self { rays, ends, arrivals, rows: surface.domain.mesh.triangles.clone() }
    }

    /// The matrix for values of receivers in place of source vertices: `receiver_of_vertex` as
    /// [`super::receivers::Receivers::of_vertex`].
    #[must_use]
    pub fn of_receivers(mut self, receiver_of_vertex: &[u32]) -> Self {
        let row = |v: u32| receiver_of_vertex.get(v as usize).copied().unwrap_or(super::receivers::NONE);
        self.rows.iter_mut().for_each(|corners| *corners = corners.map(row));
        self
    }

    /// True if no light comes back, as outside a convex body.
    pub fn is_empty(&self) -> bool {
        self.arrivals.is_empty()
    }

    /// Number of samples.
    pub fn samples(&self) -> usize {
        self.ends.len() / 2
    }

    /// Bytes in memory.
    pub fn bytes(&self) -> usize {
        size_of_val(self.ends.as_slice()) + size_of_val(self.arrivals.as_slice()) + size_of_val(self.rows.as_slice())
    }

    /// Bytes of the matrix of so many samples and triangles, at most.
    pub fn most_bytes(samples: usize, rays: u32, triangles: usize) -> u64 {
        let of_sample = 2 * size_of::<usize>() as u64 + u64::from(rays) * size_of::<Arrival>() as u64;
        samples as u64 * of_sample + (triangles * size_of::<[u32; 3]>()) as u64
    }

    /// Irradiance of each sample, behind the surface, RGB, from the radiosity of each vertex (each receiver after
    /// [`Self::of_receivers`]); one that is missing counts as 0.
    pub fn apply(&self, radiosity: &[DVec3], rays: Rays) -> Vec<DVec3> {
        let at = |row: u32| radiosity.get(row as usize).copied().unwrap_or(DVec3::ZERO);
        let of_sample = |sample: usize| {
            let mut sum = DVec3::ZERO;
            for arrival in self.of_sample(sample, rays) {
                let Some(rows) = self.rows.get(arrival.triangle as usize) else { continue };
                let [a, b, c] = arrival.weights();
                let [p, q, r] = rows.map(at);
                sum += f64::from(arrival.share) * (a * p + b * q + c * r);
            }
            sum / f64::from(self.count(rays).max(1))
        };
        (0..self.samples()).into_par_iter().with_min_len(SAMPLES_OF_A_TASK).map(of_sample).collect()
    }

    /// [`Self::apply`] with all rays for any number of columns: `rows` is `[vertex][column]`, the result
    /// `[sample][column]`. A row that is missing or cut short counts as 0. Values of either sign, such as coefficients
    /// of a basis of lights.
    pub fn apply_rows(&self, rows: &[f32], columns: usize) -> Vec<f32> {
        let mut out = vec![0.0; self.samples() * columns];
        if columns > 0 {
            let level = InstructionSet::detect();
            out.par_chunks_mut(SAMPLES_OF_A_TASK * columns).enumerate().for_each(|(task, out)| {
                sums(level, self, task * SAMPLES_OF_A_TASK, rows, columns, out);
            });
        }
        out
    }

    fn count(&self, rays: Rays) -> u32 {
        if rays == Rays::All { self.rays } else { self.rays / 2 }
    }

    fn of_sample(&self, sample: usize, rays: Rays) -> &[Arrival] {
        let end = |i: usize| self.ends.get(i).copied().unwrap_or(0);
        let first = if sample == 0 { 0 } else { end(2 * sample - 1) };
        let (middle, last) = (end(2 * sample), end(2 * sample + 1));
        let range = match rays {
            Rays::All => first..last,
            Rays::FirstHalf => first..middle,
        };
        self.arrivals.get(range).unwrap_or_default()
    }
}

#[inline(always)]
fn sums_body(matrix: &InterReflection, first: usize, rows: &[f32], columns: usize, out: &mut [f32]) {
    let scale = (matrix.rays.max(1) as f32).recip();
    let row = |index: u32| {
        let start = (index as usize).checked_mul(columns)?;
        rows.get(start..start.checked_add(columns)?)
    };
    for (i, out) in out.chunks_exact_mut(columns).enumerate() {
        out.fill(0.0);
        for arrival in matrix.of_sample(first + i, Rays::All) {
            let Some(corners) = matrix.rows.get(arrival.triangle as usize) else { continue };
            for (corner, weight) in corners.iter().zip(arrival.weights()) {
                let Some(row) = row(*corner) else { continue };
                let weight = arrival.share * (weight as f32);
                for (out, value) in out.iter_mut().zip(row) {
                    *out += weight * value;
                }
            }
        }
        out.iter_mut().for_each(|value| *value *= scale);
    }
}

multiversion! {
    /// See [`InterReflection::apply_rows`], from one sample on.
    fn sums(matrix: &InterReflection, first: usize, rows: &[f32], columns: usize, out: &mut [f32]) => sums_body
}

/// The surface of a medium from outside.
struct Optics {
    eta: f64,
    /// The constant `C`.
    diffuse: f64,
    /// Quantiles of the cosine under the density `2 F_t mu / C`, in equal steps.
    cosines: Vec<f64>,
}

/// Steps of the table of cosines: each has its share of the light to rounding, and cosines are even within a step.
const STEPS: usize = 2048;

impl Optics {
    fn new(eta: f64) -> Self {
        let entrance = CosineTransmittance::new(eta);
        let cosine = |step: usize| entrance.sample_entrance_cosine(step as f64 / STEPS as f64);
        let cosines = (0..STEPS + 1).into_par_iter().map(cosine).collect();
        Self { eta, diffuse: entrance.diffuse_transmittance(), cosines }
    }

    /// The cosine below which a share of the light comes in, in [0, 1).
    fn cosine(&self, share: f64) -> f64 {
        let step = share * STEPS as f64;
        let (first, part) = (step as usize, step.fract());
        self.cosines.get(first..).and_then(|c| c.first_chunk()).map_or(1.0, |[a, b]| a + part * (b - a))
    }
}

/// Arrivals of successive samples; ends count from the first of the block.
#[derive(Default)]
struct Block {
    ends: Vec<usize>,
    arrivals: Vec<Arrival>,
}

/// Rays of a block of samples.
#[derive(Default)]
struct Bundle {
    rays: Vec<Ray>,
    directions: Vec<DVec3>,
    /// Key of the direction, and ray.
    order: Vec<(u32, u32)>,
}

/// Surface, optics and directions for casting rays.
struct Caster<'a> {
    surface: &'a Surface<'a>,
    /// Optics of each medium.
    optics: Vec<Optics>,
    /// A (0, 2)-sequence in base 2: the first half is as well spread as the whole.
    directions: Vec<[f64; 2]>,
}

impl Caster<'_> {
    fn block(&self, samples: std::ops::Range<usize>) -> Block {
        let mut bundle = Bundle::default();
        let mut counts = Vec::with_capacity(samples.len());
        for sample in samples.clone() {
            let before = bundle.rays.len();
            if let Some(optics) = self.optics_of_sample(sample) {
                self.collect(sample, optics, &mut bundle);
            }
            counts.push(bundle.rays.len() - before);
        }
        let hits = self.trace(&mut bundle);
        let mut block = Block::default();
        let mut rest = hits.iter().zip(&bundle.directions);
        for (sample, count) in samples.zip(counts) {
            let optics = self.optics_of_sample(sample);
            for half in [count / 2, count - count / 2] {
                for (hit, direction) in rest.by_ref().take(half) {
                    let arrival =
                        (*hit).zip(optics).and_then(|(hit, receiver)| self.arrival(&hit, *direction, receiver));
                    block.arrivals.extend(arrival);
                }
                block.ends.push(block.arrivals.len());
            }
        }
        block
    }

    fn optics_of_sample(&self, sample: usize) -> Option<&Optics> {
        let offsets = &self.surface.samples.part_offsets;
        let part = offsets.partition_point(|&first| first as usize <= sample).checked_sub(1)?;
        self.optics_of_part(part)
    }

    fn optics_of_part(&self, part: usize) -> Option<&Optics> {
        let medium = self.surface.domain.parts.parts.get(part)?.medium?;
        self.optics.get(medium as usize).filter(|optics| optics.diffuse > 0.0)
    }

    /// Adds the rays of one sample: all of them, or none from a surface without a normal.
    fn collect(&self, sample: usize, optics: &Optics, bundle: &mut Bundle) {
        let domain = self.surface.domain;
        let turns = TURNS.map(|turn| ((sample + 1) as f64 * turn).fract());
        let places = Places::new(domain, self.surface.samples.patch(sample));
        for (k, [u, v]) in self.directions.iter().enumerate() {
            let Some(place) = places.at((k as f64 * FACET_STEP + turns[0]).fract()) else { return };
            let at = place.point(bits(STAGE_POINTS, sample as u64, k as u64));
            let mu = optics.cosine((u + turns[0]).fract());
            let direction = around(place.normal, mu, TAU * (v + turns[1]).fract());
            bundle.rays.push(Ray::new(offset_origin(at.as_vec3(), place.normal.as_vec3()), direction.as_vec3()));
            bundle.directions.push(direction);
        }
    }

    /// First hit of each ray, in their order.
    fn trace(&self, bundle: &mut Bundle) -> Vec<Option<Hit>> {
        let Bundle { rays, directions, order } = bundle;
        order.extend(directions.iter().zip(0..).map(|(direction, ray)| (direction_key(*direction), ray)));
        order.sort_unstable();
        let sorted: Vec<Ray> = order.iter().filter_map(|(_, ray)| rays.get(*ray as usize).copied()).collect();
        let mut found = vec![None; sorted.len()];
        self.surface.bvh.closest_many(&sorted, &mut found);
        let mut hits = vec![None; rays.len()];
        for ((_, ray), hit) in order.iter().zip(found) {
            if let Some(slot) = hits.get_mut(*ray as usize) {
                *slot = hit;
            }
        }
        hits
    }

    /// The arrival along a ray that hit a surface; none from an opaque part and from the inner side of a surface.
    fn arrival(&self, hit: &Hit, direction: DVec3, receiver: &Optics) -> Option<Arrival> {
        let domain = self.surface.domain;
        let part = *domain.parts.triangle_part.get(hit.triangle as usize)?;
        let emitter = self.optics_of_part(part as usize)?;
        let cosine = -domain.mesh.normal(hit.triangle).dot(direction);
        let share = transmittance(emitter.eta, cosine) * receiver.diffuse / emitter.diffuse;
        let share = (share as f32).min(f32::MAX);
        let whole = f32::from(WHOLE);
        let b = (hit.u.clamp(0.0, 1.0) * whole).round() as u16;
        let c = ((hit.v.clamp(0.0, 1.0) * whole).round() as u16).min(WHOLE - b);
        (share > 0.0).then_some(Arrival { triangle: hit.triangle, corners: [b, c], share })
    }
}

/// Facets of a sample by their shares of its area.
struct Places {
    facets: Vec<Place>,
    /// Area of each facet and those before it, over the whole.
    ends: Vec<f64>,
}

/// A facet.
struct Place {
    corners_mm: [DVec3; 3],
    normal: DVec3,
}

impl Places {
    fn new(domain: Domain, facets: &[Facet]) -> Self {
        let place = |facet: &Facet| Place {
            corners_mm: facet.corners_local_mm(domain.mesh),
            normal: domain.mesh.normal(facet.triangle),
        };
        let facets: Vec<Place> = facets.iter().map(place).collect();
        let mut sum = 0.0;
        let add = |place: &Place| {
            sum += area(place.corners_mm);
            sum
        };
        let mut ends: Vec<f64> = facets.iter().map(add).collect();
        ends.iter_mut().for_each(|end| *end /= sum);
        Self { facets, ends }
    }

    /// The facet at a share of the area; none where there is no area.
    fn at(&self, share: f64) -> Option<&Place> {
        let last = self.ends.last().filter(|end| **end > 0.0).map(|_| self.ends.len() - 1)?;
        self.facets.get(self.ends.partition_point(|end| *end <= share).min(last))
    }
}

impl Place {
    /// A random point, evenly distributed.
    fn point(&self, random: u64) -> DVec3 {
        let unit = |bits: u32| f64::from(bits) / 4_294_967_296.0;
        let (s, t) = (unit(random as u32), unit((random >> 32) as u32));
        let (s, t) = if s + t > 1.0 { (1.0 - s, 1.0 - t) } else { (s, t) };
        let [a, b, c] = self.corners_mm;
        a + s * (b - a) + t * (c - a)
    }
}

/// The second coordinate of Sobol's sequence as a fraction in [0, 1): with the radical inverse it makes a (0, 2)-sequence.
fn second_inverse_2(index: u32) -> f64 {
    let (mut rest, mut column, mut sum) = (index, 1u32 << 31, 0u32);
    while rest != 0 {
        if rest & 1 == 1 {
            sum ^= column;
        }
        column ^= column >> 1;
        rest >>= 1;
    }
    f64::from(sum) / 4_294_967_296.0
}

#[cfg(test)]
#[path = "interreflection_tests.rs"]
mod tests;
