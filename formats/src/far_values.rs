//! The values of the far field as bytes that zstd packs well: Haar over the lanes, zigzag, two planes of bytes.
//!
//! The lanes of a coefficient are neighbours on the surface, so most of a row is said by its mean. Bytes for each vertex
//! at zstd level 3 (1,743 values each of smooth kernels on a sphere, 10 functions that decay by 0.55; order-0 entropy with a
//! context for each function and lane: 625): plain 948; `[k][lane][byte][coefficient]` 742; by level of the transform 721;
//! `[byte][coefficient][k][lane]` 709; `[byte][k][coefficient][lane]` as here 697, and without the transform 762. Level 9
//! saves another 3 % for five times the time.

use crate::far_field::LANES;

type Row = [i16; LANES];

/// Bytes of the values: all low bytes, then all high bytes, each `[k][coefficient that keeps k][lane]`. `lanes` of
/// each coefficient are real, at least 1.
pub(crate) fn encode(values: &[Row], masks: &[u16], lanes: impl Iterator<Item = usize>) -> Vec<u8> {
    let mut at = starts(masks);
    let mut out = vec![[0u8; LANES]; 2 * values.len()];
    let (low, high) = out.split_at_mut(values.len());
    let mut rows = values.iter();
    for (&mask, lanes) in masks.iter().zip(lanes) {
        for k in bits(mask) {
            let Some(&row) = rows.next() else { break };
            let mut row = row;
            let last = row[lanes.clamp(1, LANES) - 1];
            row[lanes.min(LANES)..].fill(last);
            let row = forward(row).map(|x| ((x << 1) ^ (x >> 15)) as u16);
            low[at[k]] = row.map(|x| x as u8);
            high[at[k]] = row.map(|x| (x >> 8) as u8);
            at[k] += 1;
        }
    }
    out.into_flattened()
}

/// The values again; lanes that are not in use are whatever the last real one was. `bytes` hold as many rows as the masks
/// have bits.
pub(crate) fn decode(bytes: &[u8], masks: &[u16]) -> Vec<Row> {
    let rows = bytes.len() / (2 * LANES);
    let (low, high) = bytes.split_at(rows * LANES);
    let (low, _) = low.as_chunks::<LANES>();
    let (high, _) = high.as_chunks::<LANES>();
    let mut at = starts(masks);
    let mut out = Vec::with_capacity(rows);
    for &mask in masks {
        for k in bits(mask) {
            out.push(inverse(unzigzag(&low[at[k]], &high[at[k]])));
            at[k] += 1;
        }
    }
    out
}

/// Set bits, lowest first.
pub(crate) fn bits(mask: u16) -> impl Iterator<Item = usize> {
    (0..16).filter(move |k| mask >> k & 1 == 1)
}

/// First row of each function.
fn starts(masks: &[u16]) -> [usize; 16] {
    let mut counts = [0; 16];
    for &mask in masks {
        bits(mask).for_each(|k| counts[k] += 1);
    }
    let mut first = 0;
    counts.map(|count| {
        first += count;
        first - count
    })
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
        for coefficients in [0, 1, 33, 1000] {
            let masks: Vec<u16> = (0..coefficients).map(|_| next() as u16).collect();
            let rows: u32 = masks.iter().map(|m| m.count_ones()).sum();
            let values: Vec<Row> = (0..rows).map(|_| std::array::from_fn(|_| next())).collect();
            let bytes = encode(&values, &masks, std::iter::repeat(LANES));
            assert_eq!(bytes.len(), 32 * values.len());
            assert_eq!(decode(&bytes, &masks), values);
        }
    }

    #[test]
    fn lanes_out_of_use_cost_nothing() {
        let row = std::array::from_fn(|lane| if lane < 5 { 7 } else { 0 });
        let bytes = encode(&[row], &[8], std::iter::once(5));
        assert_eq!(bytes[0], 14);
        assert!(bytes[1..].iter().all(|&byte| byte == 0));
        assert_eq!(decode(&bytes, &[8]), [[7; LANES]]);
    }

    /// Speed of decoding, for whoever changes it: `cargo test --release -p translux-format --lib speed -- --ignored --nocapture`.
    #[test]
    #[ignore = "prints times"]
    fn speed() {
        let masks: Vec<u16> = (0..800_000u32).map(|i| 1 | (i % 1024) as u16).collect();
        let rows: u32 = masks.iter().map(|m| m.count_ones()).sum();
        let values: Vec<Row> = (0..rows).map(|i| [(i % 251) as i16 - 125; LANES]).collect();
        let bytes = encode(&values, &masks, std::iter::repeat(LANES));
        for _ in 0..5 {
            let start = std::time::Instant::now();
            let back = std::hint::black_box(decode(&bytes, &masks));
            println!("{} rows in {:.1} ms", back.len(), 1e3 * start.elapsed().as_secs_f64());
            assert!(back == values);
        }
    }
}
