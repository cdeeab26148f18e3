//! The text form of a light: `kind:key=value:key=value`, a bare path for an environment, or `sky`.
//!
//! A colon ends a value only where one of the kind's keys and `=` follow, so paths may hold colons.

use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::Arc;

use glam::DVec3;

use super::cone::Cone;
use super::environment::EnvironmentMap;
use super::validate::text as vector_text;
use super::{Light, sky, validate};
use crate::error::{Error, Result};

/// Source of the pixels of an environment.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum MapSource {
    /// A picture in a file, as typed.
    File(PathBuf),
    /// The built-in sky.
    Sky,
}

/// A light as typed: everything is checked, but no file was opened.
#[derive(Clone, Debug, PartialEq)]
pub enum LightSpec {
    /// A light that needs no file.
    Analytic(Light),
    /// An environment that is still to be loaded.
    Environment {
        /// The picture to load.
        source: MapSource,
        /// Counter-clockwise turn about +Y seen from above, in degrees.
        rotate_degrees: f64,
        /// Factor on the picture's radiance, RGB.
        scale: DVec3,
    },
}

/// A kind of light in the text form.
struct Kind {
    name: &'static str,
    required: &'static [&'static str],
    optional: &'static [&'static str],
    example: &'static str,
}

const KINDS: [Kind; 7] = [
    Kind { name: "constant", required: &["radiance"], optional: &[], example: "constant:radiance=1" },
    Kind {
        name: "directional",
        required: &["from", "irradiance"],
        optional: &[],
        example: "directional:from=0.3,0.8,0.5:irradiance=3",
    },
    Kind { name: "point", required: &["at", "intensity"], optional: &[], example: "point:at=0,10,30:intensity=900" },
    Kind {
        name: "spot",
        required: &["at", "to", "angle", "intensity"],
        optional: &["blend"],
        example: "spot:at=0,40,60:to=0,0,0:angle=30:blend=0.2:intensity=3600",
    },
    Kind {
        name: "area",
        required: &["at", "normal", "size", "radiance"],
        optional: &["u", "field"],
        example: "area:at=0,40,0:normal=0,-1,0:size=20,20:radiance=5",
    },
    Kind {
        name: "env",
        required: &["path"],
        optional: &["rotate", "scale"],
        example: "env:path=sky.hdr:rotate=90:scale=1",
    },
    Kind { name: "sky", required: &[], optional: &["rotate", "scale"], example: "sky:rotate=90" },
];

/// Share of a spot's half angle over which it falls to 0 where nothing is said.
const DEFAULT_BLEND: f64 = 0.15;

impl Kind {
    fn named(name: &str) -> Option<&'static Kind> {
        KINDS.iter().find(|k| k.name == name)
    }

    fn keys(&self) -> impl Iterator<Item = &'static str> + '_ {
        self.required.iter().chain(self.optional).copied()
    }

    fn fail(&self, what: impl fmt::Display) -> Error {
        Error::command_line(format!("{} light: {what}; type for example {}", self.name, self.example))
    }
}

/// Every form a light can take, one example a line, for help and error messages.
pub fn examples() -> impl Iterator<Item = &'static str> {
    KINDS.iter().map(|k| k.example)
}

/// Reads the text form of a light.
///
/// # Errors
/// An unknown kind or key, a missing, doubled or malformed value, a value out of range (all exit 1). The message says
/// what to type.
pub fn parse(text: &str) -> Result<LightSpec> {
    parse_trimmed(text.trim()).map_err(|e| e.at(format!("light `{}`", text.trim())))
}

impl FromStr for LightSpec {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        parse(text)
    }
}

fn parse_trimmed(text: &str) -> Result<LightSpec> {
    if text.is_empty() {
        return Err(Error::command_line(format!("it is empty; type for example {}", KINDS[0].example)));
    }
    let (head, rest) = text.split_once(':').map_or((text, None), |(head, rest)| (head, Some(rest)));
    if let Some(kind) = Kind::named(head) {
        return Values::split(kind, rest.unwrap_or(""))?.complete()?.light();
    }
    let env = &KINDS[5];
    let (path, values) = match key_colon(env, text) {
        Some(colon) => (&text[..colon], Values::split(env, &text[colon + 1..])?),
        None => (text, Values { kind: env, values: Vec::new() }),
    };
    if let Some(kind) = rest.and(unknown_kind(path)) {
        let names: Vec<_> = KINDS.iter().map(|k| k.name).collect();
        let advice = match KINDS.iter().find(|known| known.name.starts_with(kind) || kind.starts_with(known.name)) {
            Some(meant) => format!("type for example {}", meant.example),
            None => format!("a path goes as env:path={text}"),
        };
        let names = names.join(", ");
        return Err(Error::command_line(format!("`{kind}` is no kind of light; the kinds are {names}; {advice}")));
    }
    if values.get("path").is_some() {
        return Err(env.fail("the path is given twice"));
    }
    values.environment(MapSource::File(PathBuf::from(path)))
}

