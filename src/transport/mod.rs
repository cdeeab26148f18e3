//! Visibility, irradiance and the transfer of flux through the medium.

pub mod gather;
pub mod irradiance;
pub mod kernel;
pub mod receivers;
pub mod scene;
pub mod simd;
pub mod tree;

#[cfg(test)]
mod test_scene;
