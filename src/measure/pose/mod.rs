//! How wrong the rest pose's result is in other poses of the object.
//!
//! An asset is made for one shape. An engine that skins its mesh shows what the rest pose has, or lights the pose and carries that through
//! the transport of the rest pose. Both are measured against exact sums in the pose itself, over the same pieces of the surface: with K the
//! transport and E the irradiance of the rest pose (0) and of the pose (1), and B what the asset gives,
//!
//! `B - K1 E1 = (B - K0 E0) + (K0 E0 - K0 E1) + (K0 E1 - K1 E1)`:
//!
//! the asset's own error, that of the light alone, and that of the transport alone.

mod shape;
#[cfg(test)]
mod tests;

use glam::DVec3;

use self::shape::{Entered, Object, Shape};
use crate::error::{Error, ExitCode, Result};
use crate::evaluate::single_scattering::{Scattering, Traced};
use crate::evaluate::{Evaluator, MaterialEdit, SingleScattering};
use crate::geometry::deformation::Deformation;
use crate::geometry::mesh::{Mesh, Positions};
use crate::geometry::refinement::Refinement;
use crate::geometry::samples::Samples;
use crate::light::Light;
use crate::math::statistics::{VertexError, relative_errors, units, vertex_error};
use crate::measure::exact_sums::{FINER_BEYOND, TRUE_RAYS, true_samples};
use crate::measure::probes::{DIRECTIONS, Half, constant, directional};
use crate::measure::trust::{Subject, bounces};
use crate::medium::profile::Orders;
use crate::progress::{Progress, Silent};

/// Samples at most, unless twice those of the asset are more: each costs rays and sums in every pose.
const MOST_SAMPLES: usize = 1 << 16;

/// Error of an asset that the exact sums are fine enough to tell.
const SUMS_FOR: f64 = 0.01;

/// Rays towards soft light of all samples together, and of each.
const SOFT_RAYS: usize = 1 << 23;
const SOFT_DIRECTIONS: std::ops::RangeInclusive<u32> = 64..=512;

/// Places inside where single scattering is traced, for each vertex and light, where the radiosity includes it.
const SINGLE_SAMPLES: u32 = 256;

/// Directional lights that are tried where none are asked for.
const FEW_DIRECTIONS: usize = 4;

/// Bytes of a sample in one shape: its piece of the mesh, its tree and its light.
const BYTES_OF_A_SAMPLE: u64 = 900;

/// Lights that shine together, and their name.
#[derive(Clone, Debug, PartialEq)]
pub struct Lighting {
    /// Their text forms.
    pub name: String,
    /// The lights.
    pub lights: Vec<Light>,
}

/// What a pose is held against, and what is asked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Asked {
    /// Error up to which a pose is good, RMS.
    pub good_below: f64,
    /// Vertices that are measured at most, evenly spread; none for all.
    pub vertices: Option<usize>,
    /// Pieces of the surface that exact sums are over; none for as many as tell the errors of an asset.
    pub samples: Option<usize>,
    /// Whether errors of each vertex are kept.
    pub keeps_vertices: bool,
}

/// What to do about a pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Advice {
    /// The rest pose's result is good as it is.
    Keep,
    /// The transport of the rest pose is good with the light of the pose.
    Light,
    /// What is left is the asset's own error in the rest pose.
    Finer,
    /// Only a bake of the pose mends it.
    Bake,
}

/// Errors of one vertex in a pose: the largest under any of the lights, of the worst channel.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct VertexErrors {
    /// Exact radiosity in the pose under the first lights, RGB.
    pub exact: Vec<DVec3>,
    /// As shown, of the light alone, of the transport alone, and with the pose's light.
    pub columns: [Vec<f32>; 4],
}

