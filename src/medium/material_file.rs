//! Material files: TOML text to a material, every error with its line and column.

use std::fmt;
use std::ops::Range;
use std::path::Path;

use glam::DVec3;
use serde::de::{Deserialize, Deserializer, SeqAccess, Visitor};
use toml::Spanned;

use super::inversion::{RADII_MM, Radius, Reflector};
use super::look::{Found, Look};
use super::material::{Material, OpticalProperties, Overrides, Preset, preset, unknown_preset};
use super::toml_text::{Channels, one_line, position, read_text, three};
use crate::error::{Error, ExitCode, Result};
use crate::math::srgb::linear_from_hex;

/// A material as it was chosen.
#[derive(Clone, Debug, PartialEq)]
pub struct Chosen {
    /// Name and properties.
    pub material: Material,
    /// The look that the properties were found for, where they were not given.
    pub look: Option<Found>,
}

impl From<Material> for Chosen {
    fn from(material: Material) -> Self {
        Self { material, look: None }
    }
}

impl Chosen {
    /// The material that `--material` names: a preset, or a path that ends in `.toml` (see [`Chosen::from_file`]).
    ///
    /// # Errors
    /// Command line when there is no such preset (with similar names); otherwise those of [`Chosen::from_file`].
    pub fn from_argument(argument: &str, reflector: &Reflector) -> Result<Self> {
        let path = Path::new(argument);
        if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml")) {
            return Self::from_file(path, reflector);
        }
        let found = preset(argument).ok_or_else(|| Error::command_line(unknown_preset(argument)))?;
        Ok(found.material().into())
    }

    /// Reads a material file (TOML). The name defaults to the file's.
    ///
    /// Keys: `name`; `preset` (start from it); `sigma_s_reduced_per_mm` or `sigma_s_per_mm` (unreduced, with `g`);
    /// `sigma_a_per_mm`; `g` (0); `eta` (1.3). Coefficients are one number or three (RGB), in 1/mm. In their place a look:
    /// `color` (`"#e8c4b0"`, or linear sRGB as a number or three), `radius_mm` (a number or three) and `radius_convention`
    /// (the words of [`Radius`]), inverted through `reflector`.
    ///
    /// # Errors
    /// I/O when it cannot be read; invalid input, with path, line and column, for its contents; those of
    /// [`Look::found`].
    pub fn from_file(path: &Path, reflector: &Reflector) -> Result<Self> {
        let text = read_text(path, "material file", 1)?;
        let stem = path.file_stem().map_or_else(|| "custom".into(), |stem| stem.to_string_lossy().into_owned());
        parse(&text, (&path.display().to_string(), &stem), reflector)
    }

    /// The material of `--material`, if given, changed by `--sigma-s` (unreduced), `--sigma-a`, `--g` and `--eta`, or by
    /// `--color` and `--radius-mm`. Its name gets a `*` when anything of a base was changed.
    ///
    /// # Errors
    /// Command line when the result is incomplete or not valid; otherwise those of [`Look::found`].
    pub fn from_flags(base: Option<Self>, overrides: &Overrides, look: &Look, reflector: &Reflector) -> Result<Self> {
        let properties = base.as_ref().map(|base| &base.material.properties);
        let found = match look.is_empty() {
            true => None,
            false => Some(look.found(properties, overrides, reflector)),
        };
        let typed = |error: Error| match error.code() {
            ExitCode::InvalidInput => Error::command_line(error.message()),
            _ => error,
        };
        let found = found.transpose().map_err(typed)?;
        let properties = match &found {
            Some(found) => found.inversion.properties,
            None => overrides.apply(properties).map_err(typed)?,
        };
        Ok(match base {
            None => Self { material: Material { name: "custom".to_owned(), properties }, look: found },
            // A look that a file asked for is what was chosen, unless something of it was changed.
            Some(base) if base.material.properties == properties => Self { look: found.or(base.look), ..base },
            Some(base) => {
                Self { material: Material { name: format!("{}*", base.material.name), properties }, look: found }
            }
        })
    }
}

/// The keys as written.
#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    name: Option<String>,
    preset: Option<Spanned<String>>,
    sigma_s_reduced_per_mm: Option<Spanned<Channels>>,
    sigma_s_per_mm: Option<Spanned<Channels>>,
    sigma_a_per_mm: Option<Spanned<Channels>>,
    g: Option<Spanned<f64>>,
    eta: Option<Spanned<f64>>,
    color: Option<Spanned<Colour>>,
    radius_mm: Option<Spanned<Channels>>,
    radius_convention: Option<Spanned<String>>,
}

/// A colour as text or as linear channels.
#[derive(Clone, Copy)]
struct Colour(DVec3);

impl<'de> Deserialize<'de> for Colour {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        deserializer.deserialize_any(ColourVisitor)
    }
}

struct ColourVisitor;

impl ColourVisitor {
    /// A colour of channels that are in range.
    fn of<E: serde::de::Error>(channels: DVec3) -> std::result::Result<Colour, E> {
        if channels.is_finite() && channels.min_element() >= 0.0 && channels.max_element() <= 1.0 {
            return Ok(Colour(channels));
        }
        Err(E::custom(format!("the colour is {channels}; linear channels are between 0 and 1")))
    }
}

