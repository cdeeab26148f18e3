//! The kernels of the near field: many sources against one receiver, side by side.
//!
//! Points take R_d, or R_d less its far part, from a table: around a group of receivers each has a list of its own, and sums run
//! in f32 over at most `FLUSH` points. Triangles are integrated in closed form, those of a whole group of receivers side by
//! side, because a receiver alone has too few of them to fill the lanes.

use super::radial_table::Rgb;
use super::{
    EdgeRule, FLUSH, GAUSS_4, GAUSS_6, GAUSS_8, GAUSS_12, GAUSS_24, KernelRgb, LANES, Row, edge_into, edge_rule, rule,
    tail,
};
use crate::math::simd::{Level, multiversion};

/// Bits of a mantissa within a segment: 64 segments to each doubling.
const SHIFT: u32 = 23 - 6;

/// The smallest scale over the reach at least.
const LEAST_SCALE: f64 = 1e-6;

/// Sums side by side, so that none waits for the one before.
const CHAINS: usize = 4;

/// A quadratic polynomial of the squared distance beyond the start of a segment.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(16))]
struct Segment {
    value: Rgb,
    slope: Rgb,
    curvature: Rgb,
}

/// A smooth function of the squared distance, RGB, by quadratic polynomials on segments even in the logarithm of r^2 + s^2, s the
/// scale on which it is smooth: 3e-6 of itself off where it goes as the fourth power of that sum. Nothing beyond its end.
#[derive(Clone, Debug)]
pub struct SquareTable {
    /// s^2, mm^2, and its upper bits.
    scale2: f32,
    first: u32,
    /// The last one is zero.
    segments: Vec<Segment>,
}

impl SquareTable {
    /// Of values by channel and squared distance (mm^2), up to `end_mm2`.
    pub fn new(scale_mm: f64, end_mm2: f64, value: impl Fn(usize, f64) -> f64) -> Self {
        let end = end_mm2.clamp(1e-30, 1e30);
        let scale2 = (scale_mm * scale_mm).clamp(LEAST_SCALE * LEAST_SCALE * end, end) as f32;
        // A whole segment, so that the first node is at r = 0.
        let first = scale2.to_bits() >> SHIFT;
        let scale2 = f32::from_bits(first << SHIFT);
        let last = (end as f32 + scale2).to_bits() >> SHIFT;
        let square = |k: u32| f64::from(f32::from_bits(k << SHIFT)) - f64::from(scale2);
        let finite = |v: f64| if v.is_finite() { v.clamp(-1e30, 1e30) } else { 0.0 };
        let segment = |k: u32| {
            let (from, to) = (square(k), square(k + 1));
            let step = to - from;
            let mut segment = Segment::default();
            for c in 0..3 {
                let [a, m, b] = [from, 0.5 * (from + to), to].map(|r2| finite(value(c, r2)));
                segment.value[c] = a as f32;
                segment.slope[c] = ((4.0 * m - 3.0 * a - b) / step) as f32;
                segment.curvature[c] = (2.0 * (a + b - 2.0 * m) / step / step) as f32;
            }
            segment
        };
        let mut segments: Vec<Segment> = (first..=last).map(segment).collect();
        segments.push(Segment::default());
        Self { scale2, first, segments }
    }
}

/// Points as one receiver sees them.
#[derive(Clone, Debug, Default)]
pub struct Points {
    /// Squared distances, mm^2.
    r2: Vec<f32>,
    /// RGB and nothing.
    flux: Vec<Rgb>,
}

impl Points {
    /// Forgets all.
    pub fn clear(&mut self) {
        self.r2.clear();
        self.flux.clear();
    }

    /// Adds a source at a squared distance (mm^2).
    #[inline(always)]
    pub fn push(&mut self, r2: f32, [red, green, blue]: [f32; 3]) {
        self.r2.push(r2);
        self.flux.push([red, green, blue, 0.0]);
    }
}

/// Adds one row of points to the sums.
#[inline(always)]
fn row_into(table: &SquareTable, r2: &Row, flux: &[Rgb; LANES], partial: &mut [Rgb; CHAINS]) {
    let (mut index, mut beyond) = ([0u32; LANES], [0.0f32; LANES]);
    for i in 0..LANES {
        let x = r2[i] + table.scale2;
        let bits = x.to_bits() >> SHIFT;
        index[i] = bits - table.first.min(bits);
        beyond[i] = x - f32::from_bits(bits << SHIFT);
    }
    let last = table.segments.len().wrapping_sub(1);
    for i in 0..LANES {
        let Some(segment) = table.segments.get((index[i] as usize).min(last)) else { return };
        let partial = &mut partial[i % CHAINS];
        for c in 0..4 {
            let value = segment.value[c] + beyond[i] * (segment.slope[c] + beyond[i] * segment.curvature[c]);
            partial[c] += flux[i][c] * value;
        }
    }
}

