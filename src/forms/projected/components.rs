//! Components: transport as coefficients at reference points over a basis of the light, as stored and as evaluated.

use std::f64::consts::PI;
use std::ops::Range;

use glam::DVec3;
use translux_format::Budget;
use translux_format::coefficients::decode;
use translux_format::quantised_lights::{Set, tags};

use super::digits::{Digit, LANES, Term, products};
use crate::compress::prediction::Net;
use crate::error::{Error, Result};
use crate::evaluate::form::read_error;
use crate::forms::projected::references::{ascending_rows, weights};
use crate::forms::sampled_scene::{oriented, parts};
use crate::light::Light;
use crate::math::simd::{InstructionSet, multiversion};
use crate::parallel::*;
use crate::scene::Scene;
use crate::transport::balanced_tree::power_of_two_near;
use crate::transport::interpolation::SharedWeights;
use crate::transport::receivers::Receivers;

/// Reference points of one task.
const CHUNK: usize = 256;

/// Rows of the basis that one task sums, and that are summed together.
const ROWS_OF_A_TASK: usize = 256;
const ROWS: usize = 4;

/// Radiosity over irradiance from which on an asset is damaged. Real ones have up to 10 and more in [`most`]; weights of interpolation, between lights and
/// between points, make less than ten times as much of it, which is what evaluators refuse.
const MOST: f64 = 100.0;

/// Largest deviation of weights of one colour from that colour, over the largest weight.
const ROUNDING: f64 = 1e-14;

/// Lights converted to columns: the radiosities of the parts add up.
#[derive(Default)]
pub(crate) struct Lit {
    pub(crate) parts: Vec<Part>,
    /// A power of two that brings radiosity near 1, so that single precision holds lights of any size.
    pub(crate) scale: f64,
}

/// Some lights together, as weights over the basis.
pub(crate) struct Weighted {
    /// RGB weights over the rows of the folded basis, for each shell.
    pub(crate) shells: Vec<Vec<[f64; 3]>>,
    /// Share of the light that arrives at each reference point; empty where it is all.
    pub(crate) factors: Vec<f32>,
}

/// Some lights together, as terms over the columns.
pub(crate) struct Part {
    /// Radiosity of every column for each unit of its digits, over the scale.
    pub(crate) terms: Vec<Term>,
    /// Share of the light that arrives at each reference point; empty where it is all.
    pub(crate) factors: Vec<f32>,
}

/// A stored set of coefficients, with its reader's knowledge of the lights.
pub(crate) struct Coded<'a> {
    pub(crate) set: &'a Set,
    pub(crate) tags: tags::Set,
    /// Shells that its lights are on.
    pub(crate) shells: Range<usize>,
    /// Net over the lights.
    pub(crate) net: &'a Net,
    /// What the rows of its basis are.
    pub(crate) rows: Rows,
}

/// What the rows of a basis are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Rows {
    /// Lights of irradiance 1 at the centre of the scene, between which others are interpolated; with the largest irradiance on its surface.
    Lights(f64),
    /// Harmonics of the radiance.
    Harmonics,
}

/// The transport as it is evaluated.
pub(crate) struct Transport {
    /// Digits of the coefficients `[reference point][padded column]`, reference points in the order of the receivers; columns of
    /// one plane after those of the other.
    pub(crate) coefficients: Vec<i8>,
    /// Padded columns of digits.
    pub(crate) columns: usize,
    /// Columns of each plane, whole registers.
    groups: Vec<Range<usize>>,
    sets: Vec<SetOfShells>,
    /// Weights of every receiver over the reference points.
    pub(crate) weights: SharedWeights,
    /// Positions of the reference points, mm.
    pub(crate) positions: Vec<DVec3>,
    /// Buffers for the radiosity of the reference points and of the receivers.
    references: Vec<[f32; 4]>,
    gathered: Vec<[f32; 4]>,
}

