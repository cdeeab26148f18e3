//! Weights over a set of directions that give a function's value between them.

use glam::DVec3;

use super::directions::DirectionSet;
use crate::error::{Error, Result};
use crate::math::cholesky::Cholesky;
use crate::math::sh::real_sh;
use crate::math::sphere::unit;
use crate::math::svd::dot;
use crate::parallel::*;

/// Interpolation scheme of values between the directions of a set. All reproduce constants.
///
/// RMS error by the number of directions for 300 clamped cosines with up to two shadow edges, blurred by Gaussians of 3 to 30
/// degrees (standard deviation), at 400 random directions; full scale is about 1. The jump is the most that a value moves at 200
/// directions when the light turns by 0.1 degrees, beyond the function's own motion in that step (quarters of 12 great circles, 24
/// functions): it stays when the step goes to zero for `Nearest4`, and goes to zero with it for the others.
///
/// | scheme | 50 | 100 | 200 | 400 | 800 | jump |
/// | --- | --- | --- | --- | --- | --- | --- |
/// | nearest4 | 3.8e-2 | 2.5e-2 | 1.5e-2 | 9.4e-3 | 6.0e-3 | 7.2e-2 |
/// | barycentric | 3.4e-2 | 2.1e-2 | 1.2e-2 | 6.7e-3 | 3.7e-3 | 3.6e-3 |
/// | rbf | 2.4e-2 | 1.5e-2 | 7.3e-3 | 3.1e-3 | 9.8e-4 | 2.0e-3 |
/// | least-squares | 3.2e-2 | 2.0e-2 | 1.1e-2 | 5.1e-3 | 2.4e-3 | 2.4e-3 |
///
/// The same for blurs of 8 to 16 degrees, as strong scattering makes them; the last column is the lowest value at 200
/// directions (the functions are never negative):
///
/// | scheme | 50 | 100 | 200 | 400 | 800 | lowest |
/// | --- | --- | --- | --- | --- | --- | --- |
/// | nearest4 | 3.4e-2 | 2.0e-2 | 1.2e-2 | 7.4e-3 | 4.9e-3 | 0 |
/// | barycentric | 2.8e-2 | 1.6e-2 | 8.0e-3 | 4.0e-3 | 2.0e-3 | 0 |
/// | rbf | 1.4e-2 | 5.0e-3 | 1.1e-3 | 1.3e-4 | 5.9e-6 | -0.009 |
/// | least-squares | 2.3e-2 | 1.0e-2 | 3.3e-3 | 4.6e-4 | 5.3e-5 | -0.028 |
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
pub enum Scheme {
    /// The paper's: the four nearest directions with weights 1/angle^2. Exact at the directions, never negative; discontinuous
    /// wherever the fourth nearest changes.
    Nearest4,
    /// Barycentric coordinates in the spherical Delaunay triangulation: exact at the directions, never negative, continuous.
    Barycentric,
    /// Radial basis functions on all directions, smooth. Exact at the directions and for every polynomial of degree 2 (from
    /// [`QUADRATIC_FROM`] directions on, below of degree 1). Some weights are negative.
    ///
    /// The kernel is (r^2 + 0.2^2)^(3/2) of the chord r: with blurs of 3 to 30 degrees it errs by 2.40e-2, 1.48e-2, 7.31e-3
    /// and 3.08e-3 at 50, 100, 200 and 400 directions, with 8 to 16 degrees by 1.36e-2, 4.98e-3, 1.10e-3 and 1.34e-4. It was
    /// compared with r, r^3, r^4 log r, r^5, those of Matern, Wendland and Gauss, and exp(-angle).
    ///
    /// Narrow blurs are limited by the number of directions, whatever the kernel. Within 2 % of the best there, the chosen one
    /// gains on wide blurs over r^3, keeps its condition at a thousand directions, and needs a square root only, so that its bits
    /// do not depend on the platform. A bake of little else takes .3 s at 800 directions, 1 s at 1600, 1.8 s at 2048 (2 cores).
    Rbf,
    /// Least squares by spherical harmonics of [`default_order`]; smooth, not exact at the directions. Some weights are negative.
    LeastSquares,
}

impl Scheme {
    /// Every scheme.
    pub const ALL: [Self; 4] = [Self::Nearest4, Self::Barycentric, Self::Rbf, Self::LeastSquares];

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Nearest4 => "nearest4",
            Self::Barycentric => "barycentric",
            Self::Rbf => "rbf",
            Self::LeastSquares => "least-squares",
        }
    }
}

/// Most directions that [`Scheme::Rbf`] takes: its set-up grows with the third power, its memory with the second.
pub const MOST_RBF: usize = 2048;

