//! One photon from its entrance to its end.

use std::f64::consts::{FRAC_PI_2, LN_2};

use glam::DVec3;

use super::boundary::{Boundary, Crossing, Site};
use crate::math::random::mix;
use crate::medium::fresnel;
use crate::medium::material::OpticalProperties;
use crate::medium::phase::HenyeyGreenstein;

/// A photon below this weight goes on with the probability of its weight, and then has the weight 1: unbiased, and weights
/// stay in [1/2, 1], so that no estimate of a share has more variance than that of photons which live or die as wholes.
/// The number of scattering events plays no part: where nothing is absorbed, no weight ever grows.
const LEAST_WEIGHT: f64 = 0.5;

/// Reflections without scattering in between after which a photon counts as trapped: light that total reflection keeps in
/// a clear body for good.
const MOST_REFLECTIONS: u32 = 10_000;

/// Events after which a photon counts as trapped. Even a body of a thousand mean free paths lets go after 1e6 or so.
const MOST_EVENTS: u64 = 1 << 32;

/// One channel of a medium, prepared for walks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WalkMedium {
    /// Mean of the free path 1/sigma_t, unreduced, in mm; infinite without extinction.
    pub free_path_mm: f64,
    /// sigma_s / sigma_t, unreduced.
    pub albedo: f64,
    /// Refractive index inside over outside.
    pub eta_inside_over_outside: f64,
    /// Phase function.
    pub phase: HenyeyGreenstein,
}

impl WalkMedium {
    /// The red, green or blue channel (0, 1, 2) of a medium.
    pub fn new(properties: &OpticalProperties, channel: usize) -> Self {
        let value = |v: DVec3| v.to_array().get(channel).copied().unwrap_or(0.0);
        let (scattering, extinction) = (value(properties.sigma_s_per_mm()), value(properties.sigma_t_per_mm()));
        Self {
            free_path_mm: if extinction > 0.0 { 1.0 / extinction } else { f64::INFINITY },
            albedo: if extinction > 0.0 { (scattering / extinction).clamp(0.0, 1.0) } else { 0.0 },
            eta_inside_over_outside: properties.eta_inside_over_outside,
            phase: HenyeyGreenstein::new(properties.g),
        }
    }
}

/// Random numbers of one photon: each is a function of the key and of the number drawn before.
#[derive(Clone, Copy, Debug)]
pub struct Stream {
    key: u64,
    drawn: u64,
}

impl Stream {
    /// The numbers of photon `index` of `stage`.
    pub fn new(stage: u64, index: u64) -> Self {
        Self { key: mix(mix(stage) ^ index), drawn: 0 }
    }

    /// The next 64 random bits.
    #[inline(always)]
    pub fn bits(&mut self) -> u64 {
        let value = mix(self.key ^ self.drawn);
        self.drawn += 1;
        value
    }

    /// The next number, uniform in the open interval (0, 1).
    #[inline(always)]
    pub fn uniform(&mut self) -> f64 {
        open_unit(self.bits())
    }
}

/// 53 bits to the middle of their interval, never 0 or 1.
#[inline(always)]
fn open_unit(bits: u64) -> f64 {
    ((bits >> 12) as f64 + 0.5) * (1.0 / (1u64 << 52) as f64)
}

/// Place and direction in which a photon starts inside the medium.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Start {
    /// Position just inside the boundary, mm.
    pub at_mm: DVec3,
    /// Unit direction inside.
    pub direction: DVec3,
}

/// End of a photon.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum End {
    /// The photon left the medium.
    Left {
        /// The place where it left.
        site: Site,
        /// Scattering events before.
        order: u64,
        /// Weight on leaving, of 1 at the start.
        weight: f64,
    },
    /// The photon was absorbed.
    Absorbed,
    /// The photon was found outside without having left, with this weight.
    Lost(f64),
    /// Total reflection keeps the photon inside, with this weight.
    Trapped(f64),
}

/// A photon's end and its scattering events.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Walked {
    /// End of the photon.
    pub end: End,
    /// Scattering events.
    pub collisions: u64,
}

/// Walks one photon of weight 1 to its end.
pub fn walk<B: Boundary>(boundary: &B, medium: &WalkMedium, start: Start, stream: &mut Stream) -> Walked {
    if medium.phase.g() == 0.0 {
        walk_with(boundary, medium, start, stream, |_, azimuth, xi| {
            let z = 2.0 * xi - 1.0;
            let radius = ((1.0 - z) * (1.0 + z)).sqrt();
            DVec3::new(radius * azimuth[0], radius * azimuth[1], z)
        })
    } else {
        let phase = medium.phase;
        walk_with(boundary, medium, start, stream, move |direction, azimuth, xi| {
            let cosine = phase.sample_cosine(xi);
            let radius = ((1.0 - cosine) * (1.0 + cosine)).max(0.0).sqrt();
            let (t, b) = direction.any_orthonormal_pair();
            // Lengths drift by a rounding error a turn; one step of Newton's method for 1/sqrt holds them at 1.
            let turned = cosine * direction + radius * (azimuth[0] * t + azimuth[1] * b);
            turned * (1.5 - 0.5 * turned.length_squared())
        })
    }
}

