//! The text forms of cameras (`at=0,8,75:look=0,0,0:up=0,1,0:fov=28`) and resolutions (`1024x768`).

use std::fmt;
use std::str::FromStr;

use glam::DVec3;

use super::camera::{
    Camera, DEFAULT_FOV_DEGREES, Resolution, View, centre_mm, checked_fov, checked_vector, default_up,
};
use crate::error::{Error, Result};
use crate::geometry::mesh::Mesh;

const EXAMPLE: &str = "at=0,8,75:look=0,0,0:up=0,1,0:fov=28";

/// A camera as typed: every key is optional.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CameraSpec {
    /// Position of the eye in mm; by default the whole mesh is in the picture, as the view says.
    pub at_mm: Option<DVec3>,
    /// Side from which the mesh is seen where there is no position.
    pub view: View,
    /// The point in the middle of the picture, in mm; default: the centre of the mesh's bounding box.
    pub look_mm: Option<DVec3>,
    /// The direction that is up in the picture; default: +Y, or -Z for a view straight down and +Z for one straight up.
    pub up: Option<DVec3>,
    /// Vertical field of view in degrees; default: [`DEFAULT_FOV_DEGREES`].
    pub fov_degrees: Option<f64>,
}

impl CameraSpec {
    /// Fills in the keys that were not given.
    ///
    /// # Errors
    /// As [`Camera::new`] (exit 1).
    pub fn resolve(&self, mesh: &Mesh, resolution: Resolution) -> Result<Camera> {
        let look_mm = self.look_mm.unwrap_or_else(|| centre_mm(mesh));
        let fov_degrees = self.fov_degrees.unwrap_or(DEFAULT_FOV_DEGREES);
        let forward = self.at_mm.map_or(-self.view.direction(), |at| look_mm - at);
        let up = self.up.unwrap_or_else(|| default_up(forward));
        match self.at_mm {
            Some(at_mm) => Camera::new(at_mm, look_mm, up, fov_degrees),
            None => Camera::framing_from(mesh, resolution, self.view.direction(), look_mm, up, fov_degrees),
        }
        .map_err(with_example)
    }
}

/// Reads `key=value` pairs separated by colons.
impl FromStr for CameraSpec {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        read(text.trim()).map_err(|e| with_example(e).at(format!("camera `{}`", text.trim())))
    }
}

fn read(text: &str) -> Result<CameraSpec> {
    if text.is_empty() {
        return Err(Error::command_line("it is empty"));
    }
    let mut spec = CameraSpec::default();
    for pair in text.split(':') {
        let (key, value) = pair
            .split_once('=')
            .map(|(key, value)| (key.trim(), value.trim()))
            .ok_or_else(|| Error::command_line(format!("`{pair}` is not key=value")))?;
        match key {
            "at" => set(&mut spec.at_mm, key, vector(key, value)?)?,
            "look" => set(&mut spec.look_mm, key, vector(key, value)?)?,
            "up" => set(&mut spec.up, key, vector(key, value)?)?,
            "fov" => set(&mut spec.fov_degrees, key, checked_fov(number(key, value, value)?)?)?,
            _ => return Err(Error::command_line(format!("`{key}` is not one of its keys (at, look, up, fov)"))),
        }
    }
    if let (Some(at), Some(look)) = (spec.at_mm, spec.look_mm) {
        let up = spec.up.unwrap_or_else(|| default_up(look - at));
        Camera::new(at, look, up, spec.fov_degrees.unwrap_or(DEFAULT_FOV_DEGREES))?;
    }
    Ok(spec)
}

fn set<T>(slot: &mut Option<T>, key: &str, value: T) -> Result<()> {
    match slot.replace(value) {
        Some(_) => Err(Error::command_line(format!("`{key}` is given twice"))),
        None => Ok(()),
    }
}

fn vector(key: &str, value: &str) -> Result<DVec3> {
    let parts: Vec<&str> = value.split(',').collect();
    let &[x, y, z] = parts.as_slice() else {
        let count = parts.len();
        return Err(Error::command_line(format!("{key} takes X,Y,Z, not {count} numbers, and it is `{value}`")));
    };
    let component = |part| number(key, value, part);
    checked_vector(key, DVec3::new(component(x)?, component(y)?, component(z)?))
}

/// The number of a part of a key's value.
fn number(key: &str, value: &str, part: &str) -> Result<f64> {
    let part = part.trim();
    let what = match part.parse::<f64>() {
        Ok(number) if number.is_finite() => return Ok(number),
        Ok(_) => "finite",
        Err(_) => "a number",
    };
    Err(Error::command_line(format!("`{part}` is not {what} in {key}={value}")))
}

fn with_example(error: Error) -> Error {
    if error.message().contains("type for example") {
        return error;
    }
    Error::new(error.code(), format!("{}; type for example {EXAMPLE}", error.message()))
}

/// Reads `WIDTHxHEIGHT`, or one number for a square.
impl FromStr for Resolution {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let trimmed = text.trim();
        let side = |part: &str| {
            part.trim().parse::<usize>().map_err(|_| {
                Error::command_line(format!("resolution `{trimmed}`: type WIDTHxHEIGHT, for example 1024x768"))
            })
        };
        match trimmed.split_once(['x', 'X']) {
            Some((width, height)) => Self::new(side(width)?, side(height)?),
            None => side(trimmed).and_then(|n| Self::new(n, n)),
        }
    }
}

impl fmt::Display for Resolution {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.width, self.height)
    }
}
