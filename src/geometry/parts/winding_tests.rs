#![allow(clippy::unwrap_used)]

use glam::DVec3;

use super::super::{Analysis, Part, PartsRule};
use super::*;
use crate::geometry::mesh::RepairReport;
use crate::geometry::shapes::{bumpy_head, compose, cuboid, icosphere, inside_out, plane, torus};
use crate::geometry::source::{CornerAttribute, SourceModel};
use crate::geometry::test_data::{mesh_of, obj};
use crate::math::random::uniform;

/// A model with a share of its triangles turned over, chosen at random.
fn shuffled(mut model: SourceModel, share: f64, seed: u64) -> SourceModel {
    for (t, triangle) in model.triangles.iter_mut().enumerate() {
        if uniform(seed, t as u64, 0) < share {
            triangle.swap(1, 2);
        }
    }
    model
}

fn analysed(model: SourceModel) -> (Mesh, Vec<Part>, RepairReport) {
    let (mut mesh, mut report) = mesh_of(model);
    let roles = MaterialRoles::single(mesh.materials.len());
    let parts = Analysis::new(&mut mesh, &roles, PartsRule::Auto, &mut report).parts.parts;
    (mesh, parts, report)
}

/// Triangles as they are but for the corner that they begin with.
fn windings(mesh: &Mesh) -> Vec<[u32; 3]> {
    let turned = |t: &[u32; 3]| {
        let first = (0..3).min_by_key(|&i| t[i]).unwrap();
        [0, 1, 2].map(|i| t[(first + i) % 3])
    };
    mesh.triangles.iter().map(turned).collect()
}

#[test]
fn windings_of_closed_bodies_are_found_again_whatever_share_was_turned() {
    // A cavity is wound inwards and stays so; one part holds both surfaces.
    let hollow = || compose(&[(icosphere(2.0, 3), DVec3::ZERO), (inside_out(icosphere(1.0, 3)), DVec3::X * 0.3)]);
    let nested = || compose(&[(icosphere(2.0, 3), DVec3::ZERO), (icosphere(1.0, 3), DVec3::X * 0.3)]);
    let shapes = [("head", bumpy_head(10.0, 3)), ("torus", torus(5.0, 1.0, 24, 12)), ("cube", cuboid(DVec3::ONE, 1))];
    for (name, shape) in shapes.into_iter().chain([("cavity", hollow()), ("body in a body", nested())]) {
        let (right, sound, _) = analysed(shape.clone());
        assert!(sound.iter().all(|p| p.turned_triangles == 0), "{name}");
        let shares: &[f64] = if name.contains('y') { &[0.05, 0.3] } else { &[0.05, 0.3, 0.5, 0.8] };
        for &share in shares {
            let wrong = shuffled(shape.clone(), share, 7);
            let planted = wrong.triangles.iter().zip(&shape.triangles).filter(|(a, b)| a != b).count();
            let (mended, parts, _) = analysed(wrong);
            assert!(windings(&mended) == windings(&right), "{name}, {share} turned over");
            let [part] = &parts[..] else { panic!("{name}: {parts:?}") };
            assert_eq!((part.turned_triangles, part.inconsistent_edges), (planted, 0), "{name}, {share}");
            assert!(part.winding_doubts.is_empty());
            let volumes = [part, &sound[0]].map(|p| p.volume_mm3.unwrap());
            assert!((volumes[0] / volumes[1] - 1.0).abs() < 1e-12, "{name}: {volumes:?}");
            assert!(planted == 0 || part.turned().unwrap().contains("turned over"));
        }
    }
}

#[test]
fn an_open_surface_follows_its_majority_and_a_tie_is_left_and_told() {
    let sheet = || plane(4.0, 4.0, 8);
    let (right, _, _) = analysed(sheet());
    let (mended, parts, _) = analysed(shuffled(sheet(), 0.3, 3));
    assert!(windings(&mended) == windings(&right) && parts[0].turned_triangles > 0);
    let mut half = sheet();
    half.triangles.iter_mut().take(64).for_each(|t| t.swap(1, 2));
    let before = mesh_of(half.clone()).0;
    let (after, parts, _) = analysed(half);
    assert_eq!(before, after);
    assert_eq!((parts[0].turned_triangles, &parts[0].winding_doubts[..]), (0, &[WindingDoubt::Tie][..]));
    assert!(parts[0].inconsistent_edges > 0);
}

