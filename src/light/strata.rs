//! Importance sampling of an environment: rectangles of pixels of balanced energy, each with fixed candidate directions.
//!
//! The sphere is cut greedily, in the manner of Debevec's median cut (2005), but each cut goes where it lowers
//! sum(energy^2 * angular diameter) most. Irradiance is then
//! E(x) = sum over strata of weight * max(0, n.w) * F_t * V with one candidate (or the mean over several) a stratum.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::f64::consts::{PI, TAU};
use std::ops::Range;

use glam::DVec3;

use super::environment::{EnvironmentMap, direction_of};
use crate::error::{Error, Result};
use crate::math::random;

/// Resolution of the cut of an environment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StrataSettings {
    /// Rectangles at most; fewer when there are fewer lit pixels.
    pub strata: usize,
    /// Directions in each rectangle, a power of two.
    pub candidates: usize,
}

impl StrataSettings {
    /// Unoccluded irradiance within 0.1 % of the sum over all pixels with all candidates; with one random candidate a
    /// stratum the worst of a few normals is 3 to 10 % off, zero on average (1k maps, noon sun to museum).
    pub const DEFAULT: Self = Self { strata: 256, candidates: 64 };
}

/// A direction in the map's frame (not rotated) and its weight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// Unit vector towards the light.
    pub direction: DVec3,
    /// Radiance times solid angle, RGB; the mean over a stratum's candidates is the stratum's energy.
    pub weight: DVec3,
}

/// A rectangle of pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Stratum {
    /// Columns of the map.
    pub columns: Range<usize>,
    /// Rows of the map.
    pub rows: Range<usize>,
    /// Integral of the radiance over the rectangle, RGB.
    pub energy: DVec3,
}

/// A partition of an environment's lit part, with candidate directions.
#[derive(Clone, Debug, PartialEq)]
pub struct Strata {
    strata: Vec<Stratum>,
    candidates: Vec<Candidate>,
    candidates_per_stratum: usize,
}

/// More candidates than this are a mistake in the settings, not a need.
const MAX_CANDIDATES: usize = 1 << 24;

impl Strata {
    /// Cuts `map` into rectangles and places the candidates. Deterministic; a black map has no strata.
    ///
    /// # Errors
    /// Settings of zero, candidates that are not a power of two, more than 2^24 candidates in all (exit 3).
    pub fn new(map: &EnvironmentMap, settings: StrataSettings) -> Result<Self> {
        let StrataSettings { strata: count, candidates: per_stratum } = settings;
        if count == 0 || !per_stratum.is_power_of_two() {
            return Err(Error::input(format!(
                "an environment needs at least one stratum and a power of two of candidates, not {count} and {per_stratum}"
            )));
        }
        if count.saturating_mul(per_stratum) > MAX_CANDIDATES {
            return Err(Error::input(format!(
                "{count} strata of {per_stratum} candidates are more than {MAX_CANDIDATES} directions; ask for fewer"
            )));
        }
        let grid = Grid::new(map);
        let strata = grid.cut(count);
        let candidates = strata.iter().flat_map(|s| grid.place(s, per_stratum)).collect();
        Ok(Self { strata, candidates, candidates_per_stratum: per_stratum })
    }

    /// The rectangles, disjoint; everything outside them is black.
    pub fn strata(&self) -> &[Stratum] {
        &self.strata
    }

    /// Candidates of the stratum `index` (none past the end). Any aligned run of a power of two of them is itself well
    /// spread over the stratum. To use a few, start at a random one: the first alone sits in a corner.
    pub fn candidates(&self, index: usize) -> &[Candidate] {
        let start = index.saturating_mul(self.candidates_per_stratum).min(self.candidates.len());
        &self.candidates[start..(start + self.candidates_per_stratum).min(self.candidates.len())]
    }

    /// Integral of the radiance over all strata, RGB: the map's energy.
    pub fn energy(&self) -> DVec3 {
        self.strata.iter().map(|s| s.energy).sum()
    }
}

/// The map with tables over its rows.
struct Grid<'a> {
    map: &'a EnvironmentMap,
    solid_angle: Vec<f64>,
    /// Sine of the polar angle at each row boundary, height + 1 of them.
    sin_boundary: Vec<f64>,
}

/// Columns, rows and energy of one side of a cut.
type Half = (Range<usize>, Range<usize>, f64);

impl<'a> Grid<'a> {
    fn new(map: &'a EnvironmentMap) -> Self {
        let height = map.height();
        Self {
            map,
            solid_angle: (0..height).map(|row| map.pixel_solid_angle_sr(row)).collect(),
            sin_boundary: (0..=height).map(|row| (PI * row as f64 / height as f64).sin()).collect(),
        }
    }

