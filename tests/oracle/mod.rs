//! A separate, slow, scalar f64 truth for per-vertex radiosity, for tests only.
//!
//! It shares no line with the crate under test: own OBJ reader, Fresnel, dipole, lights, intersection and random
//! numbers, standard library only. What it computes, for a vertex `x_o` of a triangle mesh with surface `A`:
//!
//! `B(x_o) = Int_A R_d(|x_i - x_o|) E(x_i) dA`, `E(x_i) = Int L(w) V(x_i, w) F_t(eta, n_i.w) max(0, n_i.w) dw`,
//!
//! with the geometric normal `n_i`, lengths in mm, linear RGB. Every triangle is bisected until the kernel is smooth
//! on each piece and the pieces that a shadow boundary crosses no longer matter; each piece takes a seven-point rule
//! of degree five. [`gather::Oracle::radiosity_with_error`] also says how far the result can be trusted.
#![allow(clippy::unwrap_used, missing_docs, dead_code, unreachable_pub)]

pub mod gather;
pub mod hdr;
pub mod lights;
pub mod medium;
pub mod mesh;
pub mod patch;
pub mod rays;
pub mod shadow;
pub mod truth_files;
pub mod vector;

pub use gather::{Oracle, OracleSettings};
pub use lights::OracleLight;
pub use medium::OracleMedium;
pub use mesh::OracleMesh;
