#![allow(clippy::unwrap_used)]

use exr::prelude::{
    AnyChannel, Blocks, Compression, Encoding, Image, ImageAttributes, IntegerBounds, Layer, LayerAttributes,
    LineOrder, SmallVec, Vec2, WritableImage,
};

use super::*;
use crate::error::ExitCode;
use crate::io::exr_write::{ExrChannel, ExrImage, ExrLayer, SampleKind};
use crate::math::random;

fn samples(count: usize, seed: u64) -> Vec<f32> {
    (0..count).map(|i| (random::uniform(seed, i as u64, 0) * 8.0) as f32).collect()
}

fn channel(name: &str, kind: SampleKind, count: usize) -> ExrChannel {
    ExrChannel { name: name.into(), kind, samples: samples(count, name.len() as u64 + u64::from(name.as_bytes()[0])) }
}

fn picture(width: usize, height: usize) -> ExrImage {
    let n = width * height;
    let layer = |name: &str, channels: &[&str], kind| ExrLayer {
        name: name.into(),
        channels: channels.iter().map(|c| channel(c, kind, n)).collect(),
    };
    ExrImage {
        width,
        height,
        layers: vec![
            layer("", &["R", "G", "B", "A"], SampleKind::Half),
            layer("irradiance", &["R", "G", "B"], SampleKind::Float),
            layer("depth", &["Z"], SampleKind::Float),
        ],
        attributes: vec![
            ("light".into(), "constant:radiance=1".into()),
            ("anotherOne".into(), "ü and \n".into()),
            ("empty".into(), String::new()),
        ],
    }
}

fn only(width: usize, height: usize, names: &[&str]) -> ExrImage {
    let channels = names.iter().map(|n| channel(n, SampleKind::Float, width * height)).collect();
    let layers = vec![ExrLayer { name: String::new(), channels }];
    ExrImage { width, height, layers, attributes: Vec::new() }
}

#[test]
fn whole_numbers_are_kept_and_others_refused() {
    let image = |samples: Vec<f32>| ExrImage {
        layers: vec![ExrLayer {
            name: "part".into(),
            channels: vec![ExrChannel { name: "ID".into(), kind: SampleKind::Whole, samples }],
        }],
        ..only(3, 1, &["R"])
    };
    let ids = vec![0.0, 1.0, 16_777_216.0];
    let planes = decode_planes(&image(ids.clone()).encode().unwrap()).unwrap();
    assert_eq!((planes[0].name.as_str(), &planes[0].samples), ("part.ID", &ids));
    for odd in [-1.0, 0.5, 3e7, f32::INFINITY, f32::NAN] {
        assert!(image(vec![0.0, odd, 1.0]).encode().is_err(), "{odd}");
    }
}

#[test]
fn what_is_written_reads_back() {
    for (width, height) in [(1, 1), (37, 16), (20, 53)] {
        let image = picture(width, height);
        let planes = decode_planes(&image.encode().unwrap()).unwrap();
        assert_eq!(planes.len(), 8);
        for layer in &image.layers {
            for channel in &layer.channels {
                let name = if layer.name.is_empty() {
                    channel.name.clone()
                } else {
                    format!("{}.{}", layer.name, channel.name)
                };
                let plane = planes.iter().find(|p| p.name == name).unwrap();
                assert_eq!((plane.width, plane.height), (width, height));
                let exact = channel.kind == SampleKind::Float;
                for (got, want) in plane.samples.iter().zip(&channel.samples) {
                    assert!(
                        if exact { got == want } else { (got - want).abs() <= 0.0005 * want.abs() + 1e-7 },
                        "{name}"
                    );
                }
            }
        }
    }
}

#[test]
fn attributes_reach_the_header_in_order() {
    let image = picture(9, 40);
    let bytes = image.encode().unwrap();
    let meta = MetaData::read_from_buffered(bytes.as_slice(), true).unwrap();
    let other = &meta.headers[0].own_attributes.other;
    assert_eq!(other.len(), 3, "{other:?}");
    for (name, _) in &image.attributes {
        assert!(other.contains_key(&openexr::Text::from(name.as_str())), "{name}");
    }
    let find = |text: &str| bytes.windows(text.len()).position(|w| w == text.as_bytes()).unwrap();
    assert!(find("light\0string") < find("anotherOne\0string") && find("anotherOne\0") < find("empty\0string"));
    // The header ends after the last attribute; the table behind it must point at blocks of rows 0, 16 and 32.
    let table = find("empty\0string\0") + "empty\0string\0".len() + 4 + 1;
    for block in 0..3 {
        let offset = u64::from_le_bytes(*bytes[table + 8 * block..].first_chunk().unwrap()) as usize;
        assert_eq!(i32::from_le_bytes(*bytes[offset..].first_chunk().unwrap()), 16 * block as i32);
    }
    let white = meta.headers[0].shared_attributes.chromaticities.unwrap().white;
    assert_eq!(white, Vec2(0.3127, 0.3290));
}

