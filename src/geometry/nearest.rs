//! The nearest point of a surface.

use glam::DVec3;

use super::boxes::{Aabb, BoxTree};
use super::mesh::Mesh;

/// A point of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// Position relative to the mesh's origin, mm.
    pub at_mm: DVec3,
    /// Triangle of the point.
    pub triangle: u32,
    /// Weights of the triangle's corners.
    pub weights: [f64; 3],
    /// Distance from the query point, mm.
    pub distance_mm: f64,
}

/// Finds nearest points on some triangles of a mesh.
pub struct NearestPoint<'a> {
    mesh: &'a Mesh,
    triangles: Vec<u32>,
    boxes: BoxTree,
}

impl<'a> NearestPoint<'a> {
    /// A search over these triangles.
    pub fn new(mesh: &'a Mesh, triangles: impl IntoIterator<Item = u32>) -> Self {
        let triangles: Vec<u32> = triangles.into_iter().filter(|&t| (t as usize) < mesh.triangles.len()).collect();
        let boxes: Vec<Aabb> = triangles.iter().map(|&t| Aabb::of(&mesh.corners_local_mm(t))).collect();
        Self { mesh, triangles, boxes: BoxTree::new(&boxes) }
    }

    /// The nearest point to `p` (relative to the mesh's origin, mm). Triangles that look away from `normal` are taken where
    /// nothing else is nearer than `thickness_mm` beyond them: the other side of a thin wall is another surface. A normal of zero
    /// takes whatever is nearest. `None` without triangles.
    pub fn find(&self, p: DVec3, normal: DVec3, thickness_mm: f64) -> Option<SurfacePoint> {
        let mut best: Option<(f64, SurfacePoint)> = None;
        self.boxes.towards(p, |item| {
            let triangle = self.triangles[item as usize];
            let corners = self.mesh.corners_local_mm(triangle);
            let (weights, distance2) = closest_weights(p, corners);
            let distance_mm = distance2.sqrt();
            let away = self.mesh.cross_mm2(triangle).dot(normal) < 0.0;
            let cost = if away { distance_mm + thickness_mm } else { distance_mm };
            // Ties go to the lower index, so that the order of the tree does not matter.
            let better = best.is_none_or(|(known, place)| (cost, triangle) < (known, place.triangle));
            if better && cost.is_finite() {
                let at_mm = corners.iter().zip(weights).map(|(c, w)| *c * w).sum();
                best = Some((cost, SurfacePoint { at_mm, triangle, weights, distance_mm }));
            }
            best.map_or(f64::INFINITY, |(cost, _)| cost * cost)
        });
        best.map(|(_, place)| place)
    }
}

/// Barycentric weights of the point of a triangle that is nearest to p, and its squared distance. The weights are not
/// negative and add up to 1; a triangle without area is taken as its edges.
pub fn closest_weights(p: DVec3, [a, b, c]: [DVec3; 3]) -> ([f64; 3], f64) {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let cross = ab.cross(ac);
    let square = cross.length_squared();
    let distance2 = |[_, v, w]: [f64; 3]| (ap - ab * v - ac * w).length_squared();
    if square > 0.0 {
        let v = ap.cross(ac).dot(cross) / square;
        let w = ab.cross(ap).dot(cross) / square;
        let u = 1.0 - v - w;
        if u >= 0.0 && v >= 0.0 && w >= 0.0 {
            return ([u, v, w], distance2([u, v, w]));
        }
    }
    let along = |from: DVec3, edge: DVec3| {
        let length2 = edge.length_squared();
        if length2 > 0.0 { ((p - from).dot(edge) / length2).clamp(0.0, 1.0) } else { 0.0 }
    };
    let (s, t, r) = (along(a, ab), along(b, c - b), along(a, ac));
    let edges = [[1.0 - s, s, 0.0], [0.0, 1.0 - t, t], [1.0 - r, 0.0, r]];
    let mut best = (edges[0], distance2(edges[0]));
    for edge in &edges[1..] {
        let d = distance2(*edge);
        if d < best.1 {
            best = (*edge, d);
        }
    }
    best
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::geometry::shapes::icosphere;
    use crate::geometry::test_data::mesh_of;
    use crate::math::random::uniform;

    #[test]
    fn the_tree_finds_what_a_search_through_all_triangles_finds() {
        let (mesh, _) = mesh_of(icosphere(1.0, 3));
        let nearest = NearestPoint::new(&mesh, 0..mesh.triangles.len() as u32);
        for i in 0..500 {
            let p = DVec3::from([0, 1, 2].map(|k| 4.0 * uniform(11, i, k) - 2.0));
            let found = nearest.find(p, DVec3::ZERO, 0.0).unwrap();
            let all = (0..mesh.triangles.len() as u32).map(|t| closest_weights(p, mesh.corners_local_mm(t)).1);
            let least = all.fold(f64::INFINITY, f64::min).sqrt();
            assert!((found.distance_mm - least).abs() < 1e-12 && (found.at_mm.distance(p) - least).abs() < 1e-6);
        }
    }

    #[test]
    fn the_side_that_looks_away_is_another_surface() {
        let (mesh, _) = mesh_of(icosphere(1.0, 3));
        let nearest = NearestPoint::new(&mesh, 0..mesh.triangles.len() as u32);
        let p = DVec3::new(0.1, 0.0, 0.0);
        let right = nearest.find(p, DVec3::ZERO, 5.0).unwrap();
        let left = nearest.find(p, DVec3::NEG_X, 5.0).unwrap();
        assert!(right.at_mm.x > 0.8 && left.at_mm.x < 0.2, "{right:?} {left:?}");
        assert!(NearestPoint::new(&mesh, []).find(p, DVec3::X, 1.0).is_none());
        assert!(nearest.find(DVec3::NAN, DVec3::X, 1.0).is_none());
    }
}
