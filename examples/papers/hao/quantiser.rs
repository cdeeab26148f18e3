//! Scalar quantisers of 8 bits: a table of values, and for each value the nearest entry.
//!
//! [`Quantiser8::uniform`] has equal steps; [`Quantiser8::lloyd`] places the entries where they serve the given values best
//! (Lloyd's method I, Gersho & Gray 1992, chapter 6). Sums are of integers or in a fixed order, so the same values
//! give the same table at any number of threads.

use rayon::prelude::*;

use translux::error::{Error, Result};

/// Entries of a table of 8 bits.
pub(crate) const LEVELS: usize = 256;

/// Values handled together by a thread.
const CHUNK: usize = 1 << 16;

/// Up to so many values are taken as they are; of more, a histogram.
const MOST_EXACT: usize = 1 << 17;

/// Bits of a bin's number, and of a position inside all bins.
const BIN_BITS: u32 = 18;
const POSITION_BITS: u32 = 32;

/// Lloyd's iteration ends when the error falls by less than this fraction.
const TOLERANCE: f64 = 1e-7;

/// Iterations at most; each makes the error smaller.
const MOST_ITERATIONS: usize = 2000;

/// A table of 256 ascending values, and the nearest of them for any value.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Quantiser8 {
    table: [f32; LEVELS],
    /// The largest value that is at least as near to entry `i` as to entry `i + 1`; the last is infinite.
    upper: [f32; LEVELS],
    /// First entry with the same value.
    first: [u8; LEVELS],
}

impl Quantiser8 {
    /// From 256 finite values in ascending order; equal ones are allowed.
    ///
    /// # Errors
    /// Another number of values, or values that are not finite or not ascending (exit 3).
    pub(crate) fn from_table(table: &[f32]) -> Result<Self> {
        let Ok(table) = <[f32; LEVELS]>::try_from(table) else {
            return Err(Error::input(format!("a quantiser's table has {} values, not {LEVELS}", table.len())));
        };
        if let Some(i) = table.iter().position(|value| !value.is_finite()) {
            return Err(Error::input(format!("value {i} of a quantiser's table is not finite")));
        }
        if let Some(i) = table.windows(2).position(|pair| pair[0] > pair[1]) {
            return Err(Error::input(format!("value {} of a quantiser's table is below the one before", i + 1)));
        }
        let mut upper = [f32::INFINITY; LEVELS];
        let mut first = [0u8; LEVELS];
        for i in 1..LEVELS {
            upper[i - 1] = at_most(0.5 * (f64::from(table[i - 1]) + f64::from(table[i])));
            first[i] = if table[i] == table[i - 1] { first[i - 1] } else { i as u8 };
        }
        Ok(Self { table, upper, first })
    }

    /// Equal steps from `min` to `max`, both of them entries: entry `i` is `min + i / 255 (max - min)`.
    ///
    /// # Errors
    /// Numbers that are not finite, or `min > max` (exit 3).
    pub(crate) fn uniform(min: f32, max: f32) -> Result<Self> {
        if !(min.is_finite() && max.is_finite() && min <= max) {
            return Err(Error::input(format!("a quantiser from {min} to {max}: both must be finite and in order")));
        }
        let (low, high) = (f64::from(min), f64::from(max));
        let entry = |i: usize| (low + i as f64 / 255.0 * (high - low)) as f32;
        let mut table: [f32; LEVELS] = std::array::from_fn(entry);
        table[LEVELS - 1] = max;
        Self::from_table(&table)
    }

    /// The table that Lloyd's method finds for these values: exact for up to 256 different ones, and never with a larger
    /// mean square error than [`Quantiser8::uniform`] over their range.
    ///
    /// # Errors
    /// No values, or one that is not finite (exit 3).
    pub(crate) fn lloyd(values: &[f32]) -> Result<Self> {
        let levels = lloyd_levels(values, LEVELS)?;
        let Some(&last) = levels.last() else { return Err(no_values()) };
        let table: [f32; LEVELS] = std::array::from_fn(|i| levels.get(i).copied().unwrap_or(last));
        let best = Self::from_table(&table)?;
        let error = best.square_error(values);
        if error == 0.0 {
            return Ok(best);
        }
        let (min, max) = range(values)?;
        let uniform = Self::uniform(min, max)?;
        // Bins and the tolerance can cost a hair where equal steps are the optimum.
        Ok(if uniform.square_error(values) < error { uniform } else { best })
    }

