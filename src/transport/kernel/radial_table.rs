//! Radial functions by tables over the squared distance, three channels side by side.
//!
//! Segments are even in the logarithm of r^2 + s^2, s the scale on which the function is smooth, 64 to each doubling:
//! the upper bits of the number are the index, and within a segment the function is a polynomial of r^2. Where the
//! function goes as a power p of that sum, a linear one is off by p (p + 1) / 32768 at most, 5e-4 where p is 4, and a
//! quadratic one by 3e-6.

use std::sync::Arc;

use super::{
    Block, EdgePrecision, EdgeRule, GAUSS_3, GAUSS_4, GAUSS_6, GAUSS_8, GAUSS_12, GAUSS_24, LANES, PointSource, Radial,
    RadialIntegral, Row, RowValues, SeenTriangle, points_body,
};
use crate::math::quadrature::{gauss_legendre_cached, integrate_with};
use crate::math::simd::{InstructionSet, multiversion};
use crate::medium::profile::Profile;
use crate::medium::softened::Softened;
use crate::parallel::*;

/// Bits of a mantissa within a segment of most tables, and of a [`SmoothTable`].
pub(crate) const SHIFT: u32 = 23 - 6;
pub(crate) const SMOOTH_SHIFT: u32 = 23 - 9;

/// Share of a profile within its smallest scale.
const INNERMOST: f64 = 1e-3;

/// The smallest scale over the reach at least.
const LEAST_SCALE: f64 = 1e-6;

/// Below this ratio of rho^2 to H^2 + s^2 the mean of R_d over a step is taken in place of a difference of tails.
pub(crate) const SHORT_STEP: f32 = 0.125;

/// Rules for edges up to a length over the distance of their nearest point, where R_d is smooth inside a scale: tables err more than any
/// of them.
pub(crate) static RULES: [EdgeRule; 6] =
    [(0.4, &GAUSS_3), (0.9, &GAUSS_4), (2.0, &GAUSS_6), (4.0, &GAUSS_8), (10.0, &GAUSS_12), (f32::INFINITY, &GAUSS_24)];

/// Widest instructions used: with wider ones compilers gather from the table, five times as slowly as by single loads.
pub(crate) const WIDEST: InstructionSet = InstructionSet::Avx2;

/// Order of the rule that integrates a function over a segment.
const TAIL_ORDER: usize = 4;

/// RGB and nothing.
pub(crate) type Rgb = [f32; 4];

/// `sum += factor value`, channel by channel.
#[inline(always)]
pub(in crate::transport) fn add_product(sum: &mut Rgb, factor: &Rgb, value: &Rgb) {
    for c in 0..4 {
        sum[c] += factor[c] * value[c];
    }
}

/// Coefficients of the powers of the squared distance (mm^2) beyond the start of a segment.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(32))]
struct Segment<const N: usize>([Rgb; N]);

/// A radial function, RGB, as polynomials of N coefficients on segments of so many bits; zero beyond its end.
#[derive(Clone, Debug)]
pub struct RadialTable<const N: usize, const BITS: u32> {
    /// s^2, mm^2, and its upper bits.
    scale2: f32,
    first: u32,
    /// The last one is zero.
    segments: Vec<Segment<N>>,
}

/// Table of linear pieces, which reads less than one of quadratic pieces.
pub type LinearTable = RadialTable<2, SHIFT>;

/// Table of quadratic pieces.
pub type QuadraticTable = RadialTable<3, SHIFT>;

/// Table of linear pieces so short that functions which are smooth on the scale of their reach are off by 3e-5.
pub type SmoothTable = RadialTable<2, SMOOTH_SHIFT>;

/// Places in a table of some squared distances: segments, and the squares beyond their starts, mm^2.
#[derive(Clone, Copy, Debug)]
pub(in crate::transport) struct Places<const L: usize> {
    index: [u32; L],
    beyond: [f32; L],
}

