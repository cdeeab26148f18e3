//! The leading eigenpairs of dense positive semi-definite matrices, as many as hold all but a given part of the trace.
//!
//! Krylov spaces of the matrix in blocks of eight vectors, fully orthogonalised (block Lanczos, Golub & Van Loan 2013, 10.3.6): the
//! Ritz values are lower bounds, so that the trace less their sum bounds what is left out. Where a tenth of the pairs is needed, as
//! of smooth radiosity under many lights, that takes a sixteenth of the time of all pairs (142 of 1600, on one thread).

use super::eigen::{Eigen, symmetric_eigen};
use super::random::uniform;
use super::simd::{InstructionSet, multiversion};
use super::sparse::blocks::{self, Row, Small, WIDTH};
use super::svd::with_sign;
use crate::error::Result;
use crate::parallel::*;

/// Orders up to which all pairs are found, and the share of the order above which that is faster.
const SMALL: usize = 192;
const MOST_SHARE: f64 = 0.5;

/// Dimension of the Krylov space over the order when it is first looked at, and from look to look.
const FIRST_LOOK: f64 = 0.08;
const NEXT_LOOK: f64 = 1.5;

/// Pairs over the dimension of the Krylov space, at most: the last Ritz pairs of a space have not converged.
const CONVERGED: f64 = 0.7;

/// Stage number of the random numbers that start the Krylov space.
const STAGE: u64 = 0x6c65_6164;

/// Rows of one task, and that are multiplied together.
const TASK: usize = 32;
const TOGETHER: usize = 4;

/// What is left of a vector beside the others of its block, over its length, below which it is made orthogonal to the blocks before once more,
/// and how often at most: rounding that was nothing in the vector is much in what is left of it, and of matrices of low rank soon all there is.
const LEFT: f64 = 1e-3;
const MOST_AGAIN: usize = 3;

/// Leading eigenpairs, and the rest of the trace.
#[derive(Clone, Debug, PartialEq)]
pub struct Leading {
    /// The pairs; of those that have not converged, the Ritz pairs.
    pub pairs: Eigen,
    /// Trace less the sum of the values.
    pub omitted: f64,
}

/// The fewest leading eigenpairs, at least one and at most `most`, of the positive semi-definite matrix whose lower triangle is
/// that of `matrix` (`order * order` numbers row by row), whose values leave `left_out` or less of the trace; one or two per cent
/// more than the fewest, a quarter more where the values hardly fall. The same bits on any number of threads.
///
/// # Errors
/// Those of [`symmetric_eigen`].
pub fn leading_eigen(matrix: &[f64], order: usize, most: usize, left_out: f64) -> Result<Leading> {
    if order <= SMALL || matrix.len() != order * order || matrix.iter().any(|x| !x.is_finite()) {
        return Ok(cut(symmetric_eigen(matrix, order)?, 0.0, most, left_out));
    }
    let mut full = vec![0.0; matrix.len()];
    full.par_chunks_mut(order).enumerate().for_each(|(i, row)| {
        row[..=i].copy_from_slice(&matrix[i * order..=i * order + i]);
        (i + 1..order).for_each(|j| row[j] = matrix[j * order + i]);
    });
    let trace: f64 = (0..order).map(|i| full[i * order + i]).sum();
    let random = |row: usize| std::array::from_fn(|i| uniform(STAGE, row as u64, i as u64) - 0.5);
    let mut start: Vec<Row> = (0..order).map(random).collect();
    blocks::orthonormalise(&mut start);
    let (mut basis, mut projected) = (vec![start], Vec::<Vec<Small>>::new());
    let mut look = FIRST_LOOK * order as f64;
    loop {
        let mut next = product(&full, &basis[basis.len() - 1]);
        let slices: Vec<&[Row]> = basis.iter().map(Vec::as_slice).collect();
        projected.push(blocks::orthogonalise(&slices, &mut next));
        let mut rest = blocks::orthonormalise(&mut next);
        for _ in 0..MOST_AGAIN {
            if !is_nearly_dependent(&rest) {
                break;
            }
            blocks::orthogonalise(&slices, &mut next);
            rest = blocks::orthonormalise(&mut next);
        }
        let dimension = basis.len() * WIDTH;
        let ended = rest.iter().enumerate().all(|(i, row)| row[i] == 0.0);
        if ended || dimension as f64 >= look {
            let ritz = symmetric_eigen(&blocks::assembled(&projected), dimension)?;
            let converged = if ended { dimension } else { (CONVERGED * dimension as f64) as usize };
            let found: f64 = ritz.values[..converged.min(most)].iter().sum();
            let beyond = if ended { 0.0 } else { (trace - ritz.values.iter().sum::<f64>()).max(0.0) };
            if ended || trace - found <= left_out || converged >= most {
                let Leading { pairs: Eigen { values, vectors }, omitted } = cut(ritz, beyond, most, left_out);
                let combined = blocks::combined(&slices, &vectors);
                let of = |pair: usize| with_sign(combined[pair / WIDTH].iter().map(|row| row[pair % WIDTH]).collect());
                let vectors = (0..values.len()).into_par_iter().map(of).collect();
                return Ok(Leading { pairs: Eigen { values, vectors }, omitted });
            }
            look = dimension as f64 * NEXT_LOOK;
            if look > MOST_SHARE * order as f64 {
                return Ok(cut(symmetric_eigen(matrix, order)?, 0.0, most, left_out));
            }
        }
        basis.push(next);
    }
}

