//! Rows coded by clusters: clustered principal components (Sloan, Hall, Hart & Snyder 2003), whose rows are the mean of their cluster
//! and a few of its directions with weights of their own; and the same with what is left coded as well.

use glam::DVec3;
use rayon::prelude::*;
use translux::compress::prediction::Net;
use translux::error::{Error, Result};
use translux::geometry::cluster;
use translux::geometry::scattered::OrientedPoint;
use translux::math::eigen::symmetric_eigen;
use translux_format::Tag;
use translux_format::coefficients::encode;

/// Clusters that a row may belong to: that of its place in the kd-tree, and those whose centres are nearest.
const CANDIDATES: usize = 16;

/// Energy along a direction over that along the first below which single precision leaves nothing but noise: such directions are
/// not at right angles to the others.
const NOISE: f64 = 1e-6;

/// Rounds of fitting and choosing again.
const ROUNDS: usize = 6;

/// As the coder of the asset rounds.
const ROUNDING: f32 = 0.42;

/// Share of what clusters leave out that rounding of weights may add, and that of means, directions and weights together.
const ROUNDED_WEIGHTS: f64 = 0.1;
const ROUNDED: f64 = 0.25;

/// Steps of means and directions over that of weights and differences; how near a squared error must be.
const OF_SUBSPACES: [f32; 2] = [1.0, 0.25];
const NEAR: f64 = 0.02;

/// Steps from zero to the largest number, at most: differences from what is predicted still fit 16 bits.
const MOST_STEPS: f64 = 12_000.0;

/// Steps that are tried for the latter, and the finest over that of the weights.
const TRIALS: usize = 7;
const FINEST: f64 = 1.0 / 64.0;

/// How rows are clustered; a row may leave the cluster of its place for one that fits better, which is stored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Shape {
    /// Rows of a cluster at first.
    pub(crate) members: usize,
    /// Principal directions of each.
    pub(crate) directions: usize,
}

impl Shape {
    pub(crate) fn words(&self) -> String {
        format!("{} a cluster, {} directions", self.members, self.directions)
    }
}

/// Rows that were coded.
pub(crate) struct Clustered {
    pub(crate) bytes: usize,
    /// What a reader makes of them, `[row][column]`.
    pub(crate) known: Vec<f32>,
}

/// Rows of numbers at places.
pub(crate) struct Rows<'a> {
    pub(crate) values: &'a [f32],
    pub(crate) columns: usize,
    pub(crate) places: &'a [DVec3],
}

/// Clusters of rows.
struct Clusters {
    /// Middles of the cells of the kd-tree, which a reader knows.
    centres: Vec<DVec3>,
    /// Clusters that each row may belong to, `[row][rank]`; a reader knows them.
    candidates: Vec<Vec<u32>>,
    rank: Vec<u32>,
    subspaces: Vec<Subspace>,
}

/// A mean, and directions that are as long as the RMS of the rows along them.
#[derive(Clone, Default)]
struct Subspace {
    mean: Vec<f32>,
    directions: Vec<Vec<f32>>,
}

