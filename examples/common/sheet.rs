//! Pictures side by side.

use translux::error::Result;
use translux::io::png::encode_png;

/// Pixels between two pictures.
const GAP: usize = 4;

/// Rows of square pictures as one PNG, white between them.
pub(crate) fn png(side: usize, rows: &[Vec<Vec<[f32; 3]>>]) -> Result<Vec<u8>> {
    let pixels = |count: usize| (count * (side + GAP)).saturating_sub(GAP);
    let (width, height) = (pixels(rows.iter().map(Vec::len).max().unwrap_or(0)), pixels(rows.len()));
    let mut all = vec![[1.0; 3]; width * height];
    for (y, row) in rows.iter().enumerate() {
        for (x, picture) in row.iter().enumerate() {
            for (line, pixels) in picture.chunks_exact(side).take(side).enumerate() {
                let at = (y * (side + GAP) + line) * width + x * (side + GAP);
                all[at..at + side].copy_from_slice(pixels);
            }
        }
    }
    encode_png(width, height, &all, None)
}
