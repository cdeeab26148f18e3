//! Media that a model's own file describes, for the materials of which nobody else says what they are made of.

use glam::DVec3;

use super::size::digits;
use crate::error::{Error, Result};
use crate::math::srgb::hex_from_linear;
use crate::medium::inversion::{RADII_MM, Reflector};
use crate::medium::look::Look;
use crate::medium::material::Overrides;
use crate::medium::material_file::Chosen;
use crate::medium::volume::{Inside, Scattering, Volume};

/// Mean free paths across an object in a proposal: it shows that it is translucent.
const FREE_PATHS: f64 = 50.0;

/// Colour of a guessed medium: light, so that base colours over it are seen, and not so clear that light reaches everywhere.
const GUESSED_COLOUR: f64 = 0.8;

/// Name of a guessed medium of which the file does not even give the colour.
const GUESSED: &str = "guessed";

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
    /// The extension that describes the medium; none where it is guessed or there is none.
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
        let name = &self.name;
        match self.source {
            Some(source) => format!("material '{name}': the medium of the file ({source})"),
            None if self.is_guessed() => format!("material '{name}': a guessed medium, as the file does not say which"),
            None => format!("material '{name}': opaque, of no medium in the file"),
        }
    }

    /// Whether the medium is a guess that the size of the model gave.
    pub fn is_guessed(&self) -> bool {
        self.source.is_none() && self.chosen.is_some()
    }

    /// Whether the colour of that medium is a guess as well: base colours lie over it, and are part of one that the file gives.
    pub fn is_of_guessed_colour(&self) -> bool {
        self.is_guessed() && self.chosen.as_ref().is_some_and(|chosen| chosen.material.name == GUESSED)
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

    /// The media of these materials, each once. Where the file gives none of them an inside: none at all, or with `guess` a guessed one
    /// for all.
    ///
    /// # Errors
    /// Invalid input: values that make no medium. Command line: clear glass, and without `guess` a material that scatters over an unknown
    /// length.
    pub fn media(&self, names: &[&str], reflector: &Reflector, guess: bool) -> Result<Vec<FromFile>> {
        let has_surface = |name: &&str| *self.inside(name) == Inside::Surface;
        if names.iter().all(has_surface) {
            return match guess {
                true => names.iter().map(|name| self.guessed(name, None, reflector)).collect(),
                false => Ok(Vec::new()),
            };
        }
        let found = names.iter().map(|name| self.medium(name, reflector, guess)).collect::<Result<Vec<_>>>()?;
        // All at once: each of its own would ask for one command after another.
        let without_length = if guess { None } else { self.without_length(names) };
        let missing: Vec<String> = self.clear(names).into_iter().chain(without_length).collect();
        if missing.is_empty() { Ok(found) } else { Err(Error::command_line(missing.join("; "))) }
    }

    /// A medium that is translucent at the size of the model, of the colour that the file gives or nearly white.
    fn guessed(&self, name: &str, colour: Option<DVec3>, reflector: &Reflector) -> Result<FromFile> {
        let radius_mm = digits(self.diagonal_mm / FREE_PATHS, 1).clamp(*RADII_MM.start(), *RADII_MM.end());
        let look = Look {
            colour: Some(colour.unwrap_or(DVec3::splat(GUESSED_COLOUR))),
            radius_mm: Some(DVec3::splat(radius_mm)),
            radius: None,
        };
        let mut chosen = Chosen::from_flags(None, &Overrides::default(), &look, reflector)?;
        chosen.material.name = if colour.is_some() { name } else { GUESSED }.to_owned();
        let (name, chosen) = (name.to_owned(), Some(chosen));
        Ok(FromFile { name, chosen, source: None, albedo_and_colour: None, warnings: Vec::new() })
    }

    fn medium(&self, name: &str, reflector: &Reflector, guess: bool) -> Result<FromFile> {
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
            Inside::WithoutLength { colour, .. } if guess => self.guessed(&name, Some(*colour), reflector),
            Inside::Surface | Inside::Clear | Inside::WithoutLength { .. } => {
                Ok(FromFile { name, chosen: None, source: None, albedo_and_colour: None, warnings: Vec::new() })
            }
        }
    }

    /// What is to be said of materials that light goes through as it does through glass.
    fn clear(&self, names: &[&str]) -> Option<String> {
        let clear: Vec<&str> = names.iter().copied().filter(|name| *self.inside(name) == Inside::Clear).collect();
        let first = clear.first()?;
        let (quoted, all) = (quoted(&clear), clear.join(","));
        Some(format!(
            "{quoted} lets light through without scattering it, as clear glass does, which is not supported: leave it out (--skip '{all}'), let it \
             cast shadows (--opaque '{all}'), or say what else it is made of (--material '{first}=wax')"
        ))
    }

    /// What is to be said of materials that scatter over a length that the file does not give.
    fn without_length(&self, names: &[&str]) -> Option<String> {
        let of_file = |name| match self.inside(name) {
            Inside::WithoutLength { source, colour } => Some((name, *source, hex_from_linear(*colour))),
            _ => None,
        };
        let thin: Vec<(&str, &str, String)> = names.iter().copied().filter_map(of_file).collect();
        let (first, source, colour) = thin.first()?;
        let quoted = quoted(&thin.iter().map(|(name, ..)| *name).collect::<Vec<_>>());
        let radius = digits(self.diagonal_mm / FREE_PATHS, 1);
        // A look on the command line is one for all, and takes the place of media that the file does describe.
        let for_all = match names.iter().any(|name| matches!(self.inside(name), Inside::Volume(_))) {
            true => {
                format!("or a file with color = \"{colour}\" and radius_mm = {radius} (--material '{first}=FILE.toml')")
            }
            false => format!("or for all materials for example --color '{colour}' --radius-mm {radius}"),
        };
        Some(format!(
            "{quoted} scatters light inside ({source}), and the file does not say how far (attenuationDistance of KHR_materials_volume): say what it \
             is made of (--material '{first}=wax'), {for_all}"
        ))
    }
}

/// Names of materials in a sentence.
fn quoted(names: &[&str]) -> String {
    match names {
        [name] => format!("material '{name}'"),
        _ => format!("each of the materials '{}'", names.join("', '")),
    }
}
