//! Training materials of a basis, and other materials that judge it.

use super::grid::geometric;
use crate::math::random;
use crate::medium::dipole::Dipole;
use crate::medium::fresnel::{BoundaryFit, boundary_a};
use crate::medium::material::preset_dipoles;

/// Reduced scattering coefficients in 1/mm: from skim milk thinned thirty times to beyond Spectralon.
const SCATTERING_PER_MM: (f64, f64) = (0.02, 25.0);

/// Absorption coefficients in 1/mm beside 0.
const ABSORPTION_PER_MM: (f64, f64) = (1e-4, 2.0);

/// Refractive indices.
const ETAS: [f64; 4] = [1.0, 1.25, 1.5, 2.0];

/// Binary logarithms of the intervals of the two coefficients. Twice as many change no number of terms.
const LOG2_STEPS: (u32, u32) = (5, 4);

/// Coefficients of the plain weighting in 1/mm (Wang et al. 2008, section 4) and its samples of each.
const PLAIN_PER_MM: (f64, f64) = (1e-6, 5.0);
const PLAIN_STEPS: usize = 32;

/// Number of random materials that judge a basis, and their stream of random numbers.
const JUDGES: u64 = 200;
const JUDGES_STAGE: u64 = 0x6a75_6467;

/// One in this many random materials does not absorb.
const PURE: u64 = 16;

/// Dipoles with coefficients even in their logarithms, and without absorption.
pub(super) fn training() -> Vec<Dipole> {
    let scattering = geometric(SCATTERING_PER_MM.0, SCATTERING_PER_MM.1, LOG2_STEPS.0);
    let mut absorption = geometric(ABSORPTION_PER_MM.0, ABSORPTION_PER_MM.1, LOG2_STEPS.1);
    absorption.push(0.0);
    grid_of(&scattering, &absorption)
}

/// Dipoles with coefficients on an even grid, for the plain weighting.
pub(super) fn plain_training() -> Vec<Dipole> {
    let (from, to) = PLAIN_PER_MM;
    let values: Vec<f64> = (0..PLAIN_STEPS).map(|i| from + (to - from) * i as f64 / (PLAIN_STEPS - 1) as f64).collect();
    grid_of(&values, &values)
}

fn grid_of(scattering: &[f64], absorption: &[f64]) -> Vec<Dipole> {
    let mut dipoles = Vec::with_capacity(ETAS.len() * scattering.len() * absorption.len());
    for a in ETAS.map(|eta| boundary_a(eta, BoundaryFit::Published)) {
        for &s in scattering {
            dipoles.extend(absorption.iter().map(|&t| Dipole::new(s, t, a)));
        }
    }
    dipoles
}

/// Every channel of the measured materials, and random materials of the same ranges as [`training`], none of them part
/// of it.
pub(super) fn judges() -> Vec<Dipole> {
    let log2 = 12;
    let scattering = geometric(SCATTERING_PER_MM.0, SCATTERING_PER_MM.1, log2);
    let absorption = geometric(ABSORPTION_PER_MM.0, ABSORPTION_PER_MM.1, log2);
    let drawn = (0..JUDGES).map(|i| {
        // Odd places of a finer grid.
        let pick =
            |values: &[f64], dimension| values[2 * (random::bits(JUDGES_STAGE, i, dimension) >> 53) as usize + 1];
        let eta = 1.0 + random::uniform(JUDGES_STAGE, i, 2);
        let t = if i % PURE == 0 { 0.0 } else { pick(&absorption, 1) };
        Dipole::new(pick(&scattering, 0), t, boundary_a(eta, BoundaryFit::Published))
    });
    preset_dipoles().chain(drawn).collect()
}
