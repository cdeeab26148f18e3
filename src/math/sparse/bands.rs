//! The lowest eigenpairs of a sparse positive semi-definite matrix, band by band.
//!
//! Each band has a shift in its middle; Krylov spaces of the inverse of the shifted matrix are built in blocks, fully
//! orthogonalised, so that eigenvalues of a multiplicity as large as a block are found (spheres have them). Vectors of
//! the band before are taken out, so that no pair is found twice. The inertia of the factors at the edges of a band
//! gives its number of pairs: none is missed.
//!
//! faer's partial eigensolver takes one vector at a time through a Gram-Schmidt of all others (9.2 s for 300 pairs of
//! 15,000 rows) and hangs where a shift meets an eigenvalue; blocks keep their sums in registers, and a shift that
//! fails is moved.

use super::SymmetricMatrix;
use super::blocks::{self, Row, WIDTH};
use super::factorisation::{Factors, Symbolic};
use crate::error::{Error, Result};
use crate::math::eigen::symmetric_eigen;
use crate::math::random::uniform;
use crate::progress::Progress;

/// Pairs of a band, about.
const PAIRS: usize = 120;

/// Pairs of a band at most; a guess of its edge that gives more is halved.
const MOST_PAIRS: usize = 180;

/// Rows up to which the matrix is diagonalised as a dense one.
const DENSE: usize = 400;

/// Residual over the largest eigenvalue asked for, at which a pair has converged.
const TOLERANCE: f64 = 1e-11;

/// Dimension of a Krylov space over the number of pairs asked of it when it is first looked at, and from look to look.
const FIRST_LOOK: f64 = 2.0;
const NEXT_LOOK: f64 = 0.3;

/// Dimension of a Krylov space at most, over the number of pairs; then a new one starts beside the pairs found.
const MOST_DIMENSION: f64 = 5.0;

/// Blocks that a Krylov space may have however few pairs are asked of it: the last pair of a band converges slowly where the
/// first beyond it is near, and a new space begins from nothing.
const LEAST_BLOCKS: usize = 24;

/// Krylov spaces of a band at most: every one adds pairs unless the arithmetic has failed.
const MOST_SPACES: usize = 64;

/// Stage number of the random numbers that start Krylov spaces.
const STAGE: u64 = 0x6c61_706c;

/// Eigenpairs with ascending eigenvalues.
#[derive(Clone, Debug, Default)]
pub struct Band {
    /// Eigenvalues, ascending.
    pub values: Vec<f64>,
    /// Orthonormal vectors in blocks of eight, row by row; those beyond the number of values are 0.
    blocks: Vec<Vec<Row>>,
}

impl Band {
    /// A component of an eigenvector.
    pub fn component(&self, pair: usize, row: usize) -> f64 {
        self.blocks[pair / WIDTH][row][pair % WIDTH]
    }

    /// Scalar products of the vectors with three columns that are stored row by row.
    pub fn coefficients(&self, columns: &[[f64; 3]]) -> Vec<[f64; 3]> {
        let wide: Vec<Row> = columns.iter().map(|c| std::array::from_fn(|i| *c.get(i).unwrap_or(&0.0))).collect();
        let slices: Vec<&[Row]> = self.blocks.iter().map(Vec::as_slice).collect();
        let products = blocks::products(&slices, &wide);
        let of = |pair: usize| std::array::from_fn(|c| products[pair / WIDTH][pair % WIDTH][c]);
        (0..self.values.len()).map(of).collect()
    }
}

/// Number and accuracy of the eigenpairs that were found.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Found {
    /// Number of pairs, which is that of the inertia.
    pub pairs: usize,
    /// Largest `|A v - lambda v|` over the largest eigenvalue asked for.
    pub residual: f64,
    /// Largest scalar product of two vectors of a band or of neighbouring bands, or error of a squared length.
    pub orthogonality: f64,
}

impl Found {
    /// The sum of the pairs and the larger of each error.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            pairs: self.pairs + other.pairs,
            residual: self.residual.max(other.residual),
            orthogonality: self.orthogonality.max(other.orthogonality),
        }
    }
}

