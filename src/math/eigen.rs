//! Eigenvalues and eigenvectors of dense symmetric matrices, with the same bits at any number of threads.
//!
//! Householder reflections make the matrix tridiagonal, implicit QL steps with Wilkinson's shift diagonalise that (Golub &
//! Van Loan 2013, 8.3). The reflections and rotations are kept and then applied to blocks of columns of the unit
//! matrix: each block stays in the nearest caches and waits for no other. Every sum has a fixed order.

use crate::error::{Error, Result};
use crate::math::simd::{InstructionSet, multiversion};
use crate::math::svd::{dot, with_sign};
use crate::parallel::*;

/// Largest order that is accepted.
pub const MOST_ORDER: usize = 4096;

/// Columns of the unit matrix that are transformed together.
const BLOCK: usize = 32;

/// Rows below which threads cost more than they save.
const FEW_ROWS: usize = 128;

/// Rows (of a matrix whose largest entry is about 1) shorter than this are taken as zero: their squares lose digits.
const NEGLIGIBLE: f64 = 1e-140;

/// QL steps for one eigenvalue at most; two are usual.
const MOST_STEPS: usize = 60;

/// Eigenvalues in descending order, with their vectors.
#[derive(Clone, Debug, PartialEq)]
pub struct Eigen {
    /// Eigenvalues, descending.
    pub values: Vec<f64>,
    /// Orthonormal eigenvectors, one for each value; the first of the largest components of each is positive.
    pub vectors: Vec<Vec<f64>>,
}

/// `I - v v^T` acting on the components from `first` on.
struct Reflection {
    first: usize,
    v: Vec<f64>,
}

/// Turns the rows `row` and `row + 1`: `(x, y) -> (c x - s y, s x + c y)`.
struct Rotation {
    row: usize,
    cosine: f64,
    sine: f64,
}

/// All eigenvalues and eigenvectors of the symmetric matrix whose lower triangle is that of `matrix`, `order * order`
/// numbers row by row. At order 1200, `A v - value v` is 1.4e-15 of the largest value and scalar products of two
/// vectors are 9e-15; it takes 1.0 s on one thread and 0.5 s on two, order 600 an eighth.
///
/// # Errors
/// Another number of entries, an order above [`MOST_ORDER`], or an entry that is not finite (exit 3); no
/// convergence (exit 4), which has not been seen.
pub fn symmetric_eigen(matrix: &[f64], order: usize) -> Result<Eigen> {
    if order > MOST_ORDER {
        return Err(Error::input(format!("eigenvectors of a matrix of order {order}: at most {MOST_ORDER}")));
    }
    if matrix.len() != order * order {
        return Err(Error::input(format!("{} entries for a square matrix of order {order}", matrix.len())));
    }
    if let Some(at) = matrix.iter().position(|x| !x.is_finite()) {
        return Err(Error::input(format!("entry ({}, {}) of the matrix is not finite", at / order, at % order)));
    }
    let largest = matrix.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    if largest == 0.0 {
        let unit = |i: usize| (0..order).map(|j| f64::from(u8::from(i == j))).collect();
        return Ok(Eigen { values: vec![0.0; order], vectors: (0..order).map(unit).collect() });
    }
    // A power of two, so that scaling rounds nothing: squares neither overflow nor vanish.
    let scale = (-largest.log2().floor()).clamp(-1000.0, 1000.0).exp2();
    let mut full = vec![0.0; matrix.len()];
    for i in 0..order {
        for j in 0..=i {
            let x = matrix[i * order + j] * scale;
            (full[i * order + j], full[j * order + i]) = (x, x);
        }
    }
    let (reflections, mut diagonal, mut beside) = tridiagonal(&mut full, order);
    let rotations = diagonalise(&mut diagonal, &mut beside)?;
    drop(full);
    let vectors = transformed(order, &reflections, &rotations);
    let mut sorted: Vec<usize> = (0..order).collect();
    sorted.sort_by(|&i, &j| diagonal[j].total_cmp(&diagonal[i]).then(i.cmp(&j)));
    let values = sorted.iter().map(|&i| diagonal[i] / scale).collect();
    let vectors = sorted.par_iter().map(|&i| vector(&vectors, order, i)).collect();
    Ok(Eigen { values, vectors })
}

