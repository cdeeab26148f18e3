//! The inner loops of the transfer: point sources and flat triangles against a block of receivers, in f32.
//!
//! A block holds a few dozen receivers that lie close together; coordinates are relative to the block's centre, so
//! that single precision loses nothing. Sums run in f32 over at most `FLUSH` sources and are then added to f64.

use glam::DVec3;

use super::simd::multiversion;
use crate::medium::dipole::Pole;

/// Sources summed in f32 before the sum is added to its f64 total.
const FLUSH: usize = 32;

/// Gauss points on each edge of a triangle that is integrated exactly.
const EDGE_POINTS: usize = 8;

/// A point source of flux: one surface sample, or a cluster of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct PointSource {
    /// Position relative to the block's centre, mm.
    pub at: [f32; 3],
    /// Irradiance times area, mm^2 times the unit of irradiance, RGB.
    pub flux: [f32; 3],
}

/// A flat triangle of uniform irradiance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlatSource {
    /// Corners relative to the block's centre, mm.
    pub corners: [[f32; 3]; 3],
    /// Unit normal.
    pub normal: [f32; 3],
    /// Irradiance, RGB.
    pub irradiance: [f32; 3],
}

impl FlatSource {
    /// The triangle seen from a block centred at `centre`; `None` if it has no area.
    pub fn new(corners: [DVec3; 3], irradiance: [f32; 3], centre: DVec3) -> Option<Self> {
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).try_normalize()?;
        Some(Self {
            corners: corners.map(|c| (c - centre).as_vec3().to_array()),
            normal: normal.as_vec3().to_array(),
            irradiance,
        })
    }
}

/// One term `weight (1 + sigma d) exp(-sigma d) / d^3` of R_d, d^2 = r^2 + z^2, in single precision.
#[derive(Clone, Copy, Debug, Default)]
struct Term {
    weight: f32,
    z2: f32,
    sigma: f32,
}

/// R_d of the three channels in single precision: a real and a virtual source each (Jensen et al. 2001).
#[derive(Clone, Copy, Debug, Default)]
pub struct KernelRgb {
    terms: [[Term; 2]; 3],
}

impl KernelRgb {
    /// From the poles of each channel's profile.
    pub fn new(poles: [[Pole; 2]; 3]) -> Self {
        let term =
            |p: Pole| Term { weight: p.weight as f32, z2: (p.z_mm * p.z_mm) as f32, sigma: p.sigma_per_mm as f32 };
        Self { terms: poles.map(|channel| channel.map(term)) }
    }
}

/// Receivers of one block and their sums. All arrays have the same length.
#[derive(Clone, Debug, Default)]
pub struct Block {
    /// Coordinates relative to the block's centre, mm.
    pub at: [Vec<f32>; 3],
    /// Radiosity so far, RGB.
    pub sums: [Vec<f64>; 3],
    partial: [Vec<f32>; 3],
    scratch: [Vec<f32>; 7],
}

impl Block {
    /// A block of `receivers` around `centre`, its sums zero; `lanes` is the length that arrays are padded to.
    pub fn reset(&mut self, centre: DVec3, receivers: &[DVec3]) {
        let lanes = receivers.len().next_multiple_of(LANES);
        for (axis, at) in self.at.iter_mut().enumerate() {
            at.clear();
            at.extend(receivers.iter().map(|r| (r[axis] - centre[axis]) as f32));
            at.resize(lanes, 0.0);
        }
        for sums in &mut self.sums {
            sums.clear();
            sums.resize(lanes, 0.0);
        }
        for array in self.partial.iter_mut().chain(&mut self.scratch) {
            array.clear();
            array.resize(lanes, 0.0);
        }
    }

    /// RGB sum of one receiver.
    pub fn sum(&self, receiver: usize) -> DVec3 {
        DVec3::new(self.sums[0][receiver], self.sums[1][receiver], self.sums[2][receiver])
    }
}

