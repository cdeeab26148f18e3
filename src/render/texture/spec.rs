//! The text form of textures: `none`, `marble:key=value:...`, `image:path=FILE.png`, `base-colour:path=MODEL.glb`, or a
//! bare path of a picture (PNG, JPEG, WebP) or a glTF model.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use glam::DVec3;

use crate::error::{Error, Result};
use crate::render::camera::xyz;

/// Largest number of octaves of turbulence.
pub const MAX_OCTAVES: u32 = 10;
/// Largest turbulence.
pub const MAX_TURBULENCE: f64 = 16.0;
/// Range of the sharpness of veins.
pub const SHARPNESS: [f64; 2] = [0.1, 100.0];

const KEYS: &str = "scale, base, veins, turbulence, octaves, sharpness, seed";
const EXAMPLE: &str = "marble:scale=6:veins=0.2,0.15,0.1:seed=7";

/// The texture that multiplies the scattered light, as typed; no file has been opened.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum TextureSpec {
    /// Nothing.
    #[default]
    None,
    /// Solid marble.
    Marble(MarbleSpec),
    /// A picture over the texture coordinates.
    Image(PathBuf),
    /// The base colours of a glTF model.
    BaseColour(PathBuf),
}

/// Solid marble as typed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MarbleSpec {
    /// Distance between veins in mm; default: a share of the object's diagonal.
    pub scale_mm: Option<f64>,
    /// Albedo beside the veins, linear RGB in [0, 1].
    pub base: DVec3,
    /// Albedo of the veins, linear RGB in [0, 1].
    pub veins: DVec3,
    /// Shift of the veins by turbulence, in distances between veins.
    pub turbulence: f64,
    /// Octaves of the turbulence, each half as large and half as strong as the one before.
    pub octaves: u32,
    /// Exponent of the cosine across veins: the larger, the thinner they are.
    pub sharpness: f64,
    /// Seed of the veins.
    pub seed: u32,
}

impl Default for MarbleSpec {
    fn default() -> Self {
        Self {
            scale_mm: None,
            base: DVec3::ONE,
            veins: DVec3::new(0.22, 0.2, 0.19),
            turbulence: 2.5,
            octaves: 6,
            sharpness: 4.0,
            seed: 0,
        }
    }
}

/// Reads one of the text forms.
impl FromStr for TextureSpec {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let text = text.trim();
        read(text).map_err(|e| e.at(format!("texture `{text}`")))
    }
}

fn read(text: &str) -> Result<TextureSpec> {
    let fail = |what: &str| {
        Error::command_line(format!(
            "{what}; type none, marble, image:path=FILE.png, base-colour:path=MODEL.glb or for example {EXAMPLE}"
        ))
    };
    let (kind, rest) = text.split_once(':').map_or((text, None), |(kind, rest)| (kind, Some(rest)));
    match (kind, rest) {
        ("", None) => Err(fail("it is empty")),
        ("none", None) => Ok(TextureSpec::None),
        ("none", Some(_)) => Err(fail("`none` has no keys")),
        ("marble", None) => Ok(TextureSpec::Marble(MarbleSpec::default())),
        ("marble", Some(pairs)) => marble(pairs).map(TextureSpec::Marble),
        ("image", rest) => match path(rest) {
            Some(path) => Ok(TextureSpec::Image(path)),
            None => Err(fail("an image is given as image:path=FILE.png")),
        },
        ("base-colour" | "base-color", rest) => match path(rest) {
            Some(path) => Ok(TextureSpec::BaseColour(path)),
            None => Err(fail("base colours are given as base-colour:path=MODEL.glb, the model that was baked")),
        },
        _ if has_suffix(text, &[".png", ".jpg", ".jpeg", ".webp"]) => Ok(TextureSpec::Image(text.into())),
        _ if has_suffix(text, &[".gltf", ".glb"]) => Ok(TextureSpec::BaseColour(text.into())),
        _ => Err(fail(&format!("`{kind}` is no kind of texture"))),
    }
}

/// The text after `path=`, colons included.
fn path(rest: Option<&str>) -> Option<PathBuf> {
    let path = rest?.strip_prefix("path=")?.trim();
    (!path.is_empty()).then(|| path.into())
}

fn has_suffix(text: &str, suffixes: &[&str]) -> bool {
    let text = text.to_ascii_lowercase();
    suffixes.iter().any(|suffix| text.ends_with(suffix))
}

fn marble(pairs: &str) -> Result<MarbleSpec> {
    let mut spec = MarbleSpec::default();
    let mut seen: Vec<&str> = Vec::new();
    for pair in pairs.split(':') {
        let (key, value) = pair
            .split_once('=')
            .map(|(key, value)| (key.trim(), value.trim()))
            .ok_or_else(|| Error::command_line(format!("`{pair}` is not key=value; type for example {EXAMPLE}")))?;
        if seen.contains(&key) {
            return Err(Error::command_line(format!("`{key}` is given twice")));
        }
        seen.push(key);
        match key {
            "scale" => spec.scale_mm = Some(in_range(key, value, [f64::MIN_POSITIVE, f64::MAX])?),
            "base" => spec.base = colour(key, value)?,
            "veins" => spec.veins = colour(key, value)?,
            "turbulence" => spec.turbulence = in_range(key, value, [0.0, MAX_TURBULENCE])?,
            "octaves" => spec.octaves = whole(key, value, 1, MAX_OCTAVES)?,
            "sharpness" => spec.sharpness = in_range(key, value, SHARPNESS)?,
            "seed" => spec.seed = whole(key, value, 0, u32::MAX)?,
            _ => return Err(Error::command_line(format!("`{key}` is not one of its keys ({KEYS})"))),
        }
    }
    Ok(spec)
}

