//! The order of the far field's values in the file: function after function, because values of one function are
//! similar.

use crate::far_data::LANES;

/// Indices of the set bits, lowest first.
pub(crate) fn bits(mut mask: u16) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let k = mask.trailing_zeros() as usize;
        mask &= mask.wrapping_sub(1);
        (k < 16).then_some(k)
    })
}

/// Number of set bits of all masks together.
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

/// Reorders rows from the order of the coefficients to that of the file, `[k][coefficient that has k]`.
pub(crate) fn by_function<T: Copy + Default>(rows: &[T], masks: impl Iterator<Item = u16> + Clone) -> Vec<T> {
    let mut at = starts(masks.clone());
    let mut out = vec![T::default(); rows.len()];
    let mut rows = rows.iter();
    for k in masks.flat_map(bits) {
        let Some(row) = rows.next() else { break };
        out[at[k]] = *row;
        at[k] += 1;
    }
    out
}

/// Undoes [`by_function`]; there are as many rows as the masks have bits.
pub(crate) fn by_coefficient<T: Copy + Default>(rows: &[T], masks: impl Iterator<Item = u16> + Clone) -> Vec<T> {
    let mut at = starts(masks.clone());
    let mut out = Vec::with_capacity(rows.len());
    for k in masks.flat_map(bits) {
        out.push(rows.get(at[k]).copied().unwrap_or_default());
        at[k] += 1;
    }
    out
}

/// Low bytes of all rows, then high bytes, of zigzag numbers (sign in the lowest bit).
pub(crate) fn planes(rows: &[[i16; LANES]]) -> Vec<[u8; LANES]> {
    let zigzag = |row: &[i16; LANES]| row.map(|x| ((x << 1) ^ (x >> 15)) as u16);
    let low = rows.iter().map(|row| zigzag(row).map(|x| x as u8));
    low.chain(rows.iter().map(|row| zigzag(row).map(|x| (x >> 8) as u8))).collect()
}

/// Undoes [`planes`].
pub(crate) fn from_planes(planes: &[[u8; LANES]]) -> Vec<[i16; LANES]> {
    let (low, high) = planes.split_at(planes.len() / 2);
    let join = |(low, high): (&[u8; LANES], &[u8; LANES])| {
        std::array::from_fn(|lane| {
            let x = u16::from_le_bytes([low[lane], high[lane]]);
            ((x >> 1) as i16) ^ ((x & 1) as i16).wrapping_neg()
        })
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
            let values: Vec<[i16; LANES]> = (0..count(masks())).map(|_| std::array::from_fn(|_| next())).collect();
            assert_eq!(from_planes(&planes(&values)), values);
            assert_eq!(by_coefficient(&by_function(&values, masks()), masks()), values);
        }
    }

    /// Speed of decoding: `cargo test --release -p translux-format --lib speed -- --ignored --nocapture`.
    #[test]
    #[ignore = "prints times"]
    fn speed() {
        let masks: Vec<u16> = (0..800_000u32).map(|i| 1 | (i % 1024) as u16).collect();
        let masks = || masks.iter().copied();
        let values: Vec<[i8; LANES]> = (0..count(masks())).map(|i| [(i % 251) as i8; LANES]).collect();
        let stored = by_function(&values, masks());
        for _ in 0..5 {
            let start = std::time::Instant::now();
            let back = std::hint::black_box(by_coefficient(&stored, masks()));
            println!("{} rows in {:.1} ms", back.len(), 1e3 * start.elapsed().as_secs_f64());
            assert!(back == values);
        }
    }
}
