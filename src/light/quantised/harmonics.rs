//! Real spherical harmonics in the signs and the normalisation of Sloan et al. 2002 (Hao & Varshney 2004, section 4.1).

use std::f64::consts::{PI, SQRT_2};

use glam::DVec3;

/// Fills the first `order * order` values of `out` for a unit vector; degree l and order m are at `l * l + l + m`.
///
/// The recurrences run on normalised functions, so that no factorial overflows.
pub(super) fn real_sh(order: usize, direction: DVec3, out: &mut [f64]) {
    let DVec3 { x, y, z } = direction;
    // sin^m cos(m phi), sin^m sin(m phi) and the function of degree and order m over sin^m.
    let (mut cos, mut sin, mut sectoral) = (1.0, 0.0, (0.25 / PI).sqrt());
    for m in 0..order {
        let m_real = m as f64;
        if m > 0 {
            (cos, sin) = (x * cos - y * sin, x * sin + y * cos);
            sectoral *= -((2.0 * m_real + 1.0) / (2.0 * m_real)).sqrt();
        }
        let (mut before, mut current) = (0.0, sectoral);
        for l in m..order {
            let centre = l * l + l;
            if m == 0 {
                out[centre] = current;
            } else {
                out[centre + m] = SQRT_2 * cos * current;
                out[centre - m] = SQRT_2 * sin * current;
            }
            let ratio = |l: f64| (4.0 * l * l - 1.0) / (l * l - m_real * m_real);
            let next = l as f64 + 1.0;
            let fall = if l > m { before / ratio(l as f64).sqrt() } else { 0.0 };
            (before, current) = (current, ratio(next).sqrt() * (z * current - fall));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::quadrature::gauss_legendre;

    #[test]
    fn harmonics_are_orthonormal() {
        const ORDER: usize = 20;
        let mut gram = vec![0.0; ORDER * ORDER * ORDER * ORDER];
        let (mut values, turns) = ([0.0; ORDER * ORDER], 2 * ORDER);
        for node in gauss_legendre(ORDER) {
            for k in 0..turns {
                let (sin, cos) = (2.0 * PI * k as f64 / turns as f64).sin_cos();
                let r = (1.0 - node.position * node.position).sqrt();
                real_sh(ORDER, DVec3::new(r * cos, r * sin, node.position), &mut values);
                let weight = node.weight * 2.0 * PI / turns as f64;
                for (i, a) in values.iter().enumerate() {
                    for (j, b) in values.iter().enumerate() {
                        gram[i * ORDER * ORDER + j] += weight * a * b;
                    }
                }
            }
        }
        for (k, value) in gram.iter().enumerate() {
            let one = f64::from(u8::from(k / (ORDER * ORDER) == k % (ORDER * ORDER)));
            assert!((value - one).abs() < 1e-11, "{k}: {value}");
        }
    }
}
