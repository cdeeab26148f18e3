#![allow(clippy::unwrap_used)]

use glam::{DVec3, Vec3};

use super::lanes::Path as Instructions;
use super::{Bvh, Hit, NO_TRIANGLE, Ray, offset_origin};
use crate::geometry::shapes;
use crate::geometry::source::SourceModel;
use crate::geometry::test_data::obj;
use crate::math::random::uniform;
use crate::math::sphere::random_direction;

type Corners = Vec<[Vec3; 3]>;

fn direction(stage: u64, i: u64) -> Vec3 {
    random_direction(stage, i).as_vec3()
}

fn point(stage: u64, i: u64) -> Vec3 {
    DVec3::new(uniform(stage, i, 2), uniform(stage, i, 3), uniform(stage, i, 4)).as_vec3() * 2.0 - 1.0
}

fn corners_of(model: &SourceModel) -> Corners {
    model.triangles.iter().map(|t| t.map(|v| model.positions[v as usize].as_vec3())).collect()
}

fn torus(along: u32, around: u32) -> Corners {
    corners_of(&shapes::torus(1.0, 0.4, along, around))
}

fn icosphere(levels: u32) -> Corners {
    corners_of(&shapes::icosphere(1.0, levels))
}

fn soup(n: u64, size: f32) -> Corners {
    (0..n).map(|i| [5, 6, 7].map(|s| point(9, i) + size * point(s, i))).collect()
}

fn slivers(n: u64) -> Corners {
    (0..n).map(|i| [point(9, i), point(9, i) + 0.5 * direction(3, i), point(9, i) + 1e-4 * direction(4, i)]).collect()
}

fn moved(corners: &Corners, scale: f32, offset: Vec3) -> Corners {
    corners.iter().map(|t| t.map(|p| p * scale + offset)).collect()
}

/// Every path that this machine has.
fn paths(bvh: &Bvh) -> Vec<Bvh> {
    let mut all = vec![Bvh { path: Instructions::Portable, ..bvh.clone() }];
    if bvh.path != Instructions::Portable {
        all.push(bvh.clone());
    }
    all
}

/// All hits by testing every triangle in a tree of its own, in which no box can lose it.
fn brute(singles: &[Bvh], ray: &Ray) -> Vec<Hit> {
    let mut hits = Vec::new();
    for (i, single) in (0u32..).zip(singles) {
        single.crossings(ray, |hit| hits.push(Hit { triangle: i, ..hit }));
    }
    hits
}

/// Trees of one triangle whose box is everything.
fn singles(corners: &Corners) -> Vec<Bvh> {
    let mut all: Vec<Bvh> =
        corners.iter().map(|&t| Bvh { path: Instructions::Portable, ..Bvh::from_triangles(&[t]) }).collect();
    // The range from which far rays start over belongs to the scene, so it must be the same.
    let whole = Bvh::from_triangles(corners);
    for single in &mut all {
        for node in &mut single.tree.nodes {
            for axis in 0..3 {
                node.planes[axis][0] = f32::NEG_INFINITY;
                node.planes[axis + 3][0] = f32::INFINITY;
            }
        }
        (single.tree.low, single.tree.high) = (whole.tree.low, whole.tree.high);
        (single.tree.extent, single.tree.magnitude) = (whole.tree.extent, whole.tree.magnitude);
    }
    all
}

/// A plain test in 64 bits that shares nothing with the code under test; None where it is too close to call.
fn plain(&[a, b, c]: &[Vec3; 3], ray: &Ray) -> Option<Option<f64>> {
    let [a, b, c, o, d] = [a, b, c, ray.origin, ray.direction].map(|p| p.as_dvec3());
    let scale = [a, b, c].iter().map(|p| (*p - o).length()).fold(0.0, f64::max) + o.length();
    let n = (b - a).cross(c - a);
    let det = n.dot(d);
    if det.abs() < 1e-2 * n.length() {
        return None;
    }
    let t = n.dot(a - o) / det;
    let p = o + t * d;
    let side = |x: DVec3, y: DVec3| (y - x).cross(p - x).dot(n) / (n.length() * (y - x).length());
    let least = side(a, b).min(side(b, c)).min(side(c, a));
    if least.abs() < 1e-5 * scale || (t - f64::from(ray.t_min)).abs() < 1e-5 * scale {
        return None;
    }
    Some((least > 0.0 && t > f64::from(ray.t_min) && t < f64::from(ray.t_max)).then_some(t))
}

