//! Counts, up to a constant, the triangles in the direction of every sub-texel, from the edges that bound them.
//!
//! The column lines of the four faces around an axis are half great circles from one pole of the axis to the other. An
//! edge crosses those between the azimuths of its ends, each at a place that is linear in `s` (edges are straight on the
//! faces). A crossing changes the count on all sub-texels beyond it, seen from the pole that is above the horizon; what
//! is below the horizon therefore never reaches a sub-texel above it.
//!
//! Azimuths are numbered by the column lines before them, monotonically in spite of rounding, and the way round is the
//! exact sign of a product of 24-bit numbers: each closed boundary crosses every column line as often one way as the other,
//! or goes around the pole for all of them alike, so that rounding moves a crossing but never leaks along a column.

use glam::{DVec3, Vec3};

use crate::math::simd::{InstructionSet, multiversion};

/// The four quarters around an axis, and their faces.
pub(super) struct Ring {
    /// Axes of the quarters 0 and 1, and the axis itself, before `flip`.
    axes: [DVec3; 3],
    /// Face of each quarter.
    pub(super) quarters: [Option<Quarter>; 4],
}

/// A face as a quarter of a ring.
#[derive(Clone, Copy)]
pub(super) struct Quarter {
    pub(super) face: usize,
    /// True if `s` and `t` of the face run against those of the ring.
    pub(super) turned: bool,
}

const fn quarter(face: usize, turned: bool) -> Option<Quarter> {
    Some(Quarter { face, turned })
}

/// The ring around the vertical with the four sides, and that around Z with the top and the bottom.
pub(super) const RINGS: [Ring; 2] = [
    Ring {
        axes: [DVec3::Z, DVec3::X, DVec3::NEG_Y],
        quarters: [quarter(4, false), quarter(0, false), quarter(5, false), quarter(1, false)],
    },
    Ring { axes: [DVec3::Y, DVec3::X, DVec3::Z], quarters: [quarter(2, false), None, quarter(3, true), None] },
];

/// Counts of the quarters of one ring for one point.
pub(super) struct Counts {
    /// Sub-texels along an edge, a power of two.
    side: usize,
    /// Changes, after [`Counts::sum`] the counts: `[quarter][row from the pole][column]`.
    cells: Vec<i16>,
    /// First and end column above the horizon, `[quarter][row]`.
    bounds: Vec<[i16; 2]>,
    /// Bits of one quarter, as words, set by [`Counts::take_equal`].
    pub(super) words: Vec<u64>,
}

/// A ring as one point sees it.
pub(super) struct View {
    /// Axes of the quarters 0 and 1, and the axis away from the pole above the horizon: coordinate axes.
    axes: [DVec3; 3],
    /// True if the last axis is vertical; and its sign.
    upright: bool,
    sign: f64,
    /// True if the rows run against the axis of the ring.
    pub(super) flipped: bool,
    pub(super) active: [bool; 4],
    /// Components of the normal along `axes`.
    normal: [f64; 3],
}

impl View {
    pub(super) fn new(ring: &Ring, normal: DVec3) -> Self {
        let mut axes = ring.axes;
        let flipped = normal.dot(axes[2]) > 0.0;
        if flipped {
            axes[2] = -axes[2];
        }
        let normal = axes.map(|axis| normal.dot(axis));
        let reach = |quarter: usize| {
            let [z, x, r] = in_quarter(quarter, normal);
            z + x.abs() + r.abs() > 0.0
        };
        let upright = axes[2].y != 0.0;
        let sign = axes[2].element_sum();
        Self {
            axes,
            upright,
            sign,
            flipped,
            active: [0, 1, 2, 3].map(|q| ring.quarters[q].is_some() && reach(q)),
            normal,
        }
    }

    /// Components along the axes, which are Z, X and Y or Y, X and Z.
    #[inline(always)]
    fn components(&self, v: Vec3) -> [f64; 3] {
        let (p, r) = if self.upright { (v.z, v.y) } else { (v.y, v.z) };
        [f64::from(p), f64::from(v.x), self.sign * f64::from(r)]
    }

