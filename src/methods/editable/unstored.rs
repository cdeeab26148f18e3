//! `editable` without stored transport: samples, how finely kernels have to be resolved, and rows for environments. Any radial
//! profile is summed over them at run time, at any size of the object.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::DVec3;
use translux_format::FormatError;
use translux_format::multilevel::MultilevelSummation;

use super::bake::Stage;
use super::environment;
use super::plan::Plan;
use super::{BASIS, FAR_LEVELS, FAR_SPACING, SPLIT, TERMS, TRUNCATION};
use crate::asset::{Asset, Provenance};
use crate::compress::ledger::Ledger;
use crate::error::{Error, Result};
use crate::evaluate::environment::StoredRows;
use crate::evaluate::sampled::{Bound, Far, Plan as SampledPlan, SampledEvaluator};
use crate::evaluate::sampling_error::receiver_areas;
use crate::evaluate::{AssetParts, BakeSettings, Evaluator, Key};
use crate::light::{Light, LightKind};
use crate::medium::material::{OpticalProperties, preset};
use crate::progress::Progress;
use crate::transport::gather::MediumKernel;
use crate::transport::irradiance::Pieces;
use crate::transport::multilevel::{NearRule, Quality};
use crate::transport::scene::{Medium, Scene};

/// Lights that the resolution of kernels is chosen by.
const LIGHTS: usize = 3;

/// Published materials that it is chosen by beside the scene's own: what nets and near samples err by is largest in these.
const MATERIALS: [&str; 3] = ["ketchup", "chicken1", "spectralon"];

/// Share of the asked error that the transfer may take. What is left is for sampling and for rows.
const TRANSFER_SHARE: f64 = 0.8;

/// Error of the hierarchy where nets are not used (a device, other receivers), over the asked one.
const HIERARCHY_SHARE: f64 = 0.3;

/// Receivers of a group.
const GROUP: usize = 16;

/// Bytes of a sample or a receiver while nets are made.
const BYTES_OF_A_POINT: u64 = 1200;

/// Memory of nets.
pub(super) fn memory(samples: usize, scene: &Scene) -> u64 {
    (samples + scene.mesh.local_mm.len()) as u64 * BYTES_OF_A_POINT
}

/// Refuses values of keys that only stored transport has.
pub(super) fn check(values: &BTreeMap<String, String>) -> Result<()> {
    for Key { name, default, .. } in [BASIS, TERMS, SPLIT, FAR_SPACING, FAR_LEVELS, TRUNCATION] {
        if let Some(value) = values.get(name).filter(|value| value.as_str() != default) {
            return Err(Error::command_line(format!("--set {name}={value}: only with --set transport=stored")));
        }
    }
    Ok(())
}

/// Kernels of the scene's media, and of others in their place.
fn media(scene: &Scene) -> Vec<Vec<MediumKernel>> {
    let of = |properties: OpticalProperties| {
        let other = |medium: &Medium| MediumKernel::new(&Medium { properties, ..medium.clone() });
        scene.media.iter().map(other).collect()
    };
    let own = scene.media.iter().map(MediumKernel::new).collect();
    let others = MATERIALS.iter().filter_map(|name| preset(name)).map(|preset| of(preset.properties()));
    std::iter::once(own).chain(others).collect()
}

fn sampled_plan(plan: &Plan, max_rms: f64, quality: Quality) -> SampledPlan {
    let far = Far::Hierarchical { error: HIERARCHY_SHARE * max_rms, bound: Bound::SolidAngle };
    SampledPlan { sampling: plan.sampling, near: plan.near, far, group: GROUP, nets: Some(quality) }
}

pub(super) fn bake(
    (scene, stage): (&Scene, Stage),
    (settings, plan): (&BakeSettings, &Plan),
    progress: &dyn Progress,
) -> Result<AssetParts> {
    let probes = &settings.probes;
    progress.start("resolution", 0);
    let tuning: Vec<(Vec<DVec3>, Pieces)> = probes
        .tuning
        .iter()
        .step_by(probes.tuning.len().div_ceil(LIGHTS).max(1))
        .map(|light| stage.irradiance(scene, light, plan.sampling))
        .collect::<Result<_>>()?;
    let media = media(scene);
    let areas = receiver_areas(scene, &stage.receivers);
    let surface = stage.surface(scene);
    let error = TRANSFER_SHARE * settings.max_rms;
    let quality = Quality::tuned((&surface, &media), (&stage.receivers, &areas), &tuning, error);
    progress.finish();

    let fail = |e: FormatError| Error::runtime(format!("asset: {e}"));
    let Quality { error, spacing, softening, near: NearRule { facets_below, pieces_below } } = quality;
    let numbers = MultilevelSummation { error, spacing, softening, facets_below, pieces_below };
    let mut sections = numbers.to_sections().map_err(fail)?;
    let sharp = |light: &&Light| !matches!(light.kind(), LightKind::Environment | LightKind::Constant);
    let mut unseen: Vec<Light> = probes.unseen.iter().filter(sharp).cloned().collect();
    let mut ledger = Ledger::default();
    if !unseen.is_empty() {
        let asset = Asset {
            scene: scene.clone(),
            samples: stage.samples.clone(),
            provenance: Provenance::default(),
            ledger: Ledger::default(),
            sections: Vec::new(),
        };
        let mut evaluator = SampledEvaluator::new(Arc::new(asset), sampled_plan(plan, settings.max_rms, quality));
        evaluator.set_lights(vec![unseen.remove(0)], progress)?;
        ledger = evaluator.measured_error(&unseen, progress)?;
    }
    if settings.for_lights.contains(&LightKind::Environment) {
        let rows = environment::rows(&surface, plan, progress)?;
        environment::measure(scene, &stage, plan, &probes.unseen, &mut ledger, progress)?;
        sections.extend(rows.into_data().to_sections().map_err(fail)?);
    }
    Ok(AssetParts { samples: stage.samples, ledger, sections })
}

pub(super) fn open(asset: Arc<Asset>, plan: &Plan, max_rms: f64) -> Result<Box<dyn Evaluator>> {
    let numbers = MultilevelSummation::from_sections(&asset.sections).map_err(|e| Error::input(e.to_string()))?;
    let missing = || Error::input("an asset of `editable` without its resolution (section mls.num); bake it again");
    let MultilevelSummation { error, spacing, softening, facets_below, pieces_below } = numbers.ok_or_else(missing)?;
    let quality = Quality { error, spacing, softening, near: NearRule { facets_below, pieces_below } };
    let rows = StoredRows::of(&asset)?;
    let evaluator = SampledEvaluator::new(asset, sampled_plan(plan, max_rms, quality));
    Ok(Box::new(evaluator.with_rows(rows)))
}
