//! The error of radiosity between vertices: what is drawn there, linear over each triangle, against what is there.

use glam::DVec3;

use super::probes::{Half, directional};
use crate::error::Result;
use crate::geometry::bvh::Bvh;
use crate::geometry::samples::{self, Samples};
use crate::math::statistics::{VertexError, vertex_error};
use crate::progress::{Progress, Silent};
use crate::scene::Scene;
use crate::transport::gather::{Gather, Scheme};
use crate::transport::irradiance::{Illumination, LightSampling};
use crate::transport::near_rule::NearField;
use crate::transport::receivers::Receivers;
use crate::transport::surface::Surface;
use crate::transport::tree::SampleTree;

/// Triangles whose centroids and mid-edges are looked at, by area.
const TRIANGLES: usize = 32;

/// Surface samples: what they miss is the same at vertices and between them, as long as it varies slowly.
const SAMPLES: usize = 2048;

/// Probe directions; the worst of them counts.
const LIGHTS: usize = 2;

/// Receivers that share the samples near to them.
const GROUP: usize = 4;

/// Weights of a triangle's corners at its centroid and at the middles of its edges.
pub(super) const PLACES: [[f64; 3]; 4] = [[1.0 / 3.0; 3], [0.5, 0.5, 0.0], [0.0, 0.5, 0.5], [0.5, 0.0, 0.5]];

/// Error from which on a mesh is too coarse for what is drawn between its vertices.
pub const TOO_COARSE: f64 = 0.05;

/// The error between vertices where it is above [`TOO_COARSE`]. It is measured only where edges are long for the media, so that fine
/// meshes cost next to nothing; `bvh` is the scene's, where there is one already.
///
/// # Errors
/// Failures of the work.
pub fn too_coarse(scene: &Scene, bvh: Option<&Bvh>, progress: &dyn Progress) -> Result<Option<VertexError>> {
    if !scene.may_be_coarse() {
        return Ok(None);
    }
    let error = match bvh {
        Some(bvh) => between_vertices_with(scene, bvh, progress),
        None => between_vertices(scene, progress),
    };
    Ok(Some(error?).filter(|error| error.rms > TOO_COARSE))
}

/// Error at centroids and mid-edges of the translucent parts under a few probe lights, relative to the RMS there; zero
/// where nothing transfers light.
///
/// # Errors
/// Failures of the work.
pub fn between_vertices(scene: &Scene, progress: &dyn Progress) -> Result<VertexError> {
    between_vertices_with(scene, &Bvh::new(&scene.mesh), progress)
}

fn between_vertices_with(scene: &Scene, bvh: &Bvh, progress: &dyn Progress) -> Result<VertexError> {
    progress.start("between vertices", 0);
    let chosen = by_area(scene, TRIANGLES);
    let places: Vec<Option<(u32, DVec3)>> = chosen
        .iter()
        .flat_map(|&t| {
            let (corners, part) = (scene.mesh.corners_local_mm(t), scene.parts.triangle_part[t as usize]);
            let at = |weights: [f64; 3]| Some((part, (0..3).map(|k| weights[k] * corners[k]).sum()));
            corners.map(|corner| Some((part, corner))).into_iter().chain(PLACES.map(at))
        })
        .collect();
    let samples = Samples::new(&scene.mesh, &scene.parts, SAMPLES);
    let patches = samples::patches(&scene.mesh, &samples);
    let surface = Surface { domain: scene.domain(), bvh, samples: &samples, patches: &patches };
    let etas: Vec<f64> = scene.media.iter().map(|m| m.properties.eta_inside_over_outside).collect();
    let receivers = Receivers::at(&places, GROUP);
    let tree = SampleTree::default();
    let gather = Gather::new(&surface, &tree, &scene.media, NearField::FAST);
    let lights = directional(Half::Tuning);
    let mut worst = VertexError::default();
    for light in lights.iter().step_by(lights.len().div_ceil(LIGHTS)) {
        let lit = Illumination::new(&surface, std::slice::from_ref(light), &etas, LightSampling::FAST)?;
        let (irradiance, pieces) = lit.all_with_pieces(&Silent);
        let lit = gather.light_with_pieces(&irradiance, &pieces);
        let values = receivers.expand(&gather.radiosity(&receivers, &lit, Scheme::AllPairs, &Silent));
        let (mut drawn, mut there) = (Vec::new(), Vec::new());
        for of_triangle in values.chunks_exact(3 + PLACES.len()) {
            let (corners, between) = of_triangle.split_at(3);
            drawn.extend(PLACES.iter().map(|weights| (0..3).map(|k| weights[k] * corners[k]).sum::<DVec3>()));
            there.extend_from_slice(between);
        }
        worst = worst.max(vertex_error(&drawn, &there, &vec![1.0; there.len()]).or_none());
    }
    progress.finish();
    Ok(worst)
}

/// Triangles of translucent parts at even steps of the area: each stands for as much of it.
fn by_area(scene: &Scene, count: usize) -> Vec<u32> {
    let all: Vec<u32> = (0..scene.mesh.triangles.len() as u32).filter(|&t| scene.parts.transfers(t)).collect();
    let total: f64 = all.iter().map(|&t| scene.mesh.area_mm2(t)).sum();
    let step = total / count as f64;
    let (mut passed, mut chosen) = (0.0, Vec::new());
    for t in all {
        passed += scene.mesh.area_mm2(t);
        while chosen.len() < count && passed > (chosen.len() as f64 + 0.5) * step {
            chosen.push(t);
        }
    }
    chosen
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::geometry::mesh::{Mesh, Placement};
    use crate::geometry::part_table::PartTable;
    use crate::geometry::shapes::{cuboid, icosphere};
    use crate::geometry::source::SourceModel;
    use crate::medium::material::{Medium, preset};

    fn error(model: SourceModel) -> VertexError {
        let (mesh, _) = Mesh::from_source(model, &Placement { mm_per_unit: 1.0 }).unwrap();
        let parts = PartTable::new(&mesh, vec![0; mesh.triangles.len()], vec![("body".to_owned(), Some(0))]);
        let media = vec![Medium { name: "marble".to_owned(), properties: preset("marble").unwrap().properties() }];
        between_vertices(&Scene { mesh, parts, media }, &Silent).unwrap()
    }

    #[test]
    fn a_cube_of_twelve_triangles_is_wrong_between_its_vertices_and_a_fine_mesh_is_not() {
        let (coarse, middle, fine) =
            (error(cuboid(DVec3::splat(20.0), 1)), error(cuboid(DVec3::splat(20.0), 8)), error(icosphere(10.0, 4)));
        println!("between vertices: cube {coarse:?}; 768 triangles {middle:?}; ball of 5,120 {fine:?}");
        assert!(coarse.rms > 0.3 && coarse.worst > 0.6, "{coarse:?}");
        assert!(middle.rms < 0.5 * coarse.rms && fine.rms < 0.03, "{middle:?} {fine:?}");
    }
}
