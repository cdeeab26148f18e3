use glam::DVec3;

use super::directions::DirectionSet;
use super::interpolation::{Interpolator, MOST_ORDER, MOST_RBF, Scheme, default_order};
use super::test_functions::Lit;
use crate::error::ExitCode;
use crate::math::sh::real_sh;
use crate::math::sphere::random_direction;

fn interpolator(count: usize, scheme: Scheme) -> Interpolator {
    Interpolator::new(&DirectionSet::fibonacci(count).unwrap(), scheme).unwrap()
}

fn weights(interpolator: &Interpolator, direction: DVec3) -> Vec<f64> {
    let mut out = Vec::new();
    interpolator.weights(direction, &mut out);
    out
}

fn total(weights: &[f64], values: &[f64]) -> f64 {
    weights.iter().zip(values).map(|(w, v)| w * v).sum()
}

#[test]
fn constants_are_exact_for_every_scheme_and_count() {
    for count in [4, 5, 6, 9, 15, 16, 17, 50, 200, 333] {
        for scheme in Scheme::ALL {
            let interpolator = interpolator(count, scheme);
            let strange = [DVec3::ZERO, DVec3::NAN, DVec3::INFINITY, DVec3::splat(f64::MAX), DVec3::splat(1e-300)];
            for direction in (0..50).map(|i| random_direction(1, i)).chain(strange) {
                let weights = weights(&interpolator, direction);
                assert_eq!(weights.len(), count);
                let sum: f64 = weights.iter().sum();
                assert!((sum - 1.0).abs() < 1e-9, "{count} {scheme:?} {direction}: {sum}");
                if matches!(scheme, Scheme::Nearest4 | Scheme::Barycentric) {
                    assert!(weights.iter().all(|w| *w >= 0.0));
                    assert!(weights.iter().filter(|w| **w > 0.0).count() <= 4);
                }
            }
        }
    }
}

#[test]
fn interpolation_is_exact_at_the_directions() {
    for count in [4, 12, 50, 200, 800] {
        for scheme in [Scheme::Nearest4, Scheme::Barycentric, Scheme::Rbf] {
            let interpolator = interpolator(count, scheme);
            for (i, direction) in interpolator.set().directions().iter().enumerate().step_by(1 + count / 40) {
                for (j, weight) in weights(&interpolator, *direction).iter().enumerate() {
                    let exact = f64::from(u8::from(i == j));
                    assert!((weight - exact).abs() < 1e-8, "{count} {scheme:?} {i} {j}: {weight}");
                }
            }
        }
    }
}

#[test]
fn polynomials_are_exact_up_to_the_degree_that_is_promised() {
    let cases = [(4, Scheme::Rbf, 2), (15, Scheme::Rbf, 2), (16, Scheme::Rbf, 3), (200, Scheme::Rbf, 3)];
    let fitted = [20, 100, 200, 800].map(|count| (count, Scheme::LeastSquares, default_order(count)));
    for (count, scheme, order) in cases.into_iter().chain(fitted) {
        let interpolator = interpolator(count, scheme);
        let (mut at, mut there) = (vec![0.0; order * order], vec![0.0; order * order]);
        for i in 0..20 {
            let direction = random_direction(2, i);
            let mut sums = vec![0.0; order * order];
            for (weight, other) in weights(&interpolator, direction).iter().zip(interpolator.set().directions()) {
                real_sh(order, *other, &mut there);
                sums.iter_mut().zip(&there).for_each(|(sum, value)| *sum += weight * value);
            }
            real_sh(order, direction, &mut at);
            let worst = sums.iter().zip(&at).map(|(sum, value)| (sum - value).abs()).fold(0.0, f64::max);
            assert!(worst < 1e-10, "{count} {scheme:?}: {worst}");
        }
    }
}

#[test]
fn a_sum_over_lights_is_the_sum_of_their_weights() {
    for scheme in Scheme::ALL {
        let interpolator = interpolator(60, scheme);
        let lights: Vec<(DVec3, DVec3)> =
            (0..30).map(|i| (random_direction(3, i) * 5.0, random_direction(4, i).abs())).collect();
        let mut expected = vec![DVec3::ZERO; 60];
        for (direction, amount) in &lights {
            let weights = weights(&interpolator, *direction);
            expected.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += weight * *amount);
        }
        let found = interpolator.sum(&lights);
        assert!(found.iter().zip(&expected).all(|(a, b)| (*a - *b).abs().max_element() < 1e-11), "{scheme:?}");
        assert_eq!(interpolator.sum(&[]), vec![DVec3::ZERO; 60]);
    }
}