fn sorted(mut hits: Vec<Hit>) -> Vec<Hit> {
    hits.sort_by_key(|hit| hit.triangle);
    hits
}

/// Rays of many kinds around a scene in [-1, 1]^3 before `scale` and `offset`.
fn probe(i: u64, corners: &Corners, scale: f32, offset: Vec3) -> Ray {
    let triangle = corners[(uniform(11, i, 0) * corners.len() as f64) as usize];
    let origin = point(12, i) * 1.5 * scale + offset;
    let mut ray = Ray::new(origin, direction(13, i));
    match i % 8 {
        0 => ray.direction = Vec3::AXES[(i / 8 % 3) as usize] * [1.0, -1.0][(i / 24 % 2) as usize],
        1 => ray.direction = (direction(13, i) * Vec3::new(1.0, 1.0, 0.0)).normalize_or(Vec3::X),
        // At a vertex, at the middle of an edge, along an edge.
        2 => ray.direction = (triangle[0] - origin).normalize_or(Vec3::X),
        3 => ray.direction = (triangle[0].midpoint(triangle[1]) - origin).normalize_or(Vec3::X),
        4 => {
            ray.direction = (triangle[1] - triangle[0]).normalize_or(Vec3::X);
            ray.origin = triangle[0] - ray.direction * scale;
        }
        5 => (ray.t_min, ray.t_max) = (0.2 * scale, 0.9 * scale),
        6 => {
            let target = (triangle[0] + triangle[1] + triangle[2]) / 3.0;
            ray.origin = target - ray.direction * 1000.0 * scale;
        }
        _ => {}
    }
    ray
}

fn agrees_with_brute_force(name: &str, corners: &Corners, scale: f32, offset: Vec3, rays: u64) {
    let corners = moved(corners, scale, offset);
    let bvh = Bvh::from_triangles(&corners);
    let singles = singles(&corners);
    let (mut hits, mut decided) = (0, 0);
    let probes: Vec<Ray> = (0..rays).map(|i| probe(i, &corners, scale, offset)).collect();
    for ray in &probes {
        let expected = brute(&singles, ray);
        hits += expected.len();
        for bvh in paths(&bvh) {
            let mut found = Vec::new();
            bvh.crossings(ray, |hit| found.push(hit));
            assert_eq!(sorted(found), expected, "{name} {ray:?}");
            assert_eq!(bvh.occluded(ray, NO_TRIANGLE), !expected.is_empty(), "{name} {ray:?}");
            let skip = expected.first().map_or(0, |h| h.triangle);
            assert_eq!(bvh.occluded(ray, skip), expected.len() > 1, "{name} {ray:?}");
            let closest = bvh.closest(ray);
            assert_eq!(closest.is_some(), !expected.is_empty());
            if let Some(hit) = closest {
                assert!(expected.contains(&hit));
                assert!(expected.iter().all(|h| hit.t <= h.t), "{name} {ray:?}");
            }
        }
        if ray.origin.length() > 100.0 * scale || offset != Vec3::ZERO {
            continue;
        }
        for (i, corners) in (0u32..).zip(&corners).step_by(7) {
            let Some(expect) = plain(corners, ray) else { continue };
            let found = expected.iter().find(|h| h.triangle == i);
            assert_eq!(found.is_some(), expect.is_some(), "{name} triangle {i} {ray:?}");
            if let (Some(hit), Some(t)) = (found, expect) {
                assert!((f64::from(hit.t) - t).abs() < 1e-4 * f64::from(scale), "{name} {hit:?} {t}");
                let [a, b, c] = corners.map(|p| p.as_dvec3());
                let (u, v) = (f64::from(hit.u), f64::from(hit.v));
                let there = a * (1.0 - u - v) + b * u + c * v;
                let here = ray.origin.as_dvec3() + t * ray.direction.as_dvec3();
                assert!(there.distance(here) < 1e-4 * f64::from(scale), "{name} {hit:?}");
            }
            decided += 1;
        }
    }
    let least = if offset == Vec3::ZERO { rays / 20 } else { rays / 100 };
    assert!(hits as u64 > least, "{name}: only {hits} hits");
    assert!(offset != Vec3::ZERO || decided > rays, "{name}: only {decided} decided");
    let skip = vec![NO_TRIANGLE; probes.len()];
    for bvh in paths(&bvh) {
        let mut many = vec![false; probes.len()];
        bvh.occluded_many(&probes, &skip, &mut many);
        let single: Vec<bool> = probes.iter().map(|r| bvh.occluded(r, NO_TRIANGLE)).collect();
        assert!(many == single, "{name}");
    }
}

