//! What a page holds against the evaluator that it was made of.
#![allow(clippy::unwrap_used)]

use super::*;

/// Smooth columns of three functions of the place.
fn columns(vertices: usize, directions: usize) -> Vec<Vec<f32>> {
    let of = |i: usize, v: usize| {
        let (t, x) = (i as f32 * 0.1, v as f32 / vertices as f32);
        1.0 + t.sin() * x + t.cos() * x * x
    };
    (0..3 * directions).map(|i| (0..vertices).map(|v| of(i, v)).collect()).collect()
}

#[test]
fn as_many_functions_as_there_are_and_codes_that_use_their_range() {
    let (count, codes) = functions(&columns(50, 40), &[1.0; 50]).unwrap();
    assert!((1..=3).contains(&count), "{count}");
    assert_eq!(codes.len(), 50 * count);
    for k in 0..count {
        assert_eq!(codes.iter().skip(k).step_by(count).map(|code| code.unsigned_abs()).max(), Some(127));
    }
}

#[test]
fn black_has_no_functions() {
    assert_eq!(functions(&vec![vec![0.0; 5]; 96], &[1.0; 5]).unwrap(), (0, Vec::new()));
    assert_eq!(functions(&vec![Vec::new(); 96], &[]).unwrap(), (0, Vec::new()));
}
