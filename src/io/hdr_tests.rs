#![allow(clippy::unwrap_used)]

use super::*;
use crate::error::ExitCode;
use crate::math::random;

fn file(variables: &str, resolution: &str, data: &[u8]) -> Vec<u8> {
    let mut bytes =
        format!("#?RADIANCE\n# made by hand\n{variables}FORMAT=32-bit_rle_rgbe\n\n{resolution}\n").into_bytes();
    bytes.extend_from_slice(data);
    bytes
}

/// 2 x 2 plain pixels: 1, 2 / 4, (0.5, 1, 0).
const FLAT: [u8; 16] = [128, 128, 128, 129, 128, 128, 128, 130, 128, 128, 128, 131, 64, 128, 0, 129];

fn small_rle(width: usize, height: usize) -> Vec<u8> {
    let pixels: Vec<image::Rgb<f32>> = (0..width * height)
        .map(|i| image::Rgb(std::array::from_fn(|c| (random::uniform(4, (i / 5) as u64, c as u64) * 9.0) as f32)))
        .collect();
    let mut bytes = Vec::new();
    image::codecs::hdr::HdrEncoder::new(&mut bytes).encode(&pixels, width, height).unwrap();
    bytes
}

#[test]
fn plain_pixels_and_every_row_order_are_read() {
    let (a, b, c, d) = ([1.0_f32; 3], [2.0_f32; 3], [4.0_f32; 3], [0.5_f32, 1.0, 0.0]);
    for (resolution, expected) in [
        ("-Y 2 +X 2", [a, b, c, d]),
        ("+Y 2 +X 2", [c, d, a, b]),
        ("-Y 2 -X 2", [b, a, d, c]),
        ("+Y 2 -X 2", [d, c, b, a]),
    ] {
        let read = decode(&file("", resolution, &FLAT)).unwrap();
        assert_eq!((read.width, read.height, read.pixels), (2, 2, expected.to_vec()), "{resolution}");
        assert!(read.warnings.is_empty());
    }
}

#[test]
fn old_runs_repeat_the_pixel_before() {
    let mut data = vec![128, 64, 0, 129, 1, 1, 1, 4, 1, 1, 1, 1];
    data.extend_from_slice(&[0, 0, 0, 0]);
    let read = decode(&file("", "-Y 1 +X 262", &data)).unwrap();
    assert!(read.pixels[..261].iter().all(|p| *p == [1.0, 0.5, 0.0]));
    assert_eq!(read.pixels[261], [0.0; 3]);
}

#[test]
fn run_length_files_agree_with_the_image_crate() {
    for (width, height) in [(8, 3), (7, 2), (300, 5)] {
        let bytes = small_rle(width, height);
        let ours = decode(&bytes).unwrap();
        let theirs = image::load_from_memory_with_format(&bytes, image::ImageFormat::Hdr).unwrap().into_rgb32f();
        assert_eq!(ours.pixels.as_flattened(), theirs.as_raw().as_slice());
    }
}

#[test]
fn header_variables_are_honoured() {
    let read = decode(&file("EXPOSURE=2\nEXPOSURE=0.25\nCOLORCORR=1 2 4\n", "-Y 2 +X 2", &FLAT)).unwrap();
    assert_eq!(read.pixels[0], [2.0, 1.0, 0.5]);
    assert_eq!(read.warnings.len(), 1);
    let unknown = decode(&file("PRIMARIES=0 0 0 0 0 0 0 0\nGAMMA=1\n", "-Y 2 +X 2", &FLAT)).unwrap();
    assert_eq!((unknown.pixels[0], unknown.warnings.len()), ([1.0; 3], 0));
    let wide =
        decode(&file("PRIMARIES=0.708 0.292 0.170 0.797 0.131 0.046 0.3127 0.3290\n", "-Y 2 +X 2", &FLAT)).unwrap();
    assert!(wide.pixels[0].iter().all(|c| (c - 1.0).abs() < 1e-6), "white stays: {:?}", wide.pixels[0]);
    assert!(wide.pixels[3][1] > 1.0 && wide.warnings.len() == 1);
    let crlf = String::from_utf8(file("", "-Y 1 +X 1", b"")).unwrap().replace('\n', "\r\n").into_bytes();
    assert_eq!(decode(&[crlf, FLAT[..4].to_vec()].concat()).unwrap().pixels, [[1.0; 3]]);
    let extremes = decode(&file("", "-Y 1 +X 2", &[255, 255, 1, 255, 1, 255, 0, 1])).unwrap();
    assert!(extremes.pixels.iter().flatten().all(|c| c.is_finite()));
    assert_eq!(extremes.pixels[0][0], 255.0 * 2.0_f32.powi(119));
}

