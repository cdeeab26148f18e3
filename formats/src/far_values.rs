//! The values of the far field as bytes that zstd packs well: Haar over the lanes, zigzag, two planes of bytes.
//!
//! The lanes of a coefficient are neighbours on the surface, so most of a row is said by its mean. Bytes for each vertex
//! at zstd level 3 (1,743 values each of smooth kernels on a sphere, 10 functions that decay by 0.55; order-0 entropy with a
//! context for each function and lane: 625): plain 948; `[k][lane][byte][coefficient]` 742; by level of the transform 721;
//! `[byte][coefficient][k][lane]` 709; `[byte][k][coefficient][lane]` as here 697, and without the transform 762. Level 9
//! saves another 3 % for five times the time.

use crate::far_field::LANES;

/// Coefficients that are decoded together: both sides of the reordering stay in the first-level cache for 16 functions.
const BLOCK: usize = 32;

type Row = [i16; LANES];

/// Bytes of the values of `coefficients * terms` rows: all low bytes, then all high bytes, each `[k][coefficient][lane]`.
/// `lanes_in_use(c)` of the lanes of coefficient `c` are real, at least 1.
pub(crate) fn encode(values: &[i16], terms: usize, lanes_in_use: impl Iterator<Item = usize>) -> Vec<u8> {
    let rows: &[Row] = bytemuck::cast_slice(&values[..values.len() / LANES * LANES]);
    let coefficients = rows.len() / terms.max(1);
    let mut out = vec![[0u8; LANES]; 2 * rows.len()];
    let (low, high) = out.split_at_mut(rows.len());
    for ((c, of_coefficient), lanes) in rows.chunks_exact(terms.max(1)).enumerate().zip(lanes_in_use) {
        for (k, row) in of_coefficient.iter().enumerate() {
            let mut row = *row;
            let last = row[lanes.clamp(1, LANES) - 1];
            row[lanes.min(LANES)..].fill(last);
            let row = forward(row).map(|x| ((x << 1) ^ (x >> 15)) as u16);
            let at = k * coefficients + c;
            low[at] = row.map(|x| x as u8);
            high[at] = row.map(|x| (x >> 8) as u8);
        }
    }
    out.into_flattened()
}

/// Rows from which on a second thread helps to decode.
const SHARED_ROWS: usize = 1 << 17;

/// The values again; lanes that are not in use are whatever the last real one was. Uses a second thread for many values.
pub(crate) fn decode(bytes: &[u8], terms: usize) -> Vec<i16> {
    let rows = bytes.len() / (2 * LANES);
    let (low, high) = bytes.split_at(rows * LANES);
    let planes = Planes { low: low.as_chunks().0, high: high.as_chunks().0, terms: terms.max(1) };
    let mut out = vec![0i16; rows * LANES];
    let (out_rows, _) = out.as_chunks_mut::<LANES>();
    let middle = planes.coefficients() / 2;
    let (first, second) = out_rows.split_at_mut(middle * planes.terms);
    let started = rows >= SHARED_ROWS
        && std::thread::scope(|scope| {
            let helper = std::thread::Builder::new().spawn_scoped(scope, || planes.decode_from(0, first));
            planes.decode_from(middle, second);
            helper.is_ok()
        });
    if !started {
        planes.decode_from(0, first);
        if rows < SHARED_ROWS {
            planes.decode_from(middle, second);
        }
    }
    out
}

/// Bytes of the values, `[k][coefficient][lane]` each.
struct Planes<'a> {
    low: &'a [[u8; LANES]],
    high: &'a [[u8; LANES]],
    terms: usize,
}

