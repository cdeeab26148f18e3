#![allow(clippy::unwrap_used)]

use std::path::PathBuf;
use std::time::Instant;

use glam::{DVec3, Vec3};

use super::*;
use translux::geometry::mesh::{Mesh, Scale, resolve_scale};
use translux::geometry::nearest::closest_weights;
use translux::geometry::shapes;
use translux::geometry::source::SourceModel;
use translux::math::random::{bits, uniform};
use translux::progress::Silent;

/// A mesh with everything that an [`Input`] borrows.
struct Fixture {
    mesh: Mesh,
    triangles: Vec<[u32; 3]>,
    parts: Vec<u32>,
}

impl Fixture {
    /// A model of 50 mm, with its materials as parts.
    fn new(source: SourceModel) -> Self {
        let placement = resolve_scale(&source, Some(Scale::DiagonalMm(50.0))).unwrap();
        let (mesh, _) = Mesh::from_source(source, &placement).unwrap();
        let triangles = (0..mesh.triangles.len() as u32).map(|t| mesh.welded(t)).collect();
        let parts = mesh.triangle_material.clone();
        Self { mesh, triangles, parts }
    }

    fn input(&self) -> Input<'_> {
        Input { positions: &self.mesh.local_mm, triangles: &self.triangles, triangle_part: &self.parts }
    }

    fn simplified(&self, target: usize) -> Level {
        let mut hierarchy = Hierarchy::new(&self.input(), &Costs::default(), &[target], &Silent);
        check(&self.input(), &hierarchy);
        hierarchy.levels.remove(0)
    }

    fn used(&self) -> usize {
        used(&self.input()).iter().filter(|u| **u).count()
    }

    fn quality(&self, level: &Level) -> Quality {
        let place = |r: u32| self.mesh.local_mm[level.references[r as usize] as usize].as_dvec3();
        let diagonal_mm = self.mesh.diagonal_mm();
        let mut quality = Quality::default();
        let mut places = 0;
        for (v, anchor) in level.anchors.iter().enumerate().filter(|(_, a)| a.is_somewhere()) {
            let on_face: DVec3 = (0..3).map(|k| place(anchor.corners[k]) * anchor.weights[k]).sum();
            let distance = on_face.distance(self.mesh.local_mm[v].as_dvec3()) / diagonal_mm;
            quality.worst = quality.worst.max(distance);
            quality.rms += distance * distance;
            places += 1;
        }
        quality.rms = (quality.rms / f64::from(places.max(1))).sqrt();
        let mut normals = vec![DVec3::ZERO; self.mesh.local_mm.len()];
        for (t, corners) in self.triangles.iter().enumerate() {
            corners.iter().for_each(|&v| normals[v as usize] += self.mesh.cross_mm2(t as u32));
        }
        for face in level.faces.iter().filter(|f| f[1] != f[2]) {
            let [a, b, c] = face.map(place);
            let around: DVec3 =
                face.iter().map(|&r| normals[level.references[r as usize] as usize].normalize_or_zero()).sum();
            quality.against += usize::from((b - a).cross(c - a).dot(around) < 0.0);
        }
        quality
    }
}

/// Deviation relative to the diagonal; faces that look away from the normals of their corners in the full mesh.
#[derive(Debug, Default)]
struct Quality {
    worst: f64,
    rms: f64,
    against: usize,
}

fn used(input: &Input) -> Vec<bool> {
    let mut used = vec![false; input.positions.len()];
    for t in input.triangles {
        let real = t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
        if real && t.iter().all(|&v| input.positions.get(v as usize).is_some_and(|p| p.is_finite())) {
            t.iter().for_each(|&v| used[v as usize] = true);
        }
    }
    used
}

