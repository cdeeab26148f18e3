//! Reflection at the surface as a person asks for it.

use crate::error::{Error, Result};

/// Reflection at the surface.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
#[serde(transparent)]
pub struct Gloss(Option<f64>);

impl Gloss {
    /// No reflection.
    pub const NONE: Self = Self(None);

    /// Of a perceptual roughness in [0, 1], the square root of the width alpha of the GGX lobe; cut to the range.
    pub fn of_roughness(roughness: f64) -> Self {
        Self(Some(if roughness.is_finite() { roughness.clamp(0.0, 1.0) } else { 1.0 }))
    }

    /// The roughness, if there is a reflection.
    pub fn roughness(self) -> Option<f64> {
        self.0
    }
}

/// As of skin, wax and polished stone.
impl Default for Gloss {
    fn default() -> Self {
        Self(Some(0.3))
    }
}

impl std::str::FromStr for Gloss {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let trimmed = text.trim();
        match trimmed.parse::<f64>() {
            _ if trimmed == "none" => Ok(Self::NONE),
            Ok(roughness) if (0.0..=1.0).contains(&roughness) => Ok(Self::of_roughness(roughness)),
            _ => Err(Error::command_line(format!(
                "roughness `{trimmed}`: type a number from 0 (polished) to 1 (matt), or none for no reflection"
            ))),
        }
    }
}

impl std::fmt::Display for Gloss {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.0 {
            Some(roughness) => write!(f, "{roughness}"),
            None => f.write_str("none"),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn text_forms() {
        for text in ["none", "0", "0.3", "1"] {
            assert_eq!(text.parse::<Gloss>().unwrap().to_string(), text);
        }
        for bad in ["", "-0.1", "1.5", "nan", "shiny"] {
            assert!(bad.parse::<Gloss>().unwrap_err().message().contains("none"), "{bad}");
        }
    }
}