/// Visits every eigenpair below a limit, in bands with ascending eigenvalues. Progress advances by the pairs.
///
/// # Errors
/// Those of `visit`; run time: no memory, or pairs that do not converge.
pub fn for_each_band(
    matrix: &SymmetricMatrix,
    below: f64,
    progress: &dyn Progress,
    mut visit: impl FnMut(&Band) -> Result<()>,
) -> Result<Found> {
    if matrix.rows() == 0 || below.is_nan() || below <= 0.0 {
        return Ok(Found::default());
    }
    if matrix.rows() <= DENSE {
        let band = dense(matrix, below)?;
        progress.advance(band.values.len() as u64);
        visit(&band)?;
        return Ok(checked(matrix, &band, None, below));
    }
    let symbolic = Symbolic::new(matrix)?;
    let total = robust(&symbolic, below, below)?.1.below;
    let mut found = Found::default();
    let (mut before, mut low) = (Band::default(), -below * 1e-3);
    let mut at = 0;
    while at < total {
        let (high, upto) = edge(&symbolic, (low.max(0.0), at), (below, total))?;
        let band = one_band(matrix, &symbolic, (low, high, below), upto - at, &before)?;
        found = found.and(checked(matrix, &band, Some(&before), below));
        progress.advance((upto - at) as u64);
        visit(&band)?;
        (before, low, at) = (band, high, upto);
    }
    Ok(found)
}

/// The upper edge of the band that begins at `low` with pair `at`, and the number of pairs below it.
fn edge(symbolic: &Symbolic, (low, at): (f64, usize), (below, total): (f64, usize)) -> Result<(f64, usize)> {
    if total - at <= MOST_PAIRS {
        return Ok((below, total));
    }
    // By Weyl's law the eigenvalues of a surface are spread evenly.
    let mut width = (below - low) * PAIRS as f64 / (total - at) as f64;
    let mut least = 0.0;
    for _ in 0..60 {
        let (high, factors) = robust(symbolic, low + width, below)?;
        let upto = factors.below;
        let pairs = upto.saturating_sub(at);
        if pairs > MOST_PAIRS {
            width = 0.5 * (least + width);
        } else if pairs < PAIRS / 3 {
            (least, width) = (width, (width * 1.5).min(below - low));
        } else {
            return Ok((high, upto));
        }
    }
    // A cluster of more pairs than a band should have: it is one band all the same.
    let (high, factors) = robust(symbolic, (low + 2.0 * width).min(below), below)?;
    Ok((high, factors.below.max(at + 1)))
}

/// Factors at a shift, or very near it where a pivot vanishes there.
fn robust(symbolic: &Symbolic, shift: f64, scale: f64) -> Result<(f64, Factors<'_>)> {
    for trial in 0..8 {
        let moved = shift + scale * 1e-9 * f64::from(trial) * if trial % 2 == 0 { 1.0 } else { -1.0 };
        if let Some(factors) = symbolic.shifted(moved) {
            return Ok((moved, factors));
        }
    }
    Err(Error::runtime("the shifted Laplacian has no factors near any shift; the mesh has no sound areas"))
}

fn slices(band: &[Vec<Row>]) -> Vec<&[Row]> {
    band.iter().map(Vec::as_slice).collect()
}

/// The `wanted` pairs between two edges.
fn one_band(
    matrix: &SymmetricMatrix,
    symbolic: &Symbolic,
    (low, high, scale): (f64, f64, f64),
    wanted: usize,
    before: &Band,
) -> Result<Band> {
    let (shift, factors) = robust(symbolic, 0.5 * (low + high), scale)?;
    let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
    let mut found: Vec<Vec<Row>> = Vec::new();
    for space in 0..MOST_SPACES {
        let missing = wanted - pairs.len();
        if missing == 0 {
            break;
        }
        let locked: Vec<&[Row]> = before.blocks.iter().chain(&found).map(Vec::as_slice).collect();
        let (values, vectors) = krylov(matrix, (&factors, shift), (low, high, scale), missing, &locked, space)?;
        let base = found.len();
        pairs.extend(values.iter().enumerate().take(missing).map(|(i, v)| (*v, base + i / WIDTH, i % WIDTH)));
        found.extend(vectors);
    }
    if pairs.len() < wanted {
        let there = pairs.len();
        return Err(Error::runtime(format!(
            "{there} of {wanted} eigenpairs between {low:.3e} and {high:.3e} converged"
        )));
    }
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut sorted = vec![vec![[0.0; WIDTH]; matrix.rows()]; wanted.div_ceil(WIDTH)];
    for (new, &(_, block, column)) in pairs.iter().enumerate() {
        let from = &found[block];
        sorted[new / WIDTH].iter_mut().zip(from).for_each(|(to, from)| to[new % WIDTH] = from[column]);
    }
    Ok(Band { values: pairs.iter().map(|p| p.0).collect(), blocks: sorted })
}

