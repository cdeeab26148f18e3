use super::*;
use crate::geometry::shapes;
use crate::geometry::source::SourceModel;
use crate::transport::test_scene::mesh_of;

fn model(positions: &[[f64; 3]], triangles: &[[u32; 3]]) -> SourceModel {
    SourceModel::new(positions.iter().map(|&p| DVec3::from(p)).collect(), triangles.to_vec())
}

/// Two triangles with a seam between them, an unused vertex, a third triangle that touches the first in one vertex.
fn seamed() -> Mesh {
    let positions = [
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [1.0, 0.0, 0.0],
        [1.0, 1.0, 0.0],
        [0.0, 1.0, 0.0],
        [9.0, 9.0, 9.0],
        [-1.0, 0.0, 0.0],
        [-1.0, -1.0, 0.0],
    ];
    mesh_of(model(&positions, &[[0, 1, 2], [3, 4, 5], [0, 7, 8]]))
}

fn table(mesh: &Mesh, parts: &[u32], media: &[Option<u32>]) -> PartTable {
    PartTable::new(mesh, parts.to_vec(), media.iter().map(|m| ("part".to_owned(), *m)).collect())
}

#[test]
fn copies_of_a_vertex_share_a_receiver_and_unused_vertices_have_none() {
    let mesh = seamed();
    let receivers = Receivers::new(&mesh, &table(&mesh, &[0, 0, 0], &[Some(0)]), 16);
    assert_eq!(receivers.len(), 6);
    assert_eq!(receivers.of_vertex[1], receivers.of_vertex[3]);
    assert_eq!(receivers.of_vertex[2], receivers.of_vertex[5]);
    assert_eq!(receivers.of_vertex[6], NONE);
    let values: Vec<DVec3> = (1..=6).map(|i| DVec3::splat(f64::from(i))).collect();
    let expanded = receivers.expand(&values);
    assert_eq!((expanded.len(), expanded[6], expanded[1]), (9, DVec3::ZERO, expanded[3]));
    for (vertex, &r) in receivers.of_vertex.iter().enumerate().filter(|(_, r)| **r != NONE) {
        assert_eq!(receivers.positions[r as usize], mesh.local_mm[vertex].as_dvec3());
    }
}

#[test]
fn opaque_parts_have_no_receivers_and_a_shared_vertex_belongs_to_the_first_part() {
    let mesh = seamed();
    let opaque = Receivers::new(&mesh, &table(&mesh, &[0, 0, 1], &[Some(0), None]), 16);
    assert_eq!((opaque.len(), opaque.of_vertex[7], opaque.of_vertex[8]), (4, NONE, NONE));
    assert_ne!(opaque.of_vertex[0], NONE);
    let shared = Receivers::new(&mesh, &table(&mesh, &[1, 1, 0], &[Some(0), Some(0)]), 16);
    assert_eq!(shared.len(), 6);
    let group = shared.groups.iter().find(|g| g.run.range().contains(&(shared.of_vertex[0] as usize))).unwrap();
    assert_eq!(group.part, 0);
    let behind_opaque = Receivers::new(&mesh, &table(&mesh, &[1, 1, 0], &[None, Some(0)]), 16);
    let group = |v: usize| {
        behind_opaque.groups.iter().find(|g| g.run.range().contains(&(behind_opaque.of_vertex[v] as usize))).unwrap()
    };
    assert_eq!(group(0).part, 1, "an opaque part takes no vertex from one that transfers");
    let nothing = Receivers::new(&mesh, &table(&mesh, &[0, 0, 0], &[None]), 16);
    assert!(nothing.is_empty() && nothing.expand(&[]).iter().all(|v| *v == DVec3::ZERO));
}

