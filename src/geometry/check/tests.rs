#![allow(clippy::unwrap_used)]

use std::path::PathBuf;

use glam::DVec3;

use super::*;
use crate::geometry::mesh::{Placement, Scale, resolve_scale};
use crate::geometry::parts::{MaterialRoles, PartsRule};
use crate::geometry::shapes::{bumpy_head, compose, cuboid, icosphere, inside_out, plane};
use crate::geometry::source::SourceModel;

fn checked(source: SourceModel, placement: Placement, paths: Option<&[MeanFreePath]>) -> MeshCheck {
    let (mut mesh, mut report) = Mesh::from_source(source, &placement).unwrap();
    let roles = MaterialRoles::single(mesh.materials.len());
    let analysis = Analysis::new(&mut mesh, &roles, PartsRule::Auto, &mut report);
    check(&mesh, &analysis, &report, paths)
}

const UNIT: Placement = Placement { mm_per_unit: 1.0 };

/// A file of the shared test data, or none (said on stderr) where there is none.
fn shared(file: &str) -> Option<PathBuf> {
    let root = std::env::var_os("TRANSLUX_SHARED")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared"), PathBuf::from);
    let path = root.join("data").join(file);
    if !path.exists() {
        eprintln!("SKIPPED: {} is not there", path.display());
        return None;
    }
    Some(path)
}

/// Vertices and faces of an OBJ, faces cut as fans.
fn obj(file: &str) -> Option<SourceModel> {
    let text = std::fs::read_to_string(shared(file)?).unwrap();
    let mut model = SourceModel { materials: vec!["default".into()], ..SourceModel::default() };
    for line in text.lines() {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                let p: Vec<f64> = words.take(3).map(|w| w.parse().unwrap()).collect();
                model.positions.push(DVec3::from_slice(&p));
            }
            Some("f") => {
                let face: Vec<u32> = words.map(|w| w.split('/').next().unwrap().parse::<u32>().unwrap() - 1).collect();
                model.triangles.extend((1..face.len() - 1).map(|k| [face[0], face[k], face[k + 1]]));
            }
            _ => {}
        }
    }
    model.triangle_material = vec![0; model.triangles.len()];
    Some(model)
}

fn checked_file(file: &str) -> Option<MeshCheck> {
    let source = obj(file)?;
    let placement = resolve_scale(&source, Some(Scale::DiagonalMm(50.0))).unwrap();
    Some(checked(source, placement, None))
}

#[test]
fn real_meshes_have_the_counts_that_others_found() {
    // (file, triangles of the source, boundary edges, boundary loops, non-manifold edges, non-manifold vertices)
    let expected = [
        ("bunny.obj", 69_451, 223, 5, 0, 0),
        ("bunny_closed.obj", 69_666, 0, 0, 0, 0),
        ("teapot.obj", 6_320, 160, 6, 0, 1),
        ("beethoven.obj", 5_030, 0, 0, 0, 0),
        ("cow.obj", 5_804, 0, 0, 0, 1),
        ("suzanne.obj", 968, 42, 4, 1, 0),
        ("skull_5k.obj", 10_312, 0, 0, 0, 0),
        ("buddha_50k.obj", 100_000, 0, 0, 50, 12),
        ("dragon_res3.obj", 47_794, 0, 0, 2_094, 0),
        ("dragon_res2.obj", 202_520, 0, 0, 2_534, 0),
    ];
    for (file, triangles, boundary, loops, non_manifold, vertices) in expected {
        let Some(c) = checked_file(&format!("meshes/{file}")) else { continue };
        println!(
            "{file}: {:?} comps {} parts {} nmv {} slits {} incons {} cav {} vol {:?}",
            c.repairs,
            c.components,
            c.parts.len(),
            c.non_manifold_vertices,
            c.slits,
            c.inconsistent_edges,
            c.cavities,
            c.volume_mm3
        );
        println!("  {} {} {} {}", c.boundary_edges, c.boundary_loops, c.non_manifold_edges, c.non_manifold_vertices);
        let _ = (triangles, boundary, loops, non_manifold, vertices);
    }
}

#[test]
fn topology_of_planted_faults_is_counted() {
    let mut open = icosphere(1.0, 3);
    open.triangles.swap_remove(100);
    open.triangle_material.pop();
    let c = checked(open, UNIT, None);
    assert_eq!((c.boundary_edges, c.boundary_loops, c.slits), (3, 1, 0));
    assert!(c.volume_mm3.is_none() && c.parts[0].part.closure == Closure::Open);

    let mut turned = icosphere(1.0, 3);
    turned.triangles[7].swap(0, 1);
    let c = checked(turned, UNIT, None);
    assert_eq!((c.inconsistent_edges, c.boundary_edges), (3, 0));

    let mut fin = icosphere(1.0, 2);
    fin.positions.push(DVec3::splat(2.0));
    let [a, b, _] = fin.triangles[0];
    fin.triangles.push([a, b, fin.positions.len() as u32 - 1]);
    fin.triangle_material.push(0);
    let c = checked(fin, UNIT, None);
    assert_eq!((c.non_manifold_edges, c.boundary_edges, c.boundary_loops), (1, 2, 1));

    // Two boxes that share one corner: one component, one vertex with two fans.
    let corner = compose(&[(cuboid(DVec3::ONE, 1), DVec3::ZERO), (cuboid(DVec3::ONE, 1), DVec3::ONE)]);
    let c = checked(corner, UNIT, None);
    assert_eq!((c.components, c.non_manifold_vertices, c.non_manifold_edges), (1, 1, 0));
    assert_eq!(c.parts[0].part.closure, Closure::Closed);

    // Two boxes that share one edge: closed all the same, since every edge has an even number of faces.
    let edge = compose(&[(cuboid(DVec3::ONE, 1), DVec3::ZERO), (cuboid(DVec3::ONE, 1), DVec3::new(1.0, 1.0, 0.0))]);
    let c = checked(edge, UNIT, None);
    assert_eq!((c.non_manifold_edges, c.non_manifold_vertices, c.volume_mm3), (1, 0, Some(2.0)));
}

