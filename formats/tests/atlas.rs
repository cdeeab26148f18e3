//! Atlases go through their sections, and nothing else is accepted.
#![allow(clippy::unwrap_used)]

use translux_format::Budget;
use translux_format::atlas::{Atlas, Numbers, tags};

fn numbers() -> Numbers {
    Numbers {
        charts: 2,
        own: true,
        page: 256,
        occupancy: 0.7,
        overlap: 1e-5,
        stretch: 1.01,
        area_range: [0.9, 1.1],
        smallest: 0.4,
        flat: 1,
    }
}

/// A grid of `n` by `n` squares, its right half with places of its own, and its triangles.
fn grid(n: u32) -> (Atlas, Vec<[u32; 3]>) {
    let vertex = |x: u32, y: u32| y * (n + 1) + x;
    let (mut corners, mut triangles) = (Vec::new(), Vec::new());
    for y in 0..n {
        for x in 0..n {
            let square = [[x, y], [x + 1, y], [x + 1, y + 1], [x, y + 1]];
            let place =
                |[i, j]: [u32; 2]| [i * 300 + (j * j) % 7 + 2000 * u32::from(2 * x >= n), j * 311].map(|v| v as u16);
            for [a, b, c] in [[0, 1, 2], [0, 2, 3]] {
                triangles.push([a, b, c].map(|i: usize| vertex(square[i][0], square[i][1])));
                corners.push([a, b, c].map(|i: usize| place(square[i])));
            }
        }
    }
    (Atlas { numbers: numbers(), corners }, triangles)
}

fn read(atlas: &Atlas, triangles: &[[u32; 3]]) -> Option<Atlas> {
    Atlas::from_sections(&atlas.to_sections(triangles).unwrap(), triangles, Budget::default()).unwrap()
}

#[test]
fn atlases_survive() {
    for n in [1, 2, 30] {
        let (atlas, triangles) = grid(n);
        assert_eq!(read(&atlas, &triangles), Some(atlas.clone()));
        let fewer = &triangles[1..];
        assert!(atlas.to_sections(fewer).is_err());
        assert!(Atlas::from_sections(&atlas.to_sections(&triangles).unwrap(), fewer, Budget::default()).is_err());
    }
    let none = Atlas::default();
    assert_eq!(read(&none, &[]), Some(none));
    assert_eq!(Atlas::from_sections(&[], &[], Budget::default()).unwrap(), None);
    let (atlas, triangles) = grid(30);
    let bytes: usize = atlas.to_sections(&triangles).unwrap().iter().map(|s| s.bytes.len()).sum();
    assert!(bytes < 31 * 31 * 3 / 2, "{bytes} bytes");
}

#[test]
fn any_places_on_any_triangles_survive() {
    let mut state = 7u32;
    let mut next = |below: u32| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) % below
    };
    for (names, places) in [(1, 1), (2, 65_536), (5, 3), (1 << 24, 65_536)] {
        let triangles: Vec<[u32; 3]> = (0..500).map(|_| [0; 3].map(|_| u32::MAX - next(names))).collect();
        let corners = triangles.iter().map(|_| [0; 3].map(|_| [next(places) as u16, next(places) as u16])).collect();
        let atlas = Atlas { numbers: numbers(), corners };
        assert_eq!(read(&atlas, &triangles), Some(atlas));
    }
    // A vertex with more places than a half of the distance back has.
    let triangles = vec![[0, 0, 1]; 70_000];
    let place = |t: u32| [(t % 65_536) as u16, (t / 65_536) as u16];
    let corners = (0..70_000).map(|t| [place(t), place(69_999 - t), [0; 2]]).collect();
    let atlas = Atlas { numbers: numbers(), corners };
    assert_eq!(read(&atlas, &triangles), Some(atlas));
}

#[test]
fn nonsense_is_refused() {
    let (atlas, triangles) = grid(4);
    let refused = |change: &dyn Fn(&mut Atlas)| {
        let mut changed = atlas.clone();
        change(&mut changed);
        assert!(changed.to_sections(&triangles).is_err(), "{:?}", changed.numbers);
    };
    refused(&|a| a.numbers.occupancy = 1.5);
    refused(&|a| a.numbers.overlap = f64::NAN);
    refused(&|a| a.numbers.stretch = -1.0);
    refused(&|a| a.numbers.area_range = [2.0, 1.0]);
    refused(&|a| a.numbers.smallest = f64::INFINITY);
    refused(&|a| a.numbers.flat = 33);
    refused(&|a| a.numbers.charts = 33);
    refused(&|a| a.corners.push([[0; 2]; 3]));
    let sections = atlas.to_sections(&triangles).unwrap();
    assert_eq!(sections.iter().map(|s| s.tag).collect::<Vec<_>>(), tags::ALL);
    assert!(Atlas::from_sections(&sections, &triangles, Budget::bytes(1000)).is_err());
    for section in 0..sections.len() {
        let error = |change: &dyn Fn(&mut Vec<u8>)| {
            let mut changed = sections.clone();
            change(&mut changed[section].bytes);
            Atlas::from_sections(&changed, &triangles, Budget::default()).is_err()
        };
        let length = sections[section].bytes.len();
        assert!((0..length).all(|cut| error(&|bytes| bytes.truncate(cut))), "{section}");
        assert!(error(&|bytes| bytes.push(1)) && error(&|bytes| bytes.push(0)));
        // What is accepted is what the encoder writes for it.
        for bit in 0..8 * length {
            let mut changed = sections.clone();
            changed[section].bytes[bit / 8] ^= 1 << (bit % 8);
            if let Ok(Some(other)) = Atlas::from_sections(&changed, &triangles, Budget::default()) {
                assert_eq!(other.to_sections(&triangles).unwrap(), changed, "{section} {bit}");
            }
        }
        let mut missing = sections.clone();
        missing.remove(section);
        assert!(Atlas::from_sections(&missing, &triangles, Budget::default()).is_err());
    }
}