/// Receivers come in multiples of this many lanes.
pub const LANES: usize = 16;

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
    let p = p * f + 0.009_618_009_5;
    let p = p * f + 0.055_503_327;
    let p = p * f + 0.240_226_51;
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

#[inline(always)]
fn points_body(block: &mut Block, kernel: &KernelRgb, sources: &[PointSource]) {
    let lanes = block.at[0].len();
    let [x, y, z] = &block.at;
    let (x, y, z) = (&x[..lanes], &y[..lanes], &z[..lanes]);
    let [r2, ..] = &mut block.scratch;
    let r2 = &mut r2[..lanes];
    for chunk in sources.chunks(FLUSH) {
        for partial in &mut block.partial {
            partial.fill(0.0);
        }
        for s in chunk {
            for i in 0..lanes {
                let (dx, dy, dz) = (x[i] - s.at[0], y[i] - s.at[1], z[i] - s.at[2]);
                r2[i] = dx * dx + dy * dy + dz * dz;
            }
            for (channel, partial) in block.partial.iter_mut().enumerate() {
                let [real, image] = kernel.terms[channel];
                let flux = s.flux[channel];
                let partial = &mut partial[..lanes];
                for i in 0..lanes {
                    partial[i] += flux * (reflectance(real, r2[i]) + reflectance(image, r2[i]));
                }
            }
        }
        flush(&mut block.sums, &block.partial);
    }
}

#[inline(always)]
fn flush(sums: &mut [Vec<f64>; 3], partial: &[Vec<f32>; 3]) {
    for (sums, partial) in sums.iter_mut().zip(partial) {
        for (sum, partial) in sums.iter_mut().zip(partial) {
            *sum += f64::from(*partial);
        }
    }
}

multiversion! {
    /// Adds `flux * R_d(|x - at|)` of every source to every receiver of the block.
    pub fn add_points(block: &mut Block, kernel: &KernelRgb, sources: &[PointSource]) => points_body
}

/// Nodes and weights of Gauss-Legendre quadrature with [`EDGE_POINTS`] points on [-1, 1].
const GAUSS: [(f32, f32); EDGE_POINTS] = [
    (-0.960_289_856_497_536_2, 0.101_228_536_290_376_26),
    (-0.796_666_477_413_626_7, 0.222_381_034_453_374_47),
    (-0.525_532_409_916_329, 0.313_706_645_877_887_3),
    (-0.183_434_642_495_649_8, 0.362_683_783_378_361_98),
    (0.183_434_642_495_649_8, 0.362_683_783_378_361_98),
    (0.525_532_409_916_329, 0.313_706_645_877_887_3),
    (0.796_666_477_413_626_7, 0.222_381_034_453_374_47),
    (0.960_289_856_497_536_2, 0.101_228_536_290_376_26),
];

/// Int over a flat triangle of R_d, receiver at height H over its plane, is a sum over the edges of
/// Int (tail(H) - tail(|x - e|)) d theta, theta the angle around the receiver's foot point. With tau = tan(theta / 2)
/// an edge at distance p from the foot is |x - e|^2 = H^2 + p^2 ((1 + tau^2) / (1 - tau^2))^2, d theta = 2 d tau / (1 + tau^2).
#[inline(always)]
fn triangles_body(block: &mut Block, kernel: &KernelRgb, sources: &[FlatSource]) {
    for chunk in sources.chunks(FLUSH) {
        for partial in &mut block.partial {
            partial.fill(0.0);
        }
        for source in chunk {
            triangle_into_partial(block, kernel, source);
        }
        flush(&mut block.sums, &block.partial);
    }
}

