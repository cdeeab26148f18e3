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
//! `error` < `progress` < `math` < `medium` < `geometry` < `light` < `io` < `compress` < `transport` < `scene`
//! < `import` < `asset` < `evaluate` < `methods` < `render` < `relight` < `measure` < `report`
//! < `commands`. `tests/layers.rs` checks it.

#![warn(clippy::exit, clippy::panic, clippy::print_stderr, clippy::print_stdout)]

//! # Example
//!
//! Radiosity of a marble sphere of 20 mm under one light:
//!
//! ```
//! use std::sync::Arc;
//! use glam::DVec3;
//! use translux::asset::Provenance;
//! use translux::evaluate::{BakeSettings, Method};
//! use translux::geometry::{mesh::{Mesh, Placement}, part_table::PartTable, shapes};
//! use translux::light::Light;
//! use translux::medium::material::{Medium, preset};
//! use translux::methods::{self, settings, two_pass::TwoPass};
//! use translux::progress::Silent;
//! use translux::scene::Scene;
//!
//! # fn main() -> translux::error::Result<()> {
//! let (mesh, _) = Mesh::from_source(shapes::icosphere(10.0, 3), &Placement { mm_per_unit: 1.0 })?;
//! let parts = PartTable::new(&mesh, vec![0; mesh.triangles.len()], vec![("ball".into(), Some(0))]);
//! let marble = preset("marble").ok_or_else(|| translux::error::Error::input("no marble"))?;
//! let media = vec![Medium { name: "marble".into(), properties: marble.properties() }];
//! let settings = BakeSettings::new(&TwoPass, settings::resolve(&TwoPass, &[])?);
//! let scene = Scene { mesh, parts, media };
//! let asset = methods::bake(&TwoPass, scene, &settings, Provenance::default(), &Silent)?;
//! let mut evaluator = TwoPass.open(Arc::new(asset))?;
//! evaluator.set_lights(vec![Light::directional(DVec3::Y, DVec3::splat(3.0))?], &Silent)?;
//! let radiosity = evaluator.radiosity(&Silent)?; // one RGB for each vertex
//! assert!(radiosity.iter().all(|b| b.min_element() > 0.0));
//! # Ok(())
//! # }
//! ```

pub mod error;
pub mod progress;

pub mod math;

pub mod medium;

pub mod geometry;

pub mod light;

pub mod io;

pub mod compress;

pub mod transport;

pub mod scene;

pub mod import;

pub mod asset;

pub mod evaluate;

pub mod forms;

pub mod methods;

pub mod render;

pub mod relight;

pub mod measure;

pub mod report;

pub mod commands;
