//! What is written is what is read, in the same bytes every time.
#![allow(clippy::unwrap_used)]

mod common;

use std::borrow::Cow;
use std::path::Path;

use common::{build, full_asset, full_asset_0_0, full_asset_0_1, full_asset_0_2, seal, sections_of};
use translux_format::{
    AssetFile, Budget, Codec, ElementType, F16Bits, FormatError, Kind, RawSection, Reader, Tag, Writer,
};

const GOLDEN_0_0: &[u8] = include_bytes!("data/v0_0_full.tlux");
const GOLDEN_0_1: &[u8] = include_bytes!("data/v0_1_full.tlux");
const GOLDEN: &[u8] = include_bytes!("data/v0_2_full.tlux");

#[test]
fn every_feature_survives() {
    let asset = full_asset();
    let bytes = asset.to_bytes().unwrap();
    let back = AssetFile::from_bytes(&bytes, Budget::default()).unwrap();
    assert_eq!(back, asset);
    assert_eq!(back.to_bytes().unwrap(), bytes);
    assert_eq!(asset.to_bytes().unwrap(), bytes);
    let mut streamed = Vec::new();
    asset.write_to(&mut streamed).unwrap();
    assert_eq!(streamed, bytes);
}

/// Files of earlier versions read, and what they hold is written as it was but for the version.
#[test]
fn the_frozen_files_of_earlier_versions_still_read_and_only_the_version_is_written_differently() {
    for (golden, asset, minor) in [(GOLDEN_0_0, full_asset_0_0(), 0), (GOLDEN_0_1, full_asset_0_1(), 1)] {
        assert_eq!(AssetFile::from_bytes(golden, Budget::default()).unwrap(), asset);
        let mut bytes = asset.to_bytes().unwrap();
        assert_eq!(bytes[10..12], [2, 0]);
        bytes[10] = minor;
        seal(&mut bytes);
        assert_eq!(bytes, golden, "the writer's bytes changed");
    }
}

#[test]
fn the_frozen_file_of_version_0_2_still_reads_and_is_still_written() {
    assert_eq!(AssetFile::from_bytes(GOLDEN, Budget::default()).unwrap(), full_asset_0_2());
    assert_eq!(full_asset_0_2().to_bytes().unwrap(), GOLDEN, "the writer's bytes changed");
}

/// Run once for a new version of the format; it refuses to replace a frozen file.
#[test]
#[ignore = "writes the frozen file of a new version"]
fn freeze() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/v0_2_full.tlux");
    let frozen = std::fs::metadata(&path).is_ok_and(|file| file.len() > 0);
    assert!(!frozen, "{} is frozen", path.display());
    std::fs::write(path, full_asset_0_2().to_bytes().unwrap()).unwrap();
}

#[test]
fn a_second_writer_from_the_specification_makes_files_that_read_the_same() {
    let asset = full_asset();
    let mut sections = sections_of(&asset.to_bytes().unwrap());
    for section in &mut sections {
        section.codec = Codec::Raw;
    }
    let entries: Vec<_> = sections.iter().map(common::Entry::raw).collect();
    let mut expected = asset;
    for section in &mut expected.extra {
        section.codec = Codec::Raw;
    }
    assert_eq!(AssetFile::from_bytes(&build(&entries), Budget::default()).unwrap(), expected);
}

#[test]
fn an_empty_asset_and_an_empty_container() {
    let samples = translux_format::Samples::none(0);
    let empty = AssetFile { samples, samples_stored: true, ..Default::default() };
    let bytes = empty.to_bytes().unwrap();
    assert_eq!(AssetFile::from_bytes(&bytes, Budget::default()).unwrap(), empty);
    let nothing = Writer::new().finish();
    assert_eq!(nothing.len(), 32);
    assert!(Reader::parse(&nothing, Budget::bytes(0)).unwrap().sections().is_empty());
    let missing = AssetFile::from_bytes(&nothing, Budget::default()).unwrap_err();
    assert!(matches!(missing, FormatError::MissingSection { .. }), "{missing}");
}

#[test]
fn sections_are_typed() {
    let bytes = full_asset().to_bytes().unwrap();
    let reader = Reader::parse(&bytes, Budget::default()).unwrap();
    let tag = Tag::from_static("x.f16");
    assert_eq!(reader.array::<[F16Bits; 3]>(tag).unwrap(), [[F16Bits(0x3c00); 3]; 5]);
    assert_eq!(reader.scalars::<F16Bits>(tag).unwrap().len(), 15);
    let wrong = FormatError::WrongType {
        tag,
        expected: ElementType::U16,
        expected_components: 3,
        found: ElementType::F16,
        found_components: 3,
    };
    assert_eq!(reader.array::<[u16; 3]>(tag).unwrap_err(), wrong);
    assert_eq!(reader.array::<F16Bits>(tag).unwrap_err().code(), 19);
    assert_eq!(reader.record::<u32>(tag).unwrap_err().code(), 19);
    assert_eq!(reader.array::<u8>(Tag::from_static("none")).unwrap_err().code(), 18);
    let record: (String, Option<u8>, Vec<f32>) = reader.record(Tag::from_static("x.rec")).unwrap();
    assert_eq!(record, ("k".into(), Some(3), vec![1.5]));

    let asset = AssetFile::from_bytes(&bytes, Budget::default()).unwrap();
    let section = asset.extra.iter().find(|section| section.tag == tag).unwrap();
    assert_eq!(section.rows::<[F16Bits; 3]>().unwrap().len(), 5);
    assert_eq!(section.scalars::<F16Bits>().unwrap().len(), 15);
    assert_eq!(section.rows::<[u16; 3]>().unwrap_err(), wrong);
    assert_eq!(asset.extra.last().unwrap().record::<(String, Option<u8>, Vec<f32>)>().unwrap(), record);
    let ragged = RawSection { bytes: vec![0; 5], ..section.clone() };
    assert_eq!(ragged.rows::<[F16Bits; 3]>().unwrap_err().code(), 13);
}