fn in_range(key: &str, value: &str, [least, most]: [f64; 2]) -> Result<f64> {
    let range = if most == f64::MAX { "mm above 0".to_owned() } else { format!("{least} to {most}") };
    match value.parse::<f64>() {
        Ok(number) if (least..=most).contains(&number) => Ok(number),
        _ => Err(Error::command_line(format!("{key}={value}: a number is needed, {range}"))),
    }
}

fn whole(key: &str, value: &str, least: u32, most: u32) -> Result<u32> {
    match value.parse::<u32>() {
        Ok(number) if (least..=most).contains(&number) => Ok(number),
        _ => Err(Error::command_line(format!("{key}={value}: a whole number from {least} to {most} is needed"))),
    }
}

/// One number for grey, or three numbers.
fn colour(key: &str, value: &str) -> Result<DVec3> {
    let numbers: Vec<f64> = value.split(',').filter_map(|part| part.trim().parse().ok()).collect();
    let colour = match (numbers.as_slice(), value.split(',').count()) {
        (&[grey], 1) => DVec3::splat(grey),
        (&[r, g, b], 3) => DVec3::new(r, g, b),
        _ => return Err(Error::command_line(format!("{key}={value}: a number or R,G,B is needed"))),
    };
    if colour.to_array().iter().all(|c| (0.0..=1.0).contains(c)) {
        return Ok(colour);
    }
    Err(Error::command_line(format!(
        "{key}={value}: an albedo is from 0 to 1; above, light would be made from nothing"
    )))
}

/// The text form of the texture.
impl fmt::Display for TextureSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::None => f.write_str("none"),
            Self::Marble(marble) => marble.fmt(f),
            Self::Image(path) => write!(f, "image:path={}", path.display()),
            Self::BaseColour(path) => write!(f, "base-colour:path={}", path.display()),
        }
    }
}

impl fmt::Display for MarbleSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("marble")?;
        if let Some(scale_mm) = self.scale_mm {
            write!(f, ":scale={scale_mm}")?;
        }
        write!(f, ":base={}:veins={}", xyz(self.base), xyz(self.veins))?;
        let Self { turbulence, octaves, sharpness, seed, .. } = self;
        write!(f, ":turbulence={turbulence}:octaves={octaves}:sharpness={sharpness}:seed={seed}")
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn forms_are_read_and_written() {
        let read = |text: &str| text.parse::<TextureSpec>().unwrap();
        assert_eq!(read(" none "), TextureSpec::None);
        assert_eq!(read("marble"), TextureSpec::Marble(MarbleSpec::default()));
        assert_eq!(read("image:path=a:b=c.jpg"), TextureSpec::Image("a:b=c.jpg".into()));
        assert_eq!(read("wood/Oak.PNG"), TextureSpec::Image("wood/Oak.PNG".into()));
        assert_eq!(read("bust.glb"), TextureSpec::BaseColour("bust.glb".into()));
        assert_eq!(read("base-color:path=a.gltf"), TextureSpec::BaseColour("a.gltf".into()));
        let all = "marble:scale=2.5:base=0.9:veins=0.1,0.2,0.3:turbulence=0:octaves=10:sharpness=0.5:seed=4294967295";
        let expected = MarbleSpec {
            scale_mm: Some(2.5),
            base: DVec3::splat(0.9),
            veins: DVec3::new(0.1, 0.2, 0.3),
            turbulence: 0.0,
            octaves: 10,
            sharpness: 0.5,
            seed: u32::MAX,
        };
        assert_eq!(read(all), TextureSpec::Marble(expected));
        for text in ["none", "marble", "image:path=x.png", "base-colour:path=x", all] {
            assert_eq!(read(&read(text).to_string()), read(text), "{text}");
        }
    }

    #[test]
    fn mistakes_are_told() {
        for (text, says) in [
            ("", "it is empty"),
            ("wood", "`wood` is no kind of texture"),
            ("wood:scale=2", "`wood` is no kind"),
            ("none:scale=1", "no keys"),
            ("marble:", "key=value"),
            ("marble:scale", "key=value"),
            ("marble:scale=0", "mm above 0"),
            ("marble:scale=nan", "a number is needed"),
            ("marble:scale=inf", "a number is needed"),
            ("marble:scale=-3", "mm above 0"),
            ("marble:scale=1:scale=2", "`scale` is given twice"),
            ("marble:size=3", "not one of its keys (scale, base"),
            ("marble:base=1.1", "from 0 to 1"),
            ("marble:base=-0.1,0,0", "from 0 to 1"),
            ("marble:veins=nan", "from 0 to 1"),
            ("marble:veins=0.1,0.2", "a number or R,G,B"),
            ("marble:veins=0.1,x,0.2,0.3", "a number or R,G,B"),
            ("marble:turbulence=17", "0 to 16"),
            ("marble:octaves=0", "from 1 to 10"),
            ("marble:octaves=2.5", "from 1 to 10"),
            ("marble:sharpness=0", "0.1 to 100"),
            ("marble:seed=-1", "from 0 to 4294967295"),
            ("image", "image:path=FILE.png"),
            ("image:x.png", "image:path=FILE.png"),
            ("image:path=", "image:path=FILE.png"),
            ("base-colour", "the model that was baked"),
            ("base-colour:path=", "the model that was baked"),
        ] {
            let error = text.parse::<TextureSpec>().unwrap_err();
            assert_eq!(error.code(), crate::error::ExitCode::CommandLine);
            assert!(error.message().contains(says) && error.message().contains(text), "{text}: {error}");
        }
    }
}