fn dot(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// As [`Net::quantise`] does it.
fn rounded(value: f32) -> i16 {
    (value.abs() + ROUNDING).floor().min(f32::from(i16::MAX)).copysign(value) as i16
}

impl Subspace {
    /// Of some rows.
    fn of(rows: &[&[f32]], columns: usize, directions: usize) -> Result<Self> {
        let count = rows.len().max(1) as f32;
        let mut mean = vec![0.0f32; columns];
        rows.iter().for_each(|row| mean.iter_mut().zip(*row).for_each(|(sum, v)| *sum += v / count));
        if directions == 0 || rows.len() < 2 {
            return Ok(Self { mean, directions: vec![vec![0.0; columns]; directions] });
        }
        let centred: Vec<Vec<f32>> =
            rows.iter().map(|row| row.iter().zip(&mean).map(|(v, m)| v - m).collect()).collect();
        // Products of rows with rows have the same eigenvalues as those of columns with columns, and rows are fewer.
        let mut products = vec![0.0f64; rows.len() * rows.len()];
        for (i, a) in centred.iter().enumerate() {
            for (j, b) in centred.iter().enumerate().take(i + 1) {
                let product = f64::from(dot(a, b));
                products[i * rows.len() + j] = product;
                products[j * rows.len() + i] = product;
            }
        }
        let eigen = symmetric_eigen(&products, rows.len())?;
        let least = NOISE * eigen.values.first().copied().unwrap_or(0.0);
        let direction = |k: usize| {
            let mut sum = vec![0.0f32; columns];
            let (Some(vector), Some(&value)) = (eigen.vectors.get(k), eigen.values.get(k)) else { return sum };
            if value <= least {
                return sum;
            }
            for (row, weight) in centred.iter().zip(vector) {
                sum.iter_mut().zip(row).for_each(|(sum, v)| *sum += *weight as f32 * v);
            }
            sum.iter_mut().for_each(|v| *v /= count.sqrt());
            sum
        };
        Ok(Self { directions: (0..directions).map(direction).collect(), mean })
    }

    /// What it leaves of a row, squared.
    fn left(&self, row: &[f32]) -> f32 {
        let centred: Vec<f32> = row.iter().zip(&self.mean).map(|(v, m)| v - m).collect();
        let along = |d: &Vec<f32>| {
            let length = dot(d, d);
            if length > 0.0 { dot(&centred, d).powi(2) / length } else { 0.0 }
        };
        dot(&centred, &centred) - self.directions.iter().map(along).sum::<f32>()
    }
}

impl Clusters {
    fn new(rows: &Rows, shape: Shape) -> Result<Self> {
        let mut order: Vec<u32> = (0..rows.places.len() as u32).collect();
        let cells = cluster::groups(&mut order, rows.places, shape.members);
        let mut own = vec![0u32; rows.places.len()];
        let mut centres = Vec::with_capacity(cells.len());
        for (cell, run) in cells.iter().enumerate() {
            let members = &order[run.range()];
            members.iter().for_each(|&row| own[row as usize] = cell as u32);
            centres.push(members.iter().map(|&row| rows.places[row as usize]).sum::<DVec3>() / members.len() as f64);
        }
        let near = |(place, &own): (&DVec3, &u32)| {
            let others = (0..centres.len() as u32).filter(|&cell| cell != own);
            let mut by_distance: Vec<(f64, u32)> =
                others.map(|cell| (place.distance_squared(centres[cell as usize]), cell)).collect();
            by_distance.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            std::iter::once(own).chain(by_distance.iter().take(CANDIDATES - 1).map(|c| c.1)).collect()
        };
        let candidates: Vec<Vec<u32>> = rows.places.par_iter().zip(&own).map(near).collect();
        let rank = vec![0; rows.places.len()];
        let mut result = Self { subspaces: vec![Subspace::default(); centres.len()], centres, candidates, rank };
        result.fit(rows, shape)?;
        for _ in 0..ROUNDS {
            result.choose(rows);
            result.fit(rows, shape)?;
        }
        Ok(result)
    }

    fn of_row(&self, row: usize) -> usize {
        self.candidates[row][self.rank[row] as usize] as usize
    }

    fn fit(&mut self, rows: &Rows, shape: Shape) -> Result<()> {
        let mut members: Vec<Vec<&[f32]>> = vec![Vec::new(); self.centres.len()];
        for (index, row) in rows.values.chunks_exact(rows.columns).enumerate() {
            members[self.of_row(index)].push(row);
        }
        let fitted = |members: &Vec<&[f32]>| Subspace::of(members, rows.columns, shape.directions);
        self.subspaces = members.par_iter().map(fitted).collect::<Result<_>>()?;
        Ok(())
    }

    fn choose(&mut self, rows: &Rows) {
        let best = |(row, candidates): (&[f32], &Vec<u32>)| {
            let left = candidates.iter().map(|&c| self.subspaces[c as usize].left(row));
            left.enumerate().min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(rank, _)| rank as u32)
        };
        self.rank = rows.values.par_chunks_exact(rows.columns).zip(&self.candidates).map(best).collect();
    }

    /// The same with means and directions as a reader has them, and the bytes of both. Means are predicted from those of other
    /// clusters, as rows of the asset are.
    fn quantised(&self, columns: usize, step: f32) -> Result<(Vec<Subspace>, usize)> {
        let points: Vec<OrientedPoint> =
            self.centres.iter().map(|&at_mm| OrientedPoint { at_mm, normal: DVec3::ZERO }).collect();
        let all = 0..points.len();
        let net = Net::new(&points, std::slice::from_ref(&all), 1e-6);
        let steps = vec![step; columns];
        let means: Vec<f32> = net.point.iter().flat_map(|&c| self.subspaces[c as usize].mean.iter().copied()).collect();
        let (integers, known) = net.quantise(&means, &steps);
        let mut bytes = packed(net.point.len(), columns, &integers, Some(&net.similar()))?;
        let mut subspaces = vec![Subspace::default(); points.len()];
        for (&cluster, mean) in net.point.iter().zip(known.chunks_exact(columns)) {
            subspaces[cluster as usize].mean = mean.to_vec();
        }
        let directions = self.subspaces.first().map_or(0, |s| s.directions.len());
        let rows: Vec<f32> = (0..directions)
            .flat_map(|k| self.subspaces.iter().flat_map(move |s| s.directions[k].iter().copied()))
            .collect();
        if directions > 0 {
            let count = directions * points.len();
            let (integers, known) = Net::unpredicted(count).quantise(&rows, &steps);
            bytes += packed(count, columns, &integers, None)?;
            for (index, direction) in known.chunks_exact(columns).enumerate() {
                subspaces[index % points.len()].directions.push(direction.to_vec());
            }
        }
        Ok((subspaces, bytes))
    }

    /// Weights and, with `differences`, what is left, all with one step; means and directions with another.
    fn coded(
        &self,
        rows: &Rows,
        shape: Shape,
        (step, of_subspaces): (f32, f32),
        differences: bool,
    ) -> Result<Clustered> {
        let Rows { values, columns, places } = *rows;
        let (subspaces, mut bytes) = self.quantised(columns, of_subspaces)?;
        let of_row = |(index, row): (usize, &[f32])| {
            let Subspace { mean, directions } = &subspaces[self.of_row(index)];
            let mut left: Vec<f32> = row.iter().zip(mean).map(|(v, m)| v - m).collect();
            let weight = |d: &Vec<f32>| {
                let length = dot(d, d).sqrt();
                if length <= 0.0 {
                    return 0;
                }
                let weight = rounded(dot(&left, d) / length / step);
                left.iter_mut().zip(d).for_each(|(left, d)| *left -= f32::from(weight) * step / length * d);
                weight
            };
            let weights: Vec<i16> = directions.iter().map(weight).collect();
            let more: Vec<i16> =
                if differences { left.iter().map(|v| rounded(v / step)).collect() } else { Vec::new() };
            more.iter().zip(&mut left).for_each(|(more, left)| *left -= f32::from(*more) * step);
            let known: Vec<f32> = row.iter().zip(left).map(|(v, left)| v - left).collect();
            (weights, more, known)
        };
        let coded: Vec<_> = values.par_chunks_exact(columns).enumerate().map(of_row).collect();
        let ranks: Vec<i16> = self.rank.iter().map(|&rank| rank as i16).collect();
        bytes += packed(places.len(), 1, &ranks, None)?;
        if shape.directions > 0 {
            let weights: Vec<i16> = coded.iter().flat_map(|(weights, _, _)| weights.iter().copied()).collect();
            bytes += packed(places.len(), shape.directions, &weights, None)?;
        }
        if differences {
            let more: Vec<i16> = coded.iter().flat_map(|(_, more, _)| more.iter().copied()).collect();
            bytes += packed(places.len(), columns, &more, None)?;
        }
        Ok(Clustered { bytes, known: coded.into_iter().flat_map(|(_, _, known)| known).collect() })
    }
}