/// Eye rays of neighbouring places, from near and far, and rays that have nothing in common.
#[test]
fn bundles_find_the_closest_hits_of_single_rays() {
    let meshes = [
        ("nothing", Vec::new()),
        ("one", soup(1, 1.0)),
        ("sphere", icosphere(4)),
        ("torus", torus(24, 12)),
        ("soup", soup(2000, 0.1)),
        ("slivers", slivers(300)),
    ];
    for (name, corners) in &meshes {
        let bvh = Bvh::from_triangles(corners);
        for (distance, spread) in [(3.0, 0.002), (3.0, 0.05), (100.0, 0.01), (0.3, 0.2), (1.5, 2.0), (1e6, 1e-7)] {
            let rays: Vec<Ray> = (0..4000u64)
                .map(|i| {
                    // Sixteen rays about one axis at a time; some bundles start on both sides of a plane, some break off.
                    let axis = direction(31, i / 16);
                    let aim = axis * 0.4 * direction(32, i / 16) + direction(33, i) * spread * distance;
                    let origin = axis * distance;
                    let mut ray = Ray::new(origin, (aim - origin).normalize_or(Vec3::X));
                    if i % 97 == 0 {
                        ray.t_max = distance;
                    }
                    if i % 611 == 0 {
                        ray.direction = Vec3::NAN;
                    }
                    ray
                })
                .collect();
            for bvh in paths(&bvh) {
                let single: Vec<Option<Hit>> = rays.iter().map(|ray| bvh.closest(ray)).collect();
                for cut in [1, 3, 16, 4000] {
                    let mut many = vec![Some(Hit { triangle: 7, t: 0.0, u: 0.0, v: 0.0 }); rays.len()];
                    for (rays, out) in rays.chunks(cut).zip(many.chunks_mut(cut)) {
                        bvh.closest_many(rays, out);
                    }
                    assert!(many == single, "{name} from {distance}, spread {spread}, {cut} at once");
                }
                let hits = single.iter().flatten().count();
                let few = ["nothing", "one", "slivers"].contains(name) || distance > 1e5 || spread > 1.0;
                assert!(few || hits > 500, "{name} {distance}: {hits}");
            }
        }
    }
}

#[test]
fn every_query_agrees_with_brute_force_at_every_scale() {
    let meshes = [
        ("sphere", icosphere(2)),
        ("torus", torus(24, 12)),
        ("soup", soup(300, 0.3)),
        ("small soup", soup(500, 0.02)),
        ("slivers", slivers(300)),
    ];
    for (name, corners) in &meshes {
        for scale in [1e-3, 1.0, 1e4] {
            agrees_with_brute_force(name, corners, scale, Vec3::ZERO, 3_000);
        }
        agrees_with_brute_force(name, corners, 1.0, Vec3::new(1e4, -1e4, 2e4), 2_000);
        agrees_with_brute_force(name, corners, 1e-15, Vec3::ZERO, 500);
        agrees_with_brute_force(name, corners, 1e15, Vec3::ZERO, 500);
    }
}

