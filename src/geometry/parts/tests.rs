#![allow(clippy::unwrap_used)]

use glam::{DVec3, Vec3};

use super::*;
use crate::geometry::shapes::{bumpy_head, compose, cuboid, icosphere, inside_out, plane, torus};
use crate::geometry::source::{CornerAttribute, SourceModel};
use crate::geometry::test_data::mesh_of;

fn named(name: &str, source: SourceModel) -> SourceModel {
    source.of_material(name)
}

fn parts_of(source: SourceModel, rule: PartsRule) -> (Parts, RepairReport) {
    let (mut mesh, mut report) = mesh_of(source);
    let roles = MaterialRoles::single(mesh.materials.len());
    (Analysis::new(&mut mesh, &roles, rule, &mut report).parts, report)
}

fn two_spheres(distance: f64) -> SourceModel {
    compose(&[(icosphere(1.0, 3), DVec3::ZERO), (icosphere(1.0, 3), DVec3::X * distance)])
}

#[test]
fn rules_join_what_they_say() {
    for (distance, joined) in [(3.0, false), (2.01, false), (1.99, true), (1.5, true), (0.1, true)] {
        let (auto, _) = parts_of(two_spheres(distance), PartsRule::Auto);
        assert_eq!(auto.parts.len(), if joined { 1 } else { 2 }, "{distance}");
        assert_eq!(parts_of(two_spheres(distance), PartsRule::Separate).0.parts.len(), 2);
        let (whole, _) = parts_of(two_spheres(distance), PartsRule::Joined);
        assert_eq!((whole.parts.len(), whole.parts[0].components), (1, 2));
    }
    assert_eq!(
        parts_of(two_spheres(0.5), PartsRule::Auto).0.description(),
        "2 components -> 1 part (auto: touching or nested)"
    );
    assert_eq!(
        parts_of(two_spheres(3.0), PartsRule::Auto).0.description(),
        "2 components -> 2 parts (auto: none touch)"
    );
    assert_eq!(parts_of(icosphere(1.0, 1), PartsRule::Auto).0.description(), "1 component -> 1 part (auto)");
}

#[test]
fn boxes_face_to_face_are_one_part_and_boxes_with_a_gap_are_not() {
    for (gap, parts) in [(0.0, 1), (1e-6, 1), (1e-2, 2)] {
        let boxes = compose(&[
            (cuboid(DVec3::ONE, 2), DVec3::ZERO),
            (cuboid(DVec3::splat(0.7), 3), DVec3::new(0.85 + gap, 0.03, 0.02)),
        ]);
        assert_eq!(parts_of(boxes, PartsRule::Auto).0.parts.len(), parts, "{gap}");
    }
}

#[test]
fn nesting_joins_whatever_the_orientation_and_only_in_closed_surfaces() {
    let shell = |inner: SourceModel| compose(&[(icosphere(2.0, 3), DVec3::ZERO), (inner, DVec3::new(0.1, 0.2, 0.3))]);
    let (solid, report) = parts_of(shell(icosphere(1.0, 2)), PartsRule::Auto);
    assert_eq!((solid.parts.len(), report.flipped_components), (1, 0));
    let (hollow, report) = parts_of(shell(inside_out(icosphere(1.0, 2))), PartsRule::Auto);
    assert_eq!((hollow.parts.len(), report.flipped_components), (1, 0), "a cavity stays as it is");
    assert!(hollow.parts[0].volume_mm3.unwrap() < 0.9 * solid.parts[0].volume_mm3.unwrap());
    // A ball in the hole of a torus is inside its box, not inside it.
    let ring = compose(&[(torus(5.0, 1.0, 48, 24), DVec3::ZERO), (icosphere(1.0, 2), DVec3::ZERO)]);
    assert_eq!(parts_of(ring, PartsRule::Auto).0.parts.len(), 2);
    let mut open = icosphere(2.0, 3);
    open.triangles.truncate(1200);
    open.triangle_material.truncate(1200);
    let cup = compose(&[(open, DVec3::ZERO), (icosphere(1.0, 2), DVec3::ZERO)]);
    assert_eq!(parts_of(cup, PartsRule::Auto).0.parts.len(), 2);
}

#[test]
fn media_and_opaque_triangles_never_share_a_part() {
    let source = compose(&[
        (named("skin", icosphere(1.0, 2)), DVec3::ZERO),
        (named("wax", icosphere(1.0, 2)), DVec3::X * 0.5),
        (named("iron", icosphere(1.0, 2)), DVec3::X),
        (named("iron", icosphere(1.0, 2)), DVec3::X * 9.0),
        (named("skin", icosphere(1.0, 2)), DVec3::X * 20.0),
        (named("milk", icosphere(1.0, 2)), DVec3::X * 21.1),
    ]);
    let (mut mesh, mut report) = mesh_of(source);
    let media = [("wax".to_string(), 1)];
    let roles = MaterialRoles::resolve(&mesh.materials, &media, 0, &["iron".to_string()]).unwrap();
    let parts = Analysis::new(&mut mesh, &roles, PartsRule::Auto, &mut report).parts;
    let summary: Vec<(&str, Role, usize)> =
        parts.parts.iter().map(|p| (p.name.as_str(), p.role, p.components)).collect();
    assert_eq!(
        summary,
        [
            ("skin", Role::Medium(0), 1),
            ("wax", Role::Medium(1), 1),
            ("iron", Role::Opaque, 2),
            ("skin 2", Role::Medium(0), 2)
        ]
    );
    assert!(parts.triangle_part.windows(2).all(|w| w[0] <= w[1] || w[1] == 3));
    assert!(parts.description().contains("one of them opaque"));
}

