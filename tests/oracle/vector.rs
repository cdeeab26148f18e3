//! Three-component vectors as plain arrays, hashes for random numbers, Gauss-Legendre nodes.

use std::f64::consts::PI;

pub type V3 = [f64; 3];

#[inline]
pub fn add(a: V3, b: V3) -> V3 {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

#[inline]
pub fn sub(a: V3, b: V3) -> V3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline]
pub fn mul(a: V3, s: f64) -> V3 {
    [a[0] * s, a[1] * s, a[2] * s]
}

#[inline]
pub fn dot(a: V3, b: V3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline]
pub fn cross(a: V3, b: V3) -> V3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline]
pub fn length(a: V3) -> f64 {
    dot(a, a).sqrt()
}

#[inline]
pub fn distance(a: V3, b: V3) -> f64 {
    length(sub(a, b))
}

/// Unit vector along `a`, or zero where `a` has no direction.
#[inline]
pub fn normalised(a: V3) -> V3 {
    let l = length(a);
    if l > 0.0 && l.is_finite() { mul(a, 1.0 / l) } else { [0.0; 3] }
}

/// Two unit vectors that make a right-handed frame with the unit vector `n`.
#[inline]
pub fn frame(n: V3) -> (V3, V3) {
    let helper = if n[0].abs() < 0.6 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
    let t = normalised(cross(helper, n));
    (t, cross(n, t))
}

/// Rec. 709 luminance, used only to weigh colours against each other.
#[inline]
pub fn luminance(c: V3) -> f64 {
    0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2]
}

/// Mixes a counter into a hash; a chain of calls is a random number that depends on the counters only.
#[inline]
pub fn hash(state: u64, counter: u64) -> u64 {
    let mut z = state.rotate_left(23) ^ counter.wrapping_mul(0xd6e8_feb8_6659_fd93).wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 32)).wrapping_mul(0xd6e8_feb8_6659_fd93);
    z = (z ^ (z >> 29)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 32)
}

/// The hash as a number in [0, 1).
#[inline]
pub fn unit(h: u64) -> f64 {
    (h >> 11) as f64 / (1u64 << 53) as f64
}

/// Point `j` of a two-dimensional additive sequence (the plastic number's), shifted by the hash `shift`.
#[inline]
pub fn sequence_2d(shift: u64, j: u64) -> [f64; 2] {
    let a = unit(hash(shift, 1)) + 0.754_877_666_246_692_7 * (j + 1) as f64;
    let b = unit(hash(shift, 2)) + 0.569_840_290_998_053_2 * (j + 1) as f64;
    [a.fract(), b.fract()]
}

/// Gauss-Legendre nodes and weights on [-1, 1], by Newton's method on the Legendre polynomial.
pub fn gauss_legendre(n: usize) -> Vec<(f64, f64)> {
    (0..n)
        .map(|i| {
            let mut x = (PI * (i as f64 + 0.75) / (n as f64 + 0.5)).cos();
            let mut slope = 1.0;
            for _ in 0..100 {
                let (mut p0, mut p1) = (1.0, x);
                for k in 2..=n {
                    (p0, p1) = (p1, ((2 * k - 1) as f64 * x * p1 - (k - 1) as f64 * p0) / k as f64);
                }
                slope = n as f64 * (x * p1 - p0) / (x * x - 1.0);
                let step = p1 / slope;
                x -= step;
                if step.abs() < 1e-15 {
                    break;
                }
            }
            (x, 2.0 / ((1.0 - x * x) * slope * slope))
        })
        .collect()
}