/// Directions from which [`Scheme::Rbf`] reproduces polynomials of degree 2, not only of degree 1.
pub const QUADRATIC_FROM: usize = 16;

/// Highest order of [`Scheme::LeastSquares`].
pub const MOST_ORDER: usize = 20;

/// Directions whose functions one task sums.
const DIRECTIONS_OF_A_TASK: usize = 512;

/// A direction this close (radians) to one of the set has that one's value.
const SAME_DIRECTION: f64 = 1e-12;

/// Square of the length in the kernel, see [`Scheme::Rbf`].
const KERNEL_LENGTH_SQUARED: f64 = 0.2 * 0.2;

/// Factor on the products of harmonics that are added to make the kernel positive definite: more than its largest
/// eigenvalue on them times 4 pi over the count. It has no influence on the result.
const POLYNOMIAL_SHIFT: f64 = 100.0;

/// Order of the harmonics of [`Scheme::LeastSquares`] for a set of `count` directions: floor(sqrt(0.6 count)), at least 1 and at
/// most [`MOST_ORDER`].
pub fn default_order(count: usize) -> usize {
    ((0.6 * count as f64).sqrt() as usize).clamp(1, MOST_ORDER)
}

/// The weights of a scheme over a set of directions.
#[derive(Clone, Debug, PartialEq)]
pub struct Interpolator {
    set: DirectionSet,
    scheme: Scheme,
    /// Order of the harmonics among the functions that `matrix` multiplies.
    order: usize,
    /// Number of functions of the direction in which the weights are linear; 0 for the local schemes.
    functions: usize,
    /// Matrix from these functions to the weights, a row for each direction.
    matrix: Vec<f64>,
}

impl Interpolator {
    /// Sets `scheme` up for `set`.
    ///
    /// # Errors
    /// More than [`MOST_RBF`] directions for `Rbf` (exit 5), directions that do not determine the polynomial or the harmonics
    /// (exit 3).
    pub fn new(set: &DirectionSet, scheme: Scheme) -> Result<Self> {
        match scheme {
            Scheme::Nearest4 | Scheme::Barycentric => {
                Ok(Self { set: set.clone(), scheme, order: 0, functions: 0, matrix: Vec::new() })
            }
            Scheme::Rbf => Self::rbf(set),
            Scheme::LeastSquares => Self::least_squares(set, default_order(set.count())),
        }
    }

    /// [`Scheme::LeastSquares`] with harmonics of another order: order^2 functions.
    ///
    /// # Errors
    /// An order of 0, beyond [`MOST_ORDER`], with more functions than directions, or one that the directions do not determine
    /// (exit 3).
    pub fn least_squares(set: &DirectionSet, order: usize) -> Result<Self> {
        let count = set.count();
        if order == 0 || order > MOST_ORDER || order * order > count {
            return Err(Error::input(format!(
                "harmonics of order {order} do not fit {count} directions; their order is 1 to {MOST_ORDER} and its square at \
                 most the number of directions"
            )));
        }
        let harmonics = harmonics(set, order);
        let functions = order * order;
        let inverse = gram(&harmonics, functions)
            .and_then(|gram| Cholesky::new(gram, functions))
            .ok_or_else(|| undetermined(count, order))?
            .inverse();
        let mut matrix = vec![0.0; count * functions];
        for (row, values) in matrix.chunks_exact_mut(functions).zip(harmonics.chunks_exact(functions)) {
            row.iter_mut()
                .zip(inverse.chunks_exact(functions))
                .for_each(|(out, inverse)| *out = dot::<8>(values, inverse));
        }
        Ok(Self { set: set.clone(), scheme: Scheme::LeastSquares, order, functions, matrix })
    }

    fn rbf(set: &DirectionSet) -> Result<Self> {
        let count = set.count();
        if count > MOST_RBF {
            return Err(Error::unsupported(format!(
                "radial basis functions take {MOST_RBF} directions at most, not {count}; use barycentric interpolation"
            )));
        }
        let order = if count < QUADRATIC_FROM { 2 } else { 3 };
        let matrix = rbf_matrix(set, order).ok_or_else(|| undetermined(count, order))?;
        Ok(Self { set: set.clone(), scheme: Scheme::Rbf, order, functions: count + order * order, matrix })
    }

    /// The directions.
    pub fn set(&self) -> &DirectionSet {
        &self.set
    }

    /// The scheme.
    pub fn scheme(&self) -> Scheme {
        self.scheme
    }