#[inline(always)]
fn collect(sums: &mut [f64; 3], partial: &[Rgb; CHAINS]) {
    for (c, sum) in sums.iter_mut().enumerate() {
        for partial in partial {
            *sum += f64::from(partial[c]);
        }
    }
}

/// Points of one row, and rows of one sum in single precision.
const FLUSHED: usize = FLUSH * CHAINS;

#[inline(always)]
fn points_body(table: &SquareTable, points: &Points, sums: &mut [f64; 3]) {
    for (r2, flux) in points.r2.chunks(FLUSHED).zip(points.flux.chunks(FLUSHED)) {
        let mut partial = [[0.0f32; 4]; CHAINS];
        for (r2, flux) in r2.chunks(LANES).zip(flux.chunks(LANES)) {
            if let (Some(r2), Some(flux)) = (r2.first_chunk(), flux.first_chunk()) {
                row_into(table, r2, flux, &mut partial);
                continue;
            }
            let (mut last_r2, mut last_flux) = ([0.0f32; LANES], [[0.0f32; 4]; LANES]);
            last_r2[..r2.len()].copy_from_slice(r2);
            last_flux[..flux.len()].copy_from_slice(flux);
            row_into(table, &last_r2, &last_flux, &mut partial);
        }
        collect(sums, &partial);
    }
}

#[inline(always)]
fn chosen_body(table: &SquareTable, indices: &[u32], (r2, flux): (&[f32], &[Rgb]), sums: &mut [f64; 3]) {
    for indices in indices.chunks(FLUSHED) {
        let mut partial = [[0.0f32; 4]; CHAINS];
        for indices in indices.chunks(LANES) {
            let (mut row_r2, mut row_flux) = ([0.0f32; LANES], [[0.0f32; 4]; LANES]);
            for (lane, &index) in indices.iter().enumerate() {
                let (Some(r2), Some(flux)) = (r2.get(index as usize), flux.get(index as usize)) else { return };
                row_r2[lane] = *r2;
                row_flux[lane] = *flux;
            }
            row_into(table, &row_r2, &row_flux, &mut partial);
        }
        collect(sums, &partial);
    }
}

multiversion! {
    /// See [`add_points`].
    fn points_of(table: &SquareTable, points: &Points, sums: &mut [f64; 3]) => points_body
}

multiversion! {
    /// See [`add_chosen`].
    fn chosen(table: &SquareTable, indices: &[u32], sources: (&[f32], &[Rgb]), sums: &mut [f64; 3]) => chosen_body
}

/// Beyond these instructions nothing is gained: compilers gather from the table where single loads are faster.
const WIDEST: Level = Level::Avx2;

/// Adds `flux f(r^2)` of every source, f by a table.
pub fn add_points(level: Level, table: &SquareTable, points: &Points, sums: &mut [f64; 3]) {
    points_of(level.min(WIDEST), table, points, sums);
}

/// Adds the same of some of many sources, whose squared distances (mm^2) and fluxes are given.
pub fn add_chosen(level: Level, table: &SquareTable, indices: &[u32], sources: (&[f32], &[Rgb]), sums: &mut [f64; 3]) {
    chosen(level.min(WIDEST), table, indices, sources, sums);
}

/// Triangles as receivers see them.
#[derive(Clone, Debug, Default)]
pub struct Flats {
    rows: Vec<FlatRow>,
    len: usize,
}

#[derive(Clone, Copy, Debug)]
struct FlatRow {
    /// By corner and axis, relative to the receiver, mm.
    corners: [[Row; 3]; 3],
    irradiance: [Row; 3],
    /// Whose they are.
    receivers: [u32; LANES],
}

impl Flats {
    /// Forgets all.
    pub fn clear(&mut self) {
        self.rows.clear();
        self.len = 0;
    }

    /// Adds a triangle with corners relative to a receiver (mm) and its irradiance, RGB.
    #[inline(always)]
    pub fn push(&mut self, receiver: u32, corners: [[f32; 3]; 3], irradiance: [f32; 3]) {
        let lane = self.len % LANES;
        if lane == 0 {
            let (corners, irradiance) = ([[[0.0; LANES]; 3]; 3], [[0.0; LANES]; 3]);
            self.rows.push(FlatRow { corners, irradiance, receivers: [receiver; LANES] });
        }
        self.len += 1;
        if let Some(row) = self.rows.last_mut() {
            row.receivers[lane] = receiver;
            for (row, corner) in row.corners.iter_mut().zip(corners) {
                for (row, value) in row.iter_mut().zip(corner) {
                    row[lane] = value;
                }
            }
            for (row, value) in row.irradiance.iter_mut().zip(irradiance) {
                row[lane] = value;
            }
        }
    }
}

