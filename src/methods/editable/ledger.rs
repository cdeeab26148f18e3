//! What the stages of a bake lose: hierarchy, basis, truncation and quantiser of the far field, each against the stage
//! before it, on receivers and lights that no choice saw, the worst of all published materials and the scene's own.

use glam::DVec3;
use rayon::prelude::*;
use translux_format::far_field::FarField;

use super::bake::Stage;
use super::plan::Plan;
use crate::compress::ledger::Ledger;
use crate::error::Result;
use crate::evaluate::far_field::FarSums;
use crate::evaluate::sampling_error::{Sampled, receiver_areas};
use crate::light::Light;
use crate::math::statistics::{VertexError, vertex_error};
use crate::medium::dipole::Dipole;
use crate::medium::fresnel::BoundaryFit;
use crate::medium::material::PRESETS;
use crate::medium::profile_basis::{ProfileBasis, Projection};
use crate::progress::{Progress, Silent};
use crate::transport::balanced_tree::LightDetails;
use crate::transport::far_field::{FarTransport, LANES, Precision, TERMS};
use crate::transport::near_field::{Corners, Near, far_all_pairs};
use crate::transport::receivers::{Group, Receivers};
use crate::transport::scene::{Medium, Scene};
use crate::transport::simd::Level;

/// Groups of receivers that errors are measured on.
const GROUPS: usize = 12;

/// What a bake made and how.
pub(super) struct Baked<'a> {
    pub(super) scene: &'a Scene,
    pub(super) stage: &'a Stage,
    pub(super) plan: &'a Plan,
    pub(super) basis: &'a ProfileBasis,
    pub(super) transport: &'a FarTransport<'a>,
    pub(super) far: &'a FarField,
    pub(super) unseen: &'a [Light],
    pub(super) progress: &'a dyn Progress,
}

/// Far radiosity of each basis function at one receiver under the first channel of a light, after each stage.
#[derive(Clone, Default)]
struct Stages {
    exact: Vec<f64>,
    integrated: Vec<f64>,
    truncated: Vec<f64>,
    quantised: Vec<f64>,
}

/// A few groups of receivers, spread over all of them.
struct Subset {
    receivers: Receivers,
    /// Index of each receiver in all of them.
    indices: Vec<u32>,
    areas: Vec<f64>,
}

/// The four errors.
type Errors = [VertexError; 4];

const NAMES: [&str; 4] = ["hierarchy", "basis", "truncation", "quantiser"];

pub(super) fn measure(baked: &Baked) -> Result<Ledger> {
    let Baked { scene, stage, plan, unseen, progress, .. } = *baked;
    let mut ledger = Ledger::default();
    let areas = receiver_areas(scene, &stage.receivers);
    for light in unseen {
        let mut one = Ledger::default();
        let lights = std::slice::from_ref(light);
        let irradiance = stage.irradiance(scene, light, plan.sampling)?;
        let sampled = Sampled {
            surface: stage.surface(scene),
            media: &scene.media,
            lights,
            irradiance: &irradiance,
            sampling: plan.sampling,
            near: plan.near,
            receivers: &stage.receivers,
            areas: &areas,
        };
        sampled.enter(&mut one, progress)?;
        ledger.worst_of(one);
    }
    let subset = Subset::new(&stage.receivers, &areas);
    progress.start("ledger", unseen.len() as u64);
    let mut worst: Option<Errors> = None;
    for light in unseen {
        let errors = baked.under(light, &subset)?;
        worst = Some(worst.map_or(errors, |w| std::array::from_fn(|i| w[i].max(errors[i]))));
        progress.advance(1);
    }
    progress.finish();
    let note = format!(
        "the worst of {} materials under {} probe lights, on {} receivers that no choice saw",
        PRESETS.len() + scene.media.len(),
        unseen.len(),
        subset.indices.len()
    );
    for (name, error) in NAMES.iter().zip(worst.into_iter().flatten()) {
        ledger.add(name, error, note.clone());
    }
    Ok(ledger)
}

impl Subset {
    /// Groups between those that the choices were made by.
    fn new(all: &Receivers, areas: &[f64]) -> Self {
        let step = (all.groups.len() / GROUPS).max(1);
        let mut receivers = Receivers::default();
        let mut indices = Vec::new();
        for group in all.groups.iter().skip(step / 2).step_by(step).filter(|g| !g.run.range().is_empty()) {
            let first = receivers.positions.len() as u32;
            receivers.positions.extend_from_slice(&all.positions[group.run.range()]);
            indices.extend(group.run.first..group.run.end);
            let run = crate::geometry::cluster::Run { first, end: receivers.positions.len() as u32 };
            receivers.groups.push(Group { run, part: group.part });
        }
        let areas = indices.iter().map(|&i| areas[i as usize]).collect();
        Self { receivers, indices, areas }
    }
}

