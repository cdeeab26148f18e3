//! Rows of irradiance over the directions of a cube map, one for each sample, for light from far away: a companion of forms whose
//! evaluators light samples.

mod bake;
#[cfg(feature = "gpu")]
pub mod gpu;
mod settings;
mod source_fields;
mod stored;

pub use bake::bake;
pub use settings::EnvironmentRows;
pub use stored::{BY_RAYS, IN_ROWS, StoredRows, by_rays, sampled};
