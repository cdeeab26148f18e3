//! Exposure, and pictures as PNG and OpenEXR.

use std::str::FromStr;

use glam::DVec3;

use super::background::Background;
use super::camera::Resolution;
use super::frame::{ExitanceAt, Frame, Ground, Pixel, RenderSettings, SingleLayer, Specular, render};
use super::single::Scattered;
use super::tone::Tone;
use crate::error::{Error, Result};
use crate::evaluate::Evaluator;
use crate::io::exr_write::{ExrChannel, ExrImage, ExrLayer, MAX_HALF, SampleKind};
use crate::io::png::encode_png;
use crate::progress::Silent;

/// Share of the covered pixels that automatic exposure keeps at or below white.
pub const AUTO_EXPOSURE_PERCENTILE: f64 = 0.995;
/// Largest exposure in stops, either way.
pub const MAX_STOPS: f64 = 64.0;

/// Brightness of a PNG. OpenEXR pictures are never exposed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Exposure {
    /// The 99.5th percentile of the brightest channel over the covered pixels becomes white.
    #[default]
    Auto,
    /// A factor of 2 to this power.
    Stops(f64),
}

/// Reads `auto` or a number of stops.
impl FromStr for Exposure {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let trimmed = text.trim();
        if trimmed == "auto" {
            return Ok(Self::Auto);
        }
        match trimmed.parse::<f64>() {
            Ok(stops) if stops.abs() <= MAX_STOPS => Ok(Self::Stops(stops)),
            _ => Err(Error::command_line(format!(
                "exposure `{trimmed}`: type auto, or stops from -{MAX_STOPS} to {MAX_STOPS}, for example 1.5"
            ))),
        }
    }
}

impl std::fmt::Display for Exposure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::Stops(stops) => write!(f, "{stops}"),
        }
    }
}

impl Exposure {
    /// The factor on radiance, at least the smallest positive number.
    ///
    /// Automatic: the reciprocal of the percentile of max(R, G, B) of the diffuse and singly scattered radiance over
    /// pixels with any coverage, divided by the coverage, so that outlines count like the rest; by nearest rank. 1
    /// where all is black.
    pub fn factor(self, frame: &Frame) -> f64 {
        self.factor_of_all(&[frame])
    }

    /// One factor for several pictures: automatic exposure looks at the pixels of all of them.
    pub fn factor_of_all(self, frames: &[&Frame]) -> f64 {
        match self {
            Self::Stops(stops) => stops.clamp(-MAX_STOPS, MAX_STOPS).exp2(),
            Self::Auto => white(frames.iter().flat_map(|frame| &frame.pixels)).map_or(1.0, f64::recip),
        }
    }

    /// The radiance that becomes white in a view, measured in a small picture of it.
    ///
    /// # Errors
    /// As [`render`].
    pub fn white<'a>(
        self,
        evaluator: &dyn Evaluator,
        scattered: impl Into<Scattered<'a>>,
        settings: &RenderSettings,
    ) -> Result<f64> {
        const LONGEST_SIDE: usize = 96;
        let Resolution { width, height } = settings.resolution;
        let side = |n: usize| (n * LONGEST_SIDE).div_ceil(width.max(height).max(1)).clamp(1, n.max(1));
        let small = RenderSettings {
            resolution: Resolution::new(side(width), side(height))?,
            samples_per_pixel: 1,
            specular: Specular::Off,
            background: Background::None,
            ground: Ground::None,
            ..*settings
        };
        Ok(self.factor(&render(evaluator, scattered, &[], &small, &Silent)?).recip())
    }
}

/// The radiance that becomes white; none where all is black.
fn white<'a>(pixels: impl Iterator<Item = &'a Pixel>) -> Option<f64> {
    let brightest = |p: &Pixel| f64::from(scattered(p).into_iter().fold(0.0, f32::max)) / f64::from(p.coverage);
    let value = white_of(pixels.filter(|p| p.coverage > 0.0).map(brightest).collect())?;
    (value >= f64::MIN_POSITIVE && value.is_finite()).then_some(value)
}

/// The percentile of automatic exposure among some values, by nearest rank.
pub(crate) fn white_of(mut values: Vec<f64>) -> Option<f64> {
    let rank = (AUTO_EXPOSURE_PERCENTILE * values.len() as f64).ceil() as usize;
    let (_, value, _) = values.select_nth_unstable_by(rank.checked_sub(1)?, f64::total_cmp);
    Some(*value)
}

/// [`to_toned_png`] without a curve.
///
/// # Errors
/// As [`encode_png`].
pub fn to_png(frame: &Frame, factor: f64, background: Background) -> Result<Vec<u8>> {
    to_toned_png(frame, (factor, Tone::None), background)
}

