//! Files to plain buffers and back: OBJ, glTF, PLY, EXR, Radiance HDR, PNG.

pub mod gltf;
