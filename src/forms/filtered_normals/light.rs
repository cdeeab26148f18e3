//! Lights for local lighting: sharp ones as beams, visible or not; those from all around as harmonics of order 2.

use std::f64::consts::TAU;

use glam::DVec3;

use super::settings::Shadows;
use crate::error::Result;
use crate::geometry::bvh::{Bvh, NO_TRIANGLE, Ray, offset_origin};
use crate::light::cone::ConeFalloff;
use crate::light::harmonics::{coefficients, to_harmonics};
use crate::light::suns::apart;
use crate::light::{Light, refuse_fields};
use crate::math::quadrature::{gauss_legendre, gauss_legendre_cached};
use crate::math::sh::real_sh;
use crate::medium::fresnel;
use crate::parallel::*;

/// Cells along an edge of an area light.
const SIDE: usize = 4;

/// Bands of the harmonics (Ramamoorthi and Hanrahan 2001).
const BANDS: usize = 3;

/// Cells of the table of spread cosines, by cosine and by spread, and the Legendre bands behind it.
const COSINES: usize = 64;
const SPREADS: usize = 32;
const SPREAD_BANDS: usize = 96;

/// Height of a light over the horizon of a vertex, as a sine, from which on a shadow ray alone says whether light arrives; none is cast
/// below the horizon.
const HIGH: f64 = 0.3;

/// Points that are lit together.
const CHUNK: usize = 1024;

/// Light from one direction or one place.
enum Beam {
    Direction { from: DVec3, irradiance: DVec3 },
    Place { at: DVec3, intensity: DVec3, emission: Emission },
}

/// How a place of a light shines by direction.
enum Emission {
    /// By a cone, or everywhere.
    Cone(ConeFalloff),
    /// By the cosine to the normal of a rectangle.
    Cosine(DVec3),
}

/// A beam with its visible share from each point.
struct Seen {
    beam: Beam,
    seen: Vec<f32>,
}

/// Light from all around.
enum Around {
    Constant(DVec3),
    Harmonics(Vec<DVec3>),
}

/// `F_t(mu) max(0, mu)`, averaged over normals that spread about their mean as heat does on the sphere: harmonics of band l fall to
/// `length^(l (l + 1) / 2)` where the mean of the normals has that length.
struct SpreadCosine(Vec<[f64; COSINES + 1]>);

impl SpreadCosine {
    fn new(eta: f64) -> Self {
        let exact = |mu: f64| if mu > 0.0 { fresnel::transmittance(eta, mu) * mu } else { 0.0 };
        let cosine = |i: usize| 2.0 * i as f64 / COSINES as f64 - 1.0;
        let mut series = [0.0; SPREAD_BANDS];
        for node in gauss_legendre(SPREAD_BANDS) {
            let x = 0.5 * (node.position + 1.0);
            let (mu, weight) = (x * x, node.weight * x);
            for (l, (sum, p)) in series.iter_mut().zip(legendre(mu)).enumerate() {
                *sum += weight * (l as f64 + 0.5) * exact(mu) * p;
            }
        }
        let places: [[f64; SPREAD_BANDS]; COSINES + 1] = std::array::from_fn(|i| legendre(cosine(i)));
        let rows = (0..=SPREADS).map(|row| {
            if row == 0 {
                return std::array::from_fn(|i| exact(cosine(i)));
            }
            let length = 1.0 - (row as f64 / SPREADS as f64).powi(2);
            let bands: [f64; SPREAD_BANDS] =
                std::array::from_fn(|l| series[l] * length.powf((l * (l + 1)) as f64 / 2.0));
            places.map(|p| bands.iter().zip(p).map(|(band, p)| band * p).sum::<f64>().max(0.0))
        });
        Self(rows.collect())
    }

    /// Value for the cosine between a direction and the mean of the normals, which has a length from 0 to 1.
    fn at(&self, mu: f64, length: f64) -> f64 {
        let place = |x: f64, last: usize| {
            let x = x.clamp(0.0, last as f64);
            let cell = (x as usize).min(last - 1);
            (cell, x - cell as f64)
        };
        let (row, down) = place((1.0 - length).max(0.0).sqrt() * SPREADS as f64, SPREADS);
        let (column, right) = place((mu + 1.0) * 0.5 * COSINES as f64, COSINES);
        let of = |row: &[f64; COSINES + 1]| row[column] + right * (row[column + 1] - row[column]);
        let (narrow, wide) = (of(&self.0[row]), of(&self.0[row + 1]));
        narrow + down * (wide - narrow)
    }
}

/// Legendre polynomials of `mu`.
fn legendre(mu: f64) -> [f64; SPREAD_BANDS] {
    let mut p = [1.0; SPREAD_BANDS];
    p[1] = mu;
    for l in 2..SPREAD_BANDS {
        let n = l as f64;
        p[l] = ((2.0 * n - 1.0) * mu * p[l - 1] - (n - 1.0) * p[l - 2]) / n;
    }
    p
}