impl Planes<'_> {
    fn coefficients(&self) -> usize {
        self.low.len() / self.terms
    }

    /// Fills the rows `[coefficient][k]` of whole coefficients, `first` and those behind it.
    fn decode_from(&self, first: usize, out: &mut [Row]) {
        for (block, of_block) in out.chunks_mut(BLOCK * self.terms).enumerate() {
            for k in 0..self.terms {
                let from = k * self.coefficients() + first + block * BLOCK;
                let bytes = self.low[from..].iter().zip(&self.high[from..]);
                for (row, (low, high)) in of_block.iter_mut().skip(k).step_by(self.terms).zip(bytes) {
                    *row = inverse(unzigzag(low, high));
                }
            }
        }
    }
}

#[inline]
fn unzigzag(low: &[u8; LANES], high: &[u8; LANES]) -> Row {
    std::array::from_fn(|lane| {
        let x = u16::from_le_bytes([low[lane], high[lane]]);
        ((x >> 1) as i16) ^ ((x & 1) as i16).wrapping_neg()
    })
}

/// Four levels of the S-transform: a pair becomes its rounded mean and its difference. Everything is modulo 2^16, where
/// `a = s - (d >> 1)` and `b = a + d` undo `d = b - a` and `s = a + (d >> 1)` whatever overflows on the way.
fn forward(mut row: Row) -> Row {
    let mut length = LANES;
    while length > 1 {
        let half = length / 2;
        let mut level = row;
        for i in 0..half {
            let (a, b) = (row[2 * i], row[2 * i + 1]);
            let difference = b.wrapping_sub(a);
            level[i] = a.wrapping_add(difference >> 1);
            level[half + i] = difference;
        }
        row = level;
        length = half;
    }
    row
}

#[inline]
fn inverse(row: Row) -> Row {
    #[inline]
    fn level<const HALF: usize>(sums: &Row, differences: &Row) -> Row {
        let mut out = [0; LANES];
        for i in 0..HALF {
            let difference = differences[HALF + i];
            let a = sums[i].wrapping_sub(difference >> 1);
            out[2 * i] = a;
            out[2 * i + 1] = a.wrapping_add(difference);
        }
        out
    }
    let sums = level::<1>(&row, &row);
    let sums = level::<2>(&sums, &row);
    let sums = level::<4>(&sums, &row);
    level::<8>(&sums, &row)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_values_survive() {
        let mut state = 1u64;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            match state >> 61 {
                0 => i16::MIN,
                1 => i16::MAX,
                _ => (state >> 40) as i16,
            }
        };
        for (terms, coefficients) in [(1, 1), (3, 1), (1, 33), (10, 31), (7, 100), (2, 0), (3, SHARED_ROWS / 3 + 1)] {
            let values: Vec<i16> = (0..terms * coefficients * LANES).map(|_| next()).collect();
            let bytes = encode(&values, terms, std::iter::repeat(LANES));
            assert_eq!(bytes.len(), 2 * values.len());
            assert_eq!(decode(&bytes, terms), values);
        }
    }

    #[test]
    fn lanes_out_of_use_cost_nothing() {
        let values: Vec<i16> = (0..LANES as i16).map(|lane| if lane < 5 { 7 } else { 0 }).collect();
        let bytes = encode(&values, 1, std::iter::once(5));
        assert_eq!(bytes[0], 14);
        assert!(bytes[1..].iter().all(|&byte| byte == 0));
        assert_eq!(decode(&bytes, 1), [7; LANES]);
    }

    /// Speed of decoding, for whoever changes it: `cargo test --release -p translux-format --lib speed -- --ignored --nocapture`.
    #[test]
    #[ignore = "prints times"]
    fn speed() {
        let (terms, coefficients) = (10, 328_125);
        let values: Vec<i16> = (0..terms * coefficients * LANES).map(|i| (i % 251) as i16 - 125).collect();
        let bytes = encode(&values, terms, std::iter::repeat(LANES));
        for _ in 0..5 {
            let start = std::time::Instant::now();
            let back = std::hint::black_box(decode(&bytes, terms));
            println!("{} values in {:.1} ms", back.len(), 1e3 * start.elapsed().as_secs_f64());
            assert!(back == values);
        }
    }
}