    /// The values of all codes, ascending.
    pub(crate) fn table(&self) -> &[f32; LEVELS] {
        &self.table
    }

    /// Code of the nearest entry: of two equally near the lower, of equal entries the first. NaN gives 0.
    #[inline]
    pub(crate) fn encode(&self, value: f32) -> u8 {
        // Halving without branches; upper[255] is infinite, so the sum stays below 256.
        let mut at = 0;
        for half in [128, 64, 32, 16, 8, 4, 2, 1] {
            at += if value > self.upper[at + half - 1] { half } else { 0 };
        }
        self.first[at]
    }

    /// Codes of many values, in parallel.
    pub(crate) fn encode_all(&self, values: &[f32]) -> Vec<u8> {
        let mut codes = vec![0; values.len()];
        codes.par_chunks_mut(CHUNK).zip(values.par_chunks(CHUNK)).for_each(|(codes, values)| {
            codes.iter_mut().zip(values).for_each(|(code, value)| *code = self.encode(*value));
        });
        codes
    }

    /// The value of a code.
    #[inline]
    pub(crate) fn decode(&self, code: u8) -> f32 {
        self.table[usize::from(code)]
    }

    /// Sum of squares of what quantising changes.
    pub(crate) fn square_error(&self, values: &[f32]) -> f64 {
        sum(values, |value| f64::from(self.decode(self.encode(value))) - f64::from(value))
    }
}

/// The largest f32 that is not above a finite number within their range.
fn at_most(x: f64) -> f32 {
    let nearest = x as f32;
    if f64::from(nearest) > x { nearest.next_down() } else { nearest }
}

/// Sum of squares of a function of each value, in an order that depends on their number only.
fn sum(values: &[f32], f: impl Fn(f32) -> f64 + Sync) -> f64 {
    let squares = |chunk: &[f32]| chunk.iter().map(|value| f(*value).powi(2)).sum::<f64>();
    values.par_chunks(CHUNK).map(squares).collect::<Vec<f64>>().iter().sum()
}

fn no_values() -> Error {
    Error::input("a quantiser needs at least one value")
}

/// Smallest and largest value.
fn range(values: &[f32]) -> Result<(f32, f32)> {
    if values.is_empty() {
        return Err(no_values());
    }
    let of_chunk = |(chunk, values): (usize, &[f32])| {
        if let Some(at) = values.iter().position(|value| !value.is_finite()) {
            return Err(chunk * CHUNK + at);
        }
        Ok(values.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), v| (a.min(*v), b.max(*v))))
    };
    let ranges: Vec<_> = values.par_chunks(CHUNK).enumerate().map(of_chunk).collect();
    let mut all = (f32::INFINITY, f32::NEG_INFINITY);
    for range in ranges {
        match range {
            Ok((low, high)) => all = (all.0.min(low), all.1.max(high)),
            Err(at) => {
                return Err(Error::input(format!("value {at} to quantise is {}: not a finite number", values[at])));
            }
        }
    }
    // -0 becomes 0.
    Ok((all.0 + 0.0, all.1 + 0.0))
}

/// Up to `levels` values that represent these with a small mean square error, strictly ascending: the different values
/// themselves where they are no more than that. Of many values, a histogram of 2^18 bins stands for them.
///
/// Lloyd's method goes on from two starts, equal steps and a density of levels as the cube root of that of the values
/// (best for many levels: Panter & Dite 1951); the better end is taken.
///
/// # Errors
/// No values, one that is not finite, or no levels (exit 3).
pub(crate) fn lloyd_levels(values: &[f32], levels: usize) -> Result<Vec<f32>> {
    let (min, max) = range(values)?;
    if levels == 0 {
        return Err(Error::input("a quantiser needs at least one level"));
    }
    if let Some(few) = few_values(values, levels) {
        return Ok(few);
    }
    let atoms = Atoms::new(values, min, max, levels);
    let (low, high) = (f64::from(min), f64::from(max));
    let equal = (1..levels).map(|i| low + i as f64 / levels as f64 * (high - low)).collect();
    let ends = [equal, atoms.companded(levels)].map(|cuts| atoms.lloyd(cuts, levels));
    let best = if ends[1].1 > ends[0].1 { &ends[1] } else { &ends[0] };
    let mut found: Vec<f32> = best.0.iter().map(|level| (*level as f32).clamp(min, max)).collect();
    found.dedup();
    Ok(found)
}

