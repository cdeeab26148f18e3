//! Measurements of one part of a mesh against the mean free path of its medium.

use serde::Serialize;

use crate::geometry::parts::Part;

/// A part is thin where a straight way inwards leaves it within this many mean free paths: diffusion, which assumes
/// many scattering events between two surfaces, is inaccurate there.
pub const THIN_MEAN_FREE_PATHS: f64 = 3.0;

/// Inward rays that measure thickness, spread over the translucent area of the whole mesh.
pub const THICKNESS_SAMPLES: usize = 2048;

/// Mean free paths 1/sigma_t' of one medium over its colour channels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeanFreePath {
    /// Mean free path of the densest channel, in mm: triangles must resolve it.
    pub shortest_mm: f64,
    /// Mean free path of the clearest channel, in mm: thickness must exceed it.
    pub longest_mm: f64,
}

/// Measurements of one part.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PartCheck {
    /// The part itself.
    #[serde(flatten)]
    pub part: Part,
    /// Thickness of a sheet of the same area and volume, 2 V / A, in mm; none for open parts.
    pub mean_thickness_mm: Option<f64>,
    /// 5th and 50th percentile over the area of the way straight inwards to the next back face of the part, in mm;
    /// none where so many of the rays find no way out, and for parts with fewer than 16 of the samples.
    pub thickness_mm: [Option<f64>; 2],
    /// Share of the area where that way is below [`THIN_MEAN_FREE_PATHS`]; none without a mean free path. Parts with
    /// fewer than 16 samples are judged by their mean thickness.
    pub thin_area_share: Option<f64>,
    /// Share of the area in triangles with an edge longer than the shortest mean free path; none without one.
    pub long_edge_area_share: Option<f64>,
}
