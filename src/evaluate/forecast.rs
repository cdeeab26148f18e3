//! What a bake is expected to cost, told by its form before any work. Times are those of a nominal machine, two cores of
//! an AMD EPYC (Zen 5), whatever machine this is: the same input has the same forecast everywhere.

use std::collections::BTreeSet;

use translux_format::sample_rule::MOST_MADE;

use super::capabilities::MaterialEdit;
use crate::light::LightKind;
use crate::scene::Scene;
use crate::transport::irradiance::LightSampling;

/// Numbers of a scene that costs follow from.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Body {
    /// Source vertices.
    pub vertices: usize,
    /// Triangles that have area, opaque ones among them.
    pub triangles: usize,
    /// Translucent area over the squared shortest mean free path; 0 without one.
    pub area_over_path_squared: f64,
}

impl Body {
    /// The numbers of a scene.
    pub fn of(scene: &Scene) -> Self {
        let area = |medium: usize| {
            let parts = scene.parts.parts.iter().filter(move |part| part.medium == Some(medium as u32));
            parts.map(|part| part.area_mm2).sum::<f64>()
        };
        let squares = scene.media.iter().enumerate().map(|(index, medium)| {
            let path = medium.properties.mean_free_path_mm().min_element();
            if path > 0.0 && path.is_finite() { area(index) / (path * path) } else { 0.0 }
        });
        Self {
            vertices: scene.mesh.local_mm.len(),
            triangles: scene.mesh.triangles.len(),
            area_over_path_squared: squares.sum(),
        }
    }
}

/// Expected cost of an asset.
#[derive(Clone, Debug, PartialEq)]
pub struct Forecast {
    /// Surface samples that are summed at run time, whose error comes on top of [`Self::rms`]; none where all errors are
    /// those of stages that the bake tunes.
    pub samples: Option<usize>,
    /// Samples that stored transport is baked from, where their error comes on top of [`Self::rms`] as well: calibrated kernels take as
    /// many as the density says, whatever error is asked for.
    pub baked_samples: Option<usize>,
    /// Error that the stages of the bake and the sums at run time are expected to add: relative RMS.
    pub rms: f64,
    /// Its part in the dark, over that: the error of vertices below a tenth of the mean, relative to their own mean.
    pub dark_over_rms: f64,
    /// Bytes of the asset beside its mesh.
    pub bytes: f64,
    /// Seconds of the bake.
    pub bake_s: f64,
    /// Milliseconds to new radiosity of every vertex after a change of the light, by the light's kind.
    pub relight_ms: Vec<(LightKind, f64)>,
    /// Edits of the material that need no new bake.
    pub material: MaterialEdit,
}

impl Forecast {
    /// The same for a form that serves some kinds of light alone.
    #[must_use]
    pub fn served(mut self, kinds: &[LightKind]) -> Self {
        self.relight_ms.retain(|(kind, _)| kinds.contains(kind));
        self
    }

    /// Samples whose error comes on top of [`Self::rms`], if there are any.
    pub fn erring_samples(&self) -> Option<usize> {
        self.samples.or(self.baked_samples)
    }

    /// Time of a new light of the slowest of some kinds, ms; infinite where one of them is not served.
    pub fn slowest_relight_ms(&self, kinds: &BTreeSet<LightKind>) -> f64 {
        let of = |kind: &LightKind| self.relight_ms.iter().find(|(served, _)| served == kind).map(|(_, ms)| *ms);
        kinds.iter().map(|kind| of(kind).unwrap_or(f64::INFINITY)).fold(0.0, f64::max)
    }
}

/// A time for every kind of light.
pub fn relight_of_kinds(of: impl Fn(LightKind) -> f64) -> Vec<(LightKind, f64)> {
    LightKind::ALL.into_iter().map(|kind| (kind, of(kind))).collect()
}

/// Bytes of an asset whose samples are made again: the rule, settings, provenance and ledger.
const RULE_BYTES: f64 = 1600.0;

/// Bytes that a set of samples takes in a file: next to none where they are made again; else two for each triangle that may be in a cluster,
/// and more for each cut, and still more where they are stored in the order of their tree.
pub fn samples_bytes(samples: usize, body: Body, (ordered, stored): (bool, bool)) -> f64 {
    if !stored && samples + body.triangles <= MOST_MADE {
        return RULE_BYTES;
    }
    let (n, triangles) = (samples as f64, body.triangles.max(1) as f64);
    let of_sample = (3.0 + 0.27 * (n / triangles).log2()).clamp(2.7, 4.3);
    let of_order = if ordered { 1.0 + 0.28 * ((n / triangles - 1.0) / 3.0).clamp(0.0, 1.0) } else { 1.0 };
    900.0 + (2.0 * triangles + of_sample * n) * of_order
}

/// Milliseconds in which light of a kind reaches the samples: from stored rows where there are any that hold it, else by rays.
pub fn light_ms(samples: usize, sampling: LightSampling, has_rows: bool, kind: LightKind) -> f64 {
    let LightSampling { points_per_patch, directions, area_side } = sampling;
    match kind {
        LightKind::Environment | LightKind::Constant if has_rows => MS_OF_A_ROW * samples as f64,
        _ => rays_ms(samples, (points_per_patch, directions, area_side.pow(2)), kind),
    }
}

/// Milliseconds in which rays light the samples, by the light's kind: rays that start from `points` places of a sample for sharp
/// lights, `directions` for environments, `cells` for area lights.
pub fn rays_ms(samples: usize, (points, directions, cells): (u32, u32, u32), kind: LightKind) -> f64 {
    let rays = match kind {
        LightKind::Directional | LightKind::Point | LightKind::Spot => points,
        LightKind::Area => cells,
        LightKind::Environment | LightKind::Constant => directions,
    };
    samples as f64 * f64::from(rays) * MS_OF_A_RAY
}

/// Time of a shadow ray on both cores, ms, its share of the light's sampling included.
const MS_OF_A_RAY: f64 = 4.5e-5;

/// Time of a stored row of irradiance, ms.
const MS_OF_A_ROW: f64 = 4e-4;
