//! The settings of `filtered_normals`.

use serde::{Deserialize, Serialize};

use crate::forms::density::Density;

/// How normals are filtered, and what takes their place in local lighting.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FilteredNormals {
    /// How many samples errors are measured against.
    pub density: Density,
    /// How the ladder of filtered normals is made.
    pub filter: Filter,
    /// The response of the filter, unless it is that of the material.
    pub response: Response,
    /// Rungs of the ladder.
    pub rungs: u32,
    /// Share of the normal itself; fitted.
    pub alpha: Option<f64>,
    /// Factor of the width of the response; fitted.
    pub width: Option<f64>,
    /// What becomes of the length of a filtered normal.
    pub length: Length,
    /// Whether vertices are shadowed.
    pub shadows: Shadows,
    /// What is filtered when light comes.
    pub bleeding: Bleeding,
}

/// How the ladder is made.
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
        /// What stands beside the normal itself.
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
    /// The area around it.
    Area,
}

/// What stands beside the normal itself in a geometric sum.
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
    /// That of R_d of each channel: its Hankel transform over its total.
    Material,
    /// A Gaussian of a standard deviation on the surface, mm.
    Gaussian(f64),
    /// That of exp(-sigma r), 1/mm; sigma_tr of each channel.
    Exponential(Option<f64>),
}

/// What becomes of the length of a filtered normal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Length {
    /// It is made 1.
    Unit,
    /// It multiplies the light: less where the normals around differ.
    Kept,
    /// It says how far the normals around spread, and light falls on all of these: less from the front and more from the side and from
    /// behind, none of it lost.
    Spread,
}

/// Whether vertices are shadowed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Shadows {
    /// By rays, and by how open a vertex is under light from all around. The same holds for a light below its horizon: whether the vertex
    /// faces it is the filtered normal's to say.
    Cast,
    /// They are not, as in the paper.
    Off,
}

/// What is filtered when light comes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Bleeding {
    /// Nothing: the normals are filtered, not the light.
    Off,
    /// The shadowed irradiance, by the same filter: light bleeds across shadow boundaries (the paper's future work).
    Irradiance,
}