/// Casts rays from well inside a closed mesh at random points, edges and vertices; none may get out.
fn none_escapes(name: &str, corners: &Corners, inside: &[Vec3], rays: std::ops::Range<u64>) {
    let bvh = Bvh::from_triangles(corners);
    let count = rays.end - rays.start;
    let mut batch = Vec::new();
    let mut escaped = Vec::new();
    let mut out = vec![false; 4096];
    let skip = vec![NO_TRIANGLE; 4096];
    for i in rays {
        let origin = inside[(uniform(21, i, 0) * inside.len() as f64) as usize];
        let [a, b, c] = corners[(uniform(21, i, 1) * corners.len() as f64) as usize];
        let (s, target) = (uniform(21, i, 2) as f32, i % 4);
        let aim = [a, a.midpoint(b), b + (c - b) * s, origin + direction(22, i)][target as usize];
        batch.push(Ray::new(origin, (aim - origin).normalize_or(Vec3::X)));
        if batch.len() == out.len() {
            bvh.occluded_many(&batch, &skip, &mut out);
            escaped.extend(batch.iter().zip(&out).filter(|(_, hit)| !**hit).map(|(ray, _)| *ray));
            batch.clear();
        }
    }
    escaped.extend(batch.iter().filter(|ray| !bvh.occluded(ray, NO_TRIANGLE)));
    assert!(escaped.is_empty(), "{name}: {} of {count} rays escaped, first {:?}", escaped.len(), escaped[0]);
    // The same by parity, from which no wall can hide: a crossing of an edge counts for each triangle around it, so
    // only rays at no vertex and no edge are counted.
    for i in 0..2000 {
        let ray = Ray::new(inside[i as usize % inside.len()], direction(23, i));
        let mut crossings = 0;
        bvh.crossings(&ray, |_| crossings += 1);
        assert!(crossings % 2 == 1, "{name} {crossings} {ray:?}");
    }
}

/// Points deep inside, found by casting along the inverse normals and taking the middle.
fn middles(corners: &Corners, wanted: usize) -> Vec<Vec3> {
    let bvh = Bvh::from_triangles(corners);
    let extent = bvh.tree.extent;
    let mut found = Vec::new();
    for i in 0..corners.len() {
        let i = i * 7919 % corners.len();
        let [a, b, c] = corners[i];
        let (start, n) = ((a + b + c) / 3.0, (b - a).cross(c - a).normalize_or(Vec3::X));
        let ray = Ray::new(offset_origin(start, -n), -n);
        match bvh.closest(&ray) {
            Some(hit) if hit.t > 0.02 * extent => found.push(ray.origin + ray.direction * (0.5 * hit.t)),
            _ => {}
        }
        if found.len() == wanted {
            break;
        }
    }
    assert!(!found.is_empty());
    found
}

fn containment(rays: u64) {
    let mut meshes =
        vec![("icosphere", icosphere(4)), ("torus", torus(96, 48)), ("elephant", corners_of(&shapes::elephant(1.2)))];
    for name in ["bunny_closed.obj", "horse.obj"] {
        meshes.extend(obj(&format!("meshes/{name}")).map(|model| (name, corners_of(&model))));
    }
    let share = rays / meshes.len() as u64;
    let start = std::time::Instant::now();
    for (name, corners) in &meshes {
        let inside = middles(corners, 1000);
        none_escapes(name, corners, &inside, 0..share);
    }
    println!("{rays} rays from inside {} meshes, none escaped, {:.1} s", meshes.len(), start.elapsed().as_secs_f64());
    for scale in [1e-6, 1e6] {
        let corners = moved(&torus(96, 48), scale, Vec3::ZERO);
        none_escapes("scaled torus", &corners, &middles(&corners, 1000), 0..share / 10);
    }
}

#[test]
fn no_ray_escapes_from_inside_a_closed_mesh() {
    containment(1_000_000);
}

#[test]
fn no_ray_of_a_hundred_million_escapes() {
    if std::env::var_os("TRANSLUX_LONG").is_none() {
        println!("SKIPPED: set TRANSLUX_LONG=1 for 1e8 rays (some minutes)");
        return;
    }
    containment(100_000_000);
}

