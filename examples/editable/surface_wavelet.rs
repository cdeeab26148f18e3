//! A wavelet of values at scattered points of a surface, without a parameterisation: the lifting scheme (Sweldens 1998) on nested
//! sets of points.
//!
//! The points of a level that the coarser levels lack are predicted from those by kriging; what is left is their detail. Then the coarser
//! points are updated by shares of the details, so that the integral over the surface stays what it was: dropped details change no
//! mean. The integral of the function that a point stands for follows from the areas of the points and the weights of the predictions;
//! of the updates that keep it, that with the least squares is taken (Schroeder and Sweldens 1995).

use translux::geometry::scattered::{Kriging, OrientedPoint, Weights, choose};

/// Levels of nested points.
#[derive(Clone, Debug, Default)]
pub(crate) struct SurfaceWavelet {
    count: usize,
    /// From the coarsest to the finest.
    levels: Vec<Level>,
    /// Of each point: the norm of the function that its coefficient stands for, about.
    norms: Vec<f64>,
}

/// Points that a level adds.
#[derive(Clone, Debug, Default)]
struct Level {
    points: Vec<u32>,
    each: usize,
    /// `[point][source]`: points of coarser levels.
    sources: Vec<u32>,
    predict: Vec<f64>,
    update: Vec<f64>,
}

impl Level {
    /// Point, sources, weights of the prediction and of the update.
    fn steps(&self) -> impl DoubleEndedIterator<Item = (usize, &[u32], &[f64], &[f64])> {
        self.points.iter().enumerate().map(|(i, &point)| {
            let of = i * self.each..(i + 1) * self.each;
            (point as usize, &self.sources[of.clone()], &self.predict[of.clone()], &self.update[of])
        })
    }
}

impl SurfaceWavelet {
    /// Of points with an area each; the finest but one level has points about `spacing_mm` apart, each coarser one twice as far.
    /// Points beyond the areas count nothing.
    pub(crate) fn new(points: &[OrientedPoint], areas: &[f64], spacing_mm: f64, fit: Kriging) -> Self {
        let mut members = choose(points, spacing_mm);
        let mut taken = vec![false; points.len()];
        members.concat().iter().for_each(|&i| taken[i as usize] = true);
        members.push((0..points.len() as u32).filter(|i| !taken[*i as usize]).collect());
        let (mut levels, mut coarser): (Vec<Level>, Vec<u32>) = (Vec::new(), Vec::new());
        let finest = members.len().saturating_sub(2) as i32;
        for (index, new) in members.into_iter().enumerate() {
            let spacing = spacing_mm * 2f64.powi((finest - index as i32 + 1).max(0));
            let of = |i: &u32| points[*i as usize];
            let sources: Vec<OrientedPoint> = coarser.iter().map(of).collect();
            let targets: Vec<OrientedPoint> = new.iter().map(of).collect();
            let weights = Weights::new(&sources, &targets, spacing, fit);
            levels.push(Level {
                each: weights.each,
                sources: weights.sources.iter().map(|&s| coarser[s as usize]).collect(),
                predict: weights.values.iter().map(|&w| f64::from(w)).collect(),
                update: vec![0.0; weights.values.len()],
                points: new.clone(),
            });
            coarser.extend(new);
        }
        let mut result = Self { count: points.len(), levels, norms: Vec::new() };
        result.balance(areas);
        result
    }

    /// Integrals from the finest level down, and the updates that keep them.
    fn balance(&mut self, areas: &[f64]) {
        let mut integrals: Vec<f64> = (0..self.count).map(|i| areas.get(i).copied().unwrap_or(0.0)).collect();
        self.norms = vec![0.0; self.count];
        for level in self.levels.iter_mut().rev() {
            let each = level.each;
            for (i, &point) in level.points.iter().enumerate() {
                let own = integrals[point as usize];
                // Weights below zero may leave no integral, but a function is no smaller than its point.
                let area = areas.get(point as usize).copied().unwrap_or(0.0);
                self.norms[point as usize] = own.max(area).max(0.0).sqrt();
                for k in i * each..(i + 1) * each {
                    integrals[level.sources[k] as usize] += level.predict[k] * own;
                }
            }
            // With the integrals of the coarser functions, all predictions added.
            for (i, &point) in level.points.iter().enumerate() {
                let of = i * each..(i + 1) * each;
                // A source that stands in for missing ones has no weight.
                let used = |k: usize| level.predict[k] != 0.0;
                let sum: f64 =
                    of.clone().filter(|k| used(*k)).map(|k| integrals[level.sources[k] as usize].powi(2)).sum();
                for k in of.filter(|k| used(*k)) {
                    let share = integrals[level.sources[k] as usize] / sum.max(f64::MIN_POSITIVE);
                    level.update[k] = integrals[point as usize] * share;
                }
            }
        }
    }

    /// Of each coefficient, about the root of the integral over the surface of the square of what it stands for: what makes
    /// coefficients comparable, mm.
    pub(crate) fn norms(&self) -> &[f64] {
        &self.norms
    }

