//! Any radial profile by tables: R_d and its tail over the squared distance, three channels side by side.
//!
//! Nodes are even in the logarithm of r^2 + s^2, 64 to each doubling: the upper bits of the number are the index, and between
//! nodes the table is linear in r^2. R_d that goes as a power p of that sum is off by p (p + 1) / 32768 at most, 5e-4 where p is 4.

use std::sync::Arc;

use rayon::prelude::*;

use super::{Block, FLUSH, FlatSource, GAUSS_8, GAUSS_12, GAUSS_24, LANES, PointSource, Receivers, Row, edge_rule};
use crate::math::simd::{Level, multiversion};
use crate::medium::profile::Profile;
use crate::medium::softened::Softened;

/// Bits of a mantissa within a segment.
const SHIFT: u32 = 23 - 6;

/// Share of a profile within its smallest scale.
const INNERMOST: f64 = 1e-3;

/// The smallest scale over the reach at least.
const LEAST_SCALE: f64 = 1e-6;

/// Below this ratio of rho^2 to H^2 + s^2 the mean of R_d over a step is taken in place of a difference of tails.
const SHORT_STEP: f32 = 0.125;

/// Rules for edges up to a length over the scale on which R_d is smooth.
static RULES: [super::EdgeRule; 3] = [(2.0, &GAUSS_8), (20.0, &GAUSS_12), (f32::INFINITY, &GAUSS_24)];

/// Beyond these instructions nothing is gained: compilers gather from the table where single loads are five times as fast.
const WIDEST: Level = Level::Avx2;

/// RGB and nothing.
pub(crate) type Rgb = [f32; 4];

/// A segment: the value at its start, and its slope.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C, align(32))]
pub(in crate::transport) struct Segment {
    pub(in crate::transport) value: Rgb,
    pub(in crate::transport) slope: Rgb,
}

/// Profiles of three channels.
#[derive(Clone, Debug)]
pub struct RadialTable {
    /// s^2, mm^2.
    scale2: f32,
    /// Upper bits of s^2.
    first: u32,
    /// R_d, 1/mm^2; the last one is zero.
    reflectance: Vec<Segment>,
    /// `Int_r^inf R_d(s) s ds`; the last one is zero.
    tail: Vec<Segment>,
    /// The scale on which the profiles are smooth, mm.
    pub(in crate::transport) smooth_mm: f64,
}

/// A place in a table: a segment, and the square beyond its start, mm^2.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::transport) struct Place {
    index: u32,
    beyond: f32,
}

/// Places in a table.
struct At {
    index: [u32; LANES],
    beyond: Row,
}

impl RadialTable {
    /// Of three profiles up to a distance in mm; beyond it they are zero.
    pub fn new(profiles: &[Arc<dyn Profile>; 3], reach_mm: f64) -> Self {
        let reach = if reach_mm.is_finite() && reach_mm > 0.0 { reach_mm.min(1e15) } else { 1.0 };
        Self::of(profiles, reach, |c, r| profiles[c].reflectance(r), |c, r| profiles[c].tail(r))
    }

    /// Of what three profiles have more than their softened forms, which is nothing beyond the radius, mm, that these were softened
    /// inside.
    pub fn compact(profiles: &[Arc<dyn Profile>; 3], softened: &[Softened; 3], radius_mm: f64) -> Self {
        let value = |c: usize, r: f64| softened[c].inside(r * r).map_or(0.0, |soft| profiles[c].reflectance(r) - soft);
        let outside: [f64; 3] = std::array::from_fn(|c| profiles[c].tail(radius_mm));
        let tail = |c: usize, r: f64| {
            if r < radius_mm { profiles[c].tail(r) - outside[c] - softened[c].tail_inside(r * r) } else { 0.0 }
        };
        Self::of(profiles, radius_mm, value, tail)
    }