#[test]
fn a_convex_surface_does_not_shadow_itself() {
    for (scale, offset) in [1e-6f32, 1e-3, 1.0, 1e3, 1e6]
        .map(|s| (s, Vec3::ZERO))
        .into_iter()
        .chain([(1.0, Vec3::new(1e3, -2e3, 5e2)), (100.0, Vec3::splat(1e4))])
    {
        let corners = moved(&icosphere(4), scale, offset);
        let bvh = Bvh::from_triangles(&corners);
        for i in 0..60_000u64 {
            let triangle = (uniform(31, i, 0) * corners.len() as f64) as usize;
            let [a, b, c] = corners[triangle];
            let (mut u, mut v) = (uniform(31, i, 1) as f32, uniform(31, i, 2) as f32);
            match i % 4 {
                0 => v = 0.0,
                1 => (u, v) = (0.0, 0.0),
                _ if u + v > 1.0 => (u, v) = (1.0 - u, 1.0 - v),
                _ => {}
            }
            let normal = (b - a).cross(c - a).normalize();
            // An offset mesh is convex only to the rounding of its corners: keep to directions above that.
            let least = if offset == Vec3::ZERO { 1e-3 } else { 0.05 };
            let mut w = direction(32, i);
            w *= w.dot(normal).signum();
            if w.dot(normal) < least {
                w = (w + normal * least).normalize();
            }
            let ray = Ray::new(offset_origin(a + (b - a) * u + (c - a) * v, normal), w);
            assert!(!bvh.occluded(&ray, triangle as u32), "scale {scale} offset {offset} {ray:?}");
            assert!(!bvh.occluded(&ray, NO_TRIANGLE), "own triangle: scale {scale} offset {offset} {ray:?}");
        }
    }
}

#[test]
fn an_offset_clears_the_plane_and_stays_close() {
    for i in 0..10_000 {
        let p = point(41, i) * 10f32.powf((uniform(41, i, 9) * 60.0 - 30.0) as f32);
        let n = direction(42, i);
        let moved = offset_origin(p, n);
        let step = (moved.as_dvec3() - p.as_dvec3()).dot(n.as_dvec3());
        let unit = f64::from(p.abs().max_element());
        assert!(step > 1e-6 * unit && step < 1e-5 * unit, "{p} {n} {step}");
    }
    assert_eq!(offset_origin(Vec3::ONE, Vec3::ZERO), Vec3::ONE);
    assert_eq!(offset_origin(Vec3::ZERO, Vec3::X), Vec3::ZERO);
}

#[test]
fn nothing_is_hit_where_there_is_nothing_to_hit() {
    let empty = Bvh::from_triangles(&[]);
    let line = [Vec3::ZERO, Vec3::X, Vec3::X * 2.0];
    let same = [Vec3::ONE, Vec3::ONE, Vec3::X];
    let flawed = [Vec3::ZERO, Vec3::X, Vec3::new(0.0, f32::NAN, 0.0)];
    let endless = [Vec3::ZERO, Vec3::X, Vec3::new(0.0, f32::INFINITY, 0.0)];
    let degenerate = Bvh::from_triangles(&[line, same, flawed, endless]);
    for bvh in [&empty, &degenerate] {
        for i in 0..1000 {
            let ray = Ray::new(point(51, i), (Vec3::X * point(52, i).x - point(51, i)).normalize());
            assert!(!bvh.occluded(&ray, NO_TRIANGLE) && bvh.closest(&ray).is_none());
            bvh.crossings(&ray, |hit| panic!("{hit:?}"));
        }
    }
    let sphere = Bvh::from_triangles(&icosphere(2));
    let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY];
    let mut rays = vec![Ray::new(Vec3::ZERO, Vec3::ZERO)];
    for x in bad {
        rays.push(Ray::new(Vec3::ZERO, Vec3::new(0.0, x, 1.0)));
        rays.push(Ray::new(Vec3::new(x, 0.0, 0.0), Vec3::Z));
        rays.push(Ray { t_min: f32::NAN, ..Ray::new(Vec3::ZERO, Vec3::Z) });
        rays.push(Ray { t_max: f32::NAN, ..Ray::new(Vec3::ZERO, Vec3::Z) });
        rays.push(Ray { t_max: -1.0, ..Ray::new(Vec3::ZERO, Vec3::Z) });
        rays.push(Ray { t_min: f32::INFINITY, ..Ray::new(Vec3::ZERO, Vec3::Z) });
    }
    for ray in &rays {
        assert!(!sphere.occluded(ray, NO_TRIANGLE) && sphere.closest(ray).is_none(), "{ray:?}");
    }
    let mut out = vec![true; rays.len()];
    sphere.occluded_many(&rays, &vec![NO_TRIANGLE; rays.len()], &mut out);
    assert!(out.iter().all(|hit| !hit));
}

