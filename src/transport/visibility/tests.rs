use super::*;
use crate::geometry::shapes;
use crate::geometry::source::SourceModel;
use crate::io::obj::parse_obj;
use crate::math::cube_map::{FRAMES, centre};
use crate::transport::test_scene::{Fixture, named};

fn observers(fixture: &Fixture) -> Vec<Observer> {
    (0..fixture.samples.len()).map(|i| Observer::of(&fixture.scene.mesh, fixture.samples.patch(i))).collect()
}

/// Decisions over some observers beside one ray each.
struct Outcome {
    wrong: u64,
    hidden: u64,
    all: u64,
}

impl Outcome {
    fn disagreement(&self) -> f64 {
        self.wrong as f64 / self.all as f64
    }
}

fn compare(fixture: &Fixture, chosen: &[Observer], resolution: Resolution) -> Outcome {
    let occluders = Occluders::new(&fixture.scene.mesh);
    let side = resolution.side();
    let mut outcome = Outcome { wrong: 0, hidden: 0, all: 0 };
    visit(&occluders, &fixture.bvh, chosen, resolution, |i, visible| {
        let o = &chosen[i];
        let mut rays = Vec::new();
        let mut bits = Vec::new();
        for (face, frame) in FRAMES.iter().enumerate() {
            for y in 0..side {
                for x in 0..side {
                    let d = frame.direction(centre(side, x), centre(side, y)).normalize();
                    let cosine = o.normal.dot(d);
                    let above = visible.bit(&visible.above, face, x, y);
                    assert!(above == (cosine > 0.0) || cosine.abs() < 1e-12, "{face} {x} {y} {cosine}");
                    assert!(above || !visible.bit(&visible.seen, face, x, y));
                    if above {
                        rays.push(o.ray(d));
                        bits.push(visible.bit(&visible.seen, face, x, y));
                    }
                }
            }
        }
        let mut occluded = vec![false; rays.len()];
        fixture.bvh.occluded_many(&rays, &vec![o.triangle; rays.len()], &mut occluded);
        outcome.wrong += bits.iter().zip(&occluded).filter(|(seen, occluded)| *seen == *occluded).count() as u64;
        outcome.hidden += occluded.iter().filter(|o| **o).count() as u64;
        outcome.all += rays.len() as u64;
        assert_eq!(visible.decisions(), rays.len() as u64);
    });
    outcome
}

/// Every `step`-th observer, and of the rest as many of those that see least.
fn shadowed_and_others(fixture: &Fixture, count: usize) -> Vec<Observer> {
    let all = observers(fixture);
    let mut chosen: Vec<Observer> = all.iter().step_by((2 * all.len() / count).max(1)).copied().collect();
    let openness = |o: &Observer| {
        let (x, y) = o.normal.any_orthonormal_pair();
        let tilted = |i: usize| {
            let (sin, cos) = (i as f64 * 0.7).sin_cos();
            o.normal + (cos * x + sin * y) * (0.3 + 0.2 * i as f64)
        };
        (0..16).filter(|&i| !fixture.bvh.occluded(&o.ray(tilted(i)), o.triangle)).count()
    };
    let mut rest: Vec<(usize, usize)> = all.iter().enumerate().map(|(i, o)| (openness(o), i)).collect();
    rest.sort_unstable();
    let picked = rest[..(rest.len() / 8).max(1)].iter().step_by((rest.len() / 4 / count).max(1)).take(count / 2);
    chosen.extend(picked.map(|&(_, i)| all[i]));
    chosen
}

/// Compares on every eighth of the darkest points and others; returns the share of hidden sub-texels.
fn check(name: &str, source: SourceModel, count: usize) -> f64 {
    let fixture = Fixture::new(source, named("marble"), 4000);
    let chosen = shadowed_and_others(&fixture, count);
    let outcome = compare(&fixture, &chosen, Resolution::Sub64);
    let hidden = outcome.hidden as f64 / outcome.all as f64;
    println!("{name}: {} points, {:.0} % hidden, {:.1e} differ", chosen.len(), 100.0 * hidden, outcome.disagreement());
    assert!(outcome.disagreement() <= 1e-4, "{name}: {} of {}", outcome.wrong, outcome.all);
    hidden
}

fn open_box() -> SourceModel {
    let mut source = shapes::cuboid(DVec3::new(10.0, 6.0, 8.0), 3);
    let top = |t: &[u32; 3]| t.iter().all(|&v| source.positions[v as usize].y > 2.9);
    let kept: Vec<[u32; 3]> = source.triangles.iter().filter(|t| !top(t)).copied().collect();
    source.triangle_material.truncate(kept.len());
    source.triangles = kept;
    source
}