/// Identity of a column of digits.
#[derive(Clone, Copy)]
struct Column {
    /// Index among the stored columns.
    stored: usize,
    /// Function times planes plus plane.
    number: u16,
    digit: Digit,
}

/// Rows of functions of the light, `[row][function]`, in the precision that they need.
pub(crate) enum LightFunctions {
    /// As stored, in steps of each function.
    Stored { digits: Vec<i16>, steps: Vec<f64> },
    /// Combined with the interpolator's matrix: their sums may be far smaller than themselves.
    Combined(Vec<f64>),
}

/// Conversion of lights in some shells to columns.
struct SetOfShells {
    shells: Range<usize>,
    columns: Vec<Option<Column>>,
    /// Basis, multiplied by the units of the directions.
    basis: LightFunctions,
    functions: usize,
    /// Matrix with a row for each decorrelated plane; columns: channels and, in each, shells.
    channels: Vec<f64>,
}

/// A bound on the radiosity of any reference point under one light of irradiance 1, from a basis `[row][function]`, units included, and
/// coefficients `[reference point][column]`: sums of absolute values over the functions.
fn most(basis: &[f32], (values, set): (&[f32], &Set), rows: Rows) -> f64 {
    let functions = set.basis_steps.len();
    let planes = set.channels.len().isqrt().max(1);
    // The most that one of a decorrelated plane is in any plane.
    let most_of: Vec<f64> =
        set.channels.chunks(planes).map(|row| row.iter().fold(0.0, |most, m| m.abs().max(most))).collect();
    // The most that one of a function gives.
    let mut of_function = vec![0.0f64; functions];
    for row in values.chunks(set.columns.len().max(1)) {
        let mut of_row = vec![0.0; functions];
        for (value, number) in row.iter().zip(&set.columns) {
            let (function, plane) = (usize::from(*number) / planes, usize::from(*number) % planes);
            of_row[function] += f64::from(value.abs()) * most_of[plane];
        }
        of_function.iter_mut().zip(of_row).for_each(|(most, own)| *most = most.max(own));
    }
    let of_light = |row: &[f32]| row.iter().zip(&of_function).map(|(b, most)| f64::from(b.abs()) * most).sum::<f64>();
    let of_rows = basis.chunks(functions.max(1)).map(of_light);
    match rows {
        Rows::Lights(largest) => of_rows.fold(0.0, f64::max) / largest,
        // The squares of all harmonics of a direction add up to their number over the sphere.
        Rows::Harmonics => {
            let (count, squares) = of_rows.fold((0.0, 0.0), |(count, sum), most| (count + 1.0, sum + most * most));
            (squares * count / (4.0 * PI)).sqrt()
        }
    }
}

