//! Radiance .hdr pictures (RGBE, with and without run lengths), top row first.

use std::path::Path;

/// Width, height and linear RGB pixels.
///
/// # Panics
/// On any file that is not what a test should feed it.
pub fn read_hdr(path: &Path) -> (usize, usize, Vec<[f32; 3]>) {
    parse_hdr(&std::fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display())))
}

/// The same from the bytes of a file.
pub fn parse_hdr(bytes: &[u8]) -> (usize, usize, Vec<[f32; 3]>) {
    let blank = bytes.windows(2).position(|w| w == b"\n\n").unwrap();
    let size_end = blank + 2 + bytes[blank + 2..].iter().position(|&b| b == b'\n').unwrap();
    let size = String::from_utf8_lossy(&bytes[blank + 2..size_end]).into_owned();
    let words: Vec<&str> = size.split_whitespace().collect();
    assert!(words[0] == "-Y" && words[2] == "+X", "unusual orientation {size}");
    let (height, width): (usize, usize) = (words[1].parse().unwrap(), words[3].parse().unwrap());
    let mut at = size_end + 1;
    let mut pixels = Vec::with_capacity(width * height);
    for _ in 0..height {
        let mut row = vec![[0u8; 4]; width];
        if bytes[at] == 2 && bytes[at + 1] == 2 && bytes[at + 2] < 128 {
            at += 4;
            for channel in [0, 1, 2, 3] {
                let mut x = 0;
                while x < width {
                    let count = usize::from(bytes[at]);
                    let run = if count > 128 { count - 128 } else { count };
                    for k in 0..run {
                        row[x + k][channel] = if count > 128 { bytes[at + 1] } else { bytes[at + 1 + k] };
                    }
                    at += if count > 128 { 2 } else { 1 + count };
                    x += run;
                }
            }
        } else {
            for pixel in &mut row {
                pixel.copy_from_slice(&bytes[at..at + 4]);
                at += 4;
            }
        }
        pixels.extend(row.iter().map(|p| {
            let scale = if p[3] == 0 { 0.0 } else { 2.0_f64.powi(i32::from(p[3]) - 136) };
            [0, 1, 2].map(|k| (f64::from(p[k]) * scale) as f32)
        }));
    }
    (width, height, pixels)
}
