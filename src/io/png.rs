//! PNG pictures: linear sRGB radiance to 8-bit sRGB and back.

use std::io::Cursor;
use std::path::Path;

use image::codecs::png::{CompressionType, FilterType, PngDecoder, PngEncoder};
use image::{DynamicImage, ExtendedColorType, ImageDecoder, ImageEncoder, ImageError, Limits};

use super::picture::{MAX_DECODED_BYTES, check_size, read_capped};
use crate::error::{Error, Result};
use crate::math::srgb::{linear_from_srgb, srgb_from_linear};

/// A PNG picture as linear sRGB.
#[derive(Clone, Debug, PartialEq)]
pub struct PngImage {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height` pixels in [0, 1], row by row from the top.
    pub rgb: Vec<[f32; 3]>,
    /// Coverage in [0, 1], where the file has it.
    pub alpha: Option<Vec<f32>>,
}

/// Encodes an 8-bit sRGB PNG. `rgb` is linear and clamped to [0, 1]; `alpha` is written unchanged (not premultiplied).
///
/// # Errors
/// An empty picture, wrong lengths, values that are not finite (exit 4: a caller's mistake).
pub fn encode_png(width: usize, height: usize, rgb: &[[f32; 3]], alpha: Option<&[f32]>) -> Result<Vec<u8>> {
    let side = |n: usize| u32::try_from(n).ok().filter(|n| (1..1 << 31).contains(n));
    let (Some(w), Some(h)) = (side(width), side(height)) else {
        return Err(Error::runtime(format!("cannot write {width} x {height} pixels as PNG")));
    };
    if Some(rgb.len()) != width.checked_mul(height) || alpha.is_some_and(|a| a.len() != rgb.len()) {
        return Err(Error::runtime(format!("a PNG of {width} x {height} got {} pixels", rgb.len())));
    }
    let finite = |i: &usize| rgb[*i].iter().all(|c| c.is_finite()) && alpha.is_none_or(|a| a[*i].is_finite());
    if let Some(index) = (0..rgb.len()).find(|i| !finite(i)) {
        let (x, y) = (index % width, index / width);
        return Err(Error::runtime(format!("pixel ({x}, {y}) is not finite, so no PNG was made")));
    }
    let mut bytes = Vec::with_capacity(rgb.len() * if alpha.is_some() { 4 } else { 3 });
    for (i, pixel) in rgb.iter().enumerate() {
        bytes.extend(pixel.map(|c| quantise(srgb_from_linear(f64::from(c.clamp(0.0, 1.0))))));
        bytes.extend(alpha.map(|a| quantise(f64::from(a[i].clamp(0.0, 1.0)))));
    }
    let colour = if alpha.is_some() { ExtendedColorType::Rgba8 } else { ExtendedColorType::Rgb8 };
    let mut file = Vec::new();
    PngEncoder::new_with_quality(&mut file, CompressionType::Default, FilterType::Adaptive)
        .write_image(&bytes, w, h, colour)
        .map_err(|e| Error::runtime(format!("PNG writer: {e}")))?;
    Ok(file)
}

fn quantise(value: f64) -> u8 {
    (value * 255.0).round() as u8
}

/// Reads a PNG of any depth as linear sRGB.
///
/// # Errors
/// A file that cannot be read (exit 2), is damaged (exit 3) or has too many pixels (exit 5).
pub fn read_png(path: &Path) -> Result<PngImage> {
    read_capped(path).and_then(|bytes| decode_png(&bytes).map_err(|e| e.in_file(path)))
}

/// Like [`read_png`], from bytes.
///
/// # Errors
/// As [`read_png`], without the path.
pub fn decode_png(bytes: &[u8]) -> Result<PngImage> {
    let damaged = |e: ImageError| Error::input(format!("PNG: {e}; the file is damaged"));
    let mut limits = Limits::default();
    limits.max_alloc = Some(MAX_DECODED_BYTES);
    let decoder = PngDecoder::with_limits(Cursor::new(bytes), limits).map_err(damaged)?;
    linear(decoder, damaged)
}

/// The picture of a decoder as linear sRGB.
///
/// # Errors
/// Too many pixels (exit 5); what `damaged` says of the decoder's.
pub(super) fn linear(decoder: impl ImageDecoder, damaged: impl Fn(ImageError) -> Error) -> Result<PngImage> {
    let (width, height) = decoder.dimensions();
    // Four floats a pixel are held at once.
    check_size(u64::from(width), u64::from(height), 16)?;
    let has_alpha = decoder.color_type().has_alpha();
    let picture = DynamicImage::from_decoder(decoder).map_err(damaged)?.into_rgba32f();
    let linear = |c: f32| linear_from_srgb(f64::from(c)) as f32;
    Ok(PngImage {
        width: width as usize,
        height: height as usize,
        rgb: picture.pixels().map(|p| [linear(p[0]), linear(p[1]), linear(p[2])]).collect(),
        alpha: has_alpha.then(|| picture.pixels().map(|p| p[3]).collect()),
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::math::random;

    #[test]
    fn every_code_value_survives_the_round_trip() {
        let rgb: Vec<[f32; 3]> = (0..256).map(|i| [linear_from_srgb(f64::from(i) / 255.0) as f32, 0.0, 1.0]).collect();
        let alpha: Vec<f32> = (0..256).map(|i| i as f32 / 255.0).collect();
        let file = encode_png(16, 16, &rgb, Some(&alpha)).unwrap();
        assert_eq!(file, encode_png(16, 16, &rgb, Some(&alpha)).unwrap());
        let read = decode_png(&file).unwrap();
        assert_eq!((read.width, read.height), (16, 16));
        for (i, (got, want)) in read.rgb.iter().zip(&rgb).enumerate() {
            assert!((0..3).all(|c| (got[c] - want[c]).abs() < 1e-6), "{i}");
        }
        assert_eq!(read.alpha.as_deref(), Some(&alpha[..]));
        let opaque = decode_png(&encode_png(16, 16, &rgb, None).unwrap()).unwrap();
        assert!(opaque.alpha.is_none());
    }

    #[test]
    fn values_are_cut_to_the_range_and_must_be_finite() {
        let read = decode_png(&encode_png(2, 1, &[[-3.0, 7.0, 1e30], [0.5; 3]], None).unwrap()).unwrap();
        assert_eq!(read.rgb[0], [0.0, 1.0, 1.0]);
        assert!((read.rgb[1][0] - 0.5).abs() < 0.004);
        for bad in [f32::NAN, f32::INFINITY] {
            let error = encode_png(2, 1, &[[0.0; 3], [0.0, bad, 0.0]], None).unwrap_err();
            assert!(error.message().contains("(1, 0)"), "{error}");
        }
        assert!(encode_png(0, 1, &[], None).is_err());
        assert!(encode_png(2, 2, &[[0.0; 3]; 3], None).is_err());
        assert!(encode_png(1, 1, &[[0.0; 3]], Some(&[])).is_err());
    }

    #[test]
    fn damaged_files_are_errors() {
        let rgb: Vec<[f32; 3]> =
            (0..96).map(|i| std::array::from_fn(|c| random::uniform(1, i, c as u64) as f32)).collect();
        let file = encode_png(12, 8, &rgb, None).unwrap();
        let mut refused = 0;
        for i in 0..10_000 {
            let mut bytes = file.clone();
            if i < file.len() {
                bytes.truncate(i);
            } else {
                let at = (random::bits(2, i as u64, 0) % file.len() as u64) as usize;
                bytes[at] ^= 1 << (random::bits(2, i as u64, 1) % 8);
            }
            refused += usize::from(decode_png(&bytes).is_err());
        }
        assert!(refused > 5_000, "{refused}");
    }
}
