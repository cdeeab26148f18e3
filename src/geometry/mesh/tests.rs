#![allow(clippy::unwrap_used)]

use glam::{DVec3, Vec2};

use super::*;
use crate::error::ExitCode;
use crate::geometry::shapes::{compose, icosphere};
use crate::geometry::source::SourceModel;

const UNIT: Placement = Placement { mm_per_unit: 1.0 };

fn triangles(positions: &[[f64; 3]], triangles: &[[u32; 3]]) -> SourceModel {
    SourceModel {
        uvs: Some(CornerAttribute {
            values: (0..triangles.len()).map(|t| Vec2::splat(t as f32)).collect(),
            corners: (0..triangles.len() as u32).map(|t| [t; 3]).collect(),
        }),
        ..SourceModel::new(positions.iter().copied().map(DVec3::from).collect(), triangles.to_vec())
    }
}

#[test]
fn each_repair_is_made_and_counted_and_attributes_follow() {
    let source = triangles(
        &[
            [0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, 0.0, 0.0],
            [2.0, 0.0, 0.0],
            [f64::NAN, f64::INFINITY, 0.0],
            [-0.0, 1.0, -0.0],
            [7.0, 7.0, 7.0],
        ],
        &[
            [0, 0, 1], // a repeated index
            [0, 1, 2],
            [0, 3, 1], // a repeated place
            [0, 1, 4], // a line
            [1, 6, 3], // repeats the second, turned and through welded vertices
            [2, 1, 0], // the back of the second
            [1, 4, 2],
        ],
    );
    let (mesh, report) = Mesh::from_source(source, &UNIT).unwrap();
    assert_eq!(mesh.triangles, [[0, 1, 2], [2, 1, 0], [1, 4, 2]]);
    assert_eq!(mesh.uvs.as_ref().unwrap().corners, [[1; 3], [5; 3], [6; 3]]);
    assert_eq!(mesh.weld, [0, 1, 2, 0, 4, 5, 2, 7]);
    let expected = RepairReport {
        source_vertices: 8,
        source_triangles: 7,
        welded_vertices: 2,
        unreferenced_vertices: 2,
        vertices_without_area: 2,
        collapsed_triangles: 2,
        zero_area_triangles: 1,
        duplicate_triangles: 1,
        reversed_twins: 1,
        ..RepairReport::default()
    };
    assert_eq!(report, expected);
    assert_eq!(report.lines().len(), 6);
    assert_eq!(mesh.local_mm[5], Vec3::ZERO);
    assert!(mesh.local_mm.iter().all(|p| p.is_finite()));
    assert_eq!(mesh.bounds_local_mm(), [DVec3::new(-1.0, -0.5, 0.0), DVec3::new(1.0, 0.5, 0.0)]);
    assert_eq!(mesh.total_area_mm2(), 1.5);
    assert_eq!(mesh.normal(0), DVec3::Z);
}

#[test]
fn order_scale_and_origin_are_kept() {
    let sphere = icosphere(2.0, 3);
    let far = DVec3::new(1e6, -2e6, 3e6);
    let moved = compose(&[(sphere.clone(), far)]);
    let (mesh, report) = Mesh::from_source(moved, &Placement { mm_per_unit: 3.0 }).unwrap();
    assert!((mesh.origin_mm - far * 3.0).length() < 1e-6);
    assert_eq!(mesh.triangles, sphere.triangles);
    assert_eq!(report.welded_vertices, 0);
    for (v, p) in sphere.positions.iter().enumerate() {
        assert!((mesh.position_mm(v as u32) - (far + *p) * 3.0).length() < 1e-6);
    }
}

#[test]
fn meshes_without_area_or_beyond_single_precision_are_errors() {
    let fails = |source: SourceModel, mm_per_unit: f64| {
        let error = Mesh::from_source(source, &Placement { mm_per_unit }).unwrap_err();
        assert_eq!(error.code(), ExitCode::InvalidInput, "{error}");
        error.message().to_string()
    };
    let line = triangles(&[[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]], &[[0, 1, 2], [0, 0, 1]]);
    assert!(fails(line, 1.0).contains("1 are lines"));
    let point = triangles(&[[1.0; 3]; 3], &[[0, 1, 2]]);
    fails(point, 1.0);
    fails(SourceModel::default(), 1.0);
    let huge = |x: f64| triangles(&[[x, -x, 0.0], [-x, x, x], [x, x, -x]], &[[0, 1, 2]]);
    assert!(fails(huge(3.4e38), 1.0).contains("--size-mm"));
    fails(huge(1e308), 1.0);
    fails(huge(1.0), 1e-9);
    fails(huge(1.0), f64::NAN);
    fails(huge(f64::INFINITY), 1.0);
    let mut out_of_range = huge(1.0);
    out_of_range.triangles[0][1] = 3;
    fails(out_of_range, 1.0);
    let mut attribute = huge(1.0);
    attribute.uvs.as_mut().unwrap().corners[0] = [9; 3];
    fails(attribute, 1.0);
    let placement = resolve_scale(&huge(3.4e38), Some(Scale::DiagonalMm(30.0))).unwrap();
    let (mesh, _) = Mesh::from_source(huge(3.4e38), &placement).unwrap();
    assert!((mesh.diagonal_mm() - 30.0).abs() < 1e-4);
}

