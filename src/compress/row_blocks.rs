//! Rows of neighbouring patches together: the Haar transform over the tree of a block of patches.
//!
//! Wang et al. 2008 (section 3.3) transform their visibility vectors over the surface as well. Neighbouring patches see
//! nearly the same of a light, so that the differences of their rows are small, and most of them are dropped. In a
//! block of n numbers the first becomes their mean; each piece, halved as [`translux_format::rows::blocks`] halves,
//! stores the mean of its left half less that of the right one at the first place of the right one. Dropping such a
//! difference never changes the mean of a block. Both ways are linear, so that a reader multiplies the transformed rows
//! with a light and transforms the products back.

use std::ops::{Add, Range, Sub};

use glam::DVec3;

/// Start of the right half of a piece of `count` numbers.
fn middle(count: usize) -> usize {
    count.div_ceil(2)
}

/// Transforms rows of `stride` numbers each, all of one block, in place.
pub fn forward(rows: &mut [f32], stride: usize) {
    let count = rows.len().checked_div(stride).unwrap_or(0);
    if count <= 1 {
        return;
    }
    let half = middle(count);
    let (left, right) = rows.split_at_mut(half * stride);
    forward(left, stride);
    forward(right, stride);
    let (a, b) = (half as f32 / count as f32, (count - half) as f32 / count as f32);
    for (left, right) in left.iter_mut().zip(right).take(stride) {
        let (mean, difference) = (a * *left + b * *right, *left - *right);
        (*left, *right) = (mean, difference);
    }
}

/// Undoes [`forward`] for one number of each row.
pub fn inverse(values: &mut [DVec3]) {
    undo(values, 1, |share, value| share * value);
}

/// Undoes [`forward`] for rows of `stride` numbers each.
pub fn inverse_rows(rows: &mut [f32], stride: usize) {
    undo(rows, stride, |share, value| share as f32 * value);
}

fn undo<T: Copy + Add<Output = T> + Sub<Output = T>>(
    rows: &mut [T],
    stride: usize,
    times: impl Fn(f64, T) -> T + Copy,
) {
    let count = rows.len().checked_div(stride).unwrap_or(0);
    if count <= 1 {
        return;
    }
    let half = middle(count);
    let (left, right) = rows.split_at_mut(half * stride);
    let (up, down) = ((count - half) as f64 / count as f64, half as f64 / count as f64);
    for (left, right) in left.iter_mut().zip(&mut *right).take(stride) {
        let (mean, difference) = (*left, *right);
        (*left, *right) = (mean + times(up, difference), mean - times(down, difference));
    }
    undo(left, stride, times);
    undo(right, stride, times);
}

/// Weight of each row of a block of `count`: the contribution of the square of one of its coefficients to the sum of
/// the squares of all patches.
pub fn weights(count: usize) -> Vec<f32> {
    let mut result = vec![0.0; count];
    if let Some(first) = result.first_mut() {
        *first = count as f32;
    }
    fill_weights(0..count, &mut result);
    result
}

fn fill_weights(piece: Range<usize>, weights: &mut [f32]) {
    let count = piece.len();
    if count <= 1 {
        return;
    }
    let half = piece.start + middle(count);
    if let Some(weight) = weights.get_mut(half) {
        *weight = ((half - piece.start) * (piece.end - half)) as f32 / count as f32;
    }
    fill_weights(piece.start..half, weights);
    fill_weights(half..piece.end, weights);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::uniform;

    fn block(count: usize) -> Vec<DVec3> {
        let number = |i: usize, c| uniform(7, i as u64, c);
        (0..count).map(|i| DVec3::new(number(i, 0), number(i, 1), number(i, 2))).collect()
    }

    fn transformed(values: &[DVec3]) -> Vec<DVec3> {
        let mut rows: Vec<f32> = values.iter().flat_map(|v| v.as_vec3().to_array()).collect();
        forward(&mut rows, 3);
        rows.as_chunks::<3>().0.iter().map(|row| DVec3::from(row.map(f64::from))).collect()
    }

    #[test]
    fn back_and_forth_is_the_identity_at_any_length() {
        for count in [0, 1, 2, 3, 5, 7, 33, 48, 64] {
            let values = block(count);
            let mut rows = transformed(&values);
            if count > 0 {
                let mean = values.iter().sum::<DVec3>() / count as f64;
                assert!((rows[0] - mean).length() < 1e-6);
            }
            inverse(&mut rows);
            for (a, b) in rows.iter().zip(&values) {
                assert!((*a - *b).length() < 1e-6, "{count}: {a} {b}");
            }
            let mut rows: Vec<f32> = values.iter().flat_map(|v| v.as_vec3().to_array()).collect();
            forward(&mut rows, 3);
            inverse_rows(&mut rows, 3);
            for (a, b) in rows.as_chunks::<3>().0.iter().zip(&values) {
                assert!((DVec3::from(a.map(f64::from)) - *b).length() < 1e-6, "{count}: {a:?} {b}");
            }
        }
    }

    #[test]
    fn three_values_by_hand() {
        let rows = transformed(&[1.0, 3.0, 8.0].map(DVec3::splat));
        assert_eq!(rows.iter().map(|row| row.x).collect::<Vec<_>>(), [4.0, -2.0, -6.0]);
        assert_eq!(weights(3), [3.0, 0.5, 2.0 / 3.0]);
    }

    /// Parseval: the weighted squares sum to the squares of the values.
    #[test]
    fn weights_keep_the_sum_of_the_squares() {
        for count in [1, 2, 3, 11, 64] {
            let values = block(count);
            let rows = transformed(&values);
            let before: f64 = values.iter().map(|v| v.x * v.x).sum();
            let after: f64 = rows.iter().zip(weights(count)).map(|(v, w)| f64::from(w) * v.x * v.x).sum();
            assert!((after / before - 1.0).abs() < 1e-5, "{count}: {after} {before}");
        }
        assert!(weights(0).is_empty());
    }

    #[test]
    fn what_is_dropped_leaves_the_mean() {
        let mut rows = transformed(&block(21));
        rows[5..].fill(DVec3::ZERO);
        let mean = rows[0];
        inverse(&mut rows);
        assert!((rows.iter().sum::<DVec3>() / 21.0 - mean).length() < 1e-12);
    }
}
