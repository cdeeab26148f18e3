//! Pictures of base colours, of every format and from every place.

use std::path::Path;

use image::codecs::jpeg::JpegEncoder;
use image::codecs::webp::WebPEncoder;
use image::{ExtendedColorType, ImageEncoder};
use serde_json::{Value, json};

use super::super::base_colour::{BaseColours, read};
use super::{Maker, square};
use crate::error::{ExitCode, Result};
use crate::io::png::encode_png;

/// One colour, 8 by 8.
const SIDE: usize = 8;

/// The same colour as PNG, JPEG and WebP.
fn files() -> [Vec<u8>; 3] {
    let codes = [200u8, 120, 60].repeat(SIDE * SIDE);
    let rgb = [[0.577_580_4, 0.187_820_8, 0.045_186_2]; SIDE * SIDE];
    let (mut jpeg, mut webp) = (Vec::new(), Vec::new());
    let side = SIDE as u32;
    JpegEncoder::new_with_quality(&mut jpeg, 95).write_image(&codes, side, side, ExtendedColorType::Rgb8).unwrap();
    WebPEncoder::new_lossless(&mut webp).write_image(&codes, side, side, ExtendedColorType::Rgb8).unwrap();
    [encode_png(SIDE, SIDE, &rgb, None).unwrap(), jpeg, webp]
}

/// The base colours of a square with these pictures and this texture.
fn colours(pictures: &[&[u8]], texture: &Value) -> Result<BaseColours> {
    let mut maker: Maker = square();
    let views: Vec<usize> = pictures.iter().map(|bytes| maker.view(bytes)).collect();
    maker.json["images"] = views.iter().map(|view| json!({"bufferView": view})).collect();
    maker.json["textures"] = json!([texture]);
    maker.json["materials"] = json!([{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]);
    maker.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    // The geometry does not depend on pictures.
    assert_eq!(maker.read().unwrap().triangles.len(), 2);
    read(&maker.glb(), Path::new("made.glb"))
}

#[test]
fn pictures_of_every_format_are_read() {
    let [png, jpeg, webp] = files();
    let of_webp = json!({"extensions": {"EXT_texture_webp": {"source": 0}}});
    let of_both = json!({"source": 1, "extensions": {"EXT_texture_webp": {"source": 0}}});
    for (pictures, texture) in [
        (vec![&png[..]], json!({"source": 0})),
        (vec![&jpeg[..]], json!({"source": 0})),
        (vec![&webp[..]], of_webp),
        (vec![&webp[..], &png], of_both),
    ] {
        let read = colours(&pictures, &texture).unwrap();
        assert_eq!((read.pictures.len(), read.pictures[0].rgb.len()), (1, SIDE * SIDE));
        for (found, expected) in read.pictures[0].rgb[0].iter().zip([0.5776, 0.1878, 0.0452]) {
            assert!((found - expected).abs() < 0.02, "{texture}: {found}");
        }
    }
}

#[test]
fn other_formats_and_missing_images_are_told() {
    let [png, ..] = files();
    for (texture, code, fragment) in [
        (json!({"extensions": {"KHR_texture_basisu": {"source": 0}}}), ExitCode::Unsupported, "KTX2"),
        (json!({}), ExitCode::InvalidInput, "no image"),
        (json!({"source": 7}), ExitCode::InvalidInput, "image 7"),
        (json!({"extensions": {"EXT_texture_webp": {"source": 7}}}), ExitCode::InvalidInput, "image 7"),
        (json!({"extensions": {"EXT_texture_webp": {"source": -1}}}), ExitCode::InvalidInput, "no image"),
    ] {
        let error = colours(&[&png], &texture).unwrap_err();
        assert!(error.code() == code && error.message().contains(fragment), "{texture}: {error}");
    }
    let error = colours(&[b"GIF89a"], &json!({"source": 0})).unwrap_err();
    assert!(error.code() == ExitCode::Unsupported && error.message().contains("image 0"), "{error}");
}
