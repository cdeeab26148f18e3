//! Pictures of colours as models have them, PNG, JPEG and WebP, as linear sRGB.

use std::io::Cursor;
use std::path::Path;

use image::codecs::jpeg::JpegDecoder;
use image::codecs::webp::WebPDecoder;
use image::{ImageDecoder, ImageError, Limits};

use super::picture::{MAX_DECODED_BYTES, read_capped};
use super::png::{PngImage, decode_png, linear};
use crate::error::{Error, Result};

/// Reads a PNG, a JPEG or a still WebP as linear sRGB.
///
/// # Errors
/// A file that cannot be read (exit 2); those of [`decode_photo`].
pub fn read_photo(path: &Path) -> Result<PngImage> {
    read_capped(path).and_then(|bytes| decode_photo(&bytes).map_err(|e| e.in_file(path)))
}

/// Decodes a PNG, a JPEG or a still WebP by its first bytes. Profiles and orientations in the file do not count, as glTF
/// wants it.
///
/// # Errors
/// Exit 5 for other formats and too many pixels, 3 for a damaged file.
pub fn decode_photo(bytes: &[u8]) -> Result<PngImage> {
    let starts = |with: &[u8]| bytes.starts_with(with);
    if starts(b"\x89PNG") {
        return decode_png(bytes);
    }
    if starts(b"\xff\xd8\xff") {
        let damaged = damaged("JPEG");
        return decode(JpegDecoder::new(Cursor::new(bytes)).map_err(&damaged)?, damaged);
    }
    if starts(b"RIFF") && bytes.get(8..12) == Some(b"WEBP") {
        let damaged = damaged("WebP");
        let decoder = WebPDecoder::new(Cursor::new(bytes)).map_err(&damaged)?;
        if decoder.has_animation() {
            return Err(Error::unsupported("WebP: it is animated; a still picture is needed"));
        }
        return decode(decoder, damaged);
    }
    Err(Error::unsupported(
        "it is neither PNG, JPEG nor WebP; convert it, for example with `gltf-transform png IN.glb OUT.glb --formats \"*\"`",
    ))
}

fn damaged(format: &'static str) -> impl Fn(ImageError) -> Error {
    move |e| Error::input(format!("{format}: {e}; the file is damaged"))
}

fn decode(mut decoder: impl ImageDecoder, damaged: impl Fn(ImageError) -> Error) -> Result<PngImage> {
    let mut limits = Limits::default();
    limits.max_alloc = Some(MAX_DECODED_BYTES);
    decoder.set_limits(limits).map_err(&damaged)?;
    linear(decoder, damaged)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use image::codecs::jpeg::JpegEncoder;
    use image::codecs::webp::WebPEncoder;
    use image::{ExtendedColorType, ImageEncoder};

    use super::*;
    use crate::error::ExitCode;
    use crate::io::png::encode_png;
    use crate::math::srgb::linear_from_srgb;

    const SIDE: u32 = 16;

    /// The same slow gradient in the three formats, the second with losses.
    fn files() -> [Vec<u8>; 3] {
        let codes: Vec<u8> =
            (0..SIDE * SIDE).flat_map(|i| [60 + (i % SIDE) as u8 * 4, 100, 90 + (i / SIDE) as u8 * 4]).collect();
        let (mut jpeg, mut webp) = (Vec::new(), Vec::new());
        let encoder = JpegEncoder::new_with_quality(&mut jpeg, 95);
        encoder.write_image(&codes, SIDE, SIDE, ExtendedColorType::Rgb8).unwrap();
        WebPEncoder::new_lossless(&mut webp).write_image(&codes, SIDE, SIDE, ExtendedColorType::Rgb8).unwrap();
        let linear = |code: &u8| linear_from_srgb(f64::from(*code) / 255.0) as f32;
        let rgb: Vec<[f32; 3]> = codes.chunks_exact(3).map(|p| [linear(&p[0]), linear(&p[1]), linear(&p[2])]).collect();
        [encode_png(SIDE as usize, SIDE as usize, &rgb, None).unwrap(), jpeg, webp]
    }

    #[test]
    fn the_formats_have_the_same_colours() {
        let [png, jpeg, webp] = files().map(|file| decode_photo(&file).unwrap());
        assert_eq!(png, webp);
        assert_eq!((jpeg.width, jpeg.height, jpeg.alpha), (png.width, png.height, None));
        let off = jpeg.rgb.iter().zip(&png.rgb).flat_map(|(a, b)| (0..3).map(|c| (a[c] - b[c]).abs()));
        assert!(off.fold(0.0, f32::max) < 0.02);
    }

    #[test]
    fn damaged_and_other_files_are_errors() {
        for file in files() {
            for length in 0..file.len() {
                // Decoders of JPEG fill what is missing at the end; nothing may panic.
                let read = decode_photo(&file[..length]);
                assert!(length > 12 || read.is_err(), "{length}");
                let mut bent = file.clone();
                bent[length] ^= 0xff;
                drop(decode_photo(&bent));
            }
        }
        for (bytes, code) in [
            (&b"GIF89a"[..], ExitCode::Unsupported),
            (b"\xabKTX 20\xbb", ExitCode::Unsupported),
            (b"\xff\xd8\xff\xe0", ExitCode::InvalidInput),
            (b"RIFF\0\0\0\0WEBP", ExitCode::InvalidInput),
        ] {
            assert_eq!(decode_photo(bytes).unwrap_err().code(), code);
        }
    }
}
