#![allow(clippy::unwrap_used)]

use glam::{DVec3, Vec2};

use super::harmonics::basis;
use super::raster::{dilate, nearest};
use super::*;
use crate::io::gltf::written::Column;
use crate::math::sh::real_sh;

/// The nine functions are orthonormal, and those of the rest of the program up to signs and the names of axes.
#[test]
fn harmonics_are_orthonormal_and_positive() {
    let (rings, around) = (64, 64);
    let mut products = [[0.0; 9]; 9];
    for i in 0..rings * around {
        let height = ((i / around) as f64 + 0.5) / rings as f64 * 2.0 - 1.0;
        let (sin, cos) = ((i % around) as f64 / around as f64 * std::f64::consts::TAU).sin_cos();
        let radius = (1.0 - height * height).sqrt();
        let y = basis(DVec3::new(radius * cos, height, radius * sin));
        let weight = 4.0 * std::f64::consts::PI / (rings * around) as f64;
        for (a, row) in products.iter_mut().enumerate() {
            row.iter_mut().enumerate().for_each(|(b, sum)| *sum += weight * y[a] * y[b]);
        }
    }
    for (a, row) in products.iter().enumerate() {
        for (b, product) in row.iter().enumerate() {
            assert!((product - f64::from(u8::from(a == b))).abs() < 1e-3, "{a} {b}: {product}");
        }
    }
    let at = DVec3::new(0.3, -0.5, 0.7).normalize();
    let mut others = [0.0; 9];
    real_sh(3, at, &mut others);
    for (k, (own, other)) in basis(at).into_iter().zip(others).enumerate() {
        let odd = [1, 3, 5, 7].contains(&k);
        assert!((own - if odd { -other } else { other }).abs() < 1e-12, "{k}");
    }
}

#[test]
fn godot_gets_its_floats_four_by_four() {
    let data = VertexData {
        columns: vec![Column::new("COLOR_0", 3), Column::new("_TLX_E", 3)],
        rows: (0..12).map(|i| i as f32).collect(),
    };
    let custom = data.for_godot().unwrap();
    let names: Vec<(&str, usize)> = custom.columns.iter().map(|c| (c.name.as_str(), c.width)).collect();
    assert_eq!(names, [("COLOR_0", 3), ("TEXCOORD_2", 2), ("TEXCOORD_3", 2)]);
    assert_eq!(custom.rows, [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 0.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 0.0]);
    let many = VertexData { columns: vec![Column::new("_A", 4); 4], rows: vec![0.0; 16] };
    assert!(many.for_godot().is_err());
}

/// Whatever the winding: within a triangle the texel's own place, beyond it the nearest of the edge, nothing farther away.
#[test]
fn texels_show_the_nearest_point() {
    let corners = [Vec2::new(0.25, 0.25), Vec2::new(0.75, 0.25), Vec2::new(0.25, 0.75)];
    for corners in [corners, [corners[0], corners[2], corners[1]]] {
        let texels = nearest([(7, corners)].into_iter(), 16);
        for (i, texel) in texels.iter().enumerate() {
            let at = Vec2::new((i % 16) as f32 + 0.5, 15.5 - (i / 16) as f32) / 16.0;
            let beyond = [0.25 - at.x, 0.25 - at.y, (at.x + at.y - 1.0) / 2_f32.sqrt()];
            let is_inside = beyond.iter().all(|d| *d <= 0.0);
            let along = |i: usize| {
                let (from, to) = (corners[i], corners[(i + 1) % 3]);
                (0..=1000).map(move |k| 16.0 * from.lerp(to, k as f32 / 1000.0).distance(at))
            };
            let distance = (0..3).flat_map(along).fold(f32::INFINITY, f32::min);
            let distance = if is_inside { 0.0 } else { distance };
            match texel {
                None => assert!(distance > 1.49, "{at}: {distance}"),
                Some(found) => {
                    assert_eq!(found.triangle, 7);
                    let place: Vec2 = corners.iter().zip(found.weights).map(|(c, w)| *c * w as f32).sum();
                    assert!((16.0 * place.distance(at) - distance).abs() < 0.01 && distance < 1.51, "{at}: {distance}");
                    assert_eq!(found.distance2 == 0.0, is_inside, "{at}");
                }
            }
        }
    }
}

#[test]
fn texels_without_a_value_get_those_of_their_neighbours() {
    let mut values = vec![None; 64];
    (values[9], values[63]) = (Some(DVec3::X), Some(DVec3::Y));
    dilate(&mut values, 8);
    assert!(values.iter().all(|value| value.is_some_and(|v| (v.element_sum() - 1.0).abs() < 1e-12)));
    assert_eq!((values[0], values[54]), (Some(DVec3::X), Some(DVec3::Y)));
}
