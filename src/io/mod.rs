//! Files to plain buffers and back: OBJ, glTF, PLY, EXR, Radiance HDR, PNG.

pub mod atomic;
pub mod obj;
pub mod ply;
pub mod polygon;