#[test]
fn errors_say_what_is_wrong() {
    let flat = |variables: &str, resolution: &str| file(variables, resolution, &FLAT);
    for (bytes, code, part) in [
        (b"#?RADIANCE".to_vec(), ExitCode::InvalidInput, "ends early"),
        (flat("", "-Y 2 +X 3"), ExitCode::InvalidInput, "data end early"),
        (flat("", "-Y 0 +X 3"), ExitCode::InvalidInput, "resolution line"),
        (flat("", "-Y two +X 3"), ExitCode::InvalidInput, "resolution line"),
        (flat("", "+X 2 -Y 2"), ExitCode::Unsupported, "columns"),
        (flat("", "-Y 4000000000 +X 4000000000"), ExitCode::Unsupported, "limit"),
        (flat("FORMAT=32-bit_rle_xyze\n", "-Y 2 +X 2"), ExitCode::Unsupported, "ra_xyze"),
        (flat("FORMAT=ascii\n", "-Y 2 +X 2"), ExitCode::Unsupported, "FORMAT=ascii"),
        (flat("EXPOSURE=0\n", "-Y 2 +X 2"), ExitCode::InvalidInput, "positive factor"),
        (flat("EXPOSURE=NaN\n", "-Y 2 +X 2"), ExitCode::InvalidInput, "positive factor"),
        (flat("EXPOSURE=\n", "-Y 2 +X 2"), ExitCode::InvalidInput, "positive factor"),
        (flat("PRIMARIES=1 2\n", "-Y 2 +X 2"), ExitCode::InvalidInput, "eight numbers"),
        (file("", "-Y 1 +X 2", &[1, 1, 1, 1, 0, 0, 0, 0]), ExitCode::InvalidInput, "without a pixel"),
        (file("", "-Y 1 +X 2", &[9, 9, 9, 9, 1, 1, 1, 2]), ExitCode::InvalidInput, "past the row's end"),
        (file("", "-Y 1 +X 8", &[2, 2, 0, 9, 136, 1]), ExitCode::InvalidInput, "differs from the width"),
        (file("", "-Y 1 +X 8", &[2, 2, 0, 8, 137, 1]), ExitCode::InvalidInput, "past the row's end"),
        (file("", "-Y 1 +X 8", &[2, 2, 0, 8, 0, 1]), ExitCode::InvalidInput, "length zero"),
    ] {
        let error = decode(&bytes).expect_err(part);
        assert_eq!(error.code(), code, "{error}");
        assert!(error.message().contains(part), "{part}: {error}");
    }
}

#[test]
fn ten_thousand_damaged_files_do_no_harm() {
    let flat = file("EXPOSURE=1\n", "-Y 2 +X 2", &FLAT);
    for (seed, bytes) in [small_rle(16, 6), small_rle(5, 3), flat].into_iter().enumerate() {
        let mut refused = 0;
        for i in 0..10_000_u64 {
            let random = |d: u64| random::bits(seed as u64, i, d) as usize;
            let mut mutant = bytes.clone();
            if i < bytes.len() as u64 {
                mutant.truncate(i as usize);
                assert!(decode(&mutant).is_err(), "cut at {i} was accepted");
            }
            for flip in 0..(random(0) % 4) as u64 {
                if let Some(count) = std::num::NonZeroUsize::new(mutant.len()) {
                    mutant[random(2 * flip + 1) % count] ^= 1 << (random(2 * flip + 2) % 8);
                }
            }
            refused += usize::from(decode(&mutant).is_err());
        }
        assert!(refused > 500, "{refused}");
    }
}
