//! The inner loops of the transfer: point sources and flat triangles against a block of receivers, in f32.
//!
//! A block holds a few dozen receivers that lie close together; coordinates are relative to the block's centre, so
//! that single precision loses little. Sums run in f32 over at most `FLUSH` sources and are then added to f64.

pub mod near;
pub mod radial_table;

use glam::DVec3;

use crate::math::quadrature::gauss_legendre_const;
use crate::math::simd::multiversion;
use crate::medium::dipole::Pole;

/// Sources summed in f32 before the sum is added to its f64 total.
const FLUSH: usize = 32;

/// A point source of flux: one surface sample, or a cluster of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct PointSource {
    /// Position relative to the block's centre, mm.
    pub at: [f32; 3],
    /// Irradiance times area, mm^2 times the unit of irradiance, RGB.
    pub flux: [f32; 3],
}

/// A flat triangle of uniform irradiance, as a block sees it. What depends on the triangle alone is taken in double
/// precision, so that single precision loses only a part in 2^24 of the block's own size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlatSource {
    /// Unit normal.
    normal: [f32; 3],
    /// Height of the block's centre over the plane, mm.
    height: f32,
    edges: [Edge; 3],
    /// Irradiance, RGB.
    irradiance: [f32; 3],
}

/// An edge of a triangle, seen from the foot of the block's centre in the triangle's plane.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Edge {
    /// Unit vector along the edge.
    along: [f32; 3],
    /// Unit vector in the plane, perpendicular to the edge, away from the triangle.
    outward: [f32; 3],
    /// Distance to the edge's line along `outward`, mm.
    pedal: f32,
    /// Coordinate of its first end along `along`, mm.
    start: f32,
    /// Length, mm.
    length: f32,
}

impl FlatSource {
    /// The triangle seen from a block centred at `centre`; `None` if it has no area.
    pub fn new(corners: [DVec3; 3], irradiance: [f32; 3], centre: DVec3) -> Option<Self> {
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).try_normalize()?;
        let edge = |index: usize| {
            let (from, to) = (corners[index], corners[(index + 1) % 3]);
            let along = (to - from).try_normalize()?;
            let outward = along.cross(normal);
            Some(Edge {
                along: along.as_vec3().to_array(),
                outward: outward.as_vec3().to_array(),
                pedal: (from - centre).dot(outward) as f32,
                start: (from - centre).dot(along) as f32,
                length: from.distance(to) as f32,
            })
        };
        Some(Self {
            normal: normal.as_vec3().to_array(),
            height: normal.dot(centre - corners[0]) as f32,
            edges: [edge(0)?, edge(1)?, edge(2)?],
            irradiance,
        })
    }
}

impl FlatSource {
    /// Squared heights of receivers over the plane, mm^2.
    #[inline(always)]
    fn height2(&self, [x, y, z]: [&Row; 3]) -> Row {
        let n = self.normal;
        let mut height2 = [0.0; LANES];
        for i in 0..LANES {
            let h = self.height + (n[0] * x[i] + n[1] * y[i] + n[2] * z[i]);
            height2[i] = h * h;
        }
        height2
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
    /// Depth of the shallowest source, mm.
    shallowest: f32,
}

impl KernelRgb {
    /// From the poles of each channel's profile.
    pub fn new(poles: [[Pole; 2]; 3]) -> Self {
        let term =
            |p: Pole| Term { weight: p.weight as f32, z2: (p.z_mm * p.z_mm) as f32, sigma: p.sigma_per_mm as f32 };
        let shallowest = poles.iter().flatten().map(|p| p.z_mm).fold(f64::MAX, f64::min) as f32;
        Self { terms: poles.map(|channel| channel.map(term)), shallowest }
    }
}

/// One value for each receiver of a row.
type Row = [f32; LANES];

/// Receivers that are computed side by side, and their sums.
#[derive(Clone, Copy, Debug)]
struct Receivers {
    /// Coordinates relative to the block's centre, mm.
    at: [Row; 3],
    /// Radiosity so far, RGB.
    sums: [[f64; LANES]; 3],
}

/// Receivers of one block and their sums.
#[derive(Clone, Debug, Default)]
pub struct Block {
    rows: Vec<Receivers>,
}

impl Block {
    /// A block of `receivers` around `centre`, its sums zero.
    pub fn reset(&mut self, centre: DVec3, receivers: &[DVec3]) {
        self.rows.clear();
        for chunk in receivers.chunks(LANES) {
            let mut row = Receivers { at: [[0.0; LANES]; 3], sums: [[0.0; LANES]; 3] };
            for (lane, receiver) in chunk.iter().enumerate() {
                for axis in 0..3 {
                    row.at[axis][lane] = (receiver[axis] - centre[axis]) as f32;
                }
            }
            self.rows.push(row);
        }
    }

