//! Matrices in the form in which they are stored, and their products with a light.

use rayon::prelude::*;
use translux_format::quantised_values::LEVELS;

use super::CHANNELS;
use translux::math::simd::{InstructionSet, multiversion};

/// Sums side by side.
const LANES: usize = 16;

/// Rows of one task.
const CHUNK: usize = 256;

/// Columns that are not 0 are taken one by one where they are fewer than one of so many.
const SPARSE: usize = 8;

/// How numbers are stored.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Cells {
    Floats(Vec<f32>),
    /// Integers, whose unit is with the weights.
    Shorts(Vec<i16>),
    Bytes(Vec<i8>),
    /// Numbers of entries of a table for each plane.
    Codes {
        codes: Vec<u8>,
        tables: Vec<f32>,
    },
}

/// Numbers `[row][plane][column]`: as many planes for red as for green and blue.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Matrix {
    pub(super) planes: usize,
    pub(super) columns: usize,
    pub(super) cells: Cells,
}

impl Matrix {
    /// Rows.
    pub(super) fn rows(&self) -> usize {
        let cells = match &self.cells {
            Cells::Floats(cells) => cells.len(),
            Cells::Shorts(cells) => cells.len(),
            Cells::Bytes(cells) => cells.len(),
            Cells::Codes { codes, .. } => codes.len(),
        };
        cells / (self.planes * self.columns).max(1)
    }

    /// Bytes in memory.
    pub(super) fn bytes(&self) -> usize {
        match &self.cells {
            Cells::Floats(cells) => size_of_val(cells.as_slice()),
            Cells::Shorts(cells) => size_of_val(cells.as_slice()),
            Cells::Bytes(cells) => size_of_val(cells.as_slice()),
            Cells::Codes { codes, tables } => size_of_val(codes.as_slice()) + size_of_val(tables.as_slice()),
        }
    }

    /// The number in a cell.
    pub(super) fn value(&self, row: usize, plane: usize, column: usize) -> f32 {
        let at = (row * self.planes + plane) * self.columns + column;
        match &self.cells {
            Cells::Floats(cells) => cells.get(at).copied().unwrap_or(0.0),
            Cells::Shorts(cells) => cells.get(at).copied().map_or(0.0, f32::from),
            Cells::Bytes(cells) => cells.get(at).copied().map_or(0.0, f32::from),
            Cells::Codes { codes, tables } => {
                let entry = codes.get(at).map_or(usize::MAX, |code| plane * LEVELS + usize::from(*code));
                tables.get(entry).copied().unwrap_or(0.0)
            }
        }
    }

    /// Sums over planes and columns of every row times weights `[plane][column]`: RGB and nothing.
    pub(super) fn products(&self, weights: &[Vec<f32>]) -> Vec<[f32; 4]> {
        let mut out = vec![[0.0f32; 4]; self.rows()];
        if weights.len() != self.planes || weights.iter().any(|plane| plane.len() != self.columns) {
            return out;
        }
        let used = |column: &usize| weights.iter().any(|plane| plane[*column] != 0.0);
        let columns: Vec<usize> = (0..self.columns).filter(used).collect();
        if columns.len() * SPARSE < self.columns {
            self.some_columns(&mut out, weights, &columns);
            return out;
        }
        let (level, size) = (InstructionSet::detect(), (self.planes * self.columns).max(1) * CHUNK);
        let out_chunks = out.par_chunks_mut(CHUNK);
        match &self.cells {
            Cells::Floats(c) => out_chunks.zip(c.par_chunks(size)).for_each(|(o, c)| floats(level, o, c, weights)),
            Cells::Shorts(c) => out_chunks.zip(c.par_chunks(size)).for_each(|(o, c)| shorts(level, o, c, weights)),
            Cells::Bytes(c) => out_chunks.zip(c.par_chunks(size)).for_each(|(o, c)| bytes(level, o, c, weights)),
            Cells::Codes { codes: c, tables } => {
                out_chunks.zip(c.par_chunks(size)).for_each(|(o, c)| codes(level, o, c, weights, tables));
            }
        }
        out
    }

    fn some_columns(&self, out: &mut [[f32; 4]], weights: &[Vec<f32>], columns: &[usize]) {
        out.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, out)| {
            for (row, out) in out.iter_mut().enumerate() {
                for (plane, weights) in weights.iter().enumerate() {
                    let value = |&column: &usize| self.value(chunk * CHUNK + row, plane, column) * weights[column];
                    out[channel(plane, self.planes)] += columns.iter().map(value).sum::<f32>();
                }
            }
        });
    }
}

/// The channel that a plane belongs to.
#[inline(always)]
fn channel(plane: usize, planes: usize) -> usize {
    CHANNELS * plane / planes
}