/// Bytes of a matrix as the asset codes them.
pub(crate) fn packed(rows: usize, columns: usize, values: &[i16], similar: Option<&[u32]>) -> Result<usize> {
    let bytes = encode(Tag::from_static("cluster"), rows, columns, values, similar);
    Ok(bytes.map_err(|e| Error::runtime(e.to_string()))?.len())
}

pub(crate) fn squared_error(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum()
}

/// Means, directions, weights and what is left, with steps that make an amount of squared error; of the steps of means and
/// directions over that of the others, the one of fewest bytes.
pub(crate) fn with_differences(rows: &Rows, shape: Shape, first_step: f32, amount: f64) -> Result<Clustered> {
    let clusters = Clusters::new(rows, shape)?;
    let mut best: Option<Clustered> = None;
    for of_subspaces in OF_SUBSPACES {
        let mut step = first_step;
        let mut found = clusters.coded(rows, shape, (step, step * of_subspaces), true)?;
        for _ in 0..TRIALS {
            let error = squared_error(rows.values, &found.known);
            if (error / amount - 1.0).abs() <= NEAR {
                break;
            }
            step *= (amount / error.max(f64::MIN_POSITIVE)).sqrt() as f32;
            found = clusters.coded(rows, shape, (step, step * of_subspaces), true)?;
        }
        if best.as_ref().is_none_or(|best| found.bytes < best.bytes) {
            best = Some(found);
        }
    }
    best.ok_or_else(|| Error::runtime("no steps were tried"))
}

/// Means, directions and weights alone: steps are as coarse as what is left out anyway allows.
pub(crate) fn alone(rows: &Rows, shape: Shape) -> Result<Clustered> {
    let clusters = Clusters::new(rows, shape)?;
    let left = |(index, row): (usize, &[f32])| f64::from(clusters.subspaces[clusters.of_row(index)].left(row).max(0.0));
    let left: f64 = rows.values.chunks_exact(rows.columns).enumerate().map(left).sum();
    let weights = (rows.places.len() * shape.directions.max(1)) as f64;
    let step = (12.0 * ROUNDED_WEIGHTS * left / weights).sqrt().max(f64::from(f32::MIN_POSITIVE)) as f32;
    // The coarsest that keeps the error, between the finest and the step of the weights.
    let all = clusters.subspaces.iter().flat_map(|s| s.directions.iter().chain([&s.mean])).flatten();
    let largest = f64::from(all.fold(0.0f32, |largest, v| largest.max(v.abs())));
    let (mut fine, mut coarse) = (FINEST.max(largest / (MOST_STEPS * f64::from(step))), 4.0);
    let mut best = clusters.coded(rows, shape, (step, step * fine as f32), false)?;
    for _ in 0..TRIALS {
        let middle = f64::sqrt(fine * coarse);
        let found = clusters.coded(rows, shape, (step, step * middle as f32), false)?;
        if squared_error(rows.values, &found.known) <= (1.0 + ROUNDED) * left {
            (fine, best) = (middle, found);
        } else {
            coarse = middle;
        }
    }
    Ok(best)
}