/// Householder's reflections, and the diagonals of the tridiagonal matrix; `a` is used up. Both triangles are kept, so that
/// each row is changed and multiplied in one pass and rows do not wait for each other.
fn tridiagonal(a: &mut [f64], n: usize) -> (Vec<Reflection>, Vec<f64>, Vec<f64>) {
    let mut reflections = Vec::new();
    let (mut diagonal, mut beside) = (vec![0.0; n], vec![0.0; n]);
    let level = InstructionSet::detect();
    // What the reflection before still has to take from the rows below: v w^T + w v^T.
    let (mut v, mut w) = (vec![0.0; n], vec![0.0; n]);
    for k in 0..n {
        let (head, below) = a.split_at_mut((k + 1) * n);
        let row = &mut head[k * n + k..];
        take(row, (v[k], w[k]), (&v[k..], &w[k..]));
        diagonal[k] = row[0];
        let Some(second) = row.get(1) else { break };
        let length = dot::<8>(&row[1..], &row[1..]).sqrt();
        let reflects = length > NEGLIGIBLE && row[2..].iter().any(|x| *x != 0.0);
        let mut next = vec![0.0; n];
        if reflects {
            // v is scaled so that its square is 2; the sign avoids cancellation.
            let end = if *second > 0.0 { -length } else { length };
            let head = second - end;
            let size = (-end * head).abs().sqrt();
            next[k + 1] = head / size;
            next[k + 2..].iter_mut().zip(&row[2..]).for_each(|(v, x)| *v = x / size);
            beside[k] = end;
        } else {
            beside[k] = *second;
        }
        let mut product = vec![0.0; n];
        let (old, new) = ((&v[k + 1..], &w[k + 1..]), &next[k + 1..]);
        let update = |i: usize, (row, product): (&mut [f64], &mut f64)| {
            let row = &mut row[k + 1..];
            take_and_multiply(level, row, (old.0[i], old.1[i]), old, new, product);
        };
        if n - k - 1 < FEW_ROWS {
            below.chunks_exact_mut(n).zip(&mut product[k + 1..]).enumerate().for_each(|(i, pair)| update(i, pair));
        } else {
            let rows = below.par_chunks_mut(n).zip(&mut product[k + 1..]);
            rows.with_min_len(FEW_ROWS / 4).enumerate().for_each(|(i, pair)| update(i, pair));
        }
        // (I - v v^T) A (I - v v^T) = A - v w^T - w v^T with w = A v - (v^T A v / 2) v.
        let half = 0.5 * dot::<8>(new, &product[k + 1..]);
        let mut other = product;
        other.iter_mut().zip(&next).for_each(|(p, v)| *p -= half * v);
        if reflects {
            reflections.push(Reflection { first: k + 1, v: next[k + 1..].to_vec() });
        } else {
            other.fill(0.0);
        }
        (v, w) = (next, other);
    }
    (reflections, diagonal, beside)
}

/// `row -= a w + b v` for the vectors `(v, w)`.
#[inline(always)]
fn take(row: &mut [f64], (a, b): (f64, f64), (v, w): (&[f64], &[f64])) {
    for ((x, v), w) in row.iter_mut().zip(v).zip(w) {
        *x -= a * w + b * v;
    }
}

/// Implicit QL steps on a tridiagonal matrix (`beside[i]` between `i` and `i + 1`): the diagonal ends as the eigenvalues.
fn diagonalise(diagonal: &mut [f64], beside: &mut [f64]) -> Result<Vec<Rotation>> {
    let n = diagonal.len();
    let norm = diagonal.iter().zip(&*beside).fold(0.0_f64, |most, (d, e)| most.max(d.abs() + e.abs()));
    let mut rotations = Vec::with_capacity(n * n);
    for first in 0..n {
        for step in 0.. {
            let small = |i: usize| {
                let scale = diagonal[i].abs() + diagonal[i + 1].abs();
                // Relative to the neighbours alone, rounding among zero eigenvalues would never be small.
                beside[i].abs() <= f64::EPSILON * (scale + 0.25 * norm)
            };
            let end = (first..n - 1).find(|&i| small(i)).unwrap_or(n - 1);
            if end == first {
                break;
            }
            if step == MOST_STEPS {
                return Err(Error::runtime(format!("eigenvalue {first} of {n} did not converge")));
            }
            ql_step(diagonal, beside, (first, end), &mut rotations);
        }
    }
    Ok(rotations)
}

