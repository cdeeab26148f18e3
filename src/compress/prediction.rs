//! Predictive coding of scattered data: values at points of a surface (or of the sphere of directions), coarse to fine,
//! each level predicted from the reconstruction of those before it; the residuals are quantised.
//!
//! Because the prediction is made from reconstructed values, the error of a value is that of its own quantiser alone.

use std::ops::Range;

use crate::geometry::scattered::{Kriging, OrientedPoint, Weights, choose};
use crate::parallel::*;

/// Number of sources that a point is predicted from.
const SOURCES: usize = 12;

/// Rounding offset: a residual below 1 - 0.42 steps becomes zero and so on, for fewer bits and a little more error.
const ROUNDING: f32 = 0.42;

/// Index that stands for no row.
const NONE: u32 = u32::MAX;

/// Points in the order in which they are coded, and the weights that predict each.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Net {
    /// Index of the point of every row.
    pub point: Vec<u32>,
    levels: Vec<Refinement>,
}

#[derive(Clone, Debug, Default, PartialEq)]
struct Refinement {
    rows: Range<usize>,
    /// Weights of the prediction; the sources are rows.
    weights: Weights,
}

impl Net {
    /// A net of reference points at a spacing for every run of `points` (a part; parts do not predict each other).
    pub fn new(points: &[OrientedPoint], parts: &[Range<usize>], spacing_mm: f64) -> Self {
        let of_part = |part: &Range<usize>| {
            let first = part.start as u32;
            let levels = choose(points.get(part.clone()).unwrap_or(&[]), spacing_mm);
            levels.into_iter().map(|level| level.into_iter().map(|i| i + first).collect()).collect()
        };
        let chosen: Vec<Vec<Vec<u32>>> = parts.iter().map(of_part).collect();
        let depth = chosen.iter().map(Vec::len).max().unwrap_or(0);
        let mut net = Self::default();
        // Rows of each part so far.
        let mut rows: Vec<Vec<u32>> = vec![Vec::new(); parts.len()];
        for level in 0..depth {
            let spacing = spacing_mm * 2f64.powi((depth - 1 - level) as i32);
            let start = net.point.len();
            let mut weights = Weights { each: SOURCES, ..Weights::default() };
            let fit = Kriging { sources: SOURCES, ..Kriging::RADIOSITY };
            let mut added = Vec::with_capacity(parts.len());
            for (part, levels) in chosen.iter().enumerate() {
                // Levels of all parts end together, at the finest.
                let members = (level + levels.len()).checked_sub(depth).map_or(&[] as &[u32], |at| &levels[at]);
                let of = |i: &u32| points[*i as usize];
                let sources: Vec<OrientedPoint> = rows[part].iter().map(|&r| of(&net.point[r as usize])).collect();
                let targets: Vec<OrientedPoint> = members.iter().map(of).collect();
                let own = Weights::new(&sources, &targets, spacing, fit);
                if own.each == 0 {
                    weights.sources.extend(std::iter::repeat_n(NONE, members.len() * SOURCES));
                    weights.values.extend(std::iter::repeat_n(0.0, members.len() * SOURCES));
                } else {
                    weights.sources.extend(own.sources.iter().map(|&s| rows[part][s as usize]));
                    weights.values.extend(own.values);
                }
                added.push(members);
            }
            for (part, members) in added.into_iter().enumerate() {
                let first = net.point.len() as u32;
                rows[part].extend(first..first + members.len() as u32);
                net.point.extend(members);
            }
            net.levels.push(Refinement { rows: start..net.point.len(), weights });
        }
        net
    }

    /// A net of points in their own order that do not predict each other.
    pub fn unpredicted(points: usize) -> Self {
        let weights =
            Weights { each: SOURCES, sources: vec![NONE; points * SOURCES], values: vec![0.0; points * SOURCES] };
        Self { point: (0..points as u32).collect(), levels: vec![Refinement { rows: 0..points, weights }] }
    }

    /// An earlier row for each row that is likely to be similar; `u32::MAX` where there is none.
    pub fn similar(&self) -> Vec<u32> {
        self.levels.iter().flat_map(|l| l.weights.sources.chunks_exact(SOURCES).map(|sources| sources[0])).collect()
    }

