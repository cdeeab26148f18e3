//! Coefficients as digits of 8 bits, and lights as 16-bit numbers for each of them: products are sums of integers, which are the
//! same in any order.
//!
//! The bytes read for each light limit the rate. Most columns need a single digit, since the asset's quantiser has one
//! step for all of them and few are many steps large.

use std::ops::Range;

use crate::math::simd::InstructionSet;

/// Columns of a group are padded to whole registers.
pub(crate) const LANES: usize = 16;

/// The largest digit, and the unit of a digit over that of the one below it.
const DIGIT: f32 = 127.0;
const BASE: f32 = 2.0 * DIGIT;

/// A column has a second digit where the unit of the first would be more than this share of the quantiser's step: the variance of
/// its rounding is a sixteenth of the quantiser's at most.
const FINE: f32 = 0.25;

/// The largest number of a light.
const NUMBER: f32 = 32767.0;

/// Cells whose sum fits 32 bits.
const CELLS: usize = 512;

/// Rows that are multiplied together.
const ROWS: usize = 4;

/// Largest deviation of a group of one colour from that colour, over its largest number.
const ROUNDING: f32 = 1e-6;

/// A column of digits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Digit {
    /// Value of 1 of this digit.
    pub(crate) unit: f32,
    /// Unit of the digit above, which this one refines.
    above: Option<f32>,
}

impl Digit {
    /// Digits of a column of values up to `largest` that are known to about `step`.
    pub(crate) fn of_column(largest: f32, step: f32) -> Vec<Self> {
        let unit = largest / DIGIT;
        // Nothing to tell apart, or nothing that single precision tells apart.
        if !(unit / BASE).is_normal() {
            return vec![Self { unit: if unit.is_normal() { unit } else { 1.0 }, above: None }];
        }
        let mut digits = vec![Self { unit, above: None }];
        if unit > FINE * step {
            digits.push(Self { unit: unit / BASE, above: Some(unit) });
        }
        digits
    }

    /// This digit of a value.
    pub(crate) fn of(self, value: f32) -> i8 {
        let rest = self.above.map_or(value, |unit| value - (value / unit).round() * unit);
        (rest / self.unit).round().clamp(-DIGIT, DIGIT) as i8
    }
}

/// A number for each cell of a group of columns, times a colour.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Term {
    cells: Range<usize>,
    numbers: Vec<i16>,
    colour: [f32; 3],
}

impl Term {
    /// `None` where all values are 0.
    fn new(cells: Range<usize>, values: &[f32], colour: [f32; 3]) -> Option<Self> {
        let unit = values.iter().fold(0.0f32, |a, v| a.max(v.abs())) / NUMBER;
        let number = |v: &f32| (v / unit).round().clamp(-NUMBER, NUMBER) as i16;
        unit.is_normal().then(|| Self {
            cells,
            numbers: values.iter().map(number).collect(),
            colour: colour.map(|c| c * unit),
        })
    }

    /// Terms of the columns of each channel, group by group: one where a group has one colour (parallel light of one
    /// colour), else one for each channel.
    pub(crate) fn of_groups(columns: &[Vec<f32>; 3], groups: &[Range<usize>]) -> Vec<Self> {
        let of_group = |group: &Range<usize>| -> Vec<Self> {
            let [Some(r), Some(g), Some(b)] = columns.each_ref().map(|column| column.get(group.clone())) else {
                return Vec::new();
            };
            match one_colour([r, g, b]) {
                Some((numbers, colour)) => Self::new(group.clone(), &numbers, colour).into_iter().collect(),
                None => [r, g, b]
                    .into_iter()
                    .enumerate()
                    .filter_map(|(c, values)| {
                        Self::new(group.clone(), values, [0, 1, 2].map(|i| f32::from(u8::from(i == c))))
                    })
                    .collect(),
            }
        };
        groups.iter().flat_map(of_group).collect()
    }

    /// The columns again, as they are after rounding.
    #[cfg(any(feature = "gpu", test))]
    pub(crate) fn columns(terms: &[Self], width: usize) -> [Vec<f32>; 3] {
        [0, 1, 2].map(|c| {
            let mut column = vec![0.0; width];
            for term in terms {
                let cells = column.get_mut(term.cells.clone()).unwrap_or(&mut []);
                cells.iter_mut().zip(&term.numbers).for_each(|(cell, n)| *cell += f32::from(*n) * term.colour[c]);
            }
            column
        })
    }
}

