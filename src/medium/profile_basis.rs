//! A linear basis of the far parts of all radial profiles of one object: editing the material becomes a dot product.
//!
//! The basis is the principal components of the far parts ([`FarProfile`]) of a training set of dipoles, as in Wang et
//! al. 2008, section 3.1, with other weights. The target is the error of the radiosity under any irradiance, which
//! `T1 = Int 2 pi r |f~ - f| dr` bounds, relative to the profile's total. So each column is divided by its total, the
//! materials are even in the logarithms of their coefficients, and the components are orthonormal in
//! `Int (pi (r^2 + split^2) f)^2 d ln(r^2 + split^2)`, whose integrand is the square of that of T1.
//!
//! Terms that T1 <= 1e-2, 3e-3, 1e-3 needs for every judge ([`ProfileBasis::worst_error`]), and T1 at 12 terms:
//!
//! | split, reach in mm | terms | T1 | T1 with r^1.5 instead of r^2 | T1 of [`Family::Plain`] |
//! | --- | --- | --- | --- | --- |
//! | 0.8, 30 | 8, 10, 11 | 2.0e-4 | 2.3e-4 | 2.7e-3 |
//! | 0.5, 30 | 9, 11, 12 | 6.9e-4 | 7.7e-4 | 6.7e-3 |
//! | 0.3, 30 | 10, 12, 13 | 1.3e-3 | 2.2e-3 | 1.9e-2 |
//! | 0.5, 10 | 8, 9, 10 | 4.1e-5 | 5.2e-5 | 1.0e-3 |
//! | 2, 100 | 9, 10, 11 | 3.8e-4 | 4.0e-4 | 3.4e-3 |
//! | 0.1, 65 | 13, 15, 17 | 1.3e-2 | 2.9e-2 | 0.87 |
//!
//! Weights r^1.75 and r^2.25, and columns weighted again by their errors, changed no number of terms by more than one.
//!
//! [`Family::Ladder`] trades a few more terms for functions and coefficients that are never negative (`ladder.rs`).

use self::grid::{Grid, Interpolation};
use self::ladder::NonNegative;
use super::dipole::Dipole;
use super::far_profile::FarProfile;
use crate::error::{Error, Result};
use crate::math::svd::left_singular;

pub use self::table::{ROW_LANES, Table};

mod grid;
mod ladder;
mod materials;
mod table;

/// Largest number of terms that an asked error leads to.
pub const MOST_CHOSEN_TERMS: usize = 24;

/// Largest number of terms of any basis; the singular values of every range are rounding by then.
pub const MOST_TERMS: usize = 32;

/// Accepted split radii in mm; others are taken to the nearest.
const SPLIT_BOUNDS_MM: (f64, f64) = (1e-6, 1e6);

/// Accepted reaches as multiples of the split radius; others are taken to the nearest.
const REACH_BOUNDS: (f64, f64) = (2.0, 1e6);

/// Stored numbers beyond these bounds are refused: no accepted radius leads to them, and no sum overflows below them.
const LARGEST_WEIGHT: f64 = 1e60;
const LARGEST_VALUE: f32 = 1e30;

/// The functions of a basis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
pub enum Family {
    /// Principal components, chosen for the least error in transported light relative to the total of each material.
    #[default]
    Transported,
    /// Far parts of Gaussians whose standard deviations are a geometric sequence: neither they nor the coefficients of
    /// a material are negative, and the total of the profile is kept.
    Ladder,
    /// Principal components of the published choice, for comparison: 650 even samples of r on [0, 65] mm and an even
    /// grid of coefficients on [1e-6, 5]^2 per mm, neither weighted nor normalised.
    Plain,
}