/// Fresnel transmission of one medium for light that enters.
pub(super) struct Entrance {
    eta: f64,
    cosine: SpreadCosine,
    /// `2 pi Int F_t mu P_l dmu` of each band.
    bands: [f64; BANDS],
}

impl Entrance {
    pub(super) fn new(eta: f64) -> Self {
        // F_t rises from 0 in a thin layer at the horizon where eta is near 1: mu = x^2 puts nodes there.
        let rule = gauss_legendre_cached(16);
        let mut bands = [0.0; BANDS];
        for node in rule {
            let x = 0.5 * (node.position + 1.0);
            let mu = x * x;
            let weight = TAU * node.weight * x * fresnel::transmittance(eta, mu) * mu;
            let legendre = [1.0, mu, 1.5 * mu * mu - 0.5];
            bands.iter_mut().zip(legendre).for_each(|(band, p)| *band += weight * p);
        }
        Self { eta, cosine: SpreadCosine::new(eta), bands }
    }
}

/// Lights for some points.
#[derive(Default)]
pub(super) struct Lit {
    beams: Vec<Seen>,
    around: Vec<Around>,
}

/// Points that are lit, with the data of their shadow rays.
#[derive(Clone, Copy)]
pub(super) struct Lookers<'a> {
    pub(super) at: &'a [DVec3],
    pub(super) normals: &'a [DVec3],
    /// Share of the sky that each sees.
    pub(super) open: &'a [f64],
    pub(super) origin_mm: DVec3,
    pub(super) shadows: Shadows,
}

impl Lit {
    pub(super) fn new(lookers: Lookers, bvh: &Bvh, lights: &[Light]) -> Result<Self> {
        refuse_fields(lights)?;
        let mut lit = Self::default();
        // Three bands of harmonics have no sun.
        for light in &apart(lights, |_| true) {
            match light {
                Light::Constant { radiance } => lit.around.push(Around::Constant(*radiance)),
                Light::Environment { .. } => lit.around.push(Around::Harmonics(coefficients(light, BANDS)?)),
                _ => {
                    for beam in beams(light, lookers.origin_mm) {
                        let seen = seen(&beam, lookers, bvh);
                        lit.beams.push(Seen { beam, seen });
                    }
                }
            }
        }
        Ok(lit)
    }

    /// Irradiance behind a surface at a point, RGB, over normals that have a unit vector times a length as their mean; `open` is the share
    /// of the sky that it sees.
    pub(super) fn irradiance(
        &self,
        point: usize,
        at: DVec3,
        (normal, length): (DVec3, f64),
        open: f64,
        entrance: &Entrance,
    ) -> DVec3 {
        let mut sum = DVec3::ZERO;
        for Seen { beam, seen } in &self.beams {
            let seen = f64::from(seen[point]);
            if seen == 0.0 {
                continue;
            }
            let (direction, arriving) = beam.towards(at);
            let arriving = seen * arriving;
            let mu = normal.dot(direction);
            if length < 1.0 {
                sum += arriving * entrance.cosine.at(mu, length);
            } else if mu > 0.0 {
                sum += arriving * (fresnel::transmittance(entrance.eta, mu) * mu);
            }
        }
        for around in &self.around {
            sum += open
                * match around {
                    Around::Constant(radiance) => entrance.bands[0] * *radiance,
                    Around::Harmonics(coefficients) => {
                        let mut y = [0.0; BANDS * BANDS];
                        real_sh(BANDS, to_harmonics(normal), &mut y);
                        let spread = [1.0, length, length.powi(3)];
                        let band = |k: usize| entrance.bands[k.isqrt()] * spread[k.isqrt()] * y[k];
                        let e: DVec3 = coefficients.iter().enumerate().map(|(k, c)| band(k) * *c).sum();
                        // Three bands of a strong sun undershoot on the far side.
                        e.max(DVec3::ZERO)
                    }
                };
        }
        sum
    }
}

impl Beam {
    /// Unit direction towards the light, and its irradiance on a surface that faces it.
    fn towards(&self, from: DVec3) -> (DVec3, DVec3) {
        match self {
            Self::Direction { from, irradiance } => (*from, *irradiance),
            Self::Place { at, intensity, emission } => {
                let to = *at - from;
                let distance2 = to.length_squared().max(1e-30);
                let direction = to / distance2.sqrt();
                let share = match emission {
                    Emission::Cone(falloff) => falloff.at(direction),
                    Emission::Cosine(normal) => (-direction.dot(*normal)).max(0.0),
                };
                (direction, *intensity * (share / distance2))
            }
        }
    }
}

