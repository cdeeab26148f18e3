//! A multigrid cycle for M + t S: a preconditioner.
//!
//! Coarser grids are aggregates of about four rows, paired twice by the strongest negative values (Notay 2010); smoothing divides by
//! the sums of absolute values of each row, which is stable for any symmetric matrix, obtuse triangles included. Each grid is
//! visited twice by the next finer one, so that the number of iterations hardly grows with the number of rows.

use rayon::prelude::*;

use super::{ROWS, Row, SymmetricMatrix, TOGETHER};

/// Share of the step of a smoother; below 2 it is stable.
const RELAXED: f64 = 1.33;

/// Sweeps on the coarsest grid.
const SWEEPS: usize = 8;

/// Rows of the coarsest grid, about.
const FEW: usize = 16;

/// A coarser grid that has more than this share of the rows is not worth its visits.
const WORTHWHILE: f64 = 0.8;

/// Aggregates of a mass and a stiffness, for any t.
#[derive(Clone, Debug, Default)]
pub struct Grids(Vec<Grid>);

#[derive(Clone, Debug)]
struct Grid {
    mass: Vec<f64>,
    stiffness: SymmetricMatrix,
    /// Aggregate of each row of the next finer grid.
    of_finer: Vec<u32>,
}

impl Grids {
    /// Of a positive mass and a positive semi-definite stiffness.
    pub fn new(mass: &[f64], stiffness: &SymmetricMatrix) -> Self {
        let mut grids: Vec<Grid> = Vec::new();
        loop {
            let (mass, finer) = grids.last().map_or((mass, stiffness), |grid| (&grid.mass, &grid.stiffness));
            if finer.rows() <= FEW {
                break;
            }
            let (once, count) = paired(finer);
            let half = aggregated(finer, &once, count);
            let (twice, count) = paired(&half);
            if count as f64 > WORTHWHILE * finer.rows() as f64 {
                break;
            }
            let stiffness = aggregated(&half, &twice, count);
            let of_finer: Vec<u32> = once.iter().map(|pair| twice[*pair as usize]).collect();
            let mut sums = vec![0.0; count];
            of_finer.iter().zip(mass).for_each(|(aggregate, mass)| sums[*aggregate as usize] += mass);
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

/// Pairs of rows by their strongest negative values, and the number of pairs and single rows.
fn paired(matrix: &SymmetricMatrix) -> (Vec<u32>, usize) {
    const NONE: u32 = u32::MAX;
    let mut pair = vec![NONE; matrix.rows()];
    let mut count = 0;
    for row in 0..matrix.rows() {
        if pair[row] != NONE {
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
    for (row, &own) in aggregate.iter().enumerate() {
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

/// Writes every row, side by side where there are many.
fn for_rows(out: &mut [Row], of: impl Fn(usize, &mut Row) + Sync) {
    if out.len() <= ROWS {
        out.iter_mut().enumerate().for_each(|(row, out)| of(row, out));
    } else {
        out.par_chunks_mut(ROWS).enumerate().for_each(|(chunk, out)| {
            out.iter_mut().enumerate().for_each(|(i, out)| of(chunk * ROWS + i, out));
        });
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
    for (aggregate, residual) in aggregate.iter().zip(&own.other) {
        let sum = &mut coarser[0].right[*aggregate as usize];
        (0..TOGETHER).for_each(|n| sum[n] += residual[n]);
    }
    visit(&operators[1..], coarser);
    if operators.len() > 2 {
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
        let correction = &corrections[aggregate[row] as usize];
        (0..TOGETHER).for_each(|n| x[n] += correction[n]);
    });
    smooth(own, RELAXED);
}
