//! Separable approximations of a tabulated phase function by singular value decomposition (Kautz and McCool 1999).

use glam::DVec3;
use rayon::prelude::*;
use translux::error::{Error, Result};
use translux::math::cube_map::{FACES, direction, solid_angles_sr};
use translux::math::eigen::symmetric_eigen;
use translux::math::sh::real_sh;
use translux::medium::phase::{DirectionMaps, HenyeyGreenstein, SIDE};

/// Directions on either side: 6 x 16 x 16, as in the paper.
const TEXELS: usize = FACES * SIDE * SIDE;

/// Largest number of terms.
const MOST: usize = 25;

/// Bands of harmonics beyond those of the terms that the iteration starts with.
const EXTRA_BANDS: usize = 2;

/// Steps of subspace iteration. The harmonics are nearly the singular vectors already.
const STEPS: usize = 6;

/// `p(w_i', w_o') ~ Sum_k g_k(w_i') h_k(w_o')`: light maps and view maps on a cube map.
///
/// The table is weighted with the square roots of the solid angles, without which the energy of the result is wrong by
/// up to a factor of 2 at g = 0.9. It is symmetric, so its singular vectors are eigenvectors: a subspace iteration that
/// starts with spherical harmonics finds them in a fraction of a second. Measured (tests): energy from any direction
/// within 1e-3 of 1 for |g| <= 0.4, 2e-3 at 0.7 and 5 % at 0.9, where the table itself is too coarse; K = 4 negative
/// for |g| > 1/3; K = 8 splits a band and makes the forward value depend on direction. `LegendrePhase` has the same
/// terms exactly and keeps g free.
pub(crate) struct SeparablePhase {
    /// `g_k` towards the light.
    pub(crate) light: DirectionMaps,
    /// `h_k` towards the eye.
    pub(crate) view: DirectionMaps,
}

impl SeparablePhase {
    /// The decomposition of Henyey and Greenstein's function with 1 to 25 terms.
    ///
    /// # Errors
    /// Another number of terms (exit 3).
    pub(crate) fn new(phase: HenyeyGreenstein, terms: usize) -> Result<Self> {
        if !(1..=MOST).contains(&terms) {
            return Err(Error::input(format!("{terms} terms of a phase function: 1 to {MOST} are possible")));
        }
        let face = solid_angles_sr(SIDE);
        let roots: Vec<f64> = (0..TEXELS).map(|i| face[i % face.len()].sqrt()).collect();
        let directions: Vec<DVec3> =
            (0..TEXELS).map(|i| direction(SIDE, i / SIDE / SIDE, i % SIDE, i / SIDE % SIDE)).collect();
        let entry = |i: usize, j: usize| roots[i] * roots[j] * phase.density(-directions[i].dot(directions[j]));
        let matrix: Vec<f64> = (0..TEXELS * TEXELS).into_par_iter().map(|at| entry(at / TEXELS, at % TEXELS)).collect();
        let (values, vectors) = dominant(&matrix, &directions, &roots, terms)?;
        let (mut light, mut view) = (vec![0.0; TEXELS * terms], vec![0.0; TEXELS * terms]);
        for (k, (value, vector)) in values.iter().zip(&vectors).enumerate() {
            let scale = value.abs().sqrt();
            for (texel, x) in vector.iter().enumerate() {
                let map = scale * x / roots[texel];
                light[texel * terms + k] = map;
                view[texel * terms + k] = map.copysign(map * value);
            }
        }
        Ok(Self { light: DirectionMaps::new(terms, light), view: DirectionMaps::new(terms, view) })
    }
}