    /// The scalar energy that steers cuts and candidates: the brightest channel, so that no hue is undersampled.
    fn importance(&self, x: usize, y: usize) -> f64 {
        self.map.pixel(x, y).max_element() * self.solid_angle[y]
    }

    fn row_importance(&self, columns: &Range<usize>, y: usize) -> f64 {
        columns.clone().map(|x| self.map.pixel(x, y).max_element()).sum::<f64>() * self.solid_angle[y]
    }

    /// Diagonal of a rectangle on the sphere in radians, not capped: each cut must make it smaller.
    fn diameter(&self, columns: &Range<usize>, rows: &Range<usize>) -> f64 {
        let tall = PI * rows.len() as f64 / self.map.height() as f64;
        let crosses_equator = 2 * rows.start <= self.map.height() && 2 * rows.end >= self.map.height();
        let widest = if crosses_equator { 1.0 } else { self.sin_boundary[rows.start].max(self.sin_boundary[rows.end]) };
        let wide = TAU * columns.len() as f64 / self.map.width() as f64 * widest;
        (tall * tall + wide * wide).sqrt()
    }

    fn cut(&self, count: usize) -> Vec<Stratum> {
        let mut pieces = vec![(0..self.map.width(), 0..self.map.height())];
        let energy: f64 = pieces[0].1.clone().map(|y| self.row_importance(&pieces[0].0, y)).sum();
        if energy <= 0.0 {
            return Vec::new();
        }
        // By cost, whose bits are in its order because it is positive, then the older piece.
        let mut waiting = BinaryHeap::from([(energy.to_bits(), Reverse(0))]);
        let mut done = Vec::new();
        while waiting.len() + done.len() < count {
            let Some((_, Reverse(index))) = waiting.pop() else { break };
            let (columns, rows) = &pieces[index];
            let Some(halves) = self.best_cut(columns, rows) else {
                done.push(index);
                continue;
            };
            for (columns, rows, energy) in halves.into_iter().filter(|half| half.2 > 0.0) {
                let cost = energy * energy * self.diameter(&columns, &rows);
                waiting.push((cost.to_bits(), Reverse(pieces.len())));
                pieces.push((columns, rows));
            }
        }
        done.extend(waiting.into_iter().map(|(_, Reverse(index))| index));
        let mut found: Vec<_> = done.into_iter().map(|index| pieces[index].clone()).collect();
        found.sort_by_key(|(columns, rows)| (rows.start, columns.start));
        found.into_iter().map(|(columns, rows)| self.stratum(columns, rows)).collect()
    }

    fn stratum(&self, columns: Range<usize>, rows: Range<usize>) -> Stratum {
        let energy = rows
            .clone()
            .map(|y| columns.clone().map(|x| self.map.pixel(x, y)).sum::<DVec3>() * self.solid_angle[y])
            .sum();
        Stratum { columns, rows, energy }
    }

    /// The cut of a rectangle that leaves the lowest cost, with the halves' energies; none for a single pixel.
    fn best_cut(&self, columns: &Range<usize>, rows: &Range<usize>) -> Option<[Half; 2]> {
        let mut by_column = vec![0.0; columns.len()];
        let mut by_row = Vec::with_capacity(rows.len());
        for y in rows.clone() {
            let mut sum = 0.0;
            for (x, total) in columns.clone().zip(&mut by_column) {
                let value = self.importance(x, y);
                *total += value;
                sum += value;
            }
            by_row.push(sum);
        }
        let column_cuts = cuts(&by_column).map(|(k, a, b)| {
            let at = columns.start + k;
            [(columns.start..at, rows.clone(), a), (at..columns.end, rows.clone(), b)]
        });
        let row_cuts = cuts(&by_row).map(|(k, a, b)| {
            let at = rows.start + k;
            [(columns.clone(), rows.start..at, a), (columns.clone(), at..rows.end, b)]
        });
        let cost = |halves: &[Half; 2]| -> f64 {
            halves.iter().map(|(c, r, energy)| energy * energy * self.diameter(c, r)).sum()
        };
        column_cuts.chain(row_cuts).min_by(|a, b| cost(a).total_cmp(&cost(b)))
    }