#[test]
fn closed_shapes_are_seen_as_one_ray_each_sees_them() {
    assert!(check("head", shapes::bumpy_head(10.0, 4), 60) > 0.01);
    assert!(check("knot", shapes::torus_knot(2, 3, 10.0, 4.0, 1.5, 200, 16), 60) > 0.1);
    assert!(check("still life", shapes::still_life(1.5), 200) > 0.1);
    assert_eq!(check("box", shapes::cuboid(DVec3::new(3.0, 4.0, 5.0), 2), 20), 0.0);
    assert_eq!(check("sphere", shapes::icosphere(5.0, 3), 20), 0.0);
}

#[test]
fn open_inverted_and_crossing_surfaces_are_seen_as_one_ray_each_sees_them() {
    check("open box", open_box(), 20);
    let inside = check("open box from inside", shapes::inside_out(open_box()), 40);
    assert!(inside > 0.3 && inside < 0.99, "{inside}");
    assert_eq!(check("box from inside", shapes::inside_out(shapes::cuboid(DVec3::new(10.0, 6.0, 8.0), 3)), 10), 1.0);
    check("inside out", shapes::inside_out(shapes::bumpy_head(10.0, 3)), 20);
    let (knot, ball) = (shapes::torus_knot(2, 3, 10.0, 4.0, 1.5, 120, 12), shapes::icosphere(4.0, 3));
    check("crossing", shapes::compose(&[(knot, DVec3::ZERO), (ball, DVec3::new(9.0, 1.0, 0.5))]), 60);
    let (plane, head) = (shapes::plane(60.0, 60.0, 1), shapes::bumpy_head(10.0, 3));
    check("on a floor", shapes::compose(&[(plane, DVec3::new(0.0, -8.0, 0.0)), (head, DVec3::ZERO)]), 60);
    let cube = shapes::cuboid(DVec3::splat(4.0), 1);
    let touching = [(cube.clone(), DVec3::ZERO), (cube, DVec3::new(4.0, 4.0, 0.0))];
    check("two boxes at an edge", shapes::compose(&touching), 40);
}

#[test]
fn edges_of_many_triangles_and_mixed_windings_are_counted() {
    // Three walls that meet in one edge, one of them wound the other way.
    let mut source = shapes::plane(40.0, 40.0, 4);
    let base = source.positions.len() as u32;
    source.positions.extend([DVec3::new(0.0, 1.0, -5.0), DVec3::new(0.0, 1.0, 5.0)]);
    for (i, angle) in [0.3f64, 2.0, 4.1].iter().enumerate() {
        let out = DVec3::new(8.0 * angle.cos(), 5.0 + 4.0 * angle.sin(), 0.0);
        let at = source.positions.len() as u32;
        source.positions.push(out);
        source.triangles.push(if i == 1 { [base + 1, base, at] } else { [base, base + 1, at] });
        source.triangle_material.push(0);
    }
    check("three walls", source, 40);
}

#[test]
fn answers_do_not_depend_on_the_range() {
    let fixture = Fixture::new(shapes::torus_knot(2, 3, 10.0, 4.0, 1.5, 80, 12), named("marble"), 600);
    let (all, occluders) = (observers(&fixture), Occluders::new(&fixture.scene.mesh));
    let mut whole = Vec::new();
    visit(&occluders, &fixture.bvh, &all, Resolution::Sub128, |_, v| whole.push(v.clone()));
    assert_eq!(whole.len(), all.len());
    for range in [0..1, 17..90, 300..600] {
        visit(&occluders, &fixture.bvh, &all[range.clone()], Resolution::Sub128, |i, v| {
            assert_eq!(*v, whole[range.start + i]);
        });
    }
    assert!(compare(&fixture, &all[..12], Resolution::Sub128).disagreement() <= 1e-4);
    visit(&occluders, &fixture.bvh, &[], Resolution::Sub64, |_, _| unreachable!());
}

#[test]
fn the_scanned_bunny_is_seen_as_one_ray_each_sees_it() {
    let shared = std::env::var_os("TRANSLUX_SHARED")
        .map_or_else(|| std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared"), std::path::PathBuf::from);
    let Ok(bytes) = std::fs::read(shared.join("data/meshes/bunny_closed.obj")) else {
        println!("WITHOUT ../shared: bunny_closed is not there");
        return;
    };
    let mut source = parse_obj(&bytes, "bunny_closed").unwrap();
    let first = source.positions[0];
    let (low, high) = source.positions.iter().fold((first, first), |(l, h), p| (l.min(*p), h.max(*p)));
    source.positions.iter_mut().for_each(|p| *p *= 30.0 / (high - low).length());
    let fixture = Fixture::new(source, named("marble"), 131_072);
    let chosen = shadowed_and_others(&fixture, 1000);
    let outcome = compare(&fixture, &chosen[..1000.min(chosen.len())], Resolution::Sub64);
    let hidden = outcome.hidden as f64 / outcome.all as f64;
    println!("bunny: {:.0} % hidden, {} of {} differ", 100.0 * hidden, outcome.wrong, outcome.all);
    assert!(outcome.disagreement() <= 1e-4 && hidden > 0.2);
}
