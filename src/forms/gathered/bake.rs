//! Bake of `gathered`: samples; the resolution of kernels where sums go over nets; rows for environments.

use std::sync::Arc;

use glam::DVec3;
use translux_format::multilevel::MultilevelSummation;
use translux_format::{RawSection, Tag, calibration};

use super::forecast::forecast;
use super::lit_samples::GatheredEvaluator;
use super::model;
use super::settings::{Far, Gathered};
use crate::asset::Asset;
use crate::compress::ledger::Ledger;
use crate::error::{Error, Result};
use crate::evaluate::form::{read_error, write_error};
use crate::evaluate::inter_reflection::{self, Outside};
use crate::evaluate::memory;
use crate::evaluate::single_scattering::Traced;
use crate::evaluate::stage_cache::Key;
use crate::evaluate::stages::{of_kinds, spread};
use crate::evaluate::{
    AssetParts, BakeSettings, Capabilities, Evaluator, Forecast, Form, MaterialEdit, Model, Opener, ProfileEdit,
};
use crate::forms::density;
use crate::forms::environment_rows::{self, EnvironmentRows, StoredRows};
use crate::forms::sample_count::{UNLIKE_MATERIALS, kernels_in, samples_for};
use crate::geometry::bvh::Bvh;
use crate::geometry::samples::{self, Samples};
use crate::light::{Light, LightKind};
use crate::math::statistics::VertexError;
use crate::medium::profile::Orders;
use crate::progress::{Progress, Silent};
use crate::scene::Scene;
use crate::transport::calibration::{Calibrated, Walks};
use crate::transport::irradiance::Pieces;
use crate::transport::kernel::medium::{KernelsOfParts, MediumKernel};
use crate::transport::moved_entry;
use crate::transport::multilevel::{Quality, SurfaceNets};
use crate::transport::near_rule::NearRule;
use crate::transport::receivers::Receivers;
use crate::transport::surface::Surface;

/// Lights that the resolution of kernels is chosen by.
const LIGHTS: usize = 3;

/// Stage of assets that hold no transport, whose error is 0.
const NOTHING_STORED: &str = "nothing stored";

/// Bytes of a sample or a receiver while nets are made.
const BYTES_OF_A_POINT: u64 = 1200;

impl Form for Gathered {
    const NAME: &'static str = "gathered";

    fn validate(&self) -> Result<()> {
        self.density.validate()?;
        self.sampling.validate()?;
        self.near.validate()?;
        if !(1..=4096).contains(&self.group) {
            return Err(Error::input(format!("{} receivers in a group, not 1 to 4096", self.group)));
        }
        let share = |value: f64| value.is_finite() && value > 0.0 && value <= 1.0;
        let hierarchy = match self.far {
            Far::AllPairs => None,
            Far::Hierarchical { error, .. } => Some(error),
        };
        if let Some(error) = hierarchy.into_iter().chain(self.nets).find(|error| !share(*error)) {
            return Err(Error::input(format!("an asked error of {error}, not above 0 and at most 1")));
        }
        self.environment.iter().try_for_each(EnvironmentRows::validate)?;
        self.single.iter().try_for_each(Traced::validate)?;
        self.outside.iter().try_for_each(Outside::validate)
    }

    fn holds_transport(&self) -> bool {
        false
    }

    fn serves_points(&self) -> bool {
        true
    }

    fn serves(&self, _: Model) -> bool {
        true
    }

    fn divides(&self) -> bool {
        self.environment.is_some()
    }

    fn edits(&self, has: &dyn Fn(Tag) -> bool) -> Option<Capabilities> {
        let source_fields = environment_rows::source_fields(has);
        let profile = if has(calibration::tags::NUMBERS) { ProfileEdit::Calibrated } else { ProfileEdit::Any };
        Some(Capabilities { material: MaterialEdit::Any, profile, source_fields })
    }

    fn run_memory(&self, asset: &Asset) -> u64 {
        let nets = self.nets.map_or(0, |_| (asset.samples.len() + asset.scene.mesh.local_mm.len()) as u64);
        let is_calibrated = asset.sections.iter().any(|section| section.tag == calibration::tags::NUMBERS);
        let moved = if is_calibrated { moved_entry::memory(asset.samples.len()) } else { 0 };
        memory::of_evaluator(asset) + nets * BYTES_OF_A_POINT + moved
    }

