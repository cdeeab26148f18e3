//! Error metrics of pictures, probe lights and comparisons.

pub mod between_vertices;
pub mod chart;
pub mod flip;
pub mod growth;
pub mod image_error;
pub mod light_places;
pub mod probes;