/// One step on the block `first..=end`.
fn ql_step(d: &mut [f64], e: &mut [f64], (first, end): (usize, usize), rotations: &mut Vec<Rotation>) {
    let ratio = (d[first + 1] - d[first]) / (2.0 * e[first]);
    let shifted = ratio + ratio.hypot(1.0).copysign(ratio);
    let mut g = d[end] - d[first] + e[first] / shifted;
    let (mut sine, mut cosine, mut moved) = (1.0, 1.0, 0.0);
    for i in (first..end).rev() {
        let (f, b) = (sine * e[i], cosine * e[i]);
        let length = f.hypot(g);
        e[i + 1] = length;
        if length == 0.0 {
            // The block falls apart here.
            d[i + 1] -= moved;
            e[end] = 0.0;
            return;
        }
        (sine, cosine) = (f / length, g / length);
        let rest = d[i + 1] - moved;
        let turned = (d[i] - rest) * sine + 2.0 * cosine * b;
        moved = sine * turned;
        d[i + 1] = rest + moved;
        g = cosine * turned - b;
        rotations.push(Rotation { row: i, cosine, sine });
    }
    d[first] -= moved;
    e[first] = g;
    e[end] = 0.0;
}

/// Reflections and rotations applied to the unit matrix: blocks of columns, each `order` rows of [`BLOCK`]; row `i` of all is
/// eigenvector `i`.
fn transformed(order: usize, reflections: &[Reflection], rotations: &[Rotation]) -> Vec<Vec<[f64; BLOCK]>> {
    let level = InstructionSet::detect();
    let block = |block: usize| {
        let mut rows = vec![[0.0; BLOCK]; order];
        let diagonal = rows.iter_mut().skip(block * BLOCK).enumerate().take(BLOCK);
        diagonal.for_each(|(i, row)| row[i] = 1.0);
        transform(level, &mut rows, reflections, rotations);
        rows
    };
    (0..order.div_ceil(BLOCK)).into_par_iter().map(block).collect()
}

/// Applies reflections, and then rotations, to rows.
#[inline(always)]
fn transform_body(rows: &mut [[f64; BLOCK]], reflections: &[Reflection], rotations: &[Rotation]) {
    for reflection in reflections {
        let rows = &mut rows[reflection.first..];
        let mut along = [0.0; BLOCK];
        for (row, v) in rows.iter().zip(&reflection.v) {
            along.iter_mut().zip(row).for_each(|(sum, x)| *sum += v * x);
        }
        for (row, v) in rows.iter_mut().zip(&reflection.v) {
            row.iter_mut().zip(&along).for_each(|(x, sum)| *x -= v * sum);
        }
    }
    for Rotation { row, cosine, sine } in rotations {
        if let [x, y] = &mut rows[*row..row + 2] {
            for (x, y) in x.iter_mut().zip(y) {
                (*x, *y) = (cosine * *x - sine * *y, sine * *x + cosine * *y);
            }
        }
    }
}

/// Takes the reflection before from a row, and multiplies what is left by the next one's vector.
#[inline(always)]
fn take_and_multiply_body(row: &mut [f64], of_row: (f64, f64), old: (&[f64], &[f64]), new: &[f64], product: &mut f64) {
    take(row, of_row, old);
    *product = dot::<8>(row, new);
}

multiversion! {
    /// [`transform_body`].
    fn transform(rows: &mut [[f64; BLOCK]], reflections: &[Reflection], rotations: &[Rotation]) => transform_body;
    /// [`take_and_multiply_body`].
    fn take_and_multiply(
        row: &mut [f64], of_row: (f64, f64), old: (&[f64], &[f64]), new: &[f64], product: &mut f64
    ) => take_and_multiply_body
}

