//! A multigrid cycle for M + t S: a preconditioner.
//!
//! Coarser grids are aggregates of about four rows, paired twice by the strongest negative values (Notay 2010); smoothing divides by
//! the sums of absolute values of each row, which is stable for any symmetric matrix, obtuse triangles included. The next finer grid
//! visits each twice, so that the number of iterations hardly grows with the number of rows; once where that would cost more than the
//! finer grid itself. A part that is down to one row is solved by the smoother and left out of coarser grids.

use super::{Row, SymmetricMatrix, TOGETHER, for_rows};

/// Share of the step of a smoother; below 2 it is stable.
const RELAXED: f64 = 1.33;

/// Sweeps on the coarsest grid.
const SWEEPS: usize = 8;

/// Rows of the coarsest grid, about.
const FEW: usize = 16;

/// A coarser grid that has more than this share of the rows is not worth its visit, and more than this not worth two.
const WORTHWHILE: f64 = 0.9;
const WORTH_TWO: f64 = 0.4;

/// No aggregate.
const NONE: u32 = u32::MAX;

/// Aggregates of a mass and a stiffness, for any t.
#[derive(Clone, Debug, Default)]
pub struct Grids(Vec<Grid>);

#[derive(Clone, Debug)]
struct Grid {
    mass: Vec<f64>,
    stiffness: SymmetricMatrix,
    /// Aggregate of each row of the next finer grid; [`NONE`] for a part of one row.
    of_finer: Vec<u32>,
}

impl Grids {
    /// Aggregates the rows of a positive mass and a positive semi-definite stiffness.
    pub fn new(mass: &[f64], stiffness: &SymmetricMatrix) -> Self {
        let mut grids: Vec<Grid> = Vec::new();
        loop {
            let (mass, finer) = grids.last().map_or((mass, stiffness), |grid| (&grid.mass, &grid.stiffness));
            if finer.rows() <= FEW {
                break;
            }
            let (once, count) = paired(finer, true);
            let half = aggregated(finer, &once, count);
            let (twice, count) = paired(&half, false);
            if count == 0 || count as f64 > WORTHWHILE * finer.rows() as f64 {
                break;
            }
            let stiffness = aggregated(&half, &twice, count);
            let of_finer: Vec<u32> =
                once.iter().map(|pair| twice.get(*pair as usize).copied().unwrap_or(NONE)).collect();
            let mut sums = vec![0.0; count];
            for (aggregate, mass) in of_finer.iter().zip(mass).filter(|(aggregate, _)| **aggregate != NONE) {
                sums[*aggregate as usize] += mass;
            }
            grids.push(Grid { mass: sums, stiffness, of_finer });
        }
        Self(grids)
    }

    /// The cycle at a `t`, above the matrix itself.
    pub(super) fn cycle<'a>(&'a self, mass: &'a [f64], stiffness: &'a SymmetricMatrix, t: f64) -> Cycle<'a> {
        let finest = Operator::new(mass, stiffness, t, self.0.first().map(|grid| grid.of_finer.as_slice()));
        let aggregates = self.0.iter().skip(1).map(|grid| Some(grid.of_finer.as_slice())).chain([None]);
        let coarser = self.0.iter().zip(aggregates).map(|(grid, to)| Operator::new(&grid.mass, &grid.stiffness, t, to));
        let operators: Vec<Operator> = std::iter::once(finest).chain(coarser).collect();
        let work = operators.iter().map(|operator| Work::new(operator.mass.len())).collect();
        Cycle { operators, work }
    }
}

/// Pairs of rows by their strongest negative values, and the number of pairs and unpaired rows. Rows without values beside the
/// diagonal may be left out.
fn paired(matrix: &SymmetricMatrix, leave_out: bool) -> (Vec<u32>, usize) {
    let mut pair = vec![NONE; matrix.rows()];
    let mut count = 0;
    for row in 0..matrix.rows() {
        if pair[row] != NONE || (leave_out && matrix.row(row).next().is_none()) {
            continue;
        }
        let free = matrix.row(row).filter(|(column, value)| *value < 0.0 && pair[*column as usize] == NONE);
        let strongest = free.min_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
        pair[row] = count;
        if let Some((column, _)) = strongest {
            pair[column as usize] = count;
        }
        count += 1;
    }
    (pair, count as usize)
}