/// Pairs between the edges that one Krylov space holds, at most `wanted`, nearest the shift first; their vectors in blocks.
fn krylov(
    matrix: &SymmetricMatrix,
    (factors, shift): (&Factors, f64),
    (low, high, scale): (f64, f64, f64),
    wanted: usize,
    locked: &[&[Row]],
    space: usize,
) -> Result<(Vec<f64>, Vec<Vec<Row>>)> {
    let rows = matrix.rows();
    let random = |row: usize| std::array::from_fn(|i| uniform(STAGE, (row * WIDTH + i) as u64, space as u64) - 0.5);
    let mut start: Vec<Row> = (0..rows).map(random).collect();
    blocks::orthogonalise(locked, &mut start);
    blocks::orthonormalise(&mut start);
    let mut basis: Vec<Vec<Row>> = vec![start];
    let mut projected: Vec<Vec<blocks::Small>> = Vec::new();
    let room = rows.saturating_sub(locked.len() * WIDTH) / WIDTH;
    let most = ((MOST_DIMENSION * wanted as f64) as usize / WIDTH + 6).max(LEAST_BLOCKS).min(room.max(1));
    let mut look = ((FIRST_LOOK * wanted as f64) as usize / WIDTH + 2).min(most);
    loop {
        let mut next = solved(factors, &basis[basis.len() - 1])?;
        blocks::orthogonalise(locked, &mut next);
        let shares = blocks::orthogonalise(&slices(&basis), &mut next);
        blocks::orthogonalise(locked, &mut next);
        let rest = blocks::orthonormalise(&mut next);
        projected.push(shares);
        let ended = rest.iter().enumerate().all(|(i, r)| r[i] == 0.0) || basis.len() >= most;
        if basis.len() >= look || ended {
            let (values, vectors, missing) = ritz(&projected, rest, shift, (low, high, scale), wanted)?;
            if ended || missing == 0 {
                return Ok((values, blocks::combined(&slices(&basis), &vectors)));
            }
            look = basis.len() + ((NEXT_LOOK * wanted as f64) as usize / WIDTH).max(2);
        }
        basis.push(next);
    }
}

/// The shifted inverse times a block.
fn solved(factors: &Factors, block: &[Row]) -> Result<Vec<Row>> {
    let rows = block.len();
    let mut columns = vec![0.0; rows * WIDTH];
    for (row, values) in block.iter().enumerate() {
        for (column, value) in values.iter().enumerate() {
            columns[column * rows + row] = *value;
        }
    }
    factors.solve(&mut columns)?;
    Ok((0..rows).map(|row| std::array::from_fn(|column| columns[column * rows + row])).collect())
}

