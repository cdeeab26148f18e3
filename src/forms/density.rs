//! Number of surface samples that a scene needs, and the memory that they take.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::evaluate::Model;
use crate::geometry::samples::{Facet, Patch};
use crate::scene::Scene;
use crate::transport::moved_entry;
use crate::transport::random_walk::exitance;

/// Density of the surface samples.
///
/// The near field is integrated exactly, so the spacing follows from shadow boundaries inside a mean free path; beyond
/// `most`, a mean free path is a detail of a large object, and shadows are as sharp as the samples.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Density {
    /// Spacing over the shortest mean free path.
    pub spacing: f64,
    /// Samples at least, for the shape's own shadows; one for each triangle as well, because each has its own irradiance.
    pub least: u32,
    /// Samples at most, unless more are asked for or there are more triangles.
    pub most: u32,
}

impl Density {
    /// The same with a finer spacing.
    #[must_use]
    pub fn finer(self, factor: f64) -> Self {
        Self { spacing: self.spacing / factor, ..self }
    }

    /// Number of samples of a scene, unless one is asked for.
    pub fn count(self, scene: &Scene, asked: Option<usize>) -> usize {
        let mut wanted = 0.0;
        for part in &scene.parts.parts {
            if let Some(medium) = part.medium.and_then(|m| scene.media.get(m as usize)) {
                let spacing = self.spacing * medium.properties.mean_free_path_mm().min_element();
                if spacing > 0.0 {
                    wanted += part.area_mm2 / (spacing * spacing);
                }
            }
        }
        let triangles = scene.mesh.triangles.len();
        let (least, most) = (triangles.max(self.least as usize), triangles.max(self.most as usize));
        asked.unwrap_or_else(|| (wanted.min(1e12) as usize).clamp(least, most))
    }

    /// Refuses settings out of range.
    ///
    /// # Errors
    /// Invalid input.
    pub fn validate(&self) -> Result<()> {
        let Self { spacing, least, most } = *self;
        if !(spacing.is_finite() && spacing > 0.0 && least <= most) {
            return Err(Error::input(format!("{least} to {most} samples, {spacing} mean free paths apart")));
        }
        Ok(())
    }
}

/// Bytes that a set of samples takes with a model: patches, facets, irradiance and the tree with its clusters; with calibrated kernels
/// what light moves by as well, and the walks.
pub fn memory(count: usize, scene: &Scene, model: Model) -> u64 {
    const TREE: usize = 64;
    const IRRADIANCE: usize = 24;
    let per_sample = size_of::<Patch>() + 2 * size_of::<Facet>() + size_of::<u32>() + IRRADIANCE + TREE;
    const PER_TRIANGLE: usize = 200;
    let of_model = match model {
        Model::Dipole => 0,
        Model::Calibrated(_) => moved_entry::memory(count) + exitance::memory(scene.domain()),
    };
    (count * per_sample + scene.mesh.triangles.len() * PER_TRIANGLE) as u64 + of_model
}
