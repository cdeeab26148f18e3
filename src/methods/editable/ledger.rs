//! What the stages of a bake lose: hierarchy, basis, truncation and quantiser of the far field, each against the stage
//! before it, on receivers and lights that no choice saw, the worst of all published materials and the scene's own.

use glam::DVec3;
use rayon::prelude::*;
use translux_format::far_field::FarField;

use super::bake::Stage;
use super::interpolation::{Between, all_pairs};
use super::plan::Plan;
use super::subset::{OfFunctions, Projected, Subset};
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
use crate::transport::receivers::Group;
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

/// Rows with the same functions that errors are measured on, with and without what is dropped.
struct Measured {
    of: OfFunctions,
    everything: Vec<Rows>,
    kept: Vec<Rows>,
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
    let materials = Subset::materials(scene, baked.basis);
    let measured = baked.rows();
    let between = Between::new(scene, stage, baked.basis, &stage.points, (BETWEEN, 1));
    let (mut worst, mut irradiances): (Option<Errors>, Vec<Vec<DVec3>>) = (None, Vec::new());
    for &light in &unseen {
        let (irradiance, pieces) = stage.irradiance(scene, light, plan.sampling)?;
        let errors = baked.under(&measured, &materials, &irradiance);
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
        irradiances.push(irradiance);
        progress.advance(1);
    }
    progress.finish();
    let note = format!(
        "the worst of {} materials under {} probe lights, on {} receivers; no choice saw these lights and receivers",
        materials.len(),
        unseen.len(),
        measured.iter().map(|m| m.of.subset.indices.len()).sum::<usize>()
    );
    for (name, error) in NAMES.iter().zip(worst.into_iter().flatten()) {
        ledger.add(name, error, note.clone());
    }
    if let Some(between) = between {
        let irradiances: Vec<&[DVec3]> = irradiances.iter().map(Vec::as_slice).collect();
        let interpolation = between.error(scene, stage, (plan, baked.transport.table), &irradiances);
        let note =
            format!("the far field from {}, as above on {} receivers", stage.points.describe(), between.targets());
        ledger.add("interpolation", interpolation, note);
    }
    Ok(ledger)
}

impl Baked<'_> {
    fn rows(&self) -> Vec<Measured> {
        let of_class = |of: OfFunctions| {
            let receivers = &of.subset.receivers;
            let rows = |transport: &FarTransport| -> Vec<Rows> {
                let of_group = |group: &Group| {
                    transport.rows(&receivers.positions[group.run.range()], group.part as usize, of.functions)
                };
                receivers.groups.par_iter().map(of_group).collect()
            };
            let precision = Precision { keep: 0.0, ..self.transport.precision };
            let everything = rows(&FarTransport { precision, ..*self.transport });
            let kept = rows(self.transport);
            Measured { of, everything, kept }
        };
        Subset::of_functions(self.scene, &self.stage.points, (GROUPS, 1)).into_iter().map(of_class).collect()
    }

    /// Errors under one light, the worst of all materials. What a vertex sums of rows with unlike functions errs on its own.
    fn under(&self, measured: &[Measured], materials: &[Projected], irradiance: &[DVec3]) -> Errors {
        let details = LightDetails::new(&self.stage.samples, &self.stage.patches, irradiance);
        let stored = FarSums::new(Level::detect(), (self.far, &ByFunction::new(self.far), &[]), &details);
        let mut of_materials = vec![Errors::default(); materials.len()];
        for (class, measured) in measured.iter().enumerate() {
            let found = self.of_class((class, measured), materials, irradiance, (&details, &stored));
            for (all, found) in of_materials.iter_mut().zip(found) {
                *all = std::array::from_fn(|i| beside(all[i], found[i]));
            }
        }
        of_materials.into_iter().reduce(|a, b| std::array::from_fn(|i| a[i].max(b[i]))).unwrap_or_default()
    }

    /// Errors of the functions of some rows in each material.
    fn of_class(
        &self,
        (class, measured): (usize, &Measured),
        materials: &[Projected],
        irradiance: &[DVec3],
        light: (&LightDetails, &FarSums),
    ) -> Vec<Errors> {
        let Self { scene, stage, plan, .. } = *self;
        let subset = &measured.of.subset;
        let stages = self.stages(measured, irradiance, light);
        let near = subset.near(scene, stage, plan, materials, irradiance);
        let surface = stage.surface(scene);
        let of_material = |(material, near): (&Projected, Vec<DVec3>)| {
            let combined = |values: &[Vec<f64>]| material.add(values, vec![DVec3::ZERO; near.len()]);
            let exact = combined(&stages.exact);
            // The basis is that of all functions: one set of receivers says what it loses.
            let far = match class {
                0 => far_all_pairs(&surface, &material.dipoles, stage.split_mm, &subset.receivers, irradiance),
                _ => exact.clone(),
            };
            let truth: Vec<DVec3> = near.iter().zip(&far).map(|(n, f)| *n + *f).collect();
            // Each stage as if all before it had been exact.
            let against = |before: &[DVec3], after: &[DVec3]| {
                let values: Vec<DVec3> = (0..truth.len()).map(|i| truth[i] + (after[i] - before[i])).collect();
                vertex_error(&values, &truth, &subset.areas)
            };
            let integrated = combined(&stages.integrated);
            let (truncated, quantised) = (combined(&stages.truncated), combined(&stages.quantised));
            [
                against(&exact, &integrated),
                against(&far, &exact),
                against(&integrated, &truncated),
                against(&truncated, &quantised),
            ]
        };
        materials.iter().zip(near).map(of_material).collect()
    }

    fn stages(&self, measured: &Measured, irradiance: &[DVec3], light: (&LightDetails, &FarSums)) -> Stages {
        let Measured { of: OfFunctions { subset, functions }, everything, kept } = measured;
        let (details, stored) = light;
        let terms = self.basis.terms();
        let exact = all_pairs(self.stage, self.transport.table, &subset.receivers, &[irradiance]).concat();
        let of_rows = |mut values: Vec<Vec<f64>>| {
            for (values, exact) in values.iter_mut().zip(&exact) {
                (0..terms).filter(|k| functions >> k & 1 == 0).for_each(|k| values[k] = exact[k]);
            }
            values
        };
        let quantised = |&row: &u32| (0..terms).map(|k| stored.value(row as usize, k).x).collect();
        Stages {
            integrated: of_rows(subset.rebuilt(everything, terms, details)),
            truncated: of_rows(subset.rebuilt(kept, terms, details)),
            quantised: of_rows(subset.indices.iter().map(quantised).collect()),
            exact,
        }
    }
}

/// Two errors that know nothing of each other.
fn beside(a: VertexError, b: VertexError) -> VertexError {
    VertexError {
        rms: a.rms.hypot(b.rms),
        bias: a.bias + b.bias,
        p999: a.p999.hypot(b.p999),
        worst: a.worst.hypot(b.worst),
    }
}