    /// Fills `out` with a weight for each direction of the set, summing to 1. `direction` may have any length; a vector without
    /// a direction (zero, not finite) counts as +Z.
    pub fn weights(&self, direction: DVec3, out: &mut Vec<f64>) {
        out.clear();
        out.resize(self.set.count(), 0.0);
        if self.functions == 0 {
            self.local(direction, |index, weight| out[index] += weight);
        } else {
            let mut values = vec![0.0; self.functions];
            self.values(unit(direction), &mut values);
            for (out, row) in out.iter_mut().zip(self.matrix.chunks_exact(self.functions)) {
                *out = dot::<8>(row, &values);
            }
        }
    }

    /// The sum of the weights of many directions, each times its RGB amount: pairs are (direction, amount).
    ///
    /// Much faster than one by one for the smooth schemes, whose weights are linear in a few functions of the direction.
    pub fn sum(&self, lights: &[(DVec3, DVec3)]) -> Vec<DVec3> {
        let mut total = vec![DVec3::ZERO; self.set.count()];
        if self.functions == 0 {
            for (direction, amount) in lights {
                self.local(*direction, |index, weight| total[index] += weight * *amount);
            }
            return total;
        }
        let sums = self.function_sums(lights);
        for (total, row) in total.iter_mut().zip(self.matrix.chunks_exact(self.functions)) {
            *total = DVec3::new(dot::<8>(row, &sums[0]), dot::<8>(row, &sums[1]), dot::<8>(row, &sums[2]));
        }
        total
    }

    /// Number of functions of the direction in which a smooth scheme's weights are linear; 0 for the local schemes.
    pub fn functions(&self) -> usize {
        self.functions
    }

    /// Matrix from these functions to the weights: a row for each direction of the set, empty for the local schemes.
    pub fn matrix(&self) -> &[f64] {
        &self.matrix
    }

    /// Frees the matrix that [`Self::weights`] and [`Self::sum`] of a smooth scheme need (they give zeros from then
    /// on), for callers of [`Self::function_sums`] only.
    pub fn forget_weights(&mut self) {
        self.matrix = Vec::new();
    }

    /// Sums of the functions of many directions, each times its RGB amount, channel after channel.
    pub fn function_sums(&self, lights: &[(DVec3, DVec3)]) -> [Vec<f64>; 3] {
        let of_chunk = |lights: &[(DVec3, DVec3)]| {
            let mut values = vec![0.0; self.functions];
            let mut sums = [0, 1, 2].map(|_| vec![0.0; self.functions]);
            for (direction, amount) in lights {
                self.values(unit(*direction), &mut values);
                for (sums, amount) in sums.iter_mut().zip(amount.to_array()) {
                    sums.iter_mut().zip(&values).for_each(|(sum, value)| *sum += amount * value);
                }
            }
            sums
        };
        let mut chunks: Vec<[Vec<f64>; 3]> = lights.par_chunks(DIRECTIONS_OF_A_TASK).map(of_chunk).collect();
        let mut total = chunks.pop().unwrap_or_else(|| of_chunk(&[]));
        for chunk in chunks {
            for (total, chunk) in total.iter_mut().zip(chunk) {
                total.iter_mut().zip(chunk).for_each(|(total, sum)| *total += sum);
            }
        }
        total
    }

    /// Passes the few weights of a local scheme to `add`.
    fn local(&self, direction: DVec3, mut add: impl FnMut(usize, f64)) {
        if self.scheme == Scheme::Barycentric {
            let found = self.set.triangulation().locate(direction);
            let corners = self.set.triangulation().triangles()[found.triangle];
            corners.into_iter().zip(found.barycentric).for_each(|(index, weight)| add(index as usize, weight));
            return;
        }
        let near = self.set.nearest(direction, 4);
        match near.first() {
            Some(first) if first.angle <= SAME_DIRECTION => add(first.index, 1.0),
            _ => {
                let total: f64 = near.iter().map(|n| (n.angle * n.angle).recip()).sum();
                near.iter().for_each(|n| add(n.index, (n.angle * n.angle).recip() / total));
            }
        }
    }

    /// Values of the functions in which the weights of a smooth scheme are linear: kernels, then harmonics.
    fn values(&self, direction: DVec3, out: &mut [f64]) {
        let (kernels, harmonics) = out.split_at_mut(self.functions - self.order * self.order);
        kernels
            .iter_mut()
            .zip(self.set.directions())
            .for_each(|(out, at)| *out = kernel(direction.distance_squared(*at)));
        real_sh(self.order, direction, harmonics);
    }
}

fn undetermined(count: usize, order: usize) -> Error {
    Error::input(format!(
        "{count} directions do not determine spherical harmonics of order {order}; ask for more directions or a lower order"
    ))
}

