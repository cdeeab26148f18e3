//! Writing of OpenEXR pictures: one part, layers as channel prefixes (`diffuse.R`), ZIP over 16 rows, Rec. 709, the
//! same bytes at any thread count.

use std::collections::HashSet;
use std::io::Cursor;

use exr::prelude::{
    AnyChannel, AnyChannels, Compression, FlatSamples, Image, ImageAttributes, IntegerBounds, Layer, LayerAttributes,
    LineOrder, SmallVec, Text, Vec2, WritableImage, attribute, f16,
};

use super::colour::Chromaticities;
use crate::error::{Error, Result};

/// Storage of a channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SampleKind {
    /// 16 bits, for pictures. Values beyond +-65504 are clamped.
    Half,
    /// 32 bits, for data.
    Float,
    /// 32-bit whole numbers from 0 to [`MAX_WHOLE`], for identifiers.
    Whole,
}

/// The largest whole number up to which 32-bit floats represent all.
pub const MAX_WHOLE: f32 = 16_777_216.0;
/// The largest value of 16 bits; values beyond are clamped.
pub const MAX_HALF: f32 = 65_504.0;

/// A channel of a layer.
#[derive(Clone, Debug, PartialEq)]
pub struct ExrChannel {
    /// Name of the channel: `R`, `G`, `B`, `A`, `Z`, ...
    pub name: String,
    /// Storage of the samples.
    pub kind: SampleKind,
    /// `width * height` samples, row by row from the top; no NaN.
    pub samples: Vec<f32>,
}

/// Channels that belong together.
#[derive(Clone, Debug, PartialEq)]
pub struct ExrLayer {
    /// Prefix of its channels in the file; empty for the picture itself.
    pub name: String,
    /// Its channels.
    pub channels: Vec<ExrChannel>,
}

/// A picture to write.
#[derive(Clone, Debug, PartialEq)]
pub struct ExrImage {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Its layers, in any order (a file sorts its channels by name).
    pub layers: Vec<ExrLayer>,
    /// Text attributes of the header: name and value, in this order.
    pub attributes: Vec<(String, String)>,
}

/// Largest side that the format's 32-bit windows hold with room to spare.
const MAX_SIDE: usize = 1 << 24;
/// Largest length of a name; longer names need a flag that old readers refuse.
const MAX_NAME_BYTES: usize = 31;
const ROWS_PER_BLOCK: usize = 16;

impl ExrImage {
    /// Encodes the file.
    ///
    /// # Errors
    /// An empty picture, wrong sample counts, NaN, fractions among whole numbers, doubled, empty or overlong names
    /// (exit 4: a caller's mistake).
    pub fn encode(&self) -> Result<Vec<u8>> {
        if self.width == 0 || self.height == 0 || self.width.max(self.height) > MAX_SIDE {
            return Err(Error::runtime(format!("cannot write {} x {} pixels as OpenEXR", self.width, self.height)));
        }
        let mut names = HashSet::new();
        let mut channels: SmallVec<[AnyChannel<FlatSamples>; 4]> = SmallVec::new();
        for layer in &self.layers {
            for channel in &layer.channels {
                let dot = if layer.name.is_empty() { "" } else { "." };
                let name = format!("{}{dot}{}", layer.name, channel.name);
                channels.push(self.channel(&name, channel)?);
                if !names.insert(name.clone()) {
                    return Err(Error::runtime(format!("channel {name} is there twice")));
                }
            }
        }
        if channels.is_empty() {
            return Err(Error::runtime("an OpenEXR picture needs one channel at least"));
        }
        let encoding = exr::image::Encoding {
            compression: Compression::ZIP16,
            blocks: exr::image::Blocks::ScanLines,
            line_order: LineOrder::Increasing,
        };
        let size = Vec2(self.width, self.height);
        let layer = Layer::new(size, LayerAttributes::default(), encoding, AnyChannels::sort(channels));
        let mut attributes = ImageAttributes::new(IntegerBounds::from_dimensions(size));
        attributes.chromaticities = Some(rec_709());
        let image = Image { attributes, layer_data: layer };
        let mut bytes = Cursor::new(Vec::new());
        let failed = |e: exr::error::Error| Error::runtime(format!("OpenEXR writer: {e}"));
        if rayon::current_num_threads() > 1 {
            image.write().to_buffered(&mut bytes).map_err(failed)?;
        } else {
            image.write().non_parallel().to_buffered(&mut bytes).map_err(failed)?;
        }
        insert_attributes(bytes.into_inner(), &self.attributes, self.height.div_ceil(ROWS_PER_BLOCK))
    }