/// Converged eigenvalues between the edges, the combinations of the basis that are their vectors, and how many are still missing.
fn ritz(
    projected: &[Vec<blocks::Small>],
    rest: blocks::Small,
    shift: f64,
    (low, high, scale): (f64, f64, f64),
    wanted: usize,
) -> Result<(Vec<f64>, Vec<Vec<f64>>, usize)> {
    let order = projected.len() * WIDTH;
    let dense = blocks::assembled(projected);
    let eigen = symmetric_eigen(&dense, order)?;
    let slack = 1e-9 * scale;
    let last = order - WIDTH;
    let mut found = Vec::new();
    for (theta, vector) in eigen.values.iter().zip(&eigen.vectors) {
        let value = shift + 1.0 / theta;
        if *theta == 0.0 || !(low - slack..high + slack).contains(&value) {
            continue;
        }
        // |(A - shift)| of what the space lacks: the residual of the inverse over the eigenvalue's square.
        let lacking: f64 = (0..WIDTH)
            .map(|i| (0..WIDTH).map(|j| rest[i][j] * vector[last + j]).sum::<f64>().powi(2))
            .sum::<f64>()
            .sqrt();
        if lacking / theta.abs() * (value - shift).abs().max(0.01 * scale) <= TOLERANCE * scale {
            found.push((value, vector));
        }
    }
    found.sort_by(|a, b| (a.0 - shift).abs().total_cmp(&(b.0 - shift).abs()));
    found.truncate(wanted);
    let missing = wanted - found.len();
    Ok((found.iter().map(|f| f.0).collect(), found.into_iter().map(|f| f.1.clone()).collect(), missing))
}

/// All pairs of a small matrix.
fn dense(matrix: &SymmetricMatrix, below: f64) -> Result<Band> {
    let rows = matrix.rows();
    let mut full = vec![0.0; rows * rows];
    for row in 0..rows {
        full[row * rows + row] = matrix.diagonal()[row];
        matrix.row(row).for_each(|(column, value)| full[row * rows + column as usize] = value);
    }
    let eigen = symmetric_eigen(&full, rows)?;
    let chosen: Vec<usize> = (0..rows).rev().filter(|&i| eigen.values[i] < below).collect();
    let mut blocks = vec![vec![[0.0; WIDTH]; rows]; chosen.len().div_ceil(WIDTH)];
    for (new, &old) in chosen.iter().enumerate() {
        for (row, value) in eigen.vectors[old].iter().enumerate() {
            blocks[new / WIDTH][row][new % WIDTH] = *value;
        }
    }
    Ok(Band { values: chosen.iter().map(|&i| eigen.values[i]).collect(), blocks })
}

