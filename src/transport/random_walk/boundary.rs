//! The end of a flight through the medium: the boundary as the walk sees it, that of a part of a mesh, and the two shapes with exact
//! answers.

use glam::DVec3;

use super::clearance::{Clearance, ClearanceGrid};
use crate::geometry::bvh::{Bvh, Hit, Ray, offset_origin};
use crate::geometry::mesh::Mesh;

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

/// The triangles of one part, in the mesh's local coordinates (mm).
#[derive(Clone, Debug)]
pub struct MeshBoundary {
    bvh: Bvh,
    /// Triangles of the mesh.
    triangles: Vec<u32>,
    normals: Vec<DVec3>,
    grid: ClearanceGrid,
    /// Rounding of coordinates, generously: a surface this near behind a ray's origin may be in front of it, mm.
    slack_mm: f32,
}

/// Steps through free space from both ends before a ray is cast.
const MOST_STEPS: u32 = 6;

/// A step that covers less than this share of the remaining way is the last.
const LEAST_GAIN: f64 = 0.2;

/// Surfaces of the same part inside each other that one flight crosses at most; more are a loop of rounding errors.
const MOST_NESTED: u32 = 64;

/// Slack over the largest coordinate: the step of [`offset_origin`].
const SLACK: f64 = 1.0 / 524_288.0;

impl MeshBoundary {
    /// The boundary of a part with these triangles, whose medium has this mean free path (unreduced).
    pub fn new(mesh: &Mesh, triangles: Vec<u32>, free_path_mm: f64) -> Self {
        let corners: Vec<[DVec3; 3]> = triangles.iter().map(|&t| mesh.corners_local_mm(t)).collect();
        let single: Vec<_> = corners.iter().map(|c| c.map(|p| p.as_vec3())).collect();
        let largest = corners.iter().flatten().map(|p| p.abs().max_element()).fold(0.0, f64::max);
        Self {
            bvh: Bvh::from_triangles(&single),
            normals: triangles.iter().map(|&t| mesh.normal(t)).collect(),
            grid: ClearanceGrid::new(&corners, free_path_mm),
            triangles,
            slack_mm: (SLACK * largest) as f32,
        }
    }

    /// The triangles as rays meet them, in the order in which they were given.
    pub(in crate::transport) fn bvh(&self) -> &Bvh {
        &self.bvh
    }

    /// A point of a triangle, moved just inside.
    pub(in crate::transport) fn just_inside(point: DVec3, normal: DVec3) -> DVec3 {
        offset_origin(point.as_vec3(), -normal.as_vec3()).as_dvec3()
    }

    /// [`Boundary::crossing`] by rays, where the grid leaves it open.
    fn cast(&self, from: DVec3, direction: DVec3, reach: f64, depth: &mut u32) -> Crossing {
        // Single precision may shorten the reach below a hit that lies before its end.
        let mut ray = Ray {
            origin: from.as_vec3(),
            direction: direction.as_vec3(),
            t_min: -self.slack_mm,
            t_max: (reach as f32).next_up(),
        };
        for _ in 0..MOST_NESTED {
            let Some(hit) = self.bvh.closest(&ray) else {
                return if reach.is_finite() { Crossing::Inside } else { Crossing::Lost };
            };
            let Some((&normal, &triangle)) = self.at(&hit) else { return Crossing::Lost };
            if direction.dot(normal) > 0.0 {
                if *depth <= 1 {
                    let point = ray.origin.as_dvec3() + f64::from(hit.t) * ray.direction.as_dvec3();
                    let inside_mm = Self::just_inside(point, normal);
                    return Crossing::Surface { inside_mm, normal, site: Site { triangle, u: hit.u, v: hit.v } };
                }
                *depth -= 1;
            } else if hit.t > self.slack_mm {
                // Into another surface of the same part. One this near is the surface that the flight starts from.
                *depth += 1;
            }
            ray.t_min = hit.t.next_up();
        }
        Crossing::Lost
    }

    fn at(&self, hit: &Hit) -> Option<(&DVec3, &u32)> {
        Some((self.normals.get(hit.triangle as usize)?, self.triangles.get(hit.triangle as usize)?))
    }
}

impl Boundary for MeshBoundary {
    #[inline(always)]
    fn crossing(&self, from_mm: DVec3, direction: DVec3, reach_mm: f64, depth: &mut u32) -> Crossing {
        let Clearance::AtLeast(mut near) = self.grid.at(from_mm) else { return Crossing::Lost };
        if near > reach_mm {
            return Crossing::Inside;
        }
        let mut far = reach_mm;
        if !far.is_finite() {
            return self.cast(from_mm, direction, far, depth);
        }
        // Free space around both ends, and then around the ends of what is left: where it meets, nothing is in between. The
        // end helps the flights that start at the surface, inwards.
        for _ in 0..MOST_STEPS {
            let behind = self.grid.free(from_mm + far * direction);
            far -= behind;
            if near > far {
                return Crossing::Inside;
            }
            let ahead = self.grid.free(from_mm + near * direction);
            near += ahead;
            if near > far {
                return Crossing::Inside;
            }
            if ahead + behind <= LEAST_GAIN * (far - near) {
                break;
            }
        }
        self.cast(from_mm + near * direction, direction, far - near, depth)
    }
}
