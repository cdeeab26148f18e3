//! Values at many targets as weighted sums of values at a few sources, where neighbouring targets share most of their sources:
//! a dense product of small matrices for each run of targets instead of a gather for each target; and the adjoint of interpolation:
//! values at many points, weighted, are summed at the few that interpolate them.

use crate::geometry::scattered::Weights;
use crate::math::simd::{InstructionSet, multiversion};
use crate::parallel::*;

/// Targets of a run.
pub const LANES: usize = 16;

/// Stored value of a weight of 1.
pub const ONE: f32 = 16384.0;

/// Runs of one task.
const RUNS: usize = 64;

/// Weights of runs of [`LANES`] targets over the sources that any of the run has.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct SharedWeights {
    targets: usize,
    /// Sources of run `i` are `sources[offsets[i]..offsets[i + 1]]`.
    offsets: Vec<u32>,
    sources: Vec<u32>,
    /// `[source of a run][target of the run]` in units of 1 / [`ONE`].
    values: Vec<[i16; LANES]>,
}

impl SharedWeights {
    /// Rounds weights to 16 bits; the sum of a target's weights is kept to the rounding of one weight.
    pub fn new(weights: &Weights) -> Self {
        let targets = weights.values.len().checked_div(weights.each).unwrap_or(0);
        let runs: Vec<(Vec<u32>, Vec<[i16; LANES]>)> = (0..targets.div_ceil(LANES))
            .into_par_iter()
            .map(|run| of_run(weights, run * LANES..((run + 1) * LANES).min(targets)))
            .collect();
        let mut result = Self { targets, offsets: vec![0], ..Self::default() };
        for (sources, values) in runs {
            result.sources.extend(sources);
            result.values.extend(values);
            result.offsets.push(result.sources.len() as u32);
        }
        result
    }

    /// Renumbers the sources: source `i` becomes `names[i]`, or stays where there is none.
    pub fn rename_sources(&mut self, names: &[u32]) {
        self.sources.iter_mut().for_each(|source| *source = names.get(*source as usize).copied().unwrap_or(*source));
    }

    /// Number of targets.
    pub fn targets(&self) -> usize {
        self.targets
    }

    /// Bounds of the runs in [`Self::sources`] and [`Self::values`], one more than runs.
    pub fn offsets(&self) -> &[u32] {
        &self.offsets
    }

    /// Sources, run after run.
    pub fn sources(&self) -> &[u32] {
        &self.sources
    }

    /// A row of weights for each source of a run, in units of 1 / [`ONE`].
    pub fn values(&self) -> &[[i16; LANES]] {
        &self.values
    }

    /// Sources and weights of one target.
    pub fn of(&self, target: usize) -> impl Iterator<Item = (u32, f32)> + '_ {
        let run = self.offsets.get(target / LANES..).and_then(|o| o.first_chunk::<2>());
        let cells = run.map_or(0..0, |&[from, to]| from as usize..to as usize);
        let rows = self.sources.get(cells.clone()).unwrap_or(&[]).iter().zip(self.values.get(cells).unwrap_or(&[]));
        rows.map(move |(&source, row)| (source, f32::from(row[target % LANES]) / ONE)).filter(|(_, w)| *w != 0.0)
    }

    /// Bytes in memory.
    pub fn bytes(&self) -> usize {
        size_of_val(self.offsets.as_slice())
            + size_of_val(self.sources.as_slice())
            + size_of_val(self.values.as_slice())
    }

    /// Fills `out`, one for each target, with the weighted sums of RGB values at the sources, negative sums clamped to
    /// 0; values that are missing count as 0.
    pub fn apply(&self, values: &[[f32; 4]], out: &mut Vec<[f32; 4]>) {
        self.apply_above(0.0, values, out);
    }

    /// [`Self::apply`] without a clamp.
    pub fn apply_signed(&self, values: &[[f32; 4]], out: &mut Vec<[f32; 4]>) {
        self.apply_above(f32::NEG_INFINITY, values, out);
    }

    fn apply_above(&self, least: f32, values: &[[f32; 4]], out: &mut Vec<[f32; 4]>) {
        let level = InstructionSet::detect();
        out.resize(self.targets, [0.0; 4]);
        out.par_chunks_mut(LANES * RUNS).enumerate().for_each(|(chunk, out)| {
            sums(level, (self, least), chunk * RUNS, values, out);
        });
    }
}