    /// Candidates in proportion to the importance: the row from the first coordinate of a (0, 2)-sequence, the column
    /// from the second, uniform in solid angle within the pixel.
    fn place(&self, stratum: &Stratum, count: usize) -> Vec<Candidate> {
        let (width, height) = (self.map.width() as f64, self.map.height() as f64);
        let by_row: Vec<f64> = stratum.rows.clone().map(|y| self.row_importance(&stratum.columns, y)).collect();
        let total: f64 = by_row.iter().sum();
        let half_cell = 0.5 / count as f64;
        let mut candidates: Vec<Candidate> = (0..count as u32)
            .map(|i| {
                let (row, fy) = pick(by_row.iter().copied(), total * (random::radical_inverse_2(i) + half_cell));
                let y = stratum.rows.start + row;
                let in_row = stratum.columns.clone().map(|x| self.map.pixel(x, y).max_element());
                let row_total: f64 = in_row.clone().sum();
                let (column, fx) = pick(in_row, row_total * (sobol_2(i) + half_cell));
                let x = stratum.columns.start + column;
                let (top, bottom) = ((PI * y as f64 / height).cos(), (PI * (y + 1) as f64 / height).cos());
                let polar = (top + (bottom - top) * fy).clamp(-1.0, 1.0).acos();
                let radiance = self.map.pixel(x, y);
                Candidate {
                    direction: direction_of((x as f64 + fx) / width, polar / PI),
                    weight: radiance / radiance.max_element() * total,
                }
            })
            .collect();
        normalise(&mut candidates, stratum.energy);
        candidates
    }
}

/// Makes the mean weight of each channel equal to `energy`; a channel that no candidate met is spread evenly.
fn normalise(candidates: &mut [Candidate], energy: DVec3) {
    let mean = candidates.iter().map(|c| c.weight).sum::<DVec3>() / candidates.len() as f64;
    for channel in 0..3 {
        let factor = energy[channel] / mean[channel];
        for candidate in candidates.iter_mut() {
            candidate.weight[channel] =
                if factor.is_finite() { candidate.weight[channel] * factor } else { energy[channel] };
        }
    }
}

/// Every way to cut a run of values in two: length of the first half, both sums.
fn cuts(values: &[f64]) -> impl Iterator<Item = (usize, f64, f64)> {
    let mut after = vec![0.0; values.len() + 1];
    for (i, value) in values.iter().enumerate().rev() {
        after[i] = after[i + 1] + value;
    }
    let mut before = 0.0;
    (1..values.len()).map(move |k| {
        before += values[k - 1];
        (k, before, after[k])
    })
}

/// Index at which the running sum of `weights` passes `target`, and the share of that weight, in [0, 1], before it
/// does. Never a zero weight.
fn pick(weights: impl Iterator<Item = f64>, target: f64) -> (usize, f64) {
    let (mut sum, mut last) = (0.0, (0, 0.5));
    for (index, weight) in weights.enumerate() {
        if weight > 0.0 {
            if target < sum + weight {
                return (index, ((target - sum) / weight).clamp(0.0, 1.0));
            }
            last = (index, 1.0);
        }
        sum += weight;
    }
    last
}

