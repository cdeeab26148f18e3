//! Error metrics of pictures, probe lights, comparisons, where an asset is wrong, and how wrong it is in poses.

pub mod between_vertices;
pub mod chart;
pub(crate) mod exact_sums;
pub mod flip;
pub mod growth;
pub mod image_error;
pub mod light_places;
pub mod pose;
pub mod probes;
pub mod refine;
pub mod sample_spacing;
pub mod trust;