/// Eigenvector `i`, or its negative.
fn vector(blocks: &[Vec<[f64; BLOCK]>], order: usize, i: usize) -> Vec<f64> {
    with_sign(blocks.iter().flat_map(|rows| rows[i]).take(order).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::uniform;

    fn symmetric(n: usize, entry: impl Fn(usize, usize) -> f64) -> Vec<f64> {
        (0..n * n).map(|at| entry((at / n).max(at % n), (at / n).min(at % n))).collect()
    }

    /// Largest entry of A V - V L and of V V^T - I, over the largest entry of A.
    fn defects(matrix: &[f64], found: &Eigen) -> (f64, f64) {
        let n = found.values.len();
        let scale = matrix.iter().fold(f64::MIN_POSITIVE, |most, x| most.max(x.abs()));
        let (mut residual, mut skew) = (0.0_f64, 0.0_f64);
        for (k, v) in found.vectors.iter().enumerate() {
            for i in 0..n {
                let product = dot::<8>(&matrix[i * n..(i + 1) * n], v);
                residual = residual.max((product - found.values[k] * v[i]).abs() / scale);
            }
            for (j, other) in found.vectors.iter().enumerate() {
                skew = skew.max((dot::<8>(v, other) - f64::from(u8::from(j == k))).abs());
            }
        }
        (residual, skew)
    }

    fn check(matrix: &[f64], n: usize) -> Eigen {
        let found = symmetric_eigen(matrix, n).unwrap();
        assert_eq!((found.values.len(), found.vectors.len()), (n, n));
        let (residual, skew) = defects(matrix, &found);
        assert!(residual < 1e-14 * (n as f64).max(4.0) && skew < 1e-13, "order {n}: {residual:e} {skew:e}");
        assert!(found.values.windows(2).all(|pair| pair[0] >= pair[1]));
        found
    }

    #[test]
    fn random_matrices_of_every_order() {
        for n in [0, 1, 2, 3, 4, 7, 8, 31, 32, 33, 65, 150, 300] {
            let matrix = symmetric(n, |i, j| uniform(1, i as u64, j as u64) - 0.5);
            let found = check(&matrix, n);
            let trace: f64 = (0..n).map(|i| matrix[i * n + i]).sum();
            assert!((found.values.iter().sum::<f64>() - trace).abs() < 1e-12);
            for vector in &found.vectors {
                let largest = vector.iter().fold(0.0_f64, |best, x| if x.abs() > best.abs() { *x } else { best });
                assert!(largest > 0.0);
            }
        }
    }

    /// The second difference on n points has the eigenvalues 2 - 2 cos(pi k / (n + 1)).
    #[test]
    fn known_eigenvalues_come_back() {
        let n = 200;
        let matrix = symmetric(n, |i, j| [2.0, -1.0].get(i - j).copied().unwrap_or(0.0));
        let found = check(&matrix, n);
        for (k, value) in found.values.iter().rev().enumerate() {
            let angle = std::f64::consts::PI * (k + 1) as f64 / (n + 1) as f64;
            assert!((value - 2.0 + 2.0 * angle.cos()).abs() < 1e-14 * 8.0, "{k} {value}");
        }
        let found = check(&symmetric(4, |i, j| f64::from(u8::from(i == j)) * [3.0, -1.0, 7.0, 3.0][i]), 4);
        assert_eq!(found.values, [7.0, 3.0, 3.0, -1.0]);
        assert_eq!(found.vectors[0], [0.0, 0.0, 1.0, 0.0]);
    }

    #[test]
    fn degenerate_matrices_are_safe() {
        let n = 60;
        check(&symmetric(n, |_, _| 0.0), n);
        check(&symmetric(n, |i, j| f64::from(u8::from(i == j))), n);
        let found = check(&symmetric(n, |_, _| 1.0), n);
        assert!((found.values[0] - 60.0).abs() < 1e-12 && found.values[1..].iter().all(|x| x.abs() < 1e-13));
        check(&symmetric(n, |i, j| 1.0 / (i + j + 1) as f64), n);
        // Sizes over 300 powers of ten, blocks that fall apart, the ends of the range.
        check(&symmetric(n, |i, j| 10.0_f64.powi(-5 * (i + j) as i32 / 2)), n);
        check(&symmetric(n, |i, j| if i / 7 == j / 7 { uniform(3, i as u64, j as u64) } else { 0.0 }), n);
        check(&symmetric(n, |i, j| (uniform(4, i as u64, j as u64) - 0.5) * 1e-300), n);
        check(&symmetric(n, |i, j| (uniform(5, i as u64, j as u64) - 0.5) * 1e305), n);
        let rows: Vec<Vec<f64>> = (0..n as u64).map(|i| (0..20).map(|k| uniform(6, i, k)).collect()).collect();
        let found = check(&symmetric(n, |i, j| dot::<8>(&rows[i], &rows[j])), n);
        assert!(found.values[19] > 1e-3 && found.values[20..].iter().all(|x| x.abs() < 1e-15 * found.values[0]));
    }

    #[test]
    fn bad_input_is_refused_and_only_the_lower_triangle_counts() {
        assert!(symmetric_eigen(&[1.0; 5], 2).is_err());
        assert!(symmetric_eigen(&[1.0, f64::NAN, 0.0, 1.0], 2).is_err());
        assert!(symmetric_eigen(&[], MOST_ORDER + 1).is_err());
        let found = symmetric_eigen(&[2.0, 1e9, 1.0, 2.0], 2).unwrap();
        assert!((found.values[0] - 3.0).abs() < 1e-15 && (found.values[1] - 1.0).abs() < 1e-15);
    }

    #[test]
    fn threads_do_not_matter() {
        let n = 333;
        let matrix = symmetric(n, |i, j| uniform(8, i as u64, j as u64) - 0.4);
        let many = symmetric_eigen(&matrix, n).unwrap();
        for threads in [1, 3] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            assert!(pool.install(|| symmetric_eigen(&matrix, n)).unwrap() == many);
        }
    }
}
