//! Reading of OpenEXR pictures: environment maps as linear sRGB, and every channel as a plane for comparisons.
//!
//! A header decides how much a decoder allocates, so headers are read and bounded first; only then pixels are decoded,
//! strictly, on one thread.

use std::io::Cursor;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use exr::meta::header::Header;
use exr::prelude::{
    self as openexr, AnyChannels, FlatSamples, MetaData, ReadChannels, ReadLayers, SampleType, attribute,
};
use glam::{DMat3, DVec2};

use super::colour::Chromaticities;
use super::picture::{LinearImage, MAX_DECODED_BYTES, check_size, convert, read_capped};
use crate::error::{Error, Result};

/// The first bytes of every OpenEXR file.
pub const MAGIC: [u8; 4] = exr::meta::magic_number::BYTES;

/// One channel of a file as 32-bit floats (whole numbers above 2^24 lose digits).
#[derive(Clone, Debug, PartialEq)]
pub struct ExrPlane {
    /// The channel's name with its layer (`diffuse.R`); the part's name comes first where a file has several parts.
    pub name: String,
    /// Samples in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height` samples, row by row from the top.
    pub samples: Vec<f32>,
}

/// Reads every channel of every part, in file order.
///
/// # Errors
/// A file that cannot be read (exit 2), is damaged (exit 3), has deep or subsampled data or too many pixels (exit 5).
pub fn read_exr_channels(path: &Path) -> Result<Vec<ExrPlane>> {
    read_capped(path).and_then(|bytes| decode_planes(&bytes).map_err(|e| e.in_file(path)))
}

/// Like [`read_exr_channels`], from bytes.
///
/// # Errors
/// As [`read_exr_channels`], without the path.
pub fn decode_planes(bytes: &[u8]) -> Result<Vec<ExrPlane>> {
    let parts = decode_parts(bytes)?;
    let many = parts.len() > 1;
    let mut planes = Vec::new();
    for (index, part) in parts.into_iter().enumerate() {
        let prefix = if many { format!("{}.", part.name.unwrap_or_else(|| index.to_string())) } else { String::new() };
        planes.extend(part.channels.into_iter().map(|(name, samples)| ExrPlane {
            name: format!("{prefix}{name}"),
            width: part.width,
            height: part.height,
            samples,
        }));
    }
    Ok(planes)
}

/// Decodes the first RGB (otherwise luminance) picture of a file to linear sRGB.
///
/// # Errors
/// As [`decode_planes`]; no RGB and no Y channel, chroma stored apart, a cube map, a cropped picture (exit 5).
pub fn decode_rgb(bytes: &[u8]) -> Result<LinearImage> {
    let mut parts = decode_parts(bytes)?;
    let choice = parts
        .iter()
        .enumerate()
        .find_map(|(i, p)| p.colour_layer().map(|layer| (i, layer)))
        .or_else(|| parts.iter().enumerate().find_map(|(i, p)| p.luminance_layer().map(|layer| (i, layer))));
    let Some((index, names)) = choice else {
        let names: Vec<_> = parts.iter().flat_map(|p| p.channels.iter().map(|(n, _)| n.as_str())).collect();
        return Err(Error::unsupported(format!("it has no R, G, B or Y channels, only {}", names.join(", "))));
    };
    let part = parts.swap_remove(index);
    if part.is_cube {
        return Err(Error::unsupported("it is a cube map; convert it with `exrenvmap -l`"));
    }
    let (display_width, display_height) = part.display;
    if (display_width, display_height) != (part.width, part.height) {
        return Err(Error::unsupported(format!(
            "its pixels cover {} x {} of a display window of {display_width} x {display_height}; \
             an environment needs all of it, so export it without cropping",
            part.width, part.height
        )));
    }
    let mut warnings = Vec::new();
    if let Some((layer, _)) = names[0].rsplit_once('.') {
        warnings.push(format!("layer `{layer}` is read"));
    }
    let plane = |name: &String| part.channels.iter().find(|(n, _)| n == name).map(|(_, s)| s.as_slice());
    let (Some(r), Some(g), Some(b)) = (plane(&names[0]), plane(&names[1]), plane(&names[2])) else {
        return Err(Error::input("a colour channel is missing"));
    };
    let mut pixels: Vec<[f32; 3]> = r.iter().zip(g).zip(b).map(|((r, g), b)| [*r, *g, *b]).collect();
    if let Some(space) = part.chromaticities {
        match space.to_rec_709() {
            Ok(matrix) if matrix == DMat3::IDENTITY => {}
            Ok(matrix) => {
                convert(&mut pixels, matrix);
                warnings.push("its colours were converted from the file's chromaticities to Rec. 709".to_owned());
            }
            Err(error) => warnings.push(format!("{error}; its colours are taken as Rec. 709")),
        }
    }
    Ok(LinearImage { width: part.width, height: part.height, pixels, warnings })
}

/// A part of a file, decoded.
struct Part {
    name: Option<String>,
    width: usize,
    height: usize,
    display: (usize, usize),
    is_cube: bool,
    chromaticities: Option<Chromaticities>,
    channels: Vec<(String, Vec<f32>)>,
}

impl Part {
    /// Names of the R, G and B channels of one layer: the one without a name first, then in file order.
    fn colour_layer(&self) -> Option<[String; 3]> {
        self.layers().find_map(|prefix| {
            [["R", "G", "B"], ["r", "g", "b"], ["red", "green", "blue"]]
                .map(|names| names.map(|n| format!("{prefix}{n}")))
                .into_iter()
                .find(|names| names.iter().all(|n| self.has(n)))
        })
    }

