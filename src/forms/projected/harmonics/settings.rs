//! The settings of `harmonics`.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use translux_format::distant_transport::{DistantTransport, tags};

use super::bake::harmonics;
use super::evaluate::components;
use crate::asset::Asset;
use crate::error::{Error, Result};
use crate::evaluate::inter_reflection;
use crate::evaluate::{AssetParts, BakeSettings, Evaluator, Form};
use crate::forms::baked_in::{BakedIn, Beside};
use crate::forms::density;
use crate::forms::distant::{Distant, KINDS, MOST_ORDER, with_work};
use crate::forms::sampled_scene::GROUP;
use crate::forms::single_scattering;
use crate::light::LightKind;
use crate::progress::Progress;
use crate::scene::Scene;
use crate::transport::receivers::Receivers;

/// Transport of light from far away, under spherical harmonics at reference points.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Harmonics(pub Distant);

impl Form for Harmonics {
    const NAME: &'static str = "harmonics";

    fn validate(&self) -> Result<()> {
        self.0.validate()
    }

    fn kinds(&self) -> &'static [LightKind] {
        KINDS
    }

    fn bake_memory(&self, scene: &Scene, settings: &BakeSettings) -> u64 {
        let (samples, vertices) = (self.0.density.count(scene, settings.samples), scene.mesh.local_mm.len() as u64);
        let functions = self.0.order.unwrap_or(MOST_ORDER).pow(2) as u64;
        // Irradiance and flux of every sample; radiosities of each reference point, twice, and their columns.
        let own = samples as u64 * functions * 4 * 3 + (vertices / 2 + 256) * functions * 3 * 4 * 3;
        density::memory(samples, scene) + own + inter_reflection::memory(self.0.outside, samples, scene)
    }

    fn bake(&self, scene: &Scene, settings: &BakeSettings, progress: &dyn Progress) -> Result<AssetParts> {
        with_work((scene, settings, &self.0), progress, |work, suns, mut ledger| {
            let mut file = DistantTransport { samples: work.sampled.samples.len() as u32, ..Default::default() };
            let own = harmonics(work, suns, &mut ledger, progress)?;
            file.single = single_scattering::stored(work, Some(own.order as usize), &mut ledger, progress)?;
            file.harmonics = Some(own);
            let sections = file.to_sections().map_err(|e| Error::runtime(format!("asset: {e}")))?;
            Ok(AssetParts::without_samples(scene, ledger, sections))
        })
    }

    fn open(&self, asset: Arc<Asset>) -> Result<Box<dyn Evaluator>> {
        let scene = asset.scene.clone();
        let receivers = Receivers::new(&scene.mesh, &scene.parts, GROUP);
        let file = DistantTransport::from_sections(&asset.sections, receivers.len())
            .map_err(|e| Error::input(e.to_string()))?
            .ok_or_else(|| Error::input("an asset without its transport (sections aft.*); bake it again"))?;
        let Some(own) = &file.harmonics else {
            return Err(Error::input("an asset without the harmonics that its settings speak of; bake it again"));
        };
        let single = single_scattering::opened(file.single.as_ref(), &self.0, &scene, &receivers)?;
        let transport = components(own, (tags::SET, 1), &scene, &receivers)?;
        let beside = Beside { single, outside: self.0.outside };
        BakedIn::with(scene, receivers, file.samples as usize, transport, beside)
    }
}