/// True if little is left of a vector of a block beside the others, given the upper triangle of [`blocks::orthonormalise`].
fn is_nearly_dependent(rest: &Small) -> bool {
    let length = |c: usize| rest[..=c].iter().map(|row| row[c] * row[c]).sum::<f64>().sqrt();
    (0..WIDTH).any(|c| rest[c][c] > 0.0 && rest[c][c] < LEFT * length(c))
}

/// Leaves out the last pairs, of which at least one stays, until the rest would be more than `left_out`; `beyond` is left out
/// already.
fn cut(eigen: Eigen, beyond: f64, most: usize, left_out: f64) -> Leading {
    let Eigen { mut values, mut vectors } = eigen;
    let mut count = values.len().min(most.max(1));
    let mut omitted = beyond + values[count..].iter().map(|value| value.max(0.0)).sum::<f64>();
    while count > 1 && omitted + values[count - 1].max(0.0) <= left_out {
        count -= 1;
        omitted += values[count].max(0.0);
    }
    values.truncate(count);
    vectors.truncate(count);
    Leading { pairs: Eigen { values, vectors }, omitted }
}

/// A symmetric matrix times a block.
fn product(matrix: &[f64], block: &[Row]) -> Vec<Row> {
    let order = block.len();
    let level = InstructionSet::detect();
    let mut out = vec![[0.0; WIDTH]; order];
    out.par_chunks_mut(TASK).zip(matrix.par_chunks(TASK * order)).for_each(|(out, rows)| {
        multiply(level, rows, block, out);
    });
    out
}

#[inline(always)]
fn multiply_body(rows: &[f64], block: &[Row], out: &mut [Row]) {
    let order = block.len();
    for (out, rows) in out.chunks_mut(TOGETHER).zip(rows.chunks(TOGETHER * order)) {
        let mut sums = [[0.0; WIDTH]; TOGETHER];
        // Rows that are missing from the last ones are those of the first, for nothing.
        let [a, b, c, d] = std::array::from_fn(|i| rows.get(i * order..(i + 1) * order).unwrap_or(&rows[..order]));
        for ((((a, b), c), d), values) in a.iter().zip(b).zip(c).zip(d).zip(block) {
            for (sums, x) in sums.iter_mut().zip([a, b, c, d]) {
                add(sums, *x, values);
            }
        }
        out.copy_from_slice(&sums[..out.len()]);
    }
}

#[inline(always)]
fn add(sums: &mut Row, x: f64, values: &Row) {
    for lane in 0..WIDTH {
        sums[lane] += x * values[lane];
    }
}

