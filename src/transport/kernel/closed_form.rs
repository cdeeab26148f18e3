//! The dipole in closed form, in single precision: points 2e-7 and triangles 5e-7 to 2e-6 off their exact values, without a table.

use super::{
    EdgePrecision, EdgeRule, GAUSS_3, GAUSS_4, GAUSS_6, GAUSS_8, GAUSS_12, GAUSS_24, LANES, Radial, RadialIntegral,
    Row, RowValues, SeenTriangle,
};
use crate::math::simd::add_scaled;
use crate::medium::dipole::Pole;

/// One term `weight (1 + sigma d) exp(-sigma d) / d^3` of R_d, d^2 = r^2 + z^2, in single precision.
#[derive(Clone, Copy, Debug, Default)]
struct Term {
    weight: f32,
    z2: f32,
    sigma: f32,
}

/// R_d of the three channels: a real and a virtual source each (Jensen et al. 2001).
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct PolesRgb {
    terms: [[Term; 2]; 3],
    /// Depth of the shallowest source, mm.
    shallowest: f32,
}

impl PolesRgb {
    /// The kernel of the poles of each channel's profile, and the depth of the shallowest of them, mm.
    pub(super) fn new(poles: &[[Pole; 2]; 3], shallowest_mm: f64) -> Self {
        let term =
            |p: Pole| Term { weight: p.weight as f32, z2: (p.z_mm * p.z_mm) as f32, sigma: p.sigma_per_mm as f32 };
        Self { terms: poles.map(|channel| channel.map(term)), shallowest: shallowest_mm as f32 }
    }
}

impl EdgePrecision {
    /// Rules for edges up to a length over the distance of their nearest point, no less than the depth of the shallowest source.
    pub fn rules(self) -> &'static [EdgeRule] {
        match self {
            Self::Reference => &EDGE_RULES,
            Self::Near => &NEAR_EDGE_RULES,
        }
    }
}

/// Rules with errors of 5e-7 of the total reflectance up to 30 times the depth, 2e-6 beyond (worst case over the
/// published materials and extreme ones).
static EDGE_RULES: [EdgeRule; 5] =
    [(1.0, &GAUSS_4), (3.0, &GAUSS_6), (10.0, &GAUSS_8), (100.0, &GAUSS_12), (f32::INFINITY, &GAUSS_24)];

/// Rules with errors of 1e-5 of the total reflectance (worst case over the published materials and extreme ones):
/// coarser than those of the truth, and far finer than the three points that other samples get.
static NEAR_EDGE_RULES: [EdgeRule; 6] = [
    (0.8, &GAUSS_3),
    (2.5, &GAUSS_4),
    (8.0, &GAUSS_6),
    (25.0, &GAUSS_8),
    (80.0, &GAUSS_12),
    (f32::INFINITY, &GAUSS_24),
];

impl Radial for PolesRgb {
    type Values = [Row; 3];

    #[inline(always)]
    fn add_point(&self, sums: &mut [Row; 3], r2: &Row, flux: [f32; 3]) {
        for (channel, sums) in sums.iter_mut().enumerate() {
            let [real, image] = self.terms[channel];
            let flux = flux[channel];
            for i in 0..LANES {
                sums[i] += flux * (reflectance(real, r2[i]) + reflectance(image, r2[i]));
            }
        }
    }

    #[inline(always)]
    fn add_each(&self, sums: &mut [Row; 3], r2: &Row, flux: &[Row; 3]) {
        for (channel, sums) in sums.iter_mut().enumerate() {
            let [real, image] = self.terms[channel];
            for i in 0..LANES {
                sums[i] += flux[channel][i] * (reflectance(real, r2[i]) + reflectance(image, r2[i]));
            }
        }
    }
}

impl RadialIntegral for PolesRgb {
    type Values = [Row; 3];

    /// Int over a flat triangle of R_d is a sum over its edges of Int (tail(H) - tail(d)) p / (p^2 + s^2) ds, H the height
    /// of the receiver over the plane, p the signed distance of its foot from the edge's line, s the coordinate along it and
    /// d^2 = H^2 + z^2 + p^2 + s^2. With d0 = d at p = s = 0 the integrand of a term equals
    /// tail(H) p (1 + sigma d0 (1 - exp(-x)) / x) / (d (d + d0)), x = sigma (d - d0), which has no pole at p = s = 0.
    /// s = 2 D v / (1 - v^2), D^2 = H^2 + z^2 + p^2 with the z of the channel's real source, brings edges of any length into
    /// (-1, 1), where the integrand is bounded and analytic.
    #[inline(always)]
    fn triangle(&self, seen: &SeenTriangle, precision: EdgePrecision) -> [Row; 3] {
        let smooth2 = self.shallowest * self.shallowest;
        let rules = [0, 1, 2].map(|k| seen.rule_of_edge(k, smooth2, precision.rules()));
        let mut result = [[0.0; LANES]; 3];
        for (channel, result) in result.iter_mut().enumerate() {
            let terms = self.terms[channel];
            let mut sums = [[0.0; LANES]; 2];
            for (k, nodes) in rules.into_iter().enumerate() {
                edge_into(&mut sums, &seen.height2, (&seen.pedals[k], &seen.starts[k], &seen.lengths[k]), terms, nodes);
            }
            for i in 0..LANES {
                let sum = tail(terms[0], seen.height2[i]) * sums[0][i] + tail(terms[1], seen.height2[i]) * sums[1][i];
                // The edges of a near, but dark triangle cancel up to rounding.
                result[i] = sum.max(0.0);
            }
        }
        result
    }
}

