//! Errors of the stages of a bake: hierarchy, basis, truncation and quantiser of the far field, each against the one
//! before it, on receivers and lights that no choice saw, the worst of all published materials and the scene's own; and the near field as it is
//! summed at run time, in the scene's own.

use glam::DVec3;
use translux_format::far_field::FarField;

use super::far_sums::{ByFunction, FarSums};
use super::interpolation::Between;
use super::ordered_samples::Work;
use super::sources::{FarRadiosity, Sources, all_pairs};
use super::subset::{NearOfMaterials, OfFunctions, Projected, Subset};
use crate::compress::ledger::Ledger;
use crate::error::Result;
use crate::evaluate::sampling_error::Sampled;
use crate::evaluate::stages::{of_kinds, probe_points, worst};
use crate::forms::environment_rows::BY_RAYS;
use crate::light::Light;
use crate::math::simd::InstructionSet;
use crate::math::statistics::VertexError;
use crate::medium::fresnel::BoundaryFit;
use crate::parallel::*;
use crate::progress::{Progress, Silent};
use crate::scene::Scene;
use crate::transport::balanced_tree::LightDetails;
use crate::transport::far_field::{FarTransport, Precision, Rows};
use crate::transport::gather::{Gather, Scheme};
use crate::transport::irradiance::Pieces;
use crate::transport::kernel::medium::MediumKernel;
use crate::transport::near_field::{Near, around, far_all_pairs};
use crate::transport::receivers::{Group, ProbePoints, Receivers};
use crate::transport::tree::SampleTree;

/// Groups of receivers that errors are measured on.
const GROUPS: usize = 12;

/// Receivers between the points of the far field on which interpolation is measured.
const BETWEEN: usize = 64;

/// Results and inputs of a bake that errors are measured on.
pub(super) struct Baked<'a> {
    pub(super) work: Work<'a>,
    pub(super) transport: &'a FarTransport<'a>,
    pub(super) far: &'a FarField,
    pub(super) unseen: &'a [Light],
    pub(super) progress: &'a dyn Progress,
}

/// Far radiosity of each basis function at each receiver under the first channel of a light, after each stage.
struct AfterStages {
    exact: FarRadiosity,
    integrated: FarRadiosity,
    truncated: FarRadiosity,
    quantised: FarRadiosity,
}

/// Rows that have the same functions, with and without the dropped coefficients, to measure errors on.
struct Measured<'a> {
    of: &'a OfFunctions,
    near: NearOfMaterials<'a>,
    everything: Vec<Rows>,
    kept: Vec<Rows>,
    /// Far radiosity under each light, summed over every sample.
    exact: Vec<FarRadiosity>,
}

/// The errors of the stages.
type Errors = [VertexError; 4];

/// Lights that the error of the near field is measured under: it is mostly of the mesh.
const NEAR_LIGHTS: usize = 2;

const BASIS: usize = 1;
const NAMES: [&str; 4] = ["hierarchy", "basis", "truncation", "quantiser"];

pub(super) fn measure(baked: &Baked) -> Result<Ledger> {
    let Baked { work, unseen, progress, .. } = *baked;
    let Work { scene, ordered, form, .. } = work;
    // Environments have entries of their own; to the transport they are smooth.
    let unseen = of_kinds(unseen, &BY_RAYS);
    let mut ledger = Ledger::default();
    if unseen.is_empty() {
        return Ok(ledger);
    }
    let areas = ordered.receivers.areas_mm2(&scene.mesh);
    progress.start("ledger", 2 * unseen.len() as u64);
    let materials = Subset::materials(work);
    let mut lit: Vec<(Vec<DVec3>, Pieces)> = Vec::with_capacity(unseen.len());
    for light in &unseen {
        let (irradiance, pieces) = ordered.irradiance(scene, light, form.sampling)?;
        let mut one = Ledger::default();
        let sampled = Sampled {
            surface: ordered.surface(scene),
            kernels: None,
            calibrated: None,
            lights: std::slice::from_ref(light),
            irradiance: (&irradiance, &pieces),
            stored: None,
            sampling: form.sampling,
            near: form.near,
            receivers: &ordered.receivers,
            areas: &areas,
        };
        sampled.enter(&mut one, &Silent)?;
        ledger.worst_of(one);
        lit.push((irradiance, pieces));
        progress.advance(1);
    }
    let near = near_error(work, &lit);
    let irradiances: Vec<&[DVec3]> = lit.iter().map(|(irradiance, _)| irradiance.as_slice()).collect();
    let of_functions = Subset::of_functions(scene, &ordered.points, (GROUPS, 1));
    let measured: Vec<Measured> =
        of_functions.iter().map(|of| Measured::new(baked, of, &materials, &irradiances)).collect();
    let errors = worst(irradiances.iter().enumerate(), |(index, irradiance)| {
        progress.advance(1);
        Ok(baked.under(&measured, &materials, (index, irradiance)))
    })?;
    progress.finish();
    let note = format!(
        "the worst of {} materials under {} probe lights, on {} receivers; no choice saw these lights and receivers",
        materials.len(),
        unseen.len(),
        measured.iter().map(|m| m.of.subset.receivers.len()).sum::<usize>()
    );
    for (name, error) in NAMES.iter().zip(errors) {
        ledger.add(name, error, note.clone());
    }
    let note = format!(
        "as it is summed at run time, against all pairs, in the scene's media under {NEAR_LIGHTS} of these lights"
    );
    ledger.add("near field", near, note);
    if let Some(between) = Between::new(work, &ordered.points, (BETWEEN, 1)) {
        let interpolation = between.error(work, &irradiances);
        let note =
            format!("the far field from {}, as above on {} receivers", ordered.points.describe(), between.targets());
        ledger.add("interpolation", interpolation, note);
    }
    // What samples miss, what the basis cannot follow, what is cut off, rounded and interpolated have nothing to do with each other.
    ledger.add_together();
    Ok(ledger)
}