#[test]
fn groups_cover_every_receiver_once_within_their_capacity_and_part() {
    let two = shapes::compose(&[
        (shapes::icosphere(1.0, 3), DVec3::ZERO),
        (shapes::icosphere(2.0, 2), DVec3::new(9.0, 0.0, 0.0)),
    ]);
    let mesh = mesh_of(two);
    let first = 20 * 64;
    let part: Vec<u32> = (0..mesh.triangles.len()).map(|t| u32::from(t >= first)).collect();
    for capacity in [0, 1, 7, 16, 1000] {
        let receivers = Receivers::new(&mesh, &table(&mesh, &part, &[Some(0), Some(0)]), capacity);
        assert_eq!(receivers.len(), mesh.local_mm.len());
        let mut next = 0;
        for group in &receivers.groups {
            assert_eq!(group.run.first, next);
            assert!((1..=capacity.max(1)).contains(&group.run.range().len()));
            next = group.run.end;
            for p in &receivers.positions[group.run.range()] {
                assert_eq!(u32::from(p.x > receivers.positions[0].x + 4.0), group.part);
            }
        }
        assert_eq!(next as usize, receivers.len());
    }
}

#[test]
fn subsets_of_different_phases_are_disjoint() {
    let mesh = mesh_of(shapes::icosphere(1.0, 5));
    let part = vec![0; mesh.triangles.len()];
    let receivers = Receivers::new(&mesh, &table(&mesh, &part, &[Some(0)]), 16);
    let sets: Vec<Vec<u32>> = (0..3).map(|phase| receivers.subset(192, phase).1).collect();
    for (a, set) in sets.iter().enumerate() {
        assert!((150..=400).contains(&set.len()), "{}", set.len());
        for other in &sets[..a] {
            assert!(set.iter().all(|i| !other.contains(i)));
        }
    }
    let (subset, indices) = receivers.subset(192, 1);
    for (p, &i) in subset.positions.iter().zip(&indices) {
        assert_eq!(*p, receivers.positions[i as usize]);
    }
    assert_eq!(Receivers::default().subset(10, 0).0.len(), 0);
}

#[test]
fn few_receivers_are_shared_out_among_the_phases() {
    let of = |subdivisions, capacity| {
        let mesh = mesh_of(shapes::icosphere(1.0, subdivisions));
        let part = vec![0; mesh.triangles.len()];
        Receivers::new(&mesh, &table(&mesh, &part, &[Some(0)]), capacity)
    };
    let receivers = of(3, 64);
    let mut all: Vec<u32> = (0..3).flat_map(|phase| receivers.subset(384, phase).1).collect();
    all.sort_unstable();
    assert!(all.iter().copied().eq(0..receivers.len() as u32));
    assert_eq!(of(0, 16).subset(384, 1).1.len(), 12);
}

#[test]
fn receivers_of_some_vertices_gather_from_where_they_do_among_all() {
    let mesh = mesh_of(shapes::icosphere(1.0, 3));
    let parts = table(&mesh, &vec![0; mesh.triangles.len()], &[Some(0)]);
    let all = Receivers::new(&mesh, &parts, 16);
    let vertices: Vec<u32> = (0..mesh.local_mm.len() as u32).rev().step_by(37).chain([5, 5, u32::MAX]).collect();
    let some = all.of_vertices(&vertices);
    assert!(some.groups.len() < all.groups.len() && some.of_vertex.len() == vertices.len());
    assert!(some.len() < vertices.len());
    let place = |receivers: &Receivers, receiver: u32| {
        let group = receivers.groups.iter().find(|group| group.run.range().contains(&(receiver as usize))).unwrap();
        let index = receiver as usize;
        (receivers.sphere(*group), group.part, receivers.positions[index], receivers.normals[index])
    };
    for (i, &vertex) in vertices.iter().enumerate() {
        match all.of_vertex.get(vertex as usize) {
            Some(&there) => assert_eq!(place(&some, some.of_vertex[i]), place(&all, there)),
            None => assert_eq!(some.of_vertex[i], NONE),
        }
    }
}
