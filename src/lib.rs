//! Precomputes, compresses and relights subsurface light transport on translucent meshes.
//!
//! # Units and conventions
//!
//! Lengths are millimetres, scattering and absorption coefficients 1/mm, colours linear sRGB (Rec. 709).
//! Directions point away from the surface: `w_i` towards the light, `w_o` towards the eye.
//! Irradiance is what enters the medium (entrance Fresnel included); radiosity is the exitance
//! `B(x_o) = Int_A R_d(|x_i - x_o|) E(x_i) dA` outside the medium, per vertex and RGB.
//!
//! # Layers
//!
//! Modules import downwards only, in this order:
//! `error` < `progress` < `math` < `medium` < `geometry` < `light` < `io` < `compress` < `transport` < `asset`
//! < `evaluate` < `methods` < `render` < `relight` < `measure` < `commands`. `tests/layers.rs` checks it.

#![warn(clippy::exit, clippy::panic, clippy::print_stderr, clippy::print_stdout)]

pub mod error;
pub mod progress;

pub mod math;

pub mod medium;

pub mod geometry;

pub mod light;

pub mod io;

pub mod compress;

pub mod transport;

pub mod asset;

pub mod evaluate;

pub mod methods;

pub mod measure;

pub mod commands;
