//! Meshes that the data has not: a ball above a plate, half a ball with and without its cap.

use glam::DVec3;
use translux::geometry::shapes::{compose, cos_sin_of_turn, cuboid, icosphere};
use translux::geometry::source::SourceModel;

/// A ball at some distance above a plate of 30 x 4 x 30 whose top is at y = 0; the plate's vertices come first.
pub(crate) fn ball_above_plate(radius: f64, gap: f64, divisions: u32) -> SourceModel {
    let plate = cuboid(DVec3::new(30.0, 4.0, 30.0), divisions);
    let ball = icosphere(radius, 5);
    compose(&[(plate, DVec3::new(0.0, -2.0, 0.0)), (ball, DVec3::new(0.0, radius + gap, 0.0))])
}

/// Whether half a ball is closed by a disc.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Cap {
    There,
    Missing,
}

/// The upper half of a ball; the disc's vertices come after those of the shell.
pub(crate) fn half_ball(radius: f64, rings: u32, segments: u32, cap: Cap) -> SourceModel {
    let ring = |height: f64, radius: f64| {
        (0..segments).map(move |s| {
            let c = cos_sin_of_turn(f64::from(s) / f64::from(segments));
            DVec3::new(c.x * radius, height, -c.y * radius)
        })
    };
    let quarter = |r: u32| cos_sin_of_turn(0.25 * f64::from(r) / f64::from(rings)) * radius;
    // From the rim up to the pole, then from the rim inwards to the middle of the disc.
    let mut positions: Vec<DVec3> = (0..rings).flat_map(|r| ring(quarter(r).y, quarter(r).x)).collect();
    positions.push(DVec3::new(0.0, radius, 0.0));
    let mut triangles = Vec::new();
    let mut band = |lower: u32, upper: u32, turned: bool| {
        for s in 0..segments {
            let next = (s + 1) % segments;
            let (a, b, c, d) = (lower + s, lower + next, upper + next, upper + s);
            let both = [[a, b, c], [a, c, d]];
            triangles.extend(both.map(|[a, b, c]| if turned { [a, c, b] } else { [a, b, c] }));
        }
    };
    (1..rings).for_each(|r| band((r - 1) * segments, r * segments, false));
    let pole = positions.len() as u32 - 1;
    if cap == Cap::There {
        let first = positions.len() as u32;
        for r in 1..rings {
            let share = f64::from(rings - r) / f64::from(rings);
            positions.extend(ring(0.0, radius * share));
        }
        positions.push(DVec3::ZERO);
        for r in 1..rings {
            let lower = if r == 1 { 0 } else { first + (r - 2) * segments };
            band(lower, first + (r - 1) * segments, true);
        }
        let (last, centre) = (first + rings.saturating_sub(2) * segments, positions.len() as u32 - 1);
        triangles.extend((0..segments).map(|s| [last + (s + 1) % segments, last + s, centre]));
    }
    let last = (rings - 1) * segments;
    triangles.extend((0..segments).map(|s| [last + s, last + (s + 1) % segments, pole]));
    SourceModel::new(positions, triangles)
}
