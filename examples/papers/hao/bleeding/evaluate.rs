//! The two passes, and what they lose.

use std::sync::OnceLock;

use glam::DVec3;
use rayon::prelude::*;

use super::lists::{Cell, Lists, Neighbourhoods};
use translux::compress::ledger::Ledger;
use translux::error::{Error, Result};
use translux::evaluate::{Capabilities, Cost, Evaluator, MaterialEdit, ProfileEdit, SourceFields};
use translux::forms::baked_in::{self, MeanCosine, Truth};
use translux::geometry::bvh::Bvh;
use translux::geometry::samples::Samples;
use translux::light::Light;
use translux::math::statistics::{VertexError, vertex_error};
use translux::medium::material::Medium;
use translux::progress::{Progress, Silent};
use translux::scene::Scene;
use translux::transport::irradiance::{Illumination, LightSampling};
use translux::transport::receivers::NONE;
use translux::transport::surface::Surface;

/// Vertices that errors are measured at, of all that each light reaches.
const PROBES: usize = 256;

/// Irradiance of every vertex, RGB: the first pass.
pub(super) fn first_pass(
    scene: &Scene,
    bvh: &Bvh,
    vertices: &Neighbourhoods,
    lights: &[Light],
    progress: &dyn Progress,
) -> Result<Vec<DVec3>> {
    let none =
        Samples { facets: Vec::new(), patch_offsets: vec![0], part_offsets: vec![0; scene.parts.parts.len() + 1] };
    let surface = Surface { domain: scene.domain(), bvh, samples: &none, patches: &[] };
    let etas: Vec<f64> = scene.media.iter().map(|m| m.properties.eta_inside_over_outside).collect();
    Ok(Illumination::new(&surface, lights, &etas, LightSampling::FAST)?.at_points(&vertices.points, progress))
}

/// What the range and vertices as samples lose, under lights that no choice saw, at some of the vertices.
pub(super) fn measure(
    scene: &Scene,
    vertices: &Neighbourhoods,
    ranges_mm: &[f64],
    (samples, unseen): (usize, &[Light]),
    progress: &dyn Progress,
) -> Result<Ledger> {
    progress.start("errors", unseen.len() as u64);
    let bvh = Bvh::new(&scene.mesh);
    let mut truth = baked_in::truth(scene, samples);
    // Source vertices with the value of each probe.
    let step = (vertices.len() / PROBES).max(1);
    let probes: Vec<(usize, u32)> = (0..vertices.of_vertex.len())
        .filter_map(|v| {
            Some((v, vertices.of_vertex[v])).filter(|(_, i)| *i != NONE && (*i as usize).is_multiple_of(step))
        })
        .collect();
    let areas: Vec<f64> = probes.iter().map(|(_, i)| vertices.areas_mm2[*i as usize]).collect();
    let irradiance: Vec<Vec<DVec3>> = unseen
        .iter()
        .map(|light| first_pass(scene, &bvh, vertices, std::slice::from_ref(light), &Silent))
        .collect::<Result<_>>()?;
    // All of the part, and what is in range, under each light.
    let sums: Vec<Vec<[DVec3; 2]>> =
        probes.par_iter().map(|(_, probe)| vertices.sums(*probe as usize, ranges_mm, &irradiance)).collect();
    let (mut range, mut sampling) = (VertexError::default(), VertexError::default());
    for (index, light) in unseen.iter().enumerate() {
        truth.set_lights(vec![light.clone()], &Silent)?;
        let expected = truth.radiosity(&Silent)?;
        let expected: Vec<DVec3> = probes.iter().map(|(v, _)| expected[*v]).collect();
        let [all, near] = [0, 1].map(|k| sums.iter().map(|of_light| of_light[index][k]).collect::<Vec<DVec3>>());
        range = range.max(vertex_error(&near, &all, &areas).or_none());
        sampling = sampling.max(vertex_error(&all, &expected, &areas).or_none());
        progress.advance(1);
    }
    progress.finish();
    let mut ledger = Ledger::default();
    let list: Vec<String> = ranges_mm.iter().map(|r| format!("{r:.2}")).collect();
    ledger.add("range", range, format!("what lies beyond {} mm, under lights that no choice saw", list.join(", ")));
    ledger.add(
        "vertices as samples",
        sampling,
        "every vertex with a third of its triangles, against the samples, as above",
    );
    Ok(ledger)
}

