//! Point lights: the same directions on spheres of a few radii (Hao & Varshney 2004, section 3.3).

use glam::DVec3;

use super::directions::DirectionSet;
use crate::error::{Error, Result};
use crate::light::Light;

/// Most shells of a set.
pub const MOST_SHELLS: usize = 16;

/// Largest inverse distance of a shell, in inverse bounding radii.
pub const NEAREST: f64 = 0.99;

/// Interpolation of values between shells from those at the shells.
///
/// RMS error by the number of shells (the parallel light counts as one) for point lights from far away to this many bounding
/// radii, spread by [`DistanceSet::spread`]; 200 blurred clamped cosines with shadow edges at random places within the bounding
/// sphere, 40 lights each, of an irradiance of 1 at the centre, at exact directions:
///
/// | blend, to | 2 | 3 | 4 | 5 | 6 | 8 |
/// | --- | --- | --- | --- | --- | --- | --- |
/// | linear, 3 radii | 9.2e-3 | 2.6e-3 | 1.1e-3 | 6.0e-4 | 4.3e-4 | 2.1e-4 |
/// | polynomial, 3 radii | 9.2e-3 | 1.5e-3 | 2.3e-4 | 1.6e-4 | 2.5e-5 | 3.7e-6 |
/// | linear, 1.5 radii | 5.2e-2 | 1.7e-2 | 7.8e-3 | 5.0e-3 | 3.5e-3 | 1.8e-3 |
/// | polynomial, 1.5 radii | 5.2e-2 | 1.1e-2 | 3.2e-3 | 2.3e-3 | 4.7e-4 | 2.2e-4 |
/// | linear, 1.25 radii | 1.0e-1 | 4.0e-2 | 1.7e-2 | 9.4e-3 | 6.9e-3 | 3.2e-3 |
/// | polynomial, 1.25 radii | 1.0e-1 | 2.8e-2 | 8.7e-3 | 4.9e-3 | 1.8e-3 | 6.4e-4 |
/// | polynomial, 1.11 radii | 2.0e-1 | 7.1e-2 | 3.0e-2 | 1.3e-2 | 4.1e-3 | 2.6e-3 |
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
pub enum Blend {
    /// Linear in the inverse distance between the two nearest shells: the paper's interpolation, trilinear together
    /// with that of the direction.
    Linear,
    /// The polynomial in the inverse distance through all shells.
    Polynomial,
}

/// Distances from the scene's centre at which point lights are carried, as u = radius / distance. The first is u = 0: parallel light.
#[derive(Clone, Debug, PartialEq)]
pub struct DistanceSet {
    centre_mm: DVec3,
    radius_mm: f64,
    inverse: Vec<f64>,
    blend: Blend,
}

impl DistanceSet {
    /// Shells around the scene whose bounding sphere has this centre and radius, at `inverse` (radius over distance): the first 0,
    /// ascending, at most [`NEAREST`].
    ///
    /// # Errors
    /// A centre that is not finite, a radius that is not positive, other distances than these, more than [`MOST_SHELLS`] (exit 3).
    pub fn new(centre_mm: DVec3, radius_mm: f64, inverse: Vec<f64>, blend: Blend) -> Result<Self> {
        if !(centre_mm.is_finite() && radius_mm > 0.0 && radius_mm.is_finite()) {
            return Err(Error::input(format!(
                "the bounding sphere of a light set has a centre and a positive radius in mm, not {centre_mm} and {radius_mm}"
            )));
        }
        let ascending = inverse.windows(2).all(|pair| pair[0] < pair[1]);
        let in_range = inverse.first() == Some(&0.0) && inverse.last().is_some_and(|u| *u <= NEAREST);
        if !ascending || !in_range || inverse.len() > MOST_SHELLS {
            return Err(Error::input(format!(
                "shells of point lights need 1 to {MOST_SHELLS} inverse distances that ascend from 0 to at most {NEAREST} bounding \
                 radii, not {inverse:?}"
            )));
        }
        Ok(Self { centre_mm, radius_mm, inverse, blend })
    }

    /// `count` shells from u = 0 to `nearest`, where `blend` has the least error: evenly for `Linear`, at the extrema of
    /// Chebyshev's polynomial for `Polynomial`. One shell is parallel light only.
    ///
    /// # Errors
    /// As [`DistanceSet::new`] (exit 3).
    pub fn spread(centre_mm: DVec3, radius_mm: f64, count: usize, nearest: f64, blend: Blend) -> Result<Self> {
        let last = count.clamp(1, MOST_SHELLS + 1) - 1;
        let at = |k: usize| {
            let share = k as f64 / last.max(1) as f64;
            match blend {
                Blend::Linear => share * nearest,
                // sin^2 keeps 0 and 1 exact, where (1 - cos) / 2 would not.
                Blend::Polynomial => (0.5 * std::f64::consts::PI * share).sin().powi(2) * nearest,
            }
        };
        if count == 0 {
            return Self::new(centre_mm, radius_mm, Vec::new(), blend);
        }
        Self::new(centre_mm, radius_mm, (0..=last).map(at).collect(), blend)
    }

