//! Optical properties and their units, Fresnel, the dipole and other profiles, measured materials.

pub mod dipole;
pub mod fresnel;
pub mod material;
mod material_file;
pub mod profile;
