//! Vertices predicted from reference points (Hao and Varshney 2004, section 4.2): every vertex is a weighted sum of
//! three references, and what is left is a small residual.
//!
//! Values are one row for each vertex, `dimension` numbers long (all lights, and all channels, which share the
//! weights). Weights are barycentric, as in the paper, or fitted to the values by least squares, the paper's future
//! work.

use rayon::prelude::*;

use crate::hao::simplify::{Anchor, Level};

/// Three weights that add up to 1, in 4 bytes: the first two as fixed point, the third follows.
///
/// A step is 2^-15 and the range is [-1/2, 3/2), so that 0, 1 and every sum are exact in single precision.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Weights {
    stored: [u16; 2],
}

/// Steps of a weight of 1.
const ONE: i32 = 1 << 15;
/// Steps below zero that can be stored.
const BELOW: i32 = 1 << 14;

impl Weights {
    /// To the nearest steps. The weights should add up to 1; a value outside the range is cut off, NaN is 0.
    pub(crate) fn quantise(weights: [f64; 3]) -> Self {
        // The cast saturates and takes NaN to 0.
        let steps = |w: f64| (w * f64::from(ONE)).round() as i32;
        let store = |s: i32| s.clamp(-BELOW, i32::from(u16::MAX) - BELOW) + BELOW;
        let [mut a, mut b] = [steps(weights[0]), steps(weights[1])];
        // Two roundings upwards would leave the third weight negative.
        if weights[2] >= 0.0 && ONE.saturating_sub(a).saturating_sub(b) < 0 {
            if a >= b {
                a = ONE.saturating_sub(b);
            } else {
                b = ONE.saturating_sub(a);
            }
        }
        Self { stored: [store(a) as u16, store(b) as u16] }
    }

    /// From what was stored; any two numbers are weights.
    pub(crate) fn from_stored(stored: [u16; 2]) -> Self {
        Self { stored }
    }

    /// The numbers to store.
    pub(crate) fn stored(self) -> [u16; 2] {
        self.stored
    }

    /// The weights; they add up to exactly 1.
    pub(crate) fn values(self) -> [f32; 3] {
        let [a, b] = self.stored.map(|s| i32::from(s) - BELOW);
        [a, b, ONE - a - b].map(|steps| steps as f32 / ONE as f32)
    }
}

/// A vertex as a weighted sum of references.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Prediction {
    /// Indices of the references; [`u32::MAX`] for a vertex that has none, whose prediction is zero.
    pub(crate) corners: [u32; 3],
    /// Their weights.
    pub(crate) weights: Weights,
}

impl From<&Anchor> for Prediction {
    fn from(anchor: &Anchor) -> Self {
        Self { corners: anchor.corners, weights: Weights::quantise(anchor.weights) }
    }
}

/// The row of a reference, or an empty one where there is none.
fn row(references: &[f32], dimension: usize, reference: u32) -> &[f32] {
    let first = (reference as usize).checked_mul(dimension);
    first.and_then(|first| references.get(first..first.checked_add(dimension)?)).unwrap_or(&[])
}

/// Rows of some vertices, one after the other: what is stored of the references. A vertex without a row gets zeros.
pub(crate) fn gather(values: &[f32], dimension: usize, vertices: &[u32]) -> Vec<f32> {
    let mut rows = vec![0.0; vertices.len() * dimension];
    if dimension > 0 {
        rows.par_chunks_mut(dimension).zip(vertices).for_each(|(out, &v)| {
            let from = row(values, dimension, v);
            out[..from.len()].copy_from_slice(from);
        });
    }
    rows
}

/// Writes the predicted row of one vertex; `references` are the rows of the references.
pub(crate) fn predict(references: &[f32], prediction: &Prediction, out: &mut [f32]) {
    let dimension = out.len();
    out.fill(0.0);
    for (corner, weight) in prediction.corners.into_iter().zip(prediction.weights.values()) {
        if weight != 0.0 {
            for (out, value) in out.iter_mut().zip(row(references, dimension, corner)) {
                *out += weight * value;
            }
        }
    }
}

/// Which weights a fit may use.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub(crate) enum Bounds {
    /// None negative: predictions stay between the references.
    Convex,
    /// Down to -1/4: predictions may reach beyond the references by a little.
    Extrapolating,
}

