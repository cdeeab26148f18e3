//! Rows of irradiance over the directions of a cube map, one for each sample, for light from far away: a companion of forms whose
//! evaluators light samples.

mod bake;
#[cfg(feature = "gpu")]
pub mod gpu;
mod settings;
mod source_fields;
mod stored;

use translux_format::Tag;
use translux_format::rows::tags;

use crate::evaluate::SourceFields;
pub use bake::{ahead, bake};
pub use settings::EnvironmentRows;
pub use stored::{BY_RAYS, IN_ROWS, StoredRows, by_rays, sampled};

/// Source radiance fields that area lights may have in the media of the bake, by the sections of the asset.
pub fn source_fields(has: &dyn Fn(Tag) -> bool) -> SourceFields {
    if has(tags::COUNTS) { SourceFields::Any } else { SourceFields::None }
}