/// A pose, measured. Errors are relative to the RMS of the exact radiosity in the pose; each figure is that of the worst of the lights.
#[derive(Clone, Debug, PartialEq)]
pub struct PoseError {
    /// What the asset gives in the rest pose, against the exact radiosity of the pose.
    pub shown: VertexError,
    /// Index of the lights under which that is largest.
    pub worst_light: usize,
    /// What is left of it with the light of the pose.
    pub relit: VertexError,
    /// Irradiance of the rest pose against that of the pose, both through the transport of the rest pose.
    pub light: VertexError,
    /// The transport of the rest pose against that of the pose, both for the irradiance of the pose.
    pub transport: VertexError,
    /// RMS error as shown under each of the lights, in their order.
    pub shown_by_light: Vec<f64>,
    /// What the pose does to the mesh.
    pub deformation: Deformation,
    /// What to do about it.
    pub advice: Advice,
    /// Errors of each source vertex; empty where they are not kept.
    pub vertices: VertexErrors,
}

/// All poses, measured.
#[derive(Clone, Debug, PartialEq)]
pub struct PoseCheck {
    /// Lights that were tried, those of an entry together.
    pub lights: Vec<String>,
    /// Pieces of the surface that the exact sums are over.
    pub samples: usize,
    /// Vertices at which errors were measured, and how many there are, each welded place once.
    pub vertices: [usize; 2],
    /// The asset's own error in the rest pose under these lights.
    pub own: VertexError,
    /// The error up to which a pose is good, RMS.
    pub good_below: f64,
    /// Whether light can be traced in a pose and carried through the asset's transport: it keeps the two apart.
    pub takes_light: bool,
    /// Diffusion length of the medium and channel where it is longest, mm; infinite without absorption.
    pub diffusion_length_mm: f64,
    /// The poses, in their order.
    pub poses: Vec<PoseError>,
}

impl PoseCheck {
    /// Index of the pose with the largest error as shown; none without poses.
    pub fn worst(&self) -> Option<usize> {
        let rms = |index: &usize| self.poses[*index].shown.rms;
        (0..self.poses.len()).reduce(|a, b| if rms(&b) > rms(&a) { b } else { a })
    }
}

/// The lights that poses are tried under where none are asked for: a few directions of the half for figures and the constant light, each
/// alone, as far as an asset carries them. `refused` takes those that it does not.
///
/// # Errors
/// `Unsupported` where it carries none of them.
pub fn default_lights(evaluator: &mut dyn Evaluator, refused: &mut Vec<String>) -> Result<Vec<Lighting>> {
    let few = directional(Half::Figures).into_iter().step_by(DIRECTIONS / 2 / FEW_DIRECTIONS);
    let mut kept = Vec::new();
    for light in few.chain([constant()]) {
        match evaluator.set_lights(vec![light.clone()], &Silent) {
            Ok(()) => kept.push(Lighting { name: light.to_string(), lights: vec![light] }),
            Err(error) if error.code() == ExitCode::Unsupported => refused.push(light.to_string()),
            Err(error) => return Err(error),
        }
    }
    if kept.is_empty() {
        return Err(Error::unsupported(
            "the asset carries none of the lights that poses are tried under: name some (--light)",
        ));
    }
    Ok(kept)
}