/// A number for each cell and their common colour, if there is one; `None` as well where all are 0.
fn one_colour([r, g, b]: [&[f32]; 3]) -> Option<(Vec<f32>, [f32; 3])> {
    let rgb = || r.iter().zip(g).zip(b).map(|((r, g), b)| [*r, *g, *b]);
    let size = |cell: &[f32; 3]| cell.iter().fold(0.0f32, |a, v| a.max(v.abs()));
    let largest = rgb().max_by(|a, b| size(a).total_cmp(&size(b))).filter(|cell| size(cell) > 0.0)?;
    let colour = largest.map(|v| v / size(&largest));
    let squares: f32 = colour.iter().map(|c| c * c).sum();
    let number = |cell: &[f32; 3]| cell.iter().zip(colour).map(|(v, c)| v * c).sum::<f32>() / squares;
    let is_off = |cell: [f32; 3]| {
        let number = number(&cell);
        cell.iter().zip(colour).any(|(v, c)| (v - number * c).abs() > ROUNDING * size(&largest))
    };
    (!rgb().any(is_off)).then(|| (rgb().map(|cell| number(&cell)).collect(), colour))
}

/// Fills `out` with the products of rows of digits and the terms: RGB and 0.
pub(crate) fn products(level: InstructionSet, out: &mut [[f32; 4]], rows: &[i8], width: usize, terms: &[Term]) {
    for (out, rows) in out.chunks_mut(ROWS).zip(rows.chunks((ROWS * width).max(1))) {
        // Beyond the last row it is taken again.
        let row = |i: usize| rows.get(i * width..(i + 1) * width).unwrap_or(&rows[..width.min(rows.len())]);
        let rows = [row(0), row(1), row(2), row(3)];
        let mut rgb = [[0.0f32; 4]; ROWS];
        for term in terms {
            let sums = term.sums(level, rows);
            for (rgb, sum) in rgb.iter_mut().zip(sums) {
                rgb.iter_mut().zip(term.colour).for_each(|(value, colour)| *value += sum * colour);
            }
        }
        out.iter_mut().zip(rgb).for_each(|(out, rgb)| *out = rgb);
    }
}

impl Term {
    /// Sums of the cells of some rows times their numbers.
    fn sums(&self, level: InstructionSet, rows: [&[i8]; ROWS]) -> [f32; ROWS] {
        let cells = rows.map(|row| row.get(self.cells.clone()).unwrap_or(&[]));
        let mut sums = [0.0f32; ROWS];
        for (chunk, numbers) in self.numbers.chunks(CELLS).enumerate() {
            let first = chunk * CELLS;
            let cells = cells.map(|cells| cells.get(first..first + numbers.len()).unwrap_or(&[]));
            let added = sums_of_integers(level, cells, numbers);
            sums.iter_mut().zip(added).for_each(|(sum, added)| *sum += added as f32);
        }
        sums
    }
}

/// Sums in 32 bits of products of [`LANES`] cells at a time; rows are whole registers.
fn sums_of_integers(level: InstructionSet, rows: [&[i8]; ROWS], numbers: &[i16]) -> [i32; ROWS] {
    let (numbers, rows) = (numbers.as_chunks::<LANES>().0, rows.map(|row| row.as_chunks::<LANES>().0));
    #[cfg(target_arch = "x86_64")]
    if level >= InstructionSet::Avx2 {
        // SAFETY: `InstructionSet::available` found AVX2 on this processor.
        return unsafe { avx2(rows, numbers) };
    }
    let _ = level;
    rows.map(|row| {
        let mut sum = 0i32;
        for (cells, numbers) in row.iter().zip(numbers) {
            for i in 0..LANES {
                sum += i32::from(cells[i]) * i32::from(numbers[i]);
            }
        }
        sum
    })
}

