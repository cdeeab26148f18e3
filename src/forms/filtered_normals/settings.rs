//! The settings of `filtered_normals`.

use serde::{Deserialize, Serialize};

use crate::forms::density::Density;

/// Filter of the normals, and their use in local lighting.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FilteredNormals {
    /// Number of samples that errors are measured against.
    pub density: Density,
    /// Filter that makes the ladder of normals.
    pub filter: Filter,
    /// Response of the filter.
    pub response: Response,
    /// Number of rungs of the ladder.
    pub rungs: u32,
    /// Share of the normal itself; `None`: fitted.
    pub alpha: Option<f64>,
    /// Factor of the width of the response; `None`: fitted.
    pub width: Option<f64>,
    /// Treatment of the length of a filtered normal.
    pub length: Length,
    /// Shadows on the vertices.
    pub shadows: Shadows,
    /// Filter of the irradiance at run time.
    pub bleeding: Bleeding,
}

/// Filter that makes the ladder of normals.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Filter {
    /// Implicit steps of the heat equation on the surface.
    Heat,
    /// Manifold harmonics up to a wavelength in mean edges (10 in the paper), the remainder as a whole.
    Spectral {
        /// Shortest wavelength over the mean edge.
        wavelength: f64,
    },
    /// Sums over the vertices nearby, weighted by an exponential of the distance through space (the paper's equation 3).
    Geometric {
        /// Weight of a vertex beside the exponential.
        weights: Weights,
        /// Term added to the normal itself.
        sum: Sum,
        /// Distance up to which vertices count, in reciprocals of sigma_tr.
        reach: f64,
    },
}

/// Weight of a vertex in a geometric sum.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Weights {
    /// 1, as in the paper: dense parts of a mesh weigh more.
    Count,
    /// The area around the vertex.
    Area,
}

/// Term added to the normal itself in a geometric sum.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Sum {
    /// The sum, as in the paper.
    Plain,
    /// The mean.
    Mean,
}

/// The response of the filter.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Response {
    /// Response of R_d of each channel: its Hankel transform over its total.
    Material,
    /// A Gaussian of a standard deviation on the surface, mm.
    Gaussian(f64),
    /// Response of exp(-sigma r), sigma in 1/mm; `None`: sigma_tr of each channel.
    Exponential(Option<f64>),
}

/// Treatment of the length of a filtered normal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Length {
    /// Normalised to 1.
    Unit,
    /// Factor of the light: less where the normals around differ.
    Kept,
    /// Measure of the spread of the normals around, which all take light: less from the front and more from the side
    /// and from behind, none of it lost.
    Spread,
}

/// Shadows on the vertices.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Shadows {
    /// By rays, and by the openness of the vertex for light from all around and for a light below its horizon, where
    /// the filtered normal decides if the vertex faces it.
    Cast,
    /// None, as in the paper.
    Off,
}

/// Filter of the irradiance at run time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Bleeding {
    /// Nothing: the normals are filtered, not the light.
    Off,
    /// The shadowed irradiance, by the same filter: light bleeds across shadow boundaries (the paper's future work).
    Irradiance,
}
