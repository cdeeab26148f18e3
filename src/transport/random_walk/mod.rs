//! A volumetric random walk: the exitance that the dipole only approximates.
//!
//! Photons enter a homogeneous medium through its boundary, scatter (Henyey and Greenstein) after free paths of mean
//! 1/sigma_t (unreduced), lose weight by absorption, are reflected at the smooth boundary by exact Fresnel, and leave. What
//! leaves is tallied where it does, split by the number of scattering events.
//!
//! What it shares with the other methods: irradiance behind the surface includes F_t at the entrance; light that has left
//! does not enter again, neither its own part nor another; shadows are those of the whole scene. What it does not share:
//! the dipole is a half space's answer to multiple scattering, the walk knows the shape, the direction of entrance and
//! every order. Parts joined across air are walked one by one: no light crosses the air.

pub mod boundary;
mod clearance;
pub mod entry;
pub mod exitance;
pub mod mesh_boundary;
pub mod model_error;
pub mod tally;
pub mod walk;

#[cfg(test)]
mod tests;
