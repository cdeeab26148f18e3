//! Coding of radiosities at reference points: channels with distances, and directions, are decorrelated (principal
//! components), coefficients predicted from coarser reference points, and the residuals quantised with one step.

use translux_format::coefficients::encode;
use translux_format::quantised_lights::{Set, tags};

use crate::compress::prediction::Net;
use crate::error::Result;
use crate::evaluate::form::write_error;
use crate::math::eigen::{Eigen, symmetric_eigen};
use crate::math::leading::{Leading, leading_eigen};
use crate::math::simd::{InstructionSet, multiversion};
use crate::parallel::*;

/// Shares of the squared error for functions that are left out, and for the rounding of those that are kept.
const OMITTED: f64 = 0.4;
const ROUNDED_BASIS: f64 = 0.1;

/// Points whose products are in memory together.
const POINTS_OF_A_BATCH: usize = 4096;

/// Share of the squared error for columns of coefficients that hardly lessen it: they would cost memory and time.
const DROPPED: f64 = 0.12;

/// A basis function has this many steps on either side of 0 at most.
const MOST_STEPS: f64 = 32_000.0;

/// Columns of coefficients at most.
const MOST_COLUMNS: usize = 1 << 16;

/// Steps that are tried until the error is as asked.
const TRIALS: usize = 8;

/// Radiosities `[reference point][channel][shell][direction]` and the units of the directions; a point's row consists of planes,
/// one for each channel and shell.
pub(crate) struct Radiosities<'a> {
    pub(crate) values: std::borrow::Cow<'a, [f32]>,
    pub(crate) shells: usize,
    pub(crate) directions: usize,
    /// RMS of each direction over points, channels and shells.
    pub(crate) units: Vec<f32>,
}

impl<'a> Radiosities<'a> {
    pub(crate) fn new(values: impl Into<std::borrow::Cow<'a, [f32]>>, shells: usize, directions: usize) -> Self {
        let values = values.into();
        let mut squares = vec![0.0f64; directions];
        for row in values.chunks_exact(directions.max(1)) {
            squares.iter_mut().zip(row).for_each(|(sum, v)| *sum += f64::from(*v) * f64::from(*v));
        }
        let count = (values.len() / directions.max(1)).max(1) as f64;
        let rms: Vec<f64> = squares.iter().map(|s| (s / count).sqrt()).collect();
        // Light from where hardly anything is seen does not count as much as other light.
        let floor = 1e-3 * rms.iter().copied().fold(0.0, f64::max);
        let unit = |v: &f64| (v.max(floor) as f32).max(f32::MIN_POSITIVE);
        Self { values, shells, directions, units: rms.iter().map(unit).collect() }
    }

    fn planes(&self) -> usize {
        3 * self.shells
    }

    fn points(&self) -> usize {
        self.values.len() / (self.planes() * self.directions).max(1)
    }

    /// The planes of one direction in a point's row, in units of their lights.
    fn of_direction(&self, row: &[f32], direction: usize, out: &mut [f64]) {
        for (plane, out) in out.iter_mut().enumerate() {
            *out = f64::from(row[plane * self.directions + direction]) / f64::from(self.units[direction]);
        }
    }
}

