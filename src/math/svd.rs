//! The dominant left singular vectors of a dense matrix, with the same bits on every processor.
//!
//! Greedy orthogonalisation first reduces the matrix to as many rows as it has numerical rank, then one-sided Jacobi rotations
//! make the reduced rows orthogonal. Nothing is squared, so small singular values keep an absolute accuracy of about 1e-15
//! of the largest, where the eigenvectors of a Gram matrix would stop at 1e-8. Every sum has a fixed order.

/// Left singular vectors and singular values, in descending order of the values.
#[derive(Clone, Debug, PartialEq)]
pub struct LeftSingular {
    /// Orthonormal vectors as long as a column; the largest component of each is positive.
    pub vectors: Vec<Vec<f64>>,
    /// Their singular values, positive.
    pub values: Vec<f64>,
}

/// Remaining columns below this fraction of the largest are rounding.
const NEGLIGIBLE: f64 = 1e-14;

/// Rotations of rows more orthogonal than this (cosine) are skipped.
const ORTHOGONAL: f64 = 1e-15;

/// Jacobi converges quadratically; more sweeps than this are never needed.
const MOST_SWEEPS: usize = 30;

/// Steps beyond those asked for, which the greedy choice needs to hold the wanted subspace.
const EXTRA_STEPS: usize = 16;

/// Sum of products in interleaved partial sums, a power of two, so that the order is fixed and does not wait for every addition.
#[inline(always)]
pub(crate) fn dot<const LANES: usize>(a: &[f64], b: &[f64]) -> f64 {
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
    let mut partial = [0.0; LANES];
    for (x, y) in a.iter().zip(b) {
        for lane in 0..LANES {
            partial[lane] += x[lane] * y[lane];
        }
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(x, y)| x * y).sum();
    let mut half = LANES / 2;
    while half > 0 {
        (0..half).for_each(|lane| partial[lane] += partial[lane + half]);
        half /= 2;
    }
    partial[0] + rest
}

/// `a += factor b`.
pub(super) fn add_scaled(a: &mut [f64], factor: f64, b: &[f64]) {
    for (x, y) in a.iter_mut().zip(b) {
        *x += factor * y;
    }
}

/// At most `most` dominant left singular vectors of the matrix with these columns, all of one length and finite; fewer where
/// the numerical rank is lower.
pub fn left_singular(mut columns: Vec<Vec<f64>>, most: usize) -> LeftSingular {
    let (mut vectors, mut rows) = reduce(&mut columns, 2 * most + EXTRA_STEPS);
    rotate(&mut vectors, &mut rows);
    let norms: Vec<f64> = rows.iter().map(|row| dot::<4>(row, row).sqrt()).collect();
    let mut order: Vec<usize> = (0..norms.len()).collect();
    order.sort_by(|&i, &j| norms[j].total_cmp(&norms[i]).then(i.cmp(&j)));
    let largest = order.first().map_or(0.0, |&i| norms[i]);
    order.retain(|&i| norms[i] > NEGLIGIBLE * largest);
    order.truncate(most);
    let values = order.iter().map(|&i| norms[i]).collect();
    let vectors = order.iter().map(|&i| with_sign(std::mem::take(&mut vectors[i]))).collect();
    LeftSingular { vectors, values }
}

/// Gram-Schmidt with the longest remaining column as pivot: orthonormal vectors Q and the rows of Q^T A.
fn reduce(columns: &mut [Vec<f64>], steps: usize) -> (Vec<Vec<f64>>, Vec<Vec<f64>>) {
    let (mut vectors, mut rows): (Vec<Vec<f64>>, Vec<Vec<f64>>) = (Vec::new(), Vec::new());
    let mut first_length = 0.0_f64;
    for _ in 0..steps.min(columns.first().map_or(0, Vec::len)) {
        let squares = columns.iter().map(|column| dot::<4>(column, column));
        let longest = squares.enumerate().reduce(|best, next| if next.1 > best.1 { next } else { best });
        let Some((pivot, square)) = longest else { break };
        let length = square.sqrt();
        first_length = first_length.max(length);
        if length <= NEGLIGIBLE * first_length {
            break;
        }
        let vector = beside(columns[pivot].clone(), &vectors);
        let row = columns.iter_mut().map(|column| {
            let along = dot::<4>(&vector, column);
            add_scaled(column, -along, &vector);
            along
        });
        rows.push(row.collect());
        vectors.push(vector);
    }
    (vectors, rows)
}

/// The part of a vector that is orthogonal to others, of length 1.
fn beside(mut vector: Vec<f64>, others: &[Vec<f64>]) -> Vec<f64> {
    // Twice: what is left of the others grows when a short vector is normalised.
    for _ in 0..2 {
        for other in others {
            let along = dot::<4>(other, &vector);
            add_scaled(&mut vector, -along, other);
        }
        let length = dot::<4>(&vector, &vector).sqrt();
        vector.iter_mut().for_each(|x| *x /= length);
    }
    vector
}

