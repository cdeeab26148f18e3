//! Radiosity as colours of vertices.

use std::f64::consts::PI;

use glam::DVec3;

use super::VertexData;
use crate::io::gltf::written::Column;
use crate::render::film::{Exposure, white_of};

/// Radiosity of some places with the factor that makes colours of it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Exposed {
    /// Colours are radiosity times this, and at most 1.
    pub factor: f64,
    /// Share of the places, weighted, where a channel is cut at 1.
    pub clamped_share: f64,
}

impl Exposed {
    /// The factor of an exposure: 2 to the stops over pi, since a surface of radiosity B sends B / pi into each direction, as pictures
    /// show it; automatically the one that makes the 99.5th percentile of the brightest channel, over places with a weight, white.
    pub fn new(exposure: Exposure, radiosity: &[DVec3], weights: &[f64]) -> Self {
        let weighted = || radiosity.iter().zip(weights).filter(|(_, weight)| **weight > 0.0);
        let factor = match exposure {
            Exposure::Stops(stops) => stops.exp2() / PI,
            Exposure::Auto => {
                let white = white_of(weighted().map(|(b, _)| b.max_element()).collect());
                white.filter(|white| *white >= f64::MIN_POSITIVE && white.is_finite()).map_or(1.0 / PI, f64::recip)
            }
        };
        let total = weighted().fold(0.0, |sum, (_, weight)| sum + weight);
        let is_cut = |b: &DVec3| (*b * factor).max_element() > 1.0;
        let cut = weighted().filter(|(b, _)| is_cut(b)).fold(0.0, |sum, (_, weight)| sum + weight);
        Self { factor, clamped_share: if total > 0.0 { cut / total } else { 0.0 } }
    }

    /// The colour of a radiosity, within [0, 1].
    pub fn colour(&self, radiosity: DVec3) -> [f32; 3] {
        let exposed = radiosity * self.factor;
        // Black stays black under a factor that overflowed.
        exposed.to_array().map(|c| if c > 0.0 { c.min(1.0) as f32 } else { 0.0 })
    }
}

/// `COLOR_0` and `_TLX_E`, the radiosity itself, of each vertex.
pub fn vertex_colours(radiosity: &[DVec3], exposed: &Exposed) -> VertexData {
    let row = |b: &DVec3| exposed.colour(*b).into_iter().chain(b.as_vec3().to_array());
    VertexData {
        columns: vec![Column::new("COLOR_0", 3), Column::new("_TLX_E", 3)],
        rows: radiosity.iter().flat_map(row).collect(),
    }
}