/// Lists, lit.
pub(super) struct BleedingEvaluator {
    scene: Scene,
    bvh: OnceLock<Bvh>,
    vertices: Neighbourhoods,
    lists: Lists,
    lights: Vec<Light>,
    irradiance: Vec<DVec3>,
    /// For who asks what this is worth.
    truth: Truth,
}

impl BleedingEvaluator {
    pub(super) fn new(scene: Scene, vertices: Neighbourhoods, ranges_mm: &[f64], samples: usize) -> Self {
        let lists = Lists::new(&vertices, ranges_mm, Cell::Pieces);
        let irradiance = vec![DVec3::ZERO; vertices.len()];
        let (lights, truth) = (Vec::new(), Truth::new(samples));
        Self { scene, bvh: OnceLock::new(), vertices, lists, lights, irradiance, truth }
    }
}

/// The second pass, at the source vertices.
fn gathered(lists: &Lists, vertices: &Neighbourhoods, irradiance: &[DVec3]) -> Vec<DVec3> {
    let values = lists.radiosity(irradiance);
    vertices.of_vertex.iter().map(|&i| values.get(i as usize).copied().unwrap_or(DVec3::ZERO)).collect()
}

impl Evaluator for BleedingEvaluator {
    fn capabilities(&self) -> Capabilities {
        Capabilities { material: MaterialEdit::None, profile: ProfileEdit::None, source_fields: SourceFields::None }
    }

    fn cost(&self) -> Cost {
        let vertices = &self.vertices;
        Cost {
            // Vertices are the samples.
            samples: vertices.len(),
            receivers: vertices.len(),
            resident_bytes: self.lists.bytes()
                + size_of_val(vertices.points.as_slice())
                + size_of_val(vertices.of_vertex.as_slice()),
        }
    }

    fn scene(&self) -> &Scene {
        &self.scene
    }

    fn bvh(&self) -> &Bvh {
        self.bvh.get_or_init(|| Bvh::new(&self.scene.mesh))
    }

    fn set_lights(&mut self, lights: Vec<Light>, progress: &dyn Progress) -> Result<()> {
        self.irradiance = first_pass(&self.scene, self.bvh(), &self.vertices, &lights, progress)?;
        self.lights = lights;
        Ok(())
    }

    fn set_media(&mut self, media: Vec<Medium>) -> Result<()> {
        baked_in::replace_media(&mut self.scene, media, MeanCosine::Stays)
    }

    fn radiosity(&mut self, _: &dyn Progress) -> Result<Vec<DVec3>> {
        Ok(gathered(&self.lists, &self.vertices, &self.irradiance))
    }

    fn measured_error(&mut self, unseen: &[Light], progress: &dyn Progress) -> Result<Ledger> {
        self.bvh();
        let Self { scene, bvh, vertices, lists, lights, truth, .. } = self;
        let Some(bvh) = bvh.get() else { return Err(Error::runtime("no tree of triangles")) };
        let values =
            |lights: &[Light]| Ok(gathered(lists, vertices, &first_pass(scene, bvh, vertices, lights, progress)?));
        let note =
            "sums over lists of vertices against samples lit by rays, the worst of these lights and of probe lights";
        truth.measured(scene, (lights, unseen), values, ("bleeding", note), progress)
    }

    fn all_pairs(&mut self, progress: &dyn Progress) -> Result<Vec<DVec3>> {
        self.truth.lit(&self.scene, &self.lights, progress)?.all_pairs(progress)
    }
}