/// The different values in ascending order, `None` if there are more than `most`.
fn few_values(values: &[f32], most: usize) -> Option<Vec<f32>> {
    let mut found: Vec<f32> = Vec::new();
    let mut last = f32::NAN;
    for value in values {
        if *value == last {
            continue;
        }
        last = value + 0.0;
        if let Err(at) = found.binary_search_by(|other| other.total_cmp(&last)) {
            if found.len() == most {
                return None;
            }
            found.insert(at, last);
        }
    }
    Some(found)
}

/// Values in ascending order with sums over all before each, so that the mean of any range is at hand.
struct Atoms {
    at: Vec<f64>,
    /// Number of values in atoms before this one; one entry more than atoms.
    count: Vec<f64>,
    /// Their sum, less their number times `centre`.
    sum: Vec<f64>,
    centre: f64,
}

impl Atoms {
    fn new(values: &[f32], min: f32, max: f32, levels: usize) -> Self {
        let atoms = if values.len() <= MOST_EXACT { None } else { histogram(values, min, max) };
        // Values that crowd into a few bins are taken as they are, too.
        let atoms = atoms.filter(|atoms| atoms.len() >= 64 * levels).unwrap_or_else(|| {
            let mut sorted = values.to_vec();
            sorted.par_sort_unstable_by(f32::total_cmp);
            sorted.chunk_by(|a, b| a == b).map(|run| (f64::from(run[0]) + 0.0, run.len() as f64)).collect()
        });
        let total: f64 = atoms.iter().map(|atom| atom.1).sum();
        let centre = atoms.iter().map(|(at, count)| at * count).sum::<f64>() / total;
        let (mut count, mut sum) = (vec![0.0], vec![0.0]);
        let mut sums = (0.0, 0.0);
        for atom in &atoms {
            sums = (sums.0 + atom.1, sums.1 + atom.1 * (atom.0 - centre));
            count.push(sums.0);
            sum.push(sums.1);
        }
        Self { at: atoms.iter().map(|atom| atom.0).collect(), count, sum, centre }
    }

    /// Number of values of a range of atoms, and their mean less `centre`.
    fn cell(&self, from: usize, end: usize) -> (f64, f64) {
        let count = self.count[end] - self.count[from];
        (count, (self.sum[end] - self.sum[from]) / count)
    }

    /// Squared error of a range of atoms about their mean, for choosing the one to split.
    fn spread(&self, from: usize, end: usize) -> f64 {
        let (_, mean) = self.cell(from, end);
        let square = |i: usize| (self.at[i] - self.centre - mean).powi(2) * (self.count[i + 1] - self.count[i]);
        (from..end).map(square).sum()
    }

    /// Bounds between cells, so many that each has the same share of the cube root of the density.
    fn companded(&self, levels: usize) -> Vec<f64> {
        let last = self.at.len() - 1;
        let width = |i: usize| 0.5 * (self.at[(i + 1).min(last)] - self.at[i.saturating_sub(1)]);
        // A cell of width w with n values gets (n / w)^(1/3) w.
        let share: Vec<f64> =
            (0..=last).map(|i| ((self.count[i + 1] - self.count[i]) * width(i) * width(i)).cbrt()).collect();
        let total: f64 = share.iter().sum();
        let mut cuts = Vec::with_capacity(levels);
        let mut before = 0.0;
        for (at, share) in self.at.iter().zip(share) {
            before += share;
            while cuts.len() + 1 < levels && before >= (cuts.len() + 1) as f64 / levels as f64 * total {
                cuts.push(*at);
            }
        }
        cuts
    }

