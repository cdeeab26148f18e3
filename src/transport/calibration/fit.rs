//! Layers from moments: least squares weighted by the inverse of the dipole, which is what the noise of walks asks for,
//! with a prior of smoothness where walks say little.

use super::layers::{Layers, SUPPORT, Splines};
use super::pairs::Moments;
use crate::math::cholesky::Cholesky;

/// Standard deviation of the step from one coefficient to the next, of a and of b.
const STEP: [f64; 2] = [0.5, 0.5];

/// Standard deviation of a around 1, and of b around 0.
const PRIOR: [f64; 2] = [10.0, 3.0];

/// Relative variance of the moments, which are sums over random pairs.
const MOMENT_NOISE: f64 = 0.05;

/// The layers whose sums over pairs, `Sum R_d (a + b h) B_k h^m`, are those of the walks, `pairs[k][m]` in mm^2, as well as can be; the light of
/// one photon is `photon_mm2`. The dipole itself where that has no solution.
pub(super) fn layers(splines: Splines, moments: &Moments, pairs: &[[f64; 2]], photon_mm2: f64) -> Layers {
    let n = splines.len();
    let size = 2 * n;
    let mut matrix = vec![0.0; size * size];
    let mut right = vec![0.0; size];
    for (k, entry) in moments.iter().enumerate() {
        for (j, powers) in entry.iter().enumerate().take(SUPPORT.min(n - k)) {
            for (left, m) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                let value = powers[left + m];
                matrix[(left * n + k) * size + m * n + k + j] = value;
                matrix[(m * n + k + j) * size + left * n + k] = value;
            }
        }
    }
    for (k, [even, odd]) in pairs.iter().enumerate().take(n) {
        (right[k], right[n + k]) = (*even, *odd);
    }
    for (layer, step) in STEP.iter().enumerate() {
        let on_diagonal: Vec<f64> = moments.iter().map(|entry| entry[0][2 * layer]).collect();
        for k in 1..n {
            let (i, j) = (layer * n + k - 1, layer * n + k);
            // Within a mean free path heights have faded, and b would grow without bound to undo that.
            let free = if layer == 1 && splines.centre_mm(k) < splines.fade_mm() { 0.1 } else { 1.0 };
            let stiffness =
                (photon_mm2 + MOMENT_NOISE * 0.5 * (on_diagonal[k - 1] + on_diagonal[k])) / (free * step).powi(2);
            matrix[i * size + i] += stiffness;
            matrix[j * size + j] += stiffness;
            matrix[i * size + j] -= stiffness;
            matrix[j * size + i] -= stiffness;
        }
        // A dipole is the guess where there is nothing else.
        for k in 0..n {
            let i = layer * n + k;
            let weight = photon_mm2 / PRIOR[layer].powi(2);
            matrix[i * size + i] += weight;
            right[i] += if layer == 0 { weight } else { 0.0 };
        }
    }
    let factors = Cholesky::new(matrix, size);
    let solved = factors.map(|factors| {
        factors.solve(&mut right);
        right
    });
    let (single, double) = match solved {
        Some(x) if x.iter().all(|v| v.is_finite()) => (x[..n].to_vec(), x[n..].to_vec()),
        _ => (vec![1.0; n], vec![0.0; n]),
    };
    Layers { splines, single, double }
}
