//! An evaluator on a finer mesh of its object: radiosity at more vertices than the asset has.

use glam::DVec3;

use super::capabilities::{Capabilities, Cost, SingleScattering};
use super::evaluator::{Evaluator, Refined};
use super::exitance::{Exitance, MeshPoint};
use crate::compress::ledger::Ledger;
use crate::error::{Error, Result};
use crate::geometry::bvh::Bvh;
use crate::geometry::mesh::Mesh;
use crate::light::Light;
use crate::medium::material::Medium;
use crate::medium::profiles::model::LoadedProfile;
use crate::progress::Progress;
use crate::scene::Scene;

/// An evaluator whose scene is a finer one of the same surface, for viewers that interpolate between vertices. Light goes where it went; it is
/// evaluated at points of the asset's own triangles.
pub struct Finer {
    inner: Box<dyn Evaluator>,
    scene: Scene,
    bvh: Bvh,
    /// The vertices that have transferring area, and where each is on the asset's mesh.
    vertices: Vec<u32>,
    points: Vec<MeshPoint>,
}

impl Finer {
    /// Puts an evaluator on a scene whose triangles are pieces of its own: `of_triangle` says of which. The evaluator must serve points,
    /// and have no single scattering that depends on the eye.
    pub fn of(inner: Box<dyn Evaluator>, mut scene: Scene, of_triangle: &[u32]) -> Box<dyn Evaluator> {
        scene.media.clone_from(&inner.scene().media);
        let coarse = &inner.scene().mesh;
        let mut places = vec![None; scene.mesh.local_mm.len()];
        for ((index, corners), of) in (0..).zip(&scene.mesh.triangles).zip(of_triangle) {
            for &vertex in corners.iter().filter(|_| scene.parts.transfers(index)) {
                if let Some(place @ None) = places.get_mut(vertex as usize) {
                    *place = point_of(coarse, *of, scene.mesh.local_mm[vertex as usize].as_dvec3());
                }
            }
        }
        let (vertices, points) = (0..).zip(places).filter_map(|(vertex, place)| Some((vertex, place?))).unzip();
        let bvh = Bvh::new(&scene.mesh);
        Box::new(Self { inner, scene, bvh, vertices, points })
    }

    /// Values of the finer vertices of values of some; zero for the others.
    fn spread(&self, values: impl IntoIterator<Item = DVec3>) -> Vec<DVec3> {
        let mut all = vec![DVec3::ZERO; self.scene.mesh.local_mm.len()];
        self.vertices.iter().zip(values).for_each(|(vertex, value)| all[*vertex as usize] = value);
        all
    }

    fn at(&mut self, points: &[MeshPoint], progress: &dyn Progress) -> Result<Vec<DVec3>> {
        self.inner.prepare_points(progress)?;
        let missing = || Error::runtime("exitance at points is missing");
        Ok(self.inner.exitance_at_points().ok_or_else(missing)?.at_each(points, progress))
    }
}

/// A point of a triangle by its place; none where there is no such triangle.
fn point_of(mesh: &Mesh, triangle: u32, at_mm: DVec3) -> Option<MeshPoint> {
    mesh.triangles.get(triangle as usize)?;
    let [a, b, c] = mesh.corners_local_mm(triangle);
    let cross = mesh.cross_mm2(triangle);
    let share = |p: DVec3, q: DVec3| ((p - at_mm).cross(q - at_mm).dot(cross) / cross.length_squared()).clamp(0.0, 1.0);
    let [u, v, w] = [share(b, c), share(c, a), share(a, b)];
    let sum = u + v + w;
    let barycentric = if sum > 0.0 { [u / sum, v / sum, w / sum] } else { [1.0 / 3.0; 3] };
    Some(MeshPoint { at_mm, ..MeshPoint::new(mesh, triangle, barycentric)? })
}

impl Evaluator for Finer {
    fn capabilities(&self) -> Capabilities {
        self.inner.capabilities()
    }

    fn cost(&self) -> Cost {
        self.inner.cost()
    }

    fn scene(&self) -> &Scene {
        &self.scene
    }

    fn bvh(&self) -> &Bvh {
        &self.bvh
    }

    fn set_lights(&mut self, lights: Vec<Light>, progress: &dyn Progress) -> Result<()> {
        self.inner.set_lights(lights, progress)
    }

    fn move_lights(&mut self, lights: Vec<Light>, progress: &dyn Progress) -> Result<()> {
        self.inner.move_lights(lights, progress)
    }

    fn set_media(&mut self, media: Vec<Medium>) -> Result<()> {
        self.inner.set_media(media)?;
        self.scene.media.clone_from(&self.inner.scene().media);
        Ok(())
    }

    fn set_profile(&mut self, profile: LoadedProfile) -> Result<()> {
        self.inner.set_profile(profile)
    }

    fn prepare_for_edits(&mut self, progress: &dyn Progress) {
        self.inner.prepare_for_edits(progress);
    }

    fn remember_lights(&mut self, count: usize) {
        self.inner.remember_lights(count);
    }

    fn answer_at_once(&mut self) {
        self.inner.answer_at_once();
    }

    fn refine(&mut self) -> Result<Refined> {
        self.inner.refine()
    }

    fn radiosity(&mut self, progress: &dyn Progress) -> Result<Vec<DVec3>> {
        let points = std::mem::take(&mut self.points);
        let values = self.at(&points, progress);
        self.points = points;
        Ok(self.spread(values?))
    }

    fn radiosity_of(&mut self, vertices: &[u32], progress: &dyn Progress) -> Result<Vec<DVec3>> {
        let place = |vertex: &u32| self.vertices.binary_search(vertex).ok();
        let places: Vec<Option<usize>> = vertices.iter().map(place).collect();
        let points: Vec<MeshPoint> = places.iter().flatten().map(|place| self.points[*place]).collect();
        let mut values = self.at(&points, progress)?.into_iter();
        Ok(places.iter().map(|place| place.and_then(|_| values.next()).unwrap_or_default()).collect())
    }

    fn single_scattering(&mut self, progress: &dyn Progress) -> Result<Option<Vec<DVec3>>> {
        let values = self.inner.single_scattering(progress)?;
        Ok(values.map(|values| self.spread(self.points.iter().map(|point| values.at(point)))))
    }

    fn single_scattering_is(&self) -> SingleScattering {
        self.inner.single_scattering_is()
    }

    fn prepare_points(&mut self, _: &dyn Progress) -> Result<()> {
        Err(Error::unsupported("points of a mesh that was refined to be shown are those of the asset's own mesh"))
    }

    fn measured_error(&mut self, unseen: &[Light], progress: &dyn Progress) -> Result<Ledger> {
        self.inner.measured_error(unseen, progress)
    }

    fn all_pairs(&mut self, _: &dyn Progress) -> Result<Vec<DVec3>> {
        Err(Error::unsupported(
            "the mesh was refined to be shown, and exact sums are those of the asset's own vertices: `translux evaluate --measure` tells \
             their error",
        ))
    }

    #[cfg(feature = "gpu")]
    fn on_device(
        self: Box<Self>,
        _: &std::sync::Arc<super::device::adapter::Device>,
    ) -> Result<Box<dyn super::evaluator::DeviceEvaluator>> {
        Err(Error::unsupported("the mesh was refined to be shown, and light at its vertices is summed on the CPU"))
    }
}