    /// First and end column above the horizon, `n.w > 0`, of a row.
    pub(super) fn above(&self, side: usize, quarter: usize, row: usize) -> [usize; 2] {
        let [z, x, r] = in_quarter(quarter, self.normal);
        let half = 0.5 * side as f64;
        let t = (row as f64 + 0.5) / half - 1.0;
        let base = z + t * r;
        if x == 0.0 {
            return if base > 0.0 { [0, side] } else { [0, 0] };
        }
        let column = (1.0 - base / x) * half - 0.5;
        if x > 0.0 {
            [(column.clamp(-1.0, side as f64 - 1.0) + 1.0) as usize, side]
        } else {
            [0, side - (side as f64 - column.clamp(0.0, side as f64)) as usize]
        }
    }

    /// Direction of the centre of a sub-texel.
    pub(super) fn direction(&self, side: usize, quarter: usize, row: usize, column: usize) -> DVec3 {
        let at = |i: usize| (2 * i + 1) as f64 / side as f64 - 1.0;
        let [p, q, r] = self.axes;
        let (forward, right) = [(p, q), (q, -p), (-p, -q), (-q, p)][quarter % 4];
        (forward + at(column) * right + at(row) * r).normalize()
    }
}

/// The quarter of an azimuth.
#[inline]
fn quarter_of(p: f64, q: f64) -> usize {
    if q.abs() <= p.abs() {
        if p > 0.0 { 0 } else { 2 }
    } else if q > 0.0 {
        1
    } else {
        3
    }
}

/// Forward, right and axis of a quarter from the ring's components.
fn in_quarter(quarter: usize, [p, q, r]: [f64; 3]) -> [f64; 3] {
    match quarter {
        0 => [p, q, r],
        1 => [q, -p, r],
        2 => [-p, -q, r],
        _ => [-q, p, r],
    }
}

impl Counts {
    pub(super) fn new(side: usize) -> Self {
        let (bounds, words) = (vec![[0; 2]; 4 * side], vec![0; side * side / WORD]);
        Self { side, cells: vec![0; 4 * side * side], bounds, words }
    }

    /// Number of column lines before the azimuth of a point.
    #[inline]
    fn azimuth(&self, p: f64, q: f64) -> usize {
        let quarter = quarter_of(p, q);
        let s = if quarter.is_multiple_of(2) { q / p } else { -p / q };
        quarter * self.side + self.start(0.5 * self.side as f64 * (s + 1.0))
    }

    /// Number of centres below a place, 0 to `side`; a NaN is beyond all.
    #[inline]
    fn start(&self, place: f64) -> usize {
        // The integer part of a positive number is its floor everywhere.
        let side = self.side as f64;
        self.side - (side + 0.5 - place).clamp(0.0, side + 0.5) as u16 as usize
    }

    /// Enters an edge across which the count changes by `change` (see `Occluders::change`); ends relative to the eye.
    pub(super) fn add(&mut self, view: &View, ends: [Vec3; 2], change: i32) {
        let [a, b] = [view.components(ends[0]), view.components(ends[1])];
        let quarter = quarter_of(a[0], a[1]);
        // Quarters are convex: the edge stays inside.
        if !view.active[quarter] && quarter == quarter_of(b[0], b[1]) {
            return;
        }
        let whole = 4 * self.side;
        let turn = a[0] * b[1] - a[1] * b[0];
        let (ka, kb) = (self.azimuth(a[0], a[1]), self.azimuth(b[0], b[1]));
        let (first, end) = if turn >= 0.0 { (ka, kb) } else { (kb, ka) };
        // Both are 0 to `whole`, which are the same line.
        let count = (if end >= first { end - first } else { end + whole - first }) & (whole - 1);
        if count == 0 {
            return;
        }
        // (p, q, r) is left-handed, and right-handed where it is flipped.
        let handed = if view.flipped { -1 } else { 1 };
        let step = (handed * if turn >= 0.0 { change } else { -change }) as i16;
        let mut at = first & (whole - 1);
        let shift = self.side.trailing_zeros();
        let mut left = count;
        while left > 0 {
            let (quarter, column) = (at >> shift, at & (self.side - 1));
            let run = left.min(self.side - column);
            if view.active[quarter] {
                self.cross(quarter, column..column + run, in_quarter(quarter, a), in_quarter(quarter, b), step);
            }
            at = (at + run) & (whole - 1);
            left -= run;
        }
    }