static GAUSS_3: [(f32, f32); 3] = rule();

/// 1e-5 of the total reflectance (worst case over the published materials and extreme ones): coarser than those of the truth,
/// and far finer than the three points that other samples get.
pub static NEAR_EDGE_RULES: [EdgeRule; 6] = [
    (1.0, &GAUSS_3),
    (3.0, &GAUSS_4),
    (10.0, &GAUSS_6),
    (30.0, &GAUSS_8),
    (100.0, &GAUSS_12),
    (f32::INFINITY, &GAUSS_24),
];

/// As `triangle_into` of the parent module, with the geometry of the triangles worked out here.
#[inline(always)]
fn flats_body(kernel: &KernelRgb, flats: &Flats, sums: &mut [[f64; 3]]) {
    for row in &flats.rows {
        let mut values = [[0.0f32; LANES]; 3];
        flat_row(kernel, row, &mut values);
        for (lane, &receiver) in row.receivers.iter().enumerate() {
            let Some(sums) = sums.get_mut(receiver as usize) else { return };
            for (sum, values) in sums.iter_mut().zip(&values) {
                *sum += f64::from(values[lane]);
            }
        }
    }
}

#[inline(always)]
fn flat_row(kernel: &KernelRgb, row: &FlatRow, partial: &mut [Row; 3]) {
    let c = &row.corners;
    let mut normal = [[0.0f32; LANES]; 3];
    let mut height2 = [0.0f32; LANES];
    for i in 0..LANES {
        let e = |to: usize, axis: usize| c[to][axis][i] - c[0][axis][i];
        let x = e(1, 1) * e(2, 2) - e(1, 2) * e(2, 1);
        let y = e(1, 2) * e(2, 0) - e(1, 0) * e(2, 2);
        let z = e(1, 0) * e(2, 1) - e(1, 1) * e(2, 0);
        let length = (x * x + y * y + z * z).sqrt();
        let inverse = if length > 0.0 { 1.0 / length } else { 0.0 };
        normal[0][i] = x * inverse;
        normal[1][i] = y * inverse;
        normal[2][i] = z * inverse;
        let height = normal[0][i] * c[0][0][i] + normal[1][i] * c[0][1][i] + normal[2][i] * c[0][2][i];
        height2[i] = height * height;
    }
    let (mut pedals, mut starts, mut lengths) = ([[0.0; LANES]; 3], [[0.0; LANES]; 3], [[0.0; LANES]; 3]);
    let mut longest = 0.0f32;
    for k in 0..3 {
        let (from, to) = (&c[k], &c[(k + 1) % 3]);
        for i in 0..LANES {
            let (x, y, z) = (to[0][i] - from[0][i], to[1][i] - from[1][i], to[2][i] - from[2][i]);
            let length = (x * x + y * y + z * z).sqrt();
            let inverse = if length > 0.0 { 1.0 / length } else { 0.0 };
            let (ax, ay, az) = (x * inverse, y * inverse, z * inverse);
            let (nx, ny, nz) = (normal[0][i], normal[1][i], normal[2][i]);
            let (ox, oy, oz) = (ay * nz - az * ny, az * nx - ax * nz, ax * ny - ay * nx);
            pedals[k][i] = from[0][i] * ox + from[1][i] * oy + from[2][i] * oz;
            starts[k][i] = from[0][i] * ax + from[1][i] * ay + from[2][i] * az;
            lengths[k][i] = length;
        }
        longest = lengths[k].iter().fold(longest, |a, &b| a.max(b));
    }
    let nodes = edge_rule(&NEAR_EDGE_RULES, longest / kernel.shallowest);
    for (channel, partial) in partial.iter_mut().enumerate() {
        let terms = kernel.terms[channel];
        let mut edges = [[0.0; LANES]; 2];
        for k in 0..3 {
            edge_into(&mut edges, &height2, (&pedals[k], &starts[k], &lengths[k]), terms, nodes);
        }
        let irradiance = &row.irradiance[channel];
        for i in 0..LANES {
            let sum = tail(terms[0], height2[i]) * edges[0][i] + tail(terms[1], height2[i]) * edges[1][i];
            // The edges of a near, but dark triangle cancel up to rounding.
            partial[i] += irradiance[i] * sum.max(0.0);
        }
    }
}

multiversion! {
    /// Adds `irradiance Int R_d dA` of every flat triangle to the sum of its receiver.
    pub fn add_flats(kernel: &KernelRgb, flats: &Flats, sums: &mut [[f64; 3]]) => flats_body
}