    /// The mean of the same over a disc, in the plane of the receiver, whose points are `mean_square` mm^2 from its centre in
    /// the mean of squares.
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
                let s = (r * r + ring * ring + 2.0 * r * ring * cosine).max(0.0);
                softened[c].inside(s).map_or(0.0, |soft| profiles[c].reflectance(s.sqrt()) - soft)
            };
            rings.iter().flat_map(|&ring| cosines.map(|cosine| finite(at(ring, cosine)))).sum::<f64>() / 8.0
        };
        Self::of(profiles, radius_mm, value, |_, _| 0.0)
    }

    /// Values and tails of each channel by distance (mm), as far as they matter; the scales are those of the profiles.
    fn of(
        profiles: &[Arc<dyn Profile>; 3],
        reach: f64,
        value: impl Fn(usize, f64) -> f64 + Sync,
        tail: impl Fn(usize, f64) -> f64,
    ) -> Self {
        let containing = |share: f64| {
            let radii = profiles.iter().map(|p| p.radius_containing_mm(share)).filter(|r| *r > 0.0);
            radii.fold(reach, f64::min).max(LEAST_SCALE * reach)
        };
        let scale = containing(INNERMOST);
        let scale2 = ((scale * scale) as f32).max(f32::MIN_POSITIVE);
        // A whole segment, so that the first node is at r = 0.
        let scale2 = f32::from_bits(scale2.to_bits() >> SHIFT << SHIFT).max(f32::MIN_POSITIVE);
        let first = scale2.to_bits() >> SHIFT;
        let last = ((reach * reach) as f32 + scale2).to_bits() >> SHIFT;
        let square = |k: u32| f64::from(f32::from_bits(k << SHIFT)) - f64::from(scale2);
        let nodes: Vec<f64> = (first..=last + 1).map(square).collect();
        let mut table = Self { scale2, first, reflectance: Vec::new(), tail: Vec::new(), smooth_mm: containing(0.05) };
        let tails = [0, 1, 2].map(|c| nodes.iter().map(|&x| finite(tail(c, x.sqrt()))).collect::<Vec<f64>>());
        let mut values = [0, 1, 2].map(|c| nodes.par_iter().map(|&x| value(c, x.sqrt())).collect::<Vec<f64>>());
        for (values, tails) in values.iter_mut().zip(&tails) {
            // What the first segment reflects is right even where R_d has no value at 0.
            if let ([zero, one, ..], [tail, next, ..]) = (&mut values[..], &tails[..]) {
                *zero = (4.0 * (tail - next) / nodes[1] - *one).max(*one);
            }
            values.iter_mut().for_each(|v| *v = finite(*v));
        }
        table.reflectance = segments(&nodes, &values);
        table.tail = segments(&nodes, &tails);
        table
    }

    /// The value at a squared distance (mm^2), 1/mm^2, RGB and nothing.
    #[inline(always)]
    pub(in crate::transport) fn reflectance_at_square(&self, r2: f32) -> Rgb {
        self.reflectance_at(self.place(r2))
    }

    /// Where a squared distance (mm^2) is in the table.
    #[inline(always)]
    pub(in crate::transport) fn place(&self, r2: f32) -> Place {
        let x = r2 + self.scale2;
        let bits = x.to_bits() >> SHIFT;
        let index = (bits - self.first.min(bits)).min((self.reflectance.len() as u32).wrapping_sub(1));
        Place { index, beyond: x - f32::from_bits(bits << SHIFT) }
    }

    /// The same of four.
    #[inline(always)]
    pub(in crate::transport) fn places(&self, r2: &[f32; 4]) -> [Place; 4] {
        let last = (self.reflectance.len() as u32).wrapping_sub(1);
        let (mut index, mut beyond) = ([0; 4], [0.0; 4]);
        for i in 0..4 {
            let x = r2[i] + self.scale2;
            let bits = x.to_bits() >> SHIFT;
            index[i] = (bits - self.first.min(bits)).min(last);
            beyond[i] = x - f32::from_bits(bits << SHIFT);
        }
        std::array::from_fn(|i| Place { index: index[i], beyond: beyond[i] })
    }

    /// The value at a place, 1/mm^2, RGB and nothing.
    #[inline(always)]
    pub(in crate::transport) fn reflectance_at(&self, Place { index, beyond }: Place) -> Rgb {
        let Some(segment) = self.reflectance.get(index as usize) else { return [0.0; 4] };
        let mut value = segment.value;
        // Not `map`: closures are not compiled for the instructions of their caller.
        for (value, slope) in value.iter_mut().zip(&segment.slope) {
            *value += slope * beyond;
        }
        value
    }

    #[inline(always)]
    fn at(&self, r2: &Row) -> At {
        let mut at = At { index: [0; LANES], beyond: [0.0; LANES] };
        for ((index, beyond), r2) in at.index.iter_mut().zip(&mut at.beyond).zip(r2) {
            let x = r2 + self.scale2;
            let bits = x.to_bits() >> SHIFT;
            *index = bits - self.first.min(bits);
            *beyond = x - f32::from_bits(bits << SHIFT);
        }
        at
    }

    /// What a shader looks R_d up in: the square that is added to r^2, mm^2; its upper bits, which are those of the first segment; the
    /// segments, the value at the start of each and its slope per mm^2.
    #[cfg(feature = "gpu")]
    pub(crate) fn segments(&self) -> (f32, u32, Vec<[Rgb; 2]>) {
        (self.scale2, self.first, self.reflectance.iter().map(|s| [s.value, s.slope]).collect())
    }

    /// Bytes in memory.
    pub fn bytes(&self) -> usize {
        size_of_val(self.reflectance.as_slice()) + size_of_val(self.tail.as_slice())
    }
}