impl Baked<'_> {
    /// Errors under one light, the worst of all materials.
    fn under(&self, light: &Light, subset: &Subset) -> Result<Errors> {
        let (scene, stage) = (self.scene, self.stage);
        let irradiance = stage.irradiance(scene, light, self.plan.sampling)?;
        let details = LightDetails::new(&stage.samples, &stage.patches, &irradiance);
        let stages = self.stages(subset, &irradiance, &details);
        let surface = stage.surface(scene);
        let corners = Corners::new(&scene.mesh, &stage.samples, &stage.patches);
        let presets = PRESETS.iter().map(|m| Medium { name: m.name.to_owned(), properties: m.properties() });
        let mut worst: Option<Errors> = None;
        for medium in presets.chain(scene.media.iter().cloned()) {
            let media = vec![medium.clone(); scene.media.len()];
            let near = Near::new(&surface, (&stage.tree, &corners), &media, self.plan.near, stage.split_mm);
            let mut near_values = vec![DVec3::ZERO; subset.indices.len()];
            near.add(&subset.receivers, &irradiance, &mut near_values, &Silent);
            let dipoles = medium.properties.dipoles(BoundaryFit::Published);
            let far = far_all_pairs(&surface, &dipoles, stage.split_mm, &subset.receivers, &irradiance);
            let errors = self.of_material(&dipoles, &stages, &near_values, &far, subset);
            worst = Some(worst.map_or(errors, |w| std::array::from_fn(|i| w[i].max(errors[i]))));
        }
        Ok(worst.unwrap_or_default())
    }

    fn of_material(
        &self,
        dipoles: &[Dipole; 3],
        stages: &[Stages],
        near: &[DVec3],
        far: &[DVec3],
        subset: &Subset,
    ) -> Errors {
        let projections = dipoles.map(|d| self.basis.project(&d));
        let combine = |values: &[f64]| {
            let channel = |p: &Projection| p.coefficients.iter().zip(values).map(|(s, v)| s * v).sum::<f64>();
            DVec3::new(channel(&projections[0]), channel(&projections[1]), channel(&projections[2]))
        };
        let truth: Vec<DVec3> = near.iter().zip(far).map(|(n, f)| *n + *f).collect();
        let error = |change: &dyn Fn(usize) -> DVec3| {
            let values: Vec<DVec3> = truth.iter().enumerate().map(|(i, t)| *t + change(i)).collect();
            vertex_error(&values, &truth, &subset.areas)
        };
        let difference = |a: &[f64], b: &[f64]| combine(a) - combine(b);
        [
            error(&|i| difference(&stages[i].integrated, &stages[i].exact)),
            error(&|i| combine(&stages[i].exact) - far[i]),
            error(&|i| difference(&stages[i].truncated, &stages[i].integrated)),
            error(&|i| difference(&stages[i].quantised, &stages[i].truncated)),
        ]
    }

    fn stages(&self, subset: &Subset, irradiance: &[DVec3], details: &LightDetails) -> Vec<Stages> {
        let stored = FarSums::new(Level::detect(), self.far, details);
        let everything = Precision { keep: 0.0, ..self.transport.precision };
        let everything = FarTransport { precision: everything, ..*self.transport };
        let terms = self.basis.terms();
        let of_group = |group: &Group| {
            let members = &subset.receivers.positions[group.run.range()];
            let part = group.part as usize;
            let integrated = self.rebuild(&everything, members, part, details);
            let truncated = self.rebuild(self.transport, members, part, details);
            let exact = |lane: usize| self.all_pairs(members[lane], part, irradiance);
            let all = integrated.into_iter().zip(truncated).enumerate();
            all.map(|(lane, (integrated, truncated))| Stages {
                exact: exact(lane),
                integrated,
                truncated,
                quantised: (0..terms)
                    .map(|k| stored.value(subset.indices[group.run.first as usize + lane] as usize, k).x)
                    .collect(),
            })
            .collect::<Vec<_>>()
        };
        subset.receivers.groups.par_iter().flat_map_iter(of_group).collect()
    }

    /// Far radiosity of each function at the receivers of a group, from rows that are not quantised.
    fn rebuild(&self, transport: &FarTransport, members: &[DVec3], part: usize, light: &LightDetails) -> Vec<Vec<f64>> {
        let (rows, _) = transport.rows(members, part);
        let terms = self.basis.terms();
        let mean = f64::from(light.means[part][0]);
        let mut sums: Vec<Vec<f64>> =
            rows.sums.chunks_exact(terms).map(|s| s.iter().map(|&v| f64::from(v) * mean).collect()).collect();
        let mut values = rows.values.iter();
        for (&node, &mask) in rows.nodes.iter().zip(&rows.masks) {
            let detail = f64::from(light.details[node as usize][0]);
            for k in (0..terms).filter(|k| mask >> k & 1 == 1) {
                let Some(row) = values.next() else { break };
                for (sum, value) in sums.iter_mut().zip(&row[..LANES]) {
                    sum[k] += f64::from(*value) * detail;
                }
            }
        }
        sums.iter_mut().flatten().for_each(|v| *v *= light.scale);
        sums
    }

    /// The same from every sample.
    fn all_pairs(&self, receiver: DVec3, part: usize, irradiance: &[DVec3]) -> Vec<f64> {
        let mut sums = vec![0.0; self.basis.terms()];
        let mut values = [0.0; TERMS];
        for index in self.stage.samples.part(part) {
            let patch = &self.stage.patches[index];
            let flux = irradiance[index].x * patch.area_mm2;
            self.transport.table.evaluate(patch.centre_mm.distance_squared(receiver) as f32, &mut values);
            for (sum, value) in sums.iter_mut().zip(values) {
                *sum += flux * f64::from(value);
            }
        }
        sums
    }
}
