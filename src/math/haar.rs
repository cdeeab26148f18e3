//! The orthonormal two-dimensional Haar transform of square pictures (the nonstandard decomposition).
//!
//! Each level replaces 2 x 2 blocks by their scaled sum and three differences and goes on with the sums in the upper
//! left quarter: coefficient 0 is the sum over `side`. No product is fused with an addition, so the bits are the same
//! everywhere.

/// Transforms a picture of `side` x `side` numbers in place; `side` is a power of two, `scratch` holds as many numbers.
/// Pictures of other sizes are left as they are.
pub fn forward(side: usize, picture: &mut [f32], scratch: &mut [f32]) {
    if !fits(side, picture, scratch) {
        return;
    }
    let mut size = side;
    while size > 1 {
        let half = size / 2;
        for y in 0..half {
            let (top, bottom) = picture[2 * y * side..].split_at(side);
            let (top, bottom) = (&top[..size], &bottom[..size]);
            let (low, high) = scratch[..size * size].split_at_mut(half * size);
            let (low, high) = (&mut low[y * size..(y + 1) * size], &mut high[y * size..(y + 1) * size]);
            let ((sums, rights), (downs, both)) = (low.split_at_mut(half), high.split_at_mut(half));
            let pairs = top.chunks_exact(2).zip(bottom.chunks_exact(2));
            let out = sums.iter_mut().zip(rights).zip(downs.iter_mut().zip(both));
            for ((t, b), ((sum, right), (down, diagonal))) in pairs.zip(out) {
                let (s0, d0, s1, d1) = (t[0] + t[1], t[0] - t[1], b[0] + b[1], b[0] - b[1]);
                (*sum, *right, *down, *diagonal) =
                    (0.5 * (s0 + s1), 0.5 * (d0 + d1), 0.5 * (s0 - s1), 0.5 * (d0 - d1));
            }
        }
        for y in 0..size {
            picture[y * side..y * side + size].copy_from_slice(&scratch[y * size..(y + 1) * size]);
        }
        size = half;
    }
}

/// The inverse of [`forward`].
pub fn inverse(side: usize, picture: &mut [f32], scratch: &mut [f32]) {
    if !fits(side, picture, scratch) {
        return;
    }
    let mut size = 2;
    while size <= side {
        let half = size / 2;
        for y in 0..half {
            for x in 0..half {
                let at = |dy: usize, dx: usize| picture[(y + dy * half) * side + x + dx * half];
                let (sum, right, down, diagonal) = (at(0, 0), at(0, 1), at(1, 0), at(1, 1));
                let (s0, s1, d0, d1) = (sum + down, sum - down, right + diagonal, right - diagonal);
                let out = 2 * (y * size + x);
                (scratch[out], scratch[out + 1]) = (0.5 * (s0 + d0), 0.5 * (s0 - d0));
                (scratch[out + size], scratch[out + size + 1]) = (0.5 * (s1 + d1), 0.5 * (s1 - d1));
            }
        }
        for y in 0..size {
            picture[y * side..y * side + size].copy_from_slice(&scratch[y * size..(y + 1) * size]);
        }
        size *= 2;
    }
}

fn fits(side: usize, picture: &[f32], scratch: &[f32]) -> bool {
    let count = side.checked_mul(side);
    side.is_power_of_two() && count == Some(picture.len()) && count <= Some(scratch.len())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::uniform;

    fn noise(side: usize, stage: u64) -> Vec<f32> {
        (0..side * side).map(|i| uniform(stage, i as u64, 0) as f32 - 0.3).collect()
    }

    fn dot(a: &[f32], b: &[f32]) -> f64 {
        a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum()
    }

    #[test]
    fn the_transform_keeps_dot_products_and_has_an_inverse() {
        for side in [1, 2, 8, 32, 64] {
            let (a, b, mut scratch) = (noise(side, 1), noise(side, 2), vec![0.0; side * side]);
            let (mut ta, mut tb) = (a.clone(), b.clone());
            forward(side, &mut ta, &mut scratch);
            forward(side, &mut tb, &mut scratch);
            assert!((dot(&ta, &tb) - dot(&a, &b)).abs() < 1e-6 * (dot(&a, &a) * dot(&b, &b)).sqrt());
            let mean = a.iter().map(|x| f64::from(*x)).sum::<f64>() / side as f64;
            assert!((f64::from(ta[0]) - mean).abs() < 1e-4 * mean.abs());
            inverse(side, &mut ta, &mut scratch);
            assert!(ta.iter().zip(&a).all(|(x, y)| (x - y).abs() < 1e-6));
        }
    }

    #[test]
    fn a_constant_has_one_coefficient_and_an_impulse_few() {
        let (side, mut scratch) = (32, vec![0.0; 1024]);
        let mut flat = vec![2.0; 1024];
        forward(side, &mut flat, &mut scratch);
        assert_eq!(flat[0], 64.0);
        assert!(flat[1..].iter().all(|x| *x == 0.0));
        let mut impulse = vec![0.0; 1024];
        impulse[77] = 1.0;
        forward(side, &mut impulse, &mut scratch);
        assert_eq!(impulse.iter().filter(|x| **x != 0.0).count(), 3 * 5 + 1);
    }

    #[test]
    fn other_sizes_are_left_alone() {
        for (side, length) in [(0, 0), (3, 9), (4, 15)] {
            let (mut picture, mut scratch) = (vec![1.0; length], vec![0.0; 16]);
            forward(side, &mut picture, &mut scratch);
            inverse(side, &mut picture, &mut scratch);
            assert!(picture.iter().all(|x| *x == 1.0));
        }
    }
}