    #[inline]
    fn cross(&mut self, quarter: usize, columns: std::ops::Range<usize>, a: [f64; 3], b: [f64; 3], step: i16) {
        let half = 0.5 * self.side as f64;
        let scale = 1.0 / (b[0] * a[1] - a[0] * b[1]);
        let offset = (b[2] * a[1] - a[2] * b[1]) * scale;
        let slope = (a[2] * b[0] - b[2] * a[0]) * scale;
        // The row in units of rows, linear in the column.
        let at_zero = half * (1.0 + offset + slope * (0.5 / half - 1.0));
        let cells = &mut self.cells[quarter * self.side * self.side..][..self.side * self.side];
        let side = self.side as f64;
        for column in columns {
            let place = at_zero + slope * column as f64;
            let row = self.side - (side + 0.5 - place).clamp(0.0, side + 0.5) as u16 as usize;
            if let Some(cell) = cells.get_mut(row * self.side + column) {
                *cell = cell.wrapping_add(step);
            }
        }
    }

    /// Turns changes into counts; returns the least above the horizon, `i16::MAX` for none.
    pub(super) fn sum(&mut self, level: InstructionSet, view: &View) -> i16 {
        let (side, face) = (self.side, self.side * self.side);
        let mut least = i16::MAX;
        for quarter in (0..4).filter(|q| view.active[*q]) {
            let bounds = &mut self.bounds[quarter * side..(quarter + 1) * side];
            for (row, bounds) in bounds.iter_mut().enumerate() {
                *bounds = view.above(side, quarter, row).map(|column| column as i16);
            }
            accumulate(level, &mut self.cells[quarter * face..(quarter + 1) * face], bounds, &mut least);
        }
        least
    }

    /// First and end column above the horizon of each row of a quarter, after [`Counts::sum`].
    pub(super) fn bounds(&self, quarter: usize) -> &[[i16; 2]] {
        &self.bounds[quarter * self.side..(quarter + 1) * self.side]
    }

    /// Sets, row by row of a quarter, words with a bit for each column whose count is `value`; clears the cells.
    pub(super) fn take_equal(&mut self, level: InstructionSet, quarter: usize, value: i16) {
        let face = self.side * self.side;
        compare(level, &mut self.cells[quarter * face..(quarter + 1) * face], value, &mut self.words);
    }
}

/// Columns side by side in a word.
const WORD: usize = 64;

/// 0, 1, 2, ...
const COLUMNS: [i16; WORD] = {
    let mut columns = [0; WORD];
    let mut i = 0;
    while i < WORD {
        columns[i] = i as i16;
        i += 1;
    }
    columns
};

multiversion! {
    /// Sums each column of a quarter from the first row on, and lowers `least` to the least sum within the bounds of its row.
    fn accumulate(cells: &mut [i16], bounds: &[[i16; 2]], least: &mut i16) => accumulate_body
}

#[inline(always)]
fn accumulate_body(cells: &mut [i16], bounds: &[[i16; 2]], least: &mut i16) {
    let side = bounds.len();
    let mut lowest = [*least; WORD];
    for first in (0..side).step_by(WORD) {
        let mut running = [0i16; WORD];
        for (row, bounds) in cells.chunks_exact_mut(side).zip(bounds) {
            let Some(row) = row[first..].first_chunk_mut::<WORD>() else { continue };
            let [low, high] = bounds.map(|column| column - first as i16);
            for i in 0..WORD {
                running[i] = running[i].wrapping_add(row[i]);
                row[i] = running[i];
                let inside = (COLUMNS[i] >= low) & (COLUMNS[i] < high);
                let sum = if inside { running[i] } else { i16::MAX };
                lowest[i] = if sum < lowest[i] { sum } else { lowest[i] };
            }
        }
    }
    *least = lowest.iter().fold(*least, |least, low| least.min(*low));
}

multiversion! {
    /// A bit for each cell that has the value; clears the cells.
    fn compare(cells: &mut [i16], value: i16, words: &mut [u64]) => compare_body
}

#[inline(always)]
fn compare_body(cells: &mut [i16], value: i16, words: &mut [u64]) {
    for (cells, word) in cells.chunks_exact_mut(WORD).zip(words) {
        let Some(cells) = cells.first_chunk_mut::<WORD>() else { continue };
        let mut equal = [0u8; WORD];
        for i in 0..WORD {
            equal[i] = u8::from(cells[i] == value);
        }
        *cells = [0; WORD];
        *word = 0;
        for k in 0..WORD / 8 {
            let bytes = (0..8).fold(0u64, |all, b| all | u64::from(equal[8 * k + b]) << (8 * b));
            *word |= (bytes.wrapping_mul(0x0102_0408_1020_4080) >> 56) << (8 * k);
        }
    }
}
