//! Lights in the coordinates of a mesh, prepared for all of its points.

use glam::DVec3;

use crate::error::Result;
use crate::light::Light;
use crate::light::cone::ConeFalloff;
use crate::light::environment::Rotation;
use crate::light::strata::{Candidate, Strata, StrataSettings};
use crate::math::spherical_rectangle::SphericalRectangle;

/// A point light comes no nearer to a place than the square root of this, so that irradiance stays finite.
pub(super) const LEAST_DISTANCE2_MM2: f64 = 1e-30;

/// A light, places relative to the mesh's origin (mm); `E` is what a stage makes of an environment.
pub(super) enum Prepared<E> {
    Constant {
        radiance: DVec3,
    },
    Directional {
        from: DVec3,
        irradiance: DVec3,
    },
    /// A point or a spot light.
    Point {
        at: DVec3,
        intensity: DVec3,
        falloff: ConeFalloff,
    },
    Area(Rectangle),
    Environment(E),
}

/// A stratum of an environment.
pub(super) struct Stratum {
    /// Candidate directions in the world.
    pub(super) candidates: Vec<Candidate>,
    /// Integral of the radiance, the sum of the channels, before the light's scale.
    pub(super) energy: f64,
}

impl<E> Prepared<E> {
    /// Prepares a light for a mesh with this origin. `environment` takes the strata of an environment and their energy.
    ///
    /// # Errors
    /// A cut that environments do not take.
    pub(super) fn new(
        light: &Light,
        origin_mm: DVec3,
        cut: StrataSettings,
        environment: impl FnOnce(Vec<Stratum>, f64) -> E,
    ) -> Result<Self> {
        Ok(match light {
            Light::Constant { radiance } => Self::Constant { radiance: *radiance },
            Light::Directional { from, irradiance } => Self::Directional { from: *from, irradiance: *irradiance },
            Light::Point { at_mm, intensity } => {
                Self::Point { at: *at_mm - origin_mm, intensity: *intensity, falloff: ConeFalloff::NONE }
            }
            Light::Spot { at_mm, cone, intensity } => {
                Self::Point { at: *at_mm - origin_mm, intensity: *intensity, falloff: cone.falloff(*at_mm) }
            }
            Light::Area { at_mm, normal, u, size_mm, radiance, .. } => {
                let (v, centre) = (normal.cross(*u), *at_mm - origin_mm);
                let corner = centre - 0.5 * size_mm[0] * *u - 0.5 * size_mm[1] * v;
                let (normal, axes, size_mm, radiance) = (*normal, [*u, v], *size_mm, *radiance);
                Self::Area(Rectangle { centre, corner, normal, axes, size_mm, radiance })
            }
            Light::Environment { map, rotate_degrees, scale } => {
                let strata = Strata::new(map, cut)?;
                let rotation = Rotation::from_degrees(*rotate_degrees);
                let turned =
                    |c: &Candidate| Candidate { direction: rotation.to_world(c.direction), weight: c.weight * *scale };
                let energies = strata.strata().iter().map(|stratum| stratum.energy.element_sum()).enumerate();
                let of =
                    |(i, energy)| Stratum { candidates: strata.candidates(i).iter().map(turned).collect(), energy };
                Self::Environment(environment(energies.map(of).collect(), strata.energy().element_sum()))
            }
        })
    }

    /// True for a directional, a point or a spot light: all points of a patch see one direction or one point.
    pub(super) fn is_sharp(&self) -> bool {
        matches!(self, Self::Directional { .. } | Self::Point { .. })
    }
}

/// A one-sided area light.
pub(super) struct Rectangle {
    centre: DVec3,
    pub(super) corner: DVec3,
    pub(super) normal: DVec3,
    pub(super) axes: [DVec3; 2],
    pub(super) size_mm: [f64; 2],
    pub(super) radiance: DVec3,
}

impl Rectangle {
    /// The rectangle as seen from a place; none from behind.
    pub(super) fn seen_from(&self, at: DVec3) -> Option<SphericalRectangle> {
        let [u, v] = self.axes;
        let behind = (at - self.centre).dot(self.normal) <= 0.0;
        (!behind).then(|| SphericalRectangle::new(at, self.corner, u, v, self.size_mm))
    }

    /// True if some of the rectangle is in front of a place with a unit normal, or nearly.
    pub(super) fn is_before(&self, at: DVec3, normal: DVec3) -> bool {
        const ROUNDING: f64 = 1e-6;
        let (corner, [width, height]) = (self.corner - at, self.size_mm);
        let edges = [width * self.axes[0].dot(normal), height * self.axes[1].dot(normal)];
        let highest = corner.dot(normal) + edges[0].max(0.0) + edges[1].max(0.0);
        highest > -ROUNDING * (corner.length() + width + height)
    }
}
