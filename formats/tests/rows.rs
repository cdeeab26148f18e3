//! Irradiance rows survive a file, and damaged ones are refused.
#![allow(clippy::unwrap_used)]

mod common;

use common::{Random, full_asset, small_rows};
use translux_format::rows::{DEGREE, IrradianceRows, tags};
use translux_format::{AssetFile, Budget, Codec, FormatError, Kind, RawSection};

fn replaced(tag: translux_format::Tag, change: impl FnOnce(&mut RawSection)) -> Vec<RawSection> {
    let mut sections = small_rows().to_sections().unwrap();
    change(sections.iter_mut().find(|section| section.tag == tag).unwrap());
    sections
}

fn refused(sections: &[RawSection]) -> FormatError {
    IrradianceRows::from_sections(sections, 3).unwrap_err()
}

#[test]
fn rows_survive_sections_and_a_file() {
    let rows = small_rows();
    let sections = rows.to_sections().unwrap();
    assert!(sections.iter().all(|s| s.kind == Kind::Environment && s.codec == Codec::Zstd));
    assert_eq!(IrradianceRows::from_sections(&sections, 3).unwrap().unwrap(), rows);
    let mut asset = full_asset();
    asset.extra.extend(sections);
    let bytes = asset.to_bytes().unwrap();
    let back = AssetFile::from_bytes(&bytes, Budget::default()).unwrap();
    assert_eq!(IrradianceRows::from_sections(&back.extra, 3).unwrap().unwrap(), rows);
    assert_eq!(IrradianceRows::from_sections(&full_asset().extra, 3).unwrap(), None);
    let none =
        IrradianceRows { side: 64, terms: 1, offsets: vec![0], functions: vec![[1.0; DEGREE]], ..Default::default() };
    assert_eq!(IrradianceRows::from_sections(&none.to_sections().unwrap(), 0).unwrap().unwrap(), none);
}

#[test]
fn the_bytes_are_those_of_the_specification() {
    let sections = small_rows().to_sections().unwrap();
    let bytes = |tag| sections.iter().find(|s| s.tag == tag).unwrap().bytes.clone();
    assert_eq!(bytes(tags::DIMENSIONS), [32, 0, 0, 0, 2, 0, 0, 0]);
    assert_eq!(bytes(tags::COUNTS), [3, 0, 0, 0, 2, 0]);
    // Differences 1, 698, 5442, 2, 1022.
    assert_eq!(bytes(tags::INDICES), [1, 0xba, 0x42, 2, 0xfe, 0, 2, 0x15, 0, 3]);
    let values: [i8; 10] = [127, -5, 3, 9, 1, 0, 2, -127, -1, 0];
    assert_eq!(bytes(tags::VALUES), values.map(|v| v as u8));
    let scaling = bytes(tags::SCALING);
    let functions: Vec<u8> = small_rows().functions.as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect();
    assert_eq!(bytes(tags::FUNCTIONS), functions);
    // Term 0 of face 1: patches 0, 1, 2 hold numbers 1, 13 and 25.
    let third = |patch: usize| i16::from_le_bytes([scaling[3 + patch], scaling[36 + 3 + patch]]);
    assert_eq!([third(0), third(1), third(2)], [1, 13, 25].map(|i| i * 1800 - 32_767));
}

