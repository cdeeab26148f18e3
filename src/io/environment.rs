//! Environment maps from files: the first bytes decide the format, the pixels become linear sRGB radiance.

use std::path::Path;
use std::sync::Arc;

use glam::DVec3;

pub use super::picture::{LinearImage, MAX_DECODED_BYTES, MAX_FILE_BYTES};

use super::picture::read_capped;
use super::{exr, hdr};
use crate::error::{Error, Result};
use crate::light::Light;
use crate::light::environment::EnvironmentMap;
use crate::light::parse::{self, LightSpec, MapSource};

/// A loaded value with its warnings.
#[derive(Clone, Debug, PartialEq)]
pub struct Loaded<T> {
    /// The loaded value.
    pub value: T,
    /// Warnings, one line each, with the path in front.
    pub warnings: Vec<String>,
}

/// Reads an OpenEXR or Radiance HDR environment map.
///
/// # Errors
/// A file that cannot be read (exit 2), is damaged or holds values that are no radiance (exit 3), or uses a feature
/// that is not supported (exit 5); the path is in the message.
pub fn load_environment(path: &Path) -> Result<Loaded<EnvironmentMap>> {
    let place = path.display();
    let decoded = read_capped(path).and_then(|bytes| decode(&bytes).map_err(|e| e.at(place.to_string())))?;
    let LinearImage { width, height, pixels, mut warnings } = decoded;
    let (map, negatives) =
        EnvironmentMap::with_negatives_clamped(width, height, pixels).map_err(|e| e.at(place.to_string()))?;
    warnings.extend(negatives.map(|n| n.to_string()));
    if width != 2 * height {
        warnings.push(format!(
            "{width} x {height} pixels; an equirectangular map is twice as wide as high, so this one is stretched"
        ));
    }
    if map.energy() == DVec3::ZERO {
        warnings.push("every pixel is black".to_owned());
    }
    let warnings = warnings.into_iter().map(|w| format!("{place}: {w}")).collect();
    Ok(Loaded { value: map, warnings })
}

/// Makes the light that `spec` describes, reading its picture if it has one.
///
/// # Errors
/// Errors of [`load_environment`].
pub fn load_light(spec: &LightSpec) -> Result<Loaded<Light>> {
    let mut warnings = Vec::new();
    let load = |path: &Path| {
        let loaded = load_environment(path)?;
        warnings = loaded.warnings;
        Ok(Arc::new(loaded.value))
    };
    let value = spec.resolve(load).map_err(|e| with_hint(e, spec))?;
    Ok(Loaded { value, warnings })
}

/// Adds a hint to an error: a bare path may be a misspelt light, and a path with `:word=` a misspelt key.
fn with_hint(error: Error, spec: &LightSpec) -> Error {
    let LightSpec::Environment { source: MapSource::File(path), .. } = spec else { return error };
    if path.exists() {
        return error;
    }
    let hint = if path.to_string_lossy().split(':').skip(1).any(|part| part.contains('=')) {
        "an environment takes the keys path, rotate and scale".to_owned()
    } else {
        format!("a light is the path of a picture or one of: {}", parse::examples().collect::<Vec<_>>().join("  "))
    };
    Error::new(error.code(), format!("{} ({hint})", error.message()))
}

/// Decodes a picture; its first bytes decide the format.
///
/// # Errors
/// As [`load_environment`], without the path.
pub fn decode(bytes: &[u8]) -> Result<LinearImage> {
    if bytes.starts_with(&exr::MAGIC) {
        exr::decode_rgb(bytes)
    } else if bytes.starts_with(b"#?") {
        hdr::decode(bytes)
    } else if bytes.starts_with(b"\x89PNG") || bytes.starts_with(b"\xff\xd8\xff") {
        Err(Error::unsupported("an 8-bit picture holds no radiance; use an OpenEXR (.exr) or Radiance (.hdr) file"))
    } else if bytes.is_empty() {
        Err(Error::input("the file is empty; an environment is an OpenEXR (.exr) or Radiance (.hdr) picture"))
    } else {
        Err(Error::input("neither OpenEXR (.exr) nor Radiance (.hdr); convert the picture to one of them"))
    }
}

#[cfg(test)]
#[path = "environment_tests.rs"]
mod tests;