    fn channel(&self, name: &str, channel: &ExrChannel) -> Result<AnyChannel<FlatSamples>> {
        let text = checked_name(name)?;
        if channel.samples.len() != self.width * self.height {
            return Err(Error::runtime(format!(
                "channel {name} has {} samples where {} x {} need {}",
                channel.samples.len(),
                self.width,
                self.height,
                self.width * self.height
            )));
        }
        if let Some(index) = channel.samples.iter().position(|v| v.is_nan()) {
            let (x, y) = (index % self.width, index / self.width);
            return Err(Error::runtime(format!("channel {name} is not a number at ({x}, {y})")));
        }
        let samples = match channel.kind {
            SampleKind::Float => FlatSamples::F32(channel.samples.clone()),
            SampleKind::Half => {
                let half = |v: &f32| f16::from_f32(v.clamp(-MAX_HALF, MAX_HALF));
                FlatSamples::F16(channel.samples.iter().map(half).collect())
            }
            SampleKind::Whole => {
                let whole = |v: &f32| (0.0..=MAX_WHOLE).contains(v) && v.fract() == 0.0;
                if let Some(odd) = channel.samples.iter().find(|v| !whole(v)) {
                    return Err(Error::runtime(format!("channel {name} holds whole numbers from 0 on, not {odd}")));
                }
                FlatSamples::U32(channel.samples.iter().map(|v| *v as u32).collect())
            }
        };
        Ok(AnyChannel::new(text, samples))
    }
}

fn rec_709() -> attribute::Chromaticities {
    let Chromaticities { primaries: [r, g, b], white } = Chromaticities::REC_709;
    let xy = |v: glam::DVec2| Vec2(v.x as f32, v.y as f32);
    attribute::Chromaticities { red: xy(r), green: xy(g), blue: xy(b), white: xy(white) }
}

fn checked_name(name: &str) -> Result<Text> {
    let usable = !name.is_empty() && name.len() <= MAX_NAME_BYTES && name.bytes().all(|b| (32..127).contains(&b));
    Text::new_or_none(name)
        .filter(|_| usable)
        .ok_or_else(|| Error::runtime(format!("`{name}` is no OpenEXR name (1 to {MAX_NAME_BYTES} ASCII characters)")))
}

/// Adds text attributes to the end of a finished single-part file's header and moves its block offsets along.
///
/// The writer keeps attributes in a hash map with a random order, and bytes must not depend on chance.
fn insert_attributes(mut file: Vec<u8>, attributes: &[(String, String)], blocks: usize) -> Result<Vec<u8>> {
    let unexpected = || Error::runtime("OpenEXR writer: the header has an unexpected form");
    let mut names = HashSet::new();
    let mut at = 8;
    // Each attribute: name, 0, type, 0, 32-bit size, value; an empty name ends the list.
    while file.get(at).ok_or_else(unexpected)? != &0 {
        let name_end = at + zero_after(&file[at..]).ok_or_else(unexpected)?;
        names.insert(String::from_utf8_lossy(&file[at..name_end]).into_owned());
        let size_at = name_end + 2 + zero_after(&file[name_end + 1..]).ok_or_else(unexpected)?;
        let size = file.get(size_at..).and_then(|b| b.first_chunk::<4>()).ok_or_else(unexpected)?;
        at = size_at + 4 + u32::from_le_bytes(*size) as usize;
    }
    let mut insertion = Vec::new();
    for (name, value) in attributes {
        checked_name(name)?;
        if !names.insert(name.clone()) {
            return Err(Error::runtime(format!("OpenEXR attribute {name} is there twice or reserved")));
        }
        let size = i32::try_from(value.len()).map_err(|_| Error::runtime(format!("attribute {name} is too long")))?;
        insertion.extend_from_slice(name.as_bytes());
        insertion.extend_from_slice(b"\0string\0");
        insertion.extend_from_slice(&size.to_le_bytes());
        insertion.extend_from_slice(value.as_bytes());
    }
    let offsets = file.get_mut(at + 1..at + 1 + 8 * blocks).ok_or_else(unexpected)?;
    for offset in offsets.as_chunks_mut::<8>().0 {
        *offset = (u64::from_le_bytes(*offset) + insertion.len() as u64).to_le_bytes();
    }
    file.splice(at..at, insertion);
    Ok(file)
}

fn zero_after(bytes: &[u8]) -> Option<usize> {
    bytes.iter().position(|b| *b == 0)
}
