//! The settings of the encodings of Hao and Varshney 2004.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::values;
use crate::hao::harmonic_fit::Window;
use crate::hao::reference_points;
use translux::asset::Asset;
use translux::error::{Error, Result};
use translux::evaluate::{AssetParts, BakeSettings, Evaluator, Form};
use translux::forms::density::Density;
use translux::forms::projected::lights::LightSetSettings;
use translux::light::LightKind;
use translux::math::sh::MOST_ORDER;
use translux::progress::Progress;
use translux::scene::Scene;

/// How values of the vertices are kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) enum Encoding {
    /// A float for each vertex and light.
    Raw,
    /// A byte for each, equal steps.
    Uniform8,
    /// A byte for each, Lloyd's table: the paper's section 4.
    Lloyd8,
    /// Spherical harmonics: section 4.1.
    Harmonics,
    /// A byte for each light at reference points, spherical harmonics of the differences: section 4.2.
    ReferencePoints,
}

/// What is integrated over the neighbourhood (the paper's section 3.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) enum Integral {
    /// q, the radiosity.
    Scalar,
    /// Q, whose product with the direction of the light it is.
    Vector,
}

/// What the simplification that chooses the reference points looks at.
///
/// Error added to values under 200 lights, the median and the worst of 16 parallel lights, harmonics of order 3; closed bunny of
/// 30 mm in marble, by the share of the vertices that are reference points, in % (`Barycentric` and geometry are the paper's):
///
/// | | 1 % | 3 % | 6 % |
/// | --- | --- | --- | --- |
/// | geometry, barycentric | 4.31, 8.92 | 2.27, 4.75 | 1.43, 2.83 |
/// | geometry, least squares | 3.72, 9.04 | 2.03, 4.58 | 1.28, 2.76 |
/// | geometry, best triangle | 3.52, 9.12 | 1.90, 4.04 | 1.22, 2.48 |
/// | illumination, barycentric | 3.95, 9.30 | 1.99, 4.40 | 1.32, 2.80 |
/// | illumination, least squares | 3.49, 9.04 | 1.77, 4.22 | 1.16, 2.58 |
/// | illumination, best triangle | 3.37, 8.30 | 1.60, 3.67 | 1.01, 2.32 |
///
/// In skin1 the best triangle gives 2.10, 4.71 and 1.16, 2.67 at 3 and 6 % by geometry, 1.95, 5.15 and 1.09, 2.76 by
/// illumination: less under most lights, a little more under the worst. Weights and triangles cost up to 2 bytes a vertex.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) enum ChosenBy {
    /// The surface alone, as the paper has it.
    Geometry,
    /// Radiosity under the set of lights as well.
    Illumination,
}

/// Values of every vertex under a set of lights, encoded as the paper does.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct VertexValues {
    /// How many samples a bake takes.
    pub(crate) density: Density,
    /// The set.
    pub(crate) lights: LightSetSettings,
    /// How they are kept.
    pub(crate) encoding: Encoding,
    /// What is integrated.
    pub(crate) integral: Integral,
    /// Of the harmonics; what the error asks for.
    pub(crate) order: Option<usize>,
    /// Factors of their bands.
    pub(crate) window: Window,
    /// Reference points; as many as the error asks for.
    pub(crate) references: Option<usize>,
    /// What they follow.
    pub(crate) chosen_by: ChosenBy,
    /// How other vertices are predicted from them.
    pub(crate) weights: reference_points::Choice,
}

impl Form for VertexValues {
    const NAME: &'static str = "vertex_values";

    fn validate(&self) -> Result<()> {
        self.density.validate()?;
        self.lights.validate()?;
        match self.order {
            Some(order) if !(1..=MOST_ORDER).contains(&order) => {
                Err(Error::input(format!("harmonics of order {order}")))
            }
            _ => Ok(()),
        }
    }

    fn kinds(&self) -> &'static [LightKind] {
        &LightKind::STORABLE
    }

    fn bake_memory(&self, scene: &Scene, settings: &BakeSettings) -> u64 {
        values::bake::memory(self, scene, settings)
    }

    fn bake(&self, scene: &Scene, settings: &BakeSettings, progress: &dyn Progress) -> Result<AssetParts> {
        values::bake::bake(self, scene, settings, progress)
    }

    fn open(&self, asset: Arc<Asset>) -> Result<Box<dyn Evaluator>> {
        values::evaluate::open(self, &asset)
    }
}
