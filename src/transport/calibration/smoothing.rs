//! Values of walks without their noise: smoothed over the surface, over a length that two halves of the walks choose.

use std::collections::BTreeSet;

use glam::DVec3;

use super::lattice::Lattice;
use crate::geometry::laplacian::Laplacian;

/// Steps of the ladder of lengths, each twice as long as the one before, from a quarter of the mean edge.
const LENGTHS: usize = 9;

/// Residual of the smoothing, far below the noise; and of that which only tells how far off a length is.
const TOLERANCE: f64 = 1e-4;
const COARSE_TOLERANCE: f64 = 3e-3;

/// Lengths in a row at which a prediction is worse than at a shorter one, after which none is tried.
const WORSE: usize = 2;

/// The mean of two halves of noisy values of slots, smoothed: as they are, or over those of a guess, which varies over the surface
/// as they do. Which of the two, and the length, is for each channel what lets one half predict the other best.
pub(super) fn smoothed(lattice: &Lattice, halves: &[Vec<DVec3>; 2], guess: &[DVec3]) -> Vec<DVec3> {
    let laplacian = Laplacian::new(lattice.len(), lattice.triangles());
    let rows = |of: &[DVec3]| laplacian.at_nodes(of).iter().map(|v| v.to_array()).collect::<Vec<[f64; 3]>>();
    let [first, second] = halves.each_ref().map(|half| rows(half));
    let mean = paired(&first, &second, |a, b| 0.5 * (a + b));
    let guesses = [vec![[1.0; 3]; mean.len()], rows(guess)];
    let over = |of: &[[f64; 3]], guess: usize| paired(of, &guesses[guess], |t, k| if k > 0.0 { t / k } else { 1.0 });
    let pass = |of: &[[f64; 3]], (guess, step): Choice, tolerance: f64, from: &mut Option<Passes>| {
        let length = 0.25 * laplacian.mean_edge_mm * f64::from(1u32 << step);
        let smooth = low_passed(&laplacian, length * length, &over(of, guess), tolerance, from);
        paired(&smooth, &guesses[guess], |s, k| s * k)
    };
    let mut best: [(f64, Option<Choice>); 3] = [(f64::INFINITY, None); 3];
    for guess in 0..guesses.len() {
        let (mut least, mut worse, mut from) = ([f64::INFINITY; 3], 0, [None, None]);
        for step in 0..LENGTHS {
            if worse == WORSE {
                break;
            }
            let choice = (guess, step);
            let [a, b] = &mut from;
            let (from_a, from_b) = rayon::join(
                || pass(&first, choice, COARSE_TOLERANCE, a),
                || pass(&second, choice, COARSE_TOLERANCE, b),
            );
            let risk: [f64; 3] = std::array::from_fn(|c| {
                let terms = laplacian.mass_mm2.iter().enumerate().map(|(i, mass)| {
                    let (x, y) = (from_a[i][c] - second[i][c], from_b[i][c] - first[i][c]);
                    mass * (x * x + y * y)
                });
                terms.sum()
            });
            worse = if (0..3).any(|c| risk[c] < least[c]) { 0 } else { worse + 1 };
            for c in 0..3 {
                least[c] = least[c].min(risk[c]);
                if risk[c] < best[c].0 {
                    best[c] = (risk[c], Some(choice));
                }
            }
        }
    }
    let mut result = mean.clone();
    let chosen: BTreeSet<Choice> = best.iter().filter_map(|(_, choice)| *choice).collect();
    for choice in chosen {
        let smooth = pass(&mean, choice, TOLERANCE, &mut None);
        for c in (0..3).filter(|&c| best[c].1 == Some(choice)) {
            result.iter_mut().zip(&smooth).for_each(|(value, smooth)| value[c] = smooth[c]);
        }
    }
    let result: Vec<DVec3> = result.into_iter().map(DVec3::from_array).collect();
    laplacian.at_vertices(&result, DVec3::ONE)
}

/// A guess and a step of the ladder of lengths.
type Choice = (usize, usize);

/// A function of the channels of two lists.
fn paired(a: &[[f64; 3]], b: &[[f64; 3]], of: impl Fn(f64, f64) -> f64) -> Vec<[f64; 3]> {
    a.iter().zip(b).map(|(a, b)| [0, 1, 2].map(|c| of(a[c], b[c]))).collect()
}

/// Values after one step of a low pass, and after two.
type Passes = [Vec<[f64; 3]>; 2];

/// Two steps of half the time each: nearer to heat than one. They start `from` those of a shorter time, which they replace.
fn low_passed(
    laplacian: &Laplacian,
    t_mm2: f64,
    of: &[[f64; 3]],
    tolerance: f64,
    from: &mut Option<Passes>,
) -> Vec<[f64; 3]> {
    let [once, twice] = from.get_or_insert_with(|| [of.to_vec(), of.to_vec()]);
    laplacian.diffused(0.5 * t_mm2, of, once, tolerance);
    laplacian.diffused(0.5 * t_mm2, once, twice, tolerance);
    twice.clone()
}