/// Everything that must hold for any input.
fn check(input: &Input, hierarchy: &Hierarchy) {
    let used = used(input);
    let mut alive = used.clone();
    for collapse in &hierarchy.collapses {
        assert!(alive[collapse.removed as usize] && alive[collapse.onto as usize] && collapse.removed != collapse.onto);
        alive[collapse.removed as usize] = false;
    }
    let mut vertices: Vec<u32> = (0..input.positions.len() as u32).collect();
    for level in &hierarchy.levels {
        assert!(level.references.is_sorted_by(|a, b| a < b));
        assert_eq!(level.anchors.len(), vertices.len());
        assert_eq!(level.faces.len(), level.face_part.len());
        for face in &level.faces {
            assert!(face.iter().all(|&r| (r as usize) < level.references.len()));
            assert!(face[0] != face[1] && face[0] != face[2]);
        }
        for r in 0..level.references.len() as u32 {
            assert!(level.star(r).iter().all(|&f| level.faces[f as usize].contains(&r)));
        }
        for (&v, anchor) in vertices.iter().zip(&level.anchors) {
            if !used[v as usize] {
                assert_eq!(*anchor, Anchor::NOWHERE);
                continue;
            }
            assert!(anchor.corners.iter().all(|&r| (r as usize) < level.references.len()), "{v} {anchor:?}");
            assert!(anchor.weights.iter().all(|w| (0.0..=1.0).contains(w)), "{v} {anchor:?}");
            assert!((anchor.weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            if let Ok(own) = level.references.binary_search(&v) {
                assert_eq!(*anchor, Anchor::at(own as u32));
            }
        }
        vertices.clone_from(&level.references);
    }
    if let Some(last) = hierarchy.levels.last() {
        assert_eq!(last.references.len(), alive.iter().filter(|a| **a).count());
        assert!(last.references.iter().all(|&v| alive[v as usize]));
    }
}

/// Vertices - edges + faces.
fn euler(level: &Level) -> i64 {
    let mut edges: Vec<_> = level
        .faces
        .iter()
        .flat_map(|f| [(f[0], f[1]), (f[1], f[2]), (f[2], f[0])])
        .map(|(a, b)| (a.min(b), a.max(b)))
        .collect();
    edges.sort_unstable();
    edges.dedup();
    level.references.len() as i64 - edges.len() as i64 + level.faces.len() as i64
}

#[test]
fn a_head_keeps_its_topology_and_loses_little() {
    let head = Fixture::new(shapes::bumpy_head(10.0, 5));
    let mut last = 0.0;
    for (target, worst) in [(2560, 5e-3), (640, 2e-2), (160, 6e-2), (40, 0.15)] {
        let level = head.simplified(target);
        let quality = head.quality(&level);
        assert_eq!(level.references.len(), target);
        assert_eq!((euler(&level), quality.against), (2, 0));
        assert!(quality.worst < worst && quality.rms > last, "{target}: {quality:?}");
        last = quality.rms;
    }
    let torus = Fixture::new(shapes::torus(10.0, 4.0, 64, 32)).simplified(60);
    assert_eq!(euler(&torus), 0);
}

#[test]
fn a_plane_keeps_its_outline() {
    let plane = Fixture::new(shapes::plane(10.0, 20.0, 40));
    let level = plane.simplified(80);
    let area: f64 = level
        .faces
        .iter()
        .map(|f| {
            let [a, b, c] = f.map(|r| plane.mesh.local_mm[level.references[r as usize] as usize].as_dvec3());
            0.5 * (b - a).cross(c - a).length()
        })
        .sum();
    assert!((area / plane.mesh.total_area_mm2() - 1.0).abs() < 1e-6);
    assert!(plane.quality(&level).worst < 1e-6);
    // Even spacing: no reference stands for much more than its share of the vertices.
    let mut share = vec![0.0; 80];
    for anchor in &level.anchors {
        anchor.corners.iter().zip(anchor.weights).for_each(|(&c, w)| share[c as usize] += w);
    }
    assert!(share.iter().all(|s| *s < 4.0 * 1681.0 / 80.0), "{share:?}");
}

#[test]
fn parts_stay_apart_even_where_they_share_vertices() {
    // The upper and lower half of a sphere are two parts that share a ring of vertices.
    let mut model = shapes::uv_sphere(10.0, 48, 24);
    model.materials = vec!["upper".into(), "lower".into()];
    model.triangle_material = model
        .triangles
        .iter()
        .map(|t| u32::from(t.iter().map(|&v| model.positions[v as usize].y).sum::<f64>() < 0.0))
        .collect();
    let halves = Fixture::new(model);
    let mut parts_of = vec![Vec::new(); halves.mesh.local_mm.len()];
    for (t, corners) in halves.triangles.iter().enumerate() {
        corners.iter().for_each(|&v| parts_of[v as usize].push(halves.parts[t]));
    }
    for target in [300, 60, 10] {
        let level = halves.simplified(target);
        for (v, anchor) in level.anchors.iter().enumerate() {
            for (&c, w) in anchor.corners.iter().zip(anchor.weights) {
                let there = &parts_of[level.references[c as usize] as usize];
                assert!(w == 0.0 || parts_of[v].iter().any(|part| there.contains(part)));
            }
        }
        for (face, part) in level.faces.iter().zip(&level.face_part) {
            assert!(face.iter().all(|&r| parts_of[level.references[r as usize] as usize].contains(part)));
        }
    }
}

#[test]
fn small_components_fold_down_to_edges_and_points() {
    let spheres: Vec<_> = (0..30).map(|i| (shapes::icosphere(1.0, 0), DVec3::X * 3.0 * f64::from(i))).collect();
    let spheres = Fixture::new(shapes::compose(&spheres));
    for target in [200, 100, 60, 45, 30, 0] {
        let level = spheres.simplified(target);
        assert_eq!(level.references.len(), target.max(30));
        // No sphere is predicted from another.
        for (v, anchor) in level.anchors.iter().enumerate() {
            assert!(anchor.corners.iter().all(|&c| level.references[c as usize] as usize / 12 == v / 12));
        }
    }
    assert!(spheres.simplified(60).faces.iter().any(|f| f[1] == f[2]));
    assert!(spheres.simplified(0).faces.is_empty());
}

#[test]
fn any_soup_is_simplified_to_any_count() {
    for seed in 0..300 {
        let vertices = 3 + bits(seed, 0, 0) % 60;
        let triangles = bits(seed, 0, 1) % 150;
        let mut positions: Vec<Vec3> = (0..vertices)
            .map(|v| Vec3::from_array([1, 2, 3].map(|k| (8.0 * uniform(seed, v, k)).floor() as f32)))
            .collect();
        if seed % 3 == 0 {
            positions[0] = Vec3::NAN;
            positions[1] = Vec3::splat(f32::MAX);
        }
        let corner = |t: u64, k: u64| (bits(seed, 1000 + t, k) % (vertices + u64::from(seed % 5 == 0))) as u32;
        let mut soup: Vec<[u32; 3]> = (0..triangles).map(|t| [0, 1, 2].map(|k| corner(t, k))).collect();
        soup.extend_from_within(..soup.len() / 4);
        let part: Vec<u32> = (0..soup.len() as u64 / 2).map(|t| (bits(seed, t, 9) % 2) as u32).collect();
        let input = Input { positions: &positions, triangles: &soup, triangle_part: &part };
        let values: Vec<f32> =
            (0..2 * vertices).map(|i| if i == 7 { f32::NAN } else { uniform(seed, i, 4) as f32 }).collect();
        let signal = (seed % 2 == 0).then_some(Signal { values: &values, dimension: 2, weight_mm2: 3.0 });
        let costs = Costs { signal, ..Costs::default() };
        let levels = [vertices as usize / 2, vertices as usize / 5, 1];
        check(&input, &Hierarchy::new(&input, &costs, &levels, &Silent));
        let keep: Vec<u32> = (0..vertices as u32).filter(|v| v % 7 == 0).chain([u32::MAX]).collect();
        let kept = Hierarchy::keeping(&input, &keep, &Silent);
        check(&input, &kept);
        let used = used(&input);
        let still = |v: &u32| kept.levels[0].references.binary_search(v).is_ok();
        assert!(keep.iter().filter(|v| used.get(**v as usize) == Some(&true)).all(still));
    }
}

#[test]
fn an_empty_mesh_has_no_references() {
    let input = Input { positions: &[Vec3::ZERO; 3], triangles: &[], triangle_part: &[] };
    let hierarchy = Hierarchy::new(&input, &Costs::default(), &[2, 1], &Silent);
    check(&input, &hierarchy);
    assert!(hierarchy.levels[0].references.is_empty());
}

#[test]
fn levels_nest_and_their_references_can_be_found_again() {
    let head = Fixture::new(shapes::bumpy_head(10.0, 5));
    let input = head.input();
    let hierarchy = Hierarchy::new(&input, &Costs::default(), &[2000, 500, 100], &Silent);
    check(&input, &hierarchy);
    for pair in hierarchy.levels.windows(2) {
        assert!(pair[1].references.iter().all(|v| pair[0].references.binary_search(v).is_ok()));
        assert_eq!(pair[1].anchors.len(), pair[0].references.len());
    }
    assert_eq!(hierarchy.levels[0], head.simplified(2000));
    for level in &hierarchy.levels {
        let again = Hierarchy::keeping(&input, &level.references, &Silent);
        assert_eq!(again.levels[0].references, level.references);
        let quality = head.quality(&again.levels[0]);
        assert!(quality.worst < 0.12, "{quality:?}");
        assert_eq!(euler(&again.levels[0]), 2);
    }
}

#[test]
fn the_result_does_not_depend_on_threads() {
    let head = Fixture::new(shapes::bumpy_head(10.0, 4));
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| Hierarchy::new(&head.input(), &Costs::default(), &[300, 30], &Silent))
    };
    assert_eq!(run(1), run(5));
}

