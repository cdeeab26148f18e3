//! Lights in the coordinates of a mesh, environments as strata of directions.

use glam::DVec3;

use super::directions::direction_key;
use crate::error::Result;
use crate::light::Light;
use crate::light::environment::Rotation;
use crate::light::strata::{Candidate, Strata, StrataSettings};

/// Candidate directions in each stratum of an environment.
pub(super) const CANDIDATES: usize = 64;

/// Strata with more than this share of an environment's energy are seen from every point of a patch.
const BRIGHT_SHARE: f64 = 0.02;

/// A light with the directions and the origin that all patches share.
pub(super) enum Prepared<'a> {
    Constant { radiance: DVec3 },
    Directional { from: DVec3, irradiance: DVec3 },
    Point { at: DVec3, intensity: DVec3 },
    Area(&'a Light),
    Environment { strata: Vec<StratumRays> },
}

/// Directions of one stratum of an environment.
pub(super) struct StratumRays {
    pub(super) candidates: Vec<Candidate>,
    /// Points of a patch that look there: all for a bright stratum, whose shadow may be as sharp as a sun's.
    pub(super) points: PointsUsed,
}

/// Points of a patch that look at a stratum.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum PointsUsed {
    One,
    All,
}

impl<'a> Prepared<'a> {
    /// Prepares a light for a mesh with this origin; an environment gets so many strata.
    ///
    /// # Errors
    /// A number of strata that environments do not take.
    pub(super) fn new(light: &'a Light, origin_mm: DVec3, directions: u32) -> Result<Self> {
        Ok(match light {
            Light::Constant { radiance } => Self::Constant { radiance: *radiance },
            Light::Directional { from, irradiance } => Self::Directional { from: *from, irradiance: *irradiance },
            Light::Point { at_mm, intensity } => Self::Point { at: *at_mm - origin_mm, intensity: *intensity },
            Light::Area { .. } => Self::Area(light),
            Light::Environment { map, rotate_degrees, scale } => {
                let settings = StrataSettings { strata: directions as usize, candidates: CANDIDATES };
                let strata = Strata::new(map, settings)?;
                let rotation = Rotation::from_degrees(*rotate_degrees);
                let turned =
                    |c: &Candidate| Candidate { direction: rotation.to_world(c.direction), weight: c.weight * *scale };
                let total = strata.energy().element_sum();
                let rays = strata.strata().iter().enumerate().map(|(i, stratum)| {
                    let share = stratum.energy.element_sum() / total;
                    StratumRays {
                        candidates: strata.candidates(i).iter().map(turned).collect(),
                        points: if share > BRIGHT_SHARE { PointsUsed::All } else { PointsUsed::One },
                    }
                });
                let mut rays: Vec<(u32, StratumRays)> =
                    rays.map(|r| (direction_key(r.candidates[0].direction), r)).collect();
                rays.sort_by_key(|(key, _)| *key);
                Self::Environment { strata: rays.into_iter().map(|(_, r)| r).collect() }
            }
        })
    }

    /// True for a directional or a point light: all points of a patch see one direction or one point.
    pub(super) fn is_sharp(&self) -> bool {
        matches!(self, Self::Directional { .. } | Self::Point { .. })
    }
}