    fn bake_memory(&self, scene: &Scene, settings: &BakeSettings) -> u64 {
        let samples = self.density.count(scene, settings.samples);
        let nets = self.nets.map_or(0, |_| (samples + scene.mesh.local_mm.len()) as u64 * BYTES_OF_A_POINT);
        let rows =
            self.environment.filter(|_| settings.is_for(LightKind::Environment)).map_or(0, |e| e.memory(samples));
        density::memory(samples, scene, settings.model)
            + nets
            + rows
            + inter_reflection::memory(self.outside, samples, scene)
    }

    fn forecast(&self, scene: &Scene, settings: &BakeSettings) -> Option<Forecast> {
        forecast(self, scene, settings)
    }

    fn bake(&self, scene: &Scene, settings: &BakeSettings, progress: &dyn Progress) -> Result<AssetParts> {
        progress.start("samples", 0);
        // Nets are made for any material.
        let materials = if self.nets.is_some() { UNLIKE_MATERIALS.as_slice() } else { &[] };
        let count = match self.far {
            // The truth has them all.
            Far::AllPairs => self.density.count(scene, settings.samples),
            Far::Hierarchical { .. } => samples_for(scene, (self.density, self.sampling), settings, materials)?,
        };
        let samples = Samples::new(&scene.mesh, &scene.parts, count);
        let environment = self.environment.filter(|_| settings.is_for(LightKind::Environment));
        // Where the first scattering has a stage of its own the kernels hold the others.
        let orders = Orders::beside_first(self.single.is_some());
        let (calibrated, calibration) = match settings.model {
            Model::Dipole => (None, Vec::new()),
            Model::Calibrated(walks) => {
                let bvh = Bvh::new(&scene.mesh);
                let (calibrated, sections) =
                    model::bake(scene, &bvh, (Walks { orders, ..walks }, &settings.kernels), progress)?;
                (Some(calibrated), sections)
            }
        };
        if self.nets.is_none() && environment.is_none() {
            progress.finish();
            let mut ledger = Ledger::default();
            ledger.add(NOTHING_STORED, VertexError::default(), "samples alone: errors are those of sums at run time");
            return Ok(AssetParts { samples, ledger, sections: calibration, opener: None });
        }
        // Neighbours lie together, which rows in blocks rest on.
        let samples = samples.in_tree_order(&scene.mesh, &scene.parts);
        let (bvh, patches) = rayon::join(|| Bvh::new(&scene.mesh), || samples::patches(&scene.mesh, &samples));
        let surface = Surface { domain: scene.domain(), bvh: &bvh, samples: &samples, patches: &patches };
        let receivers = Receivers::new(&scene.mesh, &scene.parts, self.group as usize);
        progress.finish();

        let (mut ledger, mut sections) = (Ledger::default(), calibration);
        let mut measured_with = None;
        if let Some(error) = self.nets {
            let kernels = kernels(scene, calibrated.as_ref(), orders);
            let asked = (error, settings.probes.tuning.as_slice());
            let key = |key: &mut Key| {
                key.text(&format!("{self:?} {}", settings.max_rms)).samples(&samples);
            };
            let mut nets = None;
            let quality = settings.cache.common("nets", key, || {
                let made = resolution(self, &surface, (&receivers, &kernels), asked, progress)?;
                Ok(nets.insert(made).quality())
            })?;
            sections.extend(numbers(quality).to_sections().map_err(write_error)?);
            ledger = settings.cache.common("errors of nets", key, || {
                let Some((ledger, evaluator)) =
                    measured(self, (scene, &samples, &sections), (quality, nets), &settings.probes.unseen, progress)?
                else {
                    return Ok(Ledger::default());
                };
                measured_with = Some(evaluator);
                Ok(ledger)
            })?;
        }
        if let Some(rows) = environment {
            environment_rows::ahead(&surface, (rows, self.sampling), settings, progress)?;
            settings.cache.gather()?;
            let (place, how) = ((&surface, &receivers), (rows, self.sampling, self.near));
            sections.extend(environment_rows::bake(place, how, settings, &mut ledger, progress)?);
        }
        let form = *self;
        let opener = measured_with.map(|evaluator| {
            let open = move |asset| form.finished(evaluator.of_asset(asset)).map(|e| Box::new(e) as Box<dyn Evaluator>);
            Box::new(open) as Opener
        });
        Ok(AssetParts { samples, ledger, sections, opener })
    }