/// Residual and orthogonality of a band.
fn checked(matrix: &SymmetricMatrix, band: &Band, before: Option<&Band>, scale: f64) -> Found {
    let own = slices(&band.blocks);
    let mut orthogonality = 0f64;
    for (b, block) in own.iter().enumerate() {
        for (a, small) in blocks::products(&own, block).iter().enumerate() {
            for (i, row) in small.iter().enumerate() {
                for (j, value) in row.iter().enumerate() {
                    let (r, c) = (a * WIDTH + i, b * WIDTH + j);
                    if r.max(c) < band.values.len() {
                        orthogonality = orthogonality.max((value - f64::from(u8::from(r == c))).abs());
                    }
                }
            }
        }
        let others = before.map_or(Vec::new(), |before| slices(&before.blocks));
        let between = blocks::products(&others, block);
        orthogonality = between.iter().flatten().flatten().fold(orthogonality, |most, v| most.max(v.abs()));
    }
    let mut residual = 0f64;
    let mut product = vec![[0.0; WIDTH]; matrix.rows()];
    for (b, block) in band.blocks.iter().enumerate() {
        matrix.product(block, &mut product);
        let values: Row = std::array::from_fn(|i| *band.values.get(b * WIDTH + i).unwrap_or(&0.0));
        let squares = super::sum_over_rows(matrix.rows(), |run| {
            let mut sum = [0.0; WIDTH];
            for row in run {
                for i in 0..WIDTH {
                    sum[i] += (product[row][i] - values[i] * block[row][i]).powi(2);
                }
            }
            sum
        });
        residual = squares.iter().fold(residual, |most, square| most.max(square.sqrt() / scale));
    }
    Found { pairs: band.values.len(), residual, orthogonality }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::Silent;

    /// A grid on a flat torus: eigenvalues are sums of those of two rings, most of them fourfold or eightfold where both are
    /// alike.
    fn torus(side: u32) -> SymmetricMatrix {
        uneven_torus(side, 1.0)
    }

    /// The springs along y have another stiffness.
    fn uneven_torus(side: u32, stiffness: f64) -> SymmetricMatrix {
        let at = |x: u32, y: u32| (x % side) + (y % side) * side;
        let mut pairs = Vec::new();
        for y in 0..side {
            for x in 0..side {
                pairs.extend([(at(x, y), at(x + 1, y), -1.0), (at(x, y), at(x, y + 1), -stiffness)]);
            }
        }
        SymmetricMatrix::new(vec![2.0 + 2.0 * stiffness; (side * side) as usize], &pairs)
    }

    fn expected(side: u32, below: f64) -> Vec<f64> {
        expected_of_uneven(side, 1.0, below)
    }

    fn expected_of_uneven(side: u32, stiffness: f64, below: f64) -> Vec<f64> {
        let ring = |k: u32| 2.0 - 2.0 * (std::f64::consts::TAU * f64::from(k) / f64::from(side)).cos();
        let mut all: Vec<f64> = (0..side).flat_map(|a| (0..side).map(move |b| ring(a) + stiffness * ring(b))).collect();
        all.retain(|v| *v < below);
        all.sort_by(f64::total_cmp);
        all
    }

    fn all(matrix: &SymmetricMatrix, below: f64) -> (Vec<f64>, Found) {
        let mut values = Vec::new();
        let found = for_each_band(matrix, below, &Silent, |band| {
            values.extend(&band.values);
            Ok(())
        });
        (values, found.unwrap())
    }

    #[test]
    fn no_pair_of_a_torus_is_missed() {
        for (side, below) in [(60, 0.83), (17, 1.0), (18, 9.0), (30, 1.5)] {
            let (values, found) = all(&torus(side), below);
            let expected = expected(side, below);
            assert_eq!((values.len(), found.pairs), (expected.len(), expected.len()), "{side}");
            for (value, expected) in values.iter().zip(&expected) {
                assert!((value - expected).abs() < 1e-9, "{side}: {value} {expected}");
            }
            assert!(found.residual < 1e-9 && found.orthogonality < 1e-10, "{found:?}");
        }
    }

    /// Wherever the limit falls between eigenvalues that are a few per cent apart.
    #[test]
    fn few_pairs_converge_beside_near_ones() {
        let matrix = uneven_torus(21, 1.07);
        let expected = expected_of_uneven(21, 1.07, 1.6);
        let gaps = expected.windows(2).enumerate().filter(|(_, pair)| pair[1] - pair[0] > 1e-4);
        let mut limits = 0;
        for (last, pair) in gaps {
            for share in [0.1, 0.9] {
                let (values, found) = all(&matrix, pair[0] + share * (pair[1] - pair[0]));
                assert_eq!(values.len(), last + 1, "between {pair:?}");
                // Relative to a limit that may be a thousandth of the largest eigenvalue.
                assert!(found.residual < 1e-8 && found.orthogonality < 1e-10, "{found:?}");
                limits += 1;
            }
        }
        assert!(limits > 30, "{limits}");
    }

    #[test]
    fn coefficients_are_scalar_products_and_threads_do_not_change_a_bit() {
        let (matrix, below) = (torus(40), 0.3);
        let columns: Vec<[f64; 3]> = (0..matrix.rows()).map(|i| [1.0, (i % 7) as f64, (i % 40) as f64]).collect();
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut all = Vec::new();
            pool.install(|| {
                for_each_band(&matrix, below, &Silent, |band| {
                    for (pair, c) in band.coefficients(&columns).into_iter().enumerate() {
                        let dot: f64 = (0..matrix.rows()).map(|row| band.component(pair, row) * columns[row][1]).sum();
                        assert!((c[1] - dot).abs() < 1e-9);
                        all.push(c);
                    }
                    Ok(())
                })
            })
            .unwrap();
            all
        };
        let first = run(1);
        assert_eq!(first.len(), expected(40, below).len());
        assert!(first == run(3));
    }

    #[test]
    fn nothing_below_nothing() {
        assert_eq!(all(&torus(40), 0.0), (vec![], Found::default()));
        assert_eq!(all(&SymmetricMatrix::default(), 1.0), (vec![], Found::default()));
        assert_eq!(all(&torus(40), 1e-9).0.len(), 1);
    }
}
