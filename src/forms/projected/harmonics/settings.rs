//! The settings of `harmonics`.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use translux_format::Tag;
use translux_format::distant_transport::{DistantTransport, tags};

use super::bake::harmonics;
use super::evaluate::components;
use crate::asset::Asset;
use crate::error::{Error, Result};
use crate::evaluate::form::write_error;
use crate::evaluate::inter_reflection;
use crate::evaluate::{AssetParts, BakeSettings, Capabilities, Evaluator, Forecast, Form, Model};
use crate::forms::baked_in::BakedIn;
use crate::forms::density;
use crate::forms::distant::{Distant, KINDS, MOST_ORDER, with_work};
use crate::forms::projected::forecast::{Basis, forecast};
use crate::forms::single_scattering::{Opened, opened, stored};
use crate::light::LightKind;
use crate::progress::Progress;
use crate::scene::Scene;

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

    fn serves(&self, _: Model) -> bool {
        true
    }

    fn edits(&self, _: &dyn Fn(Tag) -> bool) -> Option<Capabilities> {
        Some(Capabilities::NONE)
    }

    fn divides(&self) -> bool {
        true
    }

    fn bake_memory(&self, scene: &Scene, settings: &BakeSettings) -> u64 {
        let (samples, vertices) = (self.0.density.count(scene, settings.samples), scene.mesh.local_mm.len() as u64);
        let functions = self.0.order.unwrap_or(MOST_ORDER).pow(2) as u64;
        // Light that is moved to where it first scatters is another in every channel.
        let channels = if settings.model == Model::Dipole { 1 } else { 3 };
        // Irradiance and flux of every sample; radiosities of each reference point, twice, and their columns.
        let own = samples as u64 * functions * 4 * 3 * channels + (vertices / 2 + 256) * functions * 3 * 4 * 3;
        density::memory(samples, scene, settings.model) + own + inter_reflection::memory(self.0.outside, samples, scene)
    }

    fn forecast(&self, scene: &Scene, settings: &BakeSettings) -> Option<Forecast> {
        let basis = Basis { sharp_rms: 0.031, bytes: 1.4e6, bake_s: 7.0, keeps: [0.8, 3.0] };
        let sharp = settings.is_for(LightKind::Directional);
        Some(forecast(scene, settings, self.0.density, basis, sharp).served(KINDS))
    }

    fn bake(&self, scene: &Scene, settings: &BakeSettings, progress: &dyn Progress) -> Result<AssetParts> {
        with_work((scene, settings, &self.0), progress, |work, suns, mut ledger| {
            let mut file = DistantTransport { samples: work.sampled.samples.len() as u32, ..Default::default() };
            let own = harmonics(work, suns, &mut ledger, progress)?;
            file.single = stored(work, Some(own.order as usize), &mut ledger, progress)?;
            file.harmonics = Some(own);
            let mut sections = file.to_sections().map_err(write_error)?;
            sections.extend(work.calibration.iter().cloned());
            Ok(AssetParts::without_samples(scene, ledger, sections))
        })
    }

    fn open(&self, asset: Arc<Asset>) -> Result<Box<dyn Evaluator>> {
        let Opened { scene, receivers, file, beside } = opened(&asset, &self.0)?;
        let Some(own) = &file.harmonics else {
            return Err(Error::input("an asset without the harmonics that its settings speak of; bake it again"));
        };
        let transport = components(own, (tags::SET, 1), &scene, &receivers)?;
        BakedIn::with(scene, receivers, file.samples as usize, transport, beside)
    }
}