    fn open(&self, asset: Arc<Asset>) -> Result<Box<dyn Evaluator>> {
        let stored = |_: f64| {
            let missing = || Error::input("an asset without its resolution (section mls.num); bake it again");
            let numbers = MultilevelSummation::from_sections(&asset.sections).map_err(read_error)?;
            let MultilevelSummation { error, spacing, softening, facets_below, pieces_below } =
                numbers.ok_or_else(missing)?;
            Ok(Quality { error, spacing, softening, near: NearRule { facets_below, pieces_below } })
        };
        let quality = self.nets.map(stored).transpose()?;
        let evaluator = GatheredEvaluator::new(asset, self.gathering(quality)).with_model()?;
        Ok(Box::new(self.finished(evaluator)?))
    }
}

impl Gathered {
    /// The evaluator with what lies beside its sums.
    fn finished(&self, evaluator: GatheredEvaluator) -> Result<GatheredEvaluator> {
        let rows = self.environment.map_or(Ok(None), |_| StoredRows::of(&evaluator.asset))?;
        let evaluator = evaluator.with_single(self.single)?;
        Ok(GatheredEvaluator { rows, outside: self.outside, ..evaluator })
    }
}

/// Kernels of the scene, and of each published material in the place of its media.
fn kernels(scene: &Scene, calibrated: Option<&Calibrated>, orders: Orders) -> Vec<KernelsOfParts> {
    let of_part: Vec<Option<u32>> = scene.parts.parts.iter().map(|part| part.medium).collect();
    let own = match calibrated {
        Some(calibrated) => calibrated.kernels.clone(),
        None => (MediumKernel::of_orders(&scene.media, orders, scene.mesh.diagonal_mm()), of_part.clone()),
    };
    let others = kernels_in(&scene.media, &UNLIKE_MATERIALS).map(|kernels| (kernels, of_part.clone()));
    std::iter::once(own).chain(others).collect()
}

/// The nets that keep an asked error in the media of the scene and in the hardest published ones.
fn resolution(
    form: &Gathered,
    surface: &Surface,
    (receivers, kernels): (&Receivers, &[KernelsOfParts]),
    (error, lights): (f64, &[Light]),
    progress: &dyn Progress,
) -> Result<SurfaceNets> {
    progress.start("resolution", 0);
    let domain = surface.domain;
    let lit = |light: &Light| environment_rows::sampled(surface, std::slice::from_ref(light), form.sampling, &Silent);
    let tuning: Vec<(Vec<DVec3>, Pieces)> = spread(lights, LIGHTS).map(lit).collect::<Result<_>>()?;
    let areas = receivers.areas_mm2(domain.mesh);
    let nets = SurfaceNets::tuned((surface, kernels), (receivers, &areas), &tuning, error);
    progress.finish();
    Ok(nets)
}

/// Errors of nets of a quality under light that is not in rows, if there is any, and what has measured them; with nets of these samples and receivers,
/// if they have been made.
fn measured(
    form: &Gathered,
    (scene, samples, sections): (&Scene, &Samples, &[RawSection]),
    (quality, nets): (Quality, Option<SurfaceNets>),
    unseen: &[Light],
    progress: &dyn Progress,
) -> Result<Option<(Ledger, GatheredEvaluator)>> {
    let mut unseen = of_kinds(unseen, &environment_rows::BY_RAYS);
    if unseen.is_empty() {
        return Ok(None);
    }
    let asset = Asset::of_scene(scene.clone(), samples.clone(), sections.to_vec());
    let orders = Orders::beside_first(form.single.is_some());
    let evaluator = GatheredEvaluator::new(Arc::new(asset), form.gathering(Some(quality)));
    let mut evaluator = evaluator.with_model()?.of_orders(orders)?;
    if let Some(nets) = nets {
        evaluator.take_nets(nets);
    }
    evaluator.set_lights(vec![unseen.remove(0)], progress)?;
    let ledger = evaluator.measured_error(&unseen, progress)?;
    Ok(Some((ledger, evaluator)))
}

fn numbers(quality: Quality) -> MultilevelSummation {
    let Quality { error, spacing, softening, near: NearRule { facets_below, pieces_below } } = quality;
    MultilevelSummation { error, spacing, softening, facets_below, pieces_below }
}