/// Codes radiosities, in the order of the rows of `net`, so that their error is `error` times their RMS.
pub(crate) fn code(radiosities: &Radiosities, net: &Net, light_net: &Net, tags: tags::Set, error: f64) -> Result<Set> {
    let (points, planes, lights) = (radiosities.points(), radiosities.planes(), radiosities.directions);
    let (mixture, units) = decorrelated_planes(radiosities)?;
    let mut rows = vec![0.0f32; radiosities.values.len()];
    let size = (planes * lights).max(1);
    rows.par_chunks_mut(size).zip(radiosities.values.par_chunks(size)).for_each(|(out, row)| {
        let mut of_direction = vec![0.0; planes];
        for light in 0..lights {
            radiosities.of_direction(row, light, &mut of_direction);
            of_direction.iter_mut().zip(&units).for_each(|(value, unit)| *value /= unit);
            for (plane, mixture) in mixture.chunks_exact(planes).enumerate() {
                let sum: f64 = mixture.iter().zip(&of_direction).map(|(m, v)| m * v).sum();
                out[plane * lights + light] = sum as f32;
            }
        }
    });
    let squares: f64 = rows.par_chunks(size).map(square).collect::<Vec<f64>>().iter().sum();
    // Squared error of all rows together.
    let budget = squares * error * error;
    let Principal { functions: light_functions, values, omitted } =
        principal(&rows, lights, (MOST_COLUMNS / planes.max(1), OMITTED * budget))?;
    let functions = light_functions.len();
    // Rows of the light net: functions side by side, each with the step that its importance allows.
    let mut basis = vec![0.0f32; lights * functions];
    for (row, &light) in light_net.point.iter().enumerate() {
        for f in 0..functions {
            basis[row * functions + f] = light_functions[f][light as usize] as f32;
        }
    }
    let step_of = |f: usize| {
        let largest = light_functions[f].iter().fold(0.0f64, |a, v| a.max(v.abs()));
        let share = ROUNDED_BASIS * budget / (functions * lights) as f64;
        let step = (12.0 * share / values[f].max(f64::MIN_POSITIVE)).sqrt().min(1.0);
        step.max(largest / MOST_STEPS).max(f64::from(f32::MIN_POSITIVE)) as f32
    };
    let basis_steps: Vec<f32> = (0..functions).map(step_of).collect();
    let (basis_integers, _) = light_net.quantise(&basis, &basis_steps);
    // On the exact functions: those of little weight are rounded coarsely, and strong ones would leak into them.
    let coefficients = project(&rows, (planes, lights), light_net, &basis, functions);
    let columns = columns(&coefficients, planes * functions);
    let ordered: Vec<f32> = coefficients
        .chunks_exact(planes * functions)
        .flat_map(|row| columns.iter().map(|&c| row[usize::from(c)]))
        .collect();
    let spent = omitted + ROUNDED_BASIS * budget;
    let Quantised { step, integers, known } =
        quantised(net, &ordered, columns.len(), (budget - spent).max(0.1 * budget));
    let kept = worthwhile(&ordered, &known, columns.len(), DROPPED * budget);
    let (integers, columns) = without(integers, columns, &kept);
    Ok(Set {
        channels: mixture.iter().zip(units.iter().cycle()).map(|(m, unit)| m * unit).collect(),
        step,
        units: radiosities.units.clone(),
        basis: encode(tags.basis, lights, functions, &basis_integers, Some(&light_net.similar()))
            .map_err(write_error)?,
        basis_steps,
        coefficients: encode(tags.coefficients, points, columns.len(), &integers, Some(&net.similar()))
            .map_err(write_error)?,
        columns,
    })
}

fn square(row: &[f32]) -> f64 {
    row.iter().map(|v| f64::from(*v) * f64::from(*v)).sum()
}

/// The orthonormal mixture of planes in units of their RMS whose products vanish on average, the strongest first, a row for each
/// of them; and these units. In them the same error is relative to each plane's own brightness.
fn decorrelated_planes(radiosities: &Radiosities) -> Result<(Vec<f64>, Vec<f64>)> {
    let (planes, lights) = (radiosities.planes(), radiosities.directions);
    let of_row = |row: &[f32]| {
        let mut products = vec![0.0f64; planes * planes];
        let mut of_direction = vec![0.0; planes];
        for light in 0..lights {
            radiosities.of_direction(row, light, &mut of_direction);
            for (products, a) in products.chunks_exact_mut(planes).zip(&of_direction) {
                products.iter_mut().zip(&of_direction).for_each(|(sum, b)| *sum += a * b);
            }
        }
        products
    };
    let mut sum = vec![0.0; planes * planes];
    // Some points at a time, for their memory.
    for some in radiosities.values.chunks((planes * lights).max(1) * POINTS_OF_A_BATCH) {
        let rows: Vec<Vec<f64>> = some.par_chunks((planes * lights).max(1)).map(of_row).collect();
        rows.iter().for_each(|row| sum.iter_mut().zip(row).for_each(|(sum, product)| *sum += product));
    }
    let count = (radiosities.points() * lights).max(1) as f64;
    let rms: Vec<f64> = (0..planes).map(|i| (sum[i * planes + i] / count).sqrt()).collect();
    // A dark plane does not count more than a thousandth of the brightest.
    let least = (1e-3 * rms.iter().copied().fold(0.0, f64::max)).max(f64::MIN_POSITIVE.sqrt());
    let units: Vec<f64> = rms.iter().map(|rms| rms.max(least)).collect();
    for (i, sums) in sum.chunks_exact_mut(planes).enumerate() {
        sums.iter_mut().zip(&units).for_each(|(sum, unit)| *sum /= units[i] * unit);
    }
    let eigen = symmetric_eigen(&sum, planes)?;
    Ok((eigen.vectors.concat(), units))
}

