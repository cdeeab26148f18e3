//! Filtered normals go through their sections, and nothing else is accepted.
#![allow(clippy::unwrap_used)]

use translux_format::Budget;
use translux_format::filtered_normals::{Earlier, FilteredNormals, Numbers, tags};

fn strip(rows: u32) -> Earlier {
    Earlier::new(rows as usize, (2..rows).map(|i| [i, i - 2, i - 1]).chain([[0, 1, 99]]))
}

fn fields(rows: usize) -> FilteredNormals {
    let numbers = Numbers { rungs: vec![4.0, 1.0], columns: 3, step: 1.0 / 256.0, alpha: 0.3, width: 1.5, samples: 9 };
    let codes = (0..rows * 6).map(|i| ((i * 37) % 401) as i16 - 200).collect();
    FilteredNormals { numbers, codes, openness: (0..rows).map(|i| i as u8).collect() }
}

#[test]
fn fields_survive() {
    for rows in [0, 1, 2, 50] {
        let sections = fields(rows).to_sections(&strip(rows as u32)).unwrap();
        let read = FilteredNormals::from_sections(&sections, &strip(rows as u32), Budget::default()).unwrap();
        assert_eq!(read, Some(fields(rows)));
        assert!(FilteredNormals::from_sections(&sections, &strip(rows as u32 + 1), Budget::default()).is_err());
    }
    assert_eq!(FilteredNormals::from_sections(&[], &strip(1), Budget::default()).unwrap(), None);
}

#[test]
fn nonsense_is_refused() {
    let earlier = strip(20);
    let refused = |change: &dyn Fn(&mut FilteredNormals)| {
        let mut changed = fields(20);
        change(&mut changed);
        assert!(changed.to_sections(&earlier).is_err(), "{:?}", changed.numbers);
    };
    refused(&|f| f.numbers.rungs[0] = f64::NAN);
    refused(&|f| f.numbers.rungs.clear());
    refused(&|f| f.numbers.step = 0.0);
    refused(&|f| f.numbers.width = 0.0);
    refused(&|f| f.numbers.alpha = -1.0);
    refused(&|f| f.numbers.samples = 0);
    refused(&|f| f.numbers.columns = 5);
    refused(&|f| f.codes[3] = i16::MAX);
    refused(&|f| f.openness.push(1));
    let sections = fields(20).to_sections(&earlier).unwrap();
    for section in 0..sections.len() {
        for length in 0..sections[section].bytes.len() {
            let mut cut = sections.clone();
            cut[section].bytes.truncate(length);
            assert!(FilteredNormals::from_sections(&cut, &earlier, Budget::default()).is_err(), "{section} {length}");
        }
        let mut missing = sections.clone();
        missing.remove(section);
        assert!(FilteredNormals::from_sections(&missing, &earlier, Budget::default()).is_err());
    }
    assert_eq!(sections.iter().map(|s| s.tag).collect::<Vec<_>>(), tags::ALL);
}
