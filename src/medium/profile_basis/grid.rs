//! Nodes in r, and interpolation between them; square roots and products only, hence the same bits everywhere.

use std::f64::consts::PI;

/// Intervals of equal area inside the split radius; an even number for Simpson's rule.
const INSIDE: usize = 8;

/// Binary logarithm of the intervals between the split radius and the reach. Half as many already leave the errors of
/// the presets unchanged to two digits.
const LOG2_OUTSIDE: u32 = 8;

/// Samples of the plain weighting and the radius up to which they go, in mm (Wang et al. 2008, section 3.1).
const PLAIN: (usize, f64) = (650, 65.0);

/// Number of points of a local interpolation.
const STENCIL: usize = 6;

/// `from (to / from)^(i / 2^log2)` for i = 0..=2^log2.
pub(super) fn geometric(from: f64, to: f64, log2: u32) -> Vec<f64> {
    let mut roots = vec![to / from];
    for digit in 0..log2 as usize {
        roots.push(roots[digit].sqrt());
    }
    // A factor for each binary digit: few roundings.
    let power = |i: usize| {
        let digits = (0..=log2).zip(&roots).filter(|(digit, _)| i >> (log2 - digit) & 1 == 1);
        digits.map(|(_, root)| root).product::<f64>()
    };
    let last = 1_usize << log2;
    (0..=last).map(|i| if i == last { to } else { from * power(i) }).collect()
}

/// `ln(ratio)` for ratios between 1 and 2.
fn logarithm(ratio: f64) -> f64 {
    let y = (ratio - 1.0) / (ratio + 1.0);
    let y2 = y * y;
    2.0 * y * (0..18).rev().fold(0.0, |sum, k| sum * y2 + 1.0 / f64::from(2 * k + 1))
}

/// Quadrature of `Int 2 pi r g(r) dr` over [0, reach].
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Grid {
    /// Squared radii in mm^2, ascending from 0, the split's among them.
    pub squares_mm2: Vec<f64>,
    /// Weights in mm^2.
    pub areas_mm2: Vec<f64>,
}

impl Grid {
    /// Nodes even in r^2 up to the split radius, where far profiles are quadratic in it, then even in
    /// `ln(r^2 + split^2)`; the reach is above the split.
    pub(super) fn new(split_mm: f64, reach_mm: f64) -> Self {
        let (rho2, reach2) = (split_mm * split_mm, reach_mm * reach_mm);
        let sums = geometric(2.0 * rho2, rho2 + reach2, LOG2_OUTSIDE);
        let last = sums.len() - 1;
        let step = logarithm(sums[1] / sums[0]);
        // Gregory's corrections make the trapezoidal rule exact to the fourth order.
        let correction = |i: usize| match i.min(last - i) {
            0 => 3.0 / 8.0,
            1 => 7.0 / 6.0,
            2 => 23.0 / 24.0,
            _ => 1.0,
        };
        let third = PI * rho2 / (3 * INSIDE) as f64;
        let simpson = |i: usize| if i == 0 { third } else { third * [2.0, 4.0][i % 2] };
        let mut squares_mm2: Vec<f64> = (0..INSIDE).map(|i| rho2 * i as f64 / INSIDE as f64).collect();
        let mut areas_mm2: Vec<f64> = (0..INSIDE).map(simpson).collect();
        for (i, sum) in sums.iter().enumerate() {
            let (square, shared) = match i {
                0 => (rho2, third),
                i if i == last => (reach2, 0.0),
                _ => (sum - rho2, 0.0),
            };
            squares_mm2.push(square);
            areas_mm2.push(PI * sum * step * correction(i) + shared);
        }
        Self { squares_mm2, areas_mm2 }
    }
}

/// The plain weighting's radii in mm: even over 65 mm, or over the reach where that is longer.
pub(super) fn plain_nodes(reach_mm: f64) -> Vec<f64> {
    let (samples, end_mm) = PLAIN;
    let step = end_mm.max(reach_mm) / (samples - 1) as f64;
    (0..samples).map(|i| i as f64 * step).collect()
}

/// Local polynomial interpolation in r^2 between nodes.
#[derive(Clone, Debug)]
pub(super) struct Interpolation {
    squares: Vec<f64>,
    /// The node at the split radius, which no stencil straddles: the third derivative has a jump there.
    corner: Option<usize>,
}

impl Interpolation {
    /// An interpolation between ascending squared nodes, at least two.
    pub(super) fn new(squares: Vec<f64>, split2: f64) -> Self {
        let near = |square: &f64| (square - split2).abs() <= 1e-12 * split2;
        let last = squares.len() - 1;
        let corner = squares.iter().position(near).filter(|&i| i >= 2 && i + 2 <= last);
        Self { squares, corner }
    }

    /// First node of the stencil at `square` and the weight of each of its nodes; trailing weights may be 0.
    fn weights(&self, square: f64) -> (usize, [f64; STENCIL]) {
        let above = self.squares.partition_point(|&node| node < square);
        let (first, end) = match self.corner {
            Some(corner) if above <= corner => (0, corner + 1),
            Some(corner) => (corner, self.squares.len()),
            None => (0, self.squares.len()),
        };
        let count = STENCIL.min(end - first);
        let start = above.saturating_sub(count / 2).clamp(first, end - count);
        let nodes = &self.squares[start..start + count];
        let mut weights = [0.0; STENCIL];
        for (i, (weight, node)) in weights.iter_mut().zip(nodes).enumerate() {
            let others = nodes.iter().enumerate().filter(|&(j, _)| j != i);
            *weight = others.map(|(_, other)| (square - other) / (node - other)).product();
        }
        (start, weights)
    }

    /// Values of all functions (function after function at the nodes) at one squared radius.
    pub(super) fn at(&self, functions: &[f32], square: f64) -> Vec<f64> {
        let (start, weights) = self.weights(square);
        let sum = |function: &[f32]| -> f64 {
            function[start..].iter().zip(&weights).map(|(&value, weight)| f64::from(value) * weight).sum()
        };
        functions.chunks_exact(self.squares.len()).map(sum).collect()
    }
}