/// Principal components of the light: orthonormal functions of the lights.
struct Principal {
    /// Functions by falling energy.
    functions: Vec<Vec<f64>>,
    /// Squares of their coefficients, summed over all rows.
    values: Vec<f64>,
    /// Energy of what is left out.
    omitted: f64,
}

/// At most `most` principal components of rows over the lights, at least one, without the last ones that together hold
/// an energy of `left_out` or less. With fewer rows than lights, the products between rows are used: a small mesh must
/// not wait for the components of 2,048 lights.
fn principal(rows: &[f32], lights: usize, (most, left_out): (usize, f64)) -> Result<Principal> {
    let few = (1..lights).contains(&(rows.len() / lights.max(1)));
    let (products, order) = match few {
        true => (products(rows, lights), rows.len() / lights),
        false => (gram(rows, lights), lights),
    };
    let Leading { pairs: Eigen { values, vectors }, omitted } = leading_eigen(&products, order, most, left_out)?;
    let functions = if few { over_lights(&vectors, rows, lights) } else { vectors };
    Ok(Principal { functions, values, omitted })
}

/// Orthonormal functions over the lights, of combinations of rows.
fn over_lights(combinations: &[Vec<f64>], rows: &[f32], lights: usize) -> Vec<Vec<f64>> {
    let of = |weights: &Vec<f64>| {
        let mut sum = vec![0.0f64; lights];
        for (weight, row) in weights.iter().zip(rows.chunks_exact(lights)) {
            sum.iter_mut().zip(row).for_each(|(sum, v)| *sum += weight * f64::from(*v));
        }
        sum
    };
    let mut functions: Vec<Vec<f64>> = combinations.par_iter().map(of).collect();
    // Those of little energy have lost digits against the strong ones, which nothing but their products can show.
    for f in 0..functions.len() {
        let (before, rest) = functions.split_at_mut(f);
        let own = &mut rest[0];
        for _ in 0..2 {
            for other in &*before {
                let product: f64 = own.iter().zip(other).map(|(a, b)| a * b).sum();
                own.iter_mut().zip(other).for_each(|(a, b)| *a -= product * b);
            }
            let length = own.iter().map(|v| v * v).sum::<f64>().sqrt().max(f64::MIN_POSITIVE);
            own.iter_mut().for_each(|v| *v /= length);
        }
    }
    functions
}

/// Products of each row with those up to and with itself: the lower triangle.
fn products(rows: &[f32], lights: usize) -> Vec<f64> {
    let count = rows.len() / lights.max(1);
    let mut result = vec![0.0f64; count * count];
    result.par_chunks_mut(count.max(1)).enumerate().for_each(|(i, out)| {
        let row = &rows[i * lights..(i + 1) * lights];
        for (out, other) in out[..=i].iter_mut().zip(rows.chunks_exact(lights)) {
            *out = row.iter().zip(other).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum();
        }
    });
    result
}

/// Products of the rows' entries, summed over all rows of `size`: the lower triangle.
fn gram(rows: &[f32], size: usize) -> Vec<f64> {
    const BLOCK: usize = 16;
    let level = InstructionSet::detect();
    let mut result = vec![0.0f64; size * size];
    result.par_chunks_mut(size * BLOCK).enumerate().for_each(|(block, out)| {
        let first = block * BLOCK;
        let mut partial = vec![0.0f32; out.len()];
        // Single precision within some rows, double beyond.
        for some in rows.chunks(size * 256) {
            partial.fill(0.0);
            add_products(level, &mut partial, some, size, first);
            out.iter_mut().zip(&partial).for_each(|(sum, v)| *sum += f64::from(*v));
        }
    });
    result
}

/// Adds products of entries of rows: of each entry from `first` on, as many as `sums` has rows, with those up to it.
#[inline(always)]
fn add_products_body(sums: &mut [f32], rows: &[f32], size: usize, first: usize) {
    for row in rows.chunks_exact(size) {
        for (i, sums) in sums.chunks_exact_mut(size).enumerate() {
            let factor = row[first + i];
            let end = first + i + 1;
            sums[..end].iter_mut().zip(&row[..end]).for_each(|(sum, v)| *sum += factor * v);
        }
    }
}

multiversion! {
    /// [`add_products_body`].
    fn add_products(sums: &mut [f32], rows: &[f32], size: usize, first: usize) => add_products_body
}

