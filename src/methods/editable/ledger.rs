//! What the stages of a bake lose: hierarchy, basis, truncation and quantiser of the far field, each against the stage
//! before it, on receivers and lights that no choice saw, the worst of all published materials and the scene's own.

use glam::DVec3;
use rayon::prelude::*;
use translux_format::far_field::FarField;

use super::bake::Stage;
use super::interpolation::{Between, all_pairs};
use super::plan::Plan;
use super::subset::{Projected, Subset};
use crate::compress::ledger::Ledger;
use crate::error::Result;
use crate::evaluate::environment::comes_from_far_away;
use crate::evaluate::far_field::{ByFunction, FarSums};
use crate::evaluate::sampling_error::{Sampled, receiver_areas};
use crate::light::Light;
use crate::math::simd::Level;
use crate::math::statistics::{VertexError, vertex_error};
use crate::medium::profile_basis::ProfileBasis;
use crate::progress::Progress;
use crate::transport::balanced_tree::LightDetails;
use crate::transport::far_field::{FarTransport, Precision, Rows};
use crate::transport::near_field::far_all_pairs;
use crate::transport::scene::Scene;

/// Groups of receivers that errors are measured on.
const GROUPS: usize = 12;

/// Receivers between the points of the far field on which interpolation is measured.
const BETWEEN: usize = 64;

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

/// Far radiosity of each basis function at each receiver under the first channel of a light, after each stage.
struct Stages {
    exact: Vec<Vec<f64>>,
    integrated: Vec<Vec<f64>>,
    truncated: Vec<Vec<f64>>,
    quantised: Vec<Vec<f64>>,
}

/// Rows of the receivers that errors are measured on, with and without what is dropped.
struct Measured {
    subset: Subset,
    everything: Vec<Rows>,
    kept: Vec<Rows>,
    materials: Vec<Projected>,
}

/// The errors of the stages.
type Errors = [VertexError; 4];

const NAMES: [&str; 4] = ["hierarchy", "basis", "truncation", "quantiser"];

pub(super) fn measure(baked: &Baked) -> Result<Ledger> {
    let Baked { scene, stage, plan, unseen, progress, .. } = *baked;
    // Environments have entries of their own; to the transport they are smooth.
    let unseen: Vec<&Light> = unseen.iter().filter(|l| !comes_from_far_away(l)).collect();
    let mut ledger = Ledger::default();
    let areas = receiver_areas(scene, &stage.receivers);
    progress.start("ledger", 2 * unseen.len() as u64);
    let measured = baked.rows();
    let between = Between::new(scene, stage, baked.basis, &stage.points, (BETWEEN, 1));
    let (mut worst, mut interpolation): (Option<Errors>, _) = (None, VertexError::default());
    for &light in &unseen {
        let (irradiance, pieces) = stage.irradiance(scene, light, plan.sampling)?;
        let errors = baked.under(&measured, &irradiance);
        if let Some(between) = &between {
            interpolation =
                interpolation.max(between.error(scene, stage, (plan, baked.transport.table), &[&irradiance]));
        }
        worst = Some(worst.map_or(errors, |w| std::array::from_fn(|i| w[i].max(errors[i]))));
        progress.advance(1);
        let mut one = Ledger::default();
        let sampled = Sampled {
            surface: stage.surface(scene),
            media: &scene.media,
            kernels: None,
            lights: std::slice::from_ref(light),
            irradiance: (&irradiance, &pieces),
            sampling: plan.sampling,
            near: plan.near,
            receivers: &stage.receivers,
            areas: &areas,
        };
        sampled.enter(&mut one, &crate::progress::Silent)?;
        ledger.worst_of(one);
        progress.advance(1);
    }
    progress.finish();
    let note = format!(
        "the worst of {} materials under {} probe lights, on {} receivers; no choice saw these lights and receivers",
        measured.materials.len(),
        unseen.len(),
        measured.subset.indices.len()
    );
    for (name, error) in NAMES.iter().zip(worst.into_iter().flatten()) {
        ledger.add(name, error, note.clone());
    }
    if let Some(between) = between {
        let (points, targets) = (stage.points.receivers.len(), between.targets());
        ledger.add(
            "interpolation",
            interpolation,
            format!("the far field from {points} points, as above on {targets} receivers"),
        );
    }
    Ok(ledger)
}

impl Baked<'_> {
    fn rows(&self) -> Measured {
        let subset = Subset::new(self.scene, &self.stage.points.receivers, GROUPS, 1);
        let rows = |transport: &FarTransport| -> Vec<Rows> {
            let groups = subset.receivers.groups.par_iter();
            let positions = &subset.receivers.positions;
            groups.map(|group| transport.rows(&positions[group.run.range()], group.part as usize)).collect()
        };
        let precision = Precision { keep: 0.0, ..self.transport.precision };
        let everything = rows(&FarTransport { precision, ..*self.transport });
        let kept = rows(self.transport);
        let materials = subset.materials(self.scene, self.basis);
        Measured { subset, everything, kept, materials }
    }

    /// Errors under one light, the worst of all materials.
    fn under(&self, measured: &Measured, irradiance: &[DVec3]) -> Errors {
        let Self { scene, stage, plan, .. } = *self;
        let Measured { subset, materials, .. } = measured;
        let stages = self.stages(measured, irradiance);
        let near = subset.near(scene, stage, plan, materials, irradiance);
        let surface = stage.surface(scene);
        let mut worst: Option<Errors> = None;
        for (material, near) in materials.iter().zip(near) {
            let far = far_all_pairs(&surface, &material.dipoles, stage.split_mm, &subset.receivers, irradiance);
            let truth: Vec<DVec3> = near.iter().zip(&far).map(|(n, f)| *n + *f).collect();
            // Each stage as if all before it had been exact.
            let against = |before: &[DVec3], after: &[DVec3]| {
                let values: Vec<DVec3> = (0..truth.len()).map(|i| truth[i] + (after[i] - before[i])).collect();
                vertex_error(&values, &truth, &subset.areas)
            };
            let combined = |values: &[Vec<f64>]| material.add(values, vec![DVec3::ZERO; truth.len()]);
            let (exact, integrated) = (combined(&stages.exact), combined(&stages.integrated));
            let (truncated, quantised) = (combined(&stages.truncated), combined(&stages.quantised));
            let errors = [
                against(&exact, &integrated),
                against(&far, &exact),
                against(&integrated, &truncated),
                against(&truncated, &quantised),
            ];
            worst = Some(worst.map_or(errors, |w| std::array::from_fn(|i| w[i].max(errors[i]))));
        }
        worst.unwrap_or_default()
    }

    fn stages(&self, measured: &Measured, irradiance: &[DVec3]) -> Stages {
        let Measured { subset, everything, kept, .. } = measured;
        let details = LightDetails::new(&self.stage.samples, &self.stage.patches, irradiance);
        let stored = FarSums::new(Level::detect(), (self.far, &ByFunction::new(self.far)), &details);
        let terms = self.basis.terms();
        let quantised = |&index: &u32| (0..terms).map(|k| stored.value(index as usize, k).x).collect();
        Stages {
            exact: all_pairs(self.stage, self.transport.table, &subset.receivers, &[irradiance]).concat(),
            integrated: subset.rebuilt(everything, terms, &details),
            truncated: subset.rebuilt(kept, terms, &details),
            quantised: subset.indices.iter().map(quantised).collect(),
        }
    }
}
