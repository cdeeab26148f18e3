//! `translux evaluate A.tlux --on MODEL`: radiosity of an asset's object at the vertices of another mesh of it.

use std::path::{Path, PathBuf};

use glam::DVec3;

use super::console::Console;
use super::lights::ResolvedLights;
use super::output;
use crate::asset::Provenance;
use crate::error::{Error, ExitCode, Result};
use crate::evaluate::exitance::MeshPoint;
use crate::evaluate::{Evaluator, SingleScattering};
use crate::geometry::mesh::Mesh;
use crate::geometry::nearest::{NearestPoint, SurfacePoint};
use crate::import::file::{Input, files_of};
use crate::import::load_mesh;
use crate::math::statistics::{VertexError, vertex_error};
use crate::parallel::*;
use crate::render::normals::welded_normals_mm2;
use crate::report::comparison::vertex_areas;
use crate::report::evaluation::{OnMeshReport, RadiosityReport};
use crate::report::radiosity_ply::{CALIBRATED, DIPOLE, Single, check_range, comments, model_of, radiosity_ply};
use crate::report::text::{percent, significant};
use crate::scene::Scene;

/// Share of the diagonal that is added to the distance of a triangle of the asset that faces away from a vertex.
const THIN: f64 = 0.05;

/// Share of the diagonal beyond which a vertex is so far from the asset's surface that it belongs to another object or
/// unit.
const ELSEWHERE: f64 = 0.1;

/// A mesh with the positions of its vertices, and of the centres of its triangles, on the asset's surface.
struct Placed {
    mesh: Mesh,
    /// A third of the area around each vertex, mm^2.
    areas: Vec<f64>,
    vertices: Vec<Option<SurfacePoint>>,
    centres: Vec<Option<SurfacePoint>>,
}

/// Lights the asset, writes the radiosity of the other mesh and reports how the two differ.
pub(super) fn run(
    model: &Path,
    mut evaluator: Box<dyn Evaluator>,
    provenance: &Provenance,
    (lights, outputs): (ResolvedLights, &[PathBuf]),
    console: &Console,
) -> Result<ExitCode> {
    if evaluator.single_scattering_is() != SingleScattering::None {
        return Err(Error::unsupported("--on: single scattering belongs to the asset's own mesh"));
    }
    let mut inputs = lights.inputs;
    for file in files_of(model)? {
        inputs.push(Input::read(&file)?);
    }
    let placed = place(model, evaluator.scene(), provenance, console)?;
    evaluator.set_lights(lights.lights, console)?;
    let result = placed.evaluate(evaluator.as_mut(), console).map_err(|e| e.in_file(model))?;
    output::write(outputs, console, || {
        let mut comments = comments(&provenance.method, evaluator.scene(), &lights.text);
        comments.extend((model_of(provenance) != DIPOLE).then(|| CALIBRATED.to_owned()));
        radiosity_ply(&placed.mesh, &result.radiosity, Single::None, comments)
    })?;
    let [mean_distance_mm, max_distance_mm] = placed.distances();
    let (name, vertices) = (model.display(), result.radiosity.len());
    let [mean, most] = [mean_distance_mm, max_distance_mm].map(significant);
    console.note(&format!(
        "{name}: {vertices} vertices, {mean} mm from the surface of the asset in the mean, {most} mm at most"
    ));
    let worst = |e: VertexError| format!("{} RMS, {} worst", percent(e.rms), percent(e.worst));
    console.note(&format!("added between its vertices: {}", worst(result.between)));
    console.note(&format!("added by gathering at the vertices themselves, which was not done: {}", worst(result.at)));
    let vertices_without_area = placed.vertices.iter().filter(|place| place.is_none()).count();
    if vertices_without_area > 0 {
        console.note(&format!("{vertices_without_area} vertices are on no translucent part; their radiosity is 0"));
    }
    let report = OnMeshReport {
        method: provenance.method.clone(),
        radiosity: RadiosityReport::new((lights.text, inputs), outputs, &result.radiosity, vertices_without_area),
        mean_distance_mm,
        max_distance_mm,
        at_vertices: result.at,
        between_vertices: result.between,
        cost: evaluator.cost(),
    };
    console.report("evaluate-on", &report)
}

/// Reads the mesh in the units of the asset's source and finds its vertices on the asset's surface.
fn place(model: &Path, scene: &Scene, provenance: &Provenance, console: &Console) -> Result<Placed> {
    let mm_per_unit = provenance.origin.mm_per_source_unit;
    let (mesh, [warnings, repairs]) = load_mesh(model, mm_per_unit, console)?;
    warnings.iter().for_each(|warning| console.warn(warning));
    repairs.iter().for_each(|line| console.note(line));
    let placed = console.stage("place", || Placed::new(mesh, scene, mm_per_unit));
    placed.map_err(|e| e.in_file(model))
}

/// Radiosity of the other mesh, and the difference between two ways of taking it from the asset.
struct OnMesh {
    radiosity: Vec<DVec3>,
    at: VertexError,
    between: VertexError,
}

