//! The points of a patch that look at the lights.

use glam::DVec3;

use super::sharp::{Sharp, pieces};
use super::{Illumination, PROBE_REACH, PROBE_WEIGHTS, SurfacePoint};
use crate::geometry::samples::{Facet, Patch, area};

impl Illumination<'_> {
    /// Points near the corners and at the centroid of a patch that is one facet, where four points are asked for: no
    /// straight shadow boundary leaves much of a patch unnoticed between them.
    pub(super) fn corners_and_centroid(&self, patch: usize) -> Option<[SurfacePoint; 4]> {
        let [facet] = self.surface.samples.patch(patch) else { return None };
        if self.sampling.points_per_patch.next_power_of_two() as usize != PROBE_WEIGHTS.len() {
            return None;
        }
        let mesh = self.surface.domain.mesh;
        let [a, b, c] = facet.corners_local_mm(mesh);
        let normal = self.surface.patches[patch].normal;
        let centre = (a + b + c) / 3.0;
        let at = |p: DVec3| SurfacePoint { at: centre.lerp(p, PROBE_REACH), normal, triangle: facet.triangle };
        Some([at(a), at(b), at(c), at(centre)])
    }

    /// True if one of the lights is in front of a patch, or if that is not obvious.
    pub(super) fn is_faced(&self, patch: usize, lights: &[Sharp]) -> bool {
        let Patch { centre_mm, normal, .. } = self.surface.patches[patch];
        normal == DVec3::ZERO || lights.iter().any(|light| light.faces(centre_mm, normal))
    }

    /// Centroids of the pieces of a patch that is one facet.
    pub(super) fn pieces_as_points(&self, patch: usize, count: u32, out: &mut Vec<SurfacePoint>) {
        let mesh = self.surface.domain.mesh;
        let [facet] = self.surface.samples.patch(patch) else { return };
        let Patch { centre_mm, normal, .. } = self.surface.patches[patch];
        if count == 1 {
            // Not through the mesh, whose triangles lie in another order than patches.
            out.push(SurfacePoint { at: centre_mm, normal, triangle: facet.triangle });
            return;
        }
        pieces(facet.corners_local_mm(mesh), count, &mut |corners| {
            let at = corners.iter().sum::<DVec3>() / 3.0;
            out.push(SurfacePoint { at, normal, triangle: facet.triangle });
        });
    }

    /// Points that stand for equal areas of a patch.
    pub(super) fn points_of(&self, patch: usize, out: &mut Vec<SurfacePoint>) {
        let mesh = self.surface.domain.mesh;
        let facets = self.surface.samples.patch(patch);
        let count = self.sampling.points_per_patch.next_power_of_two();
        if facets.len() == 1 {
            self.pieces_as_points(patch, count, out);
            return;
        }
        let areas: Vec<f64> = facets.iter().map(|f| area(f.corners_local_mm(mesh))).collect();
        let total: f64 = areas.iter().sum();
        let (mut index, mut passed) = (0, 0.0);
        for k in 0..count.max(facets.len().min(16) as u32) {
            let wanted = total * (f64::from(k) + 0.5) / f64::from(count.max(facets.len().min(16) as u32));
            while index + 1 < facets.len() && passed + areas[index] < wanted {
                passed += areas[index];
                index += 1;
            }
            let Facet { triangle, .. } = facets[index];
            let corners = facets[index].corners_local_mm(mesh);
            let normal = mesh.cross_mm2(triangle).normalize_or_zero();
            out.push(SurfacePoint { at: corners.iter().sum::<DVec3>() / 3.0, normal, triangle });
        }
    }
}
