//! The kernels of the near field: many sources against one receiver, side by side.
//!
//! Around a group of receivers most sources are near to a few of them only, so each receiver has its own list. Sums run in
//! f32 over at most `FLUSH` rows and are then added to f64, lane after lane.

use super::{
    EdgeRule, FLUSH, GAUSS_4, GAUSS_6, GAUSS_8, GAUSS_12, GAUSS_24, KernelRgb, LANES, Row, edge_into, edge_rule,
    reflectance, rule, tail,
};
use crate::math::simd::multiversion;

/// The even polynomial that a far profile is inside its split radius, RGB: c0 + c1 u + c2 u^2, u = r^2 - split^2.
#[derive(Clone, Copy, Debug, Default)]
pub struct SplitRgb {
    /// Split radius squared, mm^2.
    pub split2: f32,
    /// c0, c1, c2 of each channel.
    pub polynomials: [[f32; 3]; 3],
}

/// Point sources as one receiver sees them.
#[derive(Clone, Debug, Default)]
pub struct Points {
    /// Squared distances, mm^2, and fluxes, RGB, in rows of [`LANES`].
    rows: Vec<PointRow>,
    len: usize,
}

#[derive(Clone, Copy, Debug)]
struct PointRow {
    r2: Row,
    flux: [Row; 3],
}

/// A row that nothing comes from.
const NOTHING: PointRow = PointRow { r2: [1.0; LANES], flux: [[0.0; LANES]; 3] };

impl Points {
    /// Forgets all.
    pub fn clear(&mut self) {
        self.rows.clear();
        self.len = 0;
    }

    /// Adds a source at a squared distance (mm^2).
    pub fn push(&mut self, r2: f32, flux: [f32; 3]) {
        let lane = self.len % LANES;
        if lane == 0 {
            self.rows.push(NOTHING);
        }
        self.len += 1;
        if let Some(row) = self.rows.last_mut() {
            row.r2[lane] = r2;
            for (channel, flux) in row.flux.iter_mut().zip(flux) {
                channel[lane] = flux;
            }
        }
    }

    /// Replaces all by those of `indices`: squared distances (mm^2) and fluxes of every source that there is.
    pub fn select(&mut self, indices: &[u32], r2: &[f32], flux: &[[f32; 3]]) {
        self.rows.clear();
        self.len = indices.len();
        for chunk in indices.chunks(LANES) {
            let mut row = NOTHING;
            for (lane, &index) in chunk.iter().enumerate() {
                let [red, green, blue] = flux[index as usize];
                row.r2[lane] = r2[index as usize];
                row.flux[0][lane] = red;
                row.flux[1][lane] = green;
                row.flux[2][lane] = blue;
            }
            self.rows.push(row);
        }
    }
}

/// Triangles as one receiver sees them.
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
}

impl Flats {
    /// Forgets all.
    pub fn clear(&mut self) {
        self.rows.clear();
        self.len = 0;
    }

    /// Adds a triangle with corners relative to the receiver (mm) and its irradiance, RGB.
    #[inline(always)]
    pub fn push(&mut self, corners: [[f32; 3]; 3], irradiance: [f32; 3]) {
        let lane = self.len % LANES;
        if lane == 0 {
            self.rows.push(FlatRow { corners: [[[0.0; LANES]; 3]; 3], irradiance: [[0.0; LANES]; 3] });
        }
        self.len += 1;
        if let Some(row) = self.rows.last_mut() {
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

/// Which part of R_d a sum takes.
#[derive(Clone, Copy, PartialEq)]
enum Side {
    /// All of it.
    Whole,
    /// R_d less its far part: nothing beyond the split radius.
    Near,
    /// The far part, subtracted.
    LessFar,
}

#[inline(always)]
fn points_body(kernel: &KernelRgb, split: &SplitRgb, points: &Points, sums: &mut [f64; 3], side: Side) {
    for chunk in points.rows.chunks(FLUSH) {
        let mut partial = [[0.0f32; LANES]; 3];
        for row in chunk {
            for (channel, partial) in partial.iter_mut().enumerate() {
                let [real, image] = kernel.terms[channel];
                let [c0, c1, c2] = split.polynomials[channel];
                let flux = &row.flux[channel];
                for i in 0..LANES {
                    let whole = reflectance(real, row.r2[i]) + reflectance(image, row.r2[i]);
                    let u = row.r2[i] - split.split2;
                    let smooth = c0 + u * (c1 + u * c2);
                    let value = match side {
                        Side::Whole => whole,
                        Side::Near => {
                            if u < 0.0 {
                                whole - smooth
                            } else {
                                0.0
                            }
                        }
                        Side::LessFar => {
                            if u < 0.0 {
                                -smooth
                            } else {
                                -whole
                            }
                        }
                    };
                    partial[i] += flux[i] * value;
                }
            }
        }
        collect(sums, &partial);
    }
}

#[inline(always)]
fn collect(sums: &mut [f64; 3], partial: &[Row; 3]) {
    for (sum, partial) in sums.iter_mut().zip(partial) {
        for value in partial {
            *sum += f64::from(*value);
        }
    }
}

#[inline(always)]
fn whole_body(kernel: &KernelRgb, split: &SplitRgb, points: &Points, sums: &mut [f64; 3]) {
    points_body(kernel, split, points, sums, Side::Whole);
}

#[inline(always)]
fn near_body(kernel: &KernelRgb, split: &SplitRgb, points: &Points, sums: &mut [f64; 3]) {
    points_body(kernel, split, points, sums, Side::Near);
}

#[inline(always)]
fn less_far_body(kernel: &KernelRgb, split: &SplitRgb, points: &Points, sums: &mut [f64; 3]) {
    points_body(kernel, split, points, sums, Side::LessFar);
}

multiversion! {
    /// Adds `flux R_d` of every source.
    pub fn add_whole(kernel: &KernelRgb, split: &SplitRgb, points: &Points, sums: &mut [f64; 3]) => whole_body
}

multiversion! {
    /// Adds `flux (R_d - f)` of every source, f the far part of R_d.
    pub fn add_near(kernel: &KernelRgb, split: &SplitRgb, points: &Points, sums: &mut [f64; 3]) => near_body
}

multiversion! {
    /// Subtracts `flux f` of every source, f the far part of R_d.
    pub fn subtract_far(kernel: &KernelRgb, split: &SplitRgb, points: &Points, sums: &mut [f64; 3]) => less_far_body
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
fn flats_body(kernel: &KernelRgb, flats: &Flats, sums: &mut [f64; 3]) {
    for chunk in flats.rows.chunks(FLUSH) {
        let mut partial = [[0.0f32; LANES]; 3];
        for row in chunk {
            flat_row(kernel, row, &mut partial);
        }
        collect(sums, &partial);
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
    /// Adds `irradiance Int R_d dA` of every flat triangle.
    pub fn add_flats(kernel: &KernelRgb, flats: &Flats, sums: &mut [f64; 3]) => flats_body
}