impl Bounds {
    fn least(self) -> f64 {
        match self {
            Self::Convex => 0.0,
            Self::Extrapolating => -0.25,
        }
    }
}

/// Share of the spread of the references that a departure from the barycentric weights costs: settles weights that
/// the values leave open.
const REGULARISATION: f64 = 1e-4;

/// The squared error of a prediction as a function of the first two weights, over what it is at the third reference.
struct ErrorOf {
    /// Products of the differences of the first two references to the third: 11, 12, 22.
    products: [f64; 3],
    /// Products of these with the difference of the value.
    targets: [f64; 2],
    /// Squared difference of the value to the third reference.
    constant: f64,
}

/// Numbers that are summed side by side.
const LANES: usize = 8;

impl ErrorOf {
    fn new(value: &[f32], corners: [&[f32]; 3]) -> Self {
        let mut sums = [[0.0f64; LANES]; 6];
        let length = corners.iter().map(|c| c.len()).min().unwrap_or(0).min(value.len());
        let mut add = |lane: usize, i: usize| {
            let third = f64::from(corners[2][i]);
            let a = f64::from(corners[0][i]) - third;
            let b = f64::from(corners[1][i]) - third;
            let y = f64::from(value[i]) - third;
            for (sum, product) in sums.iter_mut().zip([a * a, a * b, b * b, a * y, b * y, y * y]) {
                sum[lane] += product;
            }
        };
        for start in (0..length).step_by(LANES) {
            for lane in 0..LANES.min(length - start) {
                add(lane, start + lane);
            }
        }
        let [aa, ab, bb, ay, by, yy] = sums.map(|lanes| lanes.iter().sum::<f64>());
        Self { products: [aa, ab, bb], targets: [ay, by], constant: yy }
    }

    /// Squared error of a prediction with these weights.
    fn at(&self, [u, v, _]: [f64; 3]) -> f64 {
        let [aa, ab, bb] = self.products;
        let square = aa * u * u + 2.0 * ab * u * v + bb * v * v;
        (square - 2.0 * (self.targets[0] * u + self.targets[1] * v) + self.constant).max(0.0)
    }

    /// The same function plus a cost of leaving `start`.
    fn regularised(&self, start: [f64; 3]) -> Self {
        let [aa, ab, bb] = self.products;
        // Of (du^2 + dv^2 + (du + dv)^2), so that no weight is special.
        let r = REGULARISATION * 0.5 * (aa + bb) + f64::MIN_POSITIVE;
        let [u, v, _] = start;
        Self {
            products: [aa + 2.0 * r, ab + r, bb + 2.0 * r],
            targets: [self.targets[0] + r * (2.0 * u + v), self.targets[1] + r * (u + 2.0 * v)],
            constant: self.constant + r * (u * u + v * v + (u + v) * (u + v)),
        }
    }

    /// Weights of the least value, none below `least`. Where the free minimum lies outside, the minimum is on one of
    /// the three sides of the triangle of allowed weights, because the function is convex.
    fn minimum(&self, least: f64) -> [f64; 3] {
        let [aa, ab, bb] = self.products;
        let [ay, by] = self.targets;
        let determinant = aa * bb - ab * ab;
        if determinant > 0.0 {
            let (u, v) = ((bb * ay - ab * by) / determinant, (aa * by - ab * ay) / determinant);
            let w = 1.0 - u - v;
            if u >= least && v >= least && w >= least {
                return [u, v, w];
            }
        }
        let most = 1.0 - 2.0 * least;
        let on = |linear: f64, square: f64| if square > 0.0 { (linear / square).clamp(least, most) } else { least };
        let u = on(ay - ab * least, aa);
        let v = on(by - ab * least, bb);
        // Along the third side u + v = 1 - least.
        let sum = 1.0 - least;
        let s = on(ay - by + sum * (bb - ab), aa - 2.0 * ab + bb);
        let sides = [[u, least, sum - u], [least, v, sum - v], [s, sum - s, least]];
        sides.into_iter().min_by(|a, b| self.at(*a).total_cmp(&self.at(*b))).unwrap_or(sides[0])
    }
}

/// Weights fitted to the values of a vertex.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Fit {
    /// Weights that add up to 1.
    pub(crate) weights: [f64; 3],
    /// Sum of the squared errors of the prediction.
    pub(crate) squared_error: f64,
}

