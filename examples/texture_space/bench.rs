//! What the parts share: assets with any number of samples, and the errors of pictures.

use glam::DVec3;
use translux::asset::Asset;
use translux::error::{Error, Result};
use translux::evaluate::Evaluator;
use translux::light::{Light, LightKind};
use translux::measure::image_error::{exposure, image_error};
use translux::methods;
use translux::progress::Silent;
use translux::render::frame::Frame;
use translux::scene::Scene;
use translux_format::texture_space::{self, tags};

use crate::common::bench::{Context, Recipe, bake_for, parallel};
use crate::common::lit::{opened, picture, rms, truth, under};

/// Pixels along each edge of the pictures that errors are measured on.
const SIDE: usize = 512;
const QUICK_SIDE: usize = 128;

/// From the front, above, and from behind.
pub(crate) fn lights() -> [Light; 2] {
    [DVec3::new(0.3, 0.8, 0.5), DVec3::new(-0.4, 0.3, -0.9)].map(parallel)
}

/// An asset whose choice of samples is in `set`.
pub(crate) fn baked(scene: &Scene, set: &[(&str, &str)], count: usize) -> Result<Asset> {
    let method = methods::built_in().method("texture_space")?;
    let recipe = Recipe { samples: Some(count), max_rms: 0.01, set };
    bake_for(LightKind::Directional, method, scene, &recipe, &Silent)
}

/// The same asset with another number of samples.
pub(crate) fn with_count(asset: &Asset, count: u32) -> Result<Asset> {
    let failed = |e: translux_format::FormatError| Error::runtime(e.to_string());
    let mut numbers = texture_space::from_sections(&asset.sections).map_err(failed)?.unwrap_or_default();
    numbers.count = count;
    let mut other = asset.clone();
    other.sections.retain(|section| section.tag != tags::NUMBERS);
    other.sections.push(texture_space::to_section(&numbers).map_err(failed)?);
    Ok(other)
}

/// The truth under each of the [`lights`]: radiosity, and the picture from the default eye.
pub(crate) struct Compared {
    pub(crate) scene: Scene,
    expected: Vec<(Light, Vec<DVec3>, Frame)>,
    side: usize,
}

/// Errors under the worst of the lights.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Errors {
    /// RMS over the vertices, worst channel.
    pub(crate) vertices: f64,
    /// RMS over the covered pixels.
    pub(crate) image: f64,
}

impl Compared {
    pub(crate) fn new(context: &Context, scene: Scene) -> Result<Self> {
        let side = if context.quick { QUICK_SIDE } else { SIDE };
        let mut truth = truth(context, &scene)?;
        let mut expected = Vec::new();
        for light in lights() {
            let values = under(truth.as_mut(), &light)?;
            let frame = picture(truth.as_ref(), &values, side)?;
            expected.push((light, values, frame));
        }
        Ok(Self { scene, expected, side })
    }

    pub(crate) fn errors(&self, asset: &Asset) -> Result<Errors> {
        self.errors_of(opened(asset)?.as_mut())
    }

    pub(crate) fn errors_of(&self, evaluator: &mut dyn Evaluator) -> Result<Errors> {
        let mut worst = Errors::default();
        for (light, expected, truth) in &self.expected {
            let values = under(evaluator, light)?;
            let frame = picture(evaluator, &values, self.side)?;
            worst.vertices = worst.vertices.max(rms(&self.scene, &values, expected));
            worst.image = worst.image.max(image_rms(&frame, truth));
        }
        Ok(worst)
    }
}

/// RMS of the covered pixels, both pictures at the exposure of the truth.
fn image_rms(frame: &Frame, truth: &Frame) -> f64 {
    let covered: Vec<bool> = truth.pixels.iter().map(|p| p.coverage > 0.0).collect();
    let [frame, truth] = [frame, truth].map(|f| f.pixels.iter().map(|p| p.diffuse).collect::<Vec<[f32; 3]>>());
    let factor = exposure(&truth, &covered) as f32;
    let [frame, truth] = [frame, truth].map(|f| f.iter().map(|p| p.map(|c| c * factor)).collect::<Vec<_>>());
    image_error(&frame, &truth, &covered).rms
}

/// A share to four places.
pub(crate) fn four(share: f64) -> String {
    format!("{share:.4}")
}