impl Transport {
    /// Decodes, predicts and arranges; `fold` turns a basis `[light][function]`, the lights in their own order, into
    /// the rows that weights are multiplied with.
    pub(crate) fn new(
        coded: &[Coded],
        (scene, receivers): (&Scene, &Receivers),
        spacing_mm: f64,
        fold: impl Fn(Vec<f32>, usize) -> LightFunctions,
    ) -> Result<Self> {
        let points = oriented(scene, receivers);
        let net = Net::new(&points, &parts(receivers), spacing_mm);
        let decoded = |tag, bytes: &[u8], net: &Net| {
            let found = decode(tag, bytes, Some(&net.similar()), Budget::default()).map_err(read_error)?;
            if found.rows != net.point.len() {
                let (rows, wanted) = (found.rows, net.point.len());
                return Err(Error::input(format!(
                    "{rows} rows of coefficients for {wanted} reference points: the mesh and its transport do not belong together"
                )));
            }
            Ok(found.values)
        };
        let (mut sets, mut known, mut groups, mut columns) = (Vec::new(), Vec::new(), Vec::new(), 0);
        for Coded { set: own, tags, shells, net: light_net, rows } in coded {
            let shells = shells.clone();
            let functions = own.basis_steps.len();
            let basis = decoded(tags.basis, &own.basis, light_net)?;
            let integers = decoded(tags.coefficients, &own.coefficients, &net)?;
            let values = net.dequantise(&integers, &vec![own.step; own.columns.len()]);
            let digits = digits(&values, own.columns.len(), own.step);
            let basis = light_net.dequantise(&basis, &own.basis_steps);
            let basis = by_direction(&basis, light_net, functions, &own.units);
            let most = most(&basis, (&values, own), *rows);
            if most.is_nan() || most > MOST {
                return Err(Error::input(format!(
                    "{}: a basis that may give {most:.3e} times the light that enters: the asset is damaged; bake it again",
                    tags.basis
                )));
            }
            known.push(values);
            let first = columns;
            let mut padded = Vec::new();
            for plane in 0..3 * shells.len() {
                for (stored, (&number, digits)) in own.columns.iter().zip(&digits).enumerate() {
                    if usize::from(number) % (3 * shells.len()) == plane {
                        padded.extend(digits.iter().map(|&digit| Some(Column { stored, number, digit })));
                    }
                }
                padded.resize(padded.len().next_multiple_of(LANES), None);
                groups.push(columns..first + padded.len());
                columns = first + padded.len();
            }
            sets.push(SetOfShells {
                shells,
                columns: padded,
                basis: fold(basis, functions),
                functions,
                channels: own.channels.clone(),
            });
        }
        let mut transport = Self {
            coefficients: vec![0; net.point.len() * columns],
            columns,
            groups,
            sets,
            weights: SharedWeights::default(),
            positions: Vec::new(),
            references: Vec::new(),
            gathered: Vec::new(),
        };
        let order = ascending_rows(&net.point);
        let mut first = 0;
        for (index, known) in known.iter().enumerate() {
            let stored = coded[index].set.columns.len();
            first = transport.arrange(known, stored, &order, index, first);
        }
        let chosen: Vec<u32> = order.iter().map(|&row| net.point[row as usize]).collect();
        transport.positions = chosen.iter().map(|&i| points[i as usize].at_mm + scene.mesh.origin_mm).collect();
        transport.weights = SharedWeights::new(&weights(&chosen, &points, receivers, spacing_mm));
        Ok(transport)
    }

    /// Puts the reference points of a set in the order of the receivers and their coefficients into digits, from column
    /// `first` on; returns the column after the last one.
    fn arrange(&mut self, known: &[f32], stored: usize, order: &[u32], set: usize, first: usize) -> usize {
        let columns = &self.sets[set].columns;
        let end = first + columns.len();
        self.coefficients.par_chunks_mut(self.columns.max(1)).zip(order).for_each(|(out, &row)| {
            let Some(values) = known.get(row as usize * stored..(row as usize + 1) * stored) else { return };
            for (slot, column) in out[first..end].iter_mut().zip(columns) {
                *slot = column.map_or(0, |column| column.digit.of(values[column.stored]));
            }
        });
        end
    }

    /// Converts parts of lights to columns.
    pub(crate) fn lit(&self, parts: Vec<Weighted>) -> Result<Lit> {
        let columns = |Weighted { shells, factors }| Ok((self.columns(&shells)?, factors));
        let parts = parts.into_iter().map(columns).collect::<Result<Vec<_>>>()?;
        let values = parts.iter().flat_map(|(columns, _)| columns.iter().flatten());
        let largest = values.fold(0.0f64, |a, v| a.max(v.abs()));
        let scale = power_of_two_near(largest) * f64::from(1u32 << 7);
        let part = |(columns, factors): ([Vec<f64>; 3], Vec<f32>)| {
            let columns = columns.map(|values| values.iter().map(|value| (value / scale) as f32).collect::<Vec<f32>>());
            Part { terms: Term::of_groups(&columns, &self.groups), factors }
        };
        Ok(Lit { parts: parts.into_iter().map(part).collect(), scale })
    }

