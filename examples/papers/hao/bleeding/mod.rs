//! The two passes at run time of Hao & Varshney 2004, section 2.3, for comparison: irradiance with Fresnel and shadows at every
//! vertex, then a sum over the list of the vertices in its scattering neighbourhood. No hierarchy and no quantised lights.
//!
//! An asset has the ranges of the neighbourhoods; the lists follow from the mesh and are made when it is opened.

mod evaluate;
mod lists;

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use translux_format::scattering_lists::ScatteringLists;

use self::evaluate::BleedingEvaluator;
use self::lists::{Entry, Neighbourhoods};
use translux::asset::Asset;
use translux::error::{Error, Result};
use translux::evaluate::{AssetParts, BakeSettings, Evaluator, Form};
use translux::forms::density::{self, Density};
use translux::medium::fresnel::BoundaryFit;
use translux::medium::material::Medium;
use translux::medium::profile::Profile;
use translux::progress::Progress;
use translux::scene::Scene;

/// Bytes that the lists of an asset take at most.
const MOST_BYTES: u64 = 4 << 30;

/// Lists of neighbours, evaluated in two passes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct NeighbourLists {
    /// How many samples the lists are measured against.
    pub(crate) density: Density,
    /// Share of the reflectance beyond the range of a vertex's list.
    pub(crate) range_share: f64,
}

impl Form for NeighbourLists {
    const NAME: &'static str = "neighbour_lists";

    fn validate(&self) -> Result<()> {
        self.density.validate()?;
        match self.range_share {
            share if share > 0.0 && share <= 1.0 => Ok(()),
            share => Err(Error::input(format!("a share of {share} beyond the range"))),
        }
    }

    fn bake_memory(&self, scene: &Scene, settings: &BakeSettings) -> u64 {
        memory(self, scene, settings)
    }

    fn bake(&self, scene: &Scene, settings: &BakeSettings, progress: &dyn Progress) -> Result<AssetParts> {
        bake(self, scene, settings, progress)
    }

    fn open(&self, asset: Arc<Asset>) -> Result<Box<dyn Evaluator>> {
        open(&asset)
    }
}

/// For each medium the distance beyond which at most `share` of what returns comes from, worst of the channels; never more than
/// reaches everything.
fn ranges_mm(scene: &Scene, share: f64) -> Vec<f64> {
    let everything = 2.0 * scene.mesh.diagonal_mm();
    let range = |medium: &Medium| {
        let dipoles = medium.properties.dipoles(BoundaryFit::Published);
        dipoles.iter().map(|d| d.range_mm(share)).fold(0.0, f64::max).min(everything)
    };
    scene.media.iter().map(range).collect()
}

/// Bytes of a bake: the lists, and the samples that they are measured against.
fn memory(form: &NeighbourLists, scene: &Scene, settings: &BakeSettings) -> u64 {
    let share = form.range_share;
    let entries = Neighbourhoods::new(scene).estimated_entries(&ranges_mm(scene, share));
    density::memory(form.density.count(scene, settings.samples), scene, settings.model)
        + entries * size_of::<Entry>() as u64
}

/// The lists' size, refused where it is beyond reason.
fn affordable(neighbourhoods: &Neighbourhoods, ranges_mm: &[f64]) -> Result<()> {
    let most = MOST_BYTES / size_of::<Entry>() as u64;
    // Counting takes long where there is far too much.
    let mut entries = neighbourhoods.estimated_entries(ranges_mm);
    if entries <= most {
        entries = neighbourhoods.entries(ranges_mm);
    }
    if entries <= most {
        return Ok(());
    }
    let bytes = entries.saturating_mul(size_of::<Entry>() as u64);
    let vertices = neighbourhoods.len();
    let farthest = ranges_mm.iter().copied().fold(0.0, f64::max);
    Err(Error::unsupported(format!(
        "the lists of {vertices} vertices that reach up to {farthest:.2} mm have {:.0} entries each, {:.1} GiB \
         together, and at most {} GiB are made; ask for a larger --set range-share or --max-rms, take fewer vertices, or another \
         encoding",
        entries as f64 / vertices.max(1) as f64,
        bytes as f64 / (1u64 << 30) as f64,
        MOST_BYTES >> 30,
    )))
}

fn bake(form: &NeighbourLists, scene: &Scene, settings: &BakeSettings, progress: &dyn Progress) -> Result<AssetParts> {
    let ranges_mm = ranges_mm(scene, form.range_share);
    let neighbourhoods = Neighbourhoods::new(scene);
    if neighbourhoods.len() == 0 {
        return Err(Error::input("no surface that light enters: every part is opaque"));
    }
    affordable(&neighbourhoods, &ranges_mm)?;
    let samples = u32::try_from(form.density.count(scene, settings.samples).max(1))
        .map_err(|_| Error::command_line("too many samples"))?;
    let sections = ScatteringLists { ranges_mm: ranges_mm.clone(), samples }
        .to_sections()
        .map_err(|e| Error::runtime(format!("asset: {e}")))?;
    let ledger =
        evaluate::measure(scene, &neighbourhoods, &ranges_mm, (samples as usize, &settings.probes.unseen), progress)?;
    Ok(AssetParts::without_samples(scene, ledger, sections))
}

fn open(asset: &Asset) -> Result<Box<dyn Evaluator>> {
    let file = ScatteringLists::from_sections(&asset.sections)
        .map_err(|e| Error::input(e.to_string()))?
        .ok_or_else(|| Error::input("an asset without its section qlt.ngh; bake it again"))?;
    let scene = asset.scene.clone();
    if file.ranges_mm.len() != scene.media.len() {
        let (ranges, media) = (file.ranges_mm.len(), scene.media.len());
        return Err(Error::input(format!("{ranges} ranges for {media} media: bake the asset again")));
    }
    let neighbourhoods = Neighbourhoods::new(&scene);
    affordable(&neighbourhoods, &file.ranges_mm)?;
    Ok(Box::new(BleedingEvaluator::new(scene, neighbourhoods, &file.ranges_mm, file.samples as usize)))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