#[test]
fn a_signal_draws_references_to_its_edge() {
    let plane = Fixture::new(shapes::plane(10.0, 10.0, 60));
    let values: Vec<f32> = plane.mesh.local_mm.iter().map(|p| 0.5 + 0.5 * (2.0 * p.x).clamp(-1.0, 1.0)).collect();
    let error = |costs: &Costs| {
        let hierarchy = Hierarchy::new(&plane.input(), costs, &[120], &Silent);
        check(&plane.input(), &hierarchy);
        let level = &hierarchy.levels[0];
        let value = |r: u32| f64::from(values[level.references[r as usize] as usize]);
        let square: f64 = level
            .anchors
            .iter()
            .zip(&values)
            .map(|(a, own)| {
                let predicted: f64 = (0..3).map(|k| value(a.corners[k]) * a.weights[k]).sum();
                (predicted - f64::from(*own)).powi(2)
            })
            .sum();
        (square / values.len() as f64).sqrt()
    };
    let signal = Signal { values: &values, dimension: 1, weight_mm2: 100.0 };
    let (plain, aware) = (error(&Costs::default()), error(&Costs { signal: Some(signal), ..Costs::default() }));
    eprintln!("edge on a plane: {plain:.4} by geometry, {aware:.4} with the signal");
    assert!(aware < 0.25 * plain, "{aware} {plain}");
}

