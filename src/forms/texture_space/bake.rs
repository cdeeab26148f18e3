//! Bake of `texture_space`: the atlas, and the number of samples that the asked error needs.

use glam::DVec3;
use translux_format::atlas;
use translux_format::texture_space::{self as stored, Numbers};

use super::map::welded;
use super::settings::TextureSpace;
use super::state::TextureSpaceEvaluator;
use crate::compress::ledger::Ledger;
use crate::error::Result;
use crate::evaluate::form::write_error;
use crate::evaluate::stages::{of_kinds, spread};
use crate::evaluate::{AssetParts, BakeSettings};
use crate::forms::sample_count::samples_for;
use crate::geometry::atlas::{Atlas, Report};
use crate::light::{Light, LightKind};
use crate::progress::{Progress, stage};
use crate::scene::Scene;

/// Numbers of samples that are tried, each twice the one before.
const LEAST_COUNT: u32 = 64;
pub(super) const MOST_COUNT: u32 = 1 << 14;

/// Samples at least of the exact sums that texels are measured by: they cost little, and are to err less than texels.
const LEAST_OF_TRUTH: usize = 1 << 14;

/// Share of the asked error for the samples; the texture has the rest.
pub(super) const OF_SAMPLES: f64 = 0.5;

/// Lights that the number of samples is chosen under.
const LIGHTS: usize = 3;

/// Texels along each edge unless more are asked for.
const LEAST_RESOLUTION: u32 = 256;
const MOST_RESOLUTION: u32 = 2048;

/// Share of the texture that the charts of an atlas cover, about.
const OCCUPANCY: f64 = 0.5;

/// Texels along each edge of the texture.
pub(super) fn resolution(form: &TextureSpace, scene: &Scene) -> u32 {
    let wanted = (form.density.count(scene, None) as f64 / OCCUPANCY).sqrt();
    // The nearest power of two.
    let below = (wanted * std::f64::consts::FRAC_1_SQRT_2) as u32;
    let auto = below.next_power_of_two().clamp(LEAST_RESOLUTION, MOST_RESOLUTION);
    form.resolution.unwrap_or(auto)
}

pub(super) fn bake(
    form: &TextureSpace,
    scene: &Scene,
    settings: &BakeSettings,
    progress: &dyn Progress,
) -> Result<AssetParts> {
    let resolution = resolution(form, scene);
    let (atlas, report) = stage(progress, "atlas", || Atlas::new(&scene.mesh, form.map, resolution))?;
    // Those that are asked for are texels, not the truth's.
    let of_truth = BakeSettings { samples: None, ..settings.clone() };
    let truth_samples = samples_for(scene, (form.density, form.rays(1)), &of_truth, &[])?;
    let asked = settings.samples.map(|count| count.clamp(1, u32::MAX as usize) as u32).or(form.count);
    let numbers = Numbers {
        resolution,
        count: asked.unwrap_or(LEAST_COUNT),
        truth_samples: truth_samples.clamp(LEAST_OF_TRUTH, u32::MAX as usize) as u32,
    };
    let in_file = atlas::Atlas { numbers: numbers_of(&report, resolution), corners: atlas.codes() };
    let mut evaluator = TextureSpaceEvaluator::new(form, scene, atlas, numbers)?;
    let kinds = form.sampling.kinds();
    let tuning = of_kinds(&settings.probes.tuning, kinds);
    if asked.is_none() && !tuning.is_empty() {
        stage(progress, "number of samples", || {
            let mut lights: Vec<_> = spread(&tuning, LIGHTS).cloned().collect();
            // Under a sky all of the surface is lit, and needs more samples than what a sun sees of it.
            let of_soft = |kind: &LightKind| kinds.contains(kind) && settings.is_for(*kind);
            if [LightKind::Constant, LightKind::Environment].iter().any(of_soft) {
                lights.push(Light::Constant { radiance: DVec3::ONE });
            }
            evaluator.choose_count(&lights, OF_SAMPLES * settings.max_rms, (LEAST_COUNT, MOST_COUNT))
        })?;
    }
    // One environment: nothing here is made for any of them.
    let mut environments = 0..1;
    let is_taken = |light: &Light| light.kind() != LightKind::Environment || environments.next().is_some();
    let unseen: Vec<Light> = of_kinds(&settings.probes.unseen, kinds).into_iter().filter(is_taken).collect();
    let mut ledger = Ledger::default();
    if !unseen.is_empty() {
        let sets: Vec<_> = unseen.into_iter().map(|light| vec![light]).collect();
        ledger = stage(progress, "error", || evaluator.errors(&sets, "the worst of the probe lights"))?;
    }
    let numbers = evaluator.numbers;
    let mut sections = in_file.to_sections(&welded(scene)).map_err(write_error)?;
    sections.push(stored::to_section(&numbers).map_err(write_error)?);
    Ok(AssetParts::without_samples(scene, ledger, sections))
}

/// What the asset says of its atlas.
fn numbers_of(report: &Report, page: u32) -> atlas::Numbers {
    let Report { own, charts, occupancy, overlap, stretch, area_range, smallest, flat } = *report;
    atlas::Numbers { charts, own, page, occupancy, overlap, stretch, area_range, smallest, flat }
}
