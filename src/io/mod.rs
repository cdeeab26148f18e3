//! Files to plain buffers and back: OBJ, glTF, PLY, EXR, Radiance HDR, PNG; JPEG and WebP of models.

pub mod atomic;
pub mod bundle;
pub mod cache;
pub mod colour;
pub mod environment;
pub mod exr;
pub mod exr_write;
pub mod gltf;
pub mod hdr;
pub mod obj;
pub mod photo;
mod picture;
pub mod ply;
pub mod png;
pub mod polygon;
#[cfg(test)]
mod reader_tests;