/// Encodes an 8-bit sRGB PNG of the beauty without its glare, times `factor` and through a tone curve; transparent and not
/// multiplied by alpha where there is no background.
///
/// # Errors
/// As [`encode_png`].
pub fn to_toned_png(frame: &Frame, (factor, tone): (f64, Tone), background: Background) -> Result<Vec<u8>> {
    let Resolution { width, height } = frame.resolution;
    let expose = |c: f32, factor: f64| match f64::from(c) * factor {
        // Black stays black under a factor that overflowed.
        v if v > 0.0 => v.min(f64::MAX),
        _ => 0.0,
    };
    let exposed = |v: [f32; 3], factor: f64| {
        tone.shown(DVec3::from_array(v.map(|c| expose(c, factor)))).to_array().map(|c| c as f32)
    };
    let opaque = background != Background::None;
    let shown = |p: &Pixel| match p.coverage {
        _ if opaque => exposed(without_glare(p, p.beauty), factor),
        c if c > 0.0 => exposed(without_glare(p, object(p)), factor / f64::from(c + p.shadow)),
        _ => [0.0; 3],
    };
    let rgb: Vec<[f32; 3]> = frame.pixels.iter().map(shown).collect();
    // A shadow is black that covers what comes behind, beside the object.
    let covered = |p: &Pixel| (p.coverage + p.shadow).min(1.0);
    let alpha: Option<Vec<f32>> = (!opaque).then(|| frame.pixels.iter().map(covered).collect());
    encode_png(width, height, &rgb, alpha.as_deref())
}

fn without_glare(p: &Pixel, radiance: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|c| radiance[c] - p.glare[c])
}

/// Pictures of equal height side by side, each multiplied by its factor, without their glare.
///
/// # Errors
/// No picture, or unequal heights (exit 4: a caller's mistake).
pub fn side_by_side(pictures: &[(Frame, f64)]) -> Result<Frame> {
    let height = pictures.first().map_or(0, |(frame, _)| frame.resolution.height);
    if height == 0 || pictures.iter().any(|(frame, _)| frame.resolution.height != height) {
        return Err(Error::runtime("pictures of one height are needed"));
    }
    let width = pictures.iter().map(|(frame, _)| frame.resolution.width).sum();
    let mut pixels = Vec::with_capacity(width * height);
    for row in 0..height {
        for (frame, factor) in pictures {
            let width = frame.resolution.width;
            pixels.extend(frame.pixels[row * width..(row + 1) * width].iter().map(|p| {
                let beauty = without_glare(p, p.beauty).map(|c| (f64::from(c) * factor) as f32);
                Pixel { beauty, glare: [0.0; 3], ..*p }
            }));
        }
    }
    Ok(Frame {
        resolution: Resolution::new(width, height)?,
        pixels,
        back_facing_share: 0.0,
        exitance: pictures.first().map_or_else(ExitanceAt::default, |(frame, _)| frame.exitance),
        single: SingleLayer::None,
        has_straight: false,
        textured: false,
        has_matte: false,
        has_ground: false,
    })
}

/// Radiance of the object without the background, multiplied by the coverage.
fn object(p: &Pixel) -> [f32; 3] {
    let scattered = scattered(p);
    std::array::from_fn(|c| (scattered[c] + p.specular[c] + p.matte[c]).min(f32::MAX))
}

/// Radiance from inside the object, multiplied by the coverage.
fn scattered(p: &Pixel) -> [f32; 3] {
    std::array::from_fn(|c| (p.diffuse[c] + p.single[c] + p.straight[c]).min(f32::MAX))
}

/// Storage of the colours of an OpenEXR picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, clap::ValueEnum)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum ColourType {
    /// 16 bits: 11 significant bits up to 65504, where brighter values are clamped.
    #[default]
    #[value(help = "16 bits, up to 65504")]
    Half,
    /// 32 bits.
    Float,
}

impl ColourType {
    /// Number of pixels with a clamped colour.
    pub fn cut_pixels(self, frame: &Frame) -> usize {
        let beyond = |p: &&Pixel| {
            [p.beauty, p.diffuse, p.single, p.straight, p.specular].as_flattened().iter().any(|c| c.abs() > MAX_HALF)
        };
        match self {
            Self::Half => frame.pixels.iter().filter(beyond).count(),
            Self::Float => 0,
        }
    }
}