/// Measures poses of an asset's object, each with its name for messages.
///
/// # Errors
/// `Unsupported`: an asset with light between surfaces outside; lights that the asset does not carry; command line: lights that leave a
/// pose black; failures of the work.
pub fn pose_check(
    subject: Subject,
    poses: &[(String, Positions)],
    lights: &[Lighting],
    asked: Asked,
    progress: &dyn Progress,
) -> Result<PoseCheck> {
    let Subject { evaluator, asset, profile, admit } = subject;
    if bounces(&asset.provenance).is_some() {
        return Err(Error::unsupported(
            "the asset follows light that falls on the object again from outside (inter-reflection), which is not measured in poses: check an \
             asset that was baked without it",
        ));
    }
    let scene = evaluator.scene().clone();
    let own_samples = evaluator.cost().samples;
    let most = MOST_SAMPLES.max(FINER_BEYOND * own_samples);
    let count = asked.samples.unwrap_or_else(|| true_samples(&scene, SUMS_FOR, own_samples).min(most));
    admit((count as u64).saturating_mul(2 * BYTES_OF_A_SAMPLE))?;
    let samples = Samples::new(&scene.mesh, &scene.parts, count);
    let single = evaluator.single_scattering_is();
    let orders = Orders::beside_first(single != SingleScattering::None);
    let all = welded_vertices(&scene.mesh, |t| scene.parts.transfers(t));
    let chosen = spread(&all, asked.vertices);
    let in_pose = |positions: &Positions| scene.mesh.in_pose(positions);
    let reach = poses.iter().map(|(_, p)| in_pose(p).diagonal_mm()).fold(scene.mesh.diagonal_mm(), f64::max);
    let object = Object {
        asset,
        media: scene.media.clone(),
        profile: profile.map(|p| if orders == Orders::FromTwo { p.beside_single_scattering() } else { p }),
        orders,
        single: (single == SingleScattering::Included).then(|| Traced::new(Scattering::Isotropic, SINGLE_SAMPLES)),
        pieces: Refinement::new(&scene.mesh, &samples),
        vertices: chosen,
        sampling: TRUE_RAYS.with_directions_of_all(SOFT_RAYS, samples.len(), SOFT_DIRECTIONS),
        reach_mm: reach,
    };
    progress.start("pose-check", ((poses.len() + 1) * lights.len()) as u64);
    let rest = Shape::new(&object, scene.mesh.clone(), &Silent)?;
    let mut own = VertexError::default();
    let mut known = Vec::with_capacity(lights.len());
    for lighting in lights {
        evaluator.set_lights(lighting.lights.clone(), &Silent)?;
        let given = evaluator.radiosity_of(&object.vertices, &Silent)?;
        let exact = rest.radiosity(&rest.entered(&lighting.lights)?, &Silent);
        check_lit(&exact, &rest.areas_mm2, "the rest pose", lighting)?;
        own = own.max(vertex_error(&given, &exact, &rest.areas_mm2));
        known.push(Rest { given, exact });
        progress.advance(1);
    }
    let mut measured = Vec::with_capacity(poses.len());
    for (name, positions) in poses {
        let place = |e: Error| e.at(name);
        let pose = Shape::new(&object, in_pose(positions), &Silent).map_err(place)?;
        let transfers = |t: u32| scene.parts.transfers(t);
        let deformation = Deformation::new(&scene.mesh, &pose.scene.mesh, transfers).map_err(place)?;
        let mut found = Found::default();
        for (lighting, known) in lights.iter().zip(&known) {
            let entered: Entered = pose.entered(&lighting.lights)?;
            let exact = pose.radiosity(&entered, &Silent);
            check_lit(&exact, &pose.areas_mm2, name, lighting)?;
            let carried = rest.radiosity(&rest.carried(&entered, &pose), &Silent);
            found.enter(known, [&exact, &carried], &pose.areas_mm2, asked.keeps_vertices);
            progress.advance(1);
        }
        let mut error = found.error(deformation, (asked.good_below, own.rms));
        error.vertices.expand(&scene.mesh, &object.vertices);
        measured.push(error);
    }
    progress.finish();
    let lengths = scene.parts.parts.iter().filter_map(|part| scene.media.get(part.medium? as usize));
    Ok(PoseCheck {
        lights: lights.iter().map(|lighting| lighting.name.clone()).collect(),
        samples: samples.len(),
        vertices: [object.vertices.len(), all.len()],
        own,
        good_below: asked.good_below,
        takes_light: evaluator.capabilities().material == MaterialEdit::Any,
        diffusion_length_mm: lengths.map(|m| m.properties.diffusion_length_mm().max_element()).fold(0.0, f64::max),
        poses: measured,
    })
}

/// Radiosity in the rest pose under some lights: what the asset gives, and exact sums.
struct Rest {
    given: Vec<DVec3>,
    exact: Vec<DVec3>,
}

/// Errors of a pose as lights are tried.
#[derive(Default)]
struct Found {
    errors: [VertexError; 4],
    shown_by_light: Vec<f64>,
    vertices: VertexErrors,
}

