//! Light from far away as spherical harmonics, the factor of transport that is stored in them.
//!
//! The polar axis is +Y, up: a turn of an environment about it turns pairs of coefficients, and a map is projected once for all
//! its turns.

use std::sync::{Arc, Mutex, OnceLock, PoisonError, Weak};

use glam::DVec3;

use super::Light;
use super::environment::EnvironmentMap;
use super::quantised::vector::distant;
use crate::error::{Error, Result};
use crate::math::sh::real_sh;
use crate::parallel::*;

/// Pieces of light that are summed together.
const CHUNK: usize = 512;

/// Maps whose projections are kept.
const KEPT: usize = 16;

/// A world direction in the axes of the harmonics, whose pole is world +Y.
pub fn to_harmonics(world: DVec3) -> DVec3 {
    DVec3::new(world.z, world.x, world.y)
}

/// RGB coefficients of a light's radiance, `order^2` of them: `Int L(w) y_k(w) dw`. A directional light is a Dirac impulse of its
/// irradiance.
///
/// # Errors
/// A light that is not far away (exit 5); a light so bright that sums overflow (exit 4).
pub fn coefficients(light: &Light, order: usize) -> Result<Vec<DVec3>> {
    let result = match light {
        Light::Environment { map, rotate_degrees, scale } => {
            let mut unturned = projected(map, order)?;
            turn(&mut unturned, rotate_degrees.rem_euclid(360.0).to_radians());
            unturned.iter_mut().for_each(|c| *c *= *scale);
            unturned
        }
        Light::Constant { radiance } => {
            let mut all = vec![DVec3::ZERO; order * order];
            if let Some(first) = all.first_mut() {
                *first = *radiance * (4.0 * std::f64::consts::PI).sqrt();
            }
            all
        }
        _ => sum(&distant(light)?, order),
    };
    match result.iter().all(|c| c.is_finite()) {
        true => Ok(result),
        false => Err(Error::runtime("the light is too bright for double precision; make it weaker")),
    }
}

/// Coefficients of the sum of pieces of light, each a direction (of any length) and an irradiance.
fn sum(pieces: &[(DVec3, DVec3)], order: usize) -> Vec<DVec3> {
    let of_chunk = |pieces: &[(DVec3, DVec3)]| {
        let mut sums = vec![DVec3::ZERO; order * order];
        let mut harmonics = vec![0.0; order * order];
        for (direction, irradiance) in pieces {
            real_sh(order, to_harmonics(direction.normalize_or_zero()), &mut harmonics);
            sums.iter_mut().zip(&harmonics).for_each(|(sum, y)| *sum += *y * *irradiance);
        }
        sums
    };
    let mut total = vec![DVec3::ZERO; order * order];
    for chunk in pieces.par_chunks(CHUNK).map(of_chunk).collect::<Vec<_>>() {
        total.iter_mut().zip(chunk).for_each(|(total, sum)| *total += sum);
    }
    total
}

/// Turns the function counter-clockwise about the pole.
fn turn(coefficients: &mut [DVec3], angle: f64) {
    let order = coefficients.len().isqrt();
    for m in 1..order {
        let (sin, cos) = (m as f64 * angle).sin_cos();
        for l in m..order {
            let (plus, minus) = (coefficients[l * l + l + m], coefficients[l * l + l - m]);
            coefficients[l * l + l + m] = cos * plus - sin * minus;
            coefficients[l * l + l - m] = sin * plus + cos * minus;
        }
    }
}

struct Known {
    map: Weak<EnvironmentMap>,
    coefficients: Arc<Vec<DVec3>>,
}

/// The projection of a map that is not turned; the last maps are remembered while they live.
fn projected(map: &Arc<EnvironmentMap>, order: usize) -> Result<Vec<DVec3>> {
    static KNOWN: OnceLock<Mutex<Vec<Known>>> = OnceLock::new();
    let known = KNOWN.get_or_init(Mutex::default);
    let same = |k: &Known| std::ptr::eq(k.map.as_ptr(), Arc::as_ptr(map)) && k.coefficients.len() >= order * order;
    {
        let mut known = known.lock().unwrap_or_else(PoisonError::into_inner);
        known.retain(|k| k.map.strong_count() > 0);
        if let Some(found) = known.iter().find(|k| same(k)) {
            // Lower bands do not depend on the order.
            return Ok(found.coefficients[..order * order].to_vec());
        }
    }
    let light = Light::Environment { map: Arc::clone(map), rotate_degrees: 0.0, scale: DVec3::ONE };
    let coefficients = Arc::new(sum(&distant(&light)?, order));
    let mut known = known.lock().unwrap_or_else(PoisonError::into_inner);
    if known.len() >= KEPT {
        known.remove(0);
    }
    known.push(Known { map: Arc::downgrade(map), coefficients: Arc::clone(&coefficients) });
    Ok(coefficients.to_vec())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::light::sky::sky;
    use crate::math::sh::evaluate;

    #[test]
    fn turned_maps_have_the_coefficients_of_their_pieces() {
        let map = Arc::new(sky());
        let energy = map.energy();
        for degrees in [0.0, 33.0, 90.0, 251.5, -40.0] {
            let scale = DVec3::new(2.0, 1.0, 0.5);
            let light = Light::environment(Arc::clone(&map), degrees, scale).unwrap();
            let order = 9;
            let (found, expected) = (coefficients(&light, order).unwrap(), sum(&distant(&light).unwrap(), order));
            for (k, (a, b)) in found.iter().zip(&expected).enumerate() {
                // Pieces are cut by texels that do not turn along.
                assert!((*a - *b).abs().max_element() < 1e-3 * energy.max_element(), "{degrees} {k}: {a} {b}");
            }
            // The same cache serves lower orders.
            assert_eq!(coefficients(&light, 4).unwrap(), found[..16]);
        }
    }

    #[test]
    fn a_direction_is_an_impulse_and_a_constant_the_first_harmonic() {
        let from = DVec3::new(0.3, 0.5, -0.8).normalize();
        let light = Light::directional(from, DVec3::new(3.0, 2.0, 1.0)).unwrap();
        let found = coefficients(&light, 12).unwrap();
        let red: Vec<f64> = found.iter().map(|c| c.x).collect();
        // Brightest where it comes from, as bright as an impulse of 12 bands.
        let peak = evaluate(&red, to_harmonics(from));
        assert!((peak - 3.0 * 144.0 / (4.0 * std::f64::consts::PI)).abs() < 1e-9);
        assert!((found[0].y - 2.0 / (4.0 * std::f64::consts::PI).sqrt()).abs() < 1e-12);
        let constant = coefficients(&Light::Constant { radiance: DVec3::splat(0.7) }, 3).unwrap();
        assert!((evaluate(&constant.iter().map(|c| c.z).collect::<Vec<_>>(), DVec3::X) - 0.7).abs() < 1e-12);
        assert!(constant[1..].iter().all(|c| *c == DVec3::ZERO));
    }

    #[test]
    fn lights_at_a_distance_are_refused() {
        let light = Light::point(DVec3::ONE, DVec3::ONE).unwrap();
        assert!(coefficients(&light, 3).is_err());
        let bright = Light::Constant { radiance: DVec3::splat(f64::MAX) };
        assert!(coefficients(&bright, 3).is_err());
    }
}