#[test]
fn the_nearest_point_of_a_triangle_is_the_nearest() {
    for i in 0..400 {
        let point = |k: u64| DVec3::from_array([0, 1, 2].map(|a| uniform(77, i, 3 * k + a) - 0.5));
        let mut corners = [point(0), point(1), point(2)];
        match i % 4 {
            1 => corners[2] = corners[0] + (corners[1] - corners[0]) * 0.3,
            2 => corners = [corners[0]; 3],
            _ => {}
        }
        let p = point(3) * 2.0;
        let (weights, distance2) = closest_weights(p, corners);
        let at = |w: [f64; 3]| corners[0] * w[0] + corners[1] * w[1] + corners[2] * w[2];
        assert!(weights.iter().all(|w| *w >= 0.0) && (weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        assert!((p.distance_squared(at(weights)) - distance2).abs() < 1e-12);
        for a in 0..=40 {
            for b in 0..=40 - a {
                let (a, b) = (f64::from(a) / 40.0, f64::from(b) / 40.0);
                assert!(p.distance_squared(at([a, b, 1.0 - a - b])) >= distance2 - 1e-12);
            }
        }
    }
}

/// A mesh of the shared test data, or none (said on stderr) where there is none.
fn shared(name: &str) -> Option<Fixture> {
    let root = std::env::var_os("TRANSLUX_SHARED")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared"), PathBuf::from);
    let path = root.join("data/meshes").join(name);
    let Ok(text) = std::fs::read_to_string(&path) else {
        eprintln!("WITHOUT ../shared: {} is not there", path.display());
        return None;
    };
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
    Some(Fixture::new(model))
}

#[test]
fn ears_holes_and_thin_plates_keep_their_shape() {
    let fixture = Fixture::new(shapes::still_life(1.5));
    let target = fixture.used() / 10;
    let level = fixture.simplified(target);
    let quality = fixture.quality(&level);
    println!("{target} of {}: {quality:?}", fixture.used());
    assert_eq!(level.references.len(), target);
    assert!(quality.worst < 0.02 && quality.against == 0, "{quality:?}");
}

#[test]
fn real_meshes_keep_their_shape() {
    // Name, largest deviation relative to the diagonal at 5 % of the vertices, share of faces that may look away.
    let cases = [
        ("bunny_closed.obj", 0.01, 0.0),
        ("horse.obj", 0.01, 0.0),
        ("santa.obj", 0.02, 0.0),
        ("bunny.obj", 0.01, 0.0),
        ("cow_head.obj", 0.03, 0.0),
        ("beethoven.obj", 0.08, 0.0),
        ("gargoyle.obj", 0.03, 0.0),
        ("teapot.obj", 0.08, 0.03),
        ("buddha_50k.obj", 0.03, 0.02),
        ("venus_nonmanifold.obj", 0.06, 0.02),
    ];
    for (name, worst, against) in cases {
        let Some(fixture) = shared(name) else { continue };
        let target = fixture.used() / 20;
        let start = Instant::now();
        let level = fixture.simplified(target);
        let seconds = start.elapsed().as_secs_f64();
        let quality = fixture.quality(&level);
        eprintln!(
            "{name}: {} to {} in {seconds:.2} s, deviation RMS {:.3} % worst {:.2} %, {} of {} faces look away",
            fixture.used(),
            level.references.len(),
            100.0 * quality.rms,
            100.0 * quality.worst,
            quality.against,
            level.faces.len()
        );
        assert_eq!(level.references.len(), target);
        assert!(quality.worst < worst, "{name}: {quality:?}");
        assert!(quality.against as f64 <= against * level.faces.len() as f64, "{name}: {quality:?}");
    }
}
