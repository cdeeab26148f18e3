//! Weighted average of vectors by direction and length: the interpolation of the vector integral Q
//! (Hao & Varshney 2004, section 3.2, where quaternions turn one direction into the other).

use glam::DVec3;

/// Steps of the iteration at most; it converges quadratically.
const MOST_STEPS: usize = 32;

/// A step of this angle ends the iteration.
const CONVERGED: f64 = 1e-13;

/// Spherical average of the vectors' directions (Buss & Fillmore 2001, algorithm A1) times the weighted sum of their lengths.
///
/// Pairs are (weight, vector); weights usually sum to 1, and the length is linear in them. Vectors of length zero count with
/// their length only. Where directions have no average (they cancel, or negative weights lead away from the vectors), the
/// result is the linear sum. A vector or weight that is not finite is left out; the length is never negative.
pub(crate) fn spherical_mean(vectors: &[(f64, DVec3)]) -> DVec3 {
    let finite = || vectors.iter().filter(|(weight, vector)| weight.is_finite() && vector.is_finite());
    let length: f64 = finite().map(|(weight, vector)| weight * vector.length()).sum();
    let linear: DVec3 = finite().map(|(weight, vector)| *weight * *vector).sum();
    let directions: Vec<(f64, DVec3)> =
        finite().filter_map(|(weight, vector)| Some((*weight, vector.try_normalize()?))).collect();
    match average(&directions) {
        Some(direction) if length.is_finite() => direction * length.max(0.0),
        _ if linear.is_finite() => linear,
        _ => DVec3::ZERO,
    }
}

fn average(directions: &[(f64, DVec3)]) -> Option<DVec3> {
    let total: f64 = directions.iter().map(|(weight, _)| weight).sum();
    let sum: DVec3 = directions.iter().map(|(weight, direction)| *weight * *direction).sum();
    if !(total > 0.0 && total.is_finite() && sum.length() > 1e-9 * total) {
        return None;
    }
    let mut at = sum.normalize();
    for _ in 0..MOST_STEPS {
        let step: DVec3 = directions.iter().map(|(weight, direction)| *weight * to_tangent(at, *direction)).sum();
        let step = step / total;
        let angle = step.length();
        if !angle.is_finite() {
            return None;
        }
        if angle < CONVERGED {
            return Some(at);
        }
        at = (at * angle.cos() + step * (angle.sin() / angle)).normalize();
    }
    None
}

/// The tangent at `at` that leads to `direction` along a great circle, as long as the angle; zero for the antipode.
fn to_tangent(at: DVec3, direction: DVec3) -> DVec3 {
    let across = direction - at * at.dot(direction);
    let sine = across.length();
    if sine > 0.0 && direction.distance_squared(-at) > 1e-20 {
        across * (sine.atan2(at.dot(direction)) / sine)
    } else {
        DVec3::ZERO
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use translux::math::random::uniform;
    use translux::math::sphere::random_direction;

    #[test]
    fn two_directions_average_along_their_great_circle() {
        let at = |angle: f64| DVec3::new(angle.cos(), angle.sin(), 0.0);
        for share in [0.0, 0.2, 0.5, 0.9, 1.0] {
            let mean = spherical_mean(&[(1.0 - share, 2.0 * at(0.3)), (share, 4.0 * at(2.1))]);
            let expected = (2.0 * (1.0 - share) + 4.0 * share) * at(0.3 + 1.8 * share);
            assert!((mean - expected).length() < 1e-12, "{share}: {mean} {expected}");
        }
    }

    #[test]
    fn it_is_the_minimum_of_the_squared_angles() {
        for i in 0..50 {
            let centre = random_direction(1, i);
            let vectors: Vec<(f64, DVec3)> = (0..4)
                .map(|k| (uniform(2, i, k), (centre + 0.6 * random_direction(3, 4 * i + k)).normalize()))
                .collect();
            let cost = |q: DVec3| vectors.iter().map(|(w, v)| w * q.angle_between(*v).powi(2)).sum::<f64>();
            let mean = spherical_mean(&vectors).normalize();
            for k in 0..20 {
                assert!(cost((mean + 1e-3 * random_direction(4, k)).normalize()) > cost(mean) - 1e-12);
            }
            let turn = glam::DQuat::from_axis_angle(random_direction(5, i), 1.0);
            let turned: Vec<(f64, DVec3)> = vectors.iter().map(|(w, v)| (*w, turn * *v)).collect();
            assert!((turn * spherical_mean(&vectors) - spherical_mean(&turned)).length() < 1e-11);
        }
    }

    #[test]
    fn zero_antipodal_and_broken_vectors_are_safe() {
        assert_eq!(spherical_mean(&[]), DVec3::ZERO);
        assert_eq!(spherical_mean(&[(1.0, DVec3::ZERO)]), DVec3::ZERO);
        assert_eq!(spherical_mean(&[(0.5, DVec3::X), (0.5, DVec3::NEG_X)]), DVec3::ZERO);
        assert_eq!(spherical_mean(&[(0.5, DVec3::ZERO), (0.5, 2.0 * DVec3::Y)]), DVec3::Y);
        assert_eq!(spherical_mean(&[(1.0, DVec3::Y), (f64::NAN, DVec3::X), (1.0, DVec3::INFINITY)]), DVec3::Y);
        let uneven = spherical_mean(&[(0.7, DVec3::X), (0.3, DVec3::NEG_X)]);
        assert!((uneven - DVec3::X).length() < 1e-12, "{uneven}");
        for i in 0..500 {
            let vectors: Vec<(f64, DVec3)> = (0..5)
                .map(|k| {
                    (1e3 * (uniform(6, i, k) - 0.4), random_direction(7, 5 * i + k) * 1e200_f64.powf(uniform(8, i, k)))
                })
                .collect();
            assert!(spherical_mean(&vectors).is_finite());
        }
        assert!(spherical_mean(&[(1.0, DVec3::splat(f64::MAX)), (1.0, DVec3::splat(f64::MAX))]).is_finite());
    }
}
