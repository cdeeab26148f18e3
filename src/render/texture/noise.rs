//! Gradient noise of space: Perlin's improved noise (Perlin 2002, "Improving noise") with gradients chosen by a hash of
//! the lattice point instead of a table, so that shaders have the same noise (`relight/raster/texture.wgsl`).

use glam::DVec3;

/// Bound on the absolute value of [`noise`].
pub const MAX_NOISE: f64 = 1.04;
/// Mean of `|noise|` over space, to 0.002.
pub const MEAN_ABSOLUTE_NOISE: f64 = 0.22;

/// Pseudo-random bits of a lattice point for a key.
#[inline]
fn lattice_bits(cell: [u32; 3], key: u32) -> u32 {
    let mut bits = 0u32;
    // The key comes last: before the coordinates, one key's lattice would be that of another with points exchanged.
    for part in cell.into_iter().chain([key]) {
        bits = (bits ^ part).wrapping_mul(0x9e37_79b1);
        bits ^= bits >> 15;
    }
    // The finaliser of MurmurHash3 (Appleby 2011): without it, high bits of the key do not reach the low ones.
    bits = (bits ^ (bits >> 16)).wrapping_mul(0x85eb_ca6b);
    bits = (bits ^ (bits >> 13)).wrapping_mul(0xc2b2_ae35);
    bits ^ (bits >> 16)
}

/// Product of an offset with the gradient chosen by `bits`, one of the directions to the twelve edges of a cube.
#[inline]
fn slope(bits: u32, offset: DVec3) -> f64 {
    let edge = bits % 12;
    let pair = match edge / 4 {
        0 => [offset.y, offset.z],
        1 => [offset.x, offset.z],
        _ => [offset.x, offset.y],
    };
    let first = if edge & 1 == 0 { pair[0] } else { -pair[0] };
    first + if edge & 2 == 0 { pair[1] } else { -pair[1] }
}

/// Noise that is 0 at whole coordinates, with two continuous derivatives, between -[`MAX_NOISE`] and [`MAX_NOISE`];
/// features are one unit wide. All lattice cells beyond 2^31 are alike.
#[inline]
pub fn noise(at: DVec3, key: u32) -> f64 {
    let cell = at.floor();
    let inside = at - cell;
    let fade = inside * inside * inside * (inside * (inside * 6.0 - 15.0) + 10.0);
    let cell = cell.to_array().map(|c| c as i32 as u32);
    let corner = |x: u32, y: u32, z: u32| {
        let at = [cell[0].wrapping_add(x), cell[1].wrapping_add(y), cell[2].wrapping_add(z)];
        slope(lattice_bits(at, key), inside - DVec3::new(x.into(), y.into(), z.into()))
    };
    let blend = |a: f64, b: f64, share: f64| a + (b - a) * share;
    let along_x = |y: u32, z: u32| blend(corner(0, y, z), corner(1, y, z), fade.x);
    let plane = |z: u32| blend(along_x(0, z), along_x(1, z), fade.y);
    blend(plane(0), plane(1), fade.z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::uniform;

    fn anywhere(i: u64) -> DVec3 {
        let coordinate = |d: u64| 400.0 * (uniform(11, i, d) - 0.5);
        DVec3::new(coordinate(0), coordinate(1), coordinate(2))
    }

    #[test]
    fn values_stay_in_range_and_have_the_known_moments() {
        let n = 400_000;
        let (mut sum, mut absolute, mut square, mut largest) = (0.0, 0.0, 0.0, 0.0f64);
        for i in 0..n {
            let value = noise(anywhere(i), (i % 7) as u32);
            sum += value;
            absolute += value.abs();
            square += value * value;
            largest = largest.max(value.abs());
        }
        let [mean, absolute, square] = [sum, absolute, square].map(|s| s / n as f64);
        println!("mean {mean:.5}, absolute {absolute:.5}, square {square:.5}, largest {largest:.4}");
        assert!(largest <= MAX_NOISE && largest > 0.8, "{largest}");
        assert!(mean.abs() < 2e-3, "{mean}");
        assert!((absolute - MEAN_ABSOLUTE_NOISE).abs() < 2e-3, "{absolute}");
    }

    #[test]
    fn whole_coordinates_are_zero_and_have_the_slope_of_an_edge() {
        for i in 0..500 {
            let at = anywhere(i).round();
            assert_eq!(noise(at, 3), 0.0, "{at}");
            let step = 1e-5;
            let slope = |axis: DVec3| (noise(at + axis * step, 3) - noise(at - axis * step, 3)) / (2.0 * step);
            let mut gradient = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| slope(axis).abs());
            gradient.sort_unstable_by(f64::total_cmp);
            assert!(gradient[0] < 1e-6 && (gradient[1] - 1.0).abs() < 1e-6 && (gradient[2] - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn noise_and_its_slope_are_continuous_across_cells() {
        let step = 1e-4;
        for i in 0..2000 {
            let mut at = anywhere(i);
            at.x = at.x.round();
            let value = |offset: f64| noise(at + DVec3::X * offset, 1);
            assert!((value(1e-9) - value(-1e-9)).abs() < 1e-7, "{at}");
            let (before, after) = ((value(0.0) - value(-step)) / step, (value(step) - value(0.0)) / step);
            assert!((before - after).abs() < 0.01, "{at}: {before} {after}");
        }
    }

    #[test]
    fn keys_and_places_are_independent() {
        let n = 50_000;
        let correlation = |a: &dyn Fn(u64) -> f64, b: &dyn Fn(u64) -> f64| {
            let (mut product, mut square) = (0.0, 0.0);
            for i in 0..n {
                product += a(i) * b(i);
                square += a(i) * a(i);
            }
            product / square
        };
        let plain = |i| noise(anywhere(i), 0);
        for other in [1, 2, 3, 255, 1 << 16, 1 << 24, 0x8000_0000] {
            assert!(correlation(&plain, &|i| noise(anywhere(i), other)).abs() < 0.02, "{other}");
        }
        for offset in [DVec3::new(2.0, 0.0, 0.0), DVec3::new(0.0, 5.0, 0.0), DVec3::splat(256.0)] {
            assert!(correlation(&plain, &|i| noise(anywhere(i) + offset, 0)).abs() < 0.02, "{offset}");
        }
    }

    #[test]
    fn far_places_are_finite() {
        for at in [1e9, -1e15, 1e300, f64::MAX] {
            assert!(noise(DVec3::splat(at), 1).abs() <= MAX_NOISE, "{at}");
        }
    }
}