#[test]
fn bytes_do_not_depend_on_threads_or_chance() {
    let image = picture(200, 150);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| image.encode().unwrap())
    };
    let one = with(1);
    for threads in [1, 2, 4] {
        assert!(with(threads) == one, "{threads} threads");
    }
}

#[test]
fn the_writer_refuses_what_readers_would() {
    let change = |f: fn(&mut ExrImage)| {
        let mut image = picture(4, 3);
        f(&mut image);
        image.encode().expect_err("refused").message().to_owned()
    };
    assert!(change(|i| i.layers[2].channels[0].samples[5] = f32::NAN).contains("(1, 1)"));
    assert!(change(|i| i.layers[0].channels[0].samples.truncate(5)).contains("5 samples"));
    assert!(change(|i| i.layers[0].channels[1].name = "R".into()).contains("twice"));
    assert!(change(|i| i.layers[0].channels[1].name = String::new()).contains("no OpenEXR name"));
    assert!(change(|i| i.layers[0].name = "x".repeat(40)).contains("no OpenEXR name"));
    assert!(change(|i| i.attributes[1].0 = "light".into()).contains("twice"));
    assert!(change(|i| i.attributes[1].0 = "channels".into()).contains("reserved"));
    assert!(change(|i| i.attributes[1].0 = "a\0b".into()).contains("no OpenEXR name"));
    assert!(change(|i| i.layers.clear()).contains("one channel"));
    assert!(change(|i| i.width = 0).contains("0 x 3"));
    let mut bright = picture(4, 3);
    bright.layers[0].channels[0].samples[0] = 1e30;
    let planes = decode_planes(&bright.encode().unwrap()).unwrap();
    assert_eq!(planes.iter().find(|p| p.name == "R").unwrap().samples[0], 65504.0);
}

#[test]
fn colour_is_found_in_layers_and_luminance_stands_in_for_it() {
    let read = decode_rgb(&picture(6, 3).encode().unwrap()).unwrap();
    assert_eq!((read.width, read.height, read.warnings.len()), (6, 3, 0));
    let mut layered = picture(6, 3);
    layered.layers.remove(0);
    let read = decode_rgb(&layered.encode().unwrap()).unwrap();
    assert_eq!(read.pixels[4], [0, 1, 2].map(|c| layered.layers[0].channels[c].samples[4]));
    assert!(read.warnings[0].contains("irradiance"), "{:?}", read.warnings);
    let grey = only(4, 2, &["Y"]);
    let read = decode_rgb(&grey.encode().unwrap()).unwrap();
    assert_eq!(read.pixels[3], [grey.layers[0].channels[0].samples[3]; 3]);
    for names in [&["Z"][..], &["Y", "RY", "BY"], &["R", "G"]] {
        let error = decode_rgb(&only(4, 2, names).encode().unwrap()).unwrap_err();
        assert_eq!(error.code(), ExitCode::Unsupported);
        assert!(error.message().contains(names[0]), "{error}");
    }
}

/// Replaces the value of an attribute of a written file; the new value has the same length.
fn with_attribute(mut bytes: Vec<u8>, name_and_type: &str, value: &[u8]) -> Vec<u8> {
    let at = bytes.windows(name_and_type.len()).position(|w| w == name_and_type.as_bytes()).unwrap();
    let start = at + name_and_type.len() + 4;
    bytes[start..start + value.len()].copy_from_slice(value);
    bytes
}

#[test]
fn chromaticities_are_converted_or_warned_about() {
    let mut image = only(4, 2, &["R", "G", "B"]);
    image.layers[0].channels.iter_mut().for_each(|c| c.samples.fill(0.5));
    image.layers[0].channels[1].samples[0] = 1.0;
    let bytes = image.encode().unwrap();
    let set = |numbers: [f32; 8]| {
        let value: Vec<u8> = numbers.iter().flat_map(|n| n.to_le_bytes()).collect();
        decode_rgb(&with_attribute(bytes.clone(), "chromaticities\0chromaticities\0", &value)).unwrap()
    };
    let wide = set([0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290]);
    assert!(wide.pixels[1].iter().all(|c| (c - 0.5).abs() < 1e-6), "{:?}", wide.pixels[1]);
    assert!(wide.pixels[0][1] > 1.0 && wide.pixels[0][0] < 0.5);
    assert!(wide.warnings[0].contains("converted"));
    let broken = set([0.0; 8]);
    assert_eq!(broken.pixels[0], [0.5, 1.0, 0.5]);
    assert!(broken.warnings[0].contains("taken as Rec. 709"), "{:?}", broken.warnings);
}