/// `torch:at=1` is a misspelt light, `C:\maps\sky.hdr` and `a:b.hdr` are paths.
fn unknown_kind(path: &str) -> Option<&str> {
    let (head, rest) = path.split_once(':')?;
    let word = |s: &str| s.len() > 1 && s.chars().all(|c| c.is_ascii_alphanumeric() || c == '_' || c == '-');
    let (key, _) = rest.split_once('=')?;
    (word(head) && word(key)).then_some(head)
}

/// Position of the first colon in `text` that one of the kind's keys and `=` follow.
fn key_colon(kind: &Kind, text: &str) -> Option<usize> {
    text.match_indices(':').map(|(at, _)| at).find(|at| key_at(kind, &text[at + 1..]).is_some())
}

/// The key with which `text` starts, if `=` follows it.
fn key_at(kind: &Kind, text: &str) -> Option<&'static str> {
    kind.keys().find(|key| text.strip_prefix(key).is_some_and(|t| t.trim_start().starts_with('=')))
}

struct Values<'a> {
    kind: &'static Kind,
    values: Vec<(&'static str, &'a str)>,
}

impl<'a> Values<'a> {
    fn split(kind: &'static Kind, text: &'a str) -> Result<Self> {
        let mut values: Vec<(&'static str, &'a str)> = Vec::new();
        let mut rest = text;
        while !rest.is_empty() {
            let Some(key) = key_at(kind, rest) else {
                let keys: Vec<_> = kind.keys().collect();
                let word = rest.split([':', '=']).next().unwrap_or(rest);
                return Err(kind.fail(format!("`{word}` is not one of its keys ({})", keys.join(", "))));
            };
            if values.iter().any(|(k, _)| *k == key) {
                return Err(kind.fail(format!("`{key}` is given twice")));
            }
            let value = rest[key.len()..].trim_start();
            let value = value.strip_prefix('=').unwrap_or(value);
            let end = key_colon(kind, value);
            values.push((key, value[..end.unwrap_or(value.len())].trim()));
            rest = end.map_or("", |colon| &value[colon + 1..]);
        }
        Ok(Self { kind, values })
    }

    fn complete(self) -> Result<Self> {
        match self.kind.required.iter().find(|key| self.get(key).is_none()) {
            Some(key) => Err(self.missing(key)),
            None => Ok(self),
        }
    }

    fn get(&self, key: &str) -> Option<&'a str> {
        self.values.iter().find(|(k, _)| *k == key).map(|(_, value)| *value)
    }

    fn numbers(&self, key: &str) -> Result<Option<Vec<f64>>> {
        let Some(text) = self.get(key) else { return Ok(None) };
        let number = |part: &str| {
            part.trim().parse::<f64>().map_err(|_| {
                let hint = match part.split_once(':') {
                    Some((_, word)) if word.contains('=') => {
                        let keys: Vec<_> = self.kind.keys().collect();
                        let word = word.split('=').next().unwrap_or(word);
                        format!("`{word}` is not one of its keys ({})", keys.join(", "))
                    }
                    _ => format!("`{part}` in {key}={text} is not a number"),
                };
                self.kind.fail(hint)
            })
        };
        let numbers: Vec<f64> = text.split(',').map(number).collect::<Result<_>>()?;
        match numbers.iter().find(|n| !n.is_finite()) {
            Some(n) => Err(self.kind.fail(format!("{key}={text} must be finite, and it holds {n}"))),
            None => Ok(Some(numbers)),
        }
    }

    fn colour(&self, key: &str) -> Result<Option<DVec3>> {
        match self.numbers(key)?.as_deref() {
            None => Ok(None),
            Some([grey]) => Ok(Some(DVec3::splat(*grey))),
            Some([r, g, b]) => Ok(Some(DVec3::new(*r, *g, *b))),
            Some(n) => Err(self.kind.fail(format!("{key} takes one number or R,G,B, not {} numbers", n.len()))),
        }
    }

    /// As many numbers as the `shape` in words says.
    fn array<const N: usize>(&self, key: &str, shape: &str) -> Result<Option<[f64; N]>> {
        let Some(numbers) = self.numbers(key)? else { return Ok(None) };
        let fail = |n: Vec<f64>| {
            let numbers = if N == 1 { "" } else { " numbers" };
            self.kind.fail(format!("{key} takes {shape}, not {}{numbers}", n.len()))
        };
        numbers.try_into().map(Some).map_err(fail)
    }

    fn vector(&self, key: &str) -> Result<Option<DVec3>> {
        Ok(self.array(key, "X,Y,Z")?.map(DVec3::from_array))
    }

    fn whole(&self, key: &str) -> Result<Option<u16>> {
        let Some(text) = self.get(key) else { return Ok(None) };
        let fail = |_| self.kind.fail(format!("{key} takes a whole number, not `{text}`"));
        text.parse().map(Some).map_err(fail)
    }

    fn missing(&self, key: &str) -> Error {
        self.kind.fail(format!("`{key}` is missing"))
    }

    fn light(&self) -> Result<LightSpec> {
        let colour = |key: &str| self.colour(key)?.ok_or_else(|| self.missing(key));
        let vector = |key: &str| self.vector(key)?.ok_or_else(|| self.missing(key));
        let light = match self.kind.name {
            "constant" => Light::constant(colour("radiance")?),
            "directional" => Light::directional(vector("from")?, colour("irradiance")?),
            "point" => Light::point(vector("at")?, colour("intensity")?),
            "spot" => {
                let [angle] = self.array("angle", "one number")?.ok_or_else(|| self.missing("angle"))?;
                let [blend] = self.array("blend", "one number")?.unwrap_or([DEFAULT_BLEND]);
                Light::spot(vector("at")?, vector("to")?, angle, blend, colour("intensity")?)
            }
            "area" => {
                let size = self.array("size", "two lengths in mm")?.ok_or_else(|| self.missing("size"))?;
                let light = Light::area(vector("at")?, vector("normal")?, size, colour("radiance")?, self.vector("u")?);
                match self.whole("field")? {
                    Some(points) => light.and_then(|light| light.through_field(points)),
                    None => light,
                }
            }
            "sky" => return self.environment(MapSource::Sky),
            _ => {
                let path = self.get("path").ok_or_else(|| self.missing("path"))?;
                return self.environment(MapSource::File(PathBuf::from(path)));
            }
        };
        light.map(LightSpec::Analytic).map_err(|e| self.kind.fail(e))
    }

    fn environment(&self, source: MapSource) -> Result<LightSpec> {
        if source == MapSource::File(PathBuf::new()) {
            return Err(self.kind.fail("the path is empty"));
        }
        let [rotate_degrees] = self.array("rotate", "one number")?.unwrap_or([0.0]);
        let scale = self.colour("scale")?.unwrap_or(DVec3::ONE);
        let scale = validate::amount("scale", scale).map_err(|e| self.kind.fail(e))?;
        Ok(LightSpec::Environment { source, rotate_degrees, scale })
    }
}

