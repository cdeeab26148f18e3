//! Moments of the dipole over all pairs of points of a body: the normal equations of the layers.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

use super::body::{Body, SurfacePoint, distance_and_heights};
use super::layers::{SUPPORT, Splines};
use crate::geometry::bvh::Ray;
use crate::math::random::mix;
use crate::medium::profile::Profile;
use crate::parallel::*;
use crate::transport::random_walk::walk::Stream;

/// Points that pairs are formed around, and points of the body that each forms pairs with.
const PROBES: u64 = 1024;
const POINTS: u64 = 4096;

/// Lines through the neighbourhood of a probe along its normal and two tangents in each round: surfaces may stand at right
/// angles to that of the probe.
const SHARES: [u64; 3] = [2, 1, 1];
const ROUNDS: u64 = 24;

/// Mean distances between points within which lines find the neighbourhood of a probe.
const NEAR: f64 = 3.0;

/// Neighbourhood inside which a surface is its tangent plane, over the first knot.
const INNERMOST: f64 = 0.1;

/// Probes of one task.
const CHUNK: u64 = 16;

/// Distances of pairs far apart for each factor of e: what is linear between them is exact, and the rest 2e-5 off.
const STEPS: f64 = 256.0;

/// Powers of the height: 0, 1, 2.
pub(super) const POWERS: usize = 3;

/// `Int Int R_d B_k B_(k + j) h^m dA dA`, mm^2: `[k][j][m]`.
pub(super) type Moments = Vec<[[f64; POWERS]; SUPPORT]>;

/// The moments of a profile over a body.
///
/// Pairs far apart are those of points spread over the body with probes; pairs nearby are those of probes with every crossing of
/// lines along the probe's normal and tangents, so that they are found at any distance, on every sheet and across edges.
pub(super) fn moments(body: &Body, profile: &dyn Profile, splines: &Splines, seed: u64) -> Moments {
    let area = body.area_mm2();
    let spread = |count: u64, stage: u64| -> Vec<SurfacePoint> {
        let point = |i: u64| {
            let mut stream = Stream::new(mix(seed ^ stage), i);
            let along = (i as f64 + stream.uniform()) / count as f64;
            body.point(along, &mut stream)
        };
        (0..count).into_par_iter().filter_map(point).collect()
    };
    let (probes, points) = (spread(PROBES, 1), spread(POINTS, 2));
    let near_mm = NEAR * (area / POINTS as f64).sqrt();
    let of_chunk = |(chunk, probes): (usize, &[SurfacePoint])| {
        let mut far = Far::new(near_mm, body.diagonal_mm);
        let mut sums = Sums { splines, profile, of: vec![[[0.0; POWERS]; SUPPORT]; splines.len()] };
        for (i, &probe) in probes.iter().enumerate() {
            let mut stream = Stream::new(mix(seed ^ 3), chunk as u64 * CHUNK + i as u64);
            points.iter().for_each(|&point| far.add(probe, point));
            sums.near(body, probe, near_mm, &mut stream);
        }
        (sums.of, far)
    };
    let chunks: Vec<(Moments, Far)> = probes.par_chunks(CHUNK as usize).enumerate().map(of_chunk).collect();
    let mut far = Far::new(near_mm, body.diagonal_mm);
    let mut total = Sums { splines, profile, of: vec![[[0.0; POWERS]; SUPPORT]; splines.len()] };
    let add = |to: &mut [f64], from: &[f64]| to.iter_mut().zip(from).for_each(|(t, p)| *t += p);
    for (near, of_chunk) in &chunks {
        add(total.of.as_flattened_mut().as_flattened_mut(), near.as_flattened().as_flattened());
        add(far.of.as_flattened_mut(), of_chunk.of.as_flattened());
    }
    for (step, powers) in far.of.iter().enumerate().filter(|(_, powers)| powers[0] > 0.0) {
        total.add(far.at(step), powers.map(|sum| sum * (area / POINTS as f64)));
    }
    total.of.as_flattened_mut().as_flattened_mut().iter_mut().for_each(|sum| *sum *= area / PROBES as f64);
    total.of
}

/// Pairs that are no nearer than a distance, and their heights and squared heights, by the logarithm of the distance.
struct Far {
    from_mm: f64,
    of: Vec<[f64; POWERS]>,
}

impl Far {
    fn new(from_mm: f64, to_mm: f64) -> Self {
        let steps = ((to_mm / from_mm).max(1.0).ln() * STEPS) as usize;
        Self { from_mm, of: vec![[0.0; POWERS]; steps + 3] }
    }

    fn add(&mut self, o: SurfacePoint, i: SurfacePoint) {
        let (r, heights) = distance_and_heights(o, i);
        let place = (r / self.from_mm).ln() * STEPS;
        if place >= 0.0 {
            let step = (place as usize).min(self.of.len() - 2);
            let along = (place - step as f64).min(1.0);
            for (sums, share) in self.of[step..step + 2].iter_mut().zip([1.0 - along, along]) {
                let product = share * heights;
                sums[0] += share;
                sums[1] += product;
                sums[2] += product * heights;
            }
        }
    }

    /// The distance of a step, mm.
    fn at(&self, step: usize) -> f64 {
        self.from_mm * (step as f64 / STEPS).exp()
    }
}

