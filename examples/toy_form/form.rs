//! A form: radiosity under a constant environment, one RGB value for each vertex. Every other constant light is a multiple of it.

use std::sync::Arc;

use glam::DVec3;
use serde::{Deserialize, Serialize};
use translux::asset::Asset;
use translux::compress::ledger::Ledger;
use translux::error::{Error, Result};
use translux::evaluate::keys::Keys;
use translux::evaluate::{About, AnyForm, AssetParts, BakeSettings, Evaluator, Form, Method, RegisteredForm};
use translux::forms::baked_in::{BakedIn, Stored, truth};
use translux::forms::density::{self, Density};
use translux::light::{Light, LightKind};
use translux::math::statistics::vertex_error;
use translux::progress::Progress;
use translux::scene::Scene;
use translux::transport::receivers::Receivers;
use translux_format::{Codec, Kind, RawSection, Tag};

/// What a registry takes.
pub(crate) const ENTRY: RegisteredForm = RegisteredForm::of::<Ambient>();

/// RGB of every source vertex, f32 x 3.
const TAG: Tag = Tag::from_static("toy.amb");

/// Number of samples that the radiosity was computed from, u32.
const COUNT: Tag = Tag::from_static("toy.num");

/// The settings: how many samples the radiosity is computed from.
#[derive(Serialize, Deserialize)]
pub(crate) struct Ambient {
    density: Density,
}

impl Form for Ambient {
    const NAME: &'static str = "toy_ambient";
    const TAGS: &'static [Tag] = &[TAG, COUNT];

    fn validate(&self) -> Result<()> {
        self.density.validate()
    }

    fn kinds(&self) -> &'static [LightKind] {
        &[LightKind::Constant]
    }

    fn bake_memory(&self, scene: &Scene, settings: &BakeSettings) -> u64 {
        density::memory(self.density.count(scene, settings.samples), scene, settings.model)
    }

    fn bake(&self, scene: &Scene, settings: &BakeSettings, progress: &dyn Progress) -> Result<AssetParts> {
        let count = self.density.count(scene, settings.samples);
        let under = |count: usize| {
            let mut evaluator = truth(scene, count);
            evaluator.set_lights(vec![Light::constant(DVec3::ONE)?], progress)?;
            evaluator.radiosity(progress)
        };
        let (values, coarser) = (under(count)?, under(count.div_ceil(2))?);
        let mut ledger = Ledger::default();
        let error = vertex_error(&coarser, &values, &scene.vertex_areas_mm2());
        ledger.add("sampling", error, "half as many samples against all, under a constant light");
        let rows: Vec<[f32; 3]> = values.iter().map(|b| b.as_vec3().to_array()).collect();
        let count = RawSection::from_rows(COUNT, Kind::Method, Codec::Raw, &[count as u32]);
        let sections = vec![RawSection::from_rows(TAG, Kind::Method, Codec::Zstd, &rows), count];
        Ok(AssetParts::without_samples(scene, ledger, sections))
    }

    fn open(&self, asset: Arc<Asset>) -> Result<Box<dyn Evaluator>> {
        let scene = asset.scene.clone();
        let receivers = Receivers::new(&scene.mesh, &scene.parts, 16);
        let section = |tag| asset.sections.iter().find(|section| section.tag == tag);
        let missing = || Error::input(format!("an asset without its section {TAG}; bake it again"));
        let rows: Vec<[f32; 3]> = section(TAG).ok_or_else(missing)?.rows().map_err(|e| Error::input(e.to_string()))?;
        if rows.len() != scene.mesh.local_mm.len() || rows.as_flattened().iter().any(|v| !v.is_finite()) {
            return Err(Error::input(format!("section {TAG}: it does not belong to this mesh")));
        }
        let count: Vec<u32> = section(COUNT).ok_or_else(missing)?.rows().map_err(|e| Error::input(e.to_string()))?;
        let samples = count.first().copied().unwrap_or(1) as usize;
        let values = rows.iter().map(|row| glam::Vec3::from_array(*row).as_dvec3()).collect();
        BakedIn::boxed(scene, receivers, samples, Values(values))
    }
}

/// Radiosity of every source vertex under a constant light of radiance 1.
struct Values(Vec<DVec3>);

impl Stored for Values {
    /// Sum of the radiances.
    type Light = DVec3;

    fn light(&self, lights: &[Light]) -> Result<DVec3> {
        let mut sum = DVec3::ZERO;
        for light in lights {
            match light {
                Light::Constant { radiance } => sum += *radiance,
                _ => {
                    return Err(Error::unsupported(
                        "this asset knows constant light alone; bake it with another method",
                    ));
                }
            }
        }
        Ok(sum)
    }

    fn radiosity(&mut self, light: &DVec3, _: &Receivers) -> Vec<DVec3> {
        self.0.iter().map(|value| *value * *light).collect()
    }

    fn stage(&self) -> &'static str {
        "constant light"
    }

    fn bytes(&self) -> usize {
        size_of_val(self.0.as_slice())
    }
}

/// The method that chooses the form.
pub(crate) struct ToyForm;

impl Method for ToyForm {
    fn about(&self) -> About {
        About {
            name: "toy_form",
            summary: "radiosity under a constant environment alone (an example)",
            choose_when: "You want to see how a form is added.",
            keys: &[],
            default_max_rms: 0.005,
            declared_error: None,
            ladder: &[""],
        }
    }

    fn form(&self, _: &Keys, _: &BakeSettings) -> Result<Box<dyn AnyForm>> {
        Ok(Box::new(Ambient { density: Density { spacing: 0.35, least: 1 << 15, most: 1 << 18 } }))
    }
}