/// Range, family and accuracy of a basis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BasisSettings {
    /// Radius in mm inside which the near field is integrated with the profile itself.
    pub split_mm: f64,
    /// Largest distance in mm between two points of the object.
    pub reach_mm: f64,
    /// The functions of the basis.
    pub family: Family,
    /// Number of terms; without it the smallest number that reaches `error`, [`MOST_CHOSEN_TERMS`] at most.
    pub terms: Option<usize>,
    /// Largest [`Projection::error`] that any judge of [`ProfileBasis::worst_error`] may have.
    pub error: f64,
}

/// A material on a basis.
#[derive(Clone, Debug, PartialEq)]
pub struct Projection {
    /// Coefficient s_k of each function, without unit; not negative on a ladder.
    pub coefficients: Vec<f64>,
    /// `Int 2 pi r |f~ - f| dr` over [0, reach] relative to the total diffuse reflectance of the whole profile: for any
    /// irradiance between 0 and E the radiosity of a plane is in error by at most this times what E everywhere gives.
    pub error: f64,
}

/// Functions b_k with `f(r) ~ Sum_k s_k b_k(r)` for every far profile f, where `s_k = Sum_g weight_g f(r_g) b_k(r_g)`.
/// On a ladder s minimises `Sum_g weight_g (Sum_k s_k b_k(r_g) - f(r_g))^2` over `s >= 0` with `Sum_k s_k total_k =
/// Int_0^reach 2 pi r f dr`.
#[derive(Clone, Debug)]
pub struct ProfileBasis {
    split_mm: f64,
    nodes_mm: Vec<f64>,
    weights: Vec<f64>,
    functions: Vec<f32>,
    /// Non-negative least squares for the coefficients of a ladder.
    non_negative: Option<NonNegative>,
    interpolation: Interpolation,
    /// Quadrature of the errors, and the values of the functions at its nodes, function after function.
    measure: Grid,
    measured: Vec<f64>,
}

impl ProfileBasis {
    /// The basis for an object's own range. Takes a fraction of a second; the same bits on every processor.
    ///
    /// Radii out of range are taken to the nearest accepted one: the split to 1e-6..1e6 mm, the reach to 2..1e6 splits;
    /// the number of terms to 1..=[`MOST_TERMS`]. There are fewer terms than asked only where the training set holds no
    /// more.
    pub fn new(settings: &BasisSettings) -> Self {
        let split_mm = within(settings.split_mm, SPLIT_BOUNDS_MM);
        let reach_mm = split_mm * within(settings.reach_mm / split_mm, REACH_BOUNDS);
        if settings.family == Family::Ladder {
            return match settings.terms {
                Some(terms) => Self::ladder(split_mm, reach_mm, terms.clamp(1, MOST_TERMS)),
                None => Self::shortest_ladder(split_mm, reach_mm, settings.error),
            };
        }
        let most = settings.terms.map_or(MOST_CHOSEN_TERMS, |terms| terms.clamp(1, MOST_TERMS));
        let (nodes_mm, weights) = nodes_and_weights(split_mm, reach_mm, settings.family);
        let vectors = left_singular(columns(split_mm, &nodes_mm, &weights, settings.family), most).vectors;
        let scaled = |vector: Vec<f64>| -> Vec<f32> {
            vector.iter().zip(&weights).map(|(x, weight)| (x / weight.sqrt()) as f32).collect()
        };
        let functions = vectors.into_iter().flat_map(scaled).collect();
        let basis = Self::assemble(split_mm, reach_mm, nodes_mm, weights, functions);
        match settings.terms {
            Some(_) => basis,
            None => basis.shortened(settings.error),
        }
    }

    fn ladder(split_mm: f64, reach_mm: f64, terms: usize) -> Self {
        let (nodes_mm, weights) = nodes_and_weights(split_mm, reach_mm, Family::Ladder);
        let functions = ladder::functions(split_mm, reach_mm, terms, &Grid::new(split_mm, reach_mm));
        let mut basis = Self::assemble(split_mm, reach_mm, nodes_mm, weights, functions);
        let totals = basis.integrals();
        basis.non_negative = Some(NonNegative::new(&basis.functions, &basis.weights, totals));
        basis
    }