#[test]
fn degenerate_triangles_leave_the_others_alone() {
    let sphere = icosphere(2);
    let mut mixed = Vec::new();
    for &[a, b, c] in &sphere {
        mixed.extend([[a, a, b], [a, b, c], [a, b, a.midpoint(a)]]);
    }
    let (plain, mixed) = (Bvh::from_triangles(&sphere), Bvh::from_triangles(&mixed));
    for i in 0..5000 {
        let ray = Ray::new(2.0 * point(61, i), direction(62, i));
        let expected = plain.closest(&ray).map(|hit| Hit { triangle: 3 * hit.triangle + 1, ..hit });
        assert_eq!(mixed.closest(&ray), expected);
    }
}

#[test]
fn ends_of_the_range_are_excluded_and_equal_hits_give_the_lowest_triangle() {
    let wall = [Vec3::new(-4.0, -4.0, 2.0), Vec3::new(4.0, -4.0, 2.0), Vec3::new(0.0, 4.0, 2.0)];
    let bvh = Bvh::from_triangles(&[wall; 40]);
    let ray = Ray::new(Vec3::ZERO, Vec3::Z);
    let hit = bvh.closest(&ray).unwrap();
    assert_eq!((hit.triangle, hit.t, hit.u, hit.v), (0, 2.0, 0.25, 0.5));
    assert!(!bvh.occluded(&Ray { t_max: 2.0, ..ray }, NO_TRIANGLE));
    assert!(!bvh.occluded(&Ray { t_min: 2.0, ..ray }, NO_TRIANGLE));
    assert!(bvh.occluded(&Ray { t_min: 2.0f32.next_down(), t_max: 2.0f32.next_up(), ..ray }, NO_TRIANGLE));
    let mut count = 0;
    bvh.crossings(&ray, |_| count += 1);
    assert_eq!(count, 40);
}

#[test]
fn a_tree_deeper_than_the_small_stack_works() {
    // Ever smaller triangles one inside the other's corner make the builder's tree a chain.
    let corners: Corners = (0..120)
        .map(|i| {
            let s = 0.5f32.powi(i);
            [Vec3::new(s, s, s), Vec3::new(1.5 * s, s, 1.1 * s), Vec3::new(s, 1.5 * s, 1.2 * s)]
        })
        .collect();
    let mut bvh = Bvh::from_triangles(&corners);
    let target: Vec<Ray> = corners
        .iter()
        .map(|t| {
            let centre = (t[0] + t[1] + t[2]) / 3.0;
            Ray::new(Vec3::new(centre.x, centre.y, 2.0), Vec3::NEG_Z)
        })
        .collect();
    for deep in [false, true] {
        if deep {
            bvh.tree.stack = 4096;
        }
        for bvh in paths(&bvh) {
            for ray in &target[..40] {
                assert!(bvh.occluded(ray, NO_TRIANGLE) && bvh.closest(ray).is_some());
            }
        }
    }
}

#[test]
fn the_tree_is_the_same_every_time_and_holds_every_triangle_once() {
    let corners = torus(200, 100);
    let (a, b) = (Bvh::from_triangles(&corners), Bvh::from_triangles(&corners));
    assert_eq!(format!("{a:?}"), format!("{b:?}"));
    let mut seen = vec![0; corners.len()];
    let mut stack = vec![0u32];
    while let Some(top) = stack.pop() {
        let node = &a.tree.nodes[top as usize];
        for slot in 0..8 {
            if node.planes[0][slot] > node.planes[3][slot] {
                continue;
            }
            let child = node.children.0[slot];
            if child & super::build::LEAF == 0 {
                stack.push(child);
                continue;
            }
            let block = &a.tree.blocks[(child & !super::build::LEAF) as usize >> 3];
            for lane in 0..=(child & 7) as usize {
                seen[block.triangles[lane] as usize] += 1;
                for axis in 0..3 {
                    for corner in block.corners {
                        let x = corner[axis][lane];
                        assert!(node.planes[axis][slot] <= x && x <= node.planes[axis + 3][slot]);
                    }
                }
            }
        }
    }
    assert!(seen.iter().all(|&n| n == 1));
}
