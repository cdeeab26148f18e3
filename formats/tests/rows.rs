//! Irradiance rows survive a file, and damaged ones are refused.
#![allow(clippy::unwrap_used)]

mod common;

use common::full_asset;
use translux_format::rows::{IrradianceRows, tags};
use translux_format::{AssetFile, Budget, Codec, FormatError, Kind, RawSection};

/// Two patches with details, one with none.
fn rows() -> IrradianceRows {
    IrradianceRows {
        side: 32,
        terms: 2,
        offsets: vec![0, 3, 3, 5],
        indices: vec![1, 700, 6143, 2, 1025],
        values: vec![127, -5, 3, 0, 2, -127, 9, 1, -1, 0],
        steps: vec![0.5, 0.0, 1e-3],
        scaling: (0..36).map(|i| i * 1800 - 32_767).collect(),
        scaling_steps: vec![1e-4, 2e-4, 0.0],
    }
}

fn replaced(tag: translux_format::Tag, change: impl FnOnce(&mut RawSection)) -> Vec<RawSection> {
    let mut sections = rows().to_sections().unwrap();
    change(sections.iter_mut().find(|section| section.tag == tag).unwrap());
    sections
}

fn refused(sections: &[RawSection]) -> FormatError {
    IrradianceRows::from_sections(sections, 3).unwrap_err()
}

#[test]
fn rows_survive_sections_and_a_file() {
    let rows = rows();
    let sections = rows.to_sections().unwrap();
    assert!(sections.iter().all(|s| s.kind == Kind::Environment && s.codec == Codec::Zstd));
    assert_eq!(IrradianceRows::from_sections(&sections, 3).unwrap().unwrap(), rows);
    let mut asset = full_asset();
    asset.extra.extend(sections);
    let bytes = asset.to_bytes().unwrap();
    let back = AssetFile::from_bytes(&bytes, Budget::default()).unwrap();
    assert_eq!(IrradianceRows::from_sections(&back.extra, 3).unwrap().unwrap(), rows);
    assert_eq!(IrradianceRows::from_sections(&full_asset().extra, 3).unwrap(), None);
    let none = IrradianceRows { side: 64, terms: 1, offsets: vec![0], ..Default::default() };
    assert_eq!(IrradianceRows::from_sections(&none.to_sections().unwrap(), 0).unwrap().unwrap(), none);
}

#[test]
fn the_bytes_are_those_of_the_specification() {
    let sections = rows().to_sections().unwrap();
    let bytes = |tag| sections.iter().find(|s| s.tag == tag).unwrap().bytes.clone();
    assert_eq!(bytes(tags::DIMENSIONS), [32, 0, 0, 0, 2, 0, 0, 0]);
    assert_eq!(bytes(tags::COUNTS), [3, 0, 0, 0, 2, 0]);
    // Differences 1, 698, 5442, 2, 1022.
    assert_eq!(bytes(tags::INDICES), [1, 0xba, 0x42, 2, 0xfe, 0, 2, 0x15, 0, 3]);
    let values: [i8; 10] = [127, -5, 3, 9, 1, 0, 2, -127, -1, 0];
    assert_eq!(bytes(tags::VALUES), values.map(|v| v as u8));
    let scaling = bytes(tags::SCALING);
    // Term 0 of face 1: patches 0, 1, 2 hold numbers 1, 13 and 25.
    let third = |patch: usize| i16::from_le_bytes([scaling[3 + patch], scaling[36 + 3 + patch]]);
    assert_eq!([third(0), third(1), third(2)], [1, 13, 25].map(|i| i * 1800 - 32_767));
}

#[test]
fn every_missing_or_mistyped_section_is_refused() {
    let all = rows().to_sections().unwrap();
    for i in 0..all.len() {
        let mut sections = all.clone();
        let gone = sections.remove(i);
        let found = IrradianceRows::from_sections(&sections, 3);
        match gone.tag {
            tags::DIMENSIONS => assert_eq!(found, Ok(None)),
            tag => assert_eq!(found, Err(FormatError::MissingSection { tag })),
        }
        let mut sections = all.clone();
        sections[i].kind = Kind::Method;
        assert!(matches!(refused(&sections), FormatError::Invalid { tag, .. } if tag == gone.tag));
        let mut sections = all.clone();
        sections[i].components += 1;
        assert!(matches!(refused(&sections), FormatError::WrongType { tag, .. } if tag == gone.tag));
    }
    for patches in [0, 2, 4, usize::MAX] {
        assert!(IrradianceRows::from_sections(&all, patches).is_err());
    }
}

#[test]
fn any_bytes_give_rows_that_are_valid_or_an_error() {
    for section in rows().to_sections().unwrap() {
        let length = section.bytes.len();
        for at in 0..length {
            for byte in [0, 1, 0x7f, 0x80, 0xff] {
                let sections = replaced(section.tag, |s| s.bytes[at] = byte);
                if let Ok(Some(read)) = IrradianceRows::from_sections(&sections, 3) {
                    read.validate().unwrap();
                    let again = read.to_sections().unwrap();
                    assert_eq!(IrradianceRows::from_sections(&again, 3).unwrap().unwrap(), read);
                }
            }
            assert!(IrradianceRows::from_sections(&replaced(section.tag, |s| s.bytes.truncate(at)), 3).is_err());
        }
        assert!(IrradianceRows::from_sections(&replaced(section.tag, |s| s.bytes.push(0)), 3).is_err());
    }
}

#[test]
fn contents_out_of_range_are_refused() {
    let dimensions = |side: u32, terms: u32| {
        replaced(tags::DIMENSIONS, |s| s.bytes = [side, terms].iter().flat_map(|x| x.to_le_bytes()).collect())
    };
    for (side, terms) in [(0, 2), (1, 2), (33, 2), (128, 2), (u32::MAX, 2), (32, 0), (32, 5), (32, u32::MAX)] {
        assert!(matches!(refused(&dimensions(side, terms)), FormatError::Invalid { tag: tags::DIMENSIONS, .. }));
    }
    // An index of 6144, and one of 0.
    assert!(matches!(
        refused(&replaced(tags::INDICES, |s| s.bytes[2] += 1)),
        FormatError::Invalid { tag: tags::INDICES, .. }
    ));
    assert!(matches!(
        refused(&replaced(tags::INDICES, |s| s.bytes[0] = 0)),
        FormatError::Invalid { tag: tags::INDICES, .. }
    ));
    for step in [f32::NAN, f32::INFINITY, -1.0] {
        let sections = replaced(tags::STEPS, |s| s.bytes[4..8].copy_from_slice(&step.to_le_bytes()));
        assert!(matches!(refused(&sections), FormatError::Invalid { tag: tags::STEPS, .. }));
    }
    for broken in [
        IrradianceRows { offsets: vec![0, 3, 2, 5], ..rows() },
        IrradianceRows { offsets: vec![], ..rows() },
        IrradianceRows { indices: vec![1, 1, 6143, 2, 1025], ..rows() },
        IrradianceRows { indices: vec![1, 1024, 6143, 2, 1025], ..rows() },
        IrradianceRows { values: vec![0; 9], ..rows() },
        IrradianceRows { scaling: vec![0; 35], ..rows() },
        IrradianceRows { steps: vec![0.0; 2], ..rows() },
    ] {
        assert!(broken.to_sections().is_err());
    }
}
