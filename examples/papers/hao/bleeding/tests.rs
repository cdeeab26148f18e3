//! Lists against all pairs, sums against closed forms and against the samples.

use glam::DVec3;

use super::lists::{Cell, Lists, Neighbourhoods};
use super::*;
use translux::forms::baked_in;
use translux::geometry::mesh::{Mesh, Scale, resolve_scale};
use translux::geometry::part_table::PartTable;
use translux::geometry::shapes;
use translux::geometry::source::SourceModel;
use translux::light::Light;
use translux::math::statistics::vertex_error;
use translux::medium::material::preset;
use translux::progress::Silent;

fn medium(name: &str) -> Medium {
    Medium { name: name.to_owned(), properties: preset(name).unwrap().properties() }
}

/// Triangles below each bound of `ends` are a part of their own, of these media; the others are opaque.
fn scene(model: SourceModel, scale: Scale, parts: &[(usize, &str)]) -> Scene {
    let placement = resolve_scale(&model, Some(scale)).unwrap();
    let (mesh, _) = Mesh::from_source(model, &placement).unwrap();
    let part_of = |t: usize| parts.iter().position(|(end, _)| t < *end).unwrap_or(parts.len()) as u32;
    let triangle_part = (0..mesh.triangles.len()).map(part_of).collect();
    let mut entries: Vec<(String, Option<u32>)> = (0..parts.len()).map(|i| (i.to_string(), Some(i as u32))).collect();
    entries.push(("opaque".to_owned(), None));
    let parts_table = PartTable::new(&mesh, triangle_part, entries);
    Scene { mesh, parts: parts_table, media: parts.iter().map(|(_, name)| medium(name)).collect() }
}

fn one(model: SourceModel, diagonal_mm: f64, name: &str) -> Scene {
    scene(model, Scale::DiagonalMm(diagonal_mm), &[(usize::MAX, name)])
}

#[test]
fn lists_hold_the_vertices_of_the_part_in_range_and_no_others() {
    // Two media that share the vertices of a seam, a second body and an opaque one.
    let cuboid = shapes::cuboid(DVec3::new(2.0, 2.0, 2.0), 6);
    let (half, whole) = (cuboid.triangles.len() / 2, cuboid.triangles.len());
    let ball = shapes::icosphere(1.0, 2);
    let more = whole + ball.triangles.len();
    let model =
        shapes::compose(&[(cuboid, DVec3::ZERO), (ball, DVec3::X * 2.5), (shapes::icosphere(0.5, 1), DVec3::X * 5.0)]);
    let scene = scene(model, Scale::MillimetresPerUnit(1.0), &[(half, "marble"), (whole, "skin1"), (more, "marble")]);
    let vertices = Neighbourhoods::new(&scene);
    let ranges = [0.7, 0.4, 0.9];
    let part_of = |v: usize| vertices.points[v].1;
    let at = |v: usize| vertices.points[v].0.at;
    let lists = Lists::new(&vertices, &ranges, Cell::Pieces);
    let mut entries = 0;
    for (row, list) in lists.rows().enumerate() {
        let range = ranges[part_of(row) as usize];
        let near = |other: &usize| part_of(*other) == part_of(row) && at(*other).distance(at(row)) <= range;
        let expected: Vec<u32> = (0..vertices.len()).filter(near).map(|v| v as u32).collect();
        assert_eq!(list.iter().map(|e| e.vertex).collect::<Vec<_>>(), expected, "{row}");
        entries += list.len() as u64;
        for entry in list {
            let expected = vertices.factors(row, entry.vertex as usize, Cell::Pieces);
            for (found, expected) in entry.factors.into_iter().zip(expected) {
                assert!((f64::from(found) - expected).abs() <= 1e-5 * expected, "{row} {entry:?} {expected}");
            }
        }
    }
    assert_eq!(vertices.entries(&ranges), entries);
    assert!(entries > 5 * vertices.len() as u64);
    // Every bit of surface that light enters stands for its vertices.
    let total: f64 = vertices.areas_mm2.iter().sum();
    let parts: f64 = scene.parts.parts.iter().filter(|p| p.transfers()).map(|p| p.area_mm2).sum();
    assert!((total / parts - 1.0).abs() < 1e-12, "{total} {parts}");
    // Every source vertex of those parts has a value, the others have none.
    let receives = scene.vertex_areas_mm2();
    for (v, index) in vertices.of_vertex.iter().enumerate() {
        assert_eq!(*index != translux::transport::receivers::NONE, receives[v] > 0.0);
    }
}

