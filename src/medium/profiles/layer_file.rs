//! Layer files: TOML text to a stack of layers; errors name line and column.

use std::path::Path;

use toml::Spanned;

use super::layers::{Layer, MOST_LAYERS, THICKNESSES_MM};
use crate::error::{Error, Result};
use crate::medium::material::{OpticalProperties, Overrides, preset};
use crate::medium::toml_text::{Channels, one_line, position, read_text};

/// A layer of all channels; without properties it is of the medium that the profile is evaluated for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LayerSpec {
    /// Thickness in mm; none for a half space.
    pub thickness_mm: Option<f64>,
    /// Optical properties of the layer.
    pub properties: Option<OpticalProperties>,
}

impl LayerSpec {
    /// The layer of one channel (0 to 2).
    pub(super) fn channel(&self, medium: &OpticalProperties, channel: usize) -> Layer {
        let properties = self.properties.as_ref().unwrap_or(medium);
        Layer {
            thickness_mm: self.thickness_mm,
            sigma_s_reduced_per_mm: properties.sigma_s_reduced_per_mm[channel],
            sigma_a_per_mm: properties.sigma_a_per_mm[channel],
            eta_inside_over_outside: properties.eta_inside_over_outside,
        }
    }
}

/// The keys as written.
#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[serde(default)]
    layer: Vec<Spanned<Keys>>,
}

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Keys {
    thickness_mm: Option<Spanned<f64>>,
    preset: Option<String>,
    sigma_s_reduced_per_mm: Option<Channels>,
    sigma_s_per_mm: Option<Channels>,
    sigma_a_per_mm: Option<Channels>,
    g: Option<f64>,
    eta: Option<f64>,
}

/// Reads a stack: a table `[[layer]]` for each layer from the top, with the keys of a material file (`preset`,
/// `sigma_s_reduced_per_mm` or `sigma_s_per_mm`, `sigma_a_per_mm`, `g`, `eta`) and `thickness_mm`, which only the last
/// may leave out. A layer without a material is of the medium that the profile is evaluated for.
///
/// # Errors
/// I/O when it cannot be read; invalid input, with path, line and column, for its contents.
pub fn read(path: &Path) -> Result<Vec<LayerSpec>> {
    parse(&read_text(path, "layer file", 4)?, &path.display().to_string())
}

/// Like [`read`] for a text; `place` names it in errors.
pub(super) fn parse(text: &str, place: &str) -> Result<Vec<LayerSpec>> {
    let at = |start: usize, error: Error| error.at(format!("{place}:{}", position(text, start)));
    let file: File = toml::from_str(text)
        .map_err(|error| at(error.span().map_or(0, |span| span.start), Error::input(one_line(error.message()))))?;
    if file.layer.is_empty() || file.layer.len() > MOST_LAYERS {
        let count = file.layer.len();
        return Err(Error::input(format!("{count} tables [[layer]]; there must be 1 to {MOST_LAYERS}")).at(place));
    }
    let last = file.layer.len() - 1;
    let layers = file.layer.iter().enumerate().map(|(i, layer)| {
        let (start, keys) = (layer.span().start, layer.get_ref());
        match &keys.thickness_mm {
            None if i < last => {
                return Err(at(
                    start,
                    Error::input("thickness_mm is missing; only the last layer may be a half space"),
                ));
            }
            Some(thickness) if !THICKNESSES_MM.contains(thickness.get_ref()) => {
                let message = format!(
                    "thickness_mm is {}; it must be between {:e} and {:e}",
                    thickness.get_ref(),
                    THICKNESSES_MM.start(),
                    THICKNESSES_MM.end()
                );
                return Err(at(thickness.span().start, Error::input(message)));
            }
            _ => {}
        }
        let properties = material(keys).map_err(|error| at(start, error))?;
        Ok(LayerSpec { thickness_mm: keys.thickness_mm.as_ref().map(|t| *t.get_ref()), properties })
    });
    layers.collect()
}

/// The material of a layer, if it names one.
fn material(keys: &Keys) -> Result<Option<OpticalProperties>> {
    let named = |name: &String| match preset(name) {
        Some(preset) => Ok(preset.properties()),
        None => Err(Error::input(format!("no material is called '{name}'; `translux materials` lists them"))),
    };
    let base = keys.preset.as_ref().map(named).transpose()?;
    let overrides = Overrides {
        sigma_s_reduced_per_mm: keys.sigma_s_reduced_per_mm.map(|channels| channels.0),
        sigma_s_per_mm: keys.sigma_s_per_mm.map(|channels| channels.0),
        sigma_a_per_mm: keys.sigma_a_per_mm.map(|channels| channels.0),
        g: keys.g,
        eta_inside_over_outside: keys.eta,
    };
    if base.is_none() && overrides.is_empty() {
        return Ok(None);
    }
    overrides.apply(base.as_ref()).map(Some)
}