#[test]
fn every_missing_or_mistyped_section_is_refused() {
    let all = small_rows().to_sections().unwrap();
    for i in 0..all.len() {
        let mut sections = all.clone();
        let gone = sections.remove(i);
        let found = IrradianceRows::from_sections(&sections, 3);
        assert_eq!(found, Err(FormatError::MissingSection { tag: gone.tag }));
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
    for section in small_rows().to_sections().unwrap() {
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
    for number in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let sections = replaced(tags::FUNCTIONS, |s| s.bytes[136..].copy_from_slice(&number.to_le_bytes()));
        assert!(matches!(refused(&sections), FormatError::Invalid { tag: tags::FUNCTIONS, .. }));
    }
    for broken in [
        IrradianceRows { offsets: vec![0, 3, 2, 5], ..small_rows() },
        IrradianceRows { offsets: vec![], ..small_rows() },
        IrradianceRows { indices: vec![1, 1, 6143, 2, 1025], ..small_rows() },
        IrradianceRows { indices: vec![1, 1024, 6143, 2, 1025], ..small_rows() },
        IrradianceRows { values: vec![0; 9], ..small_rows() },
        IrradianceRows { scaling: vec![0; 35], ..small_rows() },
        IrradianceRows { steps: vec![0.0; 2], ..small_rows() },
        IrradianceRows { functions: vec![[1.0; DEGREE]], ..small_rows() },
        IrradianceRows { functions: vec![[1.0; DEGREE], [f64::NAN; DEGREE]], ..small_rows() },
    ] {
        assert!(broken.to_sections().is_err());
    }
}

#[test]
fn rows_in_blocks_have_a_tag_of_their_own() {
    let rows = IrradianceRows { block: 2, ..small_rows() };
    let sections = rows.to_sections().unwrap();
    assert_eq!((sections[0].tag, sections.len()), (tags::BLOCKS, 8));
    assert_eq!(sections[0].bytes, [32, 0, 0, 0, 2, 0, 0, 0, 2, 0, 0, 0]);
    assert_eq!(IrradianceRows::from_sections(&sections, 3).unwrap().unwrap(), rows);
    for block in [0u32, 1, 1025, u32::MAX] {
        let mut sections = sections.clone();
        sections[0].bytes[8..].copy_from_slice(&block.to_le_bytes());
        assert!(matches!(refused(&sections), FormatError::Invalid { tag: tags::BLOCKS, .. }));
    }
    // A reader that takes one for the other would be wrong, and so are both.
    let mut both = sections.clone();
    both.extend(small_rows().to_sections().unwrap().into_iter().take(1));
    assert!(matches!(refused(&both), FormatError::Invalid { tag: tags::BLOCKS, .. }));
    let mut narrow = sections.clone();
    narrow[0].components = 2;
    assert!(matches!(refused(&narrow), FormatError::WrongType { tag: tags::BLOCKS, .. }));
    for (block, ok) in [(1, false), (2, true), (1024, true), (1025, false)] {
        assert_eq!(IrradianceRows { block, ..small_rows() }.validate().is_ok(), ok, "{block}");
    }
    // Rows of vertices are never in blocks.
    assert!(rows.to_sections_as(&tags::TRANSPORT, Kind::Method).is_err());
}

#[test]
fn blocks_are_halves_of_parts() {
    use translux_format::rows::blocks;
    assert_eq!(blocks(&[0, 5, 5, 6, 14], 4), [[0, 3], [3, 5], [5, 6], [6, 10], [10, 14]]);
    assert_eq!(blocks(&[0, 9], 2), [[0, 2], [2, 3], [3, 5], [5, 7], [7, 9]]);
    assert!(blocks(&[0, 9], 0).is_empty() && blocks(&[], 4).is_empty() && blocks(&[7], 4).is_empty());
    // Offsets that fall are nobody's part.
    assert!(blocks(&[9, 3], 4).is_empty());
    assert_eq!(blocks(&[0, 131_072], 64).len(), 2048);
}

/// Patches of about `details` details, two terms.
fn many(patches: usize, details: usize) -> IrradianceRows {
    let mut random = Random(3);
    let mut rows = IrradianceRows { offsets: vec![0], indices: vec![], ..small_rows() };
    for _ in 0..patches {
        let count = random.below(3).max(1) * details / 2;
        let mut places: Vec<u16> = (0..count).map(|_| random.below(6144) as u16).filter(|p| p % 1024 > 0).collect();
        places.sort_unstable();
        places.dedup();
        rows.indices.extend(places);
        rows.offsets.push(rows.indices.len() as u32);
    }
    rows.values = (0..2 * rows.indices.len()).map(|_| random.next() as i8).collect();
    rows.steps = (0..patches).map(|i| i as f32).collect();
    rows.scaling = (0..12 * patches).map(|_| random.next() as i16).collect();
    rows.scaling_steps = (0..patches).map(|i| 0.5 * i as f32).collect();
    rows
}

/// Places as the specification has them, one after the other; `None` where they are wrong.
fn places_one_by_one(offsets: &[u32], bytes: &[u8], texels: u64) -> Option<Vec<u16>> {
    let (low, high) = bytes.split_at(bytes.len() / 2);
    let mut places = Vec::new();
    for pair in offsets.windows(2) {
        let mut next = 0;
        for i in pair[0] as usize..pair[1] as usize {
            let place = next + u64::from(low[i]) + 256 * u64::from(high[i]);
            if place >= 6 * texels || place.is_multiple_of(texels) {
                return None;
            }
            places.push(place as u16);
            next = place + 1;
        }
    }
    Some(places)
}

#[test]
fn many_rows_of_every_length_survive() {
    for details in [1, 2, 5, 33, 128, 700] {
        let rows = many(600, details);
        let sections = rows.to_sections().unwrap();
        let back = IrradianceRows::from_sections(&sections, 600).unwrap().unwrap();
        assert!(back == rows, "{details} details");
    }
}

/// Damaged differences are refused exactly where adding up one by one finds a wrong place.
#[test]
fn places_are_those_that_adding_up_gives() {
    let mut random = Random(4);
    let (mut accepted, mut refused) = (0, 0);
    for round in 0..3000 {
        let rows = many(1 + round % 7, 1 + round % 40);
        let mut sections = rows.to_sections().unwrap();
        let section = sections.iter_mut().find(|s| s.tag == tags::INDICES).unwrap();
        let length = section.bytes.len();
        for _ in 0..random.below(4).min(length) {
            let bytes = [0, 1, 2, 0x0f, 0x17, 0x18, 0x40, 0x80, 0xff];
            section.bytes[random.below(length)] = bytes[random.below(bytes.len())];
        }
        let expected = places_one_by_one(&rows.offsets, &section.bytes, 1024);
        let found = IrradianceRows::from_sections(&sections, rows.patches());
        match &expected {
            Some(_) => accepted += 1,
            None => refused += 1,
        }
        assert!(found.ok().flatten().map(|rows| rows.indices) == expected, "round {round}");
    }
    assert!(accepted > 500 && refused > 500, "{accepted} accepted, {refused} refused");
}

/// Speed of decoding, for whoever changes it:
/// `cargo test --release -p translux-format --test rows speed -- --ignored --nocapture`.
#[test]
#[ignore = "prints times"]
fn speed() {
    let rows = many(131_072, 186);
    let sections = rows.to_sections().unwrap();
    for _ in 0..7 {
        let start = std::time::Instant::now();
        let back = IrradianceRows::from_sections(&sections, 131_072).unwrap().unwrap();
        println!("{} details in {:.1} ms", back.indices.len(), 1e3 * start.elapsed().as_secs_f64());
        assert!(back == rows);
    }
}