    /// Radiosity of every column for each unit of its digits under some lights, for each channel of RGB.
    fn columns(&self, shells: &[Vec<[f64; 3]>]) -> Result<[Vec<f64>; 3]> {
        let shells: Vec<&[[f64; 3]]> = shells.iter().map(Vec::as_slice).collect();
        let mut exact = [0, 1, 2].map(|_| Vec::with_capacity(self.columns));
        for own in &self.sets {
            let columns = own.columns(shells.get(own.shells.clone()).unwrap_or(&[]));
            for (all, columns) in exact.iter_mut().zip(columns) {
                all.extend(columns);
            }
        }
        if exact.iter().flatten().any(|value| !value.is_finite()) {
            return Err(Error::runtime("the light is too bright for double precision; make it weaker"));
        }
        Ok(exact)
    }

    /// Fills `values` with the radiosity of every reference point over the scale of the lights, RGB and 0.
    fn products(&self, parts: &[Part], values: &mut Vec<[f32; 4]>) {
        values.resize(self.coefficients.len() / self.columns.max(1), [0.0; 4]);
        let level = InstructionSet::detect();
        let rows = self.coefficients.par_chunks((self.columns * CHUNK).max(1));
        values.par_chunks_mut(CHUNK).zip(rows).enumerate().for_each(|(chunk, (out, rows))| {
            let mut own = [[0.0f32; 4]; CHUNK];
            let own = &mut own[..out.len()];
            for (index, part) in parts.iter().enumerate() {
                products(level, own, rows, self.columns, &part.terms);
                if let Some(factors) = part.factors.get(chunk * CHUNK..) {
                    own.iter_mut().zip(factors).for_each(|(value, factor)| value.iter_mut().for_each(|v| *v *= factor));
                }
                if index == 0 {
                    out.copy_from_slice(own);
                } else {
                    let cells = out.as_flattened_mut().iter_mut().zip(own.as_flattened());
                    cells.for_each(|(out, value)| *out += value);
                }
            }
        });
    }

    /// Radiosity of the reference points in the order of the receivers, none negative.
    pub(crate) fn at_references(&self, lit: &Lit) -> Vec<DVec3> {
        let mut values = Vec::new();
        self.products(&lit.parts, &mut values);
        let value = |v: &[f32; 4]| DVec3::new(v[0].into(), v[1].into(), v[2].into()).max(DVec3::ZERO) * lit.scale;
        values.iter().map(value).collect()
    }

    /// Radiosity of every source vertex, RGB, none negative.
    pub(crate) fn radiosity(&mut self, lit: &Lit, receivers: &Receivers) -> Vec<DVec3> {
        let mut references = std::mem::take(&mut self.references);
        self.products(&lit.parts, &mut references);
        self.weights.apply(&references, &mut self.gathered);
        self.references = references;
        receivers.expand_rgb(&self.gathered, lit.scale)
    }

    /// Radiosity of every receiver under each part of the lights, over their scale, RGB and 0, of either sign.
    pub(crate) fn of_parts(&self, lit: &Lit) -> Vec<Vec<[f32; 4]>> {
        let mut references = Vec::new();
        let of_part = |part: &Part| {
            let mut gathered = Vec::new();
            self.products(std::slice::from_ref(part), &mut references);
            self.weights.apply_signed(&references, &mut gathered);
            gathered
        };
        lit.parts.iter().map(of_part).collect()
    }

    /// Bytes in memory.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(self.coefficients.as_slice())
            + self.sets.iter().map(|set| set.basis.bytes()).sum::<usize>()
            + size_of_val(self.positions.as_slice())
            + self.weights.bytes()
    }
}

/// Functions of the light that components are over.
pub(crate) trait LightBasis: Send + Sync + 'static {
    /// Name of the stage, for [`Stored::stage`].
    const STAGE: &'static str;

    /// Converts lights to columns of a transport.
    fn lit(&self, transport: &Transport, lights: &[Light]) -> Result<Lit>;
}

