//! Error metrics of pictures, probe lights, comparisons, and where an asset is wrong.

pub mod between_vertices;
pub mod chart;
pub(crate) mod exact_sums;
pub mod flip;
pub mod growth;
pub mod image_error;
pub mod light_places;
pub mod probes;
pub mod trust;