impl<const N: usize, const BITS: u32> RadialTable<N, BITS> {
    /// A table without segments, and the squared distances of its nodes: the start of the first segment and the end of
    /// each, mm^2.
    fn empty(scale_mm: f64, end_mm2: f64) -> (Self, Vec<f64>) {
        let end = end_mm2.clamp(1e-30, 1e30);
        let scale2 = (scale_mm * scale_mm).clamp(LEAST_SCALE * LEAST_SCALE * end, end) as f32;
        // A whole segment, so that the first node is at r = 0.
        let first = scale2.max(f32::MIN_POSITIVE).to_bits() >> BITS;
        let scale2 = f32::from_bits(first << BITS);
        let last = (end as f32 + scale2).to_bits() >> BITS;
        let square = |k: u32| f64::from(f32::from_bits(k << BITS)) - f64::from(scale2);
        (Self { scale2, first, segments: Vec::new() }, (first..=last + 1).map(square).collect())
    }

    /// The table with segments of these coefficients, `[channel][power]` each.
    fn filled(mut self, segments: impl Iterator<Item = [[f64; N]; 3]>) -> Self {
        let single = |channels: [[f64; N]; 3]| {
            let power = |k: usize| [channels[0][k] as f32, channels[1][k] as f32, channels[2][k] as f32, 0.0];
            Segment(std::array::from_fn(power))
        };
        self.segments = segments.map(single).collect();
        self.segments.push(Segment([[0.0; 4]; N]));
        self
    }

    /// Places of some squared distances (mm^2) in the table.
    #[inline(always)]
    pub(in crate::transport) fn places<const L: usize>(&self, r2: &[f32; L]) -> Places<L> {
        let last = (self.segments.len() as u32).wrapping_sub(1);
        let (mut index, mut beyond) = ([0; L], [0.0; L]);
        for i in 0..L {
            let x = r2[i] + self.scale2;
            let bits = x.to_bits() >> BITS;
            index[i] = (bits - self.first.min(bits)).min(last);
            beyond[i] = x - f32::from_bits(bits << BITS);
        }
        Places { index, beyond }
    }

    /// The value at one of some places.
    #[inline(always)]
    pub(in crate::transport) fn value<const L: usize>(&self, places: &Places<L>, i: usize) -> Rgb {
        let Some(Segment(powers)) = self.segments.get(places.index[i] as usize) else { return [0.0; 4] };
        // Not `map` nor `fold`: closures are not compiled for the instructions of their caller.
        let mut value = powers[N - 1];
        for power in powers[..N - 1].iter().rev() {
            for c in 0..4 {
                value[c] = power[c] + places.beyond[i] * value[c];
            }
        }
        value
    }

    /// The value at a squared distance, mm^2.
    #[inline(always)]
    pub(in crate::transport) fn at_square(&self, r2: f32) -> Rgb {
        self.value(&self.places(&[r2]), 0)
    }

    /// The table for a shader: the square that is added to r^2, mm^2; its upper bits, which are those of the first
    /// segment; the coefficients of each segment.
    #[cfg(feature = "gpu")]
    pub(crate) fn segments(&self) -> (f32, u32, Vec<[Rgb; N]>) {
        (self.scale2, self.first, self.segments.iter().map(|segment| segment.0).collect())
    }
}

impl<const BITS: u32> RadialTable<2, BITS> {
    /// The table that is linear between values of each channel at the nodes.
    fn linear(self, nodes: &[f64], values: &[Vec<f64>; 3]) -> Self {
        let segment = |k: usize| {
            values.each_ref().map(|values| [values[k], (values[k + 1] - values[k]) / (nodes[k + 1] - nodes[k])])
        };
        self.filled((0..nodes.len().saturating_sub(1)).map(segment))
    }
}

impl SmoothTable {
    /// Tabulates `value` over channel and squared distance (mm^2), smooth on a scale (mm), up to a reach, mm.
    pub(in crate::transport) fn new(scale_mm: f64, reach_mm: f64, value: impl Fn(usize, f64) -> f64) -> Self {
        let (table, nodes) = Self::empty(scale_mm, reach_mm * reach_mm);
        let values = [0, 1, 2].map(|c| nodes.iter().map(|&r2| finite(value(c, r2))).collect::<Vec<f64>>());
        table.linear(&nodes, &values)
    }
}