/// Components of an asset.
pub(crate) struct Components<B> {
    pub(crate) basis: B,
    pub(crate) transport: Transport,
}

impl SetOfShells {
    /// Radiosity of every column for weights of the basis's rows in each shell, for each channel of RGB.
    fn columns(&self, shells: &[&[[f64; 3]]]) -> [Vec<f64>; 3] {
        let functions: Vec<[Vec<f64>; 3]> = shells.iter().map(|weights| self.functions_of(weights)).collect();
        let planes = 3 * self.shells.len();
        [0, 1, 2].map(|rgb| {
            let of_column = |column: &Option<Column>| {
                let Some(Column { number, digit, .. }) = *column else { return 0.0 };
                let (function, plane) = (usize::from(number) / planes, usize::from(number) % planes);
                let row = &self.channels[plane * planes + rgb * self.shells.len()..][..self.shells.len()];
                let sum: f64 = functions.iter().zip(row).map(|(shell, m)| m * shell[rgb][function]).sum();
                sum * f64::from(digit.unit)
            };
            self.columns.iter().map(of_column).collect()
        })
    }

    /// Sums of the rows of the basis, each with its RGB weight.
    fn functions_of(&self, weights: &[[f64; 3]]) -> [Vec<f64>; 3] {
        let mut result = [0, 1, 2].map(|_| vec![0.0; self.functions]);
        for (colour, numbers) in by_colour(weights) {
            let sums = self.sums_of(&numbers);
            for (result, colour) in result.iter_mut().zip(colour) {
                result.iter_mut().zip(&sums).for_each(|(result, sum)| *result += colour * sum);
            }
        }
        result
    }

    /// Sums of rows of the basis with these weights.
    fn sums_of(&self, weights: &[f64]) -> Vec<f64> {
        match &self.basis {
            LightFunctions::Stored { digits, steps } => {
                let mut sums = sums(weights, digits, self.functions, add_rows_of_digits);
                sums.iter_mut().zip(steps).for_each(|(sum, step)| *sum *= step);
                sums
            }
            LightFunctions::Combined(basis) => sums(weights, basis, self.functions, add_rows_double),
        }
    }
}

impl LightFunctions {
    /// Rows of `functions` in 16 bits, the largest of each function 32,767 steps: to 2e-5 of it, a hundredth of the
    /// error of coding.
    pub(crate) fn stored(rows: &[f32], functions: usize) -> Self {
        let mut largest = vec![0.0f32; functions];
        for row in rows.chunks_exact(functions.max(1)) {
            largest.iter_mut().zip(row).for_each(|(largest, v)| *largest = largest.max(v.abs()));
        }
        let steps: Vec<f64> = largest.iter().map(|&largest| f64::from(largest) / f64::from(i16::MAX)).collect();
        let digit = |(&v, &step): (&f32, &f64)| if step > 0.0 { (f64::from(v) / step).round() as i16 } else { 0 };
        let digits = rows.chunks_exact(functions.max(1)).flat_map(|row| row.iter().zip(&steps).map(digit)).collect();
        Self::Stored { digits, steps }
    }

    fn bytes(&self) -> usize {
        match self {
            Self::Stored { digits, steps } => size_of_val(digits.as_slice()) + size_of_val(steps.as_slice()),
            Self::Combined(basis) => size_of_val(basis.as_slice()),
        }
    }
}

/// Adds rows with their weights to sums.
type AddRows<T> = fn(InstructionSet, &mut [f64], &[(f64, &[T])]);

