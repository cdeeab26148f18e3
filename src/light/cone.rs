//! The cone of a spot light, and the share of its intensity in a direction.

use glam::DVec3;

use super::validate;
use crate::error::{Error, Result};
use crate::math::sphere::unit;

/// Where a spot light shines, and how sharp its edge is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cone {
    /// The point that the axis goes through, world mm.
    pub to_mm: DVec3,
    /// Full angle between opposite edges, degrees, over 0 and at most 180.
    pub angle_degrees: f64,
    /// Share of the half angle, from the edge inwards, over which the intensity falls to 0; 0 for a sharp edge.
    pub blend: f64,
}

impl Cone {
    /// Checks a cone with its tip at `at_mm`.
    ///
    /// # Errors
    /// A target that is not finite or is the tip itself, an angle or a blend out of range (exit 3).
    pub fn new(at_mm: DVec3, to_mm: DVec3, angle_degrees: f64, blend: f64) -> Result<Self> {
        let to_mm = validate::position("to", to_mm)?;
        if to_mm == at_mm {
            return Err(Error::input("to is the light's own place; it is a point that the axis goes through, in mm"));
        }
        if !(to_mm - at_mm).is_finite() {
            return Err(Error::input("to is farther from at than numbers reach"));
        }
        if !(angle_degrees > 0.0 && angle_degrees <= 180.0) {
            return Err(Error::input(format!(
                "angle is the full angle of the cone, over 0 and at most 180 degrees, and it is {angle_degrees}"
            )));
        }
        if !(0.0..=1.0).contains(&blend) {
            return Err(Error::input(format!("blend is a share from 0 (a sharp edge) to 1, and it is {blend}")));
        }
        Ok(Self { to_mm, angle_degrees, blend })
    }

    /// Its falloff, seen from its tip.
    pub fn falloff(&self, at_mm: DVec3) -> ConeFalloff {
        let half = 0.5 * self.angle_degrees.to_radians();
        let full = half * (1.0 - self.blend);
        ConeFalloff { axis: unit(self.to_mm - at_mm), cos_edge: half.cos(), cos_full: full.cos() }
    }
}

/// The share of a point light's intensity by direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ConeFalloff {
    /// Unit direction of the axis, away from the light.
    pub axis: DVec3,
    /// Cosine of the angle beyond which there is no light.
    pub cos_edge: f64,
    /// Cosine of the angle within which there is all of it; not below `cos_edge`.
    pub cos_full: f64,
}

impl ConeFalloff {
    /// That of a point light that shines everywhere.
    pub const NONE: Self = Self { axis: DVec3::NEG_Y, cos_edge: -2.0, cos_full: -2.0 };

    /// Share of the intensity, 0 to 1, towards a place; `to_light` is the unit direction from there to the light. Between the edge
    /// and the full light it is `t^2 (3 - 2 t)` of the cosine.
    #[inline]
    pub fn at(&self, to_light: DVec3) -> f64 {
        let cosine = -self.axis.dot(to_light);
        if cosine >= self.cos_full {
            return 1.0;
        }
        if cosine <= self.cos_edge {
            return 0.0;
        }
        let t = (cosine - self.cos_edge) / (self.cos_full - self.cos_edge);
        t * t * (3.0 - 2.0 * t)
    }

    /// Returns whether it shines everywhere alike.
    pub fn is_none(&self) -> bool {
        self.cos_full < -1.0
    }

    /// One less the cosines of the edge and of the full light, which single precision can tell apart in narrow cones too.
    pub fn versines(&self) -> [f32; 2] {
        [self.cos_edge, self.cos_full].map(|cosine| (1.0 - cosine) as f32)
    }

    /// How much of a ball around `centre`, seen from the light at `at`, is lit: all of it in full, none, or else.
    pub fn lights_ball(&self, at: DVec3, centre: DVec3, radius: f64) -> Lit {
        let to_centre = centre - at;
        let distance = to_centre.length();
        if self.is_none() {
            return Lit::Fully;
        }
        if distance <= radius {
            return Lit::InPart;
        }
        let off_axis = self.axis.angle_between(to_centre);
        let half_width = (radius / distance).asin();
        if off_axis + half_width <= self.cos_full.acos() {
            Lit::Fully
        } else if off_axis - half_width >= self.cos_edge.acos() {
            Lit::Not
        } else {
            Lit::InPart
        }
    }
}