/// The matrix of aggregates.
fn aggregated(matrix: &SymmetricMatrix, aggregate: &[u32], count: usize) -> SymmetricMatrix {
    let mut diagonal = vec![0.0; count];
    let mut pairs = Vec::new();
    for (row, &own) in aggregate.iter().enumerate().filter(|(_, own)| **own != NONE) {
        diagonal[own as usize] += matrix.diagonal()[row];
        for (column, value) in matrix.row(row) {
            let other = aggregate[column as usize];
            if other == own {
                diagonal[own as usize] += value;
            } else if row < column as usize {
                pairs.push((own, other, value));
            }
        }
    }
    SymmetricMatrix::new(diagonal, &pairs)
}

/// M + t S on one grid.
struct Operator<'a> {
    mass: &'a [f64],
    stiffness: &'a SymmetricMatrix,
    t: f64,
    /// Reciprocals of the sums of absolute values.
    inverse: Vec<f64>,
    /// Aggregate of each row, unless this is the coarsest grid.
    aggregate: Option<&'a [u32]>,
}

impl<'a> Operator<'a> {
    fn new(mass: &'a [f64], stiffness: &'a SymmetricMatrix, t: f64, aggregate: Option<&'a [u32]>) -> Self {
        let of_row = |(row, mass): (usize, &f64)| {
            let beside: f64 = stiffness.row(row).map(|(_, value)| value.abs()).sum();
            1.0 / (mass + t * (stiffness.diagonal()[row].abs() + beside)).max(f64::MIN_POSITIVE)
        };
        let inverse = mass.iter().enumerate().map(of_row).collect();
        Self { mass, stiffness, t, inverse, aggregate }
    }

    fn residual(&self, row: usize, right: &Row, x: &[Row]) -> Row {
        let product = self.stiffness.row_product(row, x);
        std::array::from_fn(|n| right[n] - (self.mass[row] * x[row][n] + self.t * product[n]))
    }
}

/// Vectors of one grid.
struct Work {
    right: Vec<Row>,
    x: Vec<Row>,
    other: Vec<Row>,
    first: Vec<Row>,
}

impl Work {
    fn new(rows: usize) -> Self {
        let zero = || vec![[0.0; TOGETHER]; rows];
        Self { right: zero(), x: zero(), other: zero(), first: zero() }
    }
}

/// A symmetric positive definite approximation of the inverse of M + t S.
pub(super) struct Cycle<'a> {
    operators: Vec<Operator<'a>>,
    work: Vec<Work>,
}

impl Cycle<'_> {
    /// About the solution for a right-hand side.
    pub(super) fn apply(&mut self, right: &[Row]) -> &[Row] {
        self.work[0].right.copy_from_slice(right);
        visit(&self.operators, &mut self.work);
        &self.work[0].x
    }
}

