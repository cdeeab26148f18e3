//! The Gaussian ladder: non-negative functions of which every dipole is a sum with non-negative coefficients.
//!
//! R_d is a sum of Gaussians with positive weights, of all widths: `exp(-sigma d) / d` with `d^2 = r^2 + z^2` is one,
//! and so are its derivatives in r^2. The basis has to hold the far part of R_d, which ends in a parabola in r^2 inside
//! the split radius ([`FarProfile`]). No sum of Gaussians has that shape, and non-negative ones come no nearer than T1
//! = 1.3e-2, however many. But taking the far part is linear, and the far part of a Gaussian is positive too: so the
//! functions are the far parts of Gaussians, and the far part of R_d is a sum of them with the same weights as R_d of
//! the Gaussians. The near field does not change.
//!
//! The standard deviations are `split / 4 q^k`, k = 1, 2, ..., up to 0.8 times the reach; the last function is a
//! constant, their limit, for materials that are clearer than the object is wide. Each function has the total 1 over
//! the reach. Coefficients minimise the same weighted square as those of the principal components, none of them is
//! negative, and their sum is the total of the far part over the reach.
//!
//! T1 of all judges: 3.9e-3 with 11 terms for a split of 0.5 mm and a reach of 20, 3.7e-3 with 13 for 50, 1.6e-3 with
//! 13 for 0.64 and 30.

use super::grid::Grid;
use crate::math::nnls::non_negative_least_squares;
use crate::medium::dipole::decay;
use crate::medium::far_profile::FarProfile;

/// Standard deviation before the first one, over the split radius, and that of the widest Gaussian, over the reach.
const NARROWEST: f64 = 0.25;
const WIDEST: f64 = 0.8;

/// Weight of the equation for the sum of the coefficients relative to the others, before the sum is made exact.
const ENERGY_WEIGHT: f64 = 1e3;

/// Halvings that take a root to the last bit.
const HALVINGS: usize = 120;

/// Standard deviations in mm, ascending; one less than there are terms.
pub(super) fn deviations_mm(split_mm: f64, reach_mm: f64, terms: usize) -> Vec<f64> {
    let steps = terms - 1;
    let ratio = root(WIDEST * reach_mm / (NARROWEST * split_mm), steps);
    let mut deviation = NARROWEST * split_mm;
    let next = |_| {
        deviation *= ratio;
        deviation
    };
    (0..steps).map(next).collect()
}

/// The `degree`-th root of a number of at least 1; products only, so that every processor gives the same bits.
fn root(number: f64, degree: usize) -> f64 {
    let power = |x: f64| (0..degree).fold(1.0, |product, _| product * x);
    let (mut low, mut high) = (1.0, number);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if power(middle) < number { low = middle } else { high = middle }
    }
    high
}

/// The functions at the places of a grid, function after function, 1/mm^2.
pub(super) fn functions(split_mm: f64, reach_mm: f64, terms: usize, grid: &Grid) -> Vec<f32> {
    let rho2 = split_mm * split_mm;
    let rates = deviations_mm(split_mm, reach_mm, terms).into_iter().map(|deviation| 0.5 / (deviation * deviation));
    let of_rate = |rate: f64| {
        // Relative to its value at the split radius.
        let value = |square: &f64| {
            let x = rate * (square - rho2);
            if x < 0.0 { 1.0 - x * (1.0 - 0.5 * x) } else { decay(x) }
        };
        let values: Vec<f64> = grid.squares_mm2.iter().map(value).collect();
        let total: f64 = values.iter().zip(&grid.areas_mm2).map(|(value, area)| value * area).sum();
        values.into_iter().map(move |value| (value / total) as f32).collect::<Vec<f32>>()
    };
    rates.chain([0.0]).flat_map(of_rate).collect()
}

/// Non-negative least squares in the weighted functions with a given total: the way from a profile to coefficients.
#[derive(Clone, Debug)]
pub(super) struct NonNegative {
    /// Total of each function over the reach, without unit.
    totals: Vec<f64>,
    /// Orthonormal basis of the space of the weighted functions at the nodes: `[direction][node]`.
    directions: Vec<Vec<f64>>,
    /// Weighted total of each function, and the function in this orthonormal basis: `[k][row]`.
    columns: Vec<Vec<f64>>,
}

impl NonNegative {
    /// Prepares functions with these values (function after function) at nodes with these weights; everything finite.
    pub(super) fn new(functions: &[f32], weights: &[f64], totals: Vec<f64>) -> Self {
        let mut directions: Vec<Vec<f64>> = Vec::new();
        let mut columns = Vec::new();
        for (function, total) in functions.chunks_exact(weights.len()).zip(&totals) {
            let weighted = function.iter().zip(weights).map(|(&value, weight)| f64::from(value) * weight.sqrt());
            let mut rest: Vec<f64> = weighted.collect();
            let mut column = vec![0.0; 1 + directions.len()];
            column[0] = ENERGY_WEIGHT * total;
            // Twice: what the first pass leaves is not orthogonal to the last bit.
            for _ in 0..2 {
                for (direction, amount) in directions.iter().zip(&mut column[1..]) {
                    let product = dot(direction, &rest);
                    *amount += product;
                    rest.iter_mut().zip(direction).for_each(|(rest, x)| *rest -= product * x);
                }
            }
            let length = dot(&rest, &rest).sqrt();
            if length > 0.0 {
                rest.iter_mut().for_each(|x| *x /= length);
            }
            column.push(length);
            directions.push(rest);
            columns.push(column);
        }
        let rows = columns.len() + 1;
        columns.iter_mut().for_each(|column| column.resize(rows, 0.0));
        Self { totals, directions, columns }
    }

    /// Total of each function over the reach, without unit.
    pub(super) fn totals(&self) -> &[f64] {
        &self.totals
    }

    /// Coefficients of a far part, none negative; their total is the far part's within the reach.
    pub(super) fn coefficients(&self, far: &FarProfile, nodes_mm: &[f64], weights: &[f64], reach_mm: f64) -> Vec<f64> {
        let weighted = nodes_mm.iter().zip(weights);
        let weighted: Vec<f64> =
            weighted.map(|(node, weight)| weight.sqrt() * far.reflectance_at_square(node * node)).collect();
        let energy = far.total_within(reach_mm);
        let target: Vec<f64> = std::iter::once(ENERGY_WEIGHT * energy)
            .chain(self.directions.iter().map(|direction| dot(direction, &weighted)))
            .collect();
        let mut found = non_negative_least_squares(&self.columns, &target);
        let sum = dot(&found, &self.totals);
        if sum > 0.0 {
            found.iter_mut().for_each(|s| *s *= energy / sum);
        }
        found
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}
