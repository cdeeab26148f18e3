//! The form: validates its settings, bakes and opens.

use std::sync::Arc;

use translux_format::{Tag, texture_space};

use super::forecast::forecast;
use super::settings::{Local, Sampling, TextureSpace};
use super::{bake, evaluate};
use crate::asset::Asset;
use crate::error::{Error, Result};
use crate::evaluate::{AssetParts, BakeSettings, Capabilities, Evaluator, Forecast, Form, Model, memory};
use crate::forms::density;
use crate::light::LightKind;
use crate::progress::Progress;
use crate::scene::Scene;

/// Bytes of a texel at run time: its patches, nodes and their light.
const OF_TEXEL: u64 = 500;

/// Bytes of the texels of an atlas; patches end with triangles, too.
fn of_texels(texels: u64, scene: &Scene) -> u64 {
    (texels + 4 * scene.mesh.triangles.len() as u64) * OF_TEXEL
}

impl Form for TextureSpace {
    const NAME: &'static str = "texture_space";

    fn validate(&self) -> Result<()> {
        self.density.validate()?;
        self.rays(1).validate()?;
        self.near.validate()?;
        let positive = |value: f64| value.is_finite() && value > 0.0;
        let power = |value: u32| value.is_power_of_two() && (16..=4096).contains(&value);
        let local = match self.sampling {
            Sampling::Hybrid(Local { importance, sharpness, rings, of_ring, image, .. }) => {
                let few = (1..=1000).contains(&rings) && (1..=1000).contains(&of_ring);
                positive(importance) && positive(sharpness) && few && power(image)
            }
            _ => true,
        };
        if local && self.resolution.is_none_or(power) && self.count.is_none_or(|count| count > 0) {
            return Ok(());
        }
        Err(Error::input(format!("settings of texture space out of range: {self:?}")))
    }

    fn kinds(&self) -> &'static [LightKind] {
        self.sampling.kinds()
    }

    /// The atlas alone is stored, whatever the size and the material.
    fn holds_transport(&self) -> bool {
        false
    }

    fn serves_points(&self) -> bool {
        true
    }

    fn edits(&self, _: &dyn Fn(Tag) -> bool) -> Option<Capabilities> {
        Some(evaluate::EDITS)
    }

    fn bake_memory(&self, scene: &Scene, settings: &BakeSettings) -> u64 {
        let texels = u64::from(bake::resolution(self, scene)).pow(2);
        let samples = settings.samples.unwrap_or(bake::MOST_COUNT as usize) as u64;
        let truth = density::memory(self.density.count(scene, None), scene, Model::Dipole);
        truth + of_texels(texels, scene) + 48 * samples
    }

    fn run_memory(&self, asset: &Asset) -> u64 {
        // What cannot be read is refused when it is opened.
        let numbers = texture_space::from_sections(&asset.sections).ok().flatten();
        let texels = numbers.map_or(0, |numbers| u64::from(numbers.resolution).pow(2));
        memory::of_evaluator(asset) + of_texels(texels, &asset.scene)
    }

    fn forecast(&self, scene: &Scene, settings: &BakeSettings) -> Option<Forecast> {
        Some(forecast(self, scene, settings))
    }

    fn bake(&self, scene: &Scene, settings: &BakeSettings, progress: &dyn Progress) -> Result<AssetParts> {
        bake::bake(self, scene, settings, progress)
    }

    fn open(&self, asset: Arc<Asset>) -> Result<Box<dyn Evaluator>> {
        evaluate::open(self, &asset)
    }
}