    /// Centre of the scene in mm.
    pub fn centre_mm(&self) -> DVec3 {
        self.centre_mm
    }

    /// Radius of the scene's bounding sphere in mm.
    pub fn radius_mm(&self) -> f64 {
        self.radius_mm
    }

    /// Radius over distance of every shell, ascending from 0.
    pub fn inverse(&self) -> &[f64] {
        &self.inverse
    }

    /// The least distance from the centre in mm at which a point light is carried; infinite for parallel light only.
    pub fn nearest_mm(&self) -> f64 {
        self.inverse.last().map_or(f64::INFINITY, |u| self.radius_mm / u)
    }

    /// A weight for each shell, summing to 1, for a light at `distance_mm` from the centre.
    ///
    /// # Errors
    /// A light nearer than the nearest shell, or at no distance (exit 5).
    pub fn weights(&self, distance_mm: f64) -> Result<Vec<f64>> {
        let u = self.radius_mm / distance_mm;
        let last = self.inverse.last().copied().unwrap_or(0.0);
        // A light on the nearest shell itself is carried, whatever rounding says.
        if !(u >= 0.0 && u <= last * (1.0 + 1e-12)) {
            return Err(self.too_near(distance_mm));
        }
        let u = u.min(last);
        Ok(match self.blend {
            Blend::Linear => linear(&self.inverse, u),
            Blend::Polynomial => polynomial(&self.inverse, u),
        })
    }

    fn too_near(&self, distance_mm: f64) -> Error {
        let at = format!("a point light {distance_mm:.3} mm from the scene's centre");
        if self.inverse.len() < 2 {
            return Error::unsupported(format!(
                "{at}: this light set has parallel light only; bake it with point lights"
            ));
        }
        let (nearest, radius) = (self.nearest_mm(), self.radius_mm);
        Error::unsupported(format!(
            "{at} is too near: this light set carries point lights from {nearest:.3} mm on (the bounding radius is {radius:.3} mm); \
             move it away, bake for nearer ones (--set nearest, in bounding radii), or take a method that traces light, such as two_pass"
        ))
    }
}

fn linear(nodes: &[f64], u: f64) -> Vec<f64> {
    let mut weights = vec![0.0; nodes.len()];
    let above = nodes.partition_point(|node| *node <= u).min(nodes.len() - 1);
    if above == 0 {
        weights[0] = 1.0;
    } else {
        let share = ((u - nodes[above - 1]) / (nodes[above] - nodes[above - 1])).clamp(0.0, 1.0);
        weights[above - 1] = 1.0 - share;
        weights[above] = share;
    }
    weights
}

/// Values of Lagrange's polynomials at `u`.
fn polynomial(nodes: &[f64], u: f64) -> Vec<f64> {
    let factor = |k: usize| {
        let others = nodes.iter().enumerate().filter(move |(j, _)| *j != k);
        others.map(|(_, node)| (u - node) / (nodes[k] - node)).product()
    };
    (0..nodes.len()).map(factor).collect()
}

/// The entries of a light set: every direction at every distance.
#[derive(Clone, Debug, PartialEq)]
pub struct QuantisedLights {
    /// Directions from the scene's centre.
    pub directions: DirectionSet,
    /// Distances from it.
    pub shells: DistanceSet,
}

impl QuantisedLights {
    /// Number of entries: directions times shells. Entry `shell * directions + direction`.
    pub fn count(&self) -> usize {
        self.directions.count() * self.shells.inverse.len()
    }