#[test]
fn a_shared_vertex_does_not_connect_two_media() {
    let source = compose(&[
        (named("a", plane(1.0, 1.0, 1)), DVec3::ZERO),
        (named("b", plane(1.0, 1.0, 1)), DVec3::X),
        (named("a", plane(1.0, 1.0, 1)), DVec3::new(-1.0, 0.0, -1.0)),
    ]);
    let (mut mesh, mut report) = mesh_of(source);
    let roles = MaterialRoles::resolve(&mesh.materials, &[("b".to_string(), 1)], 0, &[]).unwrap();
    let parts = Analysis::new(&mut mesh, &roles, PartsRule::Separate, &mut report).parts;
    assert_eq!(parts.triangle_part, [0, 0, 1, 1, 0, 0]);
    assert!(parts.parts.iter().all(|p| p.closure == Closure::Open && p.volume_mm3.is_none()));
}

#[test]
fn unknown_and_contradicting_names_are_errors_that_list_the_materials() {
    let materials = ["skin".to_string(), "iron".to_string()];
    let unknown = MaterialRoles::resolve(&materials, &[], 0, &["steel".to_string()]).unwrap_err();
    assert!(unknown.message().contains("'steel'") && unknown.message().contains("'skin', 'iron'"), "{unknown}");
    let both = MaterialRoles::resolve(&materials, &[("iron".to_string(), 1)], 0, &["iron".to_string()]);
    assert!(both.unwrap_err().message().contains("'iron'"));
}

#[test]
fn an_inverted_component_is_turned_round_with_its_attributes() {
    let mut source = inside_out(bumpy_head(5.0, 3));
    // Normals computed from the wrong winding point inwards.
    source.normals = Some(CornerAttribute {
        values: source.positions.iter().map(|p| -p.normalize().as_vec3()).collect(),
        corners: source.triangles.clone(),
    });
    source.uvs = Some(CornerAttribute {
        values: source.positions.iter().map(|p| p.as_vec3().truncate()).collect(),
        corners: source.triangles.clone(),
    });
    let (mut mesh, mut report) = mesh_of(source);
    let roles = MaterialRoles::single(1);
    let parts = Analysis::new(&mut mesh, &roles, PartsRule::Auto, &mut report).parts;
    assert_eq!((report.flipped_components, report.flipped_triangles), (1, 1280));
    assert!(parts.parts[0].volume_mm3.unwrap() > 0.0);
    let (normals, uvs) = (mesh.normals.as_ref().unwrap(), mesh.uvs.as_ref().unwrap());
    for t in 0..mesh.triangles.len() {
        assert_eq!(uvs.corners[t], mesh.triangles[t]);
        let mean: Vec3 = normals.corners[t].iter().map(|&n| normals.values[n as usize]).sum();
        assert!(mean.as_dvec3().dot(mesh.cross_mm2(t as u32)) > 0.0);
    }
    let before = mesh.clone();
    let again = Analysis::new(&mut mesh, &roles, PartsRule::Auto, &mut report).parts;
    assert_eq!((&before, &parts), (&mesh, &again), "a second pass changes nothing");
}

#[test]
fn normals_that_were_right_stay_when_the_winding_turns() {
    let mut source = inside_out(icosphere(5.0, 2));
    source.normals = Some(CornerAttribute {
        values: source.positions.iter().map(|p| p.normalize().as_vec3()).collect(),
        corners: source.triangles.clone(),
    });
    let values = source.normals.as_ref().unwrap().values.clone();
    let (mut mesh, mut report) = mesh_of(source);
    Analysis::new(&mut mesh, &MaterialRoles::single(1), PartsRule::Auto, &mut report);
    assert_eq!(report.flipped_components, 1);
    assert_eq!(mesh.normals.unwrap().values, values);
}

#[test]
fn an_inverted_neighbour_is_turned_and_an_inverted_shell_of_another_medium_too() {
    let source = compose(&[
        (icosphere(1.0, 2), DVec3::ZERO),
        (inside_out(icosphere(1.0, 2)), DVec3::X * 5.0),
        (named("glass", inside_out(icosphere(0.5, 2))), DVec3::ZERO),
    ]);
    let (mut mesh, mut report) = mesh_of(source);
    let roles = MaterialRoles::resolve(&mesh.materials, &[("glass".to_string(), 1)], 0, &[]).unwrap();
    Analysis::new(&mut mesh, &roles, PartsRule::Auto, &mut report);
    assert_eq!(report.flipped_components, 2);
}

#[test]
fn ten_thousand_components_group_quickly_and_correctly() {
    // Rows of balls that touch within a row, and a shell around everything.
    let (rows, balls) = (100, 100);
    let ball = icosphere(0.5, 1);
    let mut list: Vec<_> = (0..rows * balls)
        .map(|i| (ball.clone(), DVec3::new(0.99 * f64::from(i % balls), 0.0, 3.0 * f64::from(i / balls))))
        .collect();
    let (separate, _) = parts_of(compose(&list), PartsRule::Separate);
    assert_eq!(separate.parts.len(), 10_000);
    let start = std::time::Instant::now();
    let (auto, _) = parts_of(compose(&list), PartsRule::Auto);
    println!("10000 components: {:?}", start.elapsed());
    assert_eq!(auto.parts.len(), 100);
    assert!(auto.parts.iter().all(|p| p.components == 100));
    list.push((icosphere(400.0, 3), DVec3::ZERO));
    assert_eq!(parts_of(compose(&list), PartsRule::Auto).0.parts.len(), 1);
}
