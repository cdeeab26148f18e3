//! Compute shaders: adapters, geometry and kernels in device memory, and evaluators whose radiosity lies there.

pub mod adapter;
pub mod interpolated;
pub mod jobs;
pub mod near_field;
pub mod rays;
pub mod surface;
pub mod tree;
mod uploaded;

pub use adapter::Device;
pub use uploaded::Uploaded;