    /// The Y channel of a layer three times, unless chroma channels go with it.
    fn luminance_layer(&self) -> Option<[String; 3]> {
        self.layers()
            .map(|prefix| (format!("{prefix}Y"), [format!("{prefix}RY"), format!("{prefix}BY")]))
            .find(|(y, chroma)| self.has(y) && !chroma.iter().any(|c| self.has(c)))
            .map(|(y, _)| [y.clone(), y.clone(), y])
    }

    /// Prefixes of channel names, the empty one first; they may repeat.
    fn layers(&self) -> impl Iterator<Item = &str> {
        let prefix = |name: &'_ String| name.rfind('.').map_or(0, |dot| dot + 1);
        std::iter::once("").chain(self.channels.iter().map(move |(name, _)| &name[..prefix(name)]))
    }

    fn has(&self, name: &str) -> bool {
        self.channels.iter().any(|(n, _)| n == name)
    }
}

fn damaged(error: exr::error::Error) -> Error {
    match error {
        exr::error::Error::NotSupported(what) => Error::unsupported(format!("OpenEXR: {what}")),
        exr::error::Error::Io(e) if e.kind() == std::io::ErrorKind::UnexpectedEof => {
            Error::input("OpenEXR: the data end early; the file is truncated or damaged")
        }
        other => Error::input(format!("OpenEXR: {other}; the file is damaged")),
    }
}

/// Runs the decoder; a panic counts as a fault of the file.
fn guarded<T>(decode: impl FnOnce() -> exr::error::Result<T>) -> Result<T> {
    match catch_unwind(AssertUnwindSafe(decode)) {
        Ok(result) => result.map_err(damaged),
        Err(_) => Err(Error::input("OpenEXR: the decoder gave up; the file is damaged")),
    }
}

fn decode_parts(bytes: &[u8]) -> Result<Vec<Part>> {
    // Attributes of odd types do not matter here, so they are skipped rather than refused.
    let meta = guarded(|| MetaData::read_from_buffered(bytes, false))?;
    check_headers(&meta, bytes.len())?;
    let image = guarded(|| {
        openexr::read()
            .no_deep_data()
            .largest_resolution_level()
            .all_channels()
            .all_layers()
            .all_attributes()
            .pedantic()
            .non_parallel()
            .from_buffered(Cursor::new(bytes))
    })?;
    let display = image.attributes.display_window.size;
    let chromaticities = image.attributes.chromaticities.map(|c| {
        let xy = |v: openexr::Vec2<f32>| DVec2::new(f64::from(v.0), f64::from(v.1));
        Chromaticities { primaries: [xy(c.red), xy(c.green), xy(c.blue)], white: xy(c.white) }
    });
    let parts = image.layer_data.into_iter().map(|layer| Part {
        name: layer.attributes.layer_name.as_ref().map(ToString::to_string),
        width: layer.size.0,
        height: layer.size.1,
        display: (display.0, display.1),
        is_cube: layer.attributes.environment_map == Some(attribute::EnvironmentMap::Cube),
        chromaticities,
        channels: channels_as_f32(layer.channel_data),
    });
    Ok(parts.collect())
}

fn channels_as_f32(channels: AnyChannels<FlatSamples>) -> Vec<(String, Vec<f32>)> {
    let as_f32 = |samples| match samples {
        FlatSamples::F16(values) => values.into_iter().map(openexr::f16::to_f32).collect(),
        FlatSamples::F32(values) => values,
        FlatSamples::U32(values) => values.into_iter().map(|v| v as f32).collect(),
    };
    channels.list.into_iter().map(|c| (c.name.to_string(), as_f32(c.sample_data))).collect()
}

/// Bounds the decoder's allocations.
fn check_headers(meta: &MetaData, file_bytes: usize) -> Result<()> {
    if meta.headers.is_empty() {
        return Err(Error::input("OpenEXR: no part; the file is damaged"));
    }
    let mut total = 0_u64;
    for header in &meta.headers {
        if header.deep || meta.requirements.has_deep_data {
            return Err(Error::unsupported("deep pixels; flatten the picture"));
        }
        if let Some(channel) = header.channels.list.iter().find(|c| c.sampling != openexr::Vec2(1, 1)) {
            return Err(Error::unsupported(format!(
                "channel {} has fewer samples than pixels (luminance-chroma); save it as RGB",
                channel.name
            )));
        }
        let bytes_per_pixel = header.channels.list.iter().map(sample_bytes).sum::<u64>();
        let (width, height) = (header.layer_size.0 as u64, header.layer_size.1 as u64);
        check_size(width, height, bytes_per_pixel.max(1))?;
        total = total.saturating_add(width * height * bytes_per_pixel);
        check_blocks(header, file_bytes)?;
    }
    if total > MAX_DECODED_BYTES {
        return Err(Error::unsupported(format!(
            "its parts together take {} MiB, above the limit of {}",
            total >> 20,
            MAX_DECODED_BYTES >> 20
        )));
    }
    Ok(())
}

/// Each block takes 8 bytes in the offset table and 8 of its own, so a header cannot ask for more than the file has.
/// A block (tiles may be of any size) is decoded in one piece and obeys the limit too.
fn check_blocks(header: &Header, file_bytes: usize) -> Result<()> {
    if header.chunk_count > file_bytes / 16 {
        return Err(Error::input(format!(
            "OpenEXR: {} blocks are announced, more than {file_bytes} bytes can hold; the file is truncated or damaged",
            header.chunk_count
        )));
    }
    let block = header.max_block_pixel_size();
    let per_pixel = header.channels.list.iter().map(sample_bytes).sum::<u64>().max(1);
    check_size(block.0 as u64, block.1 as u64, per_pixel)
}

fn sample_bytes(channel: &openexr::ChannelDescription) -> u64 {
    if channel.sample_type == SampleType::F16 { 2 } else { 4 }
}

#[cfg(test)]
#[path = "exr_tests.rs"]
mod tests;
