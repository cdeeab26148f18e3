//! Shared by bakes of light from far away: samples, a tuned hierarchy, the probe lights of choices and of errors.

use glam::DVec3;
use translux_format::RawSection;

use super::settings::{Distant, KINDS, Single};
use crate::compress::ledger::Ledger;
use crate::error::{Error, Result};
use crate::evaluate::stage_cache::Key;
use crate::evaluate::stages::{of_kinds, spread, worst};
use crate::evaluate::{BakeSettings, StageCache};
use crate::forms::sampled_scene::SampledScene;
use crate::light::{Light, LightKind};
use crate::math::statistics::VertexError;
use crate::medium::profile::Orders;
use crate::progress::Progress;
use crate::scene::Scene;
use crate::transport::gather::Scheme;
use crate::transport::many_lights::{IrradianceRows, ManyLights};
use crate::transport::near_rule::NearField;

/// Share of the asked error for the hierarchy.
const HIERARCHY: f64 = 0.1;

/// Suns that choices look at.
const TUNING: usize = 20;

/// Suns that no choice saw fare up to so many times worse than those that choices look at.
const UNSEEN: f64 = 1.6;

/// Where environments are asked for, twice the asked error is allowed with half of the energy in a sun: a sun alone may be off by four
/// times as much. Where suns are and environments are not, a sun alone keeps the asked error.
const SUN_OF_ENVIRONMENT: f64 = 4.0;

/// Turns of the edge-on suns that choices look at, about the normal of the largest flat area.
pub(crate) const TUNING_TURNS: [f64; 2] = [0.0, 0.31];

/// Samples, hierarchy, settings and probe lights of a bake.
pub(crate) struct Work<'a, 'b> {
    pub(crate) sampled: &'a SampledScene<'a>,
    pub(crate) transfer: &'a ManyLights<'b>,
    pub(crate) plan: &'a Distant,
    pub(crate) max_rms: f64,
    /// Error that a sun alone may have over the asked one, under the suns that choices look at.
    pub(crate) sun: f64,
    /// Whether the asset is asked for suns, which its ledger then tells of.
    for_suns: bool,
    /// Suns that choices look at, two of them edge-on where suns are asked for.
    pub(crate) suns: &'a [Light],
    /// Lights that no choice saw.
    pub(crate) unseen: Unseen,
    /// Sections that say how kernels are calibrated.
    pub(crate) calibration: Vec<RawSection>,
    /// Where processes that share the bake leave their blocks.
    pub(crate) cache: &'a StageCache,
}

impl Work<'_, '_> {
    /// The lights that errors are measured under, in words.
    pub(crate) fn judged_by(&self) -> &'static str {
        match (self.unseen.environments.is_empty(), self.for_suns) {
            (true, _) => "suns",
            (false, true) => "environments and suns",
            (false, false) => "environments",
        }
    }

    /// Tells what everything up to the tuned hierarchy depends on.
    pub(crate) fn tell(&self, key: &mut Key) {
        let Self { sampled, plan, max_rms, for_suns, .. } = self;
        key.text(&format!("{plan:?} {max_rms} {for_suns} {:?}", self.transfer.scheme())).samples(&sampled.samples);
    }

    /// Lights that errors are measured under: environments, then suns.
    pub(crate) fn judges(&self) -> impl Iterator<Item = &Light> {
        self.unseen.environments.iter().chain(&self.unseen.suns)
    }

    /// Error that each stage adds, the worst of the environments that no choice saw, and of the suns where these are asked for; and of
    /// all stages together, the worst of the suns. `values` hands over radiosity before and after the stages, given a light of
    /// [`Self::judges`] and its index.
    pub(crate) fn errors<'l, V, const N: usize>(
        &'l self,
        progress: &dyn Progress,
        values: impl Fn(usize, &'l Light) -> Result<V>,
        by_stage: impl Fn(&V) -> Result<[VertexError; N]>,
        together: impl Fn(&V) -> VertexError,
    ) -> Result<([VertexError; N], VertexError)> {
        let Unseen { environments, suns } = &self.unseen;
        progress.start("errors", (environments.len() + suns.len()) as u64);
        let under = |(index, light)| {
            let values = values(index, light);
            progress.advance(1);
            values
        };
        let mut errors = worst(environments.iter().enumerate(), |light| by_stage(&under(light)?))?;
        let mut alone = VertexError::default();
        for (index, light) in suns.iter().enumerate() {
            let values = under((environments.len() + index, light))?;
            alone = alone.max(together(&values));
            if self.for_suns {
                errors.iter_mut().zip(by_stage(&values)?).for_each(|(worst, error)| *worst = worst.max(error));
            }
        }
        progress.finish();
        Ok((errors, alone))
    }
}

impl Work<'_, '_> {
    /// Enters the error of the samples under suns that no choice saw, where these are asked for, else under environments.
    pub(crate) fn enter_sampling(&self, ledger: &mut Ledger, progress: &dyn Progress) -> Result<()> {
        let Unseen { environments, suns } = &self.unseen;
        let lights = if self.for_suns { suns } else { environments };
        self.sampled.enter_sampling(lights, NearField::for_error(self.max_rms), ledger, progress)
    }

