//! The background beside the object: the lights at infinity, nothing, or a colour.

use std::str::FromStr;

use glam::DVec3;

use super::camera::xyz;
use crate::error::{Error, Result};
use crate::light::Light;
use crate::light::environment::{EnvironmentMap, Rotation};

/// The background beside the object.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Background {
    /// The environments and the constant lights; other lights are invisible.
    #[default]
    Environment,
    /// Black, and transparent in formats with transparency.
    None,
    /// Uniform radiance, linear sRGB.
    Colour(DVec3),
}

/// Reads `env`, `none`, a number or `R,G,B`.
impl FromStr for Background {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let fail = |what: &str| {
            let text = text.trim();
            Error::command_line(format!(
                "background `{text}`: {what}; type env, none or R,G,B, for example 0.1,0.1,0.1"
            ))
        };
        match text.trim() {
            "env" => return Ok(Self::Environment),
            "none" => return Ok(Self::None),
            _ => {}
        }
        let numbers: Vec<f64> = text
            .split(',')
            .map(|part| part.trim().parse::<f64>().map_err(|_| fail("it is none of these")))
            .collect::<Result<_>>()?;
        let colour = match numbers[..] {
            [grey] => DVec3::splat(grey),
            [r, g, b] => DVec3::new(r, g, b),
            _ => return Err(fail(&format!("a colour has one or three numbers, not {}", numbers.len()))),
        };
        // Written so that NaN fails as well.
        if !(colour.is_finite() && colour.min_element() >= 0.0) {
            return Err(fail("radiance must be finite and not negative"));
        }
        Ok(Self::Colour(colour + 0.0))
    }
}

impl std::fmt::Display for Background {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Environment => f.write_str("env"),
            Self::None => f.write_str("none"),
            Self::Colour(colour) => f.write_str(&xyz(*colour)),
        }
    }
}

/// A background ready for look-ups.
pub(super) struct Backdrop<'a> {
    constant: DVec3,
    maps: Vec<(&'a EnvironmentMap, Rotation, DVec3)>,
}

impl<'a> Backdrop<'a> {
    pub(super) fn new(background: Background, lights: &'a [Light]) -> Self {
        let mut backdrop = Self { constant: DVec3::ZERO, maps: Vec::new() };
        match background {
            Background::None => {}
            Background::Colour(colour) => backdrop.constant = colour,
            Background::Environment => {
                for light in lights {
                    match light {
                        Light::Constant { radiance } => backdrop.constant += *radiance,
                        Light::Environment { map, rotate_degrees, scale } => {
                            backdrop.maps.push((map, Rotation::from_degrees(*rotate_degrees), *scale));
                        }
                        Light::Directional { .. } | Light::Point { .. } | Light::Spot { .. } | Light::Area { .. } => {}
                    }
                }
            }
        }
        backdrop
    }

    /// Radiance that the eye receives from a unit direction.
    #[inline]
    pub(super) fn radiance(&self, direction: DVec3) -> DVec3 {
        let seen = |(map, rotation, scale): &(&EnvironmentMap, Rotation, DVec3)| {
            *scale * map.radiance_bilinear(rotation.to_map(direction))
        };
        self.constant + self.maps.iter().map(seen).sum::<DVec3>()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn text_forms_are_read_and_shown() {
        for text in ["env", "none", "0.25,0.5,1"] {
            assert_eq!(text.parse::<Background>().unwrap().to_string(), text);
        }
        assert_eq!("0.5".parse::<Background>().unwrap(), Background::Colour(DVec3::splat(0.5)));
        for bad in ["", "sky", "1,2", "1,2,3,4", "-1,0,0", "nan", "inf,0,0"] {
            let error = bad.parse::<Background>().unwrap_err();
            assert!(error.message().contains("type env, none or R,G,B"), "{bad}: {error}");
        }
    }
}
