//! Projected transport: coefficients at reference points over a basis of functions of the light, coded together. Two forms, by the
//! basis: a set of quantised lights, and spherical harmonics.

pub(crate) mod coding;
pub(crate) mod components;
mod digits;
mod forecast;
#[cfg(feature = "gpu")]
mod gpu;
pub mod harmonics;
pub mod lights;
mod reach;
pub mod references;
mod stored;