#[test]
fn raw_sections_are_read_in_place_where_they_are_aligned() {
    let tag = Tag::from_static("rows");
    let rows: Vec<[f32; 4]> = (0..100).map(|i| [i as f32; 4]).collect();
    let mut writer = Writer::new();
    writer.add(tag, Kind::Method, Codec::Raw, &rows).unwrap();
    let file = writer.finish();
    // Eight-byte words give an aligned buffer; one byte further on gives one that is not.
    let mut words = vec![0u64; file.len() / 8 + 2];
    let buffer: &mut [u8] = bytemuck::cast_slice_mut(&mut words);
    for (shift, in_place) in [(0, true), (1, false)] {
        buffer[shift..shift + file.len()].copy_from_slice(&file);
        let reader = Reader::parse(&buffer[shift..shift + file.len()], Budget::default()).unwrap();
        let view = reader.view::<[f32; 4]>(tag).unwrap();
        assert_eq!(matches!(view, Cow::Borrowed(_)), in_place);
        assert_eq!(*view, *rows);
    }
}

#[test]
fn the_listing_tells_the_mesh_from_the_rest() {
    let bytes = full_asset().to_bytes().unwrap();
    let reader = Reader::parse(&bytes, Budget::default()).unwrap();
    reader.verify_checksums().unwrap();
    let of_kind =
        |kind| reader.sections().iter().filter(|s| s.kind == kind).map(|s| s.tag.to_string()).collect::<Vec<_>>();
    let mesh = ["mesh.org", "mesh.pos", "mesh.tri", "mesh.nrm", "mesh.nri", "mesh.uv", "mesh.uvi", "x.i64"];
    assert_eq!(of_kind(Kind::Mesh), mesh);
    assert_eq!(of_kind(Kind::Samples), ["samp.fac", "samp.off", "samp.prt", "x.i32"]);
    let positions = reader.section(translux_format::mesh::tags::POSITIONS).unwrap();
    assert_eq!((positions.rows(), positions.decoded_bytes, positions.components), (6, 72, 3));
    assert_eq!(reader.version(), (0, 2));
    let total: u64 = reader.sections().iter().map(|section| section.stored_bytes).sum();
    assert!(total < bytes.len() as u64);
}

#[test]
fn a_later_minor_version_with_unknown_sections_reads() {
    let mut bytes = full_asset().to_bytes().unwrap();
    bytes[10..12].copy_from_slice(&9u16.to_le_bytes());
    seal(&mut bytes);
    assert_eq!(Reader::parse(&bytes, Budget::default()).unwrap().version(), (0, 9));
    assert_eq!(AssetFile::from_bytes(&bytes, Budget::default()).unwrap(), full_asset());
}

#[test]
fn tags() {
    for text in ["", "123456789", "a b", "é", "a\0b"] {
        assert_eq!(Tag::new(text), None, "{text:?}");
    }
    assert_eq!(Tag::from_bytes(*b"a\0\0b\0\0\0\0"), None);
    assert_eq!(Tag::from_bytes([0; 8]), None);
    let tag = Tag::new("aZ09_.-x").unwrap();
    assert_eq!((tag.as_str(), tag.to_bytes()), ("aZ09_.-x", *b"aZ09_.-x"));
    assert_eq!(format!("[{:4}]", Tag::from_static("ab")), "[ab  ]");
}

#[test]
fn the_writer_refuses_what_the_reader_would() {
    let tag = Tag::from_static("t");
    let mut writer = Writer::new();
    writer.add(tag, Kind::Method, Codec::Raw, &[1u8]).unwrap();
    assert_eq!(writer.add(tag, Kind::Method, Codec::Raw, &[1u8]).err().unwrap().code(), 9);
    let mut asset = full_asset();
    asset.extra.push(RawSection::from_rows(translux_format::mesh::tags::UVS, Kind::Mesh, Codec::Raw, &[1u8]));
    assert_eq!(asset.to_bytes().unwrap_err().code(), 9);
    asset.extra.pop();
    asset.extra[0].components = 2;
    assert_eq!(asset.to_bytes().unwrap_err().code(), 13);
    asset.extra[0].components = 0;
    assert_eq!(asset.to_bytes().unwrap_err().code(), 10);
    let mut writer = Writer::new();
    for i in 0..translux_format::MAX_SECTIONS {
        writer.add(Tag::new(&format!("s{i}")).unwrap(), Kind::Method, Codec::Raw, &[0u8; 0]).unwrap();
    }
    assert_eq!(writer.add(tag, Kind::Method, Codec::Raw, &[1u8]).err().unwrap().code(), 7);
    let file = writer.finish();
    assert_eq!(Reader::parse(&file, Budget::default()).unwrap().sections().len(), translux_format::MAX_SECTIONS);
}