    /// The shortest ladder whose error is within `error` for every judge.
    fn shortest_ladder(split_mm: f64, reach_mm: f64, error: f64) -> Self {
        let mut basis = Self::ladder(split_mm, reach_mm, 1);
        for terms in 2..=MOST_CHOSEN_TERMS {
            if basis.worst_error() <= error {
                break;
            }
            basis = Self::ladder(split_mm, reach_mm, terms);
        }
        basis
    }

    /// `Int 2 pi r b_k dr` over [0, reach] of each function.
    fn integrals(&self) -> Vec<f64> {
        let areas = &self.measure.areas_mm2;
        let total = |function: &[f64]| function.iter().zip(areas).map(|(value, area)| value * area).sum();
        self.measured.chunks_exact(areas.len()).map(total).collect()
    }

    /// A basis from stored numbers, named as the accessors. Errors are taken up to the last node, which is the reach
    /// that it was made for unless the family was plain. A ladder has `totals`.
    ///
    /// # Errors
    /// Invalid input when the numbers do not make a basis: lengths that do not fit, nodes that do not ascend from 0,
    /// numbers that are not finite, a weight or total that is not positive, radii outside the range that [`Self::new`]
    /// serves.
    pub fn from_parts(
        split_mm: f64,
        nodes_mm: Vec<f64>,
        weights: Vec<f64>,
        functions: Vec<f32>,
        totals: Option<Vec<f64>>,
    ) -> Result<Self> {
        let wrong = |what: &str| Err(Error::input(format!("profile basis: {what}; bake the asset again")));
        let count = nodes_mm.len();
        let reach_mm = nodes_mm.last().copied().unwrap_or(0.0);
        if !(SPLIT_BOUNDS_MM.0..=SPLIT_BOUNDS_MM.1).contains(&split_mm) {
            return wrong("the split radius is out of range");
        }
        // Stored nodes are rounded square roots.
        if !(REACH_BOUNDS.0 * (1.0 - 1e-9)..=REACH_BOUNDS.1 * (1.0 + 1e-9)).contains(&(reach_mm / split_mm)) {
            return wrong("the last node does not fit the split radius");
        }
        // Their squares are what is computed with.
        let ascending = nodes_mm.windows(2).all(|pair| pair[0] * pair[0] < pair[1] * pair[1]);
        if nodes_mm.first() != Some(&0.0) || !ascending {
            return wrong("the nodes do not ascend from 0");
        }
        if weights.len() != count || !weights.iter().all(|&weight| weight > 0.0 && weight < LARGEST_WEIGHT) {
            return wrong("there is not one positive weight for each node");
        }
        let terms = functions.len() / count;
        if !(1..=MOST_TERMS).contains(&terms) || functions.len() != terms * count {
            return wrong("the functions do not have one value for each node");
        }
        if !functions.iter().all(|value| value.abs() < LARGEST_VALUE) {
            return wrong("a function is not finite");
        }
        let mut basis = Self::assemble(split_mm, reach_mm, nodes_mm, weights, functions);
        if !basis.measured.iter().all(|value| value.abs() < f64::from(LARGEST_VALUE)) {
            return wrong("the nodes are too close to each other");
        }
        if let Some(totals) = totals {
            let positive = |total: &f64| *total > 0.0 && *total < LARGEST_WEIGHT;
            if totals.len() != terms || !totals.iter().all(positive) {
                return wrong("there is not one positive total for each function");
            }
            basis.non_negative = Some(NonNegative::new(&basis.functions, &basis.weights, totals));
        }
        Ok(basis)
    }