/// How a cone lights a body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lit {
    /// As a point light would.
    Fully,
    /// Not at all.
    Not,
    /// Some of it, or some of it less.
    InPart,
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::math::quadrature::gauss_legendre;

    const AT: DVec3 = DVec3::new(1.0, 5.0, -2.0);

    fn cone(angle: f64, blend: f64) -> ConeFalloff {
        Cone::new(AT, AT - 3.0 * DVec3::Z, angle, blend).unwrap().falloff(AT)
    }

    /// Direction to the light of a place that lies so many degrees off the axis.
    fn off(degrees: f64) -> DVec3 {
        let (sin, cos) = degrees.to_radians().sin_cos();
        -DVec3::new(sin, 0.0, -cos)
    }

    #[test]
    fn light_is_full_inside_falls_over_the_blend_and_ends_at_the_edge() {
        let falloff = cone(60.0, 0.5);
        assert!([0.0, 7.0, 14.99].iter().all(|a| falloff.at(off(*a)) == 1.0));
        assert!([30.01, 60.0, 90.0, 180.0].iter().all(|a| falloff.at(off(*a)) == 0.0));
        let between: Vec<f64> = (0..=20).map(|i| falloff.at(off(15.0 + 0.75 * f64::from(i)))).collect();
        assert!(between.windows(2).all(|w| w[1] <= w[0]) && between.iter().all(|s| (0.0..=1.0).contains(s)));
        let sharp = cone(60.0, 0.0);
        assert_eq!([sharp.at(off(29.99)), sharp.at(off(30.01))], [1.0, 0.0]);
        assert_eq!(cone(180.0, 0.0).at(off(89.9)), 1.0);
        assert!(ConeFalloff::NONE.at(off(180.0)) == 1.0 && ConeFalloff::NONE.is_none() && !sharp.is_none());
    }

    /// `t^2 (3 - 2 t)` has the mean 1/2, so that the flux is that of a sharp cone whose cosine lies in the middle.
    #[test]
    fn the_flux_has_its_closed_form() {
        for (angle, blend) in [(40.0, 0.3), (120.0, 1.0), (180.0, 0.15)] {
            let falloff = cone(angle, blend);
            let rule = gauss_legendre(400);
            let flux: f64 = rule.iter().map(|n| n.weight * falloff.at(off(n.position.acos().to_degrees()))).sum();
            let expected = 1.0 - 0.5 * (falloff.cos_edge + falloff.cos_full);
            assert!((flux / expected - 1.0).abs() < 2e-3, "{angle} {blend}: {flux} {expected}");
        }
    }

    #[test]
    fn balls_are_lit_in_full_in_part_or_not() {
        let falloff = cone(60.0, 0.5);
        let ball = |degrees: f64, radius: f64| falloff.lights_ball(AT, AT - 10.0 * off(degrees), radius);
        assert_eq!([ball(0.0, 2.5), ball(0.0, 2.7), ball(14.0, 0.1)], [Lit::Fully, Lit::InPart, Lit::Fully]);
        assert_eq!([ball(20.0, 0.1), ball(40.0, 1.0), ball(180.0, 1.0)], [Lit::InPart, Lit::Not, Lit::Not]);
        assert_eq!(ball(180.0, 11.0), Lit::InPart);
        assert_eq!(ConeFalloff::NONE.lights_ball(AT, AT, 1.0), Lit::Fully);
    }

    #[test]
    fn wrong_cones_are_refused() {
        let new = |to, angle, blend| Cone::new(AT, to, angle, blend).is_ok();
        assert!(new(DVec3::ZERO, 180.0, 1.0) && new(DVec3::ZERO, 1e-3, 0.0));
        assert!(!new(AT, 60.0, 0.0) && !new(DVec3::NAN, 60.0, 0.0));
        assert!([0.0, -1.0, 180.1, f64::NAN].iter().all(|angle| !new(DVec3::ZERO, *angle, 0.0)));
        assert!([-0.1, 1.1, f64::INFINITY, f64::NAN].iter().all(|blend| !new(DVec3::ZERO, 60.0, *blend)));
    }
}
