//! Linear least squares with non-negative unknowns, for a few unknowns; the same bits on every processor.
//!
//! The active-set method of Lawson and Hanson (*Solving Least Squares Problems*, 1974, chapter 23): the unknowns that are free are
//! solved for by orthogonalisation, never through the normal equations, so that nearly parallel columns cost no more digits than
//! they must. Every sum has a fixed order.

use super::svd::add_scaled;

/// A gradient below this share of its largest possible value is rounding.
const NEGLIGIBLE: f64 = 1e-14;

/// A column's part orthogonal to the others is rounding below this share of its length: the column depends on them.
const DEPENDENT: f64 = 1e-13;

/// Changes of the free unknowns for each unknown; more than three are never needed, and the result then is feasible.
const MOST_CHANGES: usize = 10;

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

fn norm(a: &[f64]) -> f64 {
    dot(a, a).sqrt()
}

/// The x >= 0 that makes `|Sum_j x_j columns_j - target|` least, one number for each column. Columns are as long as the
/// target and finite; entries beyond the shorter one are ignored.
pub fn non_negative_least_squares(columns: &[Vec<f64>], target: &[f64]) -> Vec<f64> {
    let norms: Vec<f64> = columns.iter().map(|column| norm(column)).collect();
    let scale = norm(target);
    let mut x = vec![0.0; columns.len()];
    let mut free = vec![false; columns.len()];
    // Those that rounding let in and threw out again, until something else changes.
    let mut refused = vec![false; columns.len()];
    let mut residual = target.to_vec();
    for _ in 0..MOST_CHANGES * columns.len() {
        let gain = |j: usize| dot(&columns[j], &residual);
        let candidates = (0..columns.len()).filter(|&j| !free[j] && !refused[j]);
        let rising = candidates.map(|j| (j, gain(j))).filter(|&(j, gain)| gain > NEGLIGIBLE * norms[j] * scale);
        let best = rising.max_by(|(i, a), (j, b)| (a / norms[*i]).total_cmp(&(b / norms[*j])).then(j.cmp(i)));
        let Some((new, _)) = best else { break };
        free[new] = true;
        if settle(columns, target, &mut free, &mut x) && free[new] {
            refused.fill(false);
        } else {
            refused[new] = true;
        }
        residual.copy_from_slice(target);
        for (column, &x) in columns.iter().zip(&x).filter(|(_, x)| **x > 0.0) {
            add_scaled(&mut residual, -x, column);
        }
    }
    x
}

/// Takes the free unknowns to their least squares, freeing fewer of them until none is negative. `false` where a free column is
/// a sum of others.
fn settle(columns: &[Vec<f64>], target: &[f64], free: &mut [bool], x: &mut [f64]) -> bool {
    loop {
        let chosen: Vec<usize> = (0..columns.len()).filter(|&j| free[j]).collect();
        if chosen.is_empty() {
            return true;
        }
        let Some(found) = least_squares(columns, &chosen, target) else {
            // The unknowns that were there before are still feasible.
            chosen.iter().filter(|&&j| x[j] <= 0.0).for_each(|&j| free[j] = false);
            return false;
        };
        if found.iter().all(|&z| z > 0.0) {
            chosen.iter().zip(&found).for_each(|(&j, &z)| x[j] = z);
            return true;
        }
        // As far towards it as none becomes negative.
        let limit = |(&j, &z): (&usize, &f64)| if z > 0.0 { f64::INFINITY } else { x[j] / (x[j] - z) };
        let limits: Vec<f64> = chosen.iter().zip(&found).map(limit).collect();
        // 0 / 0 is that of a number that is 0 and stays so.
        let step = limits.iter().fold(1.0, |a: f64, &b| a.min(if b.is_nan() { 0.0 } else { b }));
        for ((&j, &z), &limit) in chosen.iter().zip(&found).zip(&limits) {
            x[j] += step * (z - x[j]);
            if limit.is_nan() || limit <= step || x[j] <= 0.0 {
                (x[j], free[j]) = (0.0, false);
            }
        }
    }
}