    /// Quantises values `[row][column]` with a step for each column. Returns the integers and the reconstructed values.
    pub fn quantise(&self, values: &[f32], steps: &[f32]) -> (Vec<i16>, Vec<f32>) {
        let columns = steps.len().max(1);
        let mut integers = vec![0i16; values.len()];
        let mut known = Vec::with_capacity(values.len());
        for level in &self.levels {
            let cells = level.rows.start * columns..level.rows.end * columns;
            let (Some(own), Some(out)) = (values.get(cells.clone()), integers.get_mut(cells)) else { break };
            let mut result = level.predict(&known, columns);
            let rows = result.par_chunks_mut(columns).zip(own.par_chunks(columns)).zip(out.par_chunks_mut(columns));
            rows.for_each(|((known, own), out)| {
                for (((known, own), out), &step) in known.iter_mut().zip(own).zip(out).zip(steps) {
                    let wanted = (own - *known) / step;
                    let size = (wanted.abs() + ROUNDING).floor().min(f32::from(i16::MAX));
                    *out = size.copysign(wanted) as i16;
                    *known += f32::from(*out) * step;
                }
            });
            known.extend(result);
        }
        (integers, known)
    }

    /// Undoes [`Self::quantise`]; returns nothing unless the number of integers is rows times steps.
    pub fn dequantise(&self, integers: &[i16], steps: &[f32]) -> Vec<f32> {
        let columns = steps.len();
        if columns == 0 || self.point.len().checked_mul(columns) != Some(integers.len()) {
            return Vec::new();
        }
        let mut known = Vec::with_capacity(integers.len());
        for level in &self.levels {
            let own = &integers[level.rows.start * columns..level.rows.end * columns];
            let mut result = level.predict(&known, columns);
            result.par_chunks_mut(columns).zip(own.par_chunks(columns)).for_each(|(known, own)| {
                for ((known, own), &step) in known.iter_mut().zip(own).zip(steps) {
                    *known += f32::from(*own) * step;
                }
            });
            known.extend(result);
        }
        known
    }
}

impl Refinement {
    fn predict(&self, known: &[f32], columns: usize) -> Vec<f32> {
        let mut result = vec![0.0f32; self.rows.len() * columns];
        result.par_chunks_mut(columns).enumerate().for_each(|(row, out)| {
            for (source, weight) in self.weights.of(row) {
                let at = source as usize * columns;
                let Some(values) = known.get(at..at + columns) else { continue };
                out.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * value);
            }
        });
        result
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    fn points(count: usize) -> Vec<OrientedPoint> {
        let of_index = |i: usize| {
            let at = |d| crate::math::random::uniform(5, i as u64, d);
            let normal = if i < count / 2 { DVec3::Z } else { DVec3::NEG_Z };
            OrientedPoint { at_mm: DVec3::new(20.0 * at(0), 20.0 * at(1), 0.0), normal }
        };
        (0..count).map(of_index).collect()
    }

    #[test]
    fn a_reader_has_what_the_writer_predicted_from_and_errors_are_the_quantisers() {
        let points = points(3000);
        let parts = [0..1500, 1500..1500, 1500..3000];
        let net = Net::new(&points, &parts, 0.5);
        assert!(net.point.len() > 800 && net.levels.len() > 2);
        let similar = net.similar();
        assert!(similar.iter().enumerate().all(|(row, &s)| s == NONE || (s as usize) < row));
        let of_row = |&p: &u32| {
            let at = points[p as usize].at_mm;
            [(0.3 * at.x).sin() as f32, (0.2 * at.y).cos() as f32]
        };
        let values: Vec<f32> = net.point.iter().flat_map(of_row).collect();
        let steps = [0.01, 0.02];
        let (integers, known) = net.quantise(&values, &steps);
        assert_eq!(net.dequantise(&integers, &steps), known);
        for (index, (a, b)) in values.iter().zip(&known).enumerate() {
            assert!((a - b).abs() <= 0.6 * steps[index % 2], "{a} {b}");
        }
        // Smooth values leave hardly anything at the finest level.
        let finest = &integers[2 * net.levels.last().map_or(0, |l| l.rows.start)..];
        let zeros = finest.iter().filter(|z| **z == 0).count();
        assert!(zeros * 10 > finest.len() * 8, "{zeros} of {}", finest.len());
    }

    #[test]
    fn odd_sizes_have_answers() {
        let none = Net::new(&[], &[], 1.0);
        assert!(none.similar().is_empty() && none.quantise(&[], &[1.0]).0.is_empty());
        let net = Net::new(&points(40), &[0..20, 20..40], 1e9);
        assert_eq!(net.point.len(), 2);
        assert!(net.dequantise(&[1], &[1.0]).is_empty() && net.dequantise(&[1, 2], &[]).is_empty());
        assert_eq!(net.dequantise(&[1, 2], &[0.5]), vec![0.5, 1.0]);
    }
}
