//! Scattering neighbourhoods: what is written is read, and every rule is checked both ways.
#![allow(clippy::unwrap_used)]

use translux_format::scattering_lists::{ScatteringLists, tags};
use translux_format::{Codec, FormatError, Kind, RawSection};

#[test]
fn they_survive() {
    let lists = ScatteringLists { ranges_mm: vec![0.0, 2.5], samples: 100 };
    let sections = lists.to_sections().unwrap();
    assert_eq!(sections.len(), 1);
    assert_eq!(ScatteringLists::from_sections(&sections).unwrap(), Some(lists));
    assert_eq!(ScatteringLists::from_sections(&[]).unwrap(), None);
}

#[test]
fn what_breaks_a_rule_is_neither_written_nor_read() {
    let broken = [(vec![f64::NAN], 1), (vec![-1.0], 1), (vec![1.0, f64::INFINITY], 1), (vec![1.0], 0)];
    for (ranges_mm, samples) in broken {
        let lists = ScatteringLists { ranges_mm, samples };
        let refused = |error: FormatError| matches!(error, FormatError::Invalid { tag: tags::NUMBERS, .. });
        assert!(refused(lists.to_sections().unwrap_err()), "{lists:?}");
        let section = RawSection::from_record(tags::NUMBERS, Kind::Method, Codec::Raw, &lists).unwrap();
        assert!(ScatteringLists::from_sections(&[section]).is_err(), "{lists:?}");
    }
    let lists = ScatteringLists { ranges_mm: vec![1.0], samples: 1 };
    let mut section = lists.to_sections().unwrap().remove(0);
    section.kind = Kind::Mesh;
    assert!(ScatteringLists::from_sections(std::slice::from_ref(&section)).is_err());
    section.kind = Kind::Method;
    for length in 0..section.bytes.len() {
        let mut cut = section.clone();
        cut.bytes.truncate(length);
        assert!(ScatteringLists::from_sections(&[cut]).is_err(), "{length}");
    }
}
