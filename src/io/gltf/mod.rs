//! placeholder until the importer arrives
use crate::{error::*, geometry::source::SourceModel};
/// .
/// # Errors
/// .
pub fn read_gltf(_: &std::path::Path) -> Result<SourceModel> { Err(Error::unsupported("gltf")) }