impl LinearTable {
    /// Tabulates `value`, a function of channel and distance (mm) that is zero beyond the reach. `tail` is
    /// `Int_r^inf value(s) s ds`, whose integral the first segment keeps even where there is no value at 0.
    fn new(
        (scale_mm, reach_mm): (f64, f64),
        value: impl Fn(usize, f64) -> f64 + Sync,
        tail: impl Fn(usize, f64) -> f64,
    ) -> Self {
        let (table, nodes) = Self::empty(scale_mm, reach_mm * reach_mm);
        let mut values = [0, 1, 2].map(|c| nodes.par_iter().map(|&x| value(c, x.sqrt())).collect::<Vec<f64>>());
        for (c, values) in values.iter_mut().enumerate() {
            if let ([zero, one, ..], [_, end, ..]) = (&mut values[..], &nodes[..]) {
                *zero = (4.0 * (positive(tail(c, 0.0)) - positive(tail(c, end.sqrt()))) / end - *one).max(*one);
            }
        }
        let values = values.map(|values| values.into_iter().map(finite).collect());
        table.linear(&nodes, &values)
    }

    /// Tabulates another function of channel and squared distance (mm^2), of either sign, in the segments of a table.
    pub(super) fn beside(table: &Self, value: impl Fn(usize, f64) -> f64) -> Self {
        let nodes = table.nodes();
        let values = [0, 1, 2].map(|c| nodes.iter().map(|&r2| finite(value(c, r2.max(0.0)))).collect::<Vec<f64>>());
        Self { scale2: table.scale2, first: table.first, segments: Vec::new() }.linear(&nodes, &values)
    }

    /// `Int_r^inf value(s) s ds` of a function of channel and squared distance (mm^2) of either sign, zero beyond the last segment,
    /// in the segments of a table.
    pub(super) fn tail_beside(table: &Self, value: impl Fn(usize, f64) -> f64) -> Self {
        let nodes = table.nodes();
        let rule = gauss_legendre_cached(TAIL_ORDER);
        let of_channel = |c: usize| {
            let mut tails = vec![0.0; nodes.len()];
            for k in (0..nodes.len().saturating_sub(1)).rev() {
                let integral =
                    integrate_with(rule, nodes[k].max(0.0), nodes[k + 1].max(0.0), |r2| finite(value(c, r2)));
                tails[k] = tails[k + 1] + 0.5 * integral;
            }
            tails
        };
        let tails = [0, 1, 2].map(of_channel);
        Self { scale2: table.scale2, first: table.first, segments: Vec::new() }.linear(&nodes, &tails)
    }

    /// Squared distances at the start of each segment, mm^2; the last one is where the table is zero.
    fn nodes(&self) -> Vec<f64> {
        let square = |k: u32| f64::from(f32::from_bits((self.first + k) << SHIFT)) - f64::from(self.scale2);
        (0..self.segments.len() as u32).map(square).collect()
    }

    /// Adds `flux f(|x - at|)` of every source to every receiver of the block.
    pub fn add_points(&self, level: InstructionSet, block: &mut Block, sources: &[PointSource]) {
        points(level, block, self, sources);
    }

    /// Tabulates three profiles less their softened forms, a difference that is zero beyond the radius, mm, inside
    /// which these were softened.
    pub fn compact(profiles: &[Arc<dyn Profile>; 3], softened: &[Softened; 3], radius_mm: f64) -> Self {
        let value = |c: usize, r: f64| softened[c].less(profiles[c].as_ref(), r * r);
        let outside: [f64; 3] = std::array::from_fn(|c| profiles[c].tail(radius_mm));
        let tail = |c: usize, r: f64| {
            if r < radius_mm { profiles[c].tail(r) - outside[c] - softened[c].tail_inside(r * r) } else { 0.0 }
        };
        Self::new((radius_containing(profiles, INNERMOST, radius_mm), radius_mm), value, tail)
    }

