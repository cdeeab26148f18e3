//! Settings of a bake as typed and as resolved, and the bake, preceded by a check of its memory.

use std::collections::BTreeSet;

use clap::Args;

use super::console::{Console, in_range};
use crate::asset::Asset;
use crate::error::{Error, Result};
use crate::evaluate::keys::share;
use crate::evaluate::{BakeSettings, Model, Probes, Recipe};
use crate::forms::gathered::uncalibrated;
use crate::import::Imported;
use crate::light::LightKind;
use crate::measure::probes::for_bake;
use crate::measure::sample_spacing::too_far_apart;
use crate::scene::Scene;
use crate::transport::calibration::{PHOTONS, Walks};

/// Options of a bake beside its method.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Method")]
pub(super) struct BakeOptions {
    /// Surface samples (default: as many as the mean free path and the far field need)
    #[arg(long, value_name = "N")]
    pub(super) samples: Option<usize>,
    /// Relative error to reach, such as 1% or 0.01 (default: the method's, see `translux methods`)
    #[arg(long, value_name = "E")]
    pub(super) max_rms: Option<String>,
    /// Kinds of light to precompute for, separated by commas: constant, directional, point, area, environment, or all.
    /// Other kinds still work where the method can sample them at run time, only slower
    #[arg(long, value_name = "KINDS", default_value = "all")]
    pub(super) for_lights: String,
    /// A key of the method (see `translux methods`); repeatable
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub(super) set: Vec<String>,
}

impl BakeOptions {
    /// The recipe of a method with all settings resolved.
    pub(super) fn resolve(&self, method: &str, model: Model, console: &Console) -> Result<Recipe> {
        let pairs: Vec<(String, String)> = self
            .set
            .iter()
            .map(|text| match text.split_once('=') {
                Some((key, value)) if !key.is_empty() => Ok((key.to_owned(), value.to_owned())),
                _ => Err(Error::command_line(format!("--set {text}: key=value is needed"))),
            })
            .collect::<Result<_>>()?;
        let samples = self.samples.map(|samples| in_range("--samples", samples, 1..=1 << 28)).transpose()?;
        let method = console.registry.method(method)?;
        let mut settings = BakeSettings::new(method.default_max_rms());
        settings.samples = samples;
        settings.for_lights = light_kinds(&self.for_lights)?;
        settings.model = model;
        if let Some(text) = &self.max_rms {
            settings.max_rms = share(text, "--max-rms")?;
        }
        method.recipe(&pairs, settings)
    }
}

/// Walks that calibrate kernels.
#[derive(Clone, Copy, Debug, Args)]
pub(super) struct WalkOptions {
    /// Photons of each channel that a random walk takes (default: as many as bring the noise to --max-rms, 5% where that is
    /// not given), or a calibration (default: 200000, fewer where each is scattered very often; 40000 of them at most, and others,
    /// tell the error of the model)
    #[arg(long, value_name = "N")]
    pub(super) photons: Option<u64>,
    /// Seed of a random walk or a calibration
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(super) seed: u64,
}

impl WalkOptions {
    /// The calibrated model.
    pub(super) fn calibrated(self) -> Result<Model> {
        let mut walks = Walks { seed: self.seed, ..Walks::default() };
        if let Some(photons) = self.photons {
            walks = Walks { photons: in_range("--photons", photons, PHOTONS)?, collisions: u64::MAX, ..walks };
        }
        Ok(Model::Calibrated(walks))
    }

    /// The model of the papers, which walks nothing.
    pub(super) fn dipole(self) -> Result<Model> {
        if self.photons.is_some() || self.seed != 0 {
            return Err(Error::command_line(
                "--photons and --seed are for models that walk: --model calibrated, or monte-carlo of `reference`; the dipole takes --samples",
            ));
        }
        Ok(Model::Dipole)
    }
}

/// The kinds of light of `--for-lights`.
pub(super) fn light_kinds(text: &str) -> Result<BTreeSet<LightKind>> {
    if text.trim() == "all" {
        return Ok(LightKind::STORABLE.into_iter().collect());
    }
    let kind = |name: &str| {
        LightKind::ALL.into_iter().find(|k| k.name() == name).ok_or_else(|| {
            let names = LightKind::ALL.map(LightKind::name).join(", ");
            Error::command_line(format!("--for-lights {name}: there are {names}, and all"))
        })
    };
    text.split(',').map(|name| kind(name.trim())).collect()
}

/// Bakes an imported model; the memory is checked before.
pub(super) fn bake(recipe: Recipe, imported: Imported, console: &Console) -> Result<Asset> {
    let probes = for_bake(&imported.scene);
    bake_with(recipe, imported, probes, console)
}

/// The same without the errors that no choice needs, which take as long as all else.
pub(super) fn bake_unmeasured(mut recipe: Recipe, imported: Imported, console: &Console) -> Result<Asset> {
    recipe.settings.tells_model = false;
    let probes = Probes { unseen: Vec::new(), ..for_bake(&imported.scene) };
    bake_with(recipe, imported, probes, console)
}

fn bake_with(mut recipe: Recipe, imported: Imported, probes: Probes, console: &Console) -> Result<Asset> {
    let Imported { scene, origin, .. } = imported;
    let advice = match largest_fit(&recipe, &scene, console.free_memory()) {
        Some(fitting) => format!("--samples {fitting} would fit, or raise --max-memory"),
        None => "no number of samples would fit, raise --max-memory".to_owned(),
    };
    console.check_memory(recipe.bake_memory(&scene), &advice)?;
    recipe.settings.probes = probes;
    let asset = recipe.bake(scene, origin.into(), console)?;
    if let Some(line) = too_far_apart(&asset.scene, asset.samples.len()) {
        console.warn(&line);
    }
    for part in uncalibrated(&asset) {
        console.warn(&format!("part `{part}` is not closed: it keeps its dipole, which needs no volume"));
    }
    Ok(asset)
}

/// The largest number of samples that the memory limit allows, as a power of two.
fn largest_fit(recipe: &Recipe, scene: &Scene, limit: u64) -> Option<usize> {
    let mut trial = recipe.settings.clone();
    (0..28).rev().map(|power| 1usize << power).find(|&samples| {
        trial.samples = Some(samples);
        recipe.form.bake_memory(scene, &trial) <= limit
    })
}
