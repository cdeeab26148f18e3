//! Quantised lights: what is written is read, and every rule about their content is checked both ways.
#![allow(clippy::unwrap_used)]

use translux_format::coefficients::encode;
use translux_format::quantised_lights::{QuantisedLights, Set, tags};
use translux_format::{Codec, FormatError, Kind, RawSection, Tag};

/// Something that breaks a rule.
type Change = fn(&mut QuantisedLights);

fn small() -> QuantisedLights {
    let coded = |tag: Tag, rows: usize, columns: usize| {
        let values: Vec<i16> = (0..rows * columns).map(|i| (i * 7 % 11) as i16 - 5).collect();
        encode(tag, rows, columns, &values, None).unwrap()
    };
    let set = |index: usize, shells: usize| Set {
        channels: (0..9 * shells * shells).map(|i| i as f64).collect(),
        step: 0.01,
        units: vec![1.5; 5],
        basis_steps: vec![0.1, 0.2, 0.3],
        basis: coded(tags::SETS[index].basis, 5, 3),
        columns: vec![0, 4, 8, 3],
        coefficients: coded(tags::SETS[index].coefficients, 6, 4),
    };
    QuantisedLights {
        directions: 5,
        shells: vec![0.0, 0.25, 0.5],
        spacing_mm: 0.5,
        direction_spacing: 0.1,
        samples: 100,
        sets: vec![set(0, 1), set(1, 2)],
    }
}

fn all_tags() -> Vec<Tag> {
    let sets = tags::SETS.iter().flat_map(|set| set.all());
    std::iter::once(tags::NUMBERS).chain(sets).collect()
}

#[test]
fn they_survive() {
    let sections = small().to_sections().unwrap();
    assert_eq!(sections.iter().map(|s| s.tag).collect::<Vec<_>>(), all_tags());
    assert_eq!(QuantisedLights::from_sections(&sections).unwrap().unwrap(), small());
    assert_eq!(QuantisedLights::from_sections(&[]).unwrap(), None);
    for tag in all_tags() {
        let some: Vec<RawSection> = sections.iter().filter(|s| s.tag != tag).cloned().collect();
        assert_eq!(QuantisedLights::from_sections(&some).unwrap_err(), FormatError::MissingSection { tag });
    }
    let mut parallel = small();
    parallel.shells.truncate(1);
    parallel.sets.truncate(1);
    let sections = parallel.to_sections().unwrap();
    assert_eq!(sections.len(), 6);
    assert_eq!(QuantisedLights::from_sections(&sections).unwrap().unwrap(), parallel);
}

#[test]
fn what_breaks_a_rule_is_not_written() {
    let [parallel, near] = tags::SETS;
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
        (tags::NUMBERS, |q| q.sets.truncate(1)),
        (tags::NUMBERS, |q| q.sets[1].channels[3] = f64::NAN),
        (tags::NUMBERS, |q| q.sets[1].channels.truncate(9)),
        (tags::NUMBERS, |q| q.sets[0].step = 0.0),
        (parallel.units, |q| q.sets[0].units[2] = 0.0),
        (near.units, |q| q.sets[1].units[2] = f32::INFINITY),
        (near.units, |q| q.sets[1].units.push(1.0)),
        (near.basis_steps, |q| q.sets[1].basis_steps[0] = f32::NAN),
        (parallel.basis, |q| q.sets[0].basis_steps.push(1.0)),
        (near.basis, |q| q.sets[1].basis.clear()),
        (parallel.columns, |q| q.sets[0].columns[1] = 0),
        (parallel.columns, |q| q.sets[0].columns[1] = 9),
        (near.columns, |q| q.sets[1].columns[1] = 18),
        (near.columns, |q| q.sets[1].columns.push(1)),
        (near.coefficients, |q| q.sets[1].coefficients.clear()),
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
    let units = tags::SETS[0].units;
    let mut sections = small().to_sections().unwrap();
    sections[1] = RawSection::from_rows(units, Kind::Method, Codec::Zstd, &[1.0f32; 4]);
    assert!(matches!(QuantisedLights::from_sections(&sections), Err(FormatError::Invalid { tag, .. }) if tag == units));
    let mut sections = small().to_sections().unwrap();
    sections[5] = RawSection::from_rows(tags::SETS[0].coefficients, Kind::Method, Codec::Raw, &[1.0f32; 4]);
    assert!(QuantisedLights::from_sections(&sections).is_err());
}