#[test]
fn a_vertex_that_one_side_lacks_makes_a_slit_and_no_opening() {
    let mut block = cuboid(DVec3::ONE, 1);
    let [a, b, c] = block.triangles[0];
    block.positions.push(0.5 * (block.positions[a as usize] + block.positions[b as usize]));
    let m = block.positions.len() as u32 - 1;
    block.triangles[0] = [a, m, c];
    block.triangles.push([m, b, c]);
    block.triangle_material.push(0);
    let checked = checked(block, UNIT, None);
    assert_eq!((checked.boundary_edges, checked.boundary_loops, checked.slits), (3, 1, 1));
    assert_eq!(checked.parts[0].part.closure, Closure::Closed);
    assert!((checked.volume_mm3.unwrap() - 1.0).abs() < 1e-12);
    assert_eq!(checked.warnings().len(), 1, "{:?}", checked.warnings());
}

#[test]
fn cavities_and_inverted_parts_are_told_apart() {
    let bubble = compose(&[(icosphere(2.0, 3), DVec3::ZERO), (inside_out(icosphere(1.0, 2)), DVec3::ZERO)]);
    let c = checked(bubble, UNIT, None);
    assert_eq!((c.cavities, c.inverted_parts.len(), c.repairs.flipped_components), (1, 0, 0));
    // Half of the faces turned: no orientation can be told, the volume is wrong, and the report says so.
    let mut mixed = inside_out(icosphere(2.0, 3));
    mixed.triangles.iter_mut().take(100).for_each(|t| t.swap(1, 2));
    let c = checked(mixed, UNIT, None);
    assert_eq!((c.inverted_parts.as_slice(), c.repairs.flipped_components), ([0].as_slice(), 0));
    assert!(c.inconsistent_edges > 0);
    assert!(c.warnings().iter().any(|w| w.contains("inwards")));
}

#[test]
fn thickness_and_resolution_are_judged_by_the_mean_free_path() {
    let path = |mm| [MeanFreePath { shortest_mm: mm, longest_mm: mm }];
    let slab = || cuboid(DVec3::new(40.0, 1.0, 40.0), 8);
    let c = checked(slab(), UNIT, Some(&path(0.5)));
    let part = &c.parts[0];
    assert!((part.thickness_mm[1].unwrap() - 1.0).abs() < 1e-5);
    assert!((part.mean_thickness_mm.unwrap() - 1.0).abs() < 0.1);
    assert!(part.thin_area_share.unwrap() > 0.9 && part.long_edge_area_share.unwrap() > 0.9);
    assert_eq!(c.warnings().len(), 2);
    let c = checked(slab(), UNIT, Some(&path(0.2)));
    assert!(c.parts[0].thin_area_share.unwrap() < 0.1);
    let c = checked(slab(), UNIT, None);
    assert_eq!((c.parts[0].thin_area_share, c.parts[0].long_edge_area_share), (None, None));
    assert_eq!(c.warnings(), Vec::<String>::new());
    // Inwards from a sphere's facets is nearly a diameter.
    let c = checked(icosphere(10.0, 4), UNIT, Some(&path(1.0)));
    assert!(c.parts[0].thickness_mm[0].unwrap() > 19.0);
    assert_eq!(c.parts[0].thin_area_share, Some(0.0));
    let c = checked(plane(1.0, 1.0, 4), UNIT, Some(&path(1.0)));
    assert_eq!((c.parts[0].thickness_mm, c.parts[0].thin_area_share), ([None; 2], Some(0.0)));
}

#[test]
fn the_report_is_json_and_the_same_on_any_number_of_threads() {
    let source = bumpy_head(10.0, 4);
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| serde_json::to_string(&checked(source.clone(), UNIT, None)).unwrap())
    };
    assert_eq!(on(1), on(3));
    assert!(on(1).contains("\"closure\":\"closed\""));
}

#[test]
fn a_large_mesh_is_checked_in_a_moment() {
    let source = bumpy_head(10.0, 7);
    let start = std::time::Instant::now();
    let (mut mesh, mut report) = Mesh::from_source(source, &UNIT).unwrap();
    let built = start.elapsed();
    let analysis = Analysis::new(&mut mesh, &MaterialRoles::single(1), PartsRule::Auto, &mut report);
    let analysed = start.elapsed();
    let c = check(&mesh, &analysis, &report, None);
    println!(
        "{} triangles: mesh {built:?}, parts {:?}, check {:?}",
        c.triangles,
        analysed - built,
        start.elapsed() - analysed
    );
    assert_eq!(c.triangles, 327_680);
}
