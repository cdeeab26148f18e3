//! Material files: TOML text to a material, every error with its line and column.

use std::fmt;
use std::io::Read;
use std::ops::Range;
use std::path::Path;

use glam::DVec3;
use serde::de::{Deserialize, Deserializer, Error as _, SeqAccess, Visitor};
use toml::Spanned;

use super::material::{Material, OpticalProperties, Overrides, Preset, preset, unknown_preset};
use crate::error::{Error, Result};

impl Material {
    /// The material that `--material` names: a preset, or a path that ends in `.toml` (see [`Material::from_file`]).
    ///
    /// # Errors
    /// Command line when there is no such preset (with similar names); otherwise those of [`Material::from_file`].
    pub fn from_argument(argument: &str) -> Result<Self> {
        let path = Path::new(argument);
        if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml")) {
            return Self::from_file(path);
        }
        preset(argument).map(Preset::material).ok_or_else(|| Error::command_line(unknown_preset(argument)))
    }

    /// Reads a material file (TOML). The name defaults to the file's.
    ///
    /// Keys: `name`; `preset` (start from it); `sigma_s_reduced_per_mm` or `sigma_s_per_mm` (unreduced, with `g`);
    /// `sigma_a_per_mm`; `g` (0); `eta` (1.3). Coefficients are one number or three (RGB), in 1/mm.
    ///
    /// # Errors
    /// I/O when it cannot be read; invalid input, with path, line and column, for its contents.
    pub fn from_file(path: &Path) -> Result<Self> {
        let text = read_text(path, "material file", 1)?;
        let stem = path.file_stem().map_or_else(|| "custom".into(), |stem| stem.to_string_lossy().into_owned());
        parse(&text, &path.display().to_string(), &stem)
    }

    /// The material of `--material`, if given, changed by `--sigma-s` (unreduced), `--sigma-a`, `--g` and `--eta`.
    /// Its name gets a `*` when anything of a base was changed.
    ///
    /// # Errors
    /// Command line when the result is incomplete or not valid.
    pub fn from_flags(base: Option<Self>, overrides: &Overrides) -> Result<Self> {
        let properties = overrides
            .apply(base.as_ref().map(|material| &material.properties))
            .map_err(|error| Error::command_line(error.message()))?;
        let name = match base {
            None => "custom".to_owned(),
            Some(material) if material.properties == properties => material.name,
            Some(material) => format!("{}*", material.name),
        };
        Ok(Self { name, properties })
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
}

/// One number for all channels, or three.
#[derive(Clone, Copy)]
pub(super) struct Channels(pub(super) DVec3);

impl<'de> Deserialize<'de> for Channels {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        deserializer.deserialize_any(ChannelsVisitor)
    }
}

struct ChannelsVisitor;

impl<'de> Visitor<'de> for ChannelsVisitor {
    type Value = Channels;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("one number or [red, green, blue] in 1/mm")
    }

    fn visit_f64<E>(self, value: f64) -> std::result::Result<Channels, E> {
        Ok(Channels(DVec3::splat(value)))
    }

    fn visit_i64<E>(self, value: i64) -> std::result::Result<Channels, E> {
        Ok(Channels(DVec3::splat(value as f64)))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut sequence: A) -> std::result::Result<Channels, A::Error> {
        let mut values: Vec<f64> = Vec::with_capacity(3);
        while let Some(value) = sequence.next_element()? {
            values.push(value);
        }
        <[f64; 3]>::try_from(values.as_slice())
            .map(|values| Channels(DVec3::from_array(values)))
            .map_err(|_| A::Error::invalid_length(values.len(), &self))
    }
}

/// The text of a file of at most `most_mib` MiB, since a path given by mistake must not fill the memory; errors name the
/// expected `kind` of file.
pub(super) fn read_text(path: &Path, kind: &str, most_mib: u64) -> Result<String> {
    let file = std::fs::File::open(path).map_err(|error| Error::io(path, &error))?;
    let mut bytes = Vec::new();
    file.take((most_mib << 20) + 1).read_to_end(&mut bytes).map_err(|error| Error::io(path, &error))?;
    let wrong = |what: &str| Error::input(format!("{what}, so this is no {kind}")).in_file(path);
    if bytes.len() as u64 > most_mib << 20 {
        return Err(wrong(&format!("longer than {most_mib} MiB")));
    }
    String::from_utf8(bytes).map_err(|_| wrong("not UTF-8 text"))
}

/// `line:column` of a byte offset, both from 1, columns in characters.
pub(super) fn position(text: &str, offset: usize) -> String {
    let before = text.get(..offset).unwrap_or(text);
    let line = before.matches('\n').count() + 1;
    let column = before.rsplit('\n').next().map_or(0, |line| line.chars().count()) + 1;
    format!("{line}:{column}")
}

/// The material that `text` describes; `place` names the text in errors, `name` is used where the text has none.
pub(super) fn parse(text: &str, place: &str, name: &str) -> Result<Material> {
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
    let properties = apply(&file, base).map_err(|(span, error)| at(span, error))?;
    Ok(Material { name: file.name.unwrap_or_else(|| name.to_owned()), properties })
}

pub(super) fn one_line(message: &str) -> String {
    message.split('\n').map(str::trim).collect::<Vec<_>>().join(", ")
}

fn span<T>(value: &Option<Spanned<T>>) -> Option<Range<usize>> {
    value.as_ref().map(Spanned::span)
}

/// Applies one key after another, so that an error names the key with the invalid value.
fn apply(file: &File, base: Option<&Preset>) -> std::result::Result<OpticalProperties, (Option<Range<usize>>, Error)> {
    let channels = |value: &Option<Spanned<Channels>>| value.as_ref().map(|value| value.get_ref().0);
    let whole = Overrides {
        sigma_s_reduced_per_mm: channels(&file.sigma_s_reduced_per_mm),
        sigma_s_per_mm: channels(&file.sigma_s_per_mm),
        sigma_a_per_mm: channels(&file.sigma_a_per_mm),
        g: file.g.as_ref().map(|g| *g.get_ref()),
        eta_inside_over_outside: file.eta.as_ref().map(|eta| *eta.get_ref()),
    };
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
