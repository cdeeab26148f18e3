#![allow(clippy::unwrap_used)]

use glam::DVec3;

use super::*;
use crate::geometry::mesh::{Placement, Scale, resolve_scale};
use crate::geometry::parts::{MaterialRoles, PartsRule};
use crate::geometry::shapes::{bumpy_head, compose, cuboid, icosphere, inside_out, plane};
use crate::geometry::source::SourceModel;
use crate::geometry::test_data::{checked, obj};

const UNIT: Placement = Placement { mm_per_unit: 1.0 };

/// Edges with one triangle and with more than two, counted the slow way on the faces as the file has them.
fn edges_of_the_file(source: &SourceModel) -> (usize, usize) {
    let mut place = std::collections::HashMap::new();
    let mut count = std::collections::HashMap::new();
    let mut id = |v: u32| {
        let key = source.positions[v as usize].to_array().map(|x| (x + 0.0).to_bits());
        *place.entry(key).or_insert(v)
    };
    for t in &source.triangles {
        let t = t.map(&mut id);
        for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
            *count.entry((a.min(b), a.max(b))).or_insert(0) += 1;
        }
    }
    (count.values().filter(|&&n| n == 1).count(), count.values().filter(|&&n| n > 2).count())
}

#[test]
fn real_meshes_have_the_counts_that_others_found() {
    // File; triangles, boundary and non-manifold edges of the file; boundary loops, vertices with several fans,
    // components and parts of the repaired mesh. Duplicates leave fewer non-manifold edges there.
    let expected = [
        ("bunny.obj", [69_451, 223, 0], [5, 0, 1, 1]),
        ("bunny_closed.obj", [69_666, 0, 0], [0, 0, 1, 1]),
        ("teapot.obj", [6_320, 160, 0], [6, 1, 3, 2]),
        ("beethoven.obj", [5_030, 0, 0], [0, 0, 3, 1]),
        ("cow.obj", [5_804, 0, 0], [0, 1, 1, 1]),
        ("suzanne.obj", [968, 42, 1], [4, 2, 1, 1]),
        ("skull_5k.obj", [10_312, 0, 0], [0, 0, 1, 1]),
        ("buddha_50k.obj", [100_000, 0, 50], [0, 12, 1, 1]),
        ("dragon_res2.obj", [202_520, 0, 2_534], [0, 16, 7, 7]),
    ];
    for (file, [triangles, boundary, non_manifold], [loops, fans, components, parts]) in expected {
        let Some(source) = obj(&format!("meshes/{file}")) else { continue };
        let placement = resolve_scale(&source, Some(Scale::DiagonalMm(50.0))).unwrap();
        assert_eq!(
            (source.triangles.len(), edges_of_the_file(&source)),
            (triangles, (boundary, non_manifold)),
            "{file}"
        );
        let c = checked(source, placement, None);
        assert_eq!((c.boundary_edges, c.boundary_loops), (boundary, loops), "{file}");
        assert_eq!((c.non_manifold_vertices, c.components, c.parts.len()), (fans, components, parts), "{file}");
        assert!(c.non_manifold_edges == non_manifold || c.repairs.duplicate_triangles > 0, "{file}");
        assert!(c.non_manifold_edges <= non_manifold, "{file}");
    }
}