impl Found {
    /// Enters the radiosity of the pose under some lights: exact, and its light carried through the transport of the rest pose.
    fn enter(&mut self, rest: &Rest, [exact, carried]: [&Vec<DVec3>; 2], areas: &[f64], keeps: bool) {
        let less = |a: &[DVec3], b: &[DVec3]| -> Vec<DVec3> { a.iter().zip(b).map(|(a, b)| *a - *b).collect() };
        let light = less(&rest.exact, carried);
        let transport = less(carried, exact);
        let shown = less(&rest.given, exact);
        let relit = less(&shown, &light);
        for (index, difference) in [shown, light, transport, relit].into_iter().enumerate() {
            // Errors of values: a difference of 0 leaves the exact value as it is.
            let values: Vec<DVec3> = exact.iter().zip(&difference).map(|(exact, d)| *exact + *d).collect();
            let error = vertex_error(&values, exact, areas);
            self.errors[index] = self.errors[index].max(error);
            if index == 0 {
                self.shown_by_light.push(error.rms);
            }
            if keeps {
                let of_vertices = relative_errors(&values, exact, areas);
                let kept = &mut self.vertices.columns[index];
                kept.resize(of_vertices.len(), 0.0);
                kept.iter_mut().zip(of_vertices).for_each(|(most, e)| *most = most.max(e));
            }
        }
        if keeps && self.vertices.exact.is_empty() {
            self.vertices.exact.clone_from(exact);
        }
    }

    fn error(self, deformation: Deformation, (good_below, own): (f64, f64)) -> PoseError {
        let [shown, light, transport, relit] = self.errors;
        let worst = |a: usize, b: usize| if self.shown_by_light[b] > self.shown_by_light[a] { b } else { a };
        let advice = if shown.rms <= good_below {
            Advice::Keep
        } else if relit.rms <= good_below {
            Advice::Light
        } else if own > good_below && transport.rms <= good_below {
            Advice::Finer
        } else {
            Advice::Bake
        };
        PoseError {
            shown,
            worst_light: (0..self.shown_by_light.len()).reduce(worst).unwrap_or(0),
            relit,
            light,
            transport,
            shown_by_light: self.shown_by_light,
            deformation,
            advice,
            vertices: self.vertices,
        }
    }
}

impl VertexErrors {
    /// Hands the values of welded places to all vertices there; 0 to those of none.
    fn expand(&mut self, mesh: &Mesh, chosen: &[u32]) {
        if self.exact.is_empty() {
            return;
        }
        let mut of_weld = vec![usize::MAX; mesh.weld.len()];
        chosen.iter().enumerate().for_each(|(index, &v)| of_weld[mesh.weld[v as usize] as usize] = index);
        let of_vertex: Vec<usize> = mesh.weld.iter().map(|&weld| of_weld[weld as usize]).collect();
        self.exact = of_vertex.iter().map(|&i| self.exact.get(i).copied().unwrap_or_default()).collect();
        for column in &mut self.columns {
            *column = of_vertex.iter().map(|&i| column.get(i).copied().unwrap_or_default()).collect();
        }
    }
}

/// The first vertex at each welded place that some triangles use, in the order of the vertices.
fn welded_vertices(mesh: &Mesh, counts: impl Fn(u32) -> bool) -> Vec<u32> {
    let mut first = vec![u32::MAX; mesh.weld.len()];
    for (triangle, corners) in mesh.triangles.iter().enumerate().filter(|(t, _)| counts(*t as u32)) {
        for (&vertex, weld) in corners.iter().zip(mesh.welded(triangle as u32)) {
            let slot = &mut first[weld as usize];
            *slot = vertex.min(*slot);
        }
    }
    let mut vertices: Vec<u32> = first.into_iter().filter(|&v| v != u32::MAX).collect();
    vertices.sort_unstable();
    vertices
}

/// So many of some vertices at most, evenly spread over their order.
fn spread(all: &[u32], most: Option<usize>) -> Vec<u32> {
    let count = most.unwrap_or(all.len()).clamp(1, all.len().max(1));
    if count >= all.len() {
        return all.to_vec();
    }
    (0..count).map(|i| all[(2 * i + 1) * all.len() / (2 * count)]).collect()
}

fn check_lit(exact: &[DVec3], areas: &[f64], where_: &str, lighting: &Lighting) -> Result<()> {
    if units(exact, areas).min_element() > 0.0 {
        return Ok(());
    }
    let name = &lighting.name;
    Err(Error::command_line(format!("--light {name}: no light arrives in {where_}, and nothing is relative to it")))
}