/// What has no value or is beyond single precision is not worth one.
fn finite(value: f64) -> f64 {
    if value.is_finite() { value.clamp(0.0, 1e30) } else { 0.0 }
}

fn segments(nodes: &[f64], values: &[Vec<f64>; 3]) -> Vec<Segment> {
    let of = |k: usize| {
        let mut segment = Segment::default();
        for (c, values) in values.iter().enumerate() {
            segment.value[c] = values[k] as f32;
            segment.slope[c] = ((values[k + 1] - values[k]) / (nodes[k + 1] - nodes[k])) as f32;
        }
        segment
    };
    let mut result: Vec<Segment> = (0..nodes.len().saturating_sub(1)).map(of).collect();
    result.push(Segment::default());
    result
}

#[inline(always)]
fn look_up(table: &[Segment], at: &At, lane: usize) -> Rgb {
    let Some(segment) = table.get((at.index[lane] as usize).min(table.len().wrapping_sub(1))) else { return [0.0; 4] };
    let beyond = at.beyond[lane];
    [0, 1, 2, 3].map(|c| segment.value[c] + segment.slope[c] * beyond)
}

#[inline(always)]
fn points_body(block: &mut Block, table: &RadialTable, sources: &[PointSource]) {
    for chunk in sources.chunks(FLUSH) {
        for row in &mut block.rows {
            let mut partial = [[0.0f32; 4]; LANES];
            for source in chunk {
                let [x, y, z] = &row.at;
                let mut r2 = [0.0; LANES];
                for i in 0..LANES {
                    let (dx, dy, dz) = (x[i] - source.at[0], y[i] - source.at[1], z[i] - source.at[2]);
                    r2[i] = dx * dx + dy * dy + dz * dz;
                }
                let at = table.at(&r2);
                let [red, green, blue] = source.flux;
                let flux = [red, green, blue, 0.0];
                for (lane, partial) in partial.iter_mut().enumerate() {
                    let value = look_up(&table.reflectance, &at, lane);
                    (0..4).for_each(|c| partial[c] += flux[c] * value[c]);
                }
            }
            flush(row, &partial);
        }
    }
}

#[inline(always)]
fn flush(row: &mut Receivers, partial: &[Rgb; LANES]) {
    for (c, sums) in row.sums.iter_mut().enumerate() {
        for (sum, partial) in sums.iter_mut().zip(partial) {
            *sum += f64::from(partial[c]);
        }
    }
}

#[inline(always)]
fn triangles_body(block: &mut Block, table: &RadialTable, sources: &[FlatSource]) {
    for chunk in sources.chunks(FLUSH) {
        for row in &mut block.rows {
            let mut partial = [[0.0f32; 4]; LANES];
            for source in chunk {
                triangle_into(&mut partial, &row.at, table, source);
            }
            flush(row, &partial);
        }
    }
}

