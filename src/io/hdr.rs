//! Radiance HDR pictures (RGBE): every run-length form, header variables honoured.
//!
//! Format: Ward, "Real Pixels" (Graphics Gems II, 1991) and the Radiance reference manual's picture description. A
//! pixel is mantissa * 2^(exponent - 136), as in all common readers.

use glam::{DMat3, DVec2, DVec3};

use super::colour::Chromaticities;
use super::picture::{LinearImage, check_size, convert};
use crate::error::{Error, Result};

/// Largest number of bytes of a header.
const MAX_HEADER_BYTES: usize = 1 << 16;

/// Decodes a picture to linear sRGB radiance. EXPOSURE and COLORCORR are divided out and PRIMARIES converted, as the
/// format asks for, each with a warning.
///
/// # Errors
/// Damage, truncation (exit 3); XYZE pixels, column-major order, a size above the limit (exit 5).
pub fn decode(bytes: &[u8]) -> Result<LinearImage> {
    let (header, data) = Header::read(bytes)?;
    check_size(header.width as u64, header.height as u64, 12)?;
    let mut pixels = Vec::new();
    let mut rest = data;
    let mut scanline = vec![[0_u8; 4]; header.width];
    for row in 0..header.height {
        rest = read_scanline(rest, &mut scanline)
            .map_err(|what| Error::input(format!("row {row} of {}: {what}; the file is damaged", header.height)))?;
        pixels.extend(scanline.iter().map(|rgbe| radiance(*rgbe, header.divisor)));
    }
    if header.right_to_left {
        pixels.chunks_exact_mut(header.width).for_each(<[_]>::reverse);
    }
    if header.bottom_up {
        pixels = pixels.chunks_exact(header.width).rev().flatten().copied().collect();
    }
    convert(&mut pixels, header.to_rec_709);
    Ok(LinearImage { width: header.width, height: header.height, pixels, warnings: header.warnings })
}

struct Header {
    width: usize,
    height: usize,
    bottom_up: bool,
    right_to_left: bool,
    divisor: DVec3,
    to_rec_709: DMat3,
    warnings: Vec<String>,
}

impl Header {
    fn read(bytes: &[u8]) -> Result<(Self, &[u8])> {
        let mut header = Self {
            width: 0,
            height: 0,
            bottom_up: false,
            right_to_left: false,
            divisor: DVec3::ONE,
            to_rec_709: DMat3::IDENTITY,
            warnings: Vec::new(),
        };
        let (signature, mut rest) = line(bytes)?;
        if !signature.starts_with("#?") {
            return Err(Error::input("no Radiance picture: it does not start with #?RADIANCE"));
        }
        loop {
            let (text, after) = line(rest)?;
            rest = after;
            if text.is_empty() {
                break;
            }
            header.variable(text.trim())?;
            if bytes.len() - rest.len() > MAX_HEADER_BYTES {
                return Err(Error::input(format!("its header is longer than {MAX_HEADER_BYTES} bytes")));
            }
        }
        let (resolution, data) = line(rest)?;
        header.resolution(&resolution)?;
        if header.divisor != DVec3::ONE {
            let DVec3 { x, y, z } = header.divisor;
            header.warnings.push(format!("the header's EXPOSURE and COLORCORR ({x}, {y}, {z}) were divided out"));
        }
        Ok((header, data))
    }

    fn variable(&mut self, text: &str) -> Result<()> {
        let Some((name, value)) = text.split_once('=').filter(|_| !text.starts_with('#')) else { return Ok(()) };
        let (name, value) = (name.trim(), value.trim());
        match name {
            "FORMAT" if value == "32-bit_rle_xyze" => {
                return Err(Error::unsupported("XYZE pixels; convert it with `ra_xyze -r`"));
            }
            "FORMAT" if value != "32-bit_rle_rgbe" => {
                return Err(Error::unsupported(format!("FORMAT={value}; only 32-bit_rle_rgbe is read")));
            }
            "EXPOSURE" => self.divide(name, value, &[0, 0, 0])?,
            "COLORCORR" => self.divide(name, value, &[0, 1, 2])?,
            "PRIMARIES" => self.primaries(value)?,
            "GAMMA" if value.parse::<f64>().ok() != Some(1.0) => {
                self.warnings.push(format!("GAMMA={value} is ignored: the pixels are taken as linear"));
            }
            _ => {}
        }
        Ok(())
    }

    fn divide(&mut self, name: &str, value: &str, channels: &[usize; 3]) -> Result<()> {
        let numbers = floats(name, value)?;
        for (channel, index) in channels.iter().enumerate() {
            match numbers.get(*index) {
                Some(n) if n.is_normal() && *n > 0.0 => self.divisor[channel] *= n,
                _ => return Err(Error::input(format!("{name}={value} is not a positive factor"))),
            }
        }
        if self.divisor.is_finite() && self.divisor.min_element() > 0.0 {
            Ok(())
        } else {
            Err(Error::input(format!("{name}={value} makes the exposure overflow")))
        }
    }

    fn primaries(&mut self, value: &str) -> Result<()> {
        let numbers = floats("PRIMARIES", value)?;
        let [rx, ry, gx, gy, bx, by, wx, wy] = numbers[..] else {
            return Err(Error::input(format!("PRIMARIES={value} does not have eight numbers")));
        };
        // Photoshop writes eight zeros for "not known".
        if numbers.iter().all(|n| *n == 0.0) {
            return Ok(());
        }
        let space = Chromaticities {
            primaries: [DVec2::new(rx, ry), DVec2::new(gx, gy), DVec2::new(bx, by)],
            white: DVec2::new(wx, wy),
        };
        self.to_rec_709 = space.to_rec_709().map_err(|e| e.at(format!("PRIMARIES={value}")))?;
        if self.to_rec_709 != DMat3::IDENTITY {
            self.warnings.push(format!("its colours were converted from PRIMARIES={value} to Rec. 709"));
        }
        Ok(())
    }