/// Error of the near field beside the far one, the worst of a few lights, against all pairs of whole kernels.
fn near_error(Work { scene, ordered, form, .. }: Work, lit: &[(Vec<DVec3>, Pieces)]) -> VertexError {
    let areas = ordered.receivers.areas_mm2(&scene.mesh);
    let (subset, points) = probe_points(&ordered.receivers, &areas);
    let (surface, kernels, tree) =
        (ordered.surface(scene), MediumKernel::of_media(&scene.media), SampleTree::default());
    let lengths = (ordered.split_mm, scene.mesh.diagonal_mm());
    let around = around(&surface, &subset, form.near, ordered.split_mm);
    let near = Near::new(surface, (&around, &ordered.corners), &kernels, form.near, ordered.split_mm);
    // What the rule in force misses is in the error of sampling.
    let gather = Gather::with_kernels(&surface, &tree, kernels.clone(), form.near);
    let step = (lit.len() / NEAR_LIGHTS).max(1);
    let of_light = |(irradiance, pieces): &(Vec<DVec3>, Pieces)| {
        let light = gather.light_with_pieces(irradiance, pieces);
        let truth = gather.radiosity(&subset, &light, Scheme::AllPairs, &Silent);
        let mut values = far_of_media(scene, ordered.sources(), lengths, (&subset, irradiance));
        near.add(&subset, (irradiance, pieces), &mut values, &Silent);
        points.error(&values, &truth)
    };
    lit.iter().step_by(step).take(NEAR_LIGHTS).map(of_light).fold(VertexError::default(), VertexError::max)
}

/// The far part of each receiver's own medium, summed over all samples.
fn far_of_media(
    scene: &Scene,
    sources: Sources,
    lengths: (f64, f64),
    (receivers, irradiance): (&Receivers, &[DVec3]),
) -> Vec<DVec3> {
    let mut values = vec![DVec3::ZERO; receivers.len()];
    for (index, medium) in scene.media.iter().enumerate() {
        let dipoles = medium.properties.dipoles(BoundaryFit::Published);
        let far = far_all_pairs(sources, &dipoles, lengths, receivers, irradiance);
        for group in &receivers.groups {
            if scene.parts.parts[group.part as usize].medium == Some(index as u32) {
                values[group.run.range()].copy_from_slice(&far[group.run.range()]);
            }
        }
    }
    values
}

impl<'a> Measured<'a> {
    fn new(baked: &'a Baked, of: &'a OfFunctions, materials: &[Projected], irradiances: &[&[DVec3]]) -> Self {
        let Baked { work, transport, .. } = *baked;
        let receivers = &of.subset.receivers;
        let rows = |transport: &FarTransport| -> Vec<Rows> {
            let of_group = |group: &Group| {
                transport.rows(&receivers.positions[group.run.range()], group.part as usize, of.functions)
            };
            receivers.groups.par_iter().map(of_group).collect()
        };
        let precision = Precision { keep: 0.0, ..transport.precision };
        Self {
            of,
            near: of.subset.near(work, materials),
            everything: rows(&FarTransport { precision, ..*transport }),
            kept: rows(transport),
            exact: all_pairs(work.ordered.sources(), work.table, receivers, irradiances),
        }
    }
}