/// An arc of a great circle, in degrees from its start.
#[derive(Clone, Copy)]
struct Arc {
    circle: u64,
    from: f64,
    to: f64,
}

/// Most that a value moves in a step along an arc beyond the function's own motion, and the step where it does.
fn largest_jump(interpolator: &Interpolator, lit: &[(Lit, Vec<f64>)], arc: Arc, steps: u32) -> (f64, Arc) {
    let start = random_direction(21, arc.circle);
    let across = random_direction(22, arc.circle).cross(start).normalize();
    let angle = |k: u32| arc.from + (arc.to - arc.from) * f64::from(k) / f64::from(steps);
    let mut largest = (0.0, arc);
    let mut before: Vec<(f64, f64)> = Vec::new();
    for k in 0..=steps {
        let (sin, cos) = angle(k).to_radians().sin_cos();
        let direction = start * cos + across * sin;
        let weights = weights(interpolator, direction);
        let now: Vec<(f64, f64)> = lit.iter().map(|(f, values)| (f.at(direction), total(&weights, values))).collect();
        for ((exact, found), (exact_before, found_before)) in now.iter().zip(&before) {
            let jump = (found - found_before).abs() - (exact - exact_before).abs();
            if jump > largest.0 {
                largest = (jump, Arc { from: angle(k - 1), to: angle(k), ..arc });
            }
        }
        before = now;
    }
    largest
}

/// The largest jump in 0.1 degrees over some quarters of great circles, and its rest in a hundredth of that step.
fn jumps(interpolator: &Interpolator) -> [f64; 2] {
    let value_of = |f: &Lit| interpolator.set().directions().iter().map(|d| f.at(*d)).collect();
    let lit: Vec<(Lit, Vec<f64>)> = (0..24)
        .map(|i| Lit::new(i, 3.0, 30.0))
        .map(|f| {
            let values = value_of(&f);
            (f, values)
        })
        .collect();
    let sweep = |circle| largest_jump(interpolator, &lit, Arc { circle, from: 0.0, to: 90.0 }, 900);
    let (jump, arc) = (1..12).map(sweep).fold(sweep(0), |best, next| if next.0 > best.0 { next } else { best });
    [jump, largest_jump(interpolator, &lit, arc, 100).0]
}

#[test]
fn only_the_four_nearest_jump_when_a_light_turns() {
    for scheme in Scheme::ALL {
        let [jump, close] = jumps(&interpolator(200, scheme));
        // A hundredth of the step leaves a hundredth of the motion, and all of a jump.
        if scheme == Scheme::Nearest4 {
            assert!(jump > 0.05 && close > 0.5 * jump, "{jump} {close}");
        } else {
            assert!(jump < 0.005 && close < 0.05 * jump, "{scheme:?}: {jump} {close}");
        }
    }
}

#[test]
fn errors_are_those_of_the_documentation() {
    let lit: Vec<Lit> = (0..300).map(|i| Lit::new(i, 3.0, 30.0)).collect();
    for (scheme, documented) in Scheme::ALL.into_iter().zip(DOCUMENTED) {
        let interpolator = interpolator(200, scheme);
        let of_set = |f: &Lit| interpolator.set().directions().iter().map(|d| f.at(*d)).collect();
        let values: Vec<Vec<f64>> = lit.iter().map(of_set).collect();
        let mut sum = 0.0;
        for direction in (0..400).map(|i| random_direction(99, i)) {
            let weights = weights(&interpolator, direction);
            let error = |(f, values): (&Lit, &Vec<f64>)| (total(&weights, values) - f.at(direction)).powi(2);
            sum += lit.iter().zip(&values).map(error).sum::<f64>();
        }
        let rms = (sum / (300.0 * 400.0)).sqrt();
        assert!((rms / documented - 1.0).abs() < 0.01, "{scheme:?}: {rms}");
    }
}

/// RMS at 200 directions in the order of [`Scheme::ALL`].
const DOCUMENTED: [f64; 4] = [1.531e-2, 1.232e-2, 7.31e-3, 1.130e-2];

#[test]
fn what_does_not_fit_is_an_error() {
    let set = DirectionSet::fibonacci(MOST_RBF + 1).unwrap();
    assert_eq!(Interpolator::new(&set, Scheme::Rbf).unwrap_err().code(), ExitCode::Unsupported);
    let set = DirectionSet::fibonacci(50).unwrap();
    for order in [0, 8, MOST_ORDER + 1, usize::MAX] {
        assert!(Interpolator::least_squares(&set, order).is_err());
    }
    assert_eq!((default_order(0), default_order(200), default_order(4096)), (1, 10, MOST_ORDER));
}
