//! Real spherical harmonics.
//!
//! `y_l^m` as in Sloan, Kautz & Snyder 2002 and Hao & Varshney 2004, section 4.1: `sqrt(2) K cos(m phi) P_l^m(cos theta)` for
//! m > 0, `sqrt(2) K sin(-m phi) P_l^-m(cos theta)` for m < 0, `K P_l^0(cos theta)` for m = 0, with
//! `(x, y, z) = (sin theta cos phi, sin theta sin phi, cos theta)` and the factor (-1)^m in `P_l^m`, so that
//! `y_1 = sqrt(3 / (4 pi)) (-y, z, -x)`. They are orthonormal over the sphere. Order `n` has the bands l = 0 to n - 1, and
//! coefficient `(l, m)` lies at `l l + l + m`.

use std::f64::consts::PI;

use glam::DVec3;

/// Largest order that is tested.
pub const MOST_ORDER: usize = 32;

/// Writes the `order^2` harmonics of a unit vector, index `l l + l + m`, to `out`, as many as it holds.
///
/// Legendre functions are normalised from the start and divided by `sin^m theta`, whose part goes with `cos(m phi)` and
/// `sin(m phi)`: nothing overflows, and the poles need no care.
pub fn real_sh(order: usize, direction: DVec3, out: &mut [f64]) {
    let DVec3 { x, y, z } = direction;
    // K_m^m (2m - 1)!! with its sign, and sin^m theta times cos and sin of m phi.
    let (mut sectoral, mut cosine, mut sine) = ((0.25 / PI).sqrt(), 1.0, 0.0);
    let mut set = |index: usize, value: f64| {
        if let Some(out) = out.get_mut(index) {
            *out = value;
        }
    };
    for m in 0..order {
        let (mut before, mut legendre) = (0.0, sectoral);
        for l in m..order {
            if m == 0 {
                set(l * l + l, legendre);
            } else {
                set(l * l + l + m, std::f64::consts::SQRT_2 * cosine * legendre);
                set(l * l + l - m, std::f64::consts::SQRT_2 * sine * legendre);
            }
            let next = step(l + 1, m, z * legendre, before);
            (before, legendre) = (legendre, next);
        }
        let k = m as f64;
        sectoral *= -((2.0 * k + 3.0) / (2.0 * k + 2.0)).sqrt();
        (cosine, sine) = (x * cosine - y * sine, x * sine + y * cosine);
    }
}

/// The normalised `P_l^m` from `z P_(l-1)^m` and `P_(l-2)^m`.
fn step(l: usize, m: usize, z_times_last: f64, before: f64) -> f64 {
    let (l, m) = (l as f64, m as f64);
    let last = l - 1.0;
    let scale = ((4.0 * l * l - 1.0) / (l * l - m * m)).sqrt();
    let back = ((last * last - m * m) / (4.0 * last * last - 1.0)).max(0.0).sqrt();
    scale * (z_times_last - back * before)
}

/// `Sum c_i y_i` for `order^2` coefficients; further ones of an incomplete band are left out.
pub fn evaluate(coefficients: &[f64], direction: DVec3) -> f64 {
    let order = coefficients.len().isqrt();
    let mut harmonics = vec![0.0; order * order];
    real_sh(order, direction, &mut harmonics);
    coefficients.iter().zip(&harmonics).map(|(c, y)| c * y).sum()
}

#[cfg(test)]
#[path = "sh_tests.rs"]
mod tests;