/// The second coordinate of Sobol's sequence: with the radical inverse a (0, 2)-sequence in base 2.
fn sobol_2(mut index: u32) -> f64 {
    let (mut direction, mut bits) = (1_u32 << 31, 0_u32);
    while index != 0 {
        if index & 1 == 1 {
            bits ^= direction;
        }
        direction ^= direction >> 1;
        index >>= 1;
    }
    f64::from(bits) * (1.0 / 4_294_967_296.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::sky::sky;

    fn settings(strata: usize, candidates: usize) -> StrataSettings {
        StrataSettings { strata, candidates }
    }

    fn map_of(width: usize, height: usize, value: impl Fn(usize, usize) -> [f32; 3]) -> EnvironmentMap {
        let pixels = (0..width * height).map(|i| value(i % width, i / width)).collect();
        EnvironmentMap::new(width, height, pixels).expect("valid")
    }

    fn noise(x: usize, y: usize) -> [f32; 3] {
        std::array::from_fn(|c| random::uniform(5, (y * 1000 + x) as u64, c as u64).powi(6) as f32)
    }

    fn close(a: DVec3, b: DVec3, relative: f64) -> bool {
        (a - b).abs().max_element() <= relative * b.max_element()
    }

    fn irradiance(map: &EnvironmentMap, normal: DVec3) -> DVec3 {
        // Four by four directions a pixel: the sum over centres alone is too coarse for the bright ones.
        let (w, h) = (map.width(), map.height());
        let mut sum = DVec3::ZERO;
        for y in 0..h {
            for x in 0..w {
                let mut cosine = 0.0;
                for k in 0..16 {
                    let (u, v) = (x as f64 + (k % 4) as f64 / 4.0 + 0.125, y as f64 + (k / 4) as f64 / 4.0 + 0.125);
                    cosine += direction_of(u / w as f64, v / h as f64).dot(normal).max(0.0) / 16.0;
                }
                sum += map.pixel(x, y) * map.pixel_solid_angle_sr(y) * cosine;
            }
        }
        sum
    }

    fn sampled(strata: &Strata, normal: DVec3) -> DVec3 {
        let mut sum = DVec3::ZERO;
        for i in 0..strata.strata().len() {
            let candidates = strata.candidates(i);
            sum += candidates.iter().map(|c| c.weight * c.direction.dot(normal).max(0.0)).sum::<DVec3>()
                / candidates.len() as f64;
        }
        sum
    }

    #[test]
    fn strata_are_disjoint_and_keep_the_energy_in_total_and_in_their_candidates() {
        let mut odd = sky().pixels().to_vec();
        odd.iter_mut().step_by(3).for_each(|p| *p = [0.0, 0.0, 7.0]);
        let maps = [sky(), map_of(37, 19, noise), EnvironmentMap::new(256, 128, odd).expect("valid")];
        for map in &maps {
            let strata = Strata::new(map, settings(100, 16)).expect("valid");
            assert_eq!(strata.strata().len(), 100);
            assert!(close(strata.energy(), map.energy(), 1e-12));
            let mut owner = vec![0; map.width() * map.height()];
            for (i, stratum) in strata.strata().iter().enumerate() {
                for y in stratum.rows.clone() {
                    for x in stratum.columns.clone() {
                        owner[y * map.width() + x] += 1;
                    }
                }
                let mean = strata.candidates(i).iter().map(|c| c.weight).sum::<DVec3>() / 16.0;
                assert!(close(mean, stratum.energy, 1e-12));
                for c in strata.candidates(i) {
                    assert!((c.direction.length() - 1.0).abs() < 1e-12 && c.weight.min_element() >= 0.0);
                    assert!(map.radiance(c.direction).max_element() > 0.0);
                }
            }
            assert!(owner.iter().all(|n| *n == 1), "strata overlap or leave lit pixels out");
        }
    }

    #[test]
    fn a_one_pixel_sun_keeps_its_energy_in_a_stratum_of_its_own() {
        for ground in [0.0_f32, 0.5] {
            let map = map_of(64, 32, |x, y| if (x, y) == (41, 9) { [9e5, 8e5, 7e5] } else { [ground; 3] });
            let strata = Strata::new(&map, settings(32, 8)).expect("valid");
            let sun = strata.strata().iter().find(|s| s.columns.contains(&41) && s.rows.contains(&9)).expect("lit");
            assert_eq!((sun.columns.clone(), sun.rows.clone()), (41..42, 9..10));
            assert_eq!(sun.energy, map.pixel(41, 9) * map.pixel_solid_angle_sr(9));
            assert!(close(strata.energy(), map.energy(), 1e-9));
        }
    }

    #[test]
    fn candidates_give_the_irradiance_of_all_pixels() {
        let sunny = map_of(128, 64, |x, y| if (x, y) == (20, 11) { [4e3, 3e3, 2e3] } else { noise(x / 4, y / 4) });
        for map in [sky(), sunny, map_of(1, 1, |_, _| [1.0, 2.0, 3.0]), map_of(64, 32, |_, _| [1.0; 3])] {
            let strata = Strata::new(&map, StrataSettings::DEFAULT).expect("valid");
            let mut worst: f64 = 0.0;
            for i in 0..24 {
                let v = (1.0 - 2.0 * (f64::from(i) + 0.5) / 24.0).acos() / PI;
                let normal = direction_of((f64::from(i) * 0.618_034).fract(), v);
                // One pixel over the whole sphere has no brute force sum over pixels, but a closed form.
                let truth = if map.width() == 1 { map.pixel(0, 0) * PI } else { irradiance(&map, normal) };
                worst = worst.max(((sampled(&strata, normal) - truth) / truth).abs().max_element());
            }
            let limit = if map.width() == 1 { 0.05 } else { 0.01 };
            assert!(worst < limit, "{}x{}: {worst}", map.width(), map.height());
        }
    }

    #[test]
    fn degenerate_maps_and_settings_are_handled() {
        let black = map_of(4, 2, |_, _| [0.0; 3]);
        let strata = Strata::new(&black, StrataSettings::DEFAULT).expect("valid");
        assert!(strata.strata().is_empty() && strata.candidates(0).is_empty());
        let bright = map_of(4, 2, |_, _| [f32::MAX; 3]);
        let strata = Strata::new(&bright, StrataSettings::DEFAULT).expect("valid");
        assert_eq!(strata.strata().len(), 8, "one pixel each");
        assert!(strata.candidates(7).iter().all(|c| c.weight.is_finite()));
        assert!(strata.candidates(8).is_empty() && strata.candidates(usize::MAX).is_empty());
        let dim = map_of(4, 2, |_, _| [f32::from_bits(1); 3]);
        assert!(close(Strata::new(&dim, settings(3, 4)).expect("valid").energy(), dim.energy(), 1e-12));
        for bad in [settings(0, 64), settings(8, 0), settings(8, 48), settings(usize::MAX, 64)] {
            assert!(Strata::new(&black, bad).is_err());
        }
    }
}
