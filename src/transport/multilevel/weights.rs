//! The adjoint of interpolation: values at many points, weighted, are summed at the few that interpolate them.

use rayon::prelude::*;

use crate::geometry::scattered::Weights;

/// Coarse points of a task at least.
const TASK: usize = 256;

/// The transpose of interpolation weights.
#[derive(Clone, Debug, Default)]
pub(crate) struct Adjoint {
    /// Coarse point `i` has the cells `offsets[i]..offsets[i + 1]`.
    pub(crate) offsets: Vec<usize>,
    /// Fine points and their weights.
    pub(crate) cells: Vec<(u32, f32)>,
}

impl Adjoint {
    /// The transpose of weights over `coarse` points.
    pub(super) fn new(weights: &Weights, coarse: usize) -> Self {
        let mut offsets = vec![0; coarse + 1];
        let used = |(_, w): &(u32, f32)| *w != 0.0;
        let fine = weights.values.len().checked_div(weights.each).unwrap_or(0);
        for i in 0..fine {
            weights.of(i).filter(used).for_each(|(source, _)| offsets[source as usize + 1] += 1);
        }
        (0..coarse).for_each(|i| offsets[i + 1] += offsets[i]);
        let mut next = offsets.clone();
        let mut cells = vec![(0, 0.0); offsets[coarse]];
        for i in 0..fine {
            for (source, weight) in weights.of(i).filter(used) {
                cells[next[source as usize]] = (i as u32, weight);
                next[source as usize] += 1;
            }
        }
        Self { offsets, cells }
    }

    /// Weighted sums, at every coarse point, of RGB values at the fine points.
    pub(super) fn apply(&self, values: &[[f32; 4]]) -> Vec<[f32; 4]> {
        let coarse = self.offsets.len().saturating_sub(1);
        let of_point = |i: usize| {
            let mut sum = [0.0f32; 4];
            for &(fine, weight) in &self.cells[self.offsets[i]..self.offsets[i + 1]] {
                let value = values.get(fine as usize).copied().unwrap_or_default();
                (0..4).for_each(|c| sum[c] += weight * value[c]);
            }
            sum
        };
        (0..coarse).into_par_iter().with_min_len(TASK).map(of_point).collect()
    }

    /// Bytes in memory.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(self.offsets.as_slice()) + size_of_val(self.cells.as_slice())
    }
}