    /// The mean of [`Self::compact`]'s difference over a disc in the plane of the receiver, whose points have the mean
    /// squared distance `mean_square`, mm^2, from its centre.
    pub fn compact_disc(
        profiles: &[Arc<dyn Profile>; 3],
        softened: &[Softened; 3],
        radius_mm: f64,
        mean_square: f64,
    ) -> Self {
        // Two rings of eight points integrate polynomials of degree 5 over a disc.
        let rings = [0.5 - 0.5 / 3f64.sqrt(), 0.5 + 0.5 / 3f64.sqrt()].map(|share| (2.0 * mean_square * share).sqrt());
        let cosines = [1.0, 3.0, 5.0, 7.0].map(|k| (k * std::f64::consts::PI / 8.0).cos());
        let value = |c: usize, r: f64| {
            let at = |ring: f64, cosine: f64| {
                let square = (r * r + ring * ring + 2.0 * r * ring * cosine).max(0.0);
                softened[c].less(profiles[c].as_ref(), square)
            };
            rings.iter().flat_map(|&ring| cosines.map(|cosine| finite(at(ring, cosine)))).sum::<f64>() / 8.0
        };
        Self::new((radius_containing(profiles, INNERMOST, radius_mm), radius_mm), value, |_, _| 0.0)
    }
}

impl QuadraticTable {
    /// Tabulates `value` over channel and squared distance (mm^2), smooth on a scale (mm), up to `end_mm2`.
    pub fn new(scale_mm: f64, end_mm2: f64, value: impl Fn(usize, f64) -> f64) -> Self {
        let (table, nodes) = Self::empty(scale_mm, end_mm2);
        let segment = |pair: &[f64]| {
            let (from, to) = (pair[0], pair[1]);
            let step = to - from;
            [0, 1, 2].map(|c| {
                let [a, m, b] = [from, 0.5 * (from + to), to].map(|r2| finite(value(c, r2)));
                [a, (4.0 * m - 3.0 * a - b) / step, 2.0 * (a + b - 2.0 * m) / step / step]
            })
        };
        table.filled(nodes.windows(2).map(segment))
    }
}

/// The smallest radius (mm) that holds a share of one of three profiles, of those that are not zero, at most the reach.
fn radius_containing(profiles: &[Arc<dyn Profile>; 3], share: f64, reach_mm: f64) -> f64 {
    let radii = profiles.iter().map(|p| p.radius_containing_mm(share)).filter(|r| *r > 0.0);
    radii.fold(reach_mm, f64::min).max(LEAST_SCALE * reach_mm)
}

/// The value clamped to the range of single precision; 0 if it is not finite.
fn finite(value: f64) -> f64 {
    if value.is_finite() { value.clamp(-1e30, 1e30) } else { 0.0 }
}

/// [`finite`], at least 0.
fn positive(value: f64) -> f64 {
    finite(value).max(0.0)
}

/// Any profiles of three channels, by tables.
#[derive(Clone, Debug)]
pub(super) struct ProfileTable {
    /// R_d, 1/mm^2.
    pub(super) reflectance: LinearTable,
    /// `Int_r^inf R_d(s) s ds`, in the same segments.
    pub(super) tail: LinearTable,
    /// The scale on which the profiles are smooth, mm.
    pub(super) smooth_mm: f64,
}

impl ProfileTable {
    /// Tables of three profiles up to a distance in mm; beyond it they are zero.
    pub(super) fn new(profiles: &[Arc<dyn Profile>; 3], reach_mm: f64) -> Self {
        let reach = if reach_mm.is_finite() && reach_mm > 0.0 { reach_mm.min(1e15) } else { 1.0 };
        let scale = radius_containing(profiles, INNERMOST, reach);
        let (tail, nodes) = LinearTable::empty(scale, reach * reach);
        let tails =
            profiles.each_ref().map(|p| nodes.iter().map(|&x| positive(p.tail(x.sqrt()))).collect::<Vec<f64>>());
        Self {
            reflectance: LinearTable::new(
                (scale, reach),
                |c, r| positive(profiles[c].reflectance(r)),
                |c, r| profiles[c].tail(r),
            ),
            tail: tail.linear(&nodes, &tails),
            smooth_mm: radius_containing(profiles, 0.05, reach),
        }
    }
}

impl RowValues for [Rgb; LANES] {
    const ZERO: Self = [[0.0; 4]; LANES];

