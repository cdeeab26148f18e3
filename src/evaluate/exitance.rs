//! Exitance as it is handed from evaluators to renderers: at the source vertices, or at any point of the surface.
//!
//! [`Evaluator::radiosity`](super::Evaluator::radiosity) gives the exitance of the vertices, which is linear over each
//! triangle; [`Evaluator::exitance_at_points`](super::Evaluator::exitance_at_points) gives it at every point that is
//! asked for, for forms that gather. A rasteriser needs neither: [`DeviceEvaluator`](super::evaluator::DeviceEvaluator)
//! leaves the exitance of the vertices in the memory of the device, which interpolates it over each triangle.

use glam::DVec3;

use crate::geometry::mesh::Mesh;
use crate::parallel::*;
use crate::progress::Progress;

/// A point of a triangle mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshPoint {
    /// Index of its triangle.
    pub triangle: u32,
    /// The triangle's corners.
    pub vertices: [u32; 3],
    /// Their weights, which add up to 1.
    pub barycentric: [f64; 3],
    /// Position relative to the mesh's origin, mm; a little off the triangle for points of another mesh of the same
    /// object.
    pub at_mm: DVec3,
}

impl MeshPoint {
    /// A point of a triangle; none where the mesh has no such triangle.
    pub fn new(mesh: &Mesh, triangle: u32, barycentric: [f64; 3]) -> Option<Self> {
        let vertices = *mesh.triangles.get(triangle as usize)?;
        let at_mm = mesh.corners_local_mm(triangle).iter().zip(barycentric).map(|(c, w)| *c * w).sum();
        Some(Self { triangle, vertices, barycentric, at_mm })
    }
}

/// Exitance of a triangle mesh, linear RGB, in the unit of the lights' irradiance.
pub trait Exitance: Sync {
    /// Exitance of every source vertex, in the order of the source, zero for vertices without transferring area; none
    /// where exitance is evaluated at points.
    fn at_vertices(&self) -> Option<&[DVec3]>;

    /// Exitance at a point, zero where nothing is transferred.
    fn at(&self, point: &MeshPoint) -> DVec3;

    /// Exitance at many points, in their order; shared work is done once.
    fn at_each(&self, points: &[MeshPoint], _progress: &dyn Progress) -> Vec<DVec3> {
        points.par_iter().map(|point| self.at(point)).collect()
    }
}

/// Exitance of the vertices, linear over each triangle.
impl Exitance for Vec<DVec3> {
    fn at_vertices(&self) -> Option<&[DVec3]> {
        Some(self)
    }

    fn at(&self, point: &MeshPoint) -> DVec3 {
        let [a, b, c] = point.vertices.map(|v| self.get(v as usize).copied().unwrap_or(DVec3::ZERO));
        let weights = point.barycentric;
        a * weights[0] + b * weights[1] + c * weights[2]
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::geometry::mesh::Placement;
    use crate::geometry::shapes;
    use crate::progress::Silent;

    #[test]
    fn corners_have_their_values_and_the_centre_their_mean() {
        let cube = shapes::cuboid(DVec3::ONE, 1);
        let mesh = &Mesh::from_source(cube, &Placement { mm_per_unit: 1.0 }).unwrap().0;
        let values: Vec<DVec3> = mesh.local_mm.iter().map(|p| p.as_dvec3()).collect();
        assert_eq!(values.at_vertices(), Some(values.as_slice()));
        for (triangle, corners) in mesh.triangles.iter().enumerate() {
            let point = |weights| MeshPoint::new(mesh, triangle as u32, weights).unwrap();
            let points = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0 / 3.0; 3]].map(point);
            let found = values.at_each(&points, &Silent);
            assert_eq!(found[..2], [values[corners[0] as usize], values[corners[2] as usize]]);
            // Positions are linear over a triangle too.
            assert!(found.iter().zip(&points).all(|(value, point)| value.distance(point.at_mm) < 1e-12));
        }
        assert_eq!(MeshPoint::new(mesh, mesh.triangles.len() as u32, [1.0, 0.0, 0.0]), None);
    }
}
