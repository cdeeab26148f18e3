//! The texels as an [`Evaluator`].

use std::sync::Arc;

use glam::DVec3;
use translux_format::texture_space as stored;
use translux_format::{Budget, FormatError, atlas};

#[cfg(feature = "gpu")]
use super::device::TextureSpaceOnDevice;
use super::light::LitMap;
use super::map::welded;
use super::settings::{Sampling, TextureSpace};
use super::state::{Chosen, TextureSpaceEvaluator, of_descent};
use crate::asset::Asset;
use crate::compress::ledger::Ledger;
use crate::error::{Error, Result};
#[cfg(feature = "gpu")]
use crate::evaluate::DeviceEvaluator;
#[cfg(feature = "gpu")]
use crate::evaluate::device::Device;
use crate::evaluate::exitance::{Exitance, MeshPoint};
use crate::evaluate::{Capabilities, Cost, Evaluator, MaterialEdit, ProfileEdit, SourceFields};
use crate::geometry::atlas::Atlas;
use crate::geometry::bvh::Bvh;
use crate::light::Light;
use crate::medium::material::Medium;
use crate::medium::profiles::model::LoadedProfile;
use crate::progress::{Progress, Silent};
use crate::scene::Scene;
use crate::transport::near_rule::NearField;
use crate::transport::receivers::Receivers;

/// The edits that every asset allows.
pub(super) const EDITS: Capabilities =
    Capabilities { material: MaterialEdit::Any, profile: ProfileEdit::OnCpu, source_fields: SourceFields::None };

pub(super) fn open(form: &TextureSpace, asset: &Arc<Asset>) -> Result<Box<dyn Evaluator>> {
    let input = |e: FormatError| Error::input(e.to_string());
    let missing = || Error::input("an asset without its atlas (sections atl.rec and tex.rec); bake it again");
    let triangles = welded(&asset.scene);
    let atlas = atlas::Atlas::from_sections(&asset.sections, &triangles, Budget::default()).map_err(input)?;
    let atlas = Atlas::from_codes(&atlas.ok_or_else(missing)?.corners);
    let numbers = stored::from_sections(&asset.sections).map_err(input)?.ok_or_else(missing)?;
    Ok(Box::new(TextureSpaceEvaluator::new(form, &asset.scene, atlas, numbers)?))
}

/// Exitance that is summed at each point.
struct AtPoints<'a> {
    evaluator: &'a TextureSpaceEvaluator,
    chosen: &'a Chosen,
    lit: &'a LitMap,
}

impl Exitance for AtPoints<'_> {
    fn at_vertices(&self) -> Option<&[DVec3]> {
        None
    }

    fn at(&self, point: &MeshPoint) -> DVec3 {
        self.at_each(std::slice::from_ref(point), &Silent).first().copied().unwrap_or_default()
    }

    fn at_each(&self, points: &[MeshPoint], progress: &dyn Progress) -> Vec<DVec3> {
        let parts = &self.evaluator.scene.parts;
        let place = |point: &MeshPoint| {
            let part = *parts.triangle_part.get(point.triangle as usize)?;
            parts.parts.get(part as usize)?.transfers().then_some((part, point.at_mm))
        };
        let receivers =
            Receivers::at(&points.iter().map(place).collect::<Vec<_>>(), of_descent(self.evaluator.numbers.count));
        progress.start("transfer", receivers.len() as u64);
        let values = self.evaluator.sums(self.chosen, self.lit, &receivers);
        progress.finish();
        receivers.expand(&values)
    }
}

impl Evaluator for TextureSpaceEvaluator {
    fn capabilities(&self) -> Capabilities {
        EDITS
    }

    fn cost(&self) -> Cost {
        let flux = self.lit.as_ref().map_or(0, LitMap::bytes);
        Cost {
            samples: self.numbers.count as usize,
            receivers: self.receivers.len(),
            resident_bytes: self.map.bytes() + flux + size_of_val(self.receivers.positions.as_slice()),
        }
    }

    fn scene(&self) -> &Scene {
        &self.scene
    }

    fn bvh(&self) -> &Bvh {
        Self::bvh(self)
    }

    fn set_lights(&mut self, lights: Vec<Light>, progress: &dyn Progress) -> Result<()> {
        self.check_lights(&lights)?;
        self.forget();
        let lit = self.illuminate(&lights, progress)?;
        // Images that cannot be made are refused here.
        let hybrid = matches!(self.form.sampling, Sampling::Hybrid(_));
        self.chosen = if hybrid { Some(self.choose(&lights, &lit)?) } else { None };
        (self.lit, self.lights) = (Some(lit), lights);
        Ok(())
    }

    fn move_lights(&mut self, lights: Vec<Light>, progress: &dyn Progress) -> Result<()> {
        self.check_lights(&lights)?;
        Self::move_lights(self, lights, progress)
    }

    fn set_media(&mut self, media: Vec<Medium>) -> Result<()> {
        if media.len() != self.scene.media.len() {
            let (given, there) = (media.len(), self.scene.media.len());
            return Err(Error::command_line(format!("{given} materials for the {there} media of the asset")));
        }
        self.take_media(media)?;
        self.truth = self.new_truth();
        Ok(())
    }

    fn set_profile(&mut self, profile: LoadedProfile) -> Result<()> {
        let before = self.profile.replace(profile);
        let taken = self.take_media(self.scene.media.clone());
        if taken.is_err() {
            self.profile = before;
        }
        taken
    }

    fn radiosity(&mut self, progress: &dyn Progress) -> Result<Vec<DVec3>> {
        self.prepare(progress)?;
        let (Some(chosen), Some(lit)) = (&self.chosen, &self.lit) else { return Ok(Vec::new()) };
        progress.start("transfer", self.receivers.len() as u64);
        let values = self.sums(chosen, lit, &self.receivers);
        progress.finish();
        Ok(self.receivers.expand(&values))
    }

    fn prepare_points(&mut self, progress: &dyn Progress) -> Result<()> {
        self.prepare(progress)
    }

    fn exitance_at_points(&self) -> Option<Box<dyn Exitance + '_>> {
        let (chosen, lit) = (self.chosen.as_ref()?, self.lit.as_ref()?);
        Some(Box::new(AtPoints { evaluator: self, chosen, lit }))
    }

    fn measured_error(&mut self, unseen: &[Light], _: &dyn Progress) -> Result<Ledger> {
        let together = [self.lights.clone()];
        let kinds = self.form.sampling.kinds();
        let each = unseen.iter().filter(|light| kinds.contains(&light.kind())).map(|light| vec![light.clone()]);
        let sets: Vec<Vec<Light>> = together.into_iter().chain(each).collect();
        self.errors(&sets, "the worst of these lights and of probe lights")
    }

    fn all_pairs(&mut self, progress: &dyn Progress) -> Result<Vec<DVec3>> {
        self.catch_up();
        self.prepare(progress)?;
        let Some(lit) = &self.lit else { return Ok(Vec::new()) };
        Ok(self.receivers.expand(&self.descent(lit, NearField::REFERENCE).radiosity(&self.receivers, 0.0)))
    }

    #[cfg(feature = "gpu")]
    fn on_device(self: Box<Self>, device: &Arc<Device>) -> Result<Box<dyn DeviceEvaluator>> {
        Ok(Box::new(TextureSpaceOnDevice::new(*self, device)?))
    }
}