#[inline(always)]
fn body<T: Copy>(out: &mut [[f32; 4]], cells: &[T], weights: &[Vec<f32>], value: impl Fn(usize, T) -> f32) {
    let (planes, columns) = (weights.len(), weights.first().map_or(0, Vec::len));
    for (out, row) in out.iter_mut().zip(cells.chunks_exact((planes * columns).max(1))) {
        for (plane, (row, weights)) in row.chunks_exact(columns.max(1)).zip(weights).enumerate() {
            let mut sums = [0.0f32; LANES];
            let (whole, rest) = row.as_chunks::<LANES>();
            let (whole_weights, rest_weights) = weights.as_chunks::<LANES>();
            for (cells, weights) in whole.iter().zip(whole_weights) {
                for i in 0..LANES {
                    sums[i] += value(plane, cells[i]) * weights[i];
                }
            }
            for (i, (cell, weight)) in rest.iter().zip(rest_weights).enumerate() {
                sums[i] += value(plane, *cell) * weight;
            }
            out[channel(plane, planes)] += total(&sums);
        }
    }
}

#[inline(always)]
fn floats_body(out: &mut [[f32; 4]], cells: &[f32], weights: &[Vec<f32>]) {
    body(out, cells, weights, |_, cell| cell);
}

#[inline(always)]
fn shorts_body(out: &mut [[f32; 4]], cells: &[i16], weights: &[Vec<f32>]) {
    body(out, cells, weights, |_, cell| f32::from(cell));
}

#[inline(always)]
fn bytes_body(out: &mut [[f32; 4]], cells: &[i8], weights: &[Vec<f32>]) {
    body(out, cells, weights, |_, cell| f32::from(cell));
}

#[inline(always)]
fn codes_body(out: &mut [[f32; 4]], cells: &[u8], weights: &[Vec<f32>], tables: &[f32]) {
    let (tables, _) = tables.as_chunks::<LEVELS>();
    if tables.len() >= weights.len() {
        body(out, cells, weights, |plane, code| tables[plane][usize::from(code)]);
    }
}

multiversion! {
    /// See [`body`].
    fn floats(out: &mut [[f32; 4]], cells: &[f32], weights: &[Vec<f32>]) => floats_body
}

multiversion! {
    /// See [`body`].
    fn shorts(out: &mut [[f32; 4]], cells: &[i16], weights: &[Vec<f32>]) => shorts_body
}

multiversion! {
    /// See [`body`].
    fn bytes(out: &mut [[f32; 4]], cells: &[i8], weights: &[Vec<f32>]) => bytes_body
}

multiversion! {
    /// See [`body`].
    fn codes(out: &mut [[f32; 4]], cells: &[u8], weights: &[Vec<f32>], tables: &[f32]) => codes_body
}

/// Pairwise, the same on every level.
#[inline(always)]
fn total(lanes: &[f32; LANES]) -> f32 {
    let mut sums = *lanes;
    let mut half = LANES / 2;
    while half > 0 {
        for i in 0..half {
            sums[i] += sums[i + half];
        }
        half /= 2;
    }
    sums[0]
}

#[cfg(test)]
mod tests {
    use super::*;
    use translux::math::random::{bits, uniform};

    #[test]
    fn products_are_sums_on_every_path() {
        for (planes, columns, used) in [(3, 37, 37), (9, 200, 200), (3, 100, 4), (9, 64, 3), (3, 1, 1), (3, 16, 16)] {
            let count = 300 * planes * columns;
            let byte = |i: usize| bits(1, i as u64, 0) as u8;
            let tables: Vec<f32> = (0..planes * LEVELS).map(|i| uniform(2, i as u64, 0) as f32).collect();
            let all = [
                Cells::Floats((0..count).map(|i| uniform(3, i as u64, 0) as f32).collect()),
                Cells::Shorts((0..count).map(|i| i16::from(byte(i)) - 100).collect()),
                Cells::Bytes((0..count).map(|i| byte(i) as i8).collect()),
                Cells::Codes { codes: (0..count).map(byte).collect(), tables },
            ];
            let weight =
                |p: usize, c: usize| if c < used { uniform(4, (p * columns + c) as u64, 0) as f32 } else { 0.0 };
            let weights: Vec<Vec<f32>> = (0..planes).map(|p| (0..columns).map(|c| weight(p, c)).collect()).collect();
            for cells in all {
                let matrix = Matrix { planes, columns, cells };
                assert_eq!(matrix.rows(), 300);
                let found = matrix.products(&weights);
                for (row, found) in found.iter().enumerate().step_by(7) {
                    let mut expected = [0.0f64; 4];
                    let mut scale = 1.0;
                    for (plane, weights) in weights.iter().enumerate() {
                        for (column, weight) in weights.iter().enumerate() {
                            let product = f64::from(matrix.value(row, plane, column)) * f64::from(*weight);
                            expected[3 * plane / planes] += product;
                            scale += product.abs();
                        }
                    }
                    assert!((0..4).all(|i| (f64::from(found[i]) - expected[i]).abs() < 1e-6 * scale), "{found:?}");
                }
                assert!(matrix.products(&weights[1..]).iter().all(|v| *v == [0.0; 4]));
            }
        }
    }
}
