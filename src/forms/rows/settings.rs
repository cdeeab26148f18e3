//! The settings of `rows`.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use translux_format::Tag;
use translux_format::distant_transport::DistantTransport;

use super::bake::{of_sample, rows};
use super::evaluate::Rows;
use crate::asset::Asset;
use crate::error::{Error, Result};
use crate::evaluate::form::write_error;
use crate::evaluate::inter_reflection;
use crate::evaluate::{AssetParts, BakeSettings, Capabilities, Evaluator, Form};
use crate::forms::baked_in::BakedIn;
use crate::forms::density;
use crate::forms::distant::{Distant, KINDS, with_work};
use crate::forms::single_scattering::{Opened, opened, stored};
use crate::light::LightKind;
use crate::progress::Progress;
use crate::scene::Scene;

/// Transport of light from far away, as Haar coefficients of every vertex.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DirectionalRows(pub Distant);

impl Form for DirectionalRows {
    const NAME: &'static str = "rows";

    fn validate(&self) -> Result<()> {
        self.0.validate()
    }

    fn kinds(&self) -> &'static [LightKind] {
        KINDS
    }

    fn edits(&self, _: &dyn Fn(Tag) -> bool) -> Option<Capabilities> {
        Some(Capabilities::NONE)
    }

    fn bake_memory(&self, scene: &Scene, settings: &BakeSettings) -> u64 {
        let (samples, vertices) = (self.0.density.count(scene, settings.samples), scene.mesh.local_mm.len() as u64);
        // Rows of samples, of nodes (half as many) with their copy, and of vertices.
        let own = samples as u64 * 2 * of_sample(&self.0) as u64 * 6 + vertices * self.0.row as u64 * 5;
        density::memory(samples, scene, settings.model) + own + inter_reflection::memory(self.0.outside, samples, scene)
    }

    fn bake(&self, scene: &Scene, settings: &BakeSettings, progress: &dyn Progress) -> Result<AssetParts> {
        with_work((scene, settings, &self.0), progress, |work, _, mut ledger| {
            let mut file = DistantTransport { samples: work.sampled.samples.len() as u32, ..Default::default() };
            file.rows = Some(rows(work, &mut ledger, progress)?);
            file.single = stored(work, None, &mut ledger, progress)?;
            Ok(AssetParts::without_samples(scene, ledger, file.to_sections().map_err(write_error)?))
        })
    }

    fn open(&self, asset: Arc<Asset>) -> Result<Box<dyn Evaluator>> {
        let Opened { scene, receivers, file, beside } = opened(&asset, &self.0)?;
        let Some(own) = &file.rows else {
            return Err(Error::input("an asset without the rows that its settings speak of; bake it again"));
        };
        let rows = Rows::new(own, self.0.transform)?;
        BakedIn::with(scene, receivers, file.samples as usize, rows, beside)
    }
}
