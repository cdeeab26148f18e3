//! The section of multilevel summation.
#![allow(clippy::unwrap_used, missing_docs)]

use translux_format::multilevel::{MultilevelSummation, tags};
use translux_format::{Codec, Kind, RawSection};

const GOOD: MultilevelSummation =
    MultilevelSummation { error: 0.005, spacing: 2.0, softening: 3.1, facets_below: 2.2, pieces_below: 5.0 };

#[test]
fn numbers_come_back() {
    let sections = GOOD.to_sections().unwrap();
    assert_eq!(MultilevelSummation::from_sections(&sections).unwrap(), Some(GOOD));
    assert_eq!(MultilevelSummation::from_sections(&[]).unwrap(), None);
}

#[test]
fn what_no_bake_writes_is_refused() {
    let bad = [
        MultilevelSummation { error: 0.0, ..GOOD },
        MultilevelSummation { error: 1.5, ..GOOD },
        MultilevelSummation { spacing: 0.0, ..GOOD },
        MultilevelSummation { softening: 0.5, ..GOOD },
        MultilevelSummation { softening: f64::INFINITY, ..GOOD },
        MultilevelSummation { facets_below: -1.0, ..GOOD },
        MultilevelSummation { pieces_below: f64::NAN, ..GOOD },
        MultilevelSummation { pieces_below: 1e9, ..GOOD },
    ];
    for numbers in bad {
        assert!(numbers.to_sections().is_err(), "{numbers:?}");
        let section = RawSection::from_record(tags::NUMBERS, Kind::Method, Codec::Raw, &numbers).unwrap();
        assert!(MultilevelSummation::from_sections(&[section]).is_err(), "{numbers:?}");
    }
    let section = GOOD.to_sections().unwrap().remove(0);
    for length in 0..section.bytes.len() {
        let cut = RawSection { bytes: section.bytes[..length].to_vec(), ..section.clone() };
        assert!(MultilevelSummation::from_sections(&[cut]).is_err(), "{length}");
    }
}
