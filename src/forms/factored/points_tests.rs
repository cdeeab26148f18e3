#![allow(clippy::unwrap_used)]
use super::*;
use crate::error::ExitCode;
use crate::forms::factored::far_sums::{ByFunction, FarSums};
use crate::math::simd::InstructionSet;
use crate::transport::balanced_tree::LightDetails;
use translux_format::far_field as file;

const SIDE: usize = 100;

/// A square of 100 x 100 mm and, above it, one of 8 x 8 mm that is another part.
fn receivers() -> Receivers {
    let at = |part: u32, side: usize| {
        (0..side * side).map(move |i| {
            let [x, y] = [i % side, i / side].map(|c| c as f64 + 0.3 * f64::from((i * 7 % 5) as u32));
            Some((part, DVec3::new(x, y, 30.0 * f64::from(part))))
        })
    };
    Receivers::at(&at(0, SIDE).chain(at(1, 8)).collect::<Vec<_>>(), LANES)
}

/// A field whose value of every row and function is what `value` makes of the row's place: sums alone, under a mean of 1.
fn field(points: &FarPoints, terms: usize, value: impl Fn(DVec3, usize) -> f64) -> FarField {
    let rows = &points.rows;
    let group = |(group, &functions): (&Group, &u16)| file::Group {
        part: group.part,
        rows_end: group.run.end,
        coefficients_end: 0,
        functions,
    };
    let mut far = FarField {
        terms,
        receiver_of_vertex: points.receivers.of_vertex.clone(),
        groups: rows.places.groups.iter().zip(&rows.functions).map(group).collect(),
        others: rows.others.clone(),
        steps: vec![1.0; terms],
        ..FarField::default()
    };
    for (group, mask) in rows.places.groups.iter().zip(&rows.functions) {
        for at in &rows.places.positions[group.run.range()] {
            far.row_sums.extend((0..terms).map(|k| if mask >> k & 1 == 1 { value(*at, k) as f32 } else { 0.0 }));
        }
    }
    far
}

#[test]
fn functions_lie_at_points_of_their_own_spacing() {
    let all = receivers();
    let points = FarPoints::choose(&all, 2.0, &[0, 2, 0, 1, 2]);
    let classes = points.rows.classes();
    assert_eq!(classes.iter().map(|(mask, _)| *mask).collect::<Vec<_>>(), [0b00101, 0b01000, 0b10010]);
    let of_part = |groups: &[Group], part: u32| -> Vec<DVec3> {
        let mine = groups.iter().filter(|g| g.part == part);
        mine.flat_map(|g| points.rows.places.positions[g.run.range()].iter().copied()).collect()
    };
    for (level, (_, groups)) in classes.iter().enumerate() {
        let mine = of_part(groups, 0);
        let spacing = 2.0 * f64::from(1u32 << level);
        let apart = mine.iter().enumerate().flat_map(|(i, a)| mine[..i].iter().map(move |b| a.distance(*b)));
        let least = apart.fold(f64::INFINITY, f64::min);
        assert!(least >= spacing, "{least} mm of {spacing}, {} points", mine.len());
        let expected = 0.7 * (SIDE * SIDE) as f64 / (spacing * spacing);
        assert!((0.7..1.5).contains(&(mine.len() as f64 / expected)), "{} of {expected}", mine.len());
        // The small part has functions at all its points: there are few.
        assert_eq!(of_part(groups, 1).len(), of_part(&classes[0].1, 1).len());
    }
    let text = points.describe();
    assert!(text.contains("points, of the functions 2 at all, 1 at ") && text.matches(" at ").count() == 3, "{text}");
    // With one level, and with levels that all functions share, there is one set of rows.
    for levels in [[0; 3], [1; 3]] {
        let points = FarPoints::choose(&all, 2.0, &levels);
        assert!(points.rows.others.is_empty() && points.fills.is_empty());
        assert_eq!(points.rows.classes().len(), 1);
    }
    let every = FarPoints::choose(&all, 0.0, &[0, 3]);
    assert!(every.weights.is_none() && every.receivers.len() == all.len());
}

#[test]
fn points_without_a_function_take_it_from_those_that_have_it_also_when_read_again() {
    let all = receivers();
    let smooth = |at: DVec3, k: usize| {
        let length = [6.0, 12.0, 24.0][k];
        1.5 + (at.x / length).sin() * (at.y / length).cos() + 0.01 * at.z
    };
    let points = FarPoints::choose(&all, 2.0, &[0, 1, 2]);
    let far = field(&points, 3, smooth);
    let part_offsets = [0, 1, 2];
    let shape = file::Shape { vertices: far.receiver_of_vertex.len(), part_offsets: &part_offsets };
    far.validate(&shape).unwrap();
    let read = FarPoints::of(&far, &all).unwrap();
    assert_eq!(read.receivers.positions, points.receivers.positions);
    assert_eq!(read.rows.places.positions, points.rows.places.positions);
    let details = LightDetails { details: vec![[0.0; 3]; 2], means: vec![[1.0; 3]; 2], scale: 1.0, colour: None };
    for points in [&points, &read] {
        let order = ByFunction::new(&far);
        let sums = FarSums::new(InstructionSet::detect(), (&far, &order, &points.fills), &details);
        for (i, &at) in points.receivers.positions.iter().enumerate() {
            for k in 0..3 {
                let error = (sums.value(i, k).x - smooth(at, k)).abs();
                // The coarsest rows are a quarter of the wave apart, and on the border there is nobody beyond.
                let most = if k == 0 { 1e-6 } else { 0.02 };
                assert!(error < most, "function {k} at {at}: {error}");
            }
        }
    }
    let mut other = far.clone();
    let vertex = |point: u32| far.receiver_of_vertex.iter().position(|p| *p == point).unwrap();
    other.receiver_of_vertex.swap(vertex(3), vertex(40));
    assert_eq!(FarPoints::of(&other, &all).err().unwrap().code(), ExitCode::InvalidInput);
}
