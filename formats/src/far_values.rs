//! The values of the far field as bytes that zstd packs well: Haar over the lanes, then zigzag, function after function.
//!
//! The lanes of a coefficient are neighbours on the surface, so most of a row is said by its mean. Bytes for each vertex
//! at zstd level 3 (1,743 values each of smooth kernels on a sphere, 10 functions that decay by 0.55; order-0 entropy with a
//! context for each function and lane: 625): plain 948; `[k][lane][byte][coefficient]` 742; by level of the transform 721;
//! `[byte][coefficient][k][lane]` 709; `[byte][k][coefficient][lane]` as here 697, and without the transform 762. Level 9
//! saves another 3 % for five times the time.

use crate::far_field::LANES;

/// Set bits, lowest first.
pub(crate) fn bits(mut mask: u16) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let k = mask.trailing_zeros() as usize;
        mask &= mask.wrapping_sub(1);
        (k < 16).then_some(k)
    })
}

/// Bits of all masks together.
pub(crate) fn count(masks: impl Iterator<Item = u16>) -> usize {
    masks.map(|mask| mask.count_ones() as usize).sum()
}

/// First row of each function.
fn starts(masks: impl Iterator<Item = u16>) -> [usize; 16] {
    let mut counts = [0; 16];
    for mask in masks {
        bits(mask).for_each(|k| counts[k] += 1);
    }
    let mut first = 0;
    counts.map(|count| {
        first += count;
        first - count
    })
}

/// Rows of one width. All arithmetic is modulo 2^width, where `a = s - (d >> 1)` and `b = a + d` undo `d = b - a` and
/// `s = a + (d >> 1)` whatever overflows on the way.
macro_rules! rows_of {
    ($module:ident, $signed:ty, $unsigned:ty) => {
        pub(crate) mod $module {
            use super::{LANES, bits, starts};

            pub(crate) type Row = [$signed; LANES];
            pub(crate) type Packed = [$unsigned; LANES];

            /// Rows as they are stored, `[k][coefficient that has k][lane]`. `lanes` of each coefficient are real, at least 1.
            pub(crate) fn pack(
                rows: &[Row],
                masks: impl Iterator<Item = u16> + Clone,
                lanes: impl Iterator<Item = usize>,
            ) -> Vec<Packed> {
                let mut at = starts(masks.clone());
                let mut out = vec![[0; LANES]; rows.len()];
                let mut rows = rows.iter();
                for (mask, lanes) in masks.zip(lanes) {
                    for k in bits(mask) {
                        let Some(&row) = rows.next() else { break };
                        let mut row = row;
                        let last = row[lanes.clamp(1, LANES) - 1];
                        row[lanes.min(LANES)..].fill(last);
                        let width = <$unsigned>::BITS - 1;
                        out[at[k]] = forward(row).map(|x| ((x << 1) ^ (x >> width)) as $unsigned);
                        at[k] += 1;
                    }
                }
                out
            }

            /// The rows again; lanes that are not in use are whatever the last real one was. There are as many rows as the
            /// masks have bits.
            pub(crate) fn unpack(packed: &[Packed], masks: impl Iterator<Item = u16> + Clone) -> Vec<Row> {
                let mut at = starts(masks.clone());
                let mut out = Vec::with_capacity(packed.len());
                for mask in masks {
                    for k in bits(mask) {
                        let row = packed.get(at[k]).copied().unwrap_or_default();
                        out.push(inverse(row.map(|x| ((x >> 1) as $signed) ^ ((x & 1) as $signed).wrapping_neg())));
                        at[k] += 1;
                    }
                }
                out
            }

            /// Four levels of the S-transform: a pair becomes its rounded mean and its difference.
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
        }
    };
}

rows_of!(narrow, i8, u8);
rows_of!(wide, i16, u16);

/// All low bytes, then all high ones.
pub(crate) fn planes(rows: &[wide::Packed]) -> Vec<[u8; LANES]> {
    let low = rows.iter().map(|row| row.map(|x| x as u8));
    low.chain(rows.iter().map(|row| row.map(|x| (x >> 8) as u8))).collect()
}

/// Undoes [`planes`].
pub(crate) fn from_planes(planes: &[[u8; LANES]]) -> Vec<wide::Packed> {
    let (low, high) = planes.split_at(planes.len() / 2);
    let join = |(low, high): (&[u8; LANES], &[u8; LANES])| {
        std::array::from_fn(|lane| u16::from_le_bytes([low[lane], high[lane]]))
    };
    low.iter().zip(high).map(join).collect()
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
        for coefficients in [0, 1, 33, 1000] {
            let masks: Vec<u16> = (0..coefficients).map(|_| next() as u16).collect();
            let masks = || masks.iter().copied();
            let values: Vec<wide::Row> = (0..count(masks())).map(|_| std::array::from_fn(|_| next())).collect();
            let packed = from_planes(&planes(&wide::pack(&values, masks(), std::iter::repeat(LANES))));
            assert_eq!(wide::unpack(&packed, masks()), values);
            let values: Vec<narrow::Row> = values.iter().map(|row| row.map(|x| x as i8)).collect();
            let packed = narrow::pack(&values, masks(), std::iter::repeat(LANES));
            assert_eq!(narrow::unpack(&packed, masks()), values);
        }
    }

    #[test]
    fn lanes_out_of_use_cost_nothing() {
        let row = std::array::from_fn(|lane| if lane < 5 { 7 } else { 0 });
        let packed = narrow::pack(&[row], std::iter::once(8), std::iter::once(5));
        assert_eq!(packed[0][0], 14);
        assert!(packed[0][1..].iter().all(|&byte| byte == 0));
        assert_eq!(narrow::unpack(&packed, std::iter::once(8)), [[7; LANES]]);
    }

    /// Speed of decoding, for whoever changes it: `cargo test --release -p translux-format --lib speed -- --ignored --nocapture`.
    #[test]
    #[ignore = "prints times"]
    fn speed() {
        let masks: Vec<u16> = (0..800_000u32).map(|i| 1 | (i % 1024) as u16).collect();
        let masks = || masks.iter().copied();
        let values: Vec<narrow::Row> = (0..count(masks())).map(|i| [(i % 251) as i8; LANES]).collect();
        let packed = narrow::pack(&values, masks(), std::iter::repeat(LANES));
        for _ in 0..5 {
            let start = std::time::Instant::now();
            let back = std::hint::black_box(narrow::unpack(&packed, masks()));
            println!("{} rows in {:.1} ms", back.len(), 1e3 * start.elapsed().as_secs_f64());
            assert!(back == values);
        }
    }
}