/// Coefficients `[point][function][plane]` of rows `[point][plane][light]`; the basis is `[row of its net][function]`.
fn project(
    rows: &[f32],
    (planes, lights): (usize, usize),
    light_net: &Net,
    basis: &[f32],
    functions: usize,
) -> Vec<f32> {
    let mut result = vec![0.0f32; rows.len() / lights.max(1) * functions];
    let rows = rows.par_chunks((planes * lights).max(1));
    result.par_chunks_mut((planes * functions).max(1)).zip(rows).for_each(|(out, row)| {
        let mut sums = vec![0.0f32; functions];
        for (plane, row) in row.chunks_exact(lights).enumerate() {
            sums.fill(0.0);
            for (&light, function) in light_net.point.iter().zip(basis.chunks_exact(functions)) {
                let value = row[light as usize];
                sums.iter_mut().zip(function).for_each(|(sum, f)| *sum += value * f);
            }
            sums.iter().enumerate().for_each(|(f, sum)| out[planes * f + plane] = *sum);
        }
    });
    result
}

/// Columns by falling energy.
fn columns(coefficients: &[f32], count: usize) -> Vec<u16> {
    let mut energy = vec![0.0f64; count];
    for row in coefficients.chunks_exact(count.max(1)) {
        energy.iter_mut().zip(row).for_each(|(sum, v)| *sum += f64::from(*v) * f64::from(*v));
    }
    let mut order: Vec<u16> = (0..count).map(|c| c as u16).collect();
    order.sort_by(|&a, &b| energy[usize::from(b)].total_cmp(&energy[usize::from(a)]).then(a.cmp(&b)));
    order
}

/// Integers, and the values that a reader decodes from them.
struct Quantised {
    step: f32,
    integers: Vec<i16>,
    known: Vec<f32>,
}

/// Quantises with the step whose squared error is the budget.
fn quantised(net: &Net, values: &[f32], columns: usize, budget: f64) -> Quantised {
    let largest = values.iter().fold(0.0f32, |a, v| a.max(v.abs()));
    let least = (largest / 16_000.0).max(f32::MIN_POSITIVE);
    let with = |step: f32| {
        let (integers, known) = net.quantise(values, &vec![step; columns]);
        Quantised { step, integers, known }
    };
    // As if every coefficient had the error of its rounding.
    let mut step = (((12.0 * budget / values.len().max(1) as f64).sqrt()) as f32).max(least);
    let mut best: Option<Quantised> = None;
    for _ in 0..TRIALS {
        let found = with(step);
        let errors = values.par_chunks(4096).zip(found.known.par_chunks(4096));
        let of_chunk = |(a, b): (&[f32], &[f32])| a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
        let error: f64 = errors.map(of_chunk).collect::<Vec<f64>>().iter().sum();
        let fits = error <= budget;
        if fits && best.as_ref().is_none_or(|best| step > best.step) {
            best = Some(found);
        }
        if fits && error >= 0.95 * budget {
            break;
        }
        let factor = (0.98 * budget / error.max(f64::MIN_POSITIVE)).sqrt().clamp(0.25, 4.0) as f32;
        // Zeros make the error grow slower than the step.
        step = (step * factor.powf(if factor > 1.0 { 1.3 } else { 1.0 })).max(least);
    }
    best.unwrap_or_else(|| with(least))
}

/// Columns to keep: those that lessen the squared error least are dropped, by `amount` or less together.
fn worthwhile(values: &[f32], known: &[f32], columns: usize, amount: f64) -> Vec<bool> {
    let mut gains = vec![0.0f64; columns];
    for (values, known) in values.chunks_exact(columns.max(1)).zip(known.chunks_exact(columns.max(1))) {
        for ((gain, v), k) in gains.iter_mut().zip(values).zip(known) {
            *gain += f64::from(*v).powi(2) - f64::from(v - k).powi(2);
        }
    }
    let mut order: Vec<usize> = (0..columns).collect();
    order.sort_by(|&a, &b| gains[a].total_cmp(&gains[b]).then(a.cmp(&b)));
    let (mut kept, mut lost) = (vec![true; columns], 0.0);
    for column in order {
        lost += gains[column].max(0.0);
        if lost > amount {
            break;
        }
        kept[column] = false;
    }
    kept
}

/// Integers and columns without those dropped.
fn without(integers: Vec<i16>, columns: Vec<u16>, kept: &[bool]) -> (Vec<i16>, Vec<u16>) {
    let of_row =
        |values: &[i16]| -> Vec<i16> { values.iter().zip(kept).filter(|(_, kept)| **kept).map(|(v, _)| *v).collect() };
    let integers = integers.chunks_exact(columns.len().max(1)).flat_map(of_row).collect();
    let columns = columns.into_iter().zip(kept).filter(|(_, kept)| **kept).map(|(c, _)| c).collect();
    (integers, columns)
}