    #[inline(always)]
    fn add_scaled(&mut self, [red, green, blue]: [f32; 3], values: &Self) {
        let factor = [red, green, blue, 0.0];
        for (sum, value) in self.iter_mut().zip(values) {
            add_product(sum, &factor, value);
        }
    }

    #[inline(always)]
    fn add_products(&mut self, factors: &[Row; 3], values: &Self) {
        for i in 0..LANES {
            for c in 0..3 {
                self[i][c] += factors[c][i] * values[i][c];
            }
        }
    }

    #[inline(always)]
    fn of_lane(&self, lane: usize) -> [f32; 3] {
        let [red, green, blue, _] = self[lane];
        [red, green, blue]
    }

    #[inline(always)]
    fn flush(&self, sums: &mut [[f64; LANES]; 3]) {
        for (c, sums) in sums.iter_mut().enumerate() {
            for (sum, value) in sums.iter_mut().zip(self) {
                *sum += f64::from(value[c]);
            }
        }
    }
}

impl<const BITS: u32> Radial for RadialTable<2, BITS> {
    type Values = [Rgb; LANES];

    #[inline(always)]
    fn add_point(&self, sums: &mut [Rgb; LANES], r2: &Row, [red, green, blue]: [f32; 3]) {
        let places = self.places(r2);
        let flux = [red, green, blue, 0.0];
        for (lane, sum) in sums.iter_mut().enumerate() {
            add_product(sum, &flux, &self.value(&places, lane));
        }
    }

    #[inline(always)]
    fn add_each(&self, sums: &mut [Rgb; LANES], r2: &Row, [red, green, blue]: &[Row; 3]) {
        let places = self.places(r2);
        for (lane, sum) in sums.iter_mut().enumerate() {
            add_product(sum, &[red[lane], green[lane], blue[lane], 0.0], &self.value(&places, lane));
        }
    }
}

multiversion! {
    fn points(block: &mut Block, table: &LinearTable, sources: &[PointSource]) => points_body::<LinearTable>, up to WIDEST
}

/// An edge as the receivers of a row see it, ready for a rule on [-1, 1].
pub(super) struct SeenEdge {
    pedal: Row,
    height2: Row,
    span: Row,
    middle: Row,
    half: Row,
}

/// A node of the rule along an edge: where it is, and the length of edge that it stands for.
pub(super) struct EdgeNode {
    /// Squared distances from the foot of the receiver, mm^2.
    step2: Row,
    /// Length along the edge, mm.
    pub(super) length: Row,
    /// Places of the node and, for short steps, halfway to the foot in r^2.
    pub(super) far: Places<LANES>,
    between: Places<LANES>,
}

impl SeenEdge {
    /// One of the edges of a triangle; the integrand varies on the scale of a length whose square, mm^2, is given.
    #[inline(always)]
    pub(super) fn new(seen: &SeenTriangle, k: usize, smooth2: f32) -> Self {
        let (start, length) = (&seen.starts[k], &seen.lengths[k]);
        let mut edge = Self {
            pedal: seen.pedals[k],
            height2: seen.height2,
            span: [0.0; LANES],
            middle: [0.0; LANES],
            half: [0.0; LANES],
        };
        for i in 0..LANES {
            let (s0, s1) = (start[i], start[i] + length[i]);
            let span2 = edge.height2[i] + smooth2 + edge.pedal[i] * edge.pedal[i];
            edge.span[i] = span2.sqrt();
            let v0 = s0 / (edge.span[i] + (span2 + s0 * s0).sqrt());
            let v1 = s1 / (edge.span[i] + (span2 + s1 * s1).sqrt());
            edge.middle[i] = 0.5 * (v0 + v1);
            edge.half[i] = 0.5 * (v1 - v0);
        }
        edge
    }