/// The same with multiplications that add pairs, which compilers do not find for several rows.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn avx2(rows: [&[[i8; LANES]]; ROWS], numbers: &[[i16; LANES]]) -> [i32; ROWS] {
    use std::arch::x86_64::{
        _mm_add_epi32, _mm_loadu_si128, _mm_storeu_si128, _mm256_add_epi32, _mm256_castsi256_si128,
        _mm256_cvtepi8_epi16, _mm256_extracti128_si256, _mm256_hadd_epi32, _mm256_loadu_si256, _mm256_madd_epi16,
        _mm256_setzero_si256,
    };
    let [a, b, c, d] = rows;
    let mut sums = [_mm256_setzero_si256(); ROWS];
    for ((((a, b), c), d), numbers) in a.iter().zip(b).zip(c).zip(d).zip(numbers) {
        // SAFETY: these are 16 numbers of 16 bits.
        let numbers = unsafe { _mm256_loadu_si256(numbers.as_ptr().cast()) };
        for (sum, cells) in sums.iter_mut().zip([a, b, c, d]) {
            // SAFETY: these are 16 numbers of 8 bits.
            let cells = _mm256_cvtepi8_epi16(unsafe { _mm_loadu_si128(cells.as_ptr().cast()) });
            *sum = _mm256_add_epi32(*sum, _mm256_madd_epi16(cells, numbers));
        }
    }
    let [a, b, c, d] = sums;
    let halves = _mm256_hadd_epi32(_mm256_hadd_epi32(a, b), _mm256_hadd_epi32(c, d));
    let total = _mm_add_epi32(_mm256_castsi256_si128(halves), _mm256_extracti128_si256::<1>(halves));
    let mut result = [0; ROWS];
    // SAFETY: there is place for 4 numbers of 32 bits.
    unsafe { _mm_storeu_si128(result.as_mut_ptr().cast(), total) };
    result
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::math::random::uniform;

    #[test]
    fn digits_hold_a_value_to_a_share_of_the_step() {
        for (largest, step, count) in [(3.0f32, 1.0, 1), (31.0, 1.0, 1), (32.0, 1.0, 2), (16_000.0, 1.0, 2)] {
            let digits = Digit::of_column(largest, step);
            assert_eq!(digits.len(), count, "{largest}");
            let tolerance = digits.last().unwrap().unit * 0.51;
            for i in 0..=1000 {
                let value = largest * (0.002 * i as f32 - 1.0);
                let known: f32 = digits.iter().map(|digit| f32::from(digit.of(value)) * digit.unit).sum();
                assert!((known - value).abs() <= tolerance + 1e-6 * largest, "{largest}: {value} {known}");
            }
            assert!(tolerance <= 0.26);
        }
        for largest in [0.0, 1e-44, 1e-37, f32::NAN, f32::INFINITY] {
            let digits = Digit::of_column(largest, 1e-3);
            assert!(digits.iter().all(|d| d.unit > 0.0 && d.unit.is_finite() && d.of(0.0) == 0), "{largest}");
        }
    }

    #[test]
    fn products_are_those_of_the_columns_on_every_level() {
        let (width, rows) = (1600, 37);
        let random = |seed, i: usize| uniform(seed, i as u64, 0) as f32 - 0.5;
        let groups = [0..48, 48..1600];
        let white: Vec<f32> = (0..width).map(|i| random(1, i)).collect();
        let coloured = [1.0, 0.5, -0.2].map(|c| white.iter().map(|v| c * v).collect::<Vec<f32>>());
        let several = [2, 3, 4].map(|seed| (0..width).map(|i| random(seed, i)).collect::<Vec<f32>>());
        // The largest that there are: sums of 32 bits would be too narrow for a row.
        let extreme = [1.0, 0.0, 0.0].map(|c| vec![c; width]);
        for (columns, count) in [(coloured, 2), (several, 6), (extreme, 2)] {
            let terms = Term::of_groups(&columns, &groups);
            assert_eq!(terms.len(), count);
            let digit = |i: usize| {
                if columns[1][0] == 0.0 { 127 } else { (255.0 * random(5, i)).round().clamp(-127.0, 127.0) as i8 }
            };
            let digits: Vec<i8> = (0..width * rows).map(digit).collect();
            let mut found = vec![[1.0; 4]; rows];
            products(InstructionSet::detect(), &mut found, &digits, width, &terms);
            let rounded = Term::columns(&terms, width);
            for (row, found) in digits.chunks_exact(width).zip(&found) {
                for c in 0..3 {
                    let sum = |column: &[f32]| -> f64 {
                        row.iter().zip(column).map(|(d, v)| f64::from(*d) * f64::from(*v)).sum()
                    };
                    let (exact, same) = (sum(&columns[c]), sum(&rounded[c]));
                    assert!((f64::from(found[c]) - same).abs() < 1e-5 * 127.0 * 40.0, "{found:?} {same}");
                    assert!((exact - same).abs() < 2e-5 * 127.0 * 40.0, "{exact} {same}");
                }
            }
            for level in InstructionSet::available() {
                let mut same = vec![[1.0; 4]; rows];
                products(level, &mut same, &digits, width, &terms);
                assert_eq!(same, found);
            }
        }
        let dark = [0, 1, 2].map(|_| vec![0.0; width]);
        assert!(Term::of_groups(&dark, &groups).is_empty());
        assert!(Term::of_groups(&[vec![], vec![], vec![]], &groups).is_empty());
    }
}
