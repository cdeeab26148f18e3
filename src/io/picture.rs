//! Pictures of radiance read from files, and the limits of their size.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use glam::{DMat3, DVec3};

use crate::error::{Error, Result};

/// Largest memory for the decoded pixels of one picture.
pub const MAX_DECODED_BYTES: u64 = 1 << 30;

/// Largest picture file that is read.
pub const MAX_FILE_BYTES: u64 = 1 << 31;

/// A picture in linear sRGB, row by row from the top, as stored in its file: values may be negative or not finite.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearImage {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height` pixels.
    pub pixels: Vec<[f32; 3]>,
    /// Warnings about the way in which the file was read.
    pub warnings: Vec<String>,
}

/// Reads a whole file of at most [`MAX_FILE_BYTES`].
pub(super) fn read_capped(path: &Path) -> Result<Vec<u8>> {
    let io = |e: std::io::Error| Error::io(path, &e);
    let file = File::open(path).map_err(io)?;
    let meta = file.metadata().map_err(io)?;
    if meta.is_dir() {
        return Err(Error::new(
            crate::error::ExitCode::Io,
            format!("{}: is a folder; give the picture's file", path.display()),
        ));
    }
    let mut bytes = Vec::new();
    // A pipe or device has no length, so the limit holds while reading too.
    file.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes).map_err(io)?;
    if bytes.len() as u64 > MAX_FILE_BYTES {
        return Err(Error::unsupported(format!(
            "{}: pictures above {} MiB are not read; reduce its resolution",
            path.display(),
            MAX_FILE_BYTES >> 20
        )));
    }
    Ok(bytes)
}

/// Refuses pictures whose pixels would not fit [`MAX_DECODED_BYTES`], before anything is allocated.
pub(super) fn check_size(width: u64, height: u64, bytes_per_pixel: u64) -> Result<()> {
    if width == 0 || height == 0 {
        return Err(Error::input(format!("its header says {width} x {height} pixels")));
    }
    match width.checked_mul(height).and_then(|n| n.checked_mul(bytes_per_pixel)) {
        Some(bytes) if bytes <= MAX_DECODED_BYTES => Ok(()),
        _ => Err(Error::unsupported(format!(
            "its header says {width} x {height} pixels of {bytes_per_pixel} bytes, above the limit of {} MiB; \
             reduce its resolution, or repair the file if that is not its size",
            MAX_DECODED_BYTES >> 20
        ))),
    }
}

/// Applies a colour matrix in place; the identity changes no bits.
pub(super) fn convert(pixels: &mut [[f32; 3]], matrix: DMat3) {
    if matrix != DMat3::IDENTITY {
        for pixel in pixels {
            *pixel = (matrix * DVec3::from_array(pixel.map(f64::from))).to_array().map(|c| c as f32);
        }
    }
}