multiversion! {
    /// `out = rows block`.
    fn multiply(rows: &[f64], block: &[Row], out: &mut [Row]) => multiply_body
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// Products of `rank` smooth random functions whose energy falls by a factor.
    fn falling(order: usize, rank: usize, factor: f64) -> Vec<f64> {
        let function = |f: usize, i: usize| factor.powi(f as i32) * (uniform(7, f as u64, i as u64) - 0.5);
        let rows: Vec<Vec<f64>> = (0..order).map(|i| (0..rank).map(|f| function(f, i)).collect()).collect();
        let mut matrix = vec![f64::NAN; order * order];
        for i in 0..order {
            for j in 0..order {
                // The upper triangle is not looked at.
                let product: f64 = rows[i].iter().zip(&rows[j]).map(|(a, b)| a * b).sum();
                matrix[i * order + j] = if j <= i { product } else { 1e9 };
            }
        }
        matrix
    }

    #[test]
    fn what_is_left_out_is_as_asked_and_the_pairs_are_next_to_the_fewest() {
        for (order, rank, factor) in
            [(100, 100, 0.8), (300, 300, 0.9), (501, 400, 0.95), (400, 30, 1.0), (193, 193, 1.0)]
        {
            let matrix = falling(order, rank, factor);
            let all = symmetric_eigen(&matrix, order).unwrap();
            let trace: f64 = all.values.iter().sum();
            for share in [0.5, 1e-2, 1e-5, 0.0] {
                let Leading { pairs, omitted } = leading_eigen(&matrix, order, order, share * trace).unwrap();
                let fewest = cut(all.clone(), 0.0, order, share * trace).pairs.values.len();
                let count = pairs.values.len();
                assert!(omitted <= share * trace + 1e-12 * trace || count == order, "{order} {share}: {omitted}");
                let most = fewest + fewest.div_ceil(if factor < 1.0 { 50 } else { 4 });
                assert!(
                    share == 0.0 || (fewest..=most).contains(&count),
                    "{order} {share}: {count}, {fewest} are needed"
                );
                for (a, vector) in pairs.vectors.iter().enumerate() {
                    for (b, other) in pairs.vectors.iter().enumerate() {
                        let product: f64 = vector.iter().zip(other).map(|(x, y)| x * y).sum();
                        assert!((product - f64::from(u8::from(a == b))).abs() < 1e-10);
                    }
                }
                // Ritz values are lower bounds.
                for (value, exact) in pairs.values.iter().zip(&all.values).take(count / 2) {
                    let range = if factor < 1.0 { 0.98 } else { 0.9 } * exact - 1e-12 * trace..=exact + 1e-12 * trace;
                    assert!(range.contains(value), "{order} {share}: {value} {exact}");
                }
            }
            let few = leading_eigen(&matrix, order, 3, 0.0).unwrap().pairs;
            assert_eq!((few.values.len(), few.vectors.len(), few.vectors[2].len()), (3, 3, order));
        }
    }

    /// As of light on a body of few flat faces: six functions, three of the same energy and two, and next to nothing else.
    #[test]
    fn pairs_of_matrices_of_low_rank_are_orthonormal() {
        for (order, rank, level) in
            [(300, 12, 1e-10), (300, 20, 1e-10), (600, 12, 1e-4), (600, 40, 1e-10), (729, 7, 1e-10)]
        {
            let mut energies = vec![0.76, 0.064, 0.064, 0.064, 0.022, 0.022];
            energies.extend((6..rank).map(|f| level * 0.7f64.powi(f - 6)));
            let function = |f: usize, i: usize| uniform(11, f as u64, i as u64) - 0.5;
            let mut matrix = vec![0.0; order * order];
            for i in 0..order {
                for j in 0..=i {
                    let products = energies.iter().enumerate().map(|(f, e)| e * function(f, i) * function(f, j));
                    matrix[i * order + j] = products.sum::<f64>();
                }
            }
            let trace: f64 = (0..order).map(|i| matrix[i * order + i]).sum();
            let Leading { pairs, omitted } = leading_eigen(&matrix, order, order, 1e-3 * trace).unwrap();
            assert!(pairs.values.len() <= 6 && omitted <= 1e-3 * trace, "{order} {rank}: {omitted}");
            for (a, vector) in pairs.vectors.iter().enumerate() {
                for (b, other) in pairs.vectors.iter().enumerate() {
                    let product: f64 = vector.iter().zip(other).map(|(x, y)| x * y).sum();
                    assert!((product - f64::from(u8::from(a == b))).abs() < 1e-10, "{order} {rank}: {a} {b} {product}");
                }
            }
        }
    }

    #[test]
    fn bits_do_not_depend_on_threads_and_nothing_is_nothing() {
        let matrix = falling(300, 300, 0.9);
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| leading_eigen(&matrix, 300, 300, 1e-6).unwrap())
        };
        assert!(run(1) == run(3));
        let dark = leading_eigen(&vec![0.0; 250 * 250], 250, 10, 0.0).unwrap();
        assert_eq!((dark.pairs.values[0], dark.omitted), (0.0, 0.0));
        assert!(leading_eigen(&[1.0; 5], 2, 2, 0.0).is_err());
        assert!(leading_eigen(&vec![f64::NAN; 300 * 300], 300, 2, 0.0).is_err());
    }
}
