//! Highlights: the models of specular reflection at the boundary of a medium, behind one set of functions.

use std::str::FromStr;

use glam::{DVec2, DVec3};

use super::blinn_phong::{BlinnPhong, DEFAULT_EXPONENT, Exponent};
use super::specular::{Ggx, Reflected};
use crate::error::{Error, Result};

/// Shape of a highlight, whatever its width.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum HighlightShape {
    /// The microfacet model of [`Ggx`].
    #[default]
    Ggx,
    /// The power of [`BlinnPhong`].
    BlinnPhong,
}

/// The model of highlights as it is typed: `ggx`, whose width is the roughness, or `blinn-phong:EXPONENT`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum HighlightModel {
    /// The microfacet model of [`Ggx`].
    #[default]
    Ggx,
    /// The power of [`BlinnPhong`].
    BlinnPhong(Exponent),
}

impl FromStr for HighlightModel {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let text = text.trim();
        if text == "ggx" {
            return Ok(Self::Ggx);
        }
        match text.split_once(':') {
            Some(("blinn-phong", exponent)) => exponent.parse().map(Self::BlinnPhong),
            _ => Err(Error::command_line(format!(
                "highlights `{text}`: type ggx or blinn-phong:EXPONENT, for example blinn-phong:{DEFAULT_EXPONENT}"
            ))),
        }
    }
}

impl std::fmt::Display for HighlightModel {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Ggx => f.write_str("ggx"),
            Self::BlinnPhong(exponent) => write!(f, "blinn-phong:{exponent}"),
        }
    }
}

/// The boundary of a medium, as it reflects.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Highlight {
    /// A rough dielectric boundary.
    Ggx(Ggx),
    /// A boundary with a power of the half vector's cosine.
    BlinnPhong(BlinnPhong),
}

impl Highlight {
    /// Reflected radiance over irradiance, in 1/sr; 0 where either unit direction is not above the surface.
    #[inline]
    pub fn brdf(&self, normal: DVec3, to_light: DVec3, to_eye: DVec3) -> f64 {
        match self {
            Self::Ggx(ggx) => ggx.brdf(normal, to_light, to_eye),
            Self::BlinnPhong(power) => power.brdf(normal, to_light, to_eye),
        }
    }

    /// Density, per steradian of `to_light`, of [`Highlight::sample`].
    #[inline]
    pub fn density_per_sr(&self, normal: DVec3, to_light: DVec3, to_eye: DVec3) -> f64 {
        let half = (to_light + to_eye).normalize_or_zero();
        match self {
            Self::Ggx(ggx) => ggx.density_per_sr(normal.dot(half), normal.dot(to_eye)),
            Self::BlinnPhong(power) => power.density_per_sr(normal.dot(half), half.dot(to_eye)),
        }
    }

    /// A direction reflected towards the eye, for two numbers in [0, 1); none where it is below the surface.
    ///
    /// `to_eye` is above the surface with this unit normal.
    #[inline]
    pub fn sample(&self, normal: DVec3, to_eye: DVec3, u: DVec2) -> Option<Reflected> {
        match self {
            Self::Ggx(ggx) => ggx.sample(normal, to_eye, u),
            Self::BlinnPhong(power) => power.sample(normal, to_eye, u),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn models_read_back_as_they_are_written() {
        for text in ["ggx", "blinn-phong:20", "blinn-phong:1.5", "blinn-phong:10000"] {
            assert_eq!(text.parse::<HighlightModel>().unwrap().to_string(), text);
        }
        for bad in ["", "phong:20", "blinn-phong", "blinn-phong:", "blinn-phong:0", "ggx:0.3", "blinn-phong:20:3"] {
            let error = bad.parse::<HighlightModel>().unwrap_err();
            assert!(error.message().contains("for example"), "{bad}: {error}");
        }
    }
}
