//! Optical properties and their units, Fresnel, the dipole and other profiles, measured materials.

pub mod dipole;
pub mod entrance_basis;
pub mod far_profile;
pub mod fresnel;
pub mod half_space;
pub mod inversion;
pub mod look;
pub mod material;
pub mod material_file;
pub mod phase;
mod planar;
pub mod profile;
pub mod profile_basis;
pub mod profiles;
pub mod softened;
mod toml_text;
pub mod volume;