/// Eigenvalues of largest magnitude and their vectors, in descending order of magnitude.
fn dominant(matrix: &[f64], directions: &[DVec3], roots: &[f64], terms: usize) -> Result<(Vec<f64>, Vec<Vec<f64>>)> {
    let bands = (terms - 1).isqrt() + 1 + EXTRA_BANDS;
    let width = bands * bands;
    // `[texel][column]`.
    let mut block = vec![0.0; TEXELS * width];
    for ((row, direction), root) in block.chunks_exact_mut(width).zip(directions).zip(roots) {
        real_sh(bands, *direction, row);
        row.iter_mut().for_each(|x| *x *= root);
    }
    orthonormalise(&mut block, width);
    let mut image = multiply(matrix, &block, width);
    for _ in 0..STEPS {
        block = image;
        orthonormalise(&mut block, width);
        image = multiply(matrix, &block, width);
    }
    let mut small = vec![0.0; width * width];
    for (row, image) in block.chunks_exact(width).zip(image.chunks_exact(width)) {
        for (i, x) in row.iter().enumerate() {
            small[i * width..][..width].iter_mut().zip(image).for_each(|(sum, y)| *sum += x * y);
        }
    }
    let eigen = symmetric_eigen(&small, width)?;
    let mut order: Vec<usize> = (0..width).collect();
    order.sort_by(|&i, &j| eigen.values[j].abs().total_cmp(&eigen.values[i].abs()).then(i.cmp(&j)));
    let vector = |&k: &usize| -> Vec<f64> {
        let weights = &eigen.vectors[k];
        block.chunks_exact(width).map(|row| row.iter().zip(weights).map(|(x, w)| x * w).sum()).collect()
    };
    order.truncate(terms);
    Ok((order.iter().map(|&k| eigen.values[k]).collect(), order.iter().map(vector).collect()))
}

/// The matrix times the columns of `[texel][column]`.
fn multiply(matrix: &[f64], block: &[f64], width: usize) -> Vec<f64> {
    let mut result = vec![0.0; TEXELS * width];
    result.par_chunks_exact_mut(width).zip(matrix.par_chunks_exact(TEXELS)).for_each(|(out, row)| {
        for (m, column) in row.iter().zip(block.chunks_exact(width)) {
            out.iter_mut().zip(column).for_each(|(sum, x)| *sum += m * x);
        }
    });
    result
}