    /// The light of an entry, white, with an irradiance of 1 at the scene's centre on a surface that faces it. None past the end.
    pub fn entry(&self, index: usize) -> Option<Light> {
        let u = *self.shells.inverse.get(index / self.directions.count())?;
        let from = *self.directions.directions().get(index % self.directions.count())?;
        if u == 0.0 {
            return Some(Light::Directional { from, irradiance: DVec3::ONE });
        }
        let distance_mm = self.shells.radius_mm / u;
        Some(Light::Point {
            at_mm: self.shells.centre_mm + distance_mm * from,
            intensity: DVec3::splat(distance_mm * distance_mm),
        })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::error::ExitCode;
    use crate::light::quantised::test_functions::Lit;
    use crate::math::random::uniform;
    use crate::math::sphere::random_direction;

    const CENTRE: DVec3 = DVec3::new(1.0, -2.0, 3.0);

    #[test]
    fn weights_sum_to_one_and_pick_the_shells() {
        for blend in [Blend::Linear, Blend::Polynomial] {
            for count in 1..=8 {
                let set = DistanceSet::spread(CENTRE, 10.0, count, 0.8, blend).unwrap();
                assert_eq!((set.inverse().len(), set.inverse()[0]), (count, 0.0));
                for (k, u) in set.inverse().iter().enumerate() {
                    let weights = set.weights(10.0 / u).unwrap();
                    assert!(weights.iter().enumerate().all(|(j, w)| (w - f64::from(u8::from(j == k))).abs() < 1e-12));
                }
                for i in 0..50 {
                    let u = set.inverse()[count - 1] * uniform(1, i, 0);
                    let sum: f64 = set.weights(10.0 / u).unwrap().iter().sum();
                    assert!((sum - 1.0).abs() < 1e-12);
                }
                assert!(set.weights(f64::INFINITY).unwrap()[0] == 1.0);
                assert!(count == 1 || (set.weights(1e300).unwrap()[0] - 1.0).abs() < 1e-15);
            }
        }
    }

    #[test]
    fn nearer_lights_are_refused_with_the_distance_that_is_carried() {
        let set = DistanceSet::spread(CENTRE, 10.0, 4, 0.8, Blend::Polynomial).unwrap();
        assert_eq!(set.nearest_mm(), 12.5);
        assert!(set.weights(12.5).is_ok());
        for distance in [12.4, 1.0, 0.0, f64::NAN, -20.0] {
            let error = set.weights(distance).unwrap_err();
            assert_eq!(error.code(), ExitCode::Unsupported);
            assert!(error.message().contains("from 12.500 mm on"), "{error}");
        }
        let parallel = DistanceSet::new(CENTRE, 10.0, vec![0.0], Blend::Linear).unwrap();
        assert!(parallel.weights(1e6).unwrap_err().message().contains("parallel light only"));
        assert_eq!(parallel.weights(f64::INFINITY).unwrap(), [1.0]);
    }

    #[test]
    fn wrong_sets_are_refused() {
        let new = |radius: f64, inverse: &[f64]| DistanceSet::new(CENTRE, radius, inverse.to_vec(), Blend::Linear);
        assert!(new(1.0, &[0.0, 0.5]).is_ok());
        for radius in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(new(radius, &[0.0]).is_err());
        }
        for inverse in [&[][..], &[0.1], &[0.0, 0.0], &[0.0, 0.5, 0.4], &[0.0, 1.0], &[0.0, f64::NAN]] {
            assert!(new(1.0, inverse).is_err(), "{inverse:?}");
        }
        assert!(DistanceSet::new(DVec3::NAN, 1.0, vec![0.0], Blend::Linear).is_err());
        for count in [0, MOST_SHELLS + 1, usize::MAX] {
            assert!(DistanceSet::spread(CENTRE, 1.0, count, 0.5, Blend::Linear).is_err());
        }
    }

    #[test]
    fn entries_give_an_irradiance_of_one_at_the_centre() {
        let lights = QuantisedLights {
            directions: DirectionSet::fibonacci(12).unwrap(),
            shells: DistanceSet::spread(CENTRE, 10.0, 3, 0.5, Blend::Polynomial).unwrap(),
        };
        assert_eq!(lights.count(), 36);
        for index in 0..36 {
            let direction = lights.directions.directions()[index % 12];
            match lights.entry(index).unwrap() {
                Light::Directional { from, irradiance } => {
                    assert!(index < 12 && from == direction && irradiance == DVec3::ONE);
                }
                Light::Point { at_mm, intensity } => {
                    let to_light = at_mm - CENTRE;
                    assert!((to_light.normalize() - direction).length() < 1e-12);
                    assert!((intensity / to_light.length_squared() - 1.0).abs().max_element() < 1e-12);
                    assert!((10.0 / to_light.length() - lights.shells.inverse()[index / 12]).abs() < 1e-12);
                }
                light => unreachable!("{light:?}"),
            }
        }
        assert!(lights.entry(36).is_none() && lights.entry(usize::MAX).is_none());
    }

    /// RMS over random surface points of the unit ball and inverse distances up to `nearest`, at exact directions.
    fn error(set: &DistanceSet, nearest: f64) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0);
        for i in 0..200 {
            let lit = Lit::new(i, 3.0, 30.0);
            let place = random_direction(31, i) * (0.3 + 0.7 * uniform(32, i, 0));
            for k in 0..40 {
                let (direction, u) = (random_direction(33, 40 * i + k), nearest * uniform(34, 40 * i + k, 0));
                let weights = set.weights(1.0 / u).unwrap();
                let found: f64 = weights
                    .iter()
                    .zip(set.inverse())
                    .map(|(w, shell)| w * lit.at_point(place, direction, *shell))
                    .sum();
                sum += (found - lit.at_point(place, direction, u)).powi(2);
                count += 1.0;
            }
        }
        (sum / count).sqrt()
    }

    #[test]
    fn polynomials_need_fewer_shells() {
        let of = |blend, count| error(&DistanceSet::spread(CENTRE, 1.0, count, 2.0 / 3.0, blend).unwrap(), 2.0 / 3.0);
        assert!(of(Blend::Polynomial, 4) < 0.6 * of(Blend::Linear, 4));
        assert!(of(Blend::Polynomial, 6) < 0.3 * of(Blend::Linear, 6));
    }
}
