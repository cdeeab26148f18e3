//! What methods that store surface samples share: how many samples, the keys of light sampling, the bake itself.

use std::collections::BTreeMap;

use super::settings::number;
use crate::compress::ledger::Ledger;
use crate::error::{Error, Result};
use crate::evaluate::{AssetParts, BakeSettings, Key};
use crate::geometry::samples::{Facet, Patch, Samples};
use crate::progress::Progress;
use crate::transport::irradiance::LightSampling;
use crate::transport::scene::Scene;

/// How densely a surface is sampled.
///
/// The near field is integrated exactly, so the spacing follows from what shadow boundaries inside a mean free path ask
/// for; beyond `most`, a mean free path is a detail of a large object, and shadows are drawn as sharp as the samples are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Density {
    /// Spacing over the shortest mean free path.
    pub spacing: f64,
    /// Samples at least, for the shape's own shadows; one for each triangle as well, because each has its own irradiance.
    pub least: usize,
    /// Samples at most, unless more are asked for or there are more triangles.
    pub most: usize,
}

impl Density {
    /// Number of samples of a scene; `finer` divides the spacing.
    pub fn count(self, scene: &Scene, settings: &BakeSettings, finer: f64) -> usize {
        let mut wanted = 0.0;
        for part in &scene.parts.parts {
            if let Some(medium) = part.medium.and_then(|m| scene.media.get(m as usize)) {
                let spacing = self.spacing / finer * medium.properties.mean_free_path_mm().min_element();
                if spacing > 0.0 {
                    wanted += part.area_mm2 / (spacing * spacing);
                }
            }
        }
        let triangles = scene.mesh.triangles.len();
        let (least, most) = (self.least.max(triangles), self.most.max(triangles));
        settings.samples.unwrap_or_else(|| (wanted.min(1e12) as usize).clamp(least, most))
    }
}

/// Bytes that a set of samples takes at run time: patches, facets, irradiance and the tree with its clusters.
pub fn memory(count: usize, scene: &Scene) -> u64 {
    const TREE: usize = 64;
    const IRRADIANCE: usize = 24;
    let per_sample = size_of::<Patch>() + 2 * size_of::<Facet>() + size_of::<u32>() + IRRADIANCE + TREE;
    const PER_TRIANGLE: usize = 200;
    (count * per_sample + scene.mesh.triangles.len() * PER_TRIANGLE) as u64
}

/// Places the samples; there is nothing else to precompute.
pub fn bake(scene: &Scene, count: usize, progress: &dyn Progress) -> AssetParts {
    progress.start("samples", 0);
    let samples = Samples::new(&scene.mesh, &scene.parts, count);
    progress.finish();
    AssetParts { samples, ledger: Ledger::default(), sections: Vec::new() }
}

/// Shadow rays of a sample towards sharp lights.
pub const fn points(default: &'static str) -> Key {
    let help = "points of a sample that a directional or point light's shadow rays start from, a power of two";
    Key { name: "points", default, help }
}

/// Shadow rays of a sample towards soft lights.
pub const fn directions(default: &'static str) -> Key {
    Key {
        name: "directions",
        default,
        help: "shadow rays of a sample towards an environment; a constant light takes a quarter of them",
    }
}

/// Cells of an area light.
pub const fn area_side(default: &'static str) -> Key {
    Key { name: "area-side", default, help: "an area light is cut into this many cells along each edge" }
}

/// The light sampling that the keys `points`, `directions` and `area-side` describe.
///
/// # Errors
/// Command line: values out of range.
pub fn light_sampling(values: &BTreeMap<String, String>, keys: [&Key; 3]) -> Result<LightSampling> {
    let [points, directions, area_side] = keys;
    let sampling = LightSampling {
        points_per_patch: number(values, points, 1..=64)?,
        directions: number(values, directions, 1..=65536)?,
        area_side: number(values, area_side, 1..=256)?,
    };
    if sampling.points_per_patch.is_power_of_two() {
        return Ok(sampling);
    }
    let points = sampling.points_per_patch;
    Err(Error::command_line(format!("--set points={points}: a power of two is needed")))
}
