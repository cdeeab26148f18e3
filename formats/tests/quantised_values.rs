//! Quantised values: what is written is read, and every rule about their content is checked both ways.
#![allow(clippy::unwrap_used)]

use translux_format::coefficients::encode;
use translux_format::quantised_values::{Encoding, LEVELS, QuantisedValues, tags};
use translux_format::{Codec, FormatError, Kind, RawSection, Tag};

/// Something that breaks a rule.
type Change = fn(&mut QuantisedValues);

const ALL: [Encoding; 4] = [Encoding::Raw, Encoding::Codes, Encoding::Harmonics, Encoding::References];

fn coded(tag: Tag, rows: usize, columns: usize) -> Vec<u8> {
    let values: Vec<i16> = (0..rows * columns).map(|i| (i * 7 % 11) as i16 - 5).collect();
    encode(tag, rows, columns, &values, None).unwrap()
}

/// Seven vertices, of which three are reference points, under ten lights.
fn small(encoding: Encoding) -> QuantisedValues {
    let empty = QuantisedValues {
        encoding,
        directions: 5,
        shells: vec![0.0, 0.25],
        samples: 100,
        planes: 3,
        ..QuantisedValues::default()
    };
    let tables: Vec<f32> = (0..3).flat_map(|_| (0..LEVELS).map(|i| i as f32)).collect();
    match encoding {
        Encoding::Raw => QuantisedValues { raw: vec![0.5; 7 * 3 * 10], ..empty },
        Encoding::Codes => QuantisedValues { tables, codes: coded(tags::CODES, 21, 10), ..empty },
        Encoding::Harmonics => {
            QuantisedValues { order: 2, scales: vec![0.5; 24], harmonics: coded(tags::HARMONICS, 7, 24), ..empty }
        }
        Encoding::References => QuantisedValues {
            order: 2,
            tables,
            codes: coded(tags::CODES, 9, 10),
            scales: vec![0.5; 24],
            harmonics: coded(tags::HARMONICS, 4, 24),
            members: coded(tags::MEMBERS, 7, 1),
            places: coded(tags::PLACES, 4, 3),
            ..empty
        },
    }
}

#[test]
fn they_survive() {
    assert_eq!(QuantisedValues::from_sections(&[]).unwrap(), None);
    for encoding in ALL {
        let values = small(encoding);
        let sections = values.to_sections().unwrap();
        assert_eq!(sections.iter().map(|s| s.tag).collect::<Vec<_>>(), encoding.tags());
        assert_eq!(QuantisedValues::from_sections(&sections).unwrap().unwrap(), values);
        for &tag in encoding.tags() {
            let some: Vec<RawSection> = sections.iter().filter(|s| s.tag != tag).cloned().collect();
            assert_eq!(QuantisedValues::from_sections(&some).unwrap_err(), FormatError::MissingSection { tag });
        }
    }
    let vectors = QuantisedValues { shells: vec![0.0], planes: 9, raw: vec![0.5; 90], ..small(Encoding::Raw) };
    assert!(vectors.to_sections().is_ok());
    assert_eq!(small(Encoding::Harmonics).columns(), 24);
}

