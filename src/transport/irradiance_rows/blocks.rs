//! Rows in blocks of neighbouring patches: one threshold and one step for all of them.
//!
//! The rows of a block are Haar transformed over its patches ([`crate::compress::row_blocks`]), on top of the transform
//! over the cube map: the paper's double projection, without a parameterised surface. A coefficient is kept where its
//! share of the squares of all patches is above a threshold, and quantised in steps of about that size. The threshold
//! is the largest one whose error, on some of the blocks, is that of separate rows with the asked number of
//! coefficients.
//!
//! # Measured
//!
//! Gargoyle, 131,072 samples, faces of 32 texels, two terms, at the squared error of 128 coefficients for each sample:
//! blocks of 8 take 27 coefficients a sample, of 32 14, of 64 11, of 256 9. Longer ones save little and need more
//! memory while they are made.
//!
//! The same shape with 65,536 vertices, against all coefficients, the worst of six maps: separate rows of 128
//! coefficients take 236 bytes a vertex in a file (1,048 in memory); radiosity in marble and skin errs by 1.2 %, under
//! a bare sun by
//! 5.7 %. In blocks 55 bytes (229), 0.60 % and 1.5 %, though irradiance errs by 3.9 % in place of 2.9 %: dropped
//! coefficients have no mean over a block, and scattering takes means. For 256 130 bytes, 0.26 % and 0.41 %. A new map
//! takes 12 ms in place of 28, on two cores.

use std::ops::Range;

use translux_format::rows::{self, IrradianceRows};

use super::row::{Work, push};
use super::{RowBaker, join};
use crate::compress::row_blocks;
use crate::compress::rows::Rows;
use crate::error::Result;
use crate::math::cube_map::FACES;
use crate::parallel::*;
use crate::progress::Progress;
use crate::transport::visibility::{Observer, visit};

/// Patches of a block at most.
const BLOCK: usize = 64;

/// Blocks whose visibility is found together.
const TOGETHER: usize = 16;

/// Blocks that the threshold is chosen on.
const PROBES: usize = 64;

/// Step of the scaling coefficients over that of the details: there are few of them, and constant light has nothing else.
const SCALING_SHARE: f32 = 0.25;

/// Bits of an energy that its bin leaves out: eight bins for each factor of two.
const BIN_SHIFT: u32 = 20;

/// Squared errors of some blocks.
struct Energies {
    /// The squared error of separate rows.
    asked: f64,
    /// Number of coefficients of blocks and the sum of their energies, by bins of energy.
    bins: Vec<(u64, f64)>,
}

impl Energies {
    fn new() -> Self {
        Self { asked: 0.0, bins: vec![(0, 0.0); 1 << (31 - BIN_SHIFT)] }
    }

    fn push(&mut self, energy: f32) {
        if let Some((count, sum)) = self.bins.get_mut((energy.to_bits() >> BIN_SHIFT) as usize) {
            *count += 1;
            *sum += f64::from(energy);
        }
    }

    fn add(&mut self, other: &Self) {
        self.asked += other.asked;
        for (bin, other) in self.bins.iter_mut().zip(&other.bins) {
            *bin = (bin.0 + other.0, bin.1 + other.1);
        }
    }

    /// The largest energy that may be dropped, if kept coefficients are rounded to steps of its root.
    fn threshold(&self, terms: usize) -> f32 {
        let mut kept: u64 = self.bins.iter().map(|bin| bin.0).sum();
        let (mut threshold, mut dropped) = (0.0f32, 0.0);
        for (bin, (count, sum)) in self.bins.iter().enumerate() {
            let edge = f32::from_bits((bin as u32 + 1) << BIN_SHIFT);
            kept -= count;
            dropped += sum;
            let rounding = f64::from(edge) / 12.0 * terms as f64 * kept as f64;
            if !edge.is_finite() || dropped + rounding > self.asked {
                break;
            }
            threshold = edge;
        }
        threshold
    }
}

/// Memory of one thread.
struct BlockWork {
    row: Work,
    face: usize,
    terms: usize,
    /// Rows of a block, patch after patch.
    rows: Vec<f32>,
    kept: Vec<u16>,
}

impl BlockWork {
    fn new(side: usize, terms: usize) -> Self {
        Self { row: Work::new(side, terms), face: side * side, terms, rows: Vec::new(), kept: Vec::new() }
    }

    fn stride(&self) -> usize {
        FACES * self.terms * self.face
    }

    /// Energy of each detail of a row, summed over the terms, with its place.
    fn details(&self, row: usize) -> impl Iterator<Item = (usize, f32)> {
        let (face, terms) = (self.face, self.terms);
        let faces = self.rows[row * self.stride()..(row + 1) * self.stride()].chunks_exact(face * terms);
        faces.enumerate().flat_map(move |(f, pictures)| {
            (1..face).map(move |x| {
                let energy = (0..terms).map(|term| pictures[term * face + x] * pictures[term * face + x]).sum::<f32>();
                (f * face + x, energy)
            })
        })
    }

    /// Appends the row of one more patch.
    fn push(&mut self) {
        self.rows.extend_from_slice(&self.row.coefficients);
    }

    /// Appends the transformed rows to `out`, and clears them.
    fn append(&mut self, threshold: f32, out: &mut IrradianceRows) {
        let stride = self.stride();
        row_blocks::forward(&mut self.rows, stride);
        for (row, weight) in row_blocks::weights(self.rows.len() / stride).into_iter().enumerate() {
            self.append_row(row, weight, threshold, out);
        }
        self.rows.clear();
    }