    /// Coefficients in place of the values, a point's at its own place; other lengths are left alone.
    pub(crate) fn forward(&self, values: &mut [f64]) {
        if values.len() != self.count {
            return;
        }
        for level in self.levels.iter().rev() {
            for (point, sources, predict, _) in level.steps() {
                let predicted: f64 = sources.iter().zip(predict).map(|(&s, w)| w * values[s as usize]).sum();
                values[point] -= predicted;
            }
            for (point, sources, _, update) in level.steps() {
                let detail = values[point];
                sources.iter().zip(update).for_each(|(&s, u)| values[s as usize] += u * detail);
            }
        }
    }

    /// Undoes [`Self::forward`].
    pub(crate) fn inverse(&self, values: &mut [f64]) {
        if values.len() != self.count {
            return;
        }
        for level in &self.levels {
            for (point, sources, _, update) in level.steps().rev() {
                let detail = values[point];
                sources.iter().zip(update).for_each(|(&s, u)| values[s as usize] -= u * detail);
            }
            for (point, sources, predict, _) in level.steps() {
                let predicted: f64 = sources.iter().zip(predict).map(|(&s, w)| w * values[s as usize]).sum();
                values[point] += predicted;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use translux::math::random::uniform;

    /// Points of a ball of radius 10 mm, with areas that differ.
    fn ball(count: usize) -> (Vec<OrientedPoint>, Vec<f64>) {
        let number = |i: usize, d| uniform(3, i as u64, d);
        let of_index = |i: usize| {
            let (z, turn) = (2.0 * number(i, 0) - 1.0, std::f64::consts::TAU * number(i, 1));
            let normal = DVec3::new((1.0 - z * z).sqrt() * turn.cos(), (1.0 - z * z).sqrt() * turn.sin(), z);
            OrientedPoint { at_mm: 10.0 * normal, normal }
        };
        ((0..count).map(of_index).collect(), (0..count).map(|i| 0.2 + number(i, 2)).collect())
    }

    fn smooth(points: &[OrientedPoint]) -> Vec<f64> {
        points.iter().map(|p| (0.3 * p.at_mm.x).sin() + 0.02 * p.at_mm.z * p.at_mm.y).collect()
    }

    fn wavelet(count: usize) -> (SurfaceWavelet, Vec<OrientedPoint>, Vec<f64>) {
        let (points, areas) = ball(count);
        (SurfaceWavelet::new(&points, &areas, 0.8, Kriging::RADIOSITY), points, areas)
    }

    #[test]
    fn values_come_back() {
        for count in [0, 1, 2, 9, 700] {
            let (wavelet, points, _) = wavelet(count);
            let before: Vec<f64> = (0..count).map(|i| uniform(5, i as u64, 0)).collect();
            let mut values = before.clone();
            wavelet.forward(&mut values);
            wavelet.inverse(&mut values);
            assert!(values.iter().zip(&before).all(|(a, b)| (a - b).abs() < 1e-10), "{count}");
            assert_eq!(wavelet.count, points.len());
        }
        let mut short = [1.0, 2.0];
        wavelet(9).0.forward(&mut short);
        assert_eq!(short, [1.0, 2.0]);
    }

    #[test]
    fn constants_have_no_details_and_smooth_values_small_ones() {
        let (wavelet, points, _) = wavelet(2000);
        let first = wavelet.levels[0].points.clone();
        let mut ones = vec![1.0; 2000];
        wavelet.forward(&mut ones);
        let details = |values: &[f64]| -> Vec<f64> {
            let is_detail = |i: &usize| !first.contains(&(*i as u32));
            (0..2000).filter(is_detail).map(|i| values[i].abs()).collect()
        };
        assert!(details(&ones).iter().all(|d| *d < 1e-5));
        let mut values = smooth(&points);
        let before: f64 = values.iter().map(|v| v.abs()).sum();
        wavelet.forward(&mut values);
        assert!(details(&values).iter().sum::<f64>() < 0.05 * before);
    }

    /// Whatever is dropped of the details, the integral over the surface stays.
    #[test]
    fn dropped_details_change_no_integral() {
        let (wavelet, points, areas) = wavelet(2000);
        let integral = |values: &[f64]| areas.iter().zip(values).map(|(a, v)| a * v).sum::<f64>();
        let before: Vec<f64> = smooth(&points).iter().zip(0..).map(|(v, i)| v + uniform(9, i, 0)).collect();
        let mut values = before.clone();
        wavelet.forward(&mut values);
        let first = &wavelet.levels[0].points;
        (0..2000).filter(|i| !first.contains(&(*i as u32))).for_each(|i| values[i] = 0.0);
        wavelet.inverse(&mut values);
        let (a, b) = (integral(&values), integral(&before));
        assert!((a / b - 1.0).abs() < 1e-6, "{a} {b}");
        // Which is no identity.
        assert!(values.iter().zip(&before).any(|(a, b)| (a - b).abs() > 0.1));
    }

    /// Norms order what is dropped: the squared error of dropped coefficients is about the sum of their weighted squares.
    #[test]
    fn norms_are_those_of_the_functions_within_a_factor() {
        let (wavelet, _, areas) = wavelet(1500);
        for point in [7, 300, 901, 1400] {
            let mut values = vec![0.0; 1500];
            values[point] = 1.0;
            wavelet.inverse(&mut values);
            let norm = areas.iter().zip(&values).map(|(a, v)| a * v * v).sum::<f64>().sqrt();
            let ratio = norm / wavelet.norms()[point];
            assert!((0.3..3.0).contains(&ratio), "{point}: {ratio}");
        }
    }
}
