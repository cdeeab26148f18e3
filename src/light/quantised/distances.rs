//! Point lights: the same directions on spheres of a few radii (Hao & Varshney 2004, section 3.3).

use glam::DVec3;

use super::directions::DirectionSet;
use crate::error::{Error, Result};
use crate::light::Light;

/// Most shells of a set.
pub const MOST_SHELLS: usize = 16;

/// Most that a shell's inverse distance may be, in inverse bounding radii.
pub const NEAREST: f64 = 0.99;

/// How values between two shells follow from those at the shells.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Blend {
    /// Linear in the inverse distance between the two nearest shells: the paper's, trilinear with the direction's.
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
        if !centre_mm.is_finite() || !(radius_mm > 0.0 && radius_mm.is_finite()) {
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

    /// Parallel light only.
    ///
    /// # Errors
    /// As [`DistanceSet::new`] (exit 3).
    pub fn parallel(centre_mm: DVec3, radius_mm: f64) -> Result<Self> {
        Self::new(centre_mm, radius_mm, vec![0.0], Blend::Linear)
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

    /// How values between shells are made.
    pub fn blend(&self) -> Blend {
        self.blend
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
        Error::unsupported(format!(
            "{at} is too near: this light set carries point lights from {:.3} mm on (the bounding radius is {:.3} mm); move the light \
             away or bake with nearer point lights",
            self.nearest_mm(),
            self.radius_mm
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

/// Lagrange's polynomials at `u`.
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
