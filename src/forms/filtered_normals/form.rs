//! The form: validates its settings, bakes and opens.

use std::sync::Arc;

use translux_format::Tag;
use translux_format::filtered_normals::MOST_RUNGS;

use super::forecast::forecast;
use super::settings::{Bleeding, Filter, FilteredNormals, Response};
use super::{bake, evaluate};
use crate::asset::Asset;
use crate::error::{Error, Result};
use crate::evaluate::{AssetParts, BakeSettings, Capabilities, Evaluator, Forecast, Form, Model, memory};
use crate::forms::density;
use crate::progress::Progress;
use crate::scene::Scene;

/// Bytes of the fields of a vertex at run time.
const OF_A_VERTEX: u64 = 320;

impl Form for FilteredNormals {
    const NAME: &'static str = "filtered_normals";

    fn validate(&self) -> Result<()> {
        self.density.validate()?;
        let positive = |value: f64| value.is_finite() && value > 0.0;
        let filter = match self.filter {
            Filter::Heat => true,
            Filter::Spectral { wavelength } => (2.0..=1e6).contains(&wavelength),
            Filter::Geometric { reach, .. } => (0.1..=100.0).contains(&reach) && self.bleeding == Bleeding::Off,
        };
        let response = match self.response {
            Response::Material | Response::Exponential(None) => true,
            Response::Gaussian(mm) => positive(mm) && !matches!(self.filter, Filter::Geometric { .. }),
            Response::Exponential(Some(sigma)) => positive(sigma),
        };
        let share = self.alpha.is_none_or(|alpha| (0.0..=1.0).contains(&alpha));
        let rungs = (2..=MOST_RUNGS as u32).contains(&self.rungs);
        if filter && response && share && rungs && self.width.is_none_or(positive) {
            return Ok(());
        }
        Err(Error::input(format!("settings of filtered normals out of range: {self:?}")))
    }

    fn edits(&self, _: &dyn Fn(Tag) -> bool) -> Option<Capabilities> {
        Some(evaluate::EDITS)
    }

    fn bake_memory(&self, scene: &Scene, settings: &BakeSettings) -> u64 {
        // Sparse matrices, vectors of the solver and fields of a vertex; the basis of a band of eigenvectors beside.
        let vertices = scene.mesh.local_mm.len() as u64;
        let of_vertex = 1200 + 24 * u64::from(self.rungs);
        let basis = if matches!(self.filter, Filter::Spectral { .. }) { 10_000 } else { 0 };
        density::memory(self.density.count(scene, settings.samples), scene, Model::Dipole)
            + vertices * (of_vertex + basis)
    }

    fn run_memory(&self, asset: &Asset) -> u64 {
        memory::of_evaluator(asset) + asset.scene.mesh.local_mm.len() as u64 * OF_A_VERTEX
    }

    fn forecast(&self, scene: &Scene, _: &BakeSettings) -> Option<Forecast> {
        Some(forecast(self, scene))
    }

    fn bake(&self, scene: &Scene, settings: &BakeSettings, progress: &dyn Progress) -> Result<AssetParts> {
        bake::bake(self, scene, settings, progress)
    }

    fn open(&self, asset: Arc<Asset>) -> Result<Box<dyn Evaluator>> {
        evaluate::open(self, &asset)
    }
}