fn of_run(weights: &Weights, targets: std::ops::Range<usize>) -> (Vec<u32>, Vec<[i16; LANES]>) {
    let mut sources: Vec<u32> =
        targets.clone().flat_map(|t| weights.of(t).filter(|(_, w)| *w != 0.0).map(|(source, _)| source)).collect();
    sources.sort_unstable();
    sources.dedup();
    let mut values = vec![[0i16; LANES]; sources.len()];
    for (lane, target) in targets.enumerate() {
        let (mut exact, mut rounded) = (0.0f32, 0i32);
        let mut largest: Option<(usize, f32)> = None;
        for (source, weight) in weights.of(target) {
            let Ok(row) = sources.binary_search(&source) else { continue };
            let value = (weight * ONE).round().clamp(f32::from(i16::MIN), f32::from(i16::MAX)) as i16;
            // A source may be listed twice.
            values[row][lane] = values[row][lane].saturating_add(value);
            exact += weight;
            rounded += i32::from(value);
            if largest.is_none_or(|(_, known)| weight > known) {
                largest = Some((row, weight));
            }
        }
        if let Some((row, _)) = largest {
            let missing = ((exact * ONE).round() as i32 - rounded).clamp(-64, 64) as i16;
            values[row][lane] = values[row][lane].saturating_add(missing);
        }
    }
    (sources, values)
}

#[inline(always)]
fn sums_body((weights, least): (&SharedWeights, f32), first: usize, values: &[[f32; 4]], out: &mut [[f32; 4]]) {
    for (run, out) in out.chunks_mut(LANES).enumerate() {
        let Some(&[from, to]) = weights.offsets.get(first + run..).and_then(|o| o.first_chunk::<2>()) else { return };
        let cells = from as usize..to as usize;
        let (Some(sources), Some(rows)) = (weights.sources.get(cells.clone()), weights.values.get(cells)) else {
            return;
        };
        let [mut r, mut g, mut b] = [[0.0f32; LANES]; 3];
        for (&source, row) in sources.iter().zip(rows) {
            let [red, green, blue, _] = values.get(source as usize).copied().unwrap_or_default();
            for i in 0..LANES {
                let weight = f32::from(row[i]);
                r[i] += weight * red;
                g[i] += weight * green;
                b[i] += weight * blue;
            }
        }
        for (i, out) in out.iter_mut().enumerate() {
            *out = [r[i], g[i], b[i], 0.0].map(|sum| (sum * (1.0 / ONE)).max(least));
        }
    }
}

multiversion! {
    /// See [`SharedWeights::apply`], from one run on.
    fn sums(weights: (&SharedWeights, f32), first: usize, values: &[[f32; 4]], out: &mut [[f32; 4]]) => sums_body
}

/// Coarse points of a task at least.
const COARSE_OF_A_TASK: usize = 256;

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
        (0..coarse).into_par_iter().with_min_len(COARSE_OF_A_TASK).map(of_point).collect()
    }

    /// Bytes in memory.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(self.offsets.as_slice()) + size_of_val(self.cells.as_slice())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::uniform;

    fn random(targets: usize, each: usize, sources: u64) -> Weights {
        let count = (targets * each) as u64;
        let at = |i: u64| (uniform(3, i, 0) * sources as f64) as u32;
        let mut weights = Weights {
            each,
            sources: (0..count).map(at).collect(),
            values: (0..count).map(|i| (uniform(3, i, 1) - 0.3) as f32).collect(),
        };
        for row in weights.values.chunks_exact_mut(each) {
            let sum: f32 = row.iter().sum();
            row.iter_mut().for_each(|w| *w *= 0.2);
            row[0] += 1.0 - 0.2 * sum;
        }
        weights
    }

    #[test]
    fn shared_weights_give_the_sums_of_each_target_on_every_level() {
        let weights = random(1000, 7, 90);
        let shared = SharedWeights::new(&weights);
        let values: Vec<[f32; 4]> =
            (0..90).map(|i| [0, 1, 2].map(|c| uniform(4, i, c) as f32)).map(|[r, g, b]| [r, g, b, 9.0]).collect();
        let mut found = Vec::new();
        shared.apply(&values, &mut found);
        assert_eq!((found.len(), shared.targets()), (1000, 1000));
        for (target, found) in found.iter().enumerate() {
            for channel in 0..3 {
                let sum: f32 = weights.of(target).map(|(s, w)| w * values[s as usize][channel]).sum();
                assert!((found[channel] - sum.max(0.0)).abs() < 4e-4, "{target}: {sum} {found:?}");
            }
        }
        let mut constant = Vec::new();
        shared.apply(&[[2.0; 4]; 90], &mut constant);
        assert!(constant.iter().all(|v| (v[0] - 2.0).abs() < 2.5e-4), "{constant:?}");
        for level in InstructionSet::available() {
            let mut same = vec![[0.0; 4]; 1000];
            sums(level, (&shared, 0.0), 0, &values, &mut same);
            assert_eq!(same, found);
        }
    }

    #[test]
    fn odd_sizes_have_answers() {
        let none = SharedWeights::new(&Weights::default());
        let mut out = vec![[1.0; 4]];
        none.apply(&[], &mut out);
        assert!(out.is_empty());
        let shared = SharedWeights::new(&random(17, 3, 5));
        shared.apply(&[], &mut out);
        assert_eq!(out, vec![[0.0; 4]; 17]);
    }
}