    /// Lloyd's iteration from these bounds: levels, and the squares that they explain (the more, the less error).
    fn lloyd(&self, bounds: Vec<f64>, levels: usize) -> (Vec<f64>, f64) {
        let total = self.spread(0, self.at.len());
        let mut cuts = self.cuts(&bounds);
        let (mut explained, mut means) = (0.0, Vec::new());
        for _ in 0..MOST_ITERATIONS {
            self.fill(&mut cuts, levels);
            let cells: Vec<(f64, f64)> = cuts.windows(2).map(|pair| self.cell(pair[0], pair[1])).collect();
            let now: f64 = cells.iter().map(|(count, mean)| count * mean * mean).sum();
            if now <= explained + TOLERANCE * (total - now).max(0.0) && !means.is_empty() {
                break;
            }
            explained = now;
            means = cells.iter().map(|cell| self.centre + cell.1).collect();
            let middles: Vec<f64> = means.windows(2).map(|pair| 0.5 * (pair[0] + pair[1])).collect();
            cuts = self.cuts(&middles);
        }
        (means, explained)
    }

    /// First atoms of the cells between these bounds, and the end; cells without atoms left out.
    fn cuts(&self, bounds: &[f64]) -> Vec<usize> {
        let inner = bounds.iter().map(|bound| self.at.partition_point(|at| at <= bound));
        let mut cuts: Vec<usize> = std::iter::once(0).chain(inner).chain([self.at.len()]).collect();
        cuts.dedup();
        cuts
    }

    /// Splits the worst cells at their mean until there are as many as levels; there are more atoms than that.
    fn fill(&self, cuts: &mut Vec<usize>, levels: usize) {
        while cuts.len() < levels + 1 {
            let spreads = cuts.windows(2).map(|pair| self.spread(pair[0], pair[1]));
            let worst = spreads.enumerate().reduce(|best, next| if next.1 > best.1 { next } else { best });
            let Some((worst, _)) = worst.filter(|worst| worst.1 > 0.0) else { return };
            let (from, end) = (cuts[worst], cuts[worst + 1]);
            let mean = self.centre + self.cell(from, end).1;
            let middle = from + self.at[from..end].partition_point(|at| *at <= mean);
            cuts.insert(worst + 1, middle.clamp(from + 1, end - 1));
        }
    }
}

/// Means and numbers of values in the bins that have any; `None` where the range is too narrow for bins.
fn histogram(values: &[f32], min: f32, max: f32) -> Option<Vec<(f64, f64)>> {
    let (low, width) = (f64::from(min), f64::from(max) - f64::from(min));
    let scale = (1u64 << POSITION_BITS) as f64 / width;
    if !scale.is_finite() {
        return None;
    }
    // Number of values and sum of their positions: integers, so that the order of adding does not matter.
    let empty = || vec![(0u64, 0u64); 1 << BIN_BITS];
    let largest = (1u64 << POSITION_BITS) - 1;
    let add = |mut bins: Vec<(u64, u64)>, values: &[f32]| {
        for value in values {
            let position = (((f64::from(*value) - low) * scale) as u64).min(largest);
            let bin = &mut bins[(position >> (POSITION_BITS - BIN_BITS)) as usize];
            *bin = (bin.0 + 1, bin.1 + position);
        }
        bins
    };
    let join = |mut a: Vec<(u64, u64)>, b: Vec<(u64, u64)>| {
        a.iter_mut().zip(b).for_each(|(a, b)| *a = (a.0 + b.0, a.1 + b.1));
        a
    };
    let bins = values.par_chunks(values.len().div_ceil(16).max(CHUNK)).fold(empty, add).reduce(empty, join);
    let occupied = bins.into_iter().filter(|bin| bin.0 > 0);
    // A position is rounded down, half a unit on average.
    Some(occupied.map(|(n, sum)| (low + (sum as f64 / n as f64 + 0.5) / scale, n as f64)).collect())
}

#[cfg(test)]
#[path = "quantiser_tests.rs"]
mod tests;
