//! Transport of distant light: what is written is read, and every rule about its content is checked both ways.
#![allow(clippy::unwrap_used)]

use translux_format::coefficients::encode;
use translux_format::distant_transport::{DistantTransport, Harmonics, Single, tags};
use translux_format::quantised_lights::Set;
use translux_format::rows::{self, IrradianceRows};
use translux_format::{FormatError, RawSection, Tag};

const VERTICES: usize = 2;

fn harmonics() -> Harmonics {
    let coded = |tag: Tag, rows: usize, columns: usize| {
        let values: Vec<i16> = (0..rows * columns).map(|i| (i * 7 % 11) as i16 - 5).collect();
        encode(tag, rows, columns, &values, None).unwrap()
    };
    let set = Set {
        channels: (0..9).map(f64::from).collect(),
        step: 0.01,
        units: vec![1.5; 4],
        basis_steps: vec![0.1, 0.2, 0.3],
        basis: coded(tags::SET.basis, 4, 3),
        columns: vec![0, 4, 8, 3],
        coefficients: coded(tags::SET.coefficients, 6, 4),
    };
    Harmonics { order: 2, spacing_mm: 0.5, set }
}

fn haar() -> IrradianceRows {
    IrradianceRows {
        side: 2,
        terms: 3,
        block: 0,
        offsets: vec![0, 2, 3],
        indices: vec![1, 6, 23],
        values: vec![1, 2, 3, 4, 5, 6, -7, -8, -9],
        steps: vec![0.5, 0.25],
        scaling: (0..2 * 18).collect(),
        scaling_steps: vec![0.125, 1.0],
        functions: vec![[0.0; 9]; 3],
    }
}

/// Light scattered once by a phase function of two terms, and by an isotropic one.
fn single() -> [Single; 2] {
    let mut harmonics = harmonics();
    harmonics.set.channels = (0..36).map(f64::from).collect();
    harmonics.set.columns = vec![0, 4, 17, 11];
    [
        Single { terms: 2, harmonics: Some(harmonics), rows: None },
        Single { terms: 1, harmonics: None, rows: Some(haar()) },
    ]
}

fn all() -> [DistantTransport; 5] {
    let of = |harmonics, rows, single| DistantTransport { samples: 100, harmonics, rows, single };
    let [terms, isotropic] = single().map(Some);
    [
        of(Some(harmonics()), None, None),
        of(None, Some(haar()), None),
        of(Some(harmonics()), Some(haar()), None),
        of(Some(harmonics()), None, terms),
        of(None, Some(haar()), isotropic),
    ]
}

#[test]
fn it_survives() {
    for (transport, count) in all().into_iter().zip([6, 9, 14, 12, 18]) {
        let sections = transport.to_sections().unwrap();
        assert_eq!(sections.len(), count);
        assert_eq!(DistantTransport::from_sections(&sections, VERTICES).unwrap().unwrap(), transport);
    }
    assert_eq!(DistantTransport::from_sections(&[], VERTICES).unwrap(), None);
    let irradiance = haar().to_sections().unwrap();
    assert_eq!(DistantTransport::from_sections(&irradiance, VERTICES).unwrap(), None, "rows of irradiance are others");
}

#[test]
fn a_section_alone_is_missing_the_others() {
    for transport in all() {
        let sections = transport.to_sections().unwrap();
        let tags: Vec<Tag> = sections.iter().map(|s| s.tag).collect();
        for tag in tags {
            let some: Vec<RawSection> = sections.iter().filter(|s| s.tag != tag).cloned().collect();
            assert_eq!(
                DistantTransport::from_sections(&some, VERTICES).unwrap_err(),
                FormatError::MissingSection { tag }
            );
        }
    }
    // The record tells whether there are harmonics.
    let mut mixed = all()[0].to_sections().unwrap();
    mixed[0] = all()[1].to_sections().unwrap()[0].clone();
    assert!(
        matches!(DistantTransport::from_sections(&mixed, 2), Err(FormatError::Invalid { tag, .. }) if tag == tags::NUMBERS)
    );
}

#[test]
fn what_breaks_a_rule_is_neither_written_nor_read() {
    type Change = fn(&mut DistantTransport);
    let changes: [(Change, Tag); 8] = [
        (|t| (t.harmonics, t.rows) = (None, None), tags::NUMBERS),
        (|t| t.harmonics.as_mut().unwrap().order = 0, tags::NUMBERS),
        (|t| t.harmonics.as_mut().unwrap().order = 33, tags::NUMBERS),
        (|t| t.harmonics.as_mut().unwrap().spacing_mm = f64::NAN, tags::NUMBERS),
        (|t| t.harmonics.as_mut().unwrap().order = 3, tags::SET.units),
        (|t| t.harmonics.as_mut().unwrap().set.step = 0.0, tags::NUMBERS),
        (|t| t.rows.as_mut().unwrap().terms = 2, rows::tags::TRANSPORT.dimensions),
        (|t| t.rows.as_mut().unwrap().indices[0] = 0, rows::tags::TRANSPORT.indices),
    ];
    for (change, expected) in changes {
        let mut transport = all()[2].clone();
        change(&mut transport);
        let error = transport.to_sections().unwrap_err();
        assert!(matches!(&error, FormatError::Invalid { tag, .. } if *tag == expected), "{error}");
    }
    let changes: [(Change, usize, Tag); 7] = [
        (|t| t.single.as_mut().unwrap().terms = 0, 3, tags::SINGLE_NUMBERS),
        (|t| t.single.as_mut().unwrap().terms = 17, 3, tags::SINGLE_NUMBERS),
        (|t| t.single.as_mut().unwrap().terms = 3, 3, tags::SINGLE_NUMBERS),
        (|t| t.single.as_mut().unwrap().harmonics = None, 3, tags::SINGLE_NUMBERS),
        (|t| t.single.as_mut().unwrap().harmonics.as_mut().unwrap().order = 33, 3, tags::SINGLE_NUMBERS),
        (|t| t.single.as_mut().unwrap().terms = 2, 4, tags::SINGLE_NUMBERS),
        (|t| t.single.as_mut().unwrap().rows.as_mut().unwrap().terms = 2, 4, rows::tags::SINGLE.dimensions),
    ];
    for (change, which, expected) in changes {
        let mut transport = all()[which].clone();
        change(&mut transport);
        let error = transport.to_sections().unwrap_err();
        assert!(matches!(&error, FormatError::Invalid { tag, .. } if *tag == expected), "{error}");
    }
    let sections = all()[1].to_sections().unwrap();
    assert!(DistantTransport::from_sections(&sections, VERTICES + 1).is_err(), "rows of other vertices");
}