#[test]
fn real_faults_are_counted() {
    type Claim = fn(&MeshCheck) -> bool;
    let unused = |c: &MeshCheck| (c.repairs.unreferenced_vertices, c.repairs.vertices_without_area) == (1_113, 1_113);
    let claims: [(&str, Claim); 6] = [
        ("meshes/bunny.obj", unused),
        ("meshes/teapot.obj", |c| c.repairs.welded_vertices == 403),
        ("bad/double_sided_teapot.obj", |c| c.repairs.reversed_twins > 3_000 && c.repairs.flipped_components == 0),
        ("bad/huge_coords_flt_max.obj", |c| c.area_mm2.is_finite() && (c.diagonal_mm - 50.0).abs() < 1e-3),
        ("bad/far_from_origin.obj", |c| c.area_mm2 > 0.0 && c.bounds_mm.iter().flatten().all(|x| x.is_finite())),
        ("bad/non_manifold_edge.obj", |c| c.non_manifold_edges == 1),
    ];
    for (file, holds) in claims {
        let Some(source) = obj(file) else { continue };
        let placement = resolve_scale(&source, Some(Scale::DiagonalMm(50.0))).unwrap();
        let found = checked(source, placement, None);
        assert!(holds(&found), "{file}: {found:?}");
    }
    if let Some(source) = obj("bad/degenerate_all.obj") {
        assert!(Mesh::from_source(source, &UNIT).is_err());
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
    assert_eq!((c.inconsistent_edges, c.boundary_edges, c.parts[0].part.turned_triangles), (0, 0, 1));
    assert!(c.warnings()[0].contains("1 of 1280 triangles"), "{:?}", c.warnings());

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
    // Most faces inwards and some outwards: the volume tells that those inwards are wrong.
    let mut mixed = inside_out(icosphere(2.0, 3));
    mixed.triangles.iter_mut().take(100).for_each(|t| t.swap(1, 2));
    let c = checked(mixed, UNIT, None);
    assert_eq!((c.inverted_parts.as_slice(), c.repairs.flipped_components), ([].as_slice(), 0));
    assert_eq!((c.inconsistent_edges, c.parts[0].part.turned_triangles), (0, 1180));
    assert_eq!(c.faults(), Vec::<String>::new());
    // Four sheets at one edge, three of them along it in one direction: nothing tells which is wrong.
    let apexes = [DVec3::X, DVec3::Y, DVec3::NEG_X, DVec3::NEG_Y];
    let positions = [DVec3::ZERO, DVec3::Z].into_iter().chain(apexes).collect();
    let book = SourceModel::new(positions, vec![[0, 1, 2], [0, 1, 3], [0, 1, 4], [1, 0, 5]]);
    let c = checked(book, UNIT, None);
    assert_eq!((c.inconsistent_edges, c.parts[0].part.turned_triangles), (1, 0));
    assert!(c.faults()[0].contains("1 edges") && c.faults()[0].contains("more than two triangles"), "{:?}", c.faults());
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
    assert_eq!(c.warnings().len(), 1);
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
fn random_soups_neither_panic_nor_give_anything_but_numbers() {
    use crate::math::random::{bits, uniform};
    for round in 0..300 {
        let random = |i: u64, d: u64| uniform(round, i, d);
        let scale = [1e-30, 1e-3, 1.0, 1e6, 1e30][(round % 5) as usize];
        let count = 3 + bits(round, 0, 9) % 40;
        // Coarse coordinates meet, overlap, align and collapse often.
        let position = |i: u64| DVec3::from([0, 1, 2].map(|d| (random(i, d) * 4.0).floor() * scale));
        let corner = |t: u64, d: u64| (bits(round, t, 20 + d) % count) as u32;
        let triangles: Vec<[u32; 3]> = (0..60).map(|t| [0, 1, 2].map(|d| corner(t, d))).collect();
        let source = SourceModel {
            positions: (0..count).map(position).collect(),
            triangle_material: (0..60).map(|t| t % 3).collect(),
            triangles,
            materials: ["a", "b", "c"].map(String::from).to_vec(),
            ..SourceModel::default()
        };
        let Ok(placement) = resolve_scale(&source, Some(Scale::DiagonalMm(30.0))) else { continue };
        let Ok((mut mesh, mut report)) = Mesh::from_source(source, &placement) else { continue };
        let roles = MaterialRoles::resolve(&mesh.materials, &[("b".into(), 1)], 0, &["c".into()]).unwrap();
        for rule in [PartsRule::Auto, PartsRule::Separate, PartsRule::Joined] {
            let analysis = Analysis::new(&mut mesh, &roles, rule, &mut report);
            let path = MeanFreePath { shortest_mm: 1.0, longest_mm: 2.0 };
            let c = check(&mesh, &analysis, &report, Some(&[path]));
            assert!(c.area_mm2 > 0.0 && c.diagonal_mm.is_finite());
            assert_eq!(c.parts.iter().map(|p| p.part.triangle_count).sum::<usize>(), mesh.triangles.len());
            assert!((mesh.total_area_mm2() / c.area_mm2 - 1.0).abs() < 1e-12);
            let numbers = c.edge_mm.iter().chain(&c.quality).chain(c.bounds_mm.iter().flatten());
            assert!(numbers.chain(c.volume_mm3.iter()).all(|x| x.is_finite()));
            assert!(!analysis.parts.description().is_empty() && c.warnings().iter().all(|w| !w.contains("NaN")));
        }
    }
}