struct Sums<'a> {
    splines: &'a Splines,
    profile: &'a dyn Profile,
    of: Moments,
}

impl Sums<'_> {
    /// Adds pairs at a distance (mm): how much of the surface they stand for, mm^2, and that times their heights and squared heights (mm).
    fn add(&mut self, r: f64, powers: [f64; POWERS]) {
        let fade = self.splines.fade_per_mm(r);
        let (first, values) = self.splines.at(r);
        let reflectance = self.profile.reflectance(r);
        let faded = [powers[0], powers[1] * fade, powers[2] * fade * fade].map(|power| reflectance * power);
        for (j, &left) in values.iter().enumerate() {
            let Some(entry) = self.of.get_mut(first + j) else { continue };
            for (sums, &right) in entry.iter_mut().zip(&values[j..]) {
                sums.iter_mut().zip(faded).for_each(|(sum, power)| *sum += left * right * power);
            }
        }
    }

    fn near(&mut self, body: &Body, probe: SurfacePoint, near_mm: f64, stream: &mut Stream) {
        let inner = (INNERMOST * self.splines.first_mm).min(0.5 * near_mm);
        self.add(0.5 * inner, [PI * inner * inner, 0.0, 0.0]);
        let (tangent, bitangent) = probe.normal.any_orthonormal_pair();
        let axes = [probe.normal, tangent, bitangent];
        let growth = (near_mm / inner).ln();
        // Crossings for each mm^2 of a surface at a point with a normal, over all lines.
        let density = |at_mm: DVec3, normal: DVec3| {
            let of = |axis: &DVec3| {
                let rho2 = (at_mm - probe.at_mm).reject_from_normalized(*axis).length_squared();
                let reached = rho2 >= inner * inner && rho2 < near_mm * near_mm;
                if reached { axis.dot(normal).abs() / (TAU * rho2 * growth) } else { 0.0 }
            };
            axes.iter().zip(SHARES).map(|(axis, share)| share as f64 * of(axis)).sum::<f64>() * ROUNDS as f64
        };
        let mut found = Vec::new();
        for (axis, share) in (0..3).zip(SHARES) {
            let lines = share * ROUNDS;
            let (along, (x, y)) = (axes[axis], (axes[(axis + 1) % 3], axes[(axis + 2) % 3]));
            for line in 0..lines {
                let rho = inner * (growth * (line as f64 + stream.uniform()) / lines as f64).exp();
                let (sin, cos) = (TAU * stream.uniform()).sin_cos();
                let start = probe.at_mm + rho * (cos * x + sin * y) + near_mm * along;
                let ray = Ray {
                    origin: start.as_vec3(),
                    direction: -along.as_vec3(),
                    t_min: 0.0,
                    t_max: (2.0 * near_mm) as f32,
                };
                found.clear();
                body.boundary.bvh().crossings(&ray, |hit| found.push((f64::from(hit.t), hit.triangle)));
                for &(t, triangle) in &found {
                    let (at_mm, normal) = (start - t * along, body.normal(triangle));
                    let (r, heights) = distance_and_heights(probe, SurfacePoint { at_mm, normal });
                    // A crossing at the very end of the lines' reach has no density by rounding.
                    let density = density(at_mm, normal);
                    if r < near_mm && density > 0.0 {
                        self.add(r, [1.0, heights, heights * heights].map(|power| power / density));
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::uniform;
    use crate::medium::fresnel::BoundaryFit;
    use crate::transport::test_scene::named;

    #[test]
    fn pairs_counted_by_their_distance_are_those_that_are_added_one_by_one() {
        let between = |i: u64, axis: u64| 2.0 * uniform(5, i, axis) - 1.0;
        let triple = |i: u64, axis: u64| DVec3::new(between(i, axis), between(i, axis + 1), between(i, axis + 2));
        let point = |i| SurfacePoint { at_mm: 10.0 * triple(i, 0), normal: triple(i, 3).normalize() };
        let points: Vec<SurfacePoint> = (0..200).map(point).collect();
        let splines = Splines::new(0.2, 35.0, 1.6);
        for profile in named("skin1").dipoles(BoundaryFit::Published) {
            let sums =
                || Sums { splines: &splines, profile: &profile, of: vec![[[0.0; POWERS]; SUPPORT]; splines.len()] };
            let (mut one_by_one, mut most, mut counted) = (sums(), sums(), sums());
            let mut far = Far::new(1.0, 35.0);
            for (&o, &i) in points.iter().flat_map(|o| points.iter().map(move |i| (o, i))) {
                far.add(o, i);
                let (r, heights) = distance_and_heights(o, i);
                if r >= 1.0 {
                    one_by_one.add(r, [1.0, heights, heights * heights]);
                    most.add(r, [1.0, heights.abs(), heights * heights]);
                }
            }
            far.of.iter().enumerate().for_each(|(step, powers)| counted.add(far.at(step), *powers));
            for power in 0..POWERS {
                let of = |sums: &Sums| sums.of.as_flattened().iter().map(|powers| powers[power]).collect::<Vec<f64>>();
                let largest = of(&most).into_iter().fold(0.0, f64::max);
                for (counted, exact) in of(&counted).iter().zip(of(&one_by_one)) {
                    assert!((counted - exact).abs() < 4e-5 * largest, "{power}: {counted} {exact} of {largest}");
                }
            }
        }
    }
}