impl RowValues for [Row; 3] {
    const ZERO: Self = [[0.0; LANES]; 3];

    #[inline(always)]
    fn add_scaled(&mut self, factor: [f32; 3], values: &Self) {
        for c in 0..3 {
            add_scaled(&mut self[c], factor[c], &values[c]);
        }
    }

    #[inline(always)]
    fn add_products(&mut self, factors: &[Row; 3], values: &Self) {
        for c in 0..3 {
            for i in 0..LANES {
                self[c][i] += factors[c][i] * values[c][i];
            }
        }
    }

    #[inline(always)]
    fn of_lane(&self, lane: usize) -> [f32; 3] {
        [self[0][lane], self[1][lane], self[2][lane]]
    }

    #[inline(always)]
    fn flush(&self, sums: &mut [[f64; LANES]; 3]) {
        for (sums, values) in sums.iter_mut().zip(self) {
            for (sum, value) in sums.iter_mut().zip(values) {
                *sum += f64::from(*value);
            }
        }
    }
}

/// exp(-x) for x >= 0, relative error below 2e-7; constant 2^-80 from x = 55 on, where nothing is left to see and
/// smaller numbers would become subnormal and slow.
///
/// 2^n * 2^f with n rounded by adding 1.5 * 2^23 and 2^f by a polynomial of degree 6 on [-0.5, 0.5]
/// (interpolated at the Chebyshev nodes).
#[inline(always)]
fn exp_neg(x: f32) -> f32 {
    const ROUND: f32 = 12_582_912.0;
    let t = (x * -std::f32::consts::LOG2_E).max(-80.0);
    let rounded = t + ROUND;
    let f = t - (rounded - ROUND);
    let p = 0.000_154_605_66_f32;
    let p = p * f + 0.001_339_988_5;
    let p = p * f + 0.009_618_009;
    let p = p * f + 0.055_503_327;
    let p = p * f + 0.240_226_5;
    let p = p * f + std::f32::consts::LN_2;
    let p = p * f + 1.0;
    let scale = f32::from_bits(rounded.to_bits().wrapping_add(127) << 23);
    p * scale
}

#[inline(always)]
fn reflectance(term: Term, r2: f32) -> f32 {
    let d2 = r2 + term.z2;
    let inverse = 1.0 / d2.sqrt();
    let x = term.sigma * (d2 * inverse);
    let cube = inverse * inverse * inverse;
    (term.weight * cube) * ((1.0 + x) * exp_neg(x))
}

/// `Int_t^inf R_d(s) s ds` of one term: weight exp(-sigma d) / d.
#[inline(always)]
fn tail(term: Term, t2: f32) -> f32 {
    let d2 = t2 + term.z2;
    let inverse = 1.0 / d2.sqrt();
    (term.weight * inverse) * exp_neg(term.sigma * (d2 * inverse))
}

/// `x + scale (1 - exp(-x))` over x, which is `1 + scale` at x = 0, without the cancellation there; times 1 / `divisor`.
#[inline(always)]
fn rise_over(x: f32, scale: f32, divisor: f32) -> f32 {
    let x = x.max(1e-12);
    let series = x * (1.0 - x * (0.5 - x * (1.0 / 6.0 - x * (1.0 / 24.0))));
    let decayed = if x < 0.1 { series } else { 1.0 - exp_neg(x) };
    (x + scale * decayed) / (x * divisor)
}

/// Adds Int (tail(H) - tail(d)) / tail(H) p / (p^2 + s^2) ds of one edge for both terms of a channel.
#[inline(always)]
fn edge_into(
    sums: &mut [Row; 2],
    height2: &Row,
    (pedals, starts, lengths): (&Row, &Row, &Row),
    [real, image]: [Term; 2],
    nodes: &[(f32, f32)],
) {
    let (mut span, mut middle, mut half) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
    let (mut real_d0, mut image_d0) = ([0.0; LANES], [0.0; LANES]);
    for i in 0..LANES {
        real_d0[i] = (height2[i] + real.z2).sqrt();
        image_d0[i] = (height2[i] + image.z2).sqrt();
        let span2 = height2[i] + real.z2 + pedals[i] * pedals[i];
        let (s0, s1) = (starts[i], starts[i] + lengths[i]);
        span[i] = span2.sqrt();
        let v0 = s0 / (span[i] + (span2 + s0 * s0).sqrt());
        let v1 = s1 / (span[i] + (span2 + s1 * s1).sqrt());
        middle[i] = 0.5 * (v0 + v1);
        half[i] = 0.5 * (v1 - v0);
    }
    for &(node, node_weight) in nodes {
        for i in 0..LANES {
            let v = middle[i] + half[i] * node;
            let v2 = v * v;
            let (plus, minus) = (1.0 + v2, (1.0 - v2).max(1e-7));
            let inverse = 1.0 / minus;
            // Distances times `minus`.
            let near = span[i] * plus;
            let far = (near * near + (image.z2 - real.z2) * (minus * minus)).sqrt();
            let weight = (2.0 * node_weight) * (half[i] * pedals[i]);
            let x = real.sigma * (near * inverse - real_d0[i]);
            sums[0][i] += weight * rise_over(x, real.sigma * real_d0[i], near + real_d0[i] * minus);
            let x = image.sigma * (far * inverse - image_d0[i]);
            let divisor = far * (far + image_d0[i] * minus);
            sums[1][i] += (weight * near) * rise_over(x, image.sigma * image_d0[i], divisor);
        }
    }
}

#[cfg(test)]
#[path = "closed_form_tests.rs"]
mod tests;