#[test]
fn what_breaks_a_rule_is_not_written() {
    let all: Vec<(Tag, Change)> = vec![
        (tags::NUMBERS, |q| q.directions = 0),
        (tags::NUMBERS, |q| q.directions = u32::MAX),
        (tags::NUMBERS, |q| q.shells = vec![]),
        (tags::NUMBERS, |q| q.shells[0] = 0.1),
        (tags::NUMBERS, |q| q.shells[1] = 0.0),
        (tags::NUMBERS, |q| q.shells[1] = f64::NAN),
        (tags::NUMBERS, |q| q.planes = 0),
        (tags::NUMBERS, |q| q.planes = 9),
        (tags::NUMBERS, |q| q.order = 33),
        (tags::NUMBERS, |q| q.order = 2 - q.order),
    ];
    let own: Vec<(Encoding, Tag, Change)> = vec![
        (Encoding::Raw, tags::RAW, |q| q.raw.truncate(100)),
        (Encoding::Raw, tags::RAW, |q| q.raw[8] = f32::NAN),
        (Encoding::Raw, tags::TABLES, |q| q.tables = vec![0.0; 3 * LEVELS]),
        (Encoding::Codes, tags::TABLES, |q| q.tables.truncate(LEVELS)),
        (Encoding::Codes, tags::TABLES, |q| q.tables[300] = 1e9),
        (Encoding::Codes, tags::TABLES, |q| q.tables[767] = f32::INFINITY),
        (Encoding::Codes, tags::CODES, |q| q.codes.clear()),
        (Encoding::Codes, tags::CODES, |q| q.codes = coded(tags::CODES, 20, 10)),
        (Encoding::Codes, tags::CODES, |q| q.codes = coded(tags::CODES, 21, 9)),
        (Encoding::Codes, tags::MEMBERS, |q| q.members = coded(tags::MEMBERS, 7, 1)),
        (Encoding::Harmonics, tags::SCALES, |q| q.scales[3] = 0.0),
        (Encoding::Harmonics, tags::SCALES, |q| q.scales[3] = f32::NAN),
        (Encoding::Harmonics, tags::SCALES, |q| q.scales.push(1.0)),
        (Encoding::Harmonics, tags::HARMONICS, |q| q.harmonics = coded(tags::HARMONICS, 7, 23)),
        (Encoding::References, tags::HARMONICS, |q| q.harmonics = coded(tags::HARMONICS, 3, 24)),
        (Encoding::References, tags::MEMBERS, |q| q.members = coded(tags::MEMBERS, 7, 2)),
        (Encoding::References, tags::PLACES, |q| q.places = coded(tags::PLACES, 4, 2)),
        (Encoding::References, tags::PLACES, |q| q.members = coded(tags::MEMBERS, 8, 1)),
        (Encoding::References, tags::PLACES, |q| q.places.clear()),
    ];
    let for_all = ALL.into_iter().flat_map(|encoding| all.iter().map(move |(tag, change)| (encoding, *tag, *change)));
    for (index, (encoding, tag, change)) in for_all.chain(own).enumerate() {
        let mut values = small(encoding);
        change(&mut values);
        match values.to_sections() {
            Err(FormatError::Invalid { tag: found, .. }) => assert_eq!(found, tag, "{index}"),
            other => panic!("{index}: {other:?}"),
        }
    }
}

#[test]
fn reading_checks_the_same() {
    let with = |encoding: Encoding, tag: Tag, section: RawSection| {
        let mut sections = small(encoding).to_sections().unwrap();
        sections.retain(|s| s.tag != tag);
        sections.push(section);
        QuantisedValues::from_sections(&sections).unwrap_err()
    };
    let floats = |tag: Tag, count: usize| RawSection::from_rows(tag, Kind::Method, Codec::Zstd, &vec![1.0f32; count]);
    let error = with(Encoding::Raw, tags::RAW, floats(tags::RAW, 31));
    assert!(matches!(error, FormatError::Invalid { tag: tags::RAW, .. }), "{error}");
    let error = with(Encoding::Codes, tags::CODES, floats(tags::CODES, 31));
    assert!(matches!(error, FormatError::WrongType { tag: tags::CODES, .. }), "{error}");
    // A section of another encoding beside those that are needed.
    let error = with(Encoding::Raw, tags::SCALES, floats(tags::SCALES, 24));
    assert!(matches!(error, FormatError::Invalid { tag: tags::SCALES, .. }), "{error}");
    let records = small(Encoding::Harmonics).to_sections().unwrap();
    let error = with(Encoding::Codes, tags::NUMBERS, records[0].clone());
    assert!(matches!(error, FormatError::Invalid { .. } | FormatError::MissingSection { .. }), "{error}");
    // Any record.
    for length in 0..records[0].bytes.len() + 2 {
        let mut record = records[0].clone();
        record.bytes.resize(length, 0x7f);
        if length != records[0].bytes.len() {
            with(Encoding::Harmonics, tags::NUMBERS, record);
        }
    }
    for at in 0..records[0].bytes.len() {
        let mut changed = records.clone();
        changed[0].bytes[at] ^= 0xff;
        // Only the number of samples and a shell's distance may be anything.
        let _ = QuantisedValues::from_sections(&changed);
    }
}