#[test]
fn huge_and_cropped_windows_are_refused_before_decoding() {
    let bytes = only(4, 2, &["R", "G", "B"]).encode().unwrap();
    let window = |w: i32, h: i32| [0, 0, w - 1, h - 1].map(i32::to_le_bytes).concat();
    let huge = with_attribute(bytes.clone(), "dataWindow\0box2i\0", &window(1_000_000_000, 1_000_000_000));
    let error = decode_planes(&huge).unwrap_err();
    assert!(error.message().contains("limit"), "{error}");
    let tall = with_attribute(bytes.clone(), "dataWindow\0box2i\0", &window(4, 1_000_000));
    let error = decode_planes(&tall).unwrap_err();
    assert!(error.message().contains("blocks"), "{error}");
    let cropped = with_attribute(bytes, "displayWindow\0box2i\0", &window(8, 4));
    assert_eq!(decode_planes(&cropped).unwrap().len(), 3);
    assert!(decode_rgb(&cropped).unwrap_err().message().contains("cropping"));
}

#[test]
fn several_parts_are_named_and_the_first_colour_one_is_read() {
    let part = |name: &str, channels: &[&str], value: f32| {
        let list: SmallVec<[_; 4]> =
            channels.iter().map(|c| AnyChannel::new(*c, FlatSamples::F32(vec![value; 8]))).collect();
        Layer::new((4, 2), LayerAttributes::named(name), Encoding::SMALL_LOSSLESS, AnyChannels::sort(list))
    };
    let layers: SmallVec<[_; 2]> =
        [part("depth", &["Y"], 3.0), part("sky", &["R", "G", "B"], 2.0)].into_iter().collect();
    let mut bytes = Cursor::new(Vec::new());
    let attributes = ImageAttributes::new(IntegerBounds::from_dimensions((4, 2)));
    Image { attributes, layer_data: layers }.write().to_buffered(&mut bytes).unwrap();
    let bytes = bytes.into_inner();
    assert_eq!(decode_rgb(&bytes).unwrap().pixels, [[2.0; 3]; 8]);
    let names: Vec<_> = decode_planes(&bytes).unwrap().into_iter().map(|p| p.name).collect();
    assert_eq!(names, ["depth.Y", "sky.B", "sky.G", "sky.R"]);
}

/// The same small picture in every compression, scan lines and tiles.
fn compressed() -> Vec<Vec<u8>> {
    let methods = [
        Compression::Uncompressed,
        Compression::RLE,
        Compression::ZIP1,
        Compression::ZIP16,
        Compression::PIZ,
        Compression::PXR24,
        Compression::B44,
        Compression::B44A,
        Compression::DWAA(None),
        Compression::DWAB(None),
    ];
    let (w, h) = (12, 20);
    let encodings = methods.into_iter().enumerate().map(|(i, compression)| Encoding {
        compression,
        blocks: if i % 2 == 0 { Blocks::ScanLines } else { Blocks::Tiles(Vec2(8, 8)) },
        line_order: LineOrder::Increasing,
    });
    let encode = |encoding| {
        let half = |n: u64| FlatSamples::F16(samples(w * h, n).into_iter().map(openexr::f16::from_f32).collect());
        let list: SmallVec<[_; 4]> =
            ["R", "G", "B"].into_iter().zip(0..).map(|(c, n)| AnyChannel::new(c, half(n))).collect();
        let layer = Layer::new((w, h), LayerAttributes::default(), encoding, AnyChannels::sort(list));
        let mut bytes = Cursor::new(Vec::new());
        Image::from_layer(layer).write().to_buffered(&mut bytes).unwrap();
        bytes.into_inner()
    };
    encodings.map(encode).collect()
}

#[test]
fn ten_thousand_damaged_files_do_no_harm() {
    let mut files = compressed();
    files.push(picture(6, 5).encode().unwrap());
    for (seed, bytes) in files.into_iter().enumerate() {
        decode_rgb(&bytes).unwrap();
        let header_end = bytes.len().min(420);
        let mut refused = 0;
        let mutants = 1000_u64;
        for i in 0..mutants {
            let random = |d: u64| random::bits(100 + seed as u64, i, d) as usize;
            let mut mutant = bytes.clone();
            match i % 4 {
                0 => mutant.truncate(random(0) % bytes.len()),
                // Half of the flips hit the header, where they do most.
                1 | 2 => (0..1 + random(0) as u64 % 3).for_each(|k| {
                    mutant[random(2 * k + 1) % header_end] ^= 1 << (random(2 * k + 2) % 8);
                }),
                _ => mutant[random(1) % bytes.len()] = random(2) as u8,
            }
            refused += usize::from(decode_rgb(&mutant).is_err());
        }
        assert!(refused > 300, "{refused}");
    }
}