    /// The sums of all receivers, RGB, which then are zero again.
    pub fn take(&mut self, out: &mut [[f32; 3]]) {
        for (row, out) in self.rows.iter_mut().zip(out.chunks_mut(LANES)) {
            for (lane, out) in out.iter_mut().enumerate() {
                *out = [0, 1, 2].map(|c| row.sums[c][lane] as f32);
            }
            row.sums = [[0.0; LANES]; 3];
        }
    }

    /// RGB sum of one receiver.
    pub fn sum(&self, receiver: usize) -> DVec3 {
        DVec3::from_array(self.rows[receiver / LANES].sums.map(|channel| channel[receiver % LANES]))
    }
}

/// Receivers of a row: one AVX-512 register, two of AVX2, four of SSE or NEON.
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

#[inline(always)]
fn points_body(block: &mut Block, kernel: &KernelRgb, sources: &[PointSource]) {
    for chunk in sources.chunks(FLUSH) {
        for row in &mut block.rows {
            let mut partial = [[0.0; LANES]; 3];
            for source in chunk {
                point_into(&mut partial, &row.at, kernel, source);
            }
            flush(&mut row.sums, &partial);
        }
    }
}

#[inline(always)]
fn point_into(partial: &mut [Row; 3], [x, y, z]: &[Row; 3], kernel: &KernelRgb, source: &PointSource) {
    let mut r2 = [0.0; LANES];
    for i in 0..LANES {
        let (dx, dy, dz) = (x[i] - source.at[0], y[i] - source.at[1], z[i] - source.at[2]);
        r2[i] = dx * dx + dy * dy + dz * dz;
    }
    for (channel, partial) in partial.iter_mut().enumerate() {
        let [real, image] = kernel.terms[channel];
        let flux = source.flux[channel];
        for i in 0..LANES {
            partial[i] += flux * (reflectance(real, r2[i]) + reflectance(image, r2[i]));
        }
    }
}

#[inline(always)]
fn flush(sums: &mut [[f64; LANES]; 3], partial: &[Row; 3]) {
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

/// Nodes and weights of a Gauss-Legendre rule on [-1, 1] in single precision.
const fn rule<const N: usize>() -> [(f32, f32); N] {
    let nodes = gauss_legendre_const::<N>();
    let mut result = [(0.0, 0.0); N];
    let mut i = 0;
    while i < N {
        result[i] = (nodes[i].position as f32, nodes[i].weight as f32);
        i += 1;
    }
    result
}

static GAUSS_4: [(f32, f32); 4] = rule();
static GAUSS_6: [(f32, f32); 6] = rule();
static GAUSS_8: [(f32, f32); 8] = rule();
static GAUSS_12: [(f32, f32); 12] = rule();
static GAUSS_24: [(f32, f32); 24] = rule();

/// A Gauss-Legendre rule, nodes on [-1, 1] and weights, for edges up to a length over the depth of the shallowest source.
pub type EdgeRule = (f32, &'static [(f32, f32)]);

/// 5e-7 of the total reflectance up to 30 times the depth, 2e-6 beyond (worst case over the published materials and
/// extreme ones).
pub static EDGE_RULES: [EdgeRule; 5] =
    [(1.0, &GAUSS_4), (3.0, &GAUSS_6), (10.0, &GAUSS_8), (100.0, &GAUSS_12), (f32::INFINITY, &GAUSS_24)];

/// The first rule that is long enough, or the last.
#[inline(always)]
fn edge_rule(rules: &'static [EdgeRule], ratio: f32) -> &'static [(f32, f32)] {
    let longest = rules.iter().find(|(limit, _)| ratio <= *limit).or(rules.last());
    longest.map_or(&[], |(_, nodes)| nodes)
}

#[inline(always)]
fn triangles_body(block: &mut Block, kernel: &KernelRgb, sources: &[FlatSource]) {
    for chunk in sources.chunks(FLUSH) {
        for row in &mut block.rows {
            let mut partial = [[0.0; LANES]; 3];
            for source in chunk {
                triangle_into(&mut partial, &row.at, kernel, source);
            }
            flush(&mut row.sums, &partial);
        }
    }
}

/// `x + scale (1 - exp(-x))` over x, which is `1 + scale` at x = 0, without the cancellation there; times 1 / `divisor`.
#[inline(always)]
fn rise_over(x: f32, scale: f32, divisor: f32) -> f32 {
    let x = x.max(1e-12);
    let series = x * (1.0 - x * (0.5 - x * (1.0 / 6.0 - x * (1.0 / 24.0))));
    let decayed = if x < 0.1 { series } else { 1.0 - exp_neg(x) };
    (x + scale * decayed) / (x * divisor)
}

/// Int over a flat triangle of R_d is a sum over its edges of Int (tail(H) - tail(d)) p / (p^2 + s^2) ds, H the height
/// of the receiver over the plane, p the signed distance of its foot from the edge's line, s the coordinate along it and
/// d^2 = H^2 + z^2 + p^2 + s^2. With d0 = d at p = s = 0 the integrand of a term equals
/// tail(H) p (1 + sigma d0 (1 - exp(-x)) / x) / (d (d + d0)), x = sigma (d - d0), which has no pole at p = s = 0.
/// s = 2 D v / (1 - v^2), D^2 = H^2 + z^2 + p^2 with the z of the channel's real source, brings edges of any length into
/// (-1, 1), where the integrand is bounded and analytic.
#[inline(always)]
fn triangle_into(partial: &mut [Row; 3], [x, y, z]: &[Row; 3], kernel: &KernelRgb, source: &FlatSource) {
    let edges = &source.edges;
    let height2 = source.height2([x, y, z]);
    let (mut pedals, mut starts) = ([[0.0; LANES]; 3], [[0.0; LANES]; 3]);
    for (k, e) in edges.iter().enumerate() {
        let (o, u) = (e.outward, e.along);
        for i in 0..LANES {
            pedals[k][i] = e.pedal - (o[0] * x[i] + o[1] * y[i] + o[2] * z[i]);
            starts[k][i] = e.start - (u[0] * x[i] + u[1] * y[i] + u[2] * z[i]);
        }
    }
    let longest = edges[0].length.max(edges[1].length).max(edges[2].length);
    let nodes = edge_rule(&EDGE_RULES, longest / kernel.shallowest);
    for (channel, partial) in partial.iter_mut().enumerate() {
        let terms = kernel.terms[channel];
        let mut sums = [[0.0; LANES]; 2];
        for (k, e) in edges.iter().enumerate() {
            edge_into(&mut sums, &height2, (&pedals[k], &starts[k], &[e.length; LANES]), terms, nodes);
        }
        let irradiance = source.irradiance[channel];
        for i in 0..LANES {
            let sum = tail(terms[0], height2[i]) * sums[0][i] + tail(terms[1], height2[i]) * sums[1][i];
            // The edges of a near, but dark triangle cancel up to rounding.
            partial[i] += irradiance * sum.max(0.0);
        }
    }
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

multiversion! {
    /// Adds `irradiance * Int R_d(|x - y|) dA(y)` over every flat triangle to every receiver of the block.
    pub fn add_triangles(block: &mut Block, kernel: &KernelRgb, sources: &[FlatSource]) => triangles_body
}

#[cfg(test)]
#[path = "kernel_tests.rs"]
mod tests;
