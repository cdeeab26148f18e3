//! Quantised lights: what is written is read, and every rule about their content is checked both ways.
#![allow(clippy::unwrap_used)]

use translux_format::coefficients::encode;
use translux_format::quantised_lights::{QuantisedLights, tags};
use translux_format::{Codec, FormatError, Kind, RawSection, Tag};

/// Something that breaks a rule.
type Change = fn(&mut QuantisedLights);

fn small() -> QuantisedLights {
    let coded = |tag: Tag, rows: usize, columns: usize| {
        let values: Vec<i16> = (0..rows * columns).map(|i| (i * 7 % 11) as i16 - 5).collect();
        encode(tag, rows, columns, &values, None).unwrap()
    };
    QuantisedLights {
        directions: 5,
        shells: vec![0.0, 0.25],
        spacing_mm: 0.5,
        direction_spacing: 0.1,
        samples: 100,
        channels: (0..36).map(f64::from).collect(),
        step: 0.01,
        units: vec![1.5; 5],
        basis_steps: vec![0.1, 0.2, 0.3],
        basis: coded(tags::BASIS, 5, 3),
        columns: vec![0, 4, 8, 3],
        coefficients: coded(tags::COEFFICIENTS, 6, 4),
    }
}

#[test]
fn they_survive() {
    let sections = small().to_sections().unwrap();
    assert_eq!(sections.iter().map(|s| s.tag).collect::<Vec<_>>(), tags::ALL);
    assert_eq!(QuantisedLights::from_sections(&sections).unwrap().unwrap(), small());
    assert_eq!(QuantisedLights::from_sections(&[]).unwrap(), None);
    for tag in tags::ALL {
        let some: Vec<RawSection> = sections.iter().filter(|s| s.tag != tag).cloned().collect();
        assert_eq!(QuantisedLights::from_sections(&some).unwrap_err(), FormatError::MissingSection { tag });
    }
}

#[test]
fn what_breaks_a_rule_is_not_written() {
    let broken: Vec<(Tag, Change)> = vec![
        (tags::NUMBERS, |q| q.directions = 0),
        (tags::NUMBERS, |q| q.directions = u32::MAX),
        (tags::NUMBERS, |q| q.shells = vec![]),
        (tags::NUMBERS, |q| q.shells[0] = 0.1),
        (tags::NUMBERS, |q| q.shells[1] = 0.0),
        (tags::NUMBERS, |q| q.shells[1] = f64::NAN),
        (tags::NUMBERS, |q| q.spacing_mm = -1.0),
        (tags::NUMBERS, |q| q.spacing_mm = f64::INFINITY),
        (tags::NUMBERS, |q| q.direction_spacing = f64::NAN),
        (tags::NUMBERS, |q| q.channels[3] = f64::NAN),
        (tags::NUMBERS, |q| q.channels.truncate(9)),
        (tags::NUMBERS, |q| q.step = 0.0),
        (tags::UNITS, |q| q.units[2] = 0.0),
        (tags::UNITS, |q| q.units[2] = f32::INFINITY),
        (tags::UNITS, |q| q.units.push(1.0)),
        (tags::BASIS_STEPS, |q| q.basis_steps[0] = f32::NAN),
        (tags::BASIS, |q| q.basis_steps.push(1.0)),
        (tags::BASIS, |q| q.basis.clear()),
        (tags::COLUMNS, |q| q.columns[1] = 0),
        (tags::COLUMNS, |q| q.columns[1] = 18),
        (tags::COLUMNS, |q| q.columns.push(1)),
        (tags::COEFFICIENTS, |q| q.coefficients.clear()),
    ];
    for (index, (tag, change)) in broken.into_iter().enumerate() {
        let mut lights = small();
        change(&mut lights);
        match lights.to_sections() {
            Err(FormatError::Invalid { tag: found, .. }) => assert_eq!(found, tag, "{index}"),
            other => panic!("{index}: {other:?}"),
        }
    }
}

#[test]
fn reading_checks_the_same() {
    let mut sections = small().to_sections().unwrap();
    sections[1] = RawSection::from_rows(tags::UNITS, Kind::Method, Codec::Zstd, &[1.0f32; 4]);
    assert!(matches!(QuantisedLights::from_sections(&sections), Err(FormatError::Invalid { tag: tags::UNITS, .. })));
    let mut sections = small().to_sections().unwrap();
    sections[5] = RawSection::from_rows(tags::COEFFICIENTS, Kind::Method, Codec::Raw, &[1.0f32; 4]);
    assert!(QuantisedLights::from_sections(&sections).is_err());
}