/// Rotates pairs of rows until all are orthogonal, and the vectors with them (Hestenes 1958).
fn rotate(vectors: &mut [Vec<f64>], rows: &mut [Vec<f64>]) {
    for _ in 0..MOST_SWEEPS {
        let mut rotated = false;
        for i in 0..rows.len() {
            for j in i + 1..rows.len() {
                let (a, b) = (dot::<4>(&rows[i], &rows[i]), dot::<4>(&rows[j], &rows[j]));
                let mixed = dot::<4>(&rows[i], &rows[j]);
                if mixed.abs() <= ORTHOGONAL * (a * b).sqrt() {
                    continue;
                }
                rotated = true;
                let ratio = (b - a) / (2.0 * mixed);
                let tangent = ratio.signum() / (ratio.abs() + (1.0 + ratio * ratio).sqrt());
                let cosine = 1.0 / (1.0 + tangent * tangent).sqrt();
                for pairs in [&mut *rows, &mut *vectors] {
                    let (head, tail) = pairs.split_at_mut(j);
                    for (x, y) in head[i].iter_mut().zip(&mut tail[0]) {
                        (*x, *y) = (cosine * (*x - tangent * *y), cosine * (*y + tangent * *x));
                    }
                }
            }
        }
        if !rotated {
            return;
        }
    }
}

/// The vector or its negative, so that the first of its largest components is positive.
pub(super) fn with_sign(mut vector: Vec<f64>) -> Vec<f64> {
    let largest = vector.iter().fold(0.0_f64, |best, &x| if x.abs() > best.abs() { x } else { best });
    if largest < 0.0 {
        vector.iter_mut().for_each(|x| *x = -*x);
    }
    vector
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::uniform;

    /// A matrix with these singular values and random singular vectors.
    fn matrix(values: &[f64], rows: usize, columns: usize) -> (Vec<Vec<f64>>, Vec<Vec<f64>>) {
        let orthonormal = |stage: u64, length: usize| -> Vec<Vec<f64>> {
            let mut vectors: Vec<Vec<f64>> = Vec::new();
            for i in 0..values.len() as u64 {
                let vector = (0..length as u64).map(|j| uniform(stage, i, j) - 0.5).collect();
                vectors.push(beside(vector, &vectors));
            }
            vectors
        };
        let (left, right) = (orthonormal(1, rows), orthonormal(2, columns));
        let entry = |i: usize, j: usize| -> f64 {
            values.iter().zip(&left).zip(&right).map(|((value, u), v)| value * u[i] * v[j]).sum()
        };
        ((0..columns).map(|j| (0..rows).map(|i| entry(i, j)).collect()).collect(), left)
    }

    #[test]
    fn known_singular_vectors_come_back_down_to_small_values() {
        let values: Vec<f64> = (0..12).map(|k| 10.0_f64.powi(-k)).collect();
        let (columns, left) = matrix(&values, 60, 200);
        let found = left_singular(columns, 12);
        assert_eq!(found.values.len(), 12);
        for (k, value) in values.iter().enumerate() {
            assert!((found.values[k] - value).abs() < 1e-14, "{k} {:e}", found.values[k]);
            // Rounding of the entries turns a vector by about 1e-16 over its value.
            let along = dot::<4>(&found.vectors[k], &left[k]).abs();
            assert!(1.0 - along < 1e-12 + 1e-30 / (value * value), "{k} {along}");
        }
    }

    #[test]
    fn vectors_are_orthonormal_with_a_positive_largest_component() {
        let columns: Vec<Vec<f64>> = (0..90).map(|j| (0..40).map(|i| uniform(9, i, j) - 0.3).collect()).collect();
        let found = left_singular(columns.clone(), 40);
        assert_eq!(found.vectors.len(), 40);
        for (i, a) in found.vectors.iter().enumerate() {
            for (j, b) in found.vectors.iter().enumerate() {
                assert!((dot::<4>(a, b) - f64::from(u8::from(i == j))).abs() < 1e-13, "{i} {j}");
            }
            let largest = a.iter().fold(0.0_f64, |best, x| if x.abs() > best.abs() { *x } else { best });
            assert!(largest > 0.0);
        }
        let squares: f64 = columns.iter().map(|column| dot::<4>(column, column)).sum();
        assert!((found.values.iter().map(|value| value * value).sum::<f64>() / squares - 1.0).abs() < 1e-13);
        assert!(found.values.windows(2).all(|pair| pair[0] >= pair[1]));
        assert_eq!(left_singular(columns, 40), found);
    }

    #[test]
    fn rank_and_wish_limit_the_number_of_vectors() {
        let (columns, _) = matrix(&[3.0, 2.0, 1.0], 30, 50);
        assert_eq!(left_singular(columns.clone(), 2).values.len(), 2);
        assert_eq!(left_singular(columns, 10).values.len(), 3);
        assert!(left_singular(vec![vec![0.0; 5]; 4], 3).vectors.is_empty());
        assert!(left_singular(Vec::new(), 3).vectors.is_empty());
        assert!(left_singular(vec![Vec::new(); 3], 3).vectors.is_empty());
    }
}
