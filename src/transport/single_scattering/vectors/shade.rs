//! From what arrives in each texel to vectors: attenuation of three channels, many texels at a time.

use crate::transport::simd::{Level, multiversion};

/// What arrives at one depth from every texel of a cube map.
pub(super) struct Planes {
    /// Of each channel if bodies attenuate channels unequally; else the first is for all.
    pub(super) gain: [Vec<f32>; 3],
    pub(super) path_mm: Vec<f32>,
    /// `[term][texel]`; not used where there is one constant term.
    pub(super) terms: Vec<f32>,
}

impl Planes {
    pub(super) fn new(texels: usize, terms: usize) -> Self {
        Self {
            gain: std::array::from_fn(|_| vec![0.0; texels]),
            path_mm: vec![0.0; texels],
            terms: vec![0.0; texels * terms],
        }
    }
}

/// One channel of one depth of one face.
pub(super) struct Channel<'a> {
    pub(super) gain: &'a [f32],
    pub(super) path_mm: &'a [f32],
    /// Solid angles, sr.
    pub(super) angles: &'a [f32],
    /// Attenuated weight of the depth times the term, where that is a constant.
    pub(super) weight: f32,
    pub(super) sigma_t_per_mm: f32,
}

const LANES: usize = 16;

/// Exponents below this give what rounds to zero beside the rest.
const LEAST_EXPONENT: f32 = -80.0;

/// `exp(x)` for x in [-80, 0], to 2e-7 of itself, by the same operations on every processor.
#[inline(always)]
fn exponential(x: f32) -> f32 {
    let x = x.max(LEAST_EXPONENT);
    let y = x * std::f32::consts::LOG2_E;
    // Rounds to the nearest whole number: y is small.
    const SHIFT: f32 = 12_582_912.0;
    let whole = (y + SHIFT) - SHIFT;
    // The remainder in two steps keeps its digits.
    let r = (x - whole * 0.693_359_4) - whole * -2.121_944_4e-4;
    let p =
        1.0 + r * (1.0 + r * (0.5 + r * (0.166_666_67 + r * (0.041_666_67 + r * (0.008_333_35 + r * 0.001_388_89)))));
    let scale = f32::from_bits(((whole as i32 + 127) as u32) << 23);
    p * scale
}

multiversion! {
    /// Adds gain, attenuation, weight and solid angle of one channel to `out`.
    pub(super) fn add_channel(channel: &Channel, out: &mut [f32]) => add_channel_body
}

#[inline(always)]
fn add_channel_body(channel: &Channel, out: &mut [f32]) {
    let (gain, path) = (channel.gain.as_chunks::<LANES>().0, channel.path_mm.as_chunks::<LANES>().0);
    let angles = channel.angles.as_chunks::<LANES>().0;
    for (((out, gain), path), angles) in out.as_chunks_mut::<LANES>().0.iter_mut().zip(gain).zip(path).zip(angles) {
        for i in 0..LANES {
            let attenuated = exponential(-channel.sigma_t_per_mm * path[i]);
            out[i] += gain[i] * attenuated * (channel.weight * angles[i]);
        }
    }
}

multiversion! {
    /// Adds a picture times the values of a term to `out`.
    pub(super) fn add_product(picture: &[f32], term: &[f32], out: &mut [f32]) => add_product_body
}

#[inline(always)]
fn add_product_body(picture: &[f32], term: &[f32], out: &mut [f32]) {
    for ((out, p), t) in out.iter_mut().zip(picture).zip(term) {
        *out += p * t;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exponential_is_exact_to_single_precision() {
        for i in 0..80_000 {
            let x = -(i as f32) / 1000.0;
            let exact = f64::from(x).exp();
            assert!((f64::from(exponential(x)) / exact - 1.0).abs() < 4e-7, "{x}");
        }
        assert!(exponential(f32::NEG_INFINITY) < 1e-34 && exponential(0.0) == 1.0);
    }

    #[test]
    fn every_instruction_set_gives_the_same_bits() {
        let ramp = |scale: f32| (0..64).map(|i| i as f32 * scale).collect::<Vec<f32>>();
        let (gain, path, angles) = (ramp(0.01), ramp(0.3), ramp(1e-3));
        let channel = Channel { gain: &gain, path_mm: &path, angles: &angles, weight: 0.7, sigma_t_per_mm: 1.3 };
        let results: Vec<Vec<f32>> = Level::available()
            .into_iter()
            .map(|level| {
                let mut out = vec![0.0; 64];
                add_channel(level, &channel, &mut out);
                out
            })
            .collect();
        assert!(results.iter().all(|r| *r == results[0]) && results[0][5] > 0.0);
    }
}