impl<'de> Visitor<'de> for ColourVisitor {
    type Value = Colour;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a colour as \"#e8c4b0\" (sRGB), or linear light as one number or [red, green, blue]")
    }

    fn visit_str<E: serde::de::Error>(self, text: &str) -> std::result::Result<Colour, E> {
        linear_from_hex(text).map(Colour).ok_or_else(|| E::invalid_value(serde::de::Unexpected::Str(text), &self))
    }

    fn visit_f64<E: serde::de::Error>(self, value: f64) -> std::result::Result<Colour, E> {
        Self::of(DVec3::splat(value))
    }

    fn visit_i64<E: serde::de::Error>(self, value: i64) -> std::result::Result<Colour, E> {
        Self::of(DVec3::splat(value as f64))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, sequence: A) -> std::result::Result<Colour, A::Error> {
        Self::of(three(sequence, &self)?)
    }
}

/// The material that `text` describes; `place` names the text in errors, `name` is used where the text has none.
pub(super) fn parse(text: &str, (place, name): (&str, &str), reflector: &Reflector) -> Result<Chosen> {
    let at = |span: Option<Range<usize>>, error: Error| match span {
        Some(span) => error.at(format!("{place}:{}", position(text, span.start))),
        None => error.at(place),
    };
    let file: File = toml::from_str(text).map_err(|error| at(error.span(), Error::input(one_line(error.message()))))?;
    let base = match &file.preset {
        None => None,
        Some(wanted) => match preset(wanted.get_ref()) {
            Some(preset) => Some(preset),
            None => return Err(at(Some(wanted.span()), Error::input(unknown_preset(wanted.get_ref())))),
        },
    };
    let radius = match &file.radius_convention {
        None => None,
        Some(word) => {
            let radius = word.get_ref().parse::<Radius>();
            Some(radius.map_err(|error| at(Some(word.span()), Error::input(error.message())))?)
        }
    };
    let look = Look {
        colour: file.color.as_ref().map(|colour| colour.get_ref().0),
        radius_mm: file.radius_mm.as_ref().map(|lengths| lengths.get_ref().0),
        radius,
    };
    let name = file.name.clone().unwrap_or_else(|| name.to_owned());
    if look.is_empty() {
        let properties = apply(&file, base).map_err(|(span, error)| at(span, error))?;
        return Ok(Material { name, properties }.into());
    }
    let is_long = |lengths: &Spanned<Channels>| lengths.get_ref().0.to_array().iter().all(|mm| RADII_MM.contains(mm));
    let blamed = file.radius_mm.as_ref().filter(|lengths| !is_long(lengths)).map(Spanned::span);
    let blamed = blamed.or(span(&file.color)).or(span(&file.radius_mm)).or(span(&file.radius_convention));
    let base = base.map(Preset::properties);
    let found = look.found(base.as_ref(), &overrides(&file), reflector).map_err(|error| at(blamed, error))?;
    Ok(Chosen { material: Material { name, properties: found.inversion.properties }, look: Some(found) })
}

fn span<T>(value: &Option<Spanned<T>>) -> Option<Range<usize>> {
    value.as_ref().map(Spanned::span)
}

/// What a file says of coefficients.
fn overrides(file: &File) -> Overrides {
    let channels = |value: &Option<Spanned<Channels>>| value.as_ref().map(|value| value.get_ref().0);
    Overrides {
        sigma_s_reduced_per_mm: channels(&file.sigma_s_reduced_per_mm),
        sigma_s_per_mm: channels(&file.sigma_s_per_mm),
        sigma_a_per_mm: channels(&file.sigma_a_per_mm),
        g: file.g.as_ref().map(|g| *g.get_ref()),
        eta_inside_over_outside: file.eta.as_ref().map(|eta| *eta.get_ref()),
    }
}

/// Applies one key after another, so that an error names the key with the invalid value.
fn apply(file: &File, base: Option<&Preset>) -> std::result::Result<OpticalProperties, (Option<Range<usize>>, Error)> {
    let whole = overrides(file);
    let base = base.map(Preset::properties);
    whole.apply(base.as_ref()).map_err(|error| {
        let harmless = OpticalProperties {
            sigma_s_reduced_per_mm: DVec3::ONE,
            sigma_a_per_mm: DVec3::ONE,
            g: 0.0,
            eta_inside_over_outside: 1.0,
        };
        let none = Overrides::default();
        let alone = [
            (span(&file.g), Overrides { g: whole.g, ..none }),
            (
                span(&file.sigma_s_reduced_per_mm),
                Overrides { sigma_s_reduced_per_mm: whole.sigma_s_reduced_per_mm, ..none },
            ),
            (span(&file.sigma_s_per_mm), Overrides { sigma_s_per_mm: whole.sigma_s_per_mm, g: whole.g, ..none }),
            (span(&file.sigma_a_per_mm), Overrides { sigma_a_per_mm: whole.sigma_a_per_mm, ..none }),
            (span(&file.eta), Overrides { eta_inside_over_outside: whole.eta_inside_over_outside, ..none }),
        ];
        let blamed = alone
            .into_iter()
            .find_map(|(span, one)| span.and_then(|span| one.apply(Some(&harmless)).err().map(|error| (span, error))));
        match blamed {
            Some((span, error)) => (Some(span), error),
            None if whole.sigma_s_reduced_per_mm.is_some() && whole.sigma_s_per_mm.is_some() => {
                (span(&file.sigma_s_per_mm), error)
            }
            None => (None, error),
        }
    })
}