    /// A node of the rule, with its places in tables of the segments of one.
    #[inline(always)]
    pub(super) fn node(&self, (node, node_weight): (f32, f32), table: &LinearTable) -> EdgeNode {
        let (mut step2, mut length, mut far2, mut middle2) = ([0.0; LANES], [0.0; LANES], [0.0; LANES], [0.0; LANES]);
        for i in 0..LANES {
            let v = self.middle[i] + self.half[i] * node;
            let v2 = v * v;
            let minus = (1.0 - v2).max(1e-7);
            let s = 2.0 * self.span[i] * v / minus;
            let slope = 2.0 * self.span[i] * (1.0 + v2) / (minus * minus);
            step2[i] = self.pedal[i] * self.pedal[i] + s * s;
            length[i] = node_weight * self.half[i] * slope;
            far2[i] = self.height2[i] + step2[i];
            middle2[i] = self.height2[i] + 0.5 * step2[i];
        }
        EdgeNode { step2, length, far: table.places(&far2), between: table.places(&middle2) }
    }
}

/// A radial function f and `Int_r^inf f(s) s ds`, in the same segments.
pub(super) struct WithTail<'a> {
    pub(super) value: &'a LinearTable,
    pub(super) tail: &'a LinearTable,
}

impl WithTail<'_> {
    /// `(tail(H) - tail(d)) / step^2`: half the mean of the function over r^2 between the foot, at a distance H, and a node at d.
    #[inline(always)]
    pub(super) fn half_mean(&self, foot: &Places<LANES>, node: &EdgeNode, height2: &Row, i: usize) -> Rgb {
        let mut mean = [0.0; 4];
        if node.step2[i] < SHORT_STEP * (height2[i] + self.value.scale2) {
            // Simpson's rule for half the mean over r^2.
            let (a, m) = (self.value.value(foot, i), self.value.value(&node.between, i));
            let b = self.value.value(&node.far, i);
            for c in 0..4 {
                mean[c] = (a[c] + 4.0 * m[c] + b[c]) * (1.0 / 12.0);
            }
        } else {
            let (a, b) = (self.tail.value(foot, i), self.tail.value(&node.far, i));
            let inverse = 1.0 / node.step2[i];
            for c in 0..4 {
                mean[c] = (a[c] - b[c]) * inverse;
            }
        }
        mean
    }
}

impl ProfileTable {
    /// The profiles with their tails.
    #[inline(always)]
    pub(super) fn with_tail(&self) -> WithTail<'_> {
        WithTail { value: &self.reflectance, tail: &self.tail }
    }

    /// The rule along an edge of a triangle.
    #[inline(always)]
    pub(super) fn rule(&self, seen: &SeenTriangle, k: usize) -> &'static [(f32, f32)] {
        seen.rule_of_edge(k, self.smooth2(), &RULES)
    }

    /// The square of the scale on which the profiles are smooth, mm^2.
    #[inline(always)]
    pub(super) fn smooth2(&self) -> f32 {
        (self.smooth_mm * self.smooth_mm) as f32
    }
}

/// Values of at least 0: the edges of a near, but dark triangle cancel up to rounding.
#[inline(always)]
pub(super) fn at_least_zero(sums: &mut [Rgb; LANES]) {
    for sum in sums {
        for value in sum {
            *value = value.max(0.0);
        }
    }
}

impl RadialIntegral for ProfileTable {
    type Values = [Rgb; LANES];

    /// As for dipoles: a sum over the edges of Int (tail(H) - tail(d)) p / (p^2 + s^2) ds.
    #[inline(always)]
    fn triangle(&self, seen: &SeenTriangle, _: EdgePrecision) -> [Rgb; LANES] {
        let height2 = &seen.height2;
        let foot = self.reflectance.places(height2);
        let profiles = self.with_tail();
        let mut sums = [[0.0; 4]; LANES];
        for k in 0..3 {
            let edge = SeenEdge::new(seen, k, self.smooth2());
            for &at in self.rule(seen, k) {
                let node = edge.node(at, &self.reflectance);
                for (i, sum) in sums.iter_mut().enumerate() {
                    let mean = profiles.half_mean(&foot, &node, height2, i);
                    let weight = node.length[i] * edge.pedal[i];
                    for c in 0..4 {
                        sum[c] += weight * mean[c];
                    }
                }
            }
        }
        at_least_zero(&mut sums);
        sums
    }
}

#[cfg(test)]
#[path = "radial_table_tests.rs"]
mod tests;
