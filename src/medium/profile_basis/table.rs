//! All functions of a basis at a squared distance, in single precision, for many points.

use super::grid::Interpolation;

/// Number to a multiple of which the functions of a row are padded with zeros.
pub const ROW_LANES: usize = 8;

/// Binary logarithm of the number of cells in an octave of `1 + r^2 / split^2`.
const LOG2_CELLS: u32 = 5;

/// Number of bits of an f32 below the cell's number.
const CELL_BITS: u32 = f32::MANTISSA_DIGITS - 1 - LOG2_CELLS;

/// Coefficients of the polynomial of a cell: value, slope, curvature and the cubic term.
const ORDER: usize = 4;

/// The functions of a basis as cubics in cells of `x = 1 + r^2 / split^2`.
///
/// The cell is read from the exponent and the upper bits of the mantissa of x, so its width is a 32nd of the octave
/// that it is in, and the split radius (x = 2) is a border. With `(cell, f) = index_of(r^2)` the functions are `c0[k] +
/// f (c1[k] + f (c2[k] + f c3[k]))`, where [`Table::row`] holds c0 to c3 one after the other, [`Table::stride`] numbers
/// each. Multiplications and additions are not fused and no library function is called: every processor gives the same
/// bits.
///
/// Error against the functions of the basis, weighted with `r^2 + split^2` as the transport is and relative to the
/// function's largest weighted magnitude: below 1e-5 for as many terms as an error of 1e-3 needs. Later functions
/// oscillate more, but their share in any material is below 1e-4. Parabolas on 64 cells were three times worse and half
/// as large again.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    terms: usize,
    stride: usize,
    inverse_split2: f32,
    largest_x: f32,
    rows: Vec<f32>,
}

impl Table {
    /// Tabulates `functions` at their nodes; squares are in mm^2, `reach2` is the largest of the nodes.
    pub(super) fn new(interpolation: &Interpolation, functions: &[f32], split2: f64, reach2: f64) -> Self {
        let inverse_split2 = (1.0 / split2) as f32;
        let largest_x = (1.0 + reach2 / split2) as f32;
        // Through the numbers that `index_of` computes with, so that their rounding is no error.
        let at = |x: f64| {
            let square = (x - 1.0) / f64::from(inverse_split2);
            interpolation.at(functions, square.clamp(0.0, reach2))
        };
        let first = 1.0_f32.to_bits() >> CELL_BITS;
        let last = largest_x.to_bits() >> CELL_BITS;
        let terms = at(1.0).len();
        let stride = terms.next_multiple_of(ROW_LANES);
        let mut rows = vec![0.0; (last - first + 1) as usize * ORDER * stride];
        for (row, cell) in rows.chunks_exact_mut(ORDER * stride).zip(first..) {
            let border = |cell: u32| f64::from(f32::from_bits(cell << CELL_BITS));
            let (from, to) = (border(cell), border(cell + 1));
            // Nothing is known beyond the reach, which the last cell need not end at.
            let used = ((f64::from(largest_x) - from) / (to - from)).clamp(1e-3, 1.0);
            let points = [0.0, 1.0, 2.0, 3.0].map(|third| at(from + third / 3.0 * used * (to - from)));
            for k in 0..terms {
                for (order, coefficient) in cubic([0, 1, 2, 3].map(|i| points[i][k]), used).into_iter().enumerate() {
                    // Functions of a hostile file may overflow.
                    let single = coefficient as f32;
                    row[order * stride + k] = if single.is_finite() { single } else { 0.0 };
                }
            }
        }
        Self { terms, stride, inverse_split2, largest_x, rows }
    }

    /// Number of functions K.
    pub fn terms(&self) -> usize {
        self.terms
    }

    /// K rounded up to a multiple of [`ROW_LANES`].
    pub fn stride(&self) -> usize {
        self.stride
    }

    /// The cell of a squared distance in mm^2 and the place in it, in [0, 1). Distances beyond the reach count
    /// as the reach, negative numbers and NaN as 0.
    #[inline(always)]
    pub fn index_of(&self, r2_mm2: f32) -> (usize, f32) {
        // In this order NaN becomes 0.
        let x = (r2_mm2.max(0.0) * self.inverse_split2 + 1.0).min(self.largest_x);
        let bits = x.to_bits() - 1.0_f32.to_bits();
        let rest = bits & ((1 << CELL_BITS) - 1);
        ((bits >> CELL_BITS) as usize, rest as f32 * (1.0 / (1_u32 << CELL_BITS) as f32))
    }

    /// Coefficients c0 to c3 of a cell, [`Self::stride`] numbers each; empty for a cell that does not exist.
    #[inline(always)]
    pub fn row(&self, cell: usize) -> &[f32] {
        let length = ORDER * self.stride;
        self.rows.get(cell * length..(cell + 1) * length).unwrap_or(&[])
    }

    /// Every function at a squared distance in mm^2, 1/mm^2; fills `out` with at most [`Self::terms`] values.
    #[inline(always)]
    pub fn evaluate(&self, r2_mm2: f32, out: &mut [f32]) {
        let (cell, f) = self.index_of(r2_mm2);
        let (c0, rest) = self.row(cell).split_at(self.stride);
        let (c1, rest) = rest.split_at(self.stride);
        let (c2, c3) = rest.split_at(self.stride);
        for ((((out, c0), c1), c2), c3) in out.iter_mut().zip(c0).zip(c1).zip(c2).zip(c3) {
            *out = c0 + f * (c1 + f * (c2 + f * c3));
        }
    }
}

/// Coefficients of the cubic with these values at 0, 1/3, 2/3 and 1 of `[0, width]`.
fn cubic([a, b, c, d]: [f64; 4], width: f64) -> [f64; 4] {
    let first = -5.5 * a + 9.0 * b - 4.5 * c + d;
    let second = 9.0 * a - 22.5 * b + 18.0 * c - 4.5 * d;
    let third = -4.5 * a + 13.5 * b - 13.5 * c + 4.5 * d;
    [a, first / width, second / (width * width), third / (width * width * width)]
}
