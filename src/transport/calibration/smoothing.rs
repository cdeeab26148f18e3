//! Values of walks without their noise: smoothed over the surface, over a length that two halves of the walks choose.

use glam::DVec3;

use crate::geometry::laplacian::Laplacian;
use crate::transport::domain::Domain;
use crate::transport::random_walk::tally::Hats;

/// Steps of the ladder of lengths, each twice as long as the one before, from a quarter of the mean edge.
const LENGTHS: usize = 9;

/// Residual of the smoothing.
const TOLERANCE: f64 = 1e-6;

/// The mean of two halves of noisy values of slots, smoothed: the length of each channel is the one with which a half
/// predicts the other best.
pub(super) fn smoothed(domain: Domain, hats: &Hats, halves: &[Vec<DVec3>; 2]) -> Vec<DVec3> {
    let triangles = hats.corners.iter().enumerate().map(|(t, c)| (*c, domain.mesh.corners_local_mm(t as u32)));
    let laplacian = Laplacian::new(hats.mass_mm2.len(), triangles);
    let nodes = halves.each_ref().map(|half| {
        laplacian.at_nodes(half).iter().map(|v| v.to_array()).collect::<Vec<[f64; 3]>>()
    });
    let mean: Vec<[f64; 3]> =
        nodes[0].iter().zip(&nodes[1]).map(|(a, b)| [0, 1, 2].map(|c| 0.5 * (a[c] + b[c]))).collect();
    let mut best = [f64::INFINITY; 3];
    let mut result = mean.clone();
    for step in 0..LENGTHS {
        let length = 0.25 * laplacian.mean_edge_mm * f64::from(1u32 << step);
        let pass = |of: &[[f64; 3]]| low_passed(&laplacian, length * length, of);
        let smooth = [pass(&nodes[0]), pass(&nodes[1])];
        let risk = [0, 1, 2].map(|c| {
            let terms = laplacian.mass_mm2.iter().enumerate().map(|(i, mass)| {
                let (a, b) = (smooth[0][i][c] - nodes[1][i][c], smooth[1][i][c] - nodes[0][i][c]);
                mass * (a * a + b * b)
            });
            terms.sum::<f64>()
        });
        let mut both = None;
        for c in 0..3 {
            if risk[c] < best[c] {
                best[c] = risk[c];
                let both = both.get_or_insert_with(|| pass(&mean));
                result.iter_mut().zip(both.iter()).for_each(|(value, smooth)| value[c] = smooth[c]);
            }
        }
        if (0..3).all(|c| risk[c] > 1.5 * best[c]) {
            break;
        }
    }
    let result: Vec<DVec3> = result.into_iter().map(DVec3::from_array).collect();
    laplacian.at_vertices(&result, DVec3::ONE)
}

/// Two steps of half the time each: nearer to heat than one.
fn low_passed(laplacian: &Laplacian, t_mm2: f64, of: &[[f64; 3]]) -> Vec<[f64; 3]> {
    let mut values = of.to_vec();
    for _ in 0..2 {
        let source = values.clone();
        laplacian.diffused(0.5 * t_mm2, &source, &mut values, TOLERANCE);
    }
    values
}