/// Gram-Schmidt, twice, of the columns of `[texel][column]`; a column that vanishes stays zero.
fn orthonormalise(block: &mut [f64], width: usize) {
    for k in 0..width {
        for _ in 0..2 {
            let mut along = vec![0.0; k];
            for row in block.chunks_exact(width) {
                along.iter_mut().zip(row).for_each(|(sum, x)| *sum += x * row[k]);
            }
            for row in block.chunks_exact_mut(width) {
                let shift: f64 = along.iter().zip(&row[..k]).map(|(a, x)| a * x).sum();
                row[k] -= shift;
            }
        }
        let length = block.chunks_exact(width).map(|row| row[k] * row[k]).sum::<f64>().sqrt();
        let scale = if length > 0.0 { 1.0 / length } else { 0.0 };
        block.chunks_exact_mut(width).for_each(|row| row[k] *= scale);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::f64::consts::PI;

    use translux::medium::phase::LegendrePhase;

    use super::*;

    /// `Sum_k g_k(w_i') h_k(w_o')`, 1/sr.
    fn product(phase: &SeparablePhase, towards_light: DVec3, towards_eye: DVec3) -> f64 {
        let (mut light, mut view) = ([0.0; MOST], [0.0; MOST]);
        phase.light.evaluate(towards_light, &mut light);
        phase.view.evaluate(towards_eye, &mut view);
        light.iter().zip(&view).map(|(g, h)| g * h).sum()
    }

    fn texels() -> impl Iterator<Item = (DVec3, f64)> {
        let face = solid_angles_sr(SIDE);
        (0..TEXELS).map(move |i| (direction(SIDE, i / SIDE / SIDE, i % SIDE, i / SIDE % SIDE), face[i % face.len()]))
    }

    /// Relative L2 error on the table, largest error of the energy, least value over the peak, spread of the forward
    /// value.
    fn figures(g: f64, terms: usize) -> [f64; 4] {
        let (truth, phase) = (HenyeyGreenstein::new(g), SeparablePhase::new(HenyeyGreenstein::new(g), terms).unwrap());
        let (mut error, mut norm, mut energy_error, mut least) = (0.0, 0.0, 0.0f64, 0.0f64);
        let mut light = vec![0.0; terms];
        let mut forward = Vec::new();
        for (a, _) in texels().step_by(13) {
            phase.light.evaluate(a, &mut light);
            let mut energy = 0.0;
            for ((b, angle), h) in texels().zip(phase.view.values().chunks_exact(terms)) {
                let p: f64 = light.iter().zip(h).map(|(g, h)| g * h).sum();
                let exact = truth.density(-a.dot(b));
                error += angle * (p - exact) * (p - exact);
                norm += angle * exact * exact;
                energy += angle * p;
                least = least.min(p);
            }
            energy_error = energy_error.max((energy - 1.0).abs());
            forward.push(product(&phase, a, -a));
        }
        let mean = forward.iter().sum::<f64>() / forward.len() as f64;
        let most = forward.iter().fold(f64::MIN, |m, &v| m.max(v)) - forward.iter().fold(f64::MAX, |m, &v| m.min(v));
        [(error / norm).sqrt(), energy_error, least / truth.density(g.signum()), most / mean]
    }

    #[test]
    fn error_energy_sign_and_spread_are_those_of_the_legendre_series() {
        // g, K, largest L2 error, of energy, lowest value, spread.
        let cases = [
            (0.25, 4, 0.14, 1e-3, -1e-9, 0.03),
            (-0.4, 4, 0.33, 1e-3, -0.06, 0.04),
            (0.4, 9, 0.16, 1e-3, -1e-3, 0.05),
            (0.4, 16, 0.08, 1e-3, -2e-3, 0.06),
            (0.7, 4, 0.78, 2e-3, -0.065, 0.05),
            (-0.9, 9, 0.97, 0.07, -0.02, 0.3),
        ];
        for (g, terms, l2, energy, least, spread) in cases {
            let found = figures(g, terms);
            println!("g {g} K {terms}: L2, energy, least, spread {found:.4?}");
            assert!(found[0] < l2 && found[0] > 0.5 * l2, "{g} {terms} {found:?}");
            assert!(found[1] < energy && found[2] > least && found[3] < spread, "{g} {terms} {found:?}");
        }
        let split = figures(0.4, 8);
        println!("g 0.4 K 8: {split:.4?}");
        assert!(split[3] > 0.2, "K = 8 splits a band: {split:?}");
    }

    #[test]
    fn whole_bands_agree_with_the_analytic_form_between_texels() {
        let phase = SeparablePhase::new(HenyeyGreenstein::new(0.4), 9).unwrap();
        let series = LegendrePhase::henyey_greenstein(0.4, 9);
        for (i, (a, _)) in texels().enumerate().step_by(97) {
            let b = (texels().nth((i * 7 + 5) % TEXELS).unwrap().0 + 0.02 * DVec3::ONE).normalize();
            let difference = product(&phase, a, b) - series.product(a, b);
            assert!(difference.abs() < 0.02 / (4.0 * PI) * 4.0, "{difference}");
        }
    }

    #[test]
    fn numbers_of_terms_are_checked_and_look_ups_never_panic() {
        assert!(SeparablePhase::new(HenyeyGreenstein::new(0.4), 0).is_err());
        assert!(SeparablePhase::new(HenyeyGreenstein::new(0.4), 26).is_err());
        let phase = SeparablePhase::new(HenyeyGreenstein::new(0.9), 1).unwrap();
        for d in [DVec3::ZERO, DVec3::NAN, DVec3::ONE, DVec3::INFINITY, DVec3::NEG_Y] {
            assert!(product(&phase, d, d).is_finite());
        }
    }
}