#[test]
fn a_moebius_strip_is_left_and_told() {
    let steps = 24;
    let point = |i: u32, side: f64| {
        let angle = std::f64::consts::TAU * f64::from(i) / f64::from(steps);
        let radius = 5.0 + side * (0.5 * angle).cos();
        DVec3::new(radius * angle.cos(), radius * angle.sin(), side * (0.5 * angle).sin())
    };
    let positions = (0..steps).flat_map(|i| [point(i, -1.0), point(i, 1.0)]).collect();
    let triangles = (0..steps).flat_map(|i| {
        let (a, b) = (2 * i, 2 * i + 1);
        // Half a turn later the sides have changed places.
        let (c, d) = if i + 1 == steps { (1, 0) } else { (a + 2, b + 2) };
        [[a, c, b], [b, c, d]]
    });
    let strip = SourceModel::new(positions, triangles.collect());
    let before = mesh_of(strip.clone()).0;
    let (after, parts, _) = analysed(strip);
    assert_eq!(before, after);
    assert_eq!(parts[0].winding_doubts, [WindingDoubt::OneSided]);
    assert!(parts[0].inconsistent_edges > 0);
}

#[test]
fn bodies_that_share_an_edge_or_a_corner_are_mended_each_and_fins_only_where_it_is_clear() {
    for second in [DVec3::ONE, DVec3::new(1.0, 1.0, 0.0)] {
        let boxes = compose(&[(cuboid(DVec3::ONE, 2), DVec3::ZERO), (cuboid(DVec3::ONE, 2), second)]);
        let (right, _, _) = analysed(boxes.clone());
        let (mended, parts, _) = analysed(shuffled(boxes, 0.4, 5));
        assert!(windings(&mended) == windings(&right), "{second}");
        assert!(parts[0].winding_doubts.is_empty());
    }
    // A cavity that touches the surface around it in one corner is of the same component, and stays a cavity.
    let mut inner = inside_out(cuboid(DVec3::ONE, 2));
    inner.positions.iter_mut().for_each(|p| *p += DVec3::splat(0.5));
    let outer = cuboid(DVec3::splat(2.0), 2);
    let touching = compose(&[(outer, DVec3::ZERO), (inner, DVec3::ZERO)]);
    let (right, sound, _) = analysed(touching.clone());
    assert_eq!(sound[0].components, 1);
    let (mended, parts, _) = analysed(shuffled(touching, 0.25, 9));
    assert!(windings(&mended) == windings(&right));
    assert!(parts[0].turned_triangles > 0 && parts[0].winding_doubts.is_empty());
}

#[test]
fn right_normals_stay_and_wrong_ones_turn_with_their_triangles() {
    let mut model = shuffled(icosphere(5.0, 2), 0.3, 1);
    let wrong = shuffled(icosphere(5.0, 2), 0.3, 1);
    model.normals = Some(CornerAttribute {
        values: model.positions.iter().map(|p| p.normalize().as_vec3()).collect(),
        corners: model.triangles.clone(),
    });
    let values = model.normals.as_ref().unwrap().values.clone();
    let (mesh, _, _) = analysed(model);
    assert_eq!(mesh.normals.as_ref().unwrap().values, values);
    assert_eq!(mesh.normals.unwrap().corners, mesh.triangles);
    // Flat normals of a winding that was wrong.
    let flat: Vec<_> = wrong
        .triangles
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(|v| wrong.positions[v as usize]);
            (b - a).cross(c - a).normalize().as_vec3()
        })
        .collect();
    let corners = (0..flat.len() as u32).map(|t| [t; 3]).collect();
    let mut model = wrong;
    model.normals = Some(CornerAttribute { values: flat, corners });
    let (mesh, _, _) = analysed(model);
    let normals = mesh.normals.as_ref().unwrap();
    for t in 0..mesh.triangles.len() {
        assert!(normals.values[normals.corners[t][0] as usize].as_dvec3().dot(mesh.cross_mm2(t as u32)) > 0.0);
    }
}

#[test]
fn real_meshes_are_found_again() {
    for file in ["bunny_3k", "suzanne", "cow_head", "skull_5k", "teapot"] {
        let Some(model) = obj(&format!("meshes/{file}.obj")) else { continue };
        let (right, sound, _) = analysed(model.clone());
        assert!(sound.iter().all(|p| p.turned_triangles == 0), "{file}: {sound:?}");
        let (mended, parts, _) = analysed(shuffled(model, 0.3, 11));
        // A duplicate that was turned is no duplicate any more: triangles are told apart by their corners.
        let expected: std::collections::HashSet<[u32; 3]> = windings(&right).into_iter().collect();
        let wrong = windings(&mended).iter().filter(|t| !expected.contains(*t)).count();
        println!("{file}: {wrong} of {} wrong; {parts:?}", right.triangles.len());
        let told = parts.iter().any(|p| p.inconsistent_edges > 0);
        assert!(wrong == 0 || told, "{file}: {wrong} of {} triangles", right.triangles.len());
        assert!(wrong * 100 <= right.triangles.len(), "{file}: {wrong} triangles");
    }
}