impl Baked<'_> {
    /// Errors under one light, the worst of all materials. Errors of rows with different functions are independent.
    fn under(&self, measured: &[Measured], materials: &[Projected], (light, irradiance): (usize, &[DVec3])) -> Errors {
        let details = LightDetails::new(&self.work.ordered.samples, &self.work.ordered.patches, irradiance);
        let stored = FarSums::new(InstructionSet::detect(), (self.far, &ByFunction::new(self.far), &[]), &details);
        let mut of_materials = vec![Errors::default(); materials.len()];
        for (class, measured) in measured.iter().enumerate() {
            let near = measured.near.under(irradiance);
            if class == 0 {
                // The basis is that of all functions: one set of receivers says what it loses.
                let lost = self.lost_by_basis(&measured.of.subset, (materials, &near), irradiance);
                of_materials.iter_mut().zip(lost).for_each(|(errors, lost)| errors[BASIS] = lost);
            }
            let stages = self.stages(measured, light, (&details, &stored));
            for ((all, material), near) in of_materials.iter_mut().zip(materials).zip(near) {
                let found = stages.errors(material, near, &measured.of.subset.points);
                *all = std::array::from_fn(|i| all[i].beside(found[i]));
            }
        }
        of_materials.into_iter().reduce(|a, b| std::array::from_fn(|i| a[i].max(b[i]))).unwrap_or_default()
    }

    /// Error of the basis at some receivers in each material.
    fn lost_by_basis(
        &self,
        subset: &Subset,
        (materials, near): (&[Projected], &[Vec<DVec3>]),
        irradiance: &[DVec3],
    ) -> Vec<VertexError> {
        let Work { scene, ordered, table, .. } = self.work;
        let (merged, light) = (ordered.merged.sources(), ordered.merged.light(irradiance));
        let by_basis = all_pairs(merged, table, &subset.receivers, &[&light]).concat();
        let lengths = (ordered.split_mm, scene.mesh.diagonal_mm());
        let of_material = |(material, near): (&Projected, &Vec<DVec3>)| {
            let far = far_all_pairs(merged, &material.dipoles, lengths, &subset.receivers, &light);
            let truth: Vec<DVec3> = near.iter().zip(&far).map(|(n, f)| *n + *f).collect();
            subset.points.error(&material.add(&by_basis, near.clone()), &truth)
        };
        materials.iter().zip(near).map(of_material).collect()
    }

    fn stages(&self, measured: &Measured, light: usize, (details, stored): (&LightDetails, &FarSums)) -> AfterStages {
        let Measured { of: OfFunctions { subset, functions }, everything, kept, exact, .. } = measured;
        let (terms, exact) = (self.work.basis.terms(), exact[light].clone());
        let of_rows = |mut values: FarRadiosity| {
            for (values, exact) in values.iter_mut().zip(&exact) {
                (0..terms).filter(|k| functions >> k & 1 == 0).for_each(|k| values[k] = exact[k]);
            }
            values
        };
        let quantised = |&row: &u32| (0..terms).map(|k| stored.value(row as usize, k).x).collect();
        AfterStages {
            integrated: of_rows(subset.rebuilt(everything, terms, details)),
            truncated: of_rows(subset.rebuilt(kept, terms, details)),
            quantised: of_rows(subset.points.indices.iter().map(quantised).collect()),
            exact,
        }
    }
}

impl AfterStages {
    /// Errors in one material, each stage as if all before it were exact; 0 for the basis.
    fn errors(&self, material: &Projected, near: Vec<DVec3>, points: &ProbePoints) -> Errors {
        let combined = |values: &FarRadiosity| material.add(values, vec![DVec3::ZERO; near.len()]);
        let truth = material.add(&self.exact, near.clone());
        let against = |before: &[DVec3], after: &[DVec3]| {
            let values: Vec<DVec3> = (0..truth.len()).map(|i| truth[i] + (after[i] - before[i])).collect();
            points.error(&values, &truth)
        };
        let [exact, integrated, truncated, quantised] =
            [&self.exact, &self.integrated, &self.truncated, &self.quantised].map(combined);
        [
            against(&exact, &integrated),
            VertexError::default(),
            against(&integrated, &truncated),
            against(&truncated, &quantised),
        ]
    }
}
