#![allow(clippy::unwrap_used)]

use super::*;
use crate::light::Light;
use crate::light::cube_light::Transform;
use crate::math::cube_map;
use crate::math::random::uniform;

fn rectangle(normal: DVec3, size: [f64; 2]) -> UnitRectangle {
    UnitRectangle::of(&Light::area(DVec3::ZERO, normal, size, DVec3::ONE, None).unwrap()).unwrap().0
}

/// The row of an unoccluded point: the cosine with a normal, transformed as rows are.
fn cosine_row(side: usize, normal: DVec3) -> Vec<f32> {
    let (haar, factors) = Transform::SolidAngle.of_transport(side).unwrap();
    let mut row = Vec::new();
    let mut scratch = vec![0.0; side * side];
    for face in 0..cube_map::FACES {
        let texel = |k: usize| normal.dot(cube_map::direction(side, face, k % side, k / side)).max(0.0) as f32;
        let mut picture: Vec<f32> = (0..side * side).map(|k| texel(k) * factors[k]).collect();
        haar.forward(&mut picture, &mut scratch);
        row.extend(picture);
    }
    row
}

/// Irradiance of unit radiance from a rectangle that lies wholly above the horizon: half the sum over the edges of the angle that each
/// fills times the cosine of its plane's normal (Lambert).
fn contour(rectangle: &UnitRectangle, at: DVec3, normal: DVec3) -> Option<f64> {
    let corners = rectangle.corners().map(|c| (c - at).normalize());
    if corners.iter().any(|c| c.dot(normal) < 0.0) {
        return None;
    }
    let edge = |i: usize| {
        let (a, b) = (corners[i], corners[(i + 1) % 4]);
        let cross = a.cross(b);
        cross.length().atan2(a.dot(b)) * normal.dot(cross.normalize_or_zero())
    };
    Some(0.5 * (0..4).map(edge).sum::<f64>().abs())
}

/// A place at a distance in front, and a normal that turns towards the rectangle.
fn place(rectangle: &UnitRectangle, index: u64, distance: f64) -> (DVec3, DVec3) {
    let n = |d: u64| uniform(43, index, d) - 0.5;
    let way = DVec3::new(n(0), n(1), n(2)).normalize();
    let way = if way.dot(rectangle.axes()[2]) < 0.0 { -way } else { way };
    (distance * way, (DVec3::new(n(3), n(4), n(5)) - way).normalize())
}

/// RMS of differences over the RMS of the closed form, of the interpolated and of the exact map.
fn errors(field: &SourceField, rectangle: &UnitRectangle, side: usize, distances: [f64; 2]) -> [f64; 2] {
    let mut memory = field.memory();
    let (mut sums, mut square) = ([0.0; 2], 0.0);
    for i in 0..300 {
        let distance = distances[0] * (distances[1] / distances[0]).powf(uniform(44, i, 0));
        let (at, normal) = place(rectangle, i, distance);
        let Some(exact) = contour(rectangle, at, normal) else { continue };
        let row = cosine_row(side, normal);
        let found = [field.product(at, &row, &mut memory), field.exact(at, &row, &mut memory)];
        sums.iter_mut().zip(found).for_each(|(sum, e)| *sum += (e - exact) * (e - exact));
        square += exact * exact;
    }
    sums.map(|sum| (sum / square).sqrt())
}

#[test]
fn the_closed_form_is_reached_as_points_and_texels_grow() {
    let shape = rectangle(DVec3::new(0.3, -0.8, 0.4), [2.0, 1.0]);
    let mut found = Vec::new();
    for (side, points) in [(8, 32), (32, 4), (32, 8), (32, 16), (32, 32), (64, 32)] {
        let field = SourceField::new(shape, side, points).unwrap();
        found.push(errors(&field, &shape, side, [1.5, 30.0]));
    }
    // Texels alone, then points: twice as many are four times as good.
    assert!(found[0][1] < 0.02 && found[4][1] < 2e-3 && found[5][1] < 8e-4, "{found:?}");
    let interpolated: Vec<f64> = found.iter().map(|errors| errors[0]).collect();
    assert!(
        interpolated[1..].windows(2).zip([0.4, 0.4, 0.6]).all(|(pair, most)| pair[1] < most * pair[0]),
        "{found:?}"
    );
    assert!(interpolated[4] < 5e-3, "{found:?}");
}

#[test]
fn places_near_the_rectangle_have_their_own_map() {
    for normal in [DVec3::Z, DVec3::new(1.0, 2.0, -0.5)] {
        let shape = rectangle(normal, [1.0, 3.0]);
        let field = SourceField::new(shape, 32, 4).unwrap();
        let [interpolated, exact] = errors(&field, &shape, 32, [0.05, 1.41]);
        assert!(interpolated == exact && exact < 3e-3, "{exact}");
    }
}

#[test]
fn behind_is_dark_and_far_away_falls_with_the_square() {
    let shape = rectangle(DVec3::Y, [1.0, 1.0]);
    let field = SourceField::new(shape, 32, 16).unwrap();
    let mut memory = field.memory();
    let row = cosine_row(32, -DVec3::Y);
    for at in [-DVec3::Y, DVec3::X, DVec3::new(3.0, -1e-9, 0.0), DVec3::NAN, DVec3::splat(1e300), DVec3::ZERO] {
        assert_eq!(field.product(at, &row, &mut memory), 0.0, "{at}");
    }
    let way = DVec3::new(0.2, 1.0, 0.1).normalize();
    for distance in [100.0, 1e4, 1e8] {
        let found = field.product(distance * way, &row, &mut memory);
        let expected = 2.0 * way.y * way.y / (distance * distance);
        assert!((found / expected - 1.0).abs() < 5e-3, "{distance}: {found} {expected}");
    }
}

#[test]
fn values_are_continuous_through_every_sphere_but_the_innermost() {
    let shape = rectangle(DVec3::new(0.1, 0.2, 1.0), [1.0, 0.4]);
    let field = SourceField::new(shape, 32, 16).unwrap();
    let mut memory = field.memory();
    for i in 0..40 {
        let (way, normal) = place(&shape, i, 1.0);
        let row = cosine_row(32, normal);
        for sphere in 1..field.spheres {
            let [inside, outside] =
                [-1e-9, 1e-9].map(|e| field.product(way * (radius(sphere) * (1.0 + e)), &row, &mut memory));
            assert!((inside - outside).abs() <= 1e-6 * inside.abs().max(1e-9), "{sphere}: {inside} {outside}");
        }
    }
}

#[test]
fn fields_do_not_depend_on_threads_and_say_their_size() {
    let shape = rectangle(DVec3::new(1.0, -1.0, 0.2), [2.0, 1.0]);
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let [a, b] = [one.install(|| SourceField::new(shape, 32, 8)).unwrap(), SourceField::new(shape, 32, 8).unwrap()];
    assert!(a.indices == b.indices && a.values == b.values && a.steps == b.steps && a.offsets == b.offsets);
    assert_eq!(a.steps.len(), a.spheres * 81);
    assert!(a.bytes() > 4 * a.indices.len());
    assert!(a.is_of(&shape, 32, 8) && !a.is_of(&shape, 64, 8) && !a.is_of(&shape, 32, 9));
    assert!(SourceField::new(shape, 33, 8).is_err());
    assert!(SourceField::new(shape, 32, 3).is_err() && SourceField::new(shape, 32, 65).is_err());
}
