use super::*;
use crate::math::quadrature::gauss_legendre_const;
use crate::math::random::uniform;

/// A rule that is exact for polynomials of degree 2 * 32 on the sphere.
fn sphere() -> Vec<(DVec3, f64)> {
    const AROUND: usize = 66;
    let nodes = gauss_legendre_const::<33>();
    let angle = |i: usize| 2.0 * PI * (i as f64 + 0.3) / AROUND as f64;
    let point = |z: f64, i: usize| {
        let r = (1.0 - z * z).sqrt();
        DVec3::new(r * angle(i).cos(), r * angle(i).sin(), z)
    };
    nodes
        .iter()
        .flat_map(|node| (0..AROUND).map(move |i| (point(node.position, i), node.weight * 2.0 * PI / AROUND as f64)))
        .collect()
}

#[test]
fn harmonics_are_orthonormal_up_to_the_highest_order() {
    let count = MOST_ORDER * MOST_ORDER;
    let rule = sphere();
    let mut rows = vec![0.0; count * rule.len()];
    for (row, (direction, weight)) in rows.chunks_exact_mut(count).zip(&rule) {
        real_sh(MOST_ORDER, *direction, row);
        row.iter_mut().for_each(|y| *y *= weight.sqrt());
    }
    let mut gram = vec![0.0; count * count];
    for row in rows.chunks_exact(count) {
        for (a, gram) in row.iter().zip(gram.chunks_exact_mut(count)) {
            gram.iter_mut().zip(row).for_each(|(g, b)| *g += a * b);
        }
    }
    for (at, g) in gram.iter().enumerate() {
        let expected = f64::from(u8::from(at / count == at % count));
        assert!((g - expected).abs() < 1e-12, "{} {}: {g}", at / count, at % count);
    }
}

/// The closed forms of Sloan 2008, appendix A2.
#[test]
fn low_orders_are_the_published_polynomials() {
    for i in 0..20 {
        let d = DVec3::new(uniform(1, i, 0) - 0.5, uniform(1, i, 1) - 0.5, uniform(1, i, 2) - 0.5).normalize();
        let DVec3 { x, y, z } = d;
        let root = |n: f64, k: f64| (n / (k * PI)).sqrt();
        let expected = [
            root(1.0, 4.0),
            -root(3.0, 4.0) * y,
            root(3.0, 4.0) * z,
            -root(3.0, 4.0) * x,
            root(15.0, 4.0) * x * y,
            -root(15.0, 4.0) * y * z,
            root(5.0, 16.0) * (3.0 * z * z - 1.0),
            -root(15.0, 4.0) * x * z,
            root(15.0, 16.0) * (x * x - y * y),
            -root(35.0, 32.0) * y * (3.0 * x * x - y * y),
            root(105.0, 4.0) * x * y * z,
            -root(21.0, 32.0) * y * (5.0 * z * z - 1.0),
            root(7.0, 16.0) * z * (5.0 * z * z - 3.0),
            -root(21.0, 32.0) * x * (5.0 * z * z - 1.0),
            root(105.0, 16.0) * z * (x * x - y * y),
            -root(35.0, 32.0) * x * (x * x - 3.0 * y * y),
        ];
        let mut found = [0.0; 16];
        real_sh(4, d, &mut found);
        for (found, expected) in found.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-14, "{found} {expected}");
        }
    }
}

/// Sum_m y_lm(a) y_lm(b) = (2l + 1) / (4 pi) P_l(a . b), poles included; a short `out` gets the first ones.
#[test]
fn the_addition_theorem_holds() {
    let directions = [DVec3::Z, DVec3::NEG_Z, DVec3::X, DVec3::NEG_Y, DVec3::new(0.6, -0.48, 0.64)];
    let values = |d: DVec3| {
        let mut values = vec![0.0; MOST_ORDER * MOST_ORDER];
        real_sh(MOST_ORDER, d, &mut values);
        values
    };
    for a in directions {
        for b in directions {
            let (ya, yb, t) = (values(a), values(b), a.dot(b));
            let (mut before, mut legendre) = (0.0, 1.0);
            for l in 0..MOST_ORDER {
                let sum: f64 = (l * l..(l + 1) * (l + 1)).map(|i| ya[i] * yb[i]).sum();
                let k = l as f64;
                assert!((sum - (2.0 * k + 1.0) / (4.0 * PI) * legendre).abs() < 1e-12, "{a} {b} {l}");
                (before, legendre) = (legendre, ((2.0 * k + 1.0) * t * legendre - k * before) / (k + 1.0));
            }
        }
    }
    let mut short = [7.0; 5];
    real_sh(24, directions[4], &mut short);
    assert_eq!(short, values(directions[4])[..5]);
    real_sh(0, DVec3::Z, &mut short);
}