/// Encodes an OpenEXR picture of linear radiance, never exposed, with `attributes` (name, text) in its header.
///
/// Layers of colour, stored as asked: the beauty as `R`, `G`, `B` with the coverage as `A`; `diffuse.R`, `.G`, `.B`;
/// `single.R`, `.G`, `.B` if there is single scattering; `straight.R`, `.G`, `.B` if light straight through was asked for;
/// `specular.R`, `.G`, `.B`; `opaque.R`, `.G`, `.B` if there are opaque
/// parts; `shadow.A` with a ground; `albedo.R`, `.G`, `.B` if there is a
/// texture, which is in the other layers already. Layers of data, always 32 bits (see [`Pixel`]): `normal.X`, `.Y`,
/// `.Z`; `depth.Z` in mm along the viewing axis; `coverage.A`; `part.ID`, a whole number.
///
/// # Errors
/// As [`ExrImage::encode`].
pub fn to_exr(frame: &Frame, colours: ColourType, attributes: Vec<(String, String)>) -> Result<Vec<u8>> {
    to_exr_with(frame, colours, attributes, Vec::new())
}

/// [`to_exr`] with further layers, which have a sample for each pixel.
///
/// # Errors
/// As [`ExrImage::encode`].
pub fn to_exr_with(
    frame: &Frame,
    colours: ColourType,
    attributes: Vec<(String, String)>,
    more: Vec<ExrLayer>,
) -> Result<Vec<u8>> {
    let channel = |name: &str, kind: SampleKind, value: &dyn Fn(&Pixel) -> f32| ExrChannel {
        name: name.to_owned(),
        kind,
        samples: frame.pixels.iter().map(value).collect(),
    };
    let triple = |names: [&str; 3], kind: SampleKind, value: fn(&Pixel) -> [f32; 3]| -> Vec<ExrChannel> {
        (0..3).map(|c| channel(names[c], kind, &|p| value(p)[c])).collect()
    };
    let layer = |name: &str, channels: Vec<ExrChannel>| ExrLayer { name: name.to_owned(), channels };
    let colour = match colours {
        ColourType::Half => SampleKind::Half,
        ColourType::Float => SampleKind::Float,
    };
    let rgb = ["R", "G", "B"];
    let mut beauty = triple(rgb, colour, |p| p.beauty);
    beauty.push(channel("A", colour, &|p| p.coverage));
    let mut layers = vec![layer("", beauty), layer("diffuse", triple(rgb, colour, |p| p.diffuse))];
    if frame.single != SingleLayer::None {
        layers.push(layer("single", triple(rgb, colour, |p| p.single)));
    }
    if frame.has_straight {
        layers.push(layer("straight", triple(rgb, colour, |p| p.straight)));
    }
    layers.push(layer("specular", triple(rgb, colour, |p| p.specular)));
    if frame.has_matte {
        layers.push(layer("opaque", triple(rgb, colour, |p| p.matte)));
    }
    if frame.has_ground {
        layers.push(layer("shadow", vec![channel("A", SampleKind::Float, &|p| p.shadow)]));
    }
    if frame.textured {
        layers.push(layer("albedo", triple(rgb, colour, |p| p.albedo)));
    }
    layers.extend([
        layer("normal", triple(["X", "Y", "Z"], SampleKind::Float, |p| p.normal)),
        layer("depth", vec![channel("Z", SampleKind::Float, &|p| p.depth_mm)]),
        layer("coverage", vec![channel("A", SampleKind::Float, &|p| p.coverage)]),
        layer("part", vec![channel("ID", SampleKind::Whole, &|p| p.part as f32)]),
    ]);
    layers.extend(more);
    let Resolution { width, height } = frame.resolution;
    ExrImage { width, height, layers, attributes }.encode()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::io::exr::decode_planes;
    use crate::io::png::decode_png;
    use crate::render::settings::EMPTY;

    fn frame(width: usize, pixels: Vec<Pixel>) -> Frame {
        let resolution = Resolution::new(width, pixels.len() / width).unwrap();
        Frame {
            resolution,
            pixels,
            back_facing_share: 0.0,
            exitance: ExitanceAt::Vertices,
            single: SingleLayer::None,
            has_straight: false,
            textured: false,
            has_matte: false,
            has_ground: false,
        }
    }

    fn pixel(radiance: [f32; 3], coverage: f32) -> Pixel {
        let diffuse = radiance.map(|c| c * coverage);
        let normal = [0.0, 0.0, coverage.ceil()];
        Pixel { beauty: diffuse, diffuse, normal, depth_mm: 3.0, coverage, part: coverage.ceil() as u32, ..EMPTY }
    }

    #[test]
    fn automatic_exposure_is_the_percentile_by_nearest_rank() {
        // 1000 covered pixels of brightness 1 to 1000: rank 995; uncovered ones do not count.
        let mut pixels: Vec<Pixel> = (0..1000).map(|i| pixel([0.1, (i * 7 % 1000 + 1) as f32, 0.2], 1.0)).collect();
        pixels.extend(vec![pixel([9e9; 3], 0.0); 500]);
        assert_eq!(Exposure::Auto.factor(&frame(10, pixels)), 1.0 / 995.0);
        // The outline counts as if the object filled the pixel.
        assert_eq!(Exposure::Auto.factor(&frame(1, vec![pixel([0.0, 0.0, 4.0], 0.25)])), 0.25);
        for dark in [pixel([0.0; 3], 1.0), pixel([-1.0; 3], 1.0), pixel([1.0; 3], 0.0)] {
            assert_eq!(Exposure::Auto.factor(&frame(2, vec![dark; 4])), 1.0);
        }
    }

    #[test]
    fn glare_is_not_shown_and_pictures_stand_side_by_side() {
        // A tenth of the pixel is a highlight of 100 on a diffuse 0.2, and white is 1.
        let highlight = Pixel { beauty: [10.2; 3], specular: [10.0; 3], glare: [9.9; 3], ..pixel([0.2; 3], 1.0) };
        let plain = pixel([0.3; 3], 1.0);
        let shown = |f: &Frame, background| decode_png(&to_png(f, 1.0, background).unwrap()).unwrap().rgb;
        let expected = shown(&frame(2, vec![plain; 2]), Background::Environment);
        let bright = frame(2, vec![highlight, plain]);
        assert_eq!(shown(&bright, Background::Environment), expected);
        assert_eq!(shown(&bright, Background::None), expected);
        let pair = side_by_side(&[(bright, 1.0), (frame(1, vec![pixel([0.15; 3], 1.0)]), 2.0)]).unwrap();
        assert_eq!((pair.resolution.width, pair.resolution.height), (3, 1));
        assert_eq!(shown(&pair, Background::Environment), shown(&frame(3, vec![plain; 3]), Background::Environment));
        assert!(side_by_side(&[]).is_err());
        assert!(side_by_side(&[(frame(1, vec![plain]), 1.0), (frame(1, vec![plain; 2]), 1.0)]).is_err());
    }

    #[test]
    fn stops_are_powers_of_two() {
        let any = frame(1, vec![pixel([1.0; 3], 1.0)]);
        for (text, factor) in [("0", 1.0), ("3", 8.0), ("-1.5", 2f64.powf(-1.5)), ("auto", 1.0)] {
            let exposure: Exposure = text.parse().unwrap();
            assert_eq!(exposure.factor(&any), factor, "{text}");
            assert_eq!(exposure.to_string(), text);
        }
        for bad in ["", "bright", "nan", "inf", "65"] {
            assert!(bad.parse::<Exposure>().unwrap_err().message().contains("type auto, or stops"), "{bad}");
        }
    }

    /// The sRGB transfer function by its definition (IEC 61966-2-1), apart from the one under test.
    fn code(linear: f64) -> u8 {
        let c = if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 };
        (255.0 * c).round() as u8
    }

    fn raw(png: &[u8]) -> Vec<u8> {
        image::load_from_memory(png).unwrap().into_bytes()
    }

    #[test]
    fn png_holds_exact_srgb_of_the_exposed_beauty() {
        let values: Vec<f32> = (0..600).map(|i| 1.2 * i as f32 / 599.0).collect();
        let picture = frame(10, values.iter().map(|&v| pixel([v, 0.5 * v, -v], 1.0)).collect());
        let bytes = raw(&to_png(&picture, 2.0, Background::Environment).unwrap());
        assert_eq!(bytes.len(), 1800);
        for (i, &v) in values.iter().enumerate() {
            let v = f64::from(v);
            let expected = [code((2.0 * v).min(1.0)), code(v.min(1.0)), 0];
            assert_eq!(bytes[3 * i..3 * i + 3], expected, "{v}");
        }
    }

    #[test]
    fn transparent_png_keeps_the_colour_of_the_outline() {
        let picture = frame(1, vec![pixel([0.5, 0.25, 1.0], 0.25), pixel([0.0; 3], 0.0)]);
        let bytes = raw(&to_png(&picture, 1.0, Background::None).unwrap());
        assert_eq!(bytes, [code(0.5), code(0.25), 255, 64, 0, 0, 0, 0]);
        assert!(decode_png(&to_png(&picture, 1.0, Background::Environment).unwrap()).unwrap().alpha.is_none());
    }

    #[test]
    fn extreme_factors_stay_finite() {
        let picture = frame(2, vec![pixel([f32::MAX, 0.0, -1.0], 1.0), pixel([1e-30, 0.0, -1.0], 1e-3)]);
        for factor in [f64::MIN_POSITIVE, 1e-300, 1e300, f64::MAX] {
            for background in [Background::Environment, Background::None] {
                assert!(to_png(&picture, factor, background).is_ok());
            }
        }
    }

    #[test]
    fn transparent_png_shows_reflections() {
        let mut shiny = pixel([0.25; 3], 0.5);
        shiny.specular = [0.125, 0.0, 0.0];
        let bytes = raw(&to_png(&frame(1, vec![shiny]), 1.0, Background::None).unwrap());
        assert_eq!(bytes, [code(0.5), code(0.25), code(0.25), 128]);
    }

    #[test]
    fn single_scattering_is_a_layer_and_is_exposed_with_the_diffuse_one() {
        let scattered = Pixel { single: [1.5, 0.25, 0.0], ..pixel([0.5; 3], 1.0) };
        let plain = frame(2, vec![scattered; 2]);
        let with = Frame { single: SingleLayer::PerVertex, ..plain.clone() };
        let planes = |f: &Frame| decode_planes(&to_exr(f, ColourType::Half, Vec::new()).unwrap()).unwrap();
        assert_eq!((planes(&plain).len(), planes(&with).len()), (16, 19));
        let red = planes(&with).into_iter().find(|p| p.name == "single.R").unwrap();
        assert_eq!(red.samples, [1.5, 1.5]);
        assert_eq!(Exposure::Auto.factor(&with), 0.5);
        let bright = Pixel { single: [7e4; 3], ..pixel([0.5; 3], 1.0) };
        assert_eq!(ColourType::Half.cut_pixels(&frame(1, vec![bright])), 1);
        // Transparent pictures show it too.
        let bytes = raw(&to_png(&with, 0.5, Background::None).unwrap());
        assert_eq!(bytes[..4], [code(1.0), code(0.375), code(0.25), 255]);
    }

    #[test]
    fn a_texture_is_a_layer_of_its_own() {
        let textured = Pixel { albedo: [0.5, 0.25, 0.125], ..pixel([0.5; 3], 1.0) };
        let with = Frame { textured: true, ..frame(1, vec![textured]) };
        let planes = decode_planes(&to_exr(&with, ColourType::Half, Vec::new()).unwrap()).unwrap();
        assert_eq!(planes.len(), 19);
        let found =
            ["albedo.R", "albedo.G", "albedo.B"].map(|name| planes.iter().find(|p| p.name == name).unwrap().samples[0]);
        assert_eq!(found, textured.albedo);
    }

    #[test]
    fn exr_has_every_layer_unexposed() {
        let mut bright = pixel([70_000.0, 0.5, 0.25], 1.0);
        bright.depth_mm = f32::INFINITY;
        bright.specular = [0.5, 0.3, 0.0];
        let picture = frame(2, vec![bright, pixel([0.125, 0.5, 1.5], 0.5)]);
        for (colours, brightest, third, cut) in
            [(ColourType::Half, 65_504.0, 0.300_048_83, 1), (ColourType::Float, 70_000.0, 0.3, 0)]
        {
            assert_eq!(colours.cut_pixels(&picture), cut);
            let attributes = vec![("camera".to_owned(), "at=0,0,1".to_owned())];
            let bytes = to_exr(&picture, colours, attributes).unwrap();
            let planes = decode_planes(&bytes).unwrap();
            let plane = |name: &str| planes.iter().find(|p| p.name == name).unwrap().samples.clone();
            assert_eq!(planes.len(), 16);
            assert_eq!(plane("R"), [brightest, 0.0625]);
            assert_eq!(plane("A"), [1.0, 0.5]);
            assert_eq!(plane("diffuse.R"), [brightest, 0.0625]);
            assert_eq!(plane("diffuse.B"), [0.25, 0.75]);
            assert_eq!(plane("specular.R"), [0.5, 0.0]);
            assert_eq!(plane("specular.G"), [third, 0.0]);
            assert_eq!(plane("normal.Z"), [1.0, 1.0]);
            assert_eq!(plane("depth.Z"), [f32::INFINITY, 3.0]);
            assert_eq!(plane("coverage.A"), [1.0, 0.5]);
            assert_eq!(plane("part.ID"), [1.0, 1.0]);
            assert!(bytes.windows(8).any(|w| w == b"at=0,0,1"));
        }
    }
}
