//! Settings of the form.

use std::ops::RangeInclusive;

use serde::{Deserialize, Serialize};

use crate::forms::density::Density;
use crate::geometry::atlas::Map;
use crate::light::LightKind;
use crate::transport::irradiance::LightSampling;
use crate::transport::near_rule::NearField;

/// Settings, the record in the asset.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TextureSpace {
    /// Texels that the surface has at least, and the samples that errors are measured against.
    pub density: Density,
    /// The map from the surface to the texture.
    pub map: Map,
    /// Texels along each edge of the texture, a power of two; none for as many as the density asks for.
    pub resolution: Option<u32>,
    /// Choice of the samples.
    pub sampling: Sampling,
    /// Samples of each receiver; none for as many as the asked error needs.
    pub count: Option<u32>,
    /// Shadow rays of a patch towards an environment, a quarter of them towards a constant light; none for as many as the number of patches
    /// asks for.
    pub directions: Option<u32>,
    /// Cells along each edge of an area light, each with a shadow ray of a patch.
    pub area_side: u32,
    /// The near field of patches that receivers see on their own.
    pub near: NearField,
}

/// Rays towards an environment of all patches together, and of one.
const SOFT_RAYS: usize = 1 << 25;
const DIRECTIONS: RangeInclusive<u32> = 8..=64;

impl TextureSpace {
    /// Rays by which each of some patches sees the lights.
    pub fn rays(&self, patches: usize) -> LightSampling {
        let asked = self.directions.unwrap_or(*DIRECTIONS.end());
        let rays = LightSampling { points_per_patch: 1, directions: asked, area_side: self.area_side };
        if self.directions.is_some() { rays } else { rays.with_directions_of_all(SOFT_RAYS, patches, DIRECTIONS) }
    }
}

/// How the samples are chosen.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Sampling {
    /// Points drawn by irradiance through the inverse of its sum in the order of the mip-map, shared by all receivers of a part: the
    /// paper's.
    Shared,
    /// Clusters of the mip-map of about equal second moments of their flux, shared by all receivers of a part.
    Clusters,
    /// Clusters of the mip-map for each group of receivers, by irradiance and R_d.
    Product,
    /// Shared samples for the far part of R_d; the near part from an image of the irradiance as the light sees it.
    Hybrid(Local),
}

impl Sampling {
    /// Kinds of light that it takes.
    pub(super) fn kinds(&self) -> &'static [LightKind] {
        match self {
            Self::Hybrid(_) => &[LightKind::Directional, LightKind::Point, LightKind::Spot],
            _ => &LightKind::ALL,
        }
    }
}

/// The local part of the hybrid method (section 4 of the paper).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Local {
    /// Lower bound c of the importance 2 pi r R_d(r), 1/mm: the local and the global part are equal where it is reached.
    pub importance: f64,
    /// Sharpness K of the division between the parts, 1/mm.
    pub sharpness: f64,
    /// Circles L around the projected receiver.
    pub rings: u32,
    /// Samples C on each circle.
    pub of_ring: u32,
    /// Pixels along each edge of the light's image, a power of two.
    pub image: u32,
    /// The samples of the far part.
    pub far: Far,
}

/// The shared samples of the far part of the hybrid method.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Far {
    /// Points drawn by irradiance: the paper's.
    Drawn,
    /// Clusters of about equal second moments of their flux.
    Clusters,
}
