//! The end of a flight through the medium: the boundary as the walk sees it, and the two shapes with exact answers.

use glam::DVec3;

/// A place on a surface made of triangles; zero where there are none.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Site {
    /// Triangle of the mesh.
    pub triangle: u32,
    /// Weight of its second corner.
    pub u: f32,
    /// Weight of its third corner.
    pub v: f32,
}

/// The end of a flight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Crossing {
    /// No crossing: the flight ends inside the medium.
    Inside,
    /// A crossing of the boundary.
    Surface {
        /// Point just inside where a reflected flight goes on, mm.
        inside_mm: DVec3,
        /// Geometric unit normal, outward.
        normal: DVec3,
        /// Place of the crossing.
        site: Site,
    },
    /// The flight is outside although it never crossed the boundary: an opening, or rounding beside a sharp edge.
    Lost,
}

/// The boundary of a homogeneous body.
pub trait Boundary: Sync {
    /// The first crossing of a flight of `reach_mm` (infinite is fine) from `from_mm` along a unit direction. `depth` counts the
    /// closed surfaces around the photon, for bodies made of several that overlap; it starts at 1.
    fn crossing(&self, from_mm: DVec3, direction: DVec3, reach_mm: f64, depth: &mut u32) -> Crossing;
}

/// The medium is everything below z = 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct HalfSpace;

impl Boundary for HalfSpace {
    #[inline(always)]
    fn crossing(&self, from_mm: DVec3, direction: DVec3, reach_mm: f64, _: &mut u32) -> Crossing {
        if from_mm.z + direction.z * reach_mm < 0.0 {
            return Crossing::Inside;
        }
        if direction.z <= 0.0 {
            return Crossing::Lost;
        }
        let distance = (-from_mm.z / direction.z).max(0.0);
        let at = from_mm + distance * direction;
        Crossing::Surface { inside_mm: DVec3::new(at.x, at.y, 0.0), normal: DVec3::Z, site: Site::default() }
    }
}

/// A ball around the origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sphere {
    /// Radius in mm.
    pub radius_mm: f64,
}

/// A point on a sphere is held inside by this share of the radius.
const JUST_INSIDE: f64 = 1.0 - 1e-12;

impl Boundary for Sphere {
    #[inline(always)]
    fn crossing(&self, from_mm: DVec3, direction: DVec3, reach_mm: f64, _: &mut u32) -> Crossing {
        let end = from_mm + direction * reach_mm;
        if end.length_squared() < self.radius_mm * self.radius_mm {
            return Crossing::Inside;
        }
        let along = from_mm.dot(direction);
        let discriminant = along * along + self.radius_mm * self.radius_mm - from_mm.length_squared();
        if discriminant < 0.0 {
            return Crossing::Lost;
        }
        let normal = (from_mm + (discriminant.sqrt() - along).max(0.0) * direction).normalize_or_zero();
        Crossing::Surface { inside_mm: normal * (self.radius_mm * JUST_INSIDE), normal, site: Site::default() }
    }
}
