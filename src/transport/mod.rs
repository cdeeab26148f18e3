//! Visibility, irradiance and the transfer of flux through the medium.

pub mod balanced_tree;
pub mod calibration;
pub mod close_pairs;
pub mod cube_harmonics;
pub mod domain;
pub mod far_field;
pub mod gather;
pub mod interpolation;
pub mod interreflection;
pub mod irradiance;
pub mod irradiance_rows;
pub mod kernel;
pub mod light_range;
pub mod many_lights;
pub mod moved_entry;
pub mod multilevel;
pub mod near_field;
pub mod near_rings;
pub mod near_rule;
mod prepared_light;
pub mod random_walk;
pub mod receivers;
pub mod sample_light;
pub mod single_scattering;
pub mod surface;
pub mod tree;
pub mod visibility;

#[cfg(test)]
mod test_scene;