#[test]
fn the_estimate_of_the_memory_is_near() {
    let scene = one(shapes::bumpy_head(1.0, 5), 30.0, "skin1");
    let vertices = Neighbourhoods::new(&scene);
    for share in [0.5, 0.1] {
        let ranges = ranges_mm(&scene, share);
        let (entries, estimated) = (vertices.entries(&ranges), vertices.estimated_entries(&ranges));
        println!("{share}: {ranges:?} mm, {entries} entries, {estimated} estimated");
        assert!((estimated as f64 / entries as f64 - 1.0).abs() < 0.15, "{entries} {estimated}");
    }
}

#[test]
fn a_row_of_a_plane_is_the_disc_of_its_range() {
    let plane = shapes::plane(24.0, 24.0, 80);
    for name in ["marble", "ketchup"] {
        let scene = scene(plane.clone(), Scale::MillimetresPerUnit(1.0), &[(usize::MAX, name)]);
        let vertices = Neighbourhoods::new(&scene);
        let centre = (0..vertices.len()).min_by(|a, b| {
            let distance = |v: &usize| vertices.points[*v].0.at.length();
            distance(a).total_cmp(&distance(b))
        });
        for range in [3.0, 8.0] {
            let lists = Lists::new(&vertices, &[range], Cell::Pieces);
            let row = lists.rows().nth(centre.unwrap()).unwrap();
            for (c, dipole) in scene.media[0].properties.dipoles(BoundaryFit::Published).iter().enumerate() {
                let sum: f64 = row.iter().map(|e| f64::from(e.factors[c])).sum();
                let expected = dipole.disc(range);
                println!("{name} {range} mm, channel {c}: {:.2} %", 100.0 * (sum / expected - 1.0));
                assert!((sum - expected).abs() < 0.03 * dipole.total(), "{name} {range} {c}: {sum} {expected}");
            }
        }
    }
}

/// Relative RMS error of some cells, and of lists without the vertex itself, under a light, against the samples.
fn errors(scene: &Scene, light: Light) -> [f64; 3] {
    let vertices = Neighbourhoods::new(scene);
    let ranges = ranges_mm(scene, 1e-3);
    let bvh = translux::geometry::bvh::Bvh::new(&scene.mesh);
    let irradiance = evaluate::first_pass(scene, &bvh, &vertices, std::slice::from_ref(&light), &Silent).unwrap();
    let mut truth = baked_in::truth(scene, 30_000);
    truth.set_lights(vec![light], &Silent).unwrap();
    let expected = truth.radiosity(&Silent).unwrap();
    let error = |lists: &Lists| {
        let values = lists.radiosity(&irradiance);
        let values: Vec<DVec3> = vertices.of_vertex.iter().map(|&i| values[i as usize]).collect();
        vertex_error(&values, &expected, &scene.vertex_areas_mm2()).rms
    };
    let pieces = Lists::new(&vertices, &ranges, Cell::Pieces);
    let point = Lists::new(&vertices, &ranges, Cell::Point);
    let mut without = Lists::new(&vertices, &ranges, Cell::Pieces);
    without.clear_own();
    [error(&pieces), error(&point), error(&without)]
}

/// The paper's pseudo code skips the vertex itself, and takes R_d at the vertex for its mean over the area.
#[test]
fn a_vertex_lights_itself_and_near_ones_are_more_than_points() {
    for (subdivisions, name, least_lost) in [(3, "marble", 0.2), (4, "marble", 0.1), (4, "skin1", 0.08)] {
        let scene = one(shapes::bumpy_head(1.0, subdivisions), 20.0, name);
        let [pieces, point, without] = errors(&scene, Light::constant(DVec3::ONE).unwrap());
        let count = scene.mesh.local_mm.len();
        println!("{name}, {count} vertices: pieces {pieces:.4}, points {point:.4}, without itself {without:.4}");
        assert!(without > least_lost && without > 4.0 * pieces, "{name} {count}: {without} {pieces}");
        assert!(pieces < 0.08 && pieces <= point + 2e-3, "{name} {count}: {pieces} {point}");
    }
}

#[test]
fn ranges_follow_the_share_and_never_leave_the_scene() {
    let scene = one(shapes::icosphere(1.0, 2), 1000.0, "marble");
    let dipoles = scene.media[0].properties.dipoles(BoundaryFit::Published);
    for share in [0.3, 0.01, 1e-3] {
        let range = ranges_mm(&scene, share)[0];
        let beyond = dipoles.iter().map(|d| d.tail(range) / d.tail(0.0)).fold(0.0, f64::max);
        assert!((beyond / share - 1.0).abs() < 1e-9, "{beyond}");
    }
    assert!(ranges_mm(&scene, f64::MIN_POSITIVE)[0] <= 2.0 * scene.mesh.diagonal_mm());
    assert_eq!(ranges_mm(&scene, 1.0)[0], 0.0);
    let alone = Neighbourhoods::new(&scene);
    assert_eq!(alone.entries(&[0.0]), alone.len() as u64);
}