/// As for poles: a sum over the edges of Int (tail(H) - tail(d)) p / (p^2 + s^2) ds.
#[inline(always)]
fn triangle_into(partial: &mut [Rgb; LANES], [x, y, z]: &[Row; 3], table: &RadialTable, source: &FlatSource) {
    let edges = &source.edges;
    let height2 = source.height2([x, y, z]);
    let foot = table.at(&height2);
    let longest = edges[0].length.max(edges[1].length).max(edges[2].length);
    let smooth2 = (table.smooth_mm * table.smooth_mm) as f32;
    let nodes = edge_rule(&RULES, longest / table.smooth_mm as f32);
    let mut sums = [[0.0f32; 4]; LANES];
    for e in edges {
        let (o, u) = (e.outward, e.along);
        let (mut pedal, mut span, mut middle, mut half) = ([0.0; LANES], [0.0; LANES], [0.0; LANES], [0.0; LANES]);
        for i in 0..LANES {
            pedal[i] = e.pedal - (o[0] * x[i] + o[1] * y[i] + o[2] * z[i]);
            let s0 = e.start - (u[0] * x[i] + u[1] * y[i] + u[2] * z[i]);
            let s1 = s0 + e.length;
            let span2 = height2[i] + smooth2 + pedal[i] * pedal[i];
            span[i] = span2.sqrt();
            let v0 = s0 / (span[i] + (span2 + s0 * s0).sqrt());
            let v1 = s1 / (span[i] + (span2 + s1 * s1).sqrt());
            middle[i] = 0.5 * (v0 + v1);
            half[i] = 0.5 * (v1 - v0);
        }
        for &(node, node_weight) in nodes {
            let (mut step2, mut weight, mut far2, mut middle2) =
                ([0.0; LANES], [0.0; LANES], [0.0; LANES], [0.0; LANES]);
            for i in 0..LANES {
                let v = middle[i] + half[i] * node;
                let v2 = v * v;
                let minus = (1.0 - v2).max(1e-7);
                let s = 2.0 * span[i] * v / minus;
                let slope = 2.0 * span[i] * (1.0 + v2) / (minus * minus);
                step2[i] = pedal[i] * pedal[i] + s * s;
                weight[i] = node_weight * half[i] * slope * pedal[i];
                far2[i] = height2[i] + step2[i];
                middle2[i] = height2[i] + 0.5 * step2[i];
            }
            let (far, between) = (table.at(&far2), table.at(&middle2));
            for (i, sums) in sums.iter_mut().enumerate() {
                let mean = if step2[i] < SHORT_STEP * (height2[i] + table.scale2) {
                    // Simpson's rule for the mean of R_d / 2 over r^2.
                    let (a, m, b) = (
                        look_up(&table.reflectance, &foot, i),
                        look_up(&table.reflectance, &between, i),
                        look_up(&table.reflectance, &far, i),
                    );
                    [0, 1, 2, 3].map(|c| (a[c] + 4.0 * m[c] + b[c]) * (1.0 / 12.0))
                } else {
                    let (a, b) = (look_up(&table.tail, &foot, i), look_up(&table.tail, &far, i));
                    let inverse = 1.0 / step2[i];
                    [0, 1, 2, 3].map(|c| (a[c] - b[c]) * inverse)
                };
                (0..4).for_each(|c| sums[c] += weight[i] * mean[c]);
            }
        }
    }
    let [red, green, blue] = source.irradiance;
    let irradiance = [red, green, blue, 0.0];
    for (partial, sums) in partial.iter_mut().zip(&sums) {
        // The edges of a near, but dark triangle cancel up to rounding.
        (0..4).for_each(|c| partial[c] += irradiance[c] * sums[c].max(0.0));
    }
}

multiversion! {
    /// See [`add_points`].
    fn points(block: &mut Block, table: &RadialTable, sources: &[PointSource]) => points_body
}

multiversion! {
    /// See [`add_triangles`].
    fn triangles(block: &mut Block, table: &RadialTable, sources: &[FlatSource]) => triangles_body
}

/// Adds `flux * R_d(|x - at|)` of every source to every receiver of the block.
pub fn add_points(level: Level, block: &mut Block, table: &RadialTable, sources: &[PointSource]) {
    points(level.min(WIDEST), block, table, sources);
}

/// Adds `irradiance * Int R_d(|x - y|) dA(y)` over every flat triangle to every receiver of the block.
pub fn add_triangles(level: Level, block: &mut Block, table: &RadialTable, sources: &[FlatSource]) {
    triangles(level.min(WIDEST), block, table, sources);
}

#[cfg(test)]
#[path = "radial_table_tests.rs"]
mod tests;