    /// Completes the basis from the stored numbers, which must be valid.
    fn assemble(split_mm: f64, reach_mm: f64, nodes_mm: Vec<f64>, weights: Vec<f64>, functions: Vec<f32>) -> Self {
        let squares = nodes_mm.iter().map(|node| node * node).collect();
        let interpolation = Interpolation::new(squares, split_mm * split_mm);
        let measure = Grid::new(split_mm, reach_mm);
        let places = measure.squares_mm2.len();
        let mut measured = vec![0.0; functions.len() / nodes_mm.len() * places];
        for (place, &square) in measure.squares_mm2.iter().enumerate() {
            for (k, value) in interpolation.at(&functions, square).into_iter().enumerate() {
                measured[k * places + place] = value;
            }
        }
        Self { split_mm, nodes_mm, weights, functions, non_negative: None, interpolation, measure, measured }
    }

    /// The basis cut to the first terms, as many as every judge needs to be within `error`.
    fn shortened(mut self, error: f64) -> Self {
        let mut worst = vec![0.0_f64; self.terms()];
        for judge in materials::judges() {
            let far = FarProfile::new(&judge, self.split_mm);
            for (worst, error) in worst.iter_mut().zip(self.errors(&far, &self.coefficients(&far))) {
                *worst = worst.max(error);
            }
        }
        let terms = worst.iter().position(|&worst| worst <= error).map_or(worst.len(), |last| last + 1);
        self.functions.truncate(terms * self.nodes_mm.len());
        self.measured.truncate(terms * self.measure.squares_mm2.len());
        self
    }

    /// Split radius in mm.
    pub fn split_mm(&self) -> f64 {
        self.split_mm
    }

    /// Largest distance in mm that the functions serve; the last node.
    pub fn reach_mm(&self) -> f64 {
        self.nodes_mm.last().copied().unwrap_or(0.0)
    }

    /// Nodes r_g in mm, ascending from 0.
    pub fn nodes_mm(&self) -> &[f64] {
        &self.nodes_mm
    }

    /// Weights of the nodes in the dot product that gives a coefficient, mm^4.
    pub fn weights_mm4(&self) -> &[f64] {
        &self.weights
    }

    /// b_k(r_g), function after function, 1/mm^2.
    pub fn functions(&self) -> &[f32] {
        &self.functions
    }

    /// `Int 2 pi r b_k dr` over the reach of each function, without unit, of a ladder; none for other families.
    pub fn totals(&self) -> Option<&[f64]> {
        self.non_negative.as_ref().map(NonNegative::totals)
    }

    /// Number of functions K.
    pub fn terms(&self) -> usize {
        self.functions.len() / self.nodes_mm.len()
    }

    /// The far part of a dipole on this basis.
    pub fn project(&self, dipole: &Dipole) -> Projection {
        let far = FarProfile::new(dipole, self.split_mm);
        let coefficients = self.coefficients(&far);
        let error = self.errors(&far, &coefficients).last().copied().unwrap_or(0.0);
        Projection { coefficients, error }
    }

    fn coefficients(&self, far: &FarProfile) -> Vec<f64> {
        if let Some(non_negative) = &self.non_negative {
            return non_negative.coefficients(far, &self.nodes_mm, &self.weights, self.reach_mm());
        }
        let weighted: Vec<f64> = self
            .nodes_mm
            .iter()
            .zip(&self.weights)
            .map(|(node, weight)| weight * far.reflectance_at_square(node * node))
            .collect();
        let dot = |function: &[f32]| weighted.iter().zip(function).map(|(f, &b)| f * f64::from(b)).sum();
        self.functions.chunks_exact(self.nodes_mm.len()).map(dot).collect()
    }