impl Placed {
    fn new(mesh: Mesh, scene: &Scene, mm_per_unit: f64) -> Result<Self> {
        let nearest = NearestPoint::new(&scene.mesh, 0..scene.mesh.triangles.len() as u32);
        let diagonal = scene.mesh.diagonal_mm();
        let offset = mesh.origin_mm - scene.mesh.origin_mm;
        // Seams have the normals of both sides.
        let normals = welded_normals_mm2(&mesh);
        let areas = vertex_areas(|v| mesh.local_mm[v as usize].as_dvec3(), mesh.local_mm.len(), &mesh.triangles);
        // What is nearest to an opaque part takes nothing from a translucent one behind it.
        let place = |at: DVec3, normal: DVec3| {
            let found = nearest.find(at, normal, THIN * diagonal)?;
            let part = *scene.parts.triangle_part.get(found.triangle as usize)?;
            scene.parts.parts.get(part as usize).is_some_and(|p| p.transfers()).then_some(found)
        };
        let vertex = |v: usize| {
            let normal = normals[mesh.weld[v] as usize];
            (areas[v] > 0.0).then(|| place(mesh.local_mm[v].as_dvec3() + offset, normal)).flatten()
        };
        let vertices: Vec<_> = (0..mesh.local_mm.len()).into_par_iter().map(vertex).collect();
        let centre = |t: u32| {
            let at = mesh.corners_local_mm(t).iter().sum::<DVec3>() / 3.0;
            place(at + offset, mesh.cross_mm2(t))
        };
        let centres = (0..mesh.triangles.len() as u32).into_par_iter().map(centre).collect();
        let placed = Self { mesh, areas, vertices, centres };
        let [_, farthest] = placed.distances();
        if farthest > ELSEWHERE * diagonal {
            let [farthest, across, unit] = [farthest, diagonal, mm_per_unit].map(significant);
            return Err(Error::input(format!(
                "its vertices are up to {farthest} mm from the surface of the asset, which is {across} mm across: is it the same \
                 object, in the units of the asset's model (one of them is {unit} mm)?"
            )));
        }
        Ok(placed)
    }

    /// Distances of the vertices from the asset's surface, mm: the mean by area, and the largest.
    fn distances(&self) -> [f64; 2] {
        let placed =
            || self.vertices.iter().zip(&self.areas).filter_map(|(p, area)| Some((p.as_ref()?.distance_mm, area)));
        let area: f64 = placed().map(|(_, area)| area).sum();
        let mean = placed().map(|(distance, area)| distance * area).sum::<f64>() / area.max(f64::MIN_POSITIVE);
        [mean, placed().map(|(distance, _)| distance).fold(0.0, f64::max)]
    }

    fn evaluate(&self, evaluator: &mut dyn Evaluator, console: &Console) -> Result<OnMesh> {
        evaluator.prepare_points(console)?;
        let missing = || Error::runtime("radiosity of another mesh is missing");
        let exitance = evaluator.exitance_at_points().ok_or_else(missing)?;
        let mesh = &evaluator.scene().mesh;
        let offset = self.mesh.origin_mm - mesh.origin_mm;
        let point = |found: &SurfacePoint| {
            let point = MeshPoint::new(mesh, found.triangle, found.weights)?;
            Some(MeshPoint { at_mm: found.at_mm, ..point })
        };
        // Zero where there is no point.
        let at = |points: Vec<Option<MeshPoint>>| -> Vec<DVec3> {
            let mut values =
                exitance.at_each(&points.iter().copied().flatten().collect::<Vec<_>>(), console).into_iter();
            points.iter().map(|point| point.and_then(|_| values.next()).unwrap_or_default()).collect()
        };
        let on_surface = |found: &Option<SurfacePoint>| found.as_ref().and_then(point);
        let itself = |(found, v): (&Option<SurfacePoint>, &glam::Vec3)| {
            Some(MeshPoint { at_mm: v.as_dvec3() + offset, ..on_surface(found)? })
        };
        let radiosity = at(self.vertices.iter().map(on_surface).collect());
        let centres = at(self.centres.iter().map(on_surface).collect());
        let itself = at(self.vertices.iter().zip(&self.mesh.local_mm).map(itself).collect());
        check_range("radiosity", &radiosity)?;
        let mean = |t: &[u32; 3]| t.iter().map(|&v| radiosity[v as usize]).sum::<DVec3>() / 3.0;
        let between: Vec<DVec3> = self.mesh.triangles.iter().map(mean).collect();
        let of_triangle = |t: u32| if self.centres[t as usize].is_some() { self.mesh.area_mm2(t) } else { 0.0 };
        let areas: Vec<f64> = (0..self.mesh.triangles.len() as u32).map(of_triangle).collect();
        Ok(OnMesh {
            at: vertex_error(&itself, &radiosity, &self.areas),
            between: vertex_error(&between, &centres, &areas),
            radiosity,
        })
    }
}