    fn append_row(&mut self, row: usize, weight: f32, threshold: f32, out: &mut IrradianceRows) {
        let mut kept = std::mem::take(&mut self.kept);
        kept.clear();
        kept.extend(self.details(row).filter(|(_, e)| e * weight > threshold).map(|(place, _)| place as u16));
        // As fine as the threshold lets it, as coarse as the levels make it.
        let fine = (threshold / weight).sqrt();
        let values = &self.rows[row * self.stride()..(row + 1) * self.stride()];
        push(values, &kept, [fine, SCALING_SHARE * fine], out);
        self.kept = kept;
    }

    /// The squared error of the rows of a block with so many coefficients each, and the energies of the transformed
    /// ones; clears the rows.
    fn measure(&mut self, coefficients: usize) -> Energies {
        let mut found = Energies::new();
        let (stride, details) = (self.stride(), coefficients.saturating_sub(FACES));
        let count = self.rows.len() / stride;
        let mut energies: Vec<f32> = Vec::new();
        for row in 0..count {
            energies.clear();
            energies.extend(self.details(row).map(|(_, energy)| energy));
            if details < energies.len() {
                energies.select_nth_unstable_by(details, |a, b| b.total_cmp(a));
            }
            let (kept, dropped) = energies.split_at(details.min(energies.len()));
            let rows = &self.rows[row * stride..(row + 1) * stride];
            let largest =
                rows.chunks_exact(self.face).flat_map(|picture| &picture[1..]).fold(0.0f32, |m, v| m.max(v.abs()));
            let step = f64::from(largest) / f64::from(i8::MAX);
            let rounded = kept.iter().filter(|energy| **energy > 0.0).count() * self.terms;
            found.asked += dropped.iter().map(|e| f64::from(*e)).sum::<f64>() + step * step / 12.0 * rounded as f64;
        }
        row_blocks::forward(&mut self.rows, stride);
        for (row, weight) in row_blocks::weights(count).into_iter().enumerate() {
            self.details(row).for_each(|(_, energy)| found.push(energy * weight));
        }
        self.rows.clear();
        found
    }
}

impl RowBaker<'_> {
    /// Rows of all patches in blocks of neighbours, with about the error of separate rows with the coefficients of the
    /// settings. Patches next to each other should lie side by side.
    ///
    /// # Errors
    /// More than 2^32 - 2 coefficients (exit 5).
    pub fn in_blocks(&self, progress: &dyn Progress) -> Result<Rows> {
        progress.start("irradiance rows", self.surface.samples.len() as u64);
        let threshold = self.threshold();
        let chunks = self.chunks(0..self.chunk_count(), threshold, progress);
        progress.finish();
        self.joined(chunks)
    }

    /// Number of chunks of the rows, which do not depend on each other.
    pub fn chunk_count(&self) -> usize {
        self.blocks().len().div_ceil(TOGETHER)
    }

    /// Some chunks of the rows, without coefficients up to an energy.
    pub fn chunks(&self, some: Range<usize>, threshold: f32, progress: &dyn Progress) -> Vec<IrradianceRows> {
        let blocks = self.blocks();
        let chunk = |blocks: &[[u32; 2]]| {
            let mut rows = self.empty();
            self.visit_blocks(blocks, |work| work.append(threshold, &mut rows));
            progress.advance(rows.patches() as u64);
            rows
        };
        let own = (some.start * TOGETHER).min(blocks.len())..(some.end * TOGETHER).min(blocks.len());
        blocks[own].par_chunks(TOGETHER).map(chunk).collect()
    }

    /// The rows of all chunks.
    ///
    /// # Errors
    /// As [`Self::in_blocks`]; chunks of other rows.
    pub fn joined(&self, chunks: Vec<IrradianceRows>) -> Result<Rows> {
        let samples = self.surface.samples;
        Rows::new(join(IrradianceRows { block: BLOCK, ..self.empty() }, chunks)?, &samples.part_offsets)
    }

    fn blocks(&self) -> Vec<[u32; 2]> {
        rows::blocks(&self.surface.samples.part_offsets, BLOCK)
    }

    /// Largest energy of a coefficient that is dropped.
    pub fn threshold(&self) -> f32 {
        let blocks = self.blocks();
        let some: Vec<[u32; 2]> = blocks.iter().copied().step_by(blocks.len().div_ceil(PROBES).max(1)).collect();
        let of_block = |block: &[u32; 2]| {
            let mut found = Energies::new();
            self.visit_blocks(&[*block], |work| found.add(&work.measure(self.settings.coefficients)));
            found
        };
        let found: Vec<Energies> = some.par_iter().map(of_block).collect();
        let mut all = Energies::new();
        found.iter().for_each(|found| all.add(found));
        all.threshold(self.settings.terms)
    }

    /// Calls `each` with the rows of each block; blocks lie one after the other.
    fn visit_blocks(&self, blocks: &[[u32; 2]], mut each: impl FnMut(&mut BlockWork)) {
        let ([first, _], [_, end]) =
            (blocks.first().copied().unwrap_or_default(), blocks.last().copied().unwrap_or_default());
        let (mesh, samples) = (self.surface.domain.mesh, self.surface.samples);
        let observers: Vec<Observer> = (first..end).map(|i| Observer::of(mesh, samples.patch(i as usize))).collect();
        let mut work = BlockWork::new(self.tables.grid.side, self.settings.terms);
        let mut ends = blocks.iter().map(|block| (block[1] - first) as usize).peekable();
        visit(&self.occluders, self.surface.bvh, &observers, self.settings.resolution, |i, visible| {
            self.transform(&observers[i], visible, &mut work.row);
            work.push();
            if ends.next_if_eq(&(i + 1)).is_some() {
                each(&mut work);
            }
        });
    }
}