fn beams(light: &Light, origin: DVec3) -> Vec<Beam> {
    match light {
        Light::Directional { from, irradiance } => vec![Beam::Direction { from: *from, irradiance: *irradiance }],
        Light::Area { at_mm, normal, u, size_mm, radiance, .. } => {
            let v = normal.cross(*u);
            let place = |i: usize| (i as f64 + 0.5) / SIDE as f64 - 0.5;
            let intensity = *radiance * (size_mm[0] * size_mm[1] / (SIDE * SIDE) as f64);
            (0..SIDE * SIDE)
                .map(|cell| {
                    let across = *u * (size_mm[0] * place(cell % SIDE)) + v * (size_mm[1] * place(cell / SIDE));
                    Beam::Place { at: *at_mm - origin + across, intensity, emission: Emission::Cosine(*normal) }
                })
                .collect()
        }
        other => other.from_place().map_or_else(Vec::new, |(at_mm, intensity, falloff)| {
            vec![Beam::Place { at: at_mm - origin, intensity, emission: Emission::Cone(falloff) }]
        }),
    }
}

/// Visible share of a beam from each point. Towards the horizon a ray depends on the bumps around a vertex more than on
/// the light, and below it light enters where the surface around the vertex faces it: there the share is that of the
/// sky.
fn seen(beam: &Beam, lookers: Lookers, bvh: &Bvh) -> Vec<f32> {
    let mut seen = vec![1.0; lookers.at.len()];
    if lookers.shadows == Shadows::Off {
        return seen;
    }
    seen.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, seen)| {
        let first = chunk * CHUNK;
        let (mut rays, mut shares) = (Vec::with_capacity(seen.len()), Vec::with_capacity(seen.len()));
        for (i, seen) in seen.iter_mut().enumerate() {
            let (at, normal) = (lookers.at[first + i], lookers.normals[first + i]);
            let (direction, _) = beam.towards(at);
            let high = (normal.dot(direction) / HIGH).clamp(0.0, 1.0);
            let share = high * high * (3.0 - 2.0 * high);
            *seen = ((1.0 - share) * lookers.open[first + i]) as f32;
            if share == 0.0 {
                continue;
            }
            let t_max = match beam {
                Beam::Direction { .. } => f32::INFINITY,
                Beam::Place { at: place, .. } => place.distance(at) as f32,
            };
            let origin = offset_origin(at.as_vec3(), normal.as_vec3());
            rays.push(Ray { origin, direction: direction.as_vec3(), t_min: 0.0, t_max });
            shares.push((i, share as f32));
        }
        let mut occluded = vec![false; rays.len()];
        bvh.occluded_many(&rays, &vec![NO_TRIANGLE; rays.len()], &mut occluded);
        shares.iter().zip(occluded).filter(|(_, occluded)| !occluded).for_each(|((i, share), _)| seen[*i] += share);
    });
    seen
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    #[test]
    fn normals_that_spread_lose_no_light() {
        for eta in [1.0, 1.3] {
            let cosine = SpreadCosine::new(eta);
            let rule = gauss_legendre(64);
            let mean = |length: f64| 0.5 * rule.iter().map(|n| n.weight * cosine.at(n.position, length)).sum::<f64>();
            let exact = 0.25 * fresnel::diffuse_transmittance(eta);
            for length in [0.0, 0.01, 0.3, 0.7, 0.95, 0.999, 1.0] {
                assert!((mean(length) / exact - 1.0).abs() < 3e-3, "{eta} {length}: {} {exact}", mean(length));
            }
            // All normals alike: the cosine itself; all directions: the mean, whatever the light.
            assert!((cosine.at(0.5, 1.0) - 0.5 * fresnel::transmittance(eta, 0.5)).abs() < 1e-3);
            assert!((cosine.at(-1.0, 0.0) / exact - 1.0).abs() < 1e-3);
            // A sphere seen as a whole: length 0; the normals of half a sphere: 1/2, seen from the side half of the front.
            assert!(cosine.at(0.0, 0.5) > 0.1 && cosine.at(1.0, 0.5) < 0.8 * cosine.at(1.0, 1.0));
        }
    }

    #[test]
    fn the_first_band_is_what_constant_light_sends_in() {
        for eta in [1.0, 1.001, 1.3, 1.5] {
            let exact = fresnel::diffuse_transmittance(eta);
            let found = Entrance::new(eta).bands[0] / PI;
            assert!((found / exact - 1.0).abs() < 2e-3, "{eta}: {found} {exact}");
        }
        // A clamped cosine: pi, 2 pi / 3, pi / 4.
        let [a, b, c] = Entrance::new(1.0).bands;
        assert!((a - PI).abs() < 1e-9 && (b - TAU / 3.0).abs() < 1e-9 && (c - PI / 4.0).abs() < 1e-9);
    }
}
