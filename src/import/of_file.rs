//! Media that a model's own file describes, for the materials of which nobody else says what they are made of.

use glam::DVec3;

use super::size::digits;
use crate::error::{Error, Result};
use crate::math::srgb::hex_from_linear;
use crate::medium::inversion::Reflector;
use crate::medium::material_file::Chosen;
use crate::medium::volume::{Inside, Scattering, Volume};

/// Mean free paths across an object in a proposal: it shows that it is translucent.
const FREE_PATHS: f64 = 50.0;

/// What a model's file says of its materials.
#[derive(Clone, Copy, Debug)]
pub struct OfFile<'a> {
    /// Names of the materials.
    pub materials: &'a [String],
    /// What the file says of the inside of each; those beyond the end have a surface only.
    pub insides: &'a [Inside],
    /// Millimetres in one unit of the file.
    pub mm_per_unit: f64,
    /// Diagonal of the model in mm.
    pub diagonal_mm: f64,
}

/// A material of which only the file speaks, and what became of it.
#[derive(Clone, Debug, PartialEq)]
pub struct FromFile {
    /// Name of the material.
    pub name: String,
    /// Its medium; none where it is opaque, as the file says nothing of its inside and others have media.
    pub chosen: Option<Chosen>,
    /// The extension that describes the medium.
    pub source: Option<&'static str>,
    /// Multi-scatter albedo that the file asks for, linear sRGB, and the colour of the medium under constant light; none where
    /// the medium was found for a look.
    pub albedo_and_colour: Option<[DVec3; 2]>,
    /// What the file says otherwise than the medium has it, one line each.
    pub warnings: Vec<String>,
}

impl FromFile {
    /// The choice in words, for the notes of a scene's origin.
    pub fn note(&self) -> String {
        match self.source {
            Some(source) => format!("material '{}': the medium of the file ({source})", self.name),
            None => format!("material '{}': opaque, of no medium in the file", self.name),
        }
    }
}

impl<'a> OfFile<'a> {
    /// A model of which the file says nothing more than names.
    pub fn nothing(materials: &'a [String]) -> Self {
        Self { materials, insides: &[], mm_per_unit: 1.0, diagonal_mm: 1.0 }
    }

    fn inside(&self, name: &str) -> &Inside {
        let index = self.materials.iter().position(|known| known == name);
        index.and_then(|index| self.insides.get(index)).unwrap_or(&Inside::Surface)
    }

    /// The media of these materials, each once; none at all where the file gives none of them an inside.
    ///
    /// # Errors
    /// Invalid input: values that make no medium. Command line: a material that scatters over an unknown length, or clear glass.
    pub fn media(&self, names: &[&str], reflector: &Reflector) -> Result<Vec<FromFile>> {
        if names.iter().all(|name| *self.inside(name) == Inside::Surface) {
            return Ok(Vec::new());
        }
        let found = names.iter().map(|name| self.medium(name, reflector)).collect::<Result<Vec<_>>>()?;
        // Each of its own would ask for one command after another.
        let missing: Vec<String> = names.iter().filter_map(|name| self.missing(name)).collect();
        if missing.is_empty() { Ok(found) } else { Err(Error::command_line(missing.join("; "))) }
    }

    fn medium(&self, name: &str, reflector: &Reflector) -> Result<FromFile> {
        let name = name.to_owned();
        let place = |e: Error| {
            e.at(format_args!(
                "material '{name}' (correct the file, or say what it is made of: --material '{name}=wax')"
            ))
        };
        match self.inside(&name) {
            Inside::Invalid(why) => Err(place(Error::input(why.clone()))),
            Inside::Volume(volume) => {
                let chosen = volume.chosen(&name, self.mm_per_unit, reflector).map_err(place)?;
                let Volume { source, scattering, warnings, .. } = volume;
                let albedo_and_colour = match scattering {
                    Scattering::Albedo { multiple, .. } => {
                        Some([*multiple, reflector.colour(&chosen.material.properties)?])
                    }
                    Scattering::Colour(_) => None,
                };
                let (source, warnings) = (Some(*source), warnings.clone());
                Ok(FromFile { name, chosen: Some(chosen), source, albedo_and_colour, warnings })
            }
            Inside::Surface | Inside::Clear | Inside::WithoutLength { .. } => {
                Ok(FromFile { name, chosen: None, source: None, albedo_and_colour: None, warnings: Vec::new() })
            }
        }
    }

    /// What is to be said of a material that is translucent, and that the file does not make a medium.
    fn missing(&self, name: &str) -> Option<String> {
        match self.inside(name) {
            Inside::Clear => Some(format!(
                "material '{name}' lets light through without scattering it, as clear glass does, which is not supported: leave it out \
                 (--skip '{name}'), let it cast shadows (--opaque '{name}'), or say what else it is made of (--material '{name}=wax')"
            )),
            Inside::WithoutLength { source, colour } => {
                let (colour, radius) = (hex_from_linear(*colour), digits(self.diagonal_mm / FREE_PATHS, 1));
                Some(format!(
                    "material '{name}' scatters light inside ({source}), and the file does not say how far (attenuationDistance of \
                     KHR_materials_volume): say --color '{colour}' --radius-mm {radius} for example, or --material '{name}=wax'"
                ))
            }
            Inside::Surface | Inside::Volume(_) | Inside::Invalid(_) => None,
        }
    }
}