    /// [`Projection::error`] with 1, 2, ... of the terms and these coefficients.
    fn errors(&self, far: &FarProfile, coefficients: &[f64]) -> Vec<f64> {
        let total = far.profile_total();
        let relative = if total > 0.0 { 1.0 / total } else { 0.0 };
        let grid = &self.measure;
        let mut rest: Vec<f64> = grid.squares_mm2.iter().map(|&square| far.reflectance_at_square(square)).collect();
        let functions = self.measured.chunks_exact(grid.squares_mm2.len());
        let residual = |(coefficient, function): (&f64, &[f64])| {
            let mut sum = 0.0;
            for ((rest, b), area) in rest.iter_mut().zip(function).zip(&grid.areas_mm2) {
                *rest -= coefficient * b;
                sum += area * rest.abs();
            }
            sum * relative
        };
        coefficients.iter().zip(functions).map(residual).collect()
    }

    /// The largest [`Projection::error`] of the judges: every channel of the measured materials, and 200 random media
    /// with sigma_s' in 0.02..25 and sigma_a in 0 and 1e-4..2 per mm and eta in 1..2 that the basis was not made from.
    pub fn worst_error(&self) -> f64 {
        materials::judges().iter().map(|judge| self.project(judge).error).fold(0.0, f64::max)
    }

    /// Typical coefficient of each function: the root mean square over the training set of `s_k` relative to the total
    /// diffuse reflectance. `spread_k b_k` is comparable between functions.
    pub fn spread(&self) -> Vec<f64> {
        let training = materials::training();
        let mut squares = vec![0.0; self.terms()];
        for dipole in &training {
            let far = FarProfile::new(dipole, self.split_mm);
            let total = far.profile_total();
            for (square, coefficient) in squares.iter_mut().zip(self.coefficients(&far)) {
                *square += (coefficient / total) * (coefficient / total);
            }
        }
        squares.into_iter().map(|square: f64| (square / training.len() as f64).sqrt()).collect()
    }

    /// Table of all functions in single precision, for evaluation at many points.
    pub fn table(&self) -> Table {
        let (split, reach) = (self.split_mm, self.reach_mm());
        Table::new(&self.interpolation, &self.functions, split * split, reach * reach)
    }
}

/// The nearest number in the range; the lower bound for NaN.
fn within(value: f64, (lowest, highest): (f64, f64)) -> f64 {
    if value > lowest { value.min(highest) } else { lowest }
}

/// Nodes in mm and their weights in mm^4.
fn nodes_and_weights(split_mm: f64, reach_mm: f64, family: Family) -> (Vec<f64>, Vec<f64>) {
    match family {
        Family::Transported | Family::Ladder => {
            let grid = Grid::new(split_mm, reach_mm);
            let last = grid.squares_mm2.len() - 1;
            let node = |(i, square): (usize, &f64)| if i == last { reach_mm } else { square.sqrt() };
            let weight = |(square, area): (&f64, &f64)| area * std::f64::consts::PI * (square + split_mm * split_mm);
            let nodes = grid.squares_mm2.iter().enumerate().map(node).collect();
            (nodes, grid.squares_mm2.iter().zip(&grid.areas_mm2).map(weight).collect())
        }
        Family::Plain => {
            let nodes = grid::plain_nodes(reach_mm);
            let weights = vec![1.0; nodes.len()];
            (nodes, weights)
        }
    }
}

/// The training set as columns, weighted so that their plain dot product is the weighted one.
fn columns(split_mm: f64, nodes_mm: &[f64], weights: &[f64], family: Family) -> Vec<Vec<f64>> {
    let dipoles = match family {
        Family::Transported | Family::Ladder => materials::training(),
        Family::Plain => materials::plain_training(),
    };
    let column = |dipole: &Dipole| {
        let far = FarProfile::new(dipole, split_mm);
        let scale = match family {
            Family::Transported | Family::Ladder => 1.0 / far.profile_total(),
            Family::Plain => 1.0,
        };
        let entry = |(node, weight): (&f64, &f64)| scale * weight.sqrt() * far.reflectance_at_square(node * node);
        nodes_mm.iter().zip(weights).map(entry).collect()
    };
    dipoles.iter().map(column).collect()
}

#[cfg(test)]
mod ladder_tests;
#[cfg(test)]
mod tests;