    /// Enters the error under a sun alone, where environments may be one.
    pub(crate) fn enter_sun(&self, ledger: &mut Ledger, error: VertexError) {
        if !self.unseen.environments.is_empty() && !self.unseen.suns.is_empty() {
            ledger.add_sun_alone(error);
        }
    }
}

/// Lights that errors are measured under.
pub(crate) struct Unseen {
    pub(crate) environments: Vec<Light>,
    pub(crate) suns: Vec<Light>,
}

impl Unseen {
    /// Of the kinds asked for; suns beside environments, which have them, and environments where nothing is asked for.
    fn new(settings: &BakeSettings) -> Self {
        let lights = &settings.probes.unseen;
        let environments = match for_suns_alone(settings) {
            true => Vec::new(),
            false => of_kinds(lights, &[LightKind::Environment, LightKind::Constant]),
        };
        Self { environments, suns: of_kinds(lights, &[LightKind::Directional]) }
    }
}

/// Whether suns are all that is asked for, of light from far away.
fn for_suns_alone(settings: &BakeSettings) -> bool {
    let soft = [LightKind::Environment, LightKind::Constant];
    settings.is_for(LightKind::Directional) && !soft.iter().any(|kind| settings.is_for(*kind))
}

/// Suns along the largest flat area.
pub(crate) fn edge_on(scene: &Scene, turns: [f64; 2]) -> impl Iterator<Item = Light> {
    turns.map(|turn| Light::Directional { from: scene.grazing(turn), irradiance: DVec3::ONE }).into_iter()
}

/// Calls `make` with everything ready, the samples under the suns that choices look at, and a ledger that has the hierarchy.
pub(crate) fn with_work<T>(
    (scene, settings, plan): (&Scene, &BakeSettings, &Distant),
    progress: &dyn Progress,
    make: impl FnOnce(&Work, &IrradianceRows, Ledger) -> Result<T>,
) -> Result<T> {
    progress.start("samples", 0);
    // Samples need not be fine enough for lamps nearby.
    let for_lights = settings.for_lights.iter().copied().filter(|kind| KINDS.contains(kind)).collect();
    let sampled = SampledScene::with_density(scene, plan.density, &BakeSettings { for_lights, ..settings.clone() })?;
    // Where the first scattering has a stage of its own the kernels hold the others.
    let orders = Orders::beside_first(plan.single != Single::Off);
    let (sampled, calibration) = sampled.with_model(settings, orders, progress)?;
    progress.finish();
    sampled.with_transfer(NearField::for_error(settings.max_rms), |mut transfer| {
        let suns = of_kinds(&settings.probes.tuning, &[LightKind::Directional]);
        let mut suns: Vec<Light> = spread(&suns, TUNING).cloned().collect();
        let for_suns = settings.is_for(LightKind::Directional);
        if for_suns && !suns.is_empty() {
            suns.extend(edge_on(scene, TUNING_TURNS));
        }
        let asked = |key: &mut Key| {
            key.text(&format!("{plan:?} {} {for_suns}", settings.max_rms)).samples(&sampled.samples);
        };
        let tuned = settings.cache.common("tuning", asked, || {
            progress.start("tuning", suns.len() as u64);
            let rows = sampled.irradiance(&suns)?;
            let hierarchy = transfer.tune(HIERARCHY * settings.max_rms, &rows);
            progress.finish();
            Ok((rows, hierarchy, transfer.scheme()))
        })?;
        let (rows, hierarchy, scheme): (IrradianceRows, VertexError, Scheme) = tuned;
        let transfer = transfer.with_scheme(scheme);
        let mut ledger = Ledger::default();
        ledger.add("hierarchy", hierarchy, "against all pairs, on vertices that no tuning saw");
        let work = Work {
            sampled: &sampled,
            transfer: &transfer,
            plan,
            max_rms: settings.max_rms,
            sun: if for_suns_alone(settings) { 1.0 } else { SUN_OF_ENVIRONMENT } / UNSEEN,
            for_suns,
            suns: &suns,
            unseen: Unseen::new(settings),
            calibration,
            cache: &settings.cache,
        };
        make(&work, &rows, ledger)
    })
}

/// The error under suns, in words.
pub(crate) fn under_suns(error: VertexError) -> String {
    let percent = 100.0 * error.rms;
    format!("{:.2} % with half of the energy in a sun, {percent:.2} % under a sun alone", 0.5 * percent)
}

/// Refuses lights that do not come from far away.
pub(crate) fn far_away(light: &Light) -> Result<()> {
    if KINDS.contains(&light.kind()) {
        return Ok(());
    }
    Err(Error::unsupported(
        "this asset has light from far away only (environment, constant, directional): bake it with --method \
         quantized_lights or editable for point and area lights",
    ))
}