/// Sums of rows of `width` with these weights.
fn sums<T: Sync>(weights: &[f64], rows: &[T], width: usize, add: AddRows<T>) -> Vec<f64> {
    let rows = weights.iter().zip(rows.chunks_exact(width.max(1)));
    let rows: Vec<(f64, &[T])> = rows.map(|(w, row)| (*w, row)).filter(|(w, _)| *w != 0.0).collect();
    let level = InstructionSet::detect();
    let of_chunk = |rows: &[(f64, &[T])]| {
        let mut sums = vec![0.0; width];
        add(level, &mut sums, rows);
        sums
    };
    let chunks: Vec<Vec<f64>> = rows.par_chunks(ROWS_OF_A_TASK).map(of_chunk).collect();
    let mut total = vec![0.0; width];
    for chunk in &chunks {
        total.iter_mut().zip(chunk).for_each(|(total, sum)| *total += sum);
    }
    total
}

/// Digits of every stored column.
fn digits(known: &[f32], stored: usize, step: f32) -> Vec<Vec<Digit>> {
    let mut largest = vec![0.0f32; stored];
    for row in known.chunks_exact(stored.max(1)) {
        largest.iter_mut().zip(row).for_each(|(l, v)| *l = l.max(v.abs()));
    }
    largest.into_iter().map(|largest| Digit::of_column(largest, step)).collect()
}

/// RGB weights as a colour times numbers, or the channels one by one where they have several colours.
fn by_colour(weights: &[[f64; 3]]) -> Vec<([f64; 3], Vec<f64>)> {
    let size = |w: &[f64; 3]| w.iter().fold(0.0f64, |a, v| a.max(v.abs()));
    let largest = weights.iter().max_by(|a, b| size(a).total_cmp(&size(b))).copied().unwrap_or_default();
    let scale = size(&largest);
    if scale == 0.0 {
        return Vec::new();
    }
    let brightest = (0..3).find(|&c| largest[c].abs() == scale).unwrap_or(0);
    let colour = largest.map(|v| v / largest[brightest]);
    let is_off = |w: &[f64; 3]| (0..3).any(|c| (w[c] - colour[c] * w[brightest]).abs() > ROUNDING * scale);
    if !weights.iter().any(is_off) {
        return vec![(colour, weights.iter().map(|w| w[brightest]).collect())];
    }
    let axis = |c: usize| [0, 1, 2].map(|i| f64::from(u8::from(i == c)));
    [0, 1, 2].map(|c| (axis(c), weights.iter().map(|w| w[c]).collect())).into()
}

/// Adds rows of the basis times their weights.
#[inline(always)]
fn add_rows_body<T: Copy + Into<f64>>(sums: &mut [f64], rows: &[(f64, &[T])]) {
    let (together, rest) = rows.as_chunks::<ROWS>();
    for &[(a, first), (b, second), (c, third), (d, fourth)] in together {
        let rows = first.iter().zip(second).zip(third.iter().zip(fourth));
        for (sum, ((&p, &q), (&r, &s))) in sums.iter_mut().zip(rows) {
            *sum += (a * p.into() + b * q.into()) + (c * r.into() + d * s.into());
        }
    }
    for (weight, row) in rest {
        sums.iter_mut().zip(*row).for_each(|(sum, &v)| *sum += weight * v.into());
    }
}

multiversion! {
    /// [`add_rows_body`] for a basis of digits.
    fn add_rows_of_digits(sums: &mut [f64], rows: &[(f64, &[i16])]) => add_rows_body
}

multiversion! {
    /// [`add_rows_body`] in double precision.
    fn add_rows_double(sums: &mut [f64], rows: &[(f64, &[f64])]) => add_rows_body
}

/// Reorders rows of the light net to `[direction][function]`, times the direction's unit.
fn by_direction(rows: &[f32], net: &Net, functions: usize, units: &[f32]) -> Vec<f32> {
    let mut result = vec![0.0; units.len() * functions];
    for (&direction, row) in net.point.iter().zip(rows.chunks_exact(functions.max(1))) {
        let at = direction as usize * functions;
        let Some(out) = result.get_mut(at..at + functions) else { continue };
        let unit = units.get(direction as usize).copied().unwrap_or(0.0);
        out.iter_mut().zip(row).for_each(|(out, v)| *out = unit * v);
    }
    result
}