#[test]
fn a_large_fan_has_its_repetitions_removed_quickly() {
    let n = 50_000u32;
    let rim = |i: u32| [f64::from(i), f64::from(i) * f64::from(i) * 1e-5, 1.0];
    let positions: Vec<[f64; 3]> = std::iter::once([0.0; 3]).chain((0..=n).map(rim)).collect();
    let once: Vec<[u32; 3]> = (1..=n).map(|i| [0, i, i + 1]).collect();
    let twice: Vec<[u32; 3]> = once.iter().copied().chain(once.iter().map(|&[a, b, c]| [b, c, a])).collect();
    let (mesh, report) = Mesh::from_source(triangles(&positions, &twice), &UNIT).unwrap();
    assert_eq!((mesh.triangles, report.duplicate_triangles), (once, n as usize));
}

#[test]
fn skipped_materials_go_with_their_triangles_only() {
    let named = |name: &str| icosphere(1.0, 0).of_material(name);
    let mut source = compose(&[(named("skin"), DVec3::ZERO), (named("iron"), DVec3::X)]);
    let error = skip_materials(&mut source, &["steel".into()]).unwrap_err();
    assert!(error.message().contains("'skin', 'iron'") && error.code() == ExitCode::CommandLine);
    assert!(skip_materials(&mut source.clone(), &["skin".into(), "iron".into()]).is_err());
    skip_materials(&mut source, &["skin".into()]).unwrap();
    assert_eq!((source.triangles.len(), source.positions.len(), source.materials.len()), (20, 24, 2));
    let (mesh, report) = Mesh::from_source(source, &UNIT).unwrap();
    assert_eq!((report.unreferenced_vertices, mesh.local_mm.len()), (12, 24));
}

#[test]
fn a_pose_is_the_same_mesh_and_anything_else_is_named() {
    let ball = icosphere(1.0, 1);
    let mesh = Mesh::from_source(ball.clone(), &UNIT).unwrap().0;
    mesh.check_pose(&ball).unwrap();
    let message = |model: &SourceModel| {
        let error = mesh.check_pose(model).unwrap_err();
        assert_eq!(error.code(), ExitCode::InvalidInput);
        error.to_string()
    };
    assert!(message(&icosphere(1.0, 2)).contains("162 vertices and 320 triangles"));
    let mut swapped = ball.clone();
    swapped.triangles.swap(3, 9);
    assert!(message(&swapped).contains("its triangle 3 has the vertices"), "{}", message(&swapped));
    let mut more = ball.clone();
    more.triangles.push([0, 1, 40]);
    more.triangle_material.push(0);
    assert!(message(&more).contains("triangle 80"), "{}", message(&more));
    // Repeated, without area, or of a material that was skipped: never in the mesh.
    let mut repeated = ball.clone();
    for corners in [ball.triangles[7], [4, 4, 5]] {
        repeated.triangles.insert(20, corners);
        repeated.triangle_material.push(0);
    }
    mesh.check_pose(&repeated).unwrap();
    // Turned round, as parts with their normals inwards are.
    let mut turned = ball;
    turned.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    mesh.check_pose(&turned).unwrap();
    // A quad and a pentagon, cut along other diagonals.
    let corners = [[0.0, 0.0], [1.0, 0.0], [2.0, 0.5], [2.0, 1.0], [1.0, 1.0], [0.0, 1.0]];
    let cut = |list: &[[u32; 3]]| triangles(&corners.map(|[x, y]| [x, y, 0.1 * x * y]), list);
    let flat = Mesh::from_source(cut(&[[0, 1, 4], [0, 4, 5], [1, 2, 3], [1, 3, 4]]), &UNIT).unwrap().0;
    flat.check_pose(&cut(&[[0, 1, 5], [1, 4, 5], [1, 2, 4], [2, 3, 4]])).unwrap();
    assert!(flat.check_pose(&cut(&[[0, 1, 5], [1, 4, 5], [1, 2, 4], [2, 3, 0]])).is_err());
}

#[test]
fn positions_of_a_pose_keep_what_has_not_moved() {
    let mesh = Mesh::from_source(icosphere(1.0, 1), &UNIT).unwrap().0;
    let places: Vec<DVec3> = (0..42).map(|v| mesh.position_mm(v)).collect();
    let near: Vec<DVec3> = places.iter().map(|p| *p + DVec3::splat(1e-7)).collect();
    assert_eq!(mesh.posed(&near, 1.0).unwrap().local_mm, mesh.local_mm);
    // Far away the origin goes along, and the shape keeps its digits.
    let far: Vec<DVec3> = places.iter().map(|p| *p + DVec3::new(1e6, 0.0, 0.0)).collect();
    let pose = mesh.in_pose(&mesh.posed(&far, 1.0).unwrap());
    assert!(pose.origin_mm.x > 9e5 && pose.position_mm(3).distance(far[3]) < 1e-6);
    for bad in [DVec3::NAN, DVec3::INFINITY, DVec3::splat(1e300)] {
        let mut broken = places.clone();
        broken[5] = bad;
        assert_eq!(mesh.posed(&broken, 1.0).unwrap_err().code(), ExitCode::InvalidInput);
    }
    assert!(mesh.posed(&places[1..], 1.0).is_err() && mesh.posed(&[DVec3::ONE; 42], 1.0).is_err());
}
