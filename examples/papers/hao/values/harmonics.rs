//! Spherical harmonics (the paper's section 4.1): of the values of all vertices in 16 bits, or of differences in 8.

use glam::DVec3;
use rayon::prelude::*;

use super::CHANNELS;
use crate::hao::harmonic_fit::{Fit, Window, band};
use translux::error::Result;
use translux::light::quantised::directions::DirectionSet;
use translux::math::sh::real_sh;

/// Pieces of a light whose harmonics are summed by one task.
const CHUNK: usize = 512;

/// From values at the directions of a set, on each shell, to coefficients.
pub(super) struct Projection {
    /// `[coefficient][direction]`.
    matrix: Vec<f32>,
    directions: usize,
    coefficients: usize,
}

impl Projection {
    /// Least squares over the directions, then the window. Weights of 1: the lattice is uniform.
    pub(super) fn new(set: &DirectionSet, order: usize, window: Window) -> Result<Self> {
        let fit = Fit::new(set.directions(), order, None)?;
        let row = |(i, row): (usize, &[f64])| {
            let factor = window.factor(band(i), order);
            row.iter().map(|v| (factor * v) as f32).collect::<Vec<f32>>()
        };
        let matrix = fit.matrix().chunks_exact(set.count()).enumerate().flat_map(row).collect();
        Ok(Self { matrix, directions: set.count(), coefficients: order * order })
    }

    /// Coefficients `[plane][coefficient]` of values `[plane][direction]`.
    pub(super) fn apply(&self, values: &[f32], out: &mut [f32]) {
        let rows = out.chunks_exact_mut(self.coefficients).zip(values.chunks_exact(self.directions));
        for (out, values) in rows {
            for (out, row) in out.iter_mut().zip(self.matrix.chunks_exact(self.directions)) {
                *out = dot(row, values);
            }
        }
    }
}

/// In single precision, sixteen sums side by side.
fn dot(a: &[f32], b: &[f32]) -> f32 {
    const LANES: usize = 16;
    let ((a, rest_a), (b, rest_b)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
    let mut sums = [0.0f32; LANES];
    for (a, b) in a.iter().zip(b) {
        (0..LANES).for_each(|i| sums[i] += a[i] * b[i]);
    }
    let rest: f32 = rest_a.iter().zip(rest_b).map(|(a, b)| a * b).sum();
    sums.iter().sum::<f32>() + rest
}

/// The unit of each column of `values`, `[row][column]`, at which its largest is `most`.
pub(super) fn scales(values: &[f32], columns: usize, most: f32) -> Vec<f32> {
    let mut largest = vec![0.0f32; columns];
    for row in values.chunks_exact(columns.max(1)) {
        largest.iter_mut().zip(row).for_each(|(l, v)| *l = l.max(v.abs()));
    }
    largest.iter().map(|l| if *l > 0.0 { (*l / most).max(f32::MIN_POSITIVE) } else { 1.0 }).collect()
}

/// Integers of values `[row][column]`, at most `most` in magnitude.
pub(super) fn integers(values: &[f32], scales: &[f32], most: f32) -> Vec<i16> {
    let mut result = vec![0i16; values.len()];
    let size = scales.len().max(1);
    result.par_chunks_mut(size).zip(values.par_chunks(size)).for_each(|(out, row)| {
        let cells = out.iter_mut().zip(row).zip(scales);
        cells.for_each(|((out, v), scale)| *out = (v / scale).round().clamp(-most, most) as i16);
    });
    result
}

/// What each harmonic of each channel contributes for a light in pieces (by shell pairs of unit direction and irradiance), times
/// its unit: `[channel][shell][coefficient]`.
pub(super) fn weights(order: usize, pieces: &[Vec<(DVec3, DVec3)>], scales: &[f32]) -> Vec<Vec<f32>> {
    let count = order * order;
    let of_chunk = |pieces: &[(DVec3, DVec3)]| {
        let mut harmonics = vec![0.0; count];
        let mut sums = vec![DVec3::ZERO; count];
        for (direction, irradiance) in pieces {
            real_sh(order, *direction, &mut harmonics);
            sums.iter_mut().zip(&harmonics).for_each(|(sum, y)| *sum += *irradiance * *y);
        }
        sums
    };
    let of_shell = |pieces: &Vec<(DVec3, DVec3)>| {
        let mut total = vec![DVec3::ZERO; count];
        for part in pieces.par_chunks(CHUNK).map(of_chunk).collect::<Vec<_>>() {
            total.iter_mut().zip(part).for_each(|(total, part)| *total += part);
        }
        total
    };
    let sums: Vec<DVec3> = pieces.iter().flat_map(of_shell).collect();
    let channel = |c: usize| -> Vec<f32> {
        let units = scales.chunks_exact(sums.len().max(1)).nth(c).unwrap_or(&[]);
        sums.iter().zip(units).map(|(sum, unit)| (sum[c] * f64::from(*unit)) as f32).collect()
    };
    (0..CHANNELS).map(channel).collect()
}