fn visit(operators: &[Operator], work: &mut [Work]) {
    let (Some(operator), Some((own, coarser))) = (operators.first(), work.split_first_mut()) else { return };
    let smooth = |Work { right, x, other, .. }: &mut Work, step: f64| {
        for_rows(other, |row, out| {
            let residual = operator.residual(row, &right[row], x);
            *out = std::array::from_fn(|n| x[row][n] + step * operator.inverse[row] * residual[n]);
        });
        std::mem::swap(x, other);
    };
    let first_step = if operator.aggregate.is_some() { RELAXED } else { 1.0 };
    for_rows(&mut own.x, |row, x| *x = own.right[row].map(|r| first_step * operator.inverse[row] * r));
    let Some(aggregate) = operator.aggregate else {
        (1..SWEEPS).for_each(|_| smooth(own, 1.0));
        return;
    };
    for_rows(&mut own.other, |row, out| *out = operator.residual(row, &own.right[row], &own.x));
    coarser[0].right.fill([0.0; TOGETHER]);
    for (aggregate, residual) in aggregate.iter().zip(&own.other).filter(|(aggregate, _)| **aggregate != NONE) {
        let sum = &mut coarser[0].right[*aggregate as usize];
        (0..TOGETHER).for_each(|n| sum[n] += residual[n]);
    }
    visit(&operators[1..], coarser);
    let finer = own.x.len() as f64;
    if operators.len() > 2 && coarser[0].x.len() as f64 <= WORTH_TWO * finer {
        let next = &mut coarser[0];
        next.first.copy_from_slice(&next.x);
        let Work { right, x, .. } = next;
        for_rows(&mut next.other, |row, out| *out = operators[1].residual(row, &right[row], x));
        std::mem::swap(&mut next.right, &mut next.other);
        visit(&operators[1..], coarser);
        let Work { x, first, .. } = &mut coarser[0];
        x.iter_mut().zip(&*first).for_each(|(x, first)| (0..TOGETHER).for_each(|n| x[n] += first[n]));
    }
    let corrections = &coarser[0].x;
    for_rows(&mut own.x, |row, x| {
        if let Some(correction) = corrections.get(aggregate[row] as usize) {
            (0..TOGETHER).for_each(|n| x[n] += correction[n]);
        }
    });
    smooth(own, RELAXED);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::sparse::resolvent::solve;

    /// Two rings of 2,000 rows, and pairs and single rows beside them that soon cannot be joined any more.
    #[test]
    fn parts_of_any_size_beside_each_other_are_solved() {
        let (ring, small) = (2000u32, 60_000u32);
        let mut pairs: Vec<(u32, u32, f64)> = Vec::new();
        for first in [0, ring] {
            pairs.extend((0..ring).map(|i| (first + i, first + (i + 1) % ring, -1.0)));
        }
        pairs.extend((0..small / 3).map(|i| (2 * ring + 3 * i, 2 * ring + 3 * i + 1, -2.0)));
        let rows = (2 * ring + small) as usize;
        let mut diagonal = vec![0.0; rows];
        for (i, j, value) in &pairs {
            diagonal[*i as usize] -= value;
            diagonal[*j as usize] -= value;
        }
        let matrix = SymmetricMatrix::new(diagonal, &pairs);
        let mass: Vec<f64> = (0..rows).map(|i| 0.5 + (i % 3) as f64).collect();
        let grids = Grids::new(&mass, &matrix);
        // A visit of all grids costs a few products with the matrix.
        let (mut visits, mut cost, mut finer) = (1.0, 0.0, rows as f64);
        for grid in &grids.0 {
            let own = grid.mass.len() as f64;
            visits *= if own <= WORTH_TWO * finer { 2.0 } else { 1.0 };
            (cost, finer) = (cost + visits * own, own);
        }
        assert!(cost < 6.0 * rows as f64, "{} products", cost / rows as f64);
        let b: Vec<Row> = (0..rows).map(|i| [(i % 7) as f64, (i % 1000) as f64, 1.0]).collect();
        let mut x = vec![[0.0; TOGETHER]; rows];
        let t = 1e5;
        let solved = solve((&mass, &matrix, &grids), t, &b, &mut x, 1e-9);
        assert!(solved.iterations < 60, "{solved:?}");
        for row in 0..rows {
            let product = matrix.row_product(row, &x);
            for n in 0..TOGETHER {
                let (found, wanted) = (mass[row] * x[row][n] + t * product[n], mass[row] * b[row][n]);
                // Right-hand sides are up to 2,500.
                assert!((found - wanted).abs() < 0.01, "{row} {n}: {found} {wanted}");
            }
        }
    }
}
