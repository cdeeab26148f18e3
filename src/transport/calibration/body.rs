//! The body of one part: its boundary for walks, and points spread evenly over its surface.

use glam::DVec3;

use crate::transport::domain::Domain;
use crate::transport::random_walk::boundary::MeshBoundary;
use crate::transport::random_walk::entry::along_curve;
use crate::transport::random_walk::walk::Stream;

/// A point of the surface with its geometric normal, unit, outward.
#[derive(Clone, Copy, Debug)]
pub(super) struct SurfacePoint {
    pub at_mm: DVec3,
    pub normal: DVec3,
}

/// The surface of one part.
pub(super) struct Body<'a> {
    domain: Domain<'a>,
    pub boundary: MeshBoundary,
    /// Triangles along a curve that keeps neighbours together, and the area up to and including each, mm^2.
    triangles: Vec<u32>,
    cumulative_mm2: Vec<f64>,
    pub diagonal_mm: f64,
}

impl<'a> Body<'a> {
    /// The body of a part in a medium with this mean free path (unreduced).
    pub(super) fn new(domain: Domain<'a>, part: u32, free_path_mm: f64) -> Self {
        let bounds = domain.mesh.bounds_local_mm();
        let of_part = |t: &u32| domain.parts.triangle_part.get(*t as usize) == Some(&part);
        let mut triangles: Vec<u32> = (0..domain.mesh.triangles.len() as u32).filter(of_part).collect();
        triangles.sort_by_cached_key(|&t| along_curve(domain.mesh, bounds, t));
        let area_so_far = |sum: &mut f64, &t: &u32| {
            *sum += domain.mesh.area_mm2(t);
            Some(*sum)
        };
        let cumulative_mm2 = triangles.iter().scan(0.0, area_so_far).collect();
        let corners = triangles.iter().flat_map(|&t| domain.mesh.corners_local_mm(t));
        let grow = |(low, high): (DVec3, DVec3), p: DVec3| (low.min(p), high.max(p));
        let (low, high) = corners.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), grow);
        Self {
            domain,
            boundary: MeshBoundary::new(domain.mesh, triangles.clone(), free_path_mm),
            triangles,
            cumulative_mm2,
            diagonal_mm: if low.is_finite() { low.distance(high) } else { 0.0 },
        }
    }

    /// Area, mm^2.
    pub(super) fn area_mm2(&self) -> f64 {
        self.cumulative_mm2.last().copied().unwrap_or(0.0)
    }

    /// The point at a fraction of the area (in [0, 1)); none on a body without area.
    pub(super) fn point(&self, along: f64, stream: &mut Stream) -> Option<SurfacePoint> {
        let wanted = along * self.area_mm2();
        let index = self.cumulative_mm2.partition_point(|&a| a <= wanted).min(self.triangles.len().checked_sub(1)?);
        let triangle = self.triangles[index];
        let [a, b, c] = self.domain.mesh.corners_local_mm(triangle);
        let (r, s) = (stream.uniform().sqrt(), stream.uniform());
        let at_mm = a * (1.0 - r) + b * (r * (1.0 - s)) + c * (r * s);
        Some(SurfacePoint { at_mm, normal: self.domain.mesh.normal(triangle) })
    }

    /// The normal of a triangle of the boundary, by its index there.
    pub(super) fn normal(&self, index: u32) -> DVec3 {
        self.triangles.get(index as usize).map_or(DVec3::ZERO, |&t| self.domain.mesh.normal(t))
    }

    /// The point of a triangle of the mesh at the weights of its second and third corner.
    pub(super) fn at_site(&self, triangle: u32, u: f64, v: f64) -> SurfacePoint {
        let [a, b, c] = self.domain.mesh.corners_local_mm(triangle);
        SurfacePoint { at_mm: a * (1.0 - u - v) + b * u + c * v, normal: self.domain.mesh.normal(triangle) }
    }
}

/// Distance of two points (mm) and the sum of the heights of each over the tangent plane of the other (mm).
pub(super) fn distance_and_heights(o: SurfacePoint, i: SurfacePoint) -> (f64, f64) {
    let way = i.at_mm - o.at_mm;
    (way.length(), way.dot(o.normal - i.normal))
}