/// Weights of three rows of references that predict a row of values best, in least squares; `start` (usually the
/// barycentric weights) settles what the values leave open. Never worse than `start` where that is within the bounds.
pub(crate) fn fit(value: &[f32], corners: [&[f32]; 3], start: [f64; 3], bounds: Bounds) -> Fit {
    let error = ErrorOf::new(value, corners);
    let weights = error.regularised(start).minimum(bounds.least());
    let (fitted, before) = (error.at(weights), error.at(start));
    let start_allowed = start.iter().all(|&w| w >= bounds.least());
    // False as well for what is not a number.
    let improves = fitted < before;
    if start_allowed && !improves {
        return Fit { weights: start, squared_error: before };
    }
    Fit { weights, squared_error: fitted }
}

/// How vertices find their references and weights.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub(crate) enum Choice {
    /// The nearest triangle, barycentric weights: the paper.
    Barycentric,
    /// The nearest triangle, fitted weights.
    Fitted(Bounds),
    /// Of the nearest triangle and those that share a corner with it, the one whose fitted weights predict best.
    BestTriangle(Bounds),
}

/// Predictions of the vertices of a level: `vertices[i]` is the vertex of `level.anchors[i]`, `None` if they are all
/// vertices in order. `values` are the rows of all vertices, `references` those of the level's references.
pub(crate) fn predictions(
    level: &Level,
    vertices: Option<&[u32]>,
    values: &[f32],
    references: &[f32],
    dimension: usize,
    choice: Choice,
) -> Vec<Prediction> {
    let one = |(i, anchor): (usize, &Anchor)| {
        let vertex = vertices.map_or(Some(i as u32), |vertices| vertices.get(i).copied());
        let value = vertex.map_or(&[][..], |v| row(values, dimension, v));
        // A reference is itself.
        if value.is_empty() || anchor.weights[0] == 1.0 && anchor.corners[0] == anchor.corners[1] {
            return Prediction::from(anchor);
        }
        match choice {
            Choice::Barycentric => Prediction::from(anchor),
            Choice::Fitted(bounds) => {
                let rows = anchor.corners.map(|c| row(references, dimension, c));
                let weights = fit(value, rows, anchor.weights, bounds).weights;
                Prediction { corners: anchor.corners, weights: Weights::quantise(weights) }
            }
            Choice::BestTriangle(bounds) => best_triangle(level, anchor, value, references, dimension, bounds),
        }
    };
    level.anchors.par_iter().enumerate().map(one).collect()
}

/// A triangle other than the nearest must be better by this factor in squared error, else its index is wasted.
const BETTER: f64 = 0.9;

fn best_triangle(
    level: &Level,
    anchor: &Anchor,
    value: &[f32],
    references: &[f32],
    dimension: usize,
    bounds: Bounds,
) -> Prediction {
    let fitted = |corners: [u32; 3], start| fit(value, corners.map(|c| row(references, dimension, c)), start, bounds);
    let nearest = fitted(anchor.corners, anchor.weights);
    let (mut best, mut corners, mut least) = (nearest, anchor.corners, BETTER * nearest.squared_error);
    for face in candidates(level, anchor) {
        // No barycentric weights of a triangle further away: those of the shared corners, which lie in both.
        let shared =
            face.map(|c| anchor.corners.iter().zip(anchor.weights).find(|(a, _)| **a == c).map_or(0.0, |(_, w)| w));
        let sum: f64 = shared.iter().sum();
        let start = if sum > 0.0 { shared.map(|w| w / sum) } else { [1.0 / 3.0; 3] };
        let fit = fitted(face, start);
        if fit.squared_error < least {
            (best, corners, least) = (fit, face, fit.squared_error);
        }
    }
    Prediction { corners, weights: Weights::quantise(best.weights) }
}

/// Triangles that share a corner with the nearest one of a vertex, without that one, in an order that a reader who has
/// the level can repeat.
pub(crate) fn candidates(level: &Level, anchor: &Anchor) -> Vec<[u32; 3]> {
    let mut faces: Vec<u32> = anchor.corners.iter().flat_map(|&c| level.star(c).iter().copied()).collect();
    faces.sort_unstable();
    faces.dedup();
    faces.iter().filter_map(|&f| level.faces.get(f as usize)).copied().filter(|f| *f != anchor.corners).collect()
}

#[cfg(test)]
#[path = "reference_points_tests.rs"]
mod tests;