/// The kernel of [`Scheme::Rbf`] at a squared chord.
fn kernel(squared: f64) -> f64 {
    let t = squared + KERNEL_LENGTH_SQUARED;
    t * t.sqrt()
}

/// Harmonics of every direction, a row each.
fn harmonics(set: &DirectionSet, order: usize) -> Vec<f64> {
    let mut values = vec![0.0; set.count() * order * order];
    values.chunks_exact_mut(order * order).zip(set.directions()).for_each(|(row, d)| real_sh(order, *d, row));
    values
}

/// Y^T Y of a matrix of rows of `width` values; none where something is not finite.
fn gram(rows: &[f64], width: usize) -> Option<Vec<f64>> {
    let mut gram = vec![0.0; width * width];
    for row in rows.chunks_exact(width) {
        for (out, a) in gram.chunks_exact_mut(width).zip(row) {
            out.iter_mut().zip(row).for_each(|(out, b)| *out += a * b);
        }
    }
    gram.iter().all(|v| v.is_finite()).then_some(gram)
}

/// Weights from kernel values and harmonics: the interpolant sum_j a_j k(w, w_j) + sum_q b_q Y_q(w) with Y^T a = 0 solves
/// [K Y; Y^T 0] [a; b] = [f; 0], so the weights of the values f are M k(w) + N Y(w) with M, N from the inverse of that matrix.
fn rbf_matrix(set: &DirectionSet, order: usize) -> Option<Vec<f64>> {
    let (count, width) = (set.count(), order * order);
    let y = harmonics(set, order);
    let y_row = |i: usize| &y[i * width..(i + 1) * width];
    // Adding Y Y^T changes nothing as Y^T a = 0, and makes the matrix positive definite.
    let mut shifted = vec![0.0; count * count];
    shifted.par_chunks_mut(count).enumerate().for_each(|(i, row)| {
        let at = set.directions()[i];
        for (j, (out, other)) in row.iter_mut().zip(set.directions()).enumerate() {
            *out = kernel(at.distance_squared(*other)) + POLYNOMIAL_SHIFT * dot::<8>(y_row(i), y_row(j));
        }
    });
    let inverse = Cholesky::new(shifted, count)?.inverse();
    let columns: Vec<Vec<f64>> = (0..width).map(|q| (0..count).map(|i| y_row(i)[q]).collect()).collect();
    let solved: Vec<Vec<f64>> =
        columns.iter().map(|column| inverse.chunks_exact(count).map(|row| dot::<8>(row, column)).collect()).collect();
    let schur = (0..width * width).map(|k| dot::<8>(&columns[k / width], &solved[k % width])).collect();
    let schur = Cholesky::new(schur, width)?.inverse();
    let functions = count + width;
    let mut matrix = vec![0.0; count * functions];
    matrix.par_chunks_mut(functions).enumerate().for_each(|(i, row)| {
        let (kernels, harmonics) = row.split_at_mut(count);
        let solved_row: Vec<f64> = solved.iter().map(|s| s[i]).collect();
        harmonics
            .iter_mut()
            .zip(schur.chunks_exact(width))
            .for_each(|(out, schur)| *out = dot::<8>(&solved_row, schur));
        kernels.copy_from_slice(&inverse[i * count..(i + 1) * count]);
        for (factor, solved) in harmonics.iter().zip(&solved) {
            kernels.iter_mut().zip(solved).for_each(|(out, s)| *out -= factor * s);
        }
    });
    make_exact(&mut matrix, &y, count, width)?;
    Some(matrix)
}

/// Adds to the weights the smallest change after which they reproduce the harmonics to the last digits: the condition of the
/// kernel's matrix would leave an error of about 1e-10.
fn make_exact(matrix: &mut [f64], y: &[f64], count: usize, width: usize) -> Option<()> {
    let functions = count + width;
    let inverse = Cholesky::new(gram(y, width)?, width)?.inverse();
    let mut missing = vec![0.0; width * functions];
    for (row, y) in matrix.chunks_exact(functions).zip(y.chunks_exact(width)) {
        for (missing, y) in missing.chunks_exact_mut(functions).zip(y) {
            missing.iter_mut().zip(row).for_each(|(out, value)| *out -= y * value);
        }
    }
    (0..width).for_each(|q| missing[q * functions + count + q] += 1.0);
    for (row, y) in matrix.chunks_exact_mut(functions).zip(y.chunks_exact(width)) {
        for (missing, inverse) in missing.chunks_exact(functions).zip(inverse.chunks_exact(width)) {
            let factor = dot::<8>(inverse, y);
            row.iter_mut().zip(missing).for_each(|(out, value)| *out += factor * value);
        }
    }
    Some(())
}
