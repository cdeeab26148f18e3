#![allow(clippy::unwrap_used)]

use glam::{DVec3, Vec2};

use super::texels::{Texel, Texels};
use super::*;
use crate::geometry::part_table::PartTable;
use crate::geometry::shapes;
use crate::geometry::source::{CornerAttribute, SourceModel};
use crate::geometry::test_data::{mesh_of, obj};

const MAPS: [Map; 4] = [Map::Auto, Map::Shape, Map::Conformal, Map::Area];

fn parts(mesh: &Mesh) -> PartTable {
    let names = mesh.materials.iter().map(|name| (name.clone(), (name != "opaque").then_some(0))).collect();
    PartTable::new(mesh, mesh.triangle_material.clone(), names)
}

/// Checks areas, order and ranges of the texels, and that centroids are the surface's.
fn check_texels(mesh: &Mesh, atlas: &Atlas, resolution: u32) -> Texels {
    let parts = parts(mesh);
    let cut = Texels::new(mesh, &parts, atlas, resolution).unwrap();
    let mut areas = vec![0.0; mesh.triangles.len()];
    let mut moments = vec![DVec3::ZERO; mesh.triangles.len()];
    for fragment in &cut.fragments {
        assert!(fragment.area_mm2 > 0.0 && fragment.centre_mm.is_finite());
        areas[fragment.triangle as usize] += fragment.area_mm2;
        moments[fragment.triangle as usize] += fragment.area_mm2 * fragment.centre_mm;
    }
    for (t, (area, moment)) in areas.iter().zip(moments).enumerate() {
        let transfers = parts.parts[parts.triangle_part[t] as usize].transfers();
        let expected = if transfers { mesh.area_mm2(t as u32) } else { 0.0 };
        assert!((area - expected).abs() <= 1e-12 * expected, "triangle {t}: {area} for {expected}");
        let [a, b, c] = mesh.corners_local_mm(t as u32);
        let distance = (moment - *area * (a + b + c) / 3.0).length();
        assert!(distance <= 1e-6 * area * mesh.diagonal_mm(), "triangle {t}: centroid");
    }
    let key = |t: &Texel| {
        (
            t.part,
            (0..16).map(|i| u64::from(t.x >> i & 1) << (2 * i) | u64::from(t.y >> i & 1) << (2 * i + 1)).sum::<u64>(),
        )
    };
    assert!(cut.texels.windows(2).all(|pair| key(&pair[0]) < key(&pair[1])));
    let mut at = 0;
    for texel in &cut.texels {
        assert!(
            texel.x < resolution && texel.y < resolution && texel.fragments.start == at && !texel.fragments.is_empty()
        );
        at = texel.fragments.end;
        let of = &cut.fragments[texel.fragments.start as usize..at as usize];
        assert!(of.windows(2).all(|pair| pair[0].triangle < pair[1].triangle));
        assert!(of.iter().all(|f| parts.triangle_part[f.triangle as usize] == texel.part));
    }
    assert_eq!(at as usize, cut.fragments.len());
    assert_eq!(cut.part_offsets.len(), parts.parts.len() + 1);
    for (i, ends) in cut.part_offsets.windows(2).enumerate() {
        assert!(cut.texels[ends[0] as usize..ends[1] as usize].iter().all(|t| t.part == i as u32));
    }
    cut
}

fn with_uvs(mut source: SourceModel, values: Vec<Vec2>, corners: Vec<[u32; 3]>) -> Mesh {
    source.uvs = Some(CornerAttribute { values, corners });
    mesh_of(source).0
}

/// A square of two triangles whose texture coordinates are scaled and moved.
fn square(scale: f32, offset: f32) -> Mesh {
    let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let positions = corners.iter().map(|[x, y]| DVec3::new(10.0 * x, 10.0 * y, 0.0)).collect();
    let triangles = vec![[0, 1, 2], [0, 2, 3]];
    let values = corners.iter().map(|c| Vec2::from(c.map(|v| scale * v as f32 + offset))).collect();
    with_uvs(SourceModel::new(positions, triangles.clone()), values, triangles)
}

