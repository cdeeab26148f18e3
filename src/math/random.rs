//! Counter-based random numbers: a value is a pure function of (seed, stage, index, dimension).

/// Mixes 64 bits (the finaliser of SplitMix64, Steele et al. 2014).
#[inline]
pub const fn mix(mut z: u64) -> u64 {
    z = z.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// 64 random bits that depend on the stage, the index and the dimension only.
#[inline]
pub const fn bits(stage: u64, index: u64, dimension: u64) -> u64 {
    mix(mix(mix(stage) ^ index) ^ dimension)
}

/// A number uniform in [0, 1) with 53 bits.
#[inline]
pub fn uniform(stage: u64, index: u64, dimension: u64) -> f64 {
    (bits(stage, index, dimension) >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
}

/// The radical inverse of `index` in base 2 as a fraction in [0, 1).
#[inline]
pub fn radical_inverse_2(index: u32) -> f64 {
    f64::from(index.reverse_bits()) * (1.0 / 4_294_967_296.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uniform_has_the_mean_and_variance_of_the_unit_interval() {
        let n = 100_000;
        let values: Vec<f64> = (0..n).map(|i| uniform(1, i, 7)).collect();
        let mean = values.iter().sum::<f64>() / n as f64;
        let variance = values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / n as f64;
        assert!((mean - 0.5).abs() < 4.0 * (1.0 / 12.0_f64 / n as f64).sqrt());
        assert!((variance - 1.0 / 12.0).abs() < 1e-3);
        assert!(values.iter().all(|v| (0.0..1.0).contains(v)));
    }

    #[test]
    fn radical_inverse_starts_as_van_der_corput() {
        let first: Vec<f64> = (0..5).map(radical_inverse_2).collect();
        assert_eq!(first, [0.0, 0.5, 0.25, 0.75, 0.125]);
    }
}