#[inline(always)]
fn walk_with<B: Boundary>(
    boundary: &B,
    medium: &WalkMedium,
    start: Start,
    stream: &mut Stream,
    turn: impl Fn(DVec3, [f64; 2], f64) -> DVec3,
) -> Walked {
    let Start { mut at_mm, mut direction } = start;
    let (mut weight, mut order, mut depth) = (1.0, 0u64, 1u32);
    let (mut reflections, mut events) = (0, 0u64);
    let end = loop {
        let reach = medium.free_path_mm * minus_ln(stream.uniform());
        match boundary.crossing(at_mm, direction, reach, &mut depth) {
            Crossing::Inside => {
                at_mm += reach * direction;
                order += 1;
                reflections = 0;
                weight *= medium.albedo;
                if weight < LEAST_WEIGHT {
                    if stream.uniform() >= weight {
                        break End::Absorbed;
                    }
                    weight = 1.0;
                }
                let bits = stream.bits();
                // The upper half for the azimuth, the lower for the cosine.
                let xi = ((bits & 0xffff_ffff) as f64 + 0.5) * (1.0 / 4_294_967_296.0);
                direction = turn(direction, cos_sin((bits >> 32) as u32), xi);
            }
            Crossing::Surface { inside_mm, normal, site } => {
                let cosine = direction.dot(normal);
                let reflected = fresnel::reflectance_inside(medium.eta_inside_over_outside, cosine);
                if reflected < 1.0 && stream.uniform() >= reflected {
                    break End::Left { site, order, weight };
                }
                reflections += 1;
                if reflections > MOST_REFLECTIONS {
                    break End::Trapped(weight);
                }
                direction = (direction - 2.0 * cosine * normal).normalize_or_zero();
                at_mm = inside_mm;
            }
            Crossing::Lost => break End::Lost(weight),
        }
        events += 1;
        if events > MOST_EVENTS {
            break End::Trapped(weight);
        }
    };
    Walked { end, collisions: order }
}

/// -ln(x) for x in (0, 1), to 1e-12 relative or 1e-14: the same bits on every machine, unlike the system's.
#[inline(always)]
fn minus_ln(x: f64) -> f64 {
    // x = m 2^e with m in [sqrt(1/2), sqrt(2)): adding the distance of sqrt(1/2) to 1 in the bits carries into the exponent.
    const TO_ONE: u64 = 1.0f64.to_bits() - std::f64::consts::FRAC_1_SQRT_2.to_bits();
    let shifted = x.to_bits().wrapping_add(TO_ONE);
    let exponent = (shifted >> 52) as i64 - 1023;
    let m = f64::from_bits(x.to_bits().wrapping_sub((exponent as u64) << 52));
    // ln m = 2 artanh((m - 1) / (m + 1)), |argument| < 0.1716.
    let s = (m - 1.0) / (m + 1.0);
    let q = s * s;
    let series = 1.0
        + q * (1.0 / 3.0
            + q * (1.0 / 5.0 + q * (1.0 / 7.0 + q * (1.0 / 9.0 + q * (1.0 / 11.0 + q * (1.0 / 13.0 + q / 15.0))))));
    -(exponent as f64 * LN_2 + 2.0 * s * series)
}

/// Cosine and sine of an angle that is uniform over the turn for uniform bits, to 1e-12.
#[inline(always)]
fn cos_sin(bits: u32) -> [f64; 2] {
    // Two bits choose the quarter; the rest an angle in [-pi/4, pi/4), by the series of both functions.
    let r = (f64::from(bits & 0x3fff_ffff) + 0.5) * (FRAC_PI_2 / f64::from(1u32 << 30)) - 0.5 * FRAC_PI_2;
    let q = r * r;
    let cosine = 1.0
        - q * (1.0 / 2.0
            - q * (1.0 / 24.0
                - q * (1.0 / 720.0 - q * (1.0 / 40_320.0 - q * (1.0 / 3_628_800.0 - q / 479_001_600.0)))));
    let sine = r
        * (1.0
            - q * (1.0 / 6.0
                - q * (1.0 / 120.0
                    - q * (1.0 / 5040.0 - q * (1.0 / 362_880.0 - q * (1.0 / 39_916_800.0 - q / 6_227_020_800.0))))));
    let (c, s) = if bits & 1 << 31 == 0 { (cosine, sine) } else { (-cosine, -sine) };
    if bits & 1 << 30 == 0 { [c, s] } else { [-s, c] }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_logarithm_is_that_of_the_system() {
        for i in 0..200_000u64 {
            let x = open_unit(mix(i)) * if i % 3 == 0 { 1e-9 } else { 1.0 };
            let (own, system) = (minus_ln(x), -x.ln());
            assert!((own - system).abs() <= 1e-14 + 1e-12 * system, "{x}: {own} {system}");
        }
        for x in [open_unit(0), open_unit(u64::MAX), 0.5, std::f64::consts::FRAC_1_SQRT_2] {
            assert!((minus_ln(x) + x.ln()).abs() < 1e-11 && minus_ln(x) > 0.0, "{x}");
        }
    }

    #[test]
    fn azimuths_are_unit_vectors_in_every_direction() {
        let mut sums = [0.0; 5];
        let n = 1 << 16;
        for i in 0..n {
            let [c, s] = cos_sin((i as u32) << 16 | 0x8000);
            assert!((c * c + s * s - 1.0).abs() < 1e-11);
            [c, s, c * s, c * c - s * s, s * s - 0.5].iter().zip(&mut sums).for_each(|(v, sum)| *sum += v);
        }
        assert!(sums.iter().all(|s| s.abs() < 1e-6 * n as f64), "{sums:?}");
    }
}