#[test]
fn every_shape_has_a_bijective_map() {
    let ring = shapes::torus(10.0, 3.0, 32, 16);
    let shapes: [(&str, SourceModel); 7] = [
        ("sphere", shapes::icosphere(10.0, 3)),
        ("torus", ring.clone()),
        ("cube", shapes::cuboid(DVec3::splat(10.0), 1)),
        ("plane", shapes::plane(10.0, 5.0, 4)),
        ("knot", shapes::torus_knot(2, 3, 10.0, 3.0, 1.0, 60, 8)),
        (
            "parts",
            shapes::compose(&[
                (ring.of_material("opaque"), DVec3::X * 40.0),
                (shapes::bumpy_head(10.0, 3), DVec3::ZERO),
            ]),
        ),
        ("triangle", SourceModel::new(vec![DVec3::ZERO, DVec3::X, DVec3::Y], vec![[0, 1, 2]])),
    ];
    for (name, shape) in shapes {
        let (mesh, _) = mesh_of(shape);
        for map in MAPS {
            let (atlas, report) = Atlas::new(&mesh, map, 128).unwrap();
            assert_eq!(atlas.corners.len(), mesh.triangles.len());
            assert!(report.overlap < 1e-6 && report.flat == 0 && !report.own, "{name} {map:?}: {report:?}");
            assert!(report.occupancy > 0.15 && report.smallest > 0.05, "{name} {map:?}: {report:?}");
            assert!(report.stretch >= 1.0 - 1e-3 && report.stretch < 1.3, "{name} {map:?}: {report:?}");
            assert_eq!(Atlas::from_codes(&atlas.codes()), atlas);
            assert_eq!(atlas.report(&mesh, false), report);
            for resolution in [16, 128] {
                check_texels(&mesh, &atlas, resolution);
            }
        }
    }
}

#[test]
fn a_square_is_cut_exactly() {
    let mesh = square(1.0, 0.0);
    let (atlas, report) = Atlas::new(&mesh, Map::Own, 64).unwrap();
    assert!(report.own && report.charts == 1 && report.flat == 0);
    assert!((report.occupancy - 1.0).abs() < 1e-12 && report.overlap == 0.0 && (report.stretch - 1.0).abs() < 1e-12);
    assert!(report.area_range.iter().all(|ratio| (ratio - 1.0).abs() < 1e-12));
    for resolution in [16, 64, 512] {
        let cut = check_texels(&mesh, &atlas, resolution);
        let n = f64::from(resolution);
        assert_eq!(cut.texels.len() as u32, resolution * resolution);
        assert_eq!(cut.fragments.len() as u32, resolution * (resolution + 1));
        for texel in &cut.texels {
            let of = &cut.fragments[texel.fragments.start as usize..texel.fragments.end as usize];
            let area: f64 = of.iter().map(|f| f.area_mm2).sum();
            let centre = of.iter().map(|f| f.area_mm2 * f.centre_mm).sum::<DVec3>() / area;
            let expected = DVec3::new(f64::from(texel.x) + 0.5, f64::from(texel.y) + 0.5, 0.0) * (10.0 / n)
                - DVec3::new(5.0, 5.0, 0.0);
            assert!((area - 100.0 / (n * n)).abs() < 1e-12 * 100.0, "{area}");
            assert!(centre.distance(expected) < 1e-10, "{centre} for {expected}");
        }
    }
}

#[test]
fn own_coordinates_are_used_only_where_they_are_bijective() {
    for (scale, offset) in
        [(1.0, 0.0), (0.5, 0.25), (-1.0, 1.0), (1.0, 3.0), (0.9, -0.95), (1.05, -0.05), (0.9, 0.4), (40.0, -3.0)]
    {
        for map in [Map::Auto, Map::Own] {
            let mesh = square(scale, offset);
            let (atlas, report) = Atlas::new(&mesh, map, 64).unwrap();
            assert!(
                report.own && report.overlap < 1e-6 && (report.stretch - 1.0).abs() < 1e-3,
                "{scale} {offset}: {report:?}"
            );
            check_texels(&mesh, &atlas, 64);
        }
    }
    let refused = |mesh: &Mesh, why: &str| {
        let error = Atlas::new(mesh, Map::Own, 64).unwrap_err();
        assert!(error.message().contains(why), "{error}");
        let (atlas, report) = Atlas::new(mesh, Map::Auto, 64).unwrap();
        assert!(!report.own && report.overlap < 1e-6);
        check_texels(mesh, &atlas, 64);
    };
    refused(&square(0.0, 0.5), "100 % of the surface");
    refused(&square(1.0, f32::INFINITY), "finite");
    refused(&mesh_of(shapes::icosphere(10.0, 2)).0, "no texture coordinates");
    // Both halves in one place.
    let positions = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(|[x, y]| DVec3::new(x, y, 0.0)).to_vec();
    let twice = SourceModel::new(positions, vec![[0, 1, 2], [0, 2, 3]]);
    refused(&with_uvs(twice, vec![Vec2::ZERO, Vec2::X, Vec2::ONE], vec![[0, 1, 2]; 2]), "50 % of the mapped area");
}

