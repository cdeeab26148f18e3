//! The two-dimensional Haar transform of square pictures, orthonormal, for texels of any solid angles.
//!
//! A texel's value is held times the square root of its weight, so that plain dot products are weighted ones. Each level
//! turns 2 x 2 blocks into the part along the weights (a constant picture has nothing else) and three differences,
//! and goes on with the former in the upper left quarter: a constant picture has coefficient 0 alone. Equal weights
//! give the usual transform. No product is fused with an addition, so the bits are the same everywhere.

/// The transform for pictures of one size and one set of weights.
#[derive(Clone, Debug, PartialEq)]
pub struct Haar {
    side: usize,
    levels: Vec<Scale>,
}

/// Rotations of one level; all `[row][column]` of the pairs.
#[derive(Clone, Debug, PartialEq)]
struct Scale {
    size: usize,
    /// Cosine and sine for each horizontal pair: `size` rows of `size / 2`.
    across: [Vec<f32>; 2],
    /// Cosine and sine for each vertical pair of horizontal sums: `size / 2` rows of `size / 2`.
    down: [Vec<f32>; 2],
}

impl Haar {
    /// The transform for pictures of `side` x `side` texels with positive weights, row by row; `None` unless `side` is
    /// a power of two and there is one weight for each texel.
    pub fn new(side: usize, weights: &[f64]) -> Option<Self> {
        let positive = weights.iter().all(|w| *w > 0.0 && w.is_finite());
        if !side.is_power_of_two() || side.checked_mul(side) != Some(weights.len()) || !positive {
            return None;
        }
        let mut levels = Vec::new();
        let (mut size, mut weights) = (side, weights.to_vec());
        while size > 1 {
            let half = size / 2;
            let pair = |a: f64, b: f64| [(a / (a + b)).sqrt() as f32, (b / (a + b)).sqrt() as f32];
            let across: Vec<[f32; 2]> = weights.chunks_exact(2).map(|w| pair(w[0], w[1])).collect();
            let sums: Vec<f64> = weights.chunks_exact(2).map(|w| w[0] + w[1]).collect();
            let rows = |y: usize| sums[2 * y * half..(2 * y + 2) * half].split_at(half);
            let down: Vec<[f32; 2]> =
                (0..half).flat_map(|y| rows(y).0.iter().zip(rows(y).1).map(|(a, b)| pair(*a, *b))).collect();
            weights = (0..half).flat_map(|y| rows(y).0.iter().zip(rows(y).1).map(|(a, b)| a + b)).collect();
            let split = |pairs: &[[f32; 2]]| [0, 1].map(|i| pairs.iter().map(|p| p[i]).collect());
            levels.push(Scale { size, across: split(&across), down: split(&down) });
            size = half;
        }
        Some(Self { side, levels })
    }

    /// Transforms a picture in place; `scratch` holds as many numbers. Slices of other lengths are left as they are.
    #[inline(always)]
    pub fn forward(&self, picture: &mut [f32], scratch: &mut [f32]) {
        let side = self.side;
        if picture.len() != side * side || scratch.len() < side * side {
            return;
        }
        for level in &self.levels {
            let (size, half) = (level.size, level.size / 2);
            for y in 0..half {
                let (top, bottom) = picture[2 * y * side..].split_at(side);
                let rows = [&top[..size], &bottom[..size]];
                let (low, high) = scratch[..size * size].split_at_mut(half * size);
                let (sums, rights) = low[y * size..(y + 1) * size].split_at_mut(half);
                let (downs, both) = high[y * size..(y + 1) * size].split_at_mut(half);
                let across = |row: usize, i: usize| {
                    let at = (2 * y + row) * half;
                    &level.across[i][at..at + half]
                };
                let (c0, s0, c1, s1) = (across(0, 0), across(0, 1), across(1, 0), across(1, 1));
                let (c, s) = (&level.down[0][y * half..(y + 1) * half], &level.down[1][y * half..(y + 1) * half]);
                for x in 0..half {
                    let [a, b] = [rows[0][2 * x], rows[0][2 * x + 1]];
                    let [e, f] = [rows[1][2 * x], rows[1][2 * x + 1]];
                    let (sum0, right0) = (c0[x] * a + s0[x] * b, s0[x] * a - c0[x] * b);
                    let (sum1, right1) = (c1[x] * e + s1[x] * f, s1[x] * e - c1[x] * f);
                    sums[x] = c[x] * sum0 + s[x] * sum1;
                    downs[x] = s[x] * sum0 - c[x] * sum1;
                    rights[x] = std::f32::consts::FRAC_1_SQRT_2 * (right0 + right1);
                    both[x] = std::f32::consts::FRAC_1_SQRT_2 * (right0 - right1);
                }
            }
            for y in 0..size {
                picture[y * side..y * side + size].copy_from_slice(&scratch[y * size..(y + 1) * size]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::cube_map::solid_angles_sr;
    use crate::math::random::uniform;

    fn noise(side: usize, stage: u64) -> Vec<f32> {
        (0..side * side).map(|i| uniform(stage, i as u64, 0) as f32 - 0.3).collect()
    }

    fn dot(a: &[f32], b: &[f32]) -> f64 {
        a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum()
    }

    #[test]
    fn the_transform_keeps_dot_products() {
        for side in [1, 2, 8, 32, 64] {
            let random: Vec<f64> = (0..side * side).map(|i| 0.1 + uniform(3, i as u64, 0)).collect();
            for weights in [vec![1.0; side * side], solid_angles_sr(side), random] {
                let haar = Haar::new(side, &weights).unwrap();
                let (a, b, mut scratch) = (noise(side, 1), noise(side, 2), vec![0.0; side * side]);
                let (mut ta, mut tb) = (a.clone(), b.clone());
                haar.forward(&mut ta, &mut scratch);
                haar.forward(&mut tb, &mut scratch);
                assert!((dot(&ta, &tb) - dot(&a, &b)).abs() < 2e-6 * (dot(&a, &a) * dot(&b, &b)).sqrt());
            }
        }
    }

    #[test]
    fn a_constant_has_one_coefficient_and_an_impulse_few() {
        let (side, mut scratch) = (32, vec![0.0; 1024]);
        let weights = solid_angles_sr(side);
        let haar = Haar::new(side, &weights).unwrap();
        let mut flat: Vec<f32> = weights.iter().map(|w| w.sqrt() as f32).collect();
        haar.forward(&mut flat, &mut scratch);
        assert!((f64::from(flat[0]) - weights.iter().sum::<f64>().sqrt()).abs() < 1e-6);
        assert!(flat[1..].iter().all(|x| x.abs() < 1e-7));
        let mut impulse = vec![0.0; 1024];
        impulse[77] = 1.0;
        haar.forward(&mut impulse, &mut scratch);
        assert_eq!(impulse.iter().filter(|x| **x != 0.0).count(), 3 * 5 + 1);
    }

    #[test]
    fn other_sizes_are_refused_or_left_alone() {
        assert!(Haar::new(3, &[1.0; 9]).is_none() && Haar::new(4, &[1.0; 15]).is_none());
        assert!(Haar::new(0, &[]).is_none() && Haar::new(2, &[1.0, 0.0, 1.0, 1.0]).is_none());
        let haar = Haar::new(4, &[1.0; 16]).unwrap();
        let (mut picture, mut scratch) = (vec![1.0; 15], vec![0.0; 16]);
        haar.forward(&mut picture, &mut scratch);
        assert!(picture.iter().all(|x| *x == 1.0));
    }
}
