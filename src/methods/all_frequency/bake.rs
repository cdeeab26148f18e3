//! What `all_frequency` precomputes: transport of the light from all directions to every vertex, in the basis that was asked for.

use translux_format::distant_transport::DistantTransport;

use super::RAYS;
use super::plan::{Basis, MOST_ORDER, Plan};
use super::{bake_harmonics, bake_rows, bake_single};
use crate::compress::ledger::Ledger;
use crate::error::{Error, Result};
use crate::evaluate::{AssetParts, BakeSettings};
use crate::geometry::samples::Samples;
use crate::light::{Light, LightKind};
use crate::math::statistics::VertexError;
use crate::methods::inter_reflection;
use crate::methods::sampling::{self, Density};
use crate::methods::stage::Stage;
use crate::progress::Progress;
use crate::transport::gather::NearField;
use crate::transport::many_lights::{IrradianceRows, ManyLights};
use crate::transport::scene::Scene;

/// Shadow boundaries stay well inside the kernel.
const DENSITY: Density = Density { spacing: 0.35, least: 1 << 16, most: 1 << 18 };

/// The error that the density is made for.
const DENSITY_RMS: f64 = 0.02;

/// Share of the asked error for the hierarchy.
const HIERARCHY: f64 = 0.1;

/// Suns that choices look at.
const TUNING: usize = 20;

/// With half of the energy in a sun, twice the asked error is allowed: a sun alone may be off by four times as much. Suns that no
/// choice saw fare up to 1.6 times worse than those that choices look at.
pub(super) const SUN: f64 = 2.5;

/// Samples of a bake.
fn count(scene: &Scene, settings: &BakeSettings) -> usize {
    DENSITY.count(scene, settings, (DENSITY_RMS / settings.max_rms).sqrt().max(1.0))
}

pub(super) fn memory(scene: &Scene, settings: &BakeSettings) -> u64 {
    let Ok(plan) = Plan::new(&settings.values) else { return sampling::memory(count(scene, settings), scene) };
    let (samples, vertices) = (count(scene, settings) as u64, scene.mesh.local_mm.len() as u64);
    let own = match plan.basis {
        // Rows of samples, of nodes (half as many) with their copy, and of vertices.
        Basis::Haar => samples * 2 * bake_rows::of_sample(&plan) as u64 * 6 + vertices * plan.row as u64 * 5,
        // Irradiance and flux of every sample; radiosities of each reference point, twice, and their columns.
        Basis::Harmonics => {
            let functions = plan.order.unwrap_or(MOST_ORDER).pow(2) as u64;
            samples * functions * 4 * 3 + (vertices / 2 + 256) * functions * 3 * 4 * 3
        }
    };
    let outside = inter_reflection::memory(scene, samples as usize, &settings.values, &RAYS);
    sampling::memory(samples as usize, scene) + own + outside
}

/// What is precomputed, and what it was computed with.
pub(super) struct Work<'a, 'b> {
    pub(super) stage: &'a Stage<'a>,
    pub(super) transfer: &'a ManyLights<'b>,
    pub(super) plan: &'a Plan,
    pub(super) max_rms: f64,
    /// Suns that choices look at.
    pub(super) suns: &'a [Light],
    /// Lights that no choice saw.
    pub(super) unseen: Unseen,
}

/// Lights that errors are measured under.
pub(super) struct Unseen {
    pub(super) environments: Vec<Light>,
    pub(super) suns: Vec<Light>,
}

impl Unseen {
    fn new(lights: &[Light]) -> Self {
        let of = |kinds: &[LightKind]| lights.iter().filter(|l| kinds.contains(&l.kind())).cloned().collect();
        Self { environments: of(&[LightKind::Environment, LightKind::Constant]), suns: of(&[LightKind::Directional]) }
    }
}

pub(super) fn bake(scene: &Scene, settings: &BakeSettings, plan: &Plan, progress: &dyn Progress) -> Result<AssetParts> {
    with_work((scene, settings, plan), progress, |work, rows, mut ledger| {
        let mut file = DistantTransport { samples: work.stage.samples.len() as u32, ..Default::default() };
        match plan.basis {
            Basis::Haar => file.rows = Some(bake_rows::rows(work, &mut ledger, progress)?),
            Basis::Harmonics => file.harmonics = Some(bake_harmonics::harmonics(work, rows, &mut ledger, progress)?),
        }
        let order = file.harmonics.as_ref().map(|h| h.order as usize);
        file.single = bake_single::single(work, order, &mut ledger, progress)?;
        let sections = file.to_sections().map_err(|e| Error::runtime(format!("asset: {e}")))?;
        let samples =
            Samples { facets: Vec::new(), patch_offsets: vec![0], part_offsets: vec![0; scene.parts.parts.len() + 1] };
        Ok(AssetParts { samples, ledger, sections })
    })
}

/// Calls `make` with everything ready, the samples under the suns that choices look at, and a ledger that has the hierarchy.
pub(super) fn with_work<T>(
    (scene, settings, plan): (&Scene, &BakeSettings, &Plan),
    progress: &dyn Progress,
    make: impl FnOnce(&Work, &IrradianceRows, Ledger) -> Result<T>,
) -> Result<T> {
    progress.start("samples", 0);
    let stage = Stage::new(scene, count(scene, settings));
    progress.finish();
    stage.with_transfer(NearField::for_error(settings.max_rms), |mut transfer| {
        let suns = directional(&settings.probes.tuning, TUNING);
        progress.start("tuning", suns.len() as u64);
        let rows = stage.irradiance(&suns)?;
        let hierarchy = transfer.tune(HIERARCHY * settings.max_rms, &rows);
        progress.finish();
        let mut ledger = Ledger::default();
        ledger.add("hierarchy", hierarchy, "against all pairs, on vertices that no tuning saw");
        let work = Work {
            stage: &stage,
            transfer: &transfer,
            plan,
            max_rms: settings.max_rms,
            suns: &suns,
            unseen: Unseen::new(&settings.probes.unseen),
        };
        make(&work, &rows, ledger)
    })
}

/// Some directional lights spread over all.
fn directional(lights: &[Light], count: usize) -> Vec<Light> {
    let all: Vec<&Light> = lights.iter().filter(|l| l.kind() == LightKind::Directional).collect();
    all.iter().step_by(all.len().div_ceil(count).max(1)).map(|l| (*l).clone()).collect()
}

/// What is known of the error under suns, in words.
pub(super) fn under_suns(error: VertexError) -> String {
    let percent = 100.0 * error.rms;
    format!("{:.2} % with half of the energy in a sun, {percent:.2} % under a sun alone", 0.5 * percent)
}