#[inline(always)]
fn triangle_into_partial(block: &mut Block, kernel: &KernelRgb, source: &FlatSource) {
    let lanes = block.at[0].len();
    let Block { at: [x, y, z], partial, scratch, .. } = block;
    let (x, y, z) = (&x[..lanes], &y[..lanes], &z[..lanes]);
    let [height2, pedal2, middle, half, t2, weight, angle] = scratch;
    let (height2, pedal2) = (&mut height2[..lanes], &mut pedal2[..lanes]);
    let (middle, half) = (&mut middle[..lanes], &mut half[..lanes]);
    let (t2, weight, angle) = (&mut t2[..lanes], &mut weight[..lanes], &mut angle[..lanes]);
    let n = source.normal;
    let a = source.corners[0];
    for i in 0..lanes {
        let h = n[0] * (x[i] - a[0]) + n[1] * (y[i] - a[1]) + n[2] * (z[i] - a[2]);
        height2[i] = h * h;
        angle[i] = 0.0;
    }
    for edge in 0..3 {
        let from = source.corners[edge];
        let to = source.corners[(edge + 1) % 3];
        let along = [to[0] - from[0], to[1] - from[1], to[2] - from[2]];
        let length = (along[0] * along[0] + along[1] * along[1] + along[2] * along[2]).sqrt();
        if length <= 0.0 {
            continue;
        }
        let u = [along[0] / length, along[1] / length, along[2] / length];
        // Perpendicular to the edge in the plane: u x n points out of the triangle.
        let outward = [u[1] * n[2] - u[2] * n[1], u[2] * n[0] - u[0] * n[2], u[0] * n[1] - u[1] * n[0]];
        for i in 0..lanes {
            let (dx, dy, dz) = (from[0] - x[i], from[1] - y[i], from[2] - z[i]);
            let pedal = dx * outward[0] + dy * outward[1] + dz * outward[2];
            let s0 = dx * u[0] + dy * u[1] + dz * u[2];
            let s1 = s0 + length;
            let p = pedal.abs();
            let p2 = pedal * pedal;
            let tau0 = s0 / (p + (p2 + s0 * s0).sqrt()).max(f32::MIN_POSITIVE);
            let tau1 = s1 / (p + (p2 + s1 * s1).sqrt()).max(f32::MIN_POSITIVE);
            pedal2[i] = p2;
            middle[i] = 0.5 * (tau0 + tau1);
            let sign = if pedal == 0.0 { 0.0 } else { f32::copysign(1.0, pedal) };
            // The sign travels with the half width: it enters the weight once.
            half[i] = sign * 0.5 * (tau1 - tau0);
        }
        for (node, node_weight) in GAUSS {
            for i in 0..lanes {
                let tau = middle[i] + half[i].abs() * node;
                let tau2 = tau * tau;
                let plus = 1.0 + tau2;
                let secant = plus / (1.0 - tau2).max(1e-6);
                t2[i] = height2[i] + pedal2[i] * (secant * secant);
                weight[i] = (2.0 * node_weight) * half[i] / plus;
                angle[i] += weight[i];
            }
            for (channel, partial) in partial.iter_mut().enumerate() {
                let [real, image] = kernel.terms[channel];
                let irradiance = source.irradiance[channel];
                let partial = &mut partial[..lanes];
                for i in 0..lanes {
                    partial[i] -= (irradiance * weight[i]) * (tail(real, t2[i]) + tail(image, t2[i]));
                }
            }
        }
    }
    for (channel, partial) in partial.iter_mut().enumerate() {
        let [real, image] = kernel.terms[channel];
        let irradiance = source.irradiance[channel];
        let partial = &mut partial[..lanes];
        for i in 0..lanes {
            partial[i] += (irradiance * angle[i]) * (tail(real, height2[i]) + tail(image, height2[i]));
        }
    }
}

multiversion! {
    /// Adds `irradiance * Int R_d(|x - y|) dA(y)` over every flat triangle to every receiver of the block.
    pub fn add_triangles(block: &mut Block, kernel: &KernelRgb, sources: &[FlatSource]) => triangles_body
}
