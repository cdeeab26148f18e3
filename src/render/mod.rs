//! Pictures of a lit scene: camera, exit radiance, auxiliary planes, exposure. Knows evaluators by their trait only.

pub mod background;
pub mod camera;
pub mod camera_text;
pub mod exit;
pub mod film;
pub mod frame;
pub(crate) mod normals;
mod pixel_samples;
