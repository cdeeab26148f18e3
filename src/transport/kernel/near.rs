//! The near field: many sources against one receiver, side by side.
//!
//! Points take R_d, or R_d less its far part, from a table: around a group of receivers each has a list of its own, and
//! sums run in f32 over at most `FLUSH` points. Triangles of a whole group of receivers are integrated side by side,
//! because a receiver alone has too few of them to fill the lanes.

use super::radial_table::{QuadraticTable, Rgb, WIDEST, add_product};
use super::{EdgePrecision, FLUSH, LANES, RadialIntegral, Row, RowValues, SeenTriangle};
use crate::math::simd::multiversion;

/// Sums side by side, so that none waits for the one before.
const CHAINS: usize = 4;

/// Points as one receiver sees them.
#[derive(Clone, Debug, Default)]
pub struct Points {
    /// Squared distances, mm^2.
    r2: Vec<f32>,
    /// RGB and nothing.
    flux: Vec<Rgb>,
}

impl Points {
    /// Removes all entries.
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
fn row_into(table: &QuadraticTable, r2: &Row, flux: &[Rgb; LANES], partial: &mut [Rgb; CHAINS]) {
    let places = table.places(r2);
    for i in 0..LANES {
        add_product(&mut partial[i % CHAINS], &flux[i], &table.value(&places, i));
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

/// Points of one sum in single precision.
const FLUSHED: usize = FLUSH * CHAINS;

#[inline(always)]
fn points_body(table: &QuadraticTable, points: &Points, sums: &mut [f64; 3]) {
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
fn chosen_body(table: &QuadraticTable, indices: &[u32], (r2, flux): (&[f32], &[Rgb]), sums: &mut [f64; 3]) {
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
    /// Adds `flux f(r^2)` of every source, f by a table.
    pub fn add_points(table: &QuadraticTable, points: &Points, sums: &mut [f64; 3]) => points_body, up to WIDEST;

    /// [`add_points`] for some of many sources, whose squared distances (mm^2) and fluxes are given.
    pub fn add_chosen(
        table: &QuadraticTable,
        indices: &[u32],
        sources: (&[f32], &[Rgb]),
        sums: &mut [f64; 3],
    ) => chosen_body, up to WIDEST;
}

/// Triangles as receivers see them.
#[derive(Clone, Debug, Default)]
pub struct Flats {
    rows: Vec<FlatRow>,
    len: usize,
}

#[derive(Clone, Copy, Debug)]
struct FlatRow {
    /// Corners relative to the receiver, `[corner][axis]`, mm.
    corners: [[Row; 3]; 3],
    irradiance: [Row; 3],
    /// Receiver of each triangle.
    receivers: [u32; LANES],
}

impl Flats {
    /// Removes all entries.
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

impl FlatRow {
    /// The triangles as their receivers see them.
    #[inline(always)]
    fn seen(&self) -> SeenTriangle {
        let c = &self.corners;
        let mut normal = [[0.0f32; LANES]; 3];
        let mut seen = SeenTriangle::NONE;
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
            seen.height2[i] = height * height;
        }
        for k in 0..3 {
            let (from, to) = (&c[k], &c[(k + 1) % 3]);
            for i in 0..LANES {
                let (x, y, z) = (to[0][i] - from[0][i], to[1][i] - from[1][i], to[2][i] - from[2][i]);
                let length = (x * x + y * y + z * z).sqrt();
                let inverse = if length > 0.0 { 1.0 / length } else { 0.0 };
                let (ax, ay, az) = (x * inverse, y * inverse, z * inverse);
                let (nx, ny, nz) = (normal[0][i], normal[1][i], normal[2][i]);
                let (ox, oy, oz) = (ay * nz - az * ny, az * nx - ax * nz, ax * ny - ay * nx);
                seen.pedals[k][i] = from[0][i] * ox + from[1][i] * oy + from[2][i] * oz;
                seen.starts[k][i] = from[0][i] * ax + from[1][i] * ay + from[2][i] * az;
                seen.lengths[k][i] = length;
            }
        }
        seen
    }
}

/// Adds `irradiance Int K dA` of every flat triangle to the sum of its receiver.
#[inline(always)]
pub(super) fn flats_body<K: RadialIntegral>(kernel: &K, flats: &Flats, sums: &mut [[f64; 3]]) {
    for row in &flats.rows {
        let values = kernel.triangle(&row.seen(), EdgePrecision::Near);
        for (lane, &receiver) in row.receivers.iter().enumerate() {
            let Some(sums) = sums.get_mut(receiver as usize) else { return };
            let value = values.of_lane(lane);
            for c in 0..3 {
                sums[c] += f64::from(row.irradiance[c][lane] * value[c]);
            }
        }
    }
}
