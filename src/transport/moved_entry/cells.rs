//! Cells of a grid around the samples, over which light is counted.

use crate::parallel::*;
use crate::transport::surface::Surface;

/// Eight cells of a sample, and its shares in them.
pub(super) type Shares = ([u32; 8], [f32; 8]);

/// Cells of a grid around the samples of a part; samples share in the eight nearest.
pub(super) struct Cells {
    /// Cells of each sample.
    pub(super) of_sample: Vec<Shares>,
    pub(super) count: usize,
}

impl Cells {
    /// Cells of the samples, whose edges depend on the part.
    pub(super) fn new(surface: &Surface, edge_mm: impl Fn(usize) -> Option<f64>) -> Self {
        const NONE: [i32; 4] = [i32::MIN; 4];
        let corners = |[part, x, y, z]: [i32; 4]| -> [[i32; 4]; 8] {
            std::array::from_fn(|i| [part, x + (i & 1) as i32, y + (i >> 1 & 1) as i32, z + (i >> 2) as i32])
        };
        let mut bases = vec![(NONE, [0.0; 3]); surface.samples.len()];
        for part in 0..surface.domain.parts.parts.len() {
            let Some(edge) = edge_mm(part) else { continue };
            let range = surface.samples.part(part);
            bases[range.clone()].par_iter_mut().zip(&surface.patches[range]).for_each(|(base, patch)| {
                let at = patch.centre_mm / edge;
                let low = at.floor();
                *base = ([part as i32, low.x as i32, low.y as i32, low.z as i32], (at - low).as_vec3().to_array());
            });
        }
        // Neighbours come one after another: few of them begin another cell.
        let mut lowest: Vec<[i32; 4]> =
            bases.chunk_by(|a, b| a.0 == b.0).map(|same| same[0].0).filter(|base| *base != NONE).collect();
        lowest.sort_unstable();
        lowest.dedup();
        let mut keys: Vec<[i32; 4]> = lowest.iter().flat_map(|base| corners(*base)).collect();
        keys.sort_unstable();
        keys.dedup();
        let found = |key: [i32; 4]| keys.binary_search(&key).map_or(u32::MAX, |found| found as u32);
        let cells: Vec<[u32; 8]> = lowest.iter().map(|base| corners(*base).map(found)).collect();
        let of_base = |(base, at): &([i32; 4], [f32; 3])| {
            let share = |i: usize| {
                let of = |axis: usize| if i >> axis & 1 == 1 { at[axis] } else { 1.0f32 - at[axis] };
                of(0) * of(1) * of(2)
            };
            let own = lowest.binary_search(base).map_or([u32::MAX; 8], |index| cells[index]);
            (own, std::array::from_fn(share))
        };
        Self { of_sample: bases.par_iter().map(of_base).collect(), count: keys.len() }
    }

    /// Cells of a sample and its shares in them.
    #[inline]
    fn shares(&self, sample: usize) -> impl Iterator<Item = (usize, f32)> {
        let (cells, shares) = &self.of_sample[sample];
        let all = cells.iter().zip(shares).filter(|(cell, _)| **cell != u32::MAX);
        all.map(|(cell, share)| (*cell as usize, *share))
    }

    /// Sums over the cells of values of the samples. Few samples share in a cell: single precision is enough.
    pub(super) fn sums<const C: usize>(&self, values: impl Iterator<Item = [f32; C]>) -> Vec<[f32; C]> {
        let mut sums = vec![[0.0; C]; self.count];
        for (sample, value) in values.enumerate() {
            if value != [0.0; C] {
                self.shares(sample).for_each(|(cell, share)| add_single(&mut sums[cell], share, &value));
            }
        }
        sums
    }

    /// Means at a sample of values of the cells.
    #[inline]
    pub(super) fn mean<const C: usize>(&self, sample: usize, values: &[[f32; C]]) -> [f32; C] {
        let mut mean = [0.0; C];
        self.shares(sample).for_each(|(cell, share)| add_single(&mut mean, share, &values[cell]));
        mean
    }
}

/// [`add`] in single precision.
#[inline(always)]
fn add_single<const C: usize>(sum: &mut [f32; C], factor: f32, values: &[f32; C]) {
    sum.iter_mut().zip(values).for_each(|(sum, value)| *sum += factor * value);
}

/// Adds a multiple of values.
#[inline(always)]
pub(super) fn add<const C: usize>(sum: &mut [f64; C], factor: f64, values: &[f64; C]) {
    sum.iter_mut().zip(values).for_each(|(sum, value)| *sum += factor * value);
}
