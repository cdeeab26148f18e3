#![allow(clippy::unwrap_used)]

use std::f64::consts::TAU;

use super::*;
use crate::math::quadrature::integrate;
use crate::math::sphere::random_direction;
use crate::medium::phase::HenyeyGreenstein;

fn direction(i: u64) -> DVec3 {
    random_direction(71, i)
}

#[test]
fn the_product_of_both_sides_is_the_series() {
    for terms in [1, 4, 9, 16, 25, 64, 144] {
        for g in [-0.9, -0.4, 0.0, 0.25, 0.7] {
            let phase = LegendrePhase::henyey_greenstein(g, terms);
            assert_eq!((phase.terms(), phase.moments.len()), (terms, terms.isqrt()));
            for i in 0..20 {
                let (a, b) = (direction(2 * i), direction(2 * i + 1));
                let difference = phase.product(a, b) - phase.density(-a.dot(b));
                assert!(difference.abs() < 1e-11, "{terms} {g}: {difference:e}");
            }
        }
    }
}

#[test]
fn many_terms_are_henyey_and_greenstein_and_positive_g_is_forward() {
    let phase = LegendrePhase::henyey_greenstein(0.5, 144);
    for i in 0..=20 {
        let c = f64::from(i) / 10.0 - 1.0;
        assert!((phase.density(c) - HenyeyGreenstein::new(0.5).density(c)).abs() < 5e-3);
    }
    // Light that arrives from behind and goes on to the eye.
    let few = LegendrePhase::henyey_greenstein(0.25, 9);
    assert!(few.product(-DVec3::X, DVec3::X) > few.product(DVec3::X, DVec3::X));
}

#[test]
fn energy_and_mean_cosine_are_exact_for_every_g() {
    for terms in [4, 9, 16, 25] {
        for g in [-0.9, -0.7, -0.4, 0.0, 0.25, 0.4, 0.7, 0.9] {
            let phase = LegendrePhase::henyey_greenstein(g, terms);
            let total = integrate(|c| TAU * phase.density(c), -1.0, 1.0, 1e-13);
            let mean = integrate(|c| TAU * c * phase.density(c), -1.0, 1.0, 1e-13);
            assert!((total - 1.0).abs() < 1e-12 && (mean - g).abs() < 1e-12, "{terms} {g} {total} {mean}");
        }
    }
}

/// The least value of the series over the peak of the true function.
fn least(g: f64, terms: usize) -> f64 {
    let (phase, truth) = (LegendrePhase::henyey_greenstein(g, terms), HenyeyGreenstein::new(g));
    let values = (0..=2000).map(|i| phase.density(f64::from(i) / 1000.0 - 1.0));
    values.fold(f64::INFINITY, f64::min) / truth.density(g.signum())
}

#[test]
fn short_series_go_negative_where_the_table_says() {
    let table = [
        (0.25, [1.0, 0.0, 0.0, 0.0, 0.0]),
        (0.4, [1.0, -0.051, 0.0, 0.0, 0.0]),
        (0.7, [1.0, -0.058, -0.028, -0.056, -0.017]),
        (0.9, [1.0, -0.009, -0.007, -0.0145, -0.011]),
    ];
    for (g, expected) in table {
        for (terms, expected) in [1, 4, 9, 16, 25].into_iter().zip(expected) {
            let (found, mirrored) = (least(g, terms), least(-g, terms));
            assert!((found - mirrored).abs() < 1e-9);
            assert!((found.min(0.0) - f64::min(expected, 0.0)).abs() < 0.001);
        }
    }
    assert!(least(0.333, 4) > 0.0 && least(0.334, 4) < 0.0);
}

#[test]
fn terms_that_are_no_square_depend_on_direction() {
    for (g, least, most) in [(0.25, 0.10, 0.13), (0.4, 0.19, 0.23), (0.7, 0.3, 0.4)] {
        let spread = |terms: usize| {
            let phase = LegendrePhase::henyey_greenstein(g, terms);
            let forward: Vec<f64> = (0..500).map(|i| phase.product(-direction(i), direction(i))).collect();
            let (low, high) = forward.iter().fold((f64::MAX, f64::MIN), |(l, h), &v| (l.min(v), h.max(v)));
            (high - low) / (forward.iter().sum::<f64>() / 500.0)
        };
        assert!((least..most).contains(&spread(8)), "{}", spread(8));
        assert!(spread(4) < 1e-12 && spread(9) < 1e-12);
    }
}

#[test]
fn strange_numbers_of_terms_and_g_are_brought_inside() {
    assert_eq!(LegendrePhase::henyey_greenstein(f64::NAN, 0).terms(), 1);
    assert_eq!(LegendrePhase::henyey_greenstein(2.0, 100_000).terms(), MOST_TERMS);
    let (mut few, mut none) = ([0.0; 2], []);
    LegendrePhase::henyey_greenstein(0.3, 9).view(DVec3::X, &mut few);
    LegendrePhase::light(9, DVec3::X, &mut none);
    assert!(few.iter().all(|h| h.is_finite()));
}