impl LightSpec {
    /// The light itself; `load` is asked for the picture of an environment file.
    ///
    /// # Errors
    /// Those of `load` and of [`Light::environment`].
    pub fn resolve(&self, load: impl FnOnce(&Path) -> Result<Arc<EnvironmentMap>>) -> Result<Light> {
        match self {
            Self::Analytic(light) => Ok(light.clone()),
            Self::Environment { source, rotate_degrees, scale } => {
                let map = match source {
                    MapSource::Sky => Arc::new(sky::sky()),
                    MapSource::File(path) => load(path)?,
                };
                Light::environment(map, *rotate_degrees, *scale)
            }
        }
    }
}

/// The canonical text form: [`parse`] gives the same light back, bit for bit.
impl fmt::Display for LightSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Analytic(light) => light.fmt(f),
            Self::Environment { source, rotate_degrees, scale } => {
                match source {
                    MapSource::Sky => f.write_str("sky")?,
                    MapSource::File(path) => write!(f, "env:path={}", path.display())?,
                }
                write_placement(f, *rotate_degrees, *scale)
            }
        }
    }
}

/// The text form that the command line takes; an environment in memory has no path, and shows its size instead.
impl fmt::Display for Light {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Constant { radiance } => write!(f, "constant:radiance={}", colour_text(*radiance)),
            Self::Directional { from, irradiance } => {
                write!(f, "directional:from={}:irradiance={}", vector_text(*from), colour_text(*irradiance))
            }
            Self::Point { at_mm, intensity } => {
                write!(f, "point:at={}:intensity={}", vector_text(*at_mm), colour_text(*intensity))
            }
            Self::Spot { at_mm, cone: Cone { to_mm, angle_degrees, blend }, intensity } => {
                let (at, to, intensity) = (vector_text(*at_mm), vector_text(*to_mm), colour_text(*intensity));
                write!(f, "spot:at={at}:to={to}:angle={angle_degrees}:blend={blend}:intensity={intensity}")
            }
            Self::Area { at_mm, normal, u, size_mm: [a, b], radiance, field } => {
                write!(
                    f,
                    "area:at={}:normal={}:size={a},{b}:radiance={}:u={}",
                    vector_text(*at_mm),
                    vector_text(*normal),
                    colour_text(*radiance),
                    vector_text(*u)
                )?;
                field.map_or(Ok(()), |points| write!(f, ":field={points}"))
            }
            Self::Environment { map, rotate_degrees, scale } => {
                write!(f, "env:path=<{}x{} pixels>", map.width(), map.height())?;
                write_placement(f, *rotate_degrees, *scale)
            }
        }
    }
}

fn write_placement(f: &mut fmt::Formatter<'_>, rotate_degrees: f64, scale: DVec3) -> fmt::Result {
    if rotate_degrees != 0.0 {
        write!(f, ":rotate={rotate_degrees}")?;
    }
    if scale != DVec3::ONE {
        write!(f, ":scale={}", colour_text(scale))?;
    }
    Ok(())
}

fn colour_text(c: DVec3) -> String {
    if c.x == c.y && c.y == c.z { c.x.to_string() } else { vector_text(c) }
}

#[cfg(test)]
#[path = "parse_tests.rs"]
mod tests;