#[test]
fn broken_surfaces_have_a_map() {
    // Three triangles on an edge, one that is alone, one that is thinner than coordinates tell, one that is turned over.
    let positions = [
        [0.0; 3],
        [1.0, 0.0, 0.0],
        [0.5, 1.0, 0.0],
        [0.5, -1.0, 0.0],
        [0.5, 0.0, 1.0],
        [9.0, 9.0, 9.0],
        [9.0, 8.0, 9.0],
        [8.0, 9.0, 9.0],
        [0.5, 1e-6, 0.0],
    ];
    let triangles = vec![[0, 1, 2], [1, 0, 3], [0, 1, 4], [5, 6, 7], [0, 1, 8], [2, 3, 4]];
    let (mesh, _) = mesh_of(SourceModel::new(positions.map(DVec3::from).to_vec(), triangles));
    for map in MAPS {
        let (atlas, report) = Atlas::new(&mesh, map, 16).unwrap();
        assert!(report.overlap < 1e-6 && report.flat <= 1, "{report:?}");
        check_texels(&mesh, &atlas, 16);
    }
}

#[test]
fn small_parts_that_are_far_apart_have_a_map() {
    let ball = shapes::icosphere(1.0, 3);
    let (mesh, _) = mesh_of(shapes::compose(&[(ball.clone(), DVec3::ZERO), (ball, DVec3::X * 1e5)]));
    for map in MAPS {
        let (atlas, report) = Atlas::new(&mesh, map, 256).unwrap();
        assert!(report.flat == 0 && report.overlap < 1e-6 && report.stretch < 1.1, "{report:?}");
        check_texels(&mesh, &atlas, 256);
    }
}

#[test]
fn any_corners_are_cut() {
    let (mesh, _) = mesh_of(shapes::icosphere(10.0, 2));
    let mut state = 1u32;
    let mut next = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        [-1e30, 0.0, 1e-7, 0.5, 0.999_99, 1.0, 2.0, f32::INFINITY, (state >> 8) as f32 / 16_777_216.0]
            [(state >> 28) as usize % 9]
    };
    let corners = mesh.triangles.iter().map(|_| [0; 3].map(|_| Vec2::new(next(), next()))).collect();
    let atlas = Atlas { corners };
    assert!(atlas.report(&mesh, true).overlap > 0.5);
    check_texels(&mesh, &atlas, 64);
    let none = Atlas::default();
    assert_eq!(none.report(&mesh, false).flat as usize, mesh.triangles.len());
    assert!(Texels::new(&mesh, &parts(&mesh), &none, 64).unwrap().texels.is_empty());
    for resolution in [0, 8, 100, 8192] {
        assert!(Texels::new(&mesh, &parts(&mesh), &none, resolution).is_err());
    }
}

#[test]
fn even_areas_are_the_least_spread() {
    let Some(source) = obj("meshes/cow_head.obj") else { return };
    let (mesh, _) = mesh_of(source);
    let spread = |map| {
        let (_, report) = Atlas::new(&mesh, map, 256).unwrap();
        report.area_range[1] / report.area_range[0]
    };
    let [shape, conformal, area] = [Map::Shape, Map::Conformal, Map::Area].map(spread);
    assert!(area <= shape && area < 0.5 * conformal, "{shape} {conformal} {area}");
}
