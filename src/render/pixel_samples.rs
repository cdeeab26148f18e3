//! Sample points of the eye rays within a pixel, and further pairs of numbers for each of them: stratified, different
//! in each pixel, a function of the pixel alone.
//!
//! The first 2^k points of the Sobol (0, 2) sequence lie one in each column, row and elementary rectangle of the pixel
//! cut in 2^k. A random digit scramble for each pixel and a jitter within the finest cell keep that, and make every
//! point uniform over the pixel, so that a mean over them is an unbiased box filter.

use glam::DVec2;

use crate::math::random;

/// Key of the random numbers of this stage.
const STAGE: u64 = 0x7069_7865_6c73;
/// Dimension of the pixel's scramble; the samples use lower ones.
const SCRAMBLE: u64 = 1 << 32;

/// The purpose of the points. Points of different streams are independent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stream {
    /// Positions where eye rays cross the pixel.
    Eye,
    /// Directions in which they are reflected.
    Lobe,
    /// Points of an area light that they sample.
    Light,
    /// Points of lights that matte surfaces sample.
    MatteLight,
    /// Directions from matte surfaces.
    MatteLobe,
}

/// The points of a pixel before they are scrambled.
pub(super) struct PixelSamples {
    /// Column and row of the cell of each point.
    cells: Vec<[u32; 2]>,
    /// Binary logarithm of the number of columns.
    bits: u32,
}

impl PixelSamples {
    pub(super) fn new(count: u32) -> Self {
        let bits = count.max(1).next_power_of_two().trailing_zeros();
        let top = |reversed: u32| if bits == 0 { 0 } else { reversed >> (32 - bits) };
        let cells = (0..count.max(1)).map(|i| [top(i.reverse_bits()), top(sobol_2(i))]).collect();
        Self { cells, bits }
    }

    /// Points in [0, 1)^2 of one pixel.
    pub(super) fn of_pixel(&self, stream: Stream, pixel: u64) -> impl Iterator<Item = DVec2> + '_ {
        let mask = (1u32 << self.bits) - 1;
        let stage = STAGE ^ ((stream as u64) << 60);
        let scramble = random::bits(stage, pixel, SCRAMBLE);
        let scramble = [scramble as u32 & mask, (scramble >> 32) as u32 & mask];
        let width = 1.0 / f64::from(1u32 << self.bits);
        self.cells.iter().enumerate().map(move |(i, cell)| {
            let jitter = random::bits(stage, pixel, i as u64);
            let fraction = |bits: u32| f64::from(bits) * (1.0 / 4_294_967_296.0);
            let place = |axis: usize, bits: u32| (f64::from(cell[axis] ^ scramble[axis]) + fraction(bits)) * width;
            DVec2::new(place(0, jitter as u32), place(1, (jitter >> 32) as u32))
        })
    }
}

/// The second dimension of the Sobol sequence, as the upper bits of a fraction.
fn sobol_2(mut index: u32) -> u32 {
    let (mut value, mut direction) = (0, 1u32 << 31);
    while index != 0 {
        if index & 1 == 1 {
            value ^= direction;
        }
        index >>= 1;
        direction ^= direction >> 1;
    }
    value
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_elementary_rectangle_holds_one_point() {
        for bits in 0..=6u32 {
            let samples = PixelSamples::new(1 << bits);
            for pixel in 0..50 {
                for columns in 0..=bits {
                    let (nx, ny) = (1usize << columns, 1usize << (bits - columns));
                    let mut hits = vec![0; nx * ny];
                    for p in samples.of_pixel(Stream::Lobe, pixel) {
                        hits[(p.y * ny as f64) as usize * nx + (p.x * nx as f64) as usize] += 1;
                    }
                    assert!(hits.iter().all(|&h| h == 1), "{bits} bits, pixel {pixel}, {nx} x {ny}: {hits:?}");
                }
            }
        }
    }

    #[test]
    fn points_are_uniform_over_the_pixel() {
        for count in [1, 3, 5, 16] {
            let samples = PixelSamples::new(count);
            let pixels = 20_000;
            let (mut sum, mut square) = (DVec2::ZERO, DVec2::ZERO);
            for p in (0..pixels).flat_map(|pixel| samples.of_pixel(Stream::Lobe, pixel)) {
                assert!(p.min_element() >= 0.0 && p.max_element() < 1.0);
                sum += p;
                square += p * p;
            }
            let n = f64::from(count) * pixels as f64;
            let tolerance = 4.0 * (1.0 / 12.0 / pixels as f64).sqrt();
            assert!((sum / n - 0.5).abs().max_element() < tolerance, "{count}: {}", sum / n);
            assert!((square / n - 1.0 / 3.0).abs().max_element() < 2.0 * tolerance, "{count}: {}", square / n);
        }
    }
}