/// Least squares over the chosen columns by modified Gram-Schmidt with the target as one more column; `None` where one of them is
/// a sum of others.
fn least_squares(columns: &[Vec<f64>], chosen: &[usize], target: &[f64]) -> Option<Vec<f64>> {
    let count = chosen.len();
    let mut directions: Vec<Vec<f64>> = chosen.iter().map(|&j| columns[j].clone()).collect();
    let mut rest = target.to_vec();
    let mut triangle = vec![vec![0.0; count]; count];
    let mut right = vec![0.0; count];
    for i in 0..count {
        let (done, later) = directions.split_at_mut(i + 1);
        let direction = &mut done[i];
        let length = norm(direction);
        // Written so that NaN ends here as well.
        let independent = length > DEPENDENT * norm(&columns[chosen[i]]);
        if !independent {
            return None;
        }
        direction.iter_mut().for_each(|x| *x /= length);
        triangle[i][i] = length;
        for (j, other) in later.iter_mut().enumerate() {
            let product = dot(direction, other);
            triangle[i][i + 1 + j] = product;
            add_scaled(other, -product, direction);
        }
        right[i] = dot(direction, &rest);
        add_scaled(&mut rest, -right[i], direction);
    }
    for i in (0..count).rev() {
        let known = dot(&triangle[i][i + 1..], &right[i + 1..]);
        right[i] = (right[i] - known) / triangle[i][i];
    }
    Some(right)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::uniform;

    /// Columns and a target of random numbers in -0.5..0.5.
    fn problem(seed: u64, rows: u64, count: u64) -> (Vec<Vec<f64>>, Vec<f64>) {
        let column = |j| (0..rows).map(|i| uniform(seed, i, j) - 0.5).collect();
        ((0..count).map(column).collect(), column(count))
    }

    fn residual(columns: &[Vec<f64>], x: &[f64], target: &[f64]) -> Vec<f64> {
        let mut rest = target.to_vec();
        columns.iter().zip(x).for_each(|(column, &x)| add_scaled(&mut rest, -x, column));
        rest
    }

    #[test]
    fn the_answer_is_optimal() {
        let mut bound = 0;
        for seed in 0..200 {
            let (columns, target) = problem(seed, 20, 1 + seed % 16);
            let x = non_negative_least_squares(&columns, &target);
            let rest = residual(&columns, &x, &target);
            for (column, &x) in columns.iter().zip(&x) {
                // The conditions of Karush, Kuhn and Tucker.
                let gain = dot(column, &rest);
                assert!(x >= 0.0 && gain < 1e-12 && (x == 0.0 || gain > -1e-12), "{seed} {x} {gain:e}");
                bound += usize::from(x == 0.0);
            }
        }
        assert!(bound > 300, "{bound}");
    }

    #[test]
    fn a_known_sum_is_found_again() {
        for seed in 0..50 {
            let (columns, _) = problem(1000 + seed, 18, 12);
            let known: Vec<f64> = (0..12).map(|j| (uniform(seed, j, 99) - 0.4).max(0.0)).collect();
            let target: Vec<f64> = residual(&columns, &known, &[0.0; 18]).iter().map(|x| -x).collect();
            let x = non_negative_least_squares(&columns, &target);
            assert!(x.iter().zip(&known).all(|(x, known)| (x - known).abs() < 1e-11), "{seed}: {x:?}");
        }
    }

    #[test]
    fn degenerate_problems_have_an_answer() {
        assert!(non_negative_least_squares(&[], &[1.0]).is_empty());
        // Twice the same column, one of zeros, one that points away.
        let columns = vec![vec![1.0, 1.0], vec![1.0, 1.0], vec![0.0, 0.0], vec![-1.0, 0.0]];
        let x = non_negative_least_squares(&columns, &[2.0, 2.0]);
        assert!((x[0] + x[1] - 2.0).abs() < 1e-12 && x[2] == 0.0 && x[3] == 0.0, "{x:?}");
        assert_eq!(non_negative_least_squares(&columns, &[0.0, 0.0]), [0.0; 4]);
        let nothing = non_negative_least_squares(&columns[3..], &[1.0, 5.0]);
        assert_eq!(nothing, [0.0]);
        assert_eq!(non_negative_least_squares(&columns, &[f64::NAN, 1.0]).len(), 4);
    }
}
