//! The error between vertices, told of the vertices around which it is.

use glam::DVec3;

use super::exact::Lit;
use crate::error::Result;
use crate::evaluate::exitance::MeshPoint;
use crate::measure::between_vertices::PLACES;
use crate::progress::Progress;
use crate::scene::Scene;

/// Sums of squares of what is drawn between vertices against what is there, for each vertex over the triangles around it.
pub(super) struct Between {
    triangles: Vec<u32>,
    points: Vec<MeshPoint>,
    /// Area-weighted squares, and the areas, mm^2.
    squares: Vec<(DVec3, f64)>,
}

impl Between {
    /// Centroids and mid-edges of the translucent parts of a scene.
    pub(super) fn new(scene: &Scene) -> Self {
        let all = 0..scene.mesh.triangles.len() as u32;
        let triangles: Vec<u32> = all.filter(|&t| scene.parts.transfers(t)).collect();
        let of = |&t: &u32| PLACES.map(|weights| MeshPoint::new(&scene.mesh, t, weights));
        let points = triangles.iter().flat_map(of).flatten().collect();
        Self { triangles, points, squares: vec![(DVec3::ZERO, 0.0); scene.mesh.local_mm.len()] }
    }

    /// Enters the error under a light; `exact` is the radiosity of the vertices, `unit` that of each channel.
    pub(super) fn enter(
        &mut self,
        scene: &Scene,
        (lit, exact, unit): (&mut Lit, &[DVec3], DVec3),
        progress: &dyn Progress,
    ) -> Result<()> {
        let there = lit.at_points(&self.points, progress)?;
        for ((&triangle, points), there) in
            self.triangles.iter().zip(self.points.chunks(PLACES.len())).zip(there.chunks(PLACES.len()))
        {
            let area = scene.mesh.area_mm2(triangle);
            let mut square = DVec3::ZERO;
            for (point, there) in points.iter().zip(there) {
                let of = |v: u32| exact.get(v as usize).copied().unwrap_or_default();
                let drawn: DVec3 = point.vertices.iter().zip(point.barycentric).map(|(v, w)| w * of(*v)).sum();
                square += ((drawn - *there) / unit).powf(2.0);
            }
            for vertex in points.first().map_or([0; 3], |point| point.vertices) {
                if let Some((sum, weight)) = self.squares.get_mut(vertex as usize) {
                    *sum += area / PLACES.len() as f64 * square;
                    *weight += area;
                }
            }
        }
        Ok(())
    }

    /// Root mean square at each vertex, of the worst channel.
    pub(super) fn at_vertices(self) -> Vec<f64> {
        let of = |(sum, weight): (DVec3, f64)| if weight > 0.0 { (sum / weight).max_element().sqrt() } else { 0.0 };
        self.squares.into_iter().map(of).collect()
    }
}