    fn resolution(&mut self, text: &str) -> Result<()> {
        let bad = || Error::input(format!("its resolution line is `{text}` where `-Y height +X width` belongs"));
        let words: Vec<&str> = text.split_ascii_whitespace().collect();
        let [first, height, second, width] = words[..] else { return Err(bad()) };
        match (first, second) {
            ("-Y" | "+Y", "+X" | "-X") => {}
            ("-X" | "+X", "+Y" | "-Y") => {
                return Err(Error::unsupported(format!(
                    "its pixels run in columns (`{text}`); turn it with `protate`"
                )));
            }
            _ => return Err(bad()),
        }
        self.bottom_up = first == "+Y";
        self.right_to_left = second == "-X";
        let size = |word: &str| word.parse::<u32>().ok().filter(|n| *n > 0).map(|n| n as usize).ok_or_else(bad);
        (self.height, self.width) = (size(height)?, size(width)?);
        Ok(())
    }
}

fn floats(name: &str, value: &str) -> Result<Vec<f64>> {
    value
        .split_ascii_whitespace()
        .map(|word| word.parse().map_err(|_| Error::input(format!("{name}={value}: `{word}` is not a number"))))
        .collect()
}

/// The next header line without its end, and the bytes after it.
fn line(bytes: &[u8]) -> Result<(String, &[u8])> {
    let window = &bytes[..bytes.len().min(MAX_HEADER_BYTES)];
    match window.iter().position(|b| *b == b'\n') {
        Some(end) => {
            let text = String::from_utf8_lossy(&window[..end]);
            Ok((text.strip_suffix('\r').unwrap_or(&text).to_owned(), &bytes[end + 1..]))
        }
        None => Err(Error::input("its header ends early; the file is truncated or no Radiance picture")),
    }
}

fn radiance([r, g, b, exponent]: [u8; 4], divisor: DVec3) -> [f32; 3] {
    if exponent == 0 {
        return [0.0; 3];
    }
    // 2^(exponent - 136), built from its bits: exact.
    let scale = f64::from_bits((u64::from(exponent) + 1023 - 136) << 52);
    let colour = DVec3::new(f64::from(r), f64::from(g), f64::from(b)) * scale / divisor;
    colour.to_array().map(|c| c as f32)
}

const TRUNCATED: &str = "the data end early";

fn read_scanline<'a>(bytes: &'a [u8], pixels: &mut [[u8; 4]]) -> std::result::Result<&'a [u8], &'static str> {
    match bytes {
        [2, 2, high, low, rest @ ..] if *high < 128 && (8..0x8000).contains(&pixels.len()) => {
            if usize::from(*high) << 8 | usize::from(*low) != pixels.len() {
                return Err("its length differs from the width");
            }
            read_planes(rest, pixels)
        }
        _ => read_flat(bytes, pixels),
    }
}

/// Reads the run-length form since 1991: each component in runs of its own.
fn read_planes<'a>(mut bytes: &'a [u8], pixels: &mut [[u8; 4]]) -> std::result::Result<&'a [u8], &'static str> {
    for component in 0..4 {
        let mut x = 0;
        while x < pixels.len() {
            let (&code, rest) = bytes.split_first().ok_or(TRUNCATED)?;
            let is_run = code > 128;
            let count = usize::from(if is_run { code - 128 } else { code });
            let used = if is_run { 1 } else { count };
            if count == 0 {
                return Err("a run of length zero");
            }
            let values = rest.get(..used).ok_or(TRUNCATED)?;
            let target = pixels.get_mut(x..x + count).ok_or("a run goes past the row's end")?;
            for (pixel, value) in target.iter_mut().zip(values.iter().cycle()) {
                pixel[component] = *value;
            }
            bytes = &rest[used..];
            x += count;
        }
    }
    Ok(bytes)
}

/// Reads plain pixels with the old runs: (1, 1, 1, n) repeats the pixel before n times, and n counts 256 times more in
/// each further such pixel.
fn read_flat<'a>(mut bytes: &'a [u8], pixels: &mut [[u8; 4]]) -> std::result::Result<&'a [u8], &'static str> {
    let (mut x, mut shift) = (0_usize, 0_u32);
    while x < pixels.len() {
        let (pixel, rest) = bytes.split_first_chunk::<4>().ok_or(TRUNCATED)?;
        bytes = rest;
        if pixel[..3] != [1, 1, 1] {
            pixels[x] = *pixel;
            (x, shift) = (x + 1, 0);
            continue;
        }
        let previous = *x.checked_sub(1).and_then(|i| pixels.get(i)).ok_or("a run without a pixel before it")?;
        let count = if shift < 32 { usize::from(pixel[3]) << shift } else { usize::MAX };
        let target =
            x.checked_add(count).and_then(|end| pixels.get_mut(x..end)).ok_or("a run goes past the row's end")?;
        target.fill(previous);
        (x, shift) = (x + count, shift + 8);
    }
    Ok(bytes)
}

#[cfg(test)]
#[path = "hdr_tests.rs"]
mod tests;
