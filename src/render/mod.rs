//! Pictures of a lit scene: camera, exit radiance, auxiliary planes, exposure. Evaluators are used through their trait
//! only.

pub mod background;
pub mod blinn_phong;
pub mod camera;
pub mod camera_text;
pub mod centres;
pub mod exit;
pub(crate) mod eye;
pub mod film;
pub mod frame;
mod glossy_lights;
mod glossy_map;
pub mod highlight;
mod lights;
mod matte;
pub mod normals;
mod pixel_samples;
mod seen;
mod settings;
pub mod single;
pub mod specular;
mod straight;
pub mod texture;
pub mod tone;
