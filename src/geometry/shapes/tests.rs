#![allow(clippy::unwrap_used)]

use std::f64::consts::PI;

use super::*;
use crate::geometry::check::MeshCheck;
use crate::geometry::mesh::Placement;
use crate::geometry::test_data;

fn checked(source: &SourceModel) -> MeshCheck {
    test_data::checked(source.clone(), Placement { mm_per_unit: 1.0 }, None)
}

fn euler(c: &MeshCheck) -> i64 {
    c.welded_vertices_used as i64 - c.edges as i64 + c.triangles as i64
}

/// Closed, manifold, outward and in one piece, with the given Euler number.
fn assert_sound(name: &str, source: &SourceModel, expected_euler: i64) -> MeshCheck {
    let c = checked(source);
    assert_eq!(c.warnings(), Vec::<String>::new(), "{name}");
    assert_eq!((c.boundary_edges, c.non_manifold_edges, c.non_manifold_vertices), (0, 0, 0), "{name}");
    assert_eq!((c.components, c.repairs.flipped_components), (1, 0), "{name}");
    assert_eq!(euler(&c), expected_euler, "{name}");
    assert!(c.volume_mm3.unwrap() > 0.0, "{name}");
    c
}

fn near(value: f64, expected: f64, relative: f64) {
    assert!((value / expected - 1.0).abs() < relative, "{value} instead of {expected}");
}

#[test]
fn the_unit_circle_agrees_with_the_library() {
    for i in -1000..1000 {
        let turns = f64::from(i) / 397.0;
        let (sin, cos) = (turns * 2.0 * PI).sin_cos();
        let c = cos_sin_of_turn(turns);
        assert!((c.x - cos).abs() < 1e-14 && (c.y - sin).abs() < 1e-14, "{turns}");
    }
}

#[test]
fn shapes_are_closed_with_their_euler_numbers_areas_and_volumes() {
    let sphere = assert_sound("icosphere", &icosphere(10.0, 5), 2);
    near(sphere.area_mm2, 400.0 * PI, 2e-3);
    near(sphere.volume_mm3.unwrap(), 4000.0 * PI / 3.0, 3e-3);
    assert_eq!((sphere.triangles, sphere.vertices), (20 * 1024, 10 * 1024 + 2));

    let sphere = assert_sound("uv sphere", &uv_sphere(10.0, 96, 48), 2);
    near(sphere.area_mm2, 400.0 * PI, 2e-3);

    let c = assert_sound("cuboid", &cuboid(DVec3::new(2.0, 3.0, 4.0), 7), 2);
    near(c.area_mm2, 52.0, 1e-6);
    near(c.volume_mm3.unwrap(), 24.0, 1e-6);

    let c = assert_sound("torus", &torus(10.0, 3.0, 128, 48), 0);
    near(c.area_mm2, 4.0 * PI * PI * 30.0, 5e-3);
    near(c.volume_mm3.unwrap(), 2.0 * PI * PI * 90.0, 5e-3);

    assert_sound("knot", &torus_knot(2, 3, 10.0, 4.0, 1.5, 400, 24), 0);
    assert_sound("head", &bumpy_head(10.0, 4), 2);
    let open = checked(&plane(4.0, 5.0, 6));
    near(open.area_mm2, 20.0, 1e-6);
    assert_eq!((euler(&open), open.boundary_edges, open.boundary_loops), (1, 24, 1));
}

#[test]
fn the_sphere_converges_with_the_square_of_the_edge() {
    let error = |n| 1.0 - checked(&icosphere(1.0, n)).area_mm2 / (4.0 * PI);
    let ratio = error(3) / error(4);
    assert!((3.7..4.3).contains(&ratio), "{ratio}");
}

#[test]
fn the_knot_encloses_its_length_times_the_cross_section() {
    let c = checked(&torus_knot(2, 3, 10.0, 4.0, 1.0, 2000, 64));
    // Pappus: the volume of a tube is its cross section times the length of the centre line.
    let point = |u: f64| {
        let (a, b) = (4.0 * PI * u, 6.0 * PI * u);
        let ring = 10.0 + 4.0 * b.cos();
        DVec3::new(a.sin() * ring, 4.0 * b.sin(), a.cos() * ring)
    };
    let length: f64 = (0..20_000).map(|i| point(f64::from(i) / 2e4).distance(point(f64::from(i + 1) / 2e4))).sum();
    near(c.volume_mm3.unwrap(), PI * length, 5e-3);
}

#[test]
fn the_demonstration_model_is_one_clean_closed_piece() {
    let model = demo_model();
    assert_eq!(model.metres_per_unit, Some(1e-3));
    assert_eq!(model, demo_model());
    let c = assert_sound("demo", &model, 2);
    assert!((20_000..40_000).contains(&c.triangles), "{}", c.triangles);
    assert!(c.quality[0] > 0.7 && c.edge_mm[2] < 2.0, "{:?} {:?}", c.quality, c.edge_mm);
    let size = DVec3::from(c.bounds_mm[1]) - DVec3::from(c.bounds_mm[0]);
    assert!((50.0..70.0).contains(&size.max_element()), "{size}");
    // The ears are thin, the body is thick.
    let [thin, middle] = c.parts[0].thickness_mm;
    assert!(thin.unwrap() < 3.0 && middle.unwrap() > 6.0);
}

#[test]
fn an_implicit_sphere_has_its_area_and_its_vertices_on_it() {
    let grid = implicit::Grid { min: DVec3::splat(-6.0), max: DVec3::splat(6.0), spacing: 0.4 };
    let sphere = implicit::mesh(&|p: DVec3| p.length() - 5.0, &grid);
    assert!(sphere.positions.iter().all(|p| (p.length() - 5.0).abs() < 1e-9));
    let c = assert_sound("implicit sphere", &sphere, 2);
    near(c.area_mm2, 100.0 * PI, 5e-3);
}

#[test]
fn compositions_keep_order_and_merge_materials() {
    let named = |name: &str| icosphere(1.0, 0).of_material(name);
    let whole = compose(&[(named("a"), DVec3::ZERO), (named("b"), DVec3::X * 3.0), (named("a"), DVec3::X * 6.0)]);
    assert_eq!(whole.materials, ["a", "b"]);
    assert_eq!(whole.positions.len(), 36);
    assert_eq!([0, 20, 40].map(|t| whole.triangle_material[t]), [0, 1, 0]);
    assert_eq!(whole.triangles[40], named("a").triangles[0].map(|v| v + 24));
    assert_eq!(checked(&whole).components, 3);
}
