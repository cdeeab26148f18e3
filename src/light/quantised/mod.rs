//! The quantised light set of Hao & Varshney 2004 (sections 3.1 to 3.3): any light as weights over a fixed set of lights.
//!
//! Scattered light is precomputed once for every entry of a set, [`distances::QuantisedLights`]: parallel light from a lattice of
//! directions and, where point lights come near, the same lattice on spheres of a few radii. A light is then a vector of RGB
//! weights over the entries, [`vector::light_vector`], and everything that the entries carry is linear in that vector.
//! The weights come from an [`interpolation::Interpolator`], of which the paper's is one of four.

pub mod directions;
pub mod distances;
pub mod interpolation;
#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod interpolation_tests;
#[cfg(test)]
mod test_functions;
pub mod vector;
#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod vector_tests;
