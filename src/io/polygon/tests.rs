#![allow(clippy::unwrap_used)]

use super::*;

fn flat(points: &[[f64; 2]]) -> Vec<DVec3> {
    points.iter().map(|p| DVec3::new(p[0], p[1], 0.0)).collect()
}

/// A polygon of `n` corners around the origin, at distances by their numbers.
fn around(n: usize, radius: impl Fn(usize) -> f64) -> Vec<DVec3> {
    let corner = |i: usize| {
        let angle = i as f64 * std::f64::consts::TAU / n as f64;
        radius(i) * DVec3::new(angle.cos(), angle.sin(), 0.0)
    };
    (0..n).map(corner).collect()
}

fn newell(corners: &[DVec3]) -> DVec3 {
    let origin = corners[0];
    (0..corners.len()).map(|i| (corners[i] - origin).cross(corners[(i + 1) % corners.len()] - origin)).sum()
}

fn total_area(corners: &[DVec3], triangles: &[[usize; 3]]) -> f64 {
    triangles.iter().map(|&[a, b, c]| (corners[b] - corners[a]).cross(corners[c] - corners[a]).length() / 2.0).sum()
}

/// Asserts n - 2 triangles, area and winding kept, every corner used, every outline edge in exactly one triangle.
fn check_planar(corners: &[DVec3]) {
    let triangles = triangulate(corners);
    assert_eq!(triangles.len(), corners.len() - 2);
    let normal = newell(corners);
    let area = normal.length() / 2.0;
    let sum = total_area(corners, &triangles);
    assert!((sum - area).abs() <= 1e-12 * area, "area {sum} instead of {area} with {} corners", corners.len());
    let mut edges = std::collections::HashMap::new();
    for &[a, b, c] in &triangles {
        let cross = (corners[b] - corners[a]).cross(corners[c] - corners[a]);
        assert!(cross.dot(normal) >= -1e-12 * area * normal.length());
        for edge in [(a, b), (b, c), (c, a)] {
            assert!(edges.insert(edge, ()).is_none(), "an edge twice in one direction");
        }
    }
    for i in 0..corners.len() {
        let edge = (i, (i + 1) % corners.len());
        assert!(edges.contains_key(&edge) && !edges.contains_key(&(edge.1, edge.0)), "outline edge {edge:?}");
    }
}

/// Checks the same polygon in a slanted plane, far from the origin, reversed and with another first corner.
fn check_everywhere(points: &[[f64; 2]]) {
    let corners = flat(points);
    check_planar(&corners);
    let turn = glam::DQuat::from_rotation_x(0.7) * glam::DQuat::from_rotation_y(-1.1);
    let slanted: Vec<DVec3> = corners.iter().map(|&c| turn * c).collect();
    check_planar(&slanted);
    let far: Vec<DVec3> = corners.iter().map(|&c| c + DVec3::new(1024.0, -4096.0, 512.0)).collect();
    check_planar(&far);
    let mut reversed = slanted.clone();
    reversed.reverse();
    check_planar(&reversed);
    for shift in 1..corners.len() {
        let mut rotated = slanted.clone();
        rotated.rotate_left(shift);
        check_planar(&rotated);
    }
    for scale in [1e-150, 1e150] {
        let scaled: Vec<DVec3> = corners.iter().map(|&c| c * scale).collect();
        assert_eq!(triangulate(&scaled).len(), corners.len() - 2);
    }
}

#[test]
fn too_few_corners_give_nothing() {
    assert!(triangulate(&[]).is_empty());
    assert!(triangulate(&flat(&[[0.0, 0.0], [1.0, 0.0]])).is_empty());
    assert_eq!(triangulate(&flat(&[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])), [[0, 1, 2]]);
}

#[test]
fn quads_take_the_shorter_valid_diagonal() {
    let wide = flat(&[[0.0, 0.0], [2.0, -0.5], [4.0, 0.0], [2.0, 0.5]]);
    assert_eq!(triangulate(&wide), [[0, 1, 3], [1, 2, 3]]);
    let square = flat(&[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]);
    assert_eq!(triangulate(&square), [[0, 1, 2], [0, 2, 3]]);
    let rounded = flat(&[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 0.99999999]]);
    assert_eq!(triangulate(&rounded), triangulate(&square));
    // An arrow head: the short diagonal 1-3 lies outside.
    let arrow = [[0.0, 0.0], [3.0, -1.0], [1.0, 0.0], [3.0, 1.0]];
    assert_eq!(triangulate(&flat(&arrow)), [[0, 1, 2], [0, 2, 3]]);
    check_everywhere(&arrow);
    check_everywhere(&[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [1.0, 1.0]]);
}

#[test]
fn a_flat_corner_of_a_quad_gives_no_sliver() {
    let corners = flat(&[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [1.0, 1.0]]);
    assert_eq!(triangulate(&corners), [[0, 1, 3], [1, 2, 3]]);
}

#[test]
fn concave_polygons_keep_their_area() {
    check_everywhere(&[[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [2.0, 1.0], [0.0, 4.0]]);
    let comb: Vec<[f64; 2]> = (0..20)
        .map(|i| [f64::from(i), if i % 2 == 0 { 0.5 } else { 5.0 }])
        .rev()
        .chain([[0.0, 0.0], [19.0, 0.0]])
        .collect();
    check_everywhere(&comb);
    let star: Vec<[f64; 2]> = (0..30)
        .map(|i| {
            let (angle, radius) = (f64::from(i) * std::f64::consts::TAU / 30.0, if i % 2 == 0 { 1.0 } else { 0.2 });
            [radius * angle.cos(), radius * angle.sin()]
        })
        .collect();
    check_everywhere(&star);
    let spiral: Vec<[f64; 2]> = (0..60)
        .map(|i| (f64::from(i) * 0.3, 1.0))
        .chain((0..60).rev().map(|i| (f64::from(i) * 0.3, 0.8)))
        .map(|(angle, width)| [(angle + 2.0) * width * angle.cos(), (angle + 2.0) * width * angle.sin()])
        .collect();
    check_everywhere(&spiral);
}

#[test]
fn collinear_corners_give_no_triangle_without_area() {
    let side = [0.0, 0.1, 0.3, 0.7, 0.9];
    let mut square = Vec::new();
    square.extend(side.map(|t| [t, 0.0]));
    square.extend(side.map(|t| [1.0, t]));
    square.extend(side.map(|t| [1.0 - t, 1.0]));
    square.extend(side.map(|t| [0.0, 1.0 - t]));
    check_everywhere(&square);
    // Corners on one side only, so that the shortest cuts are those along it. In slanted planes the corners are
    // collinear only up to rounding.
    let mut comb: Vec<[f64; 2]> = (0..=10).map(|i| [0.1 * f64::from(i), 0.0]).collect();
    comb.extend([[1.0, 1.0], [0.0, 1.0]]);
    check_everywhere(&comb);
    for step in 0..200 {
        let turn = glam::DQuat::from_rotation_z(f64::from(step)) * glam::DQuat::from_rotation_x(0.37 * f64::from(step));
        let corners: Vec<DVec3> = flat(&comb).iter().map(|&c| turn * c).collect();
        for [a, b, c] in triangulate(&corners) {
            assert!((corners[b] - corners[a]).cross(corners[c] - corners[a]).length() > 1e-3, "step {step}");
        }
    }
}

#[test]
fn a_hole_joined_by_a_doubled_edge_keeps_its_area() {
    let corners = flat(&[
        [0.0, 0.0],
        [4.0, 0.0],
        [4.0, 4.0],
        [0.0, 4.0],
        [0.0, 0.0],
        [1.0, 1.0],
        [1.0, 3.0],
        [3.0, 3.0],
        [3.0, 1.0],
        [1.0, 1.0],
    ]);
    let triangles = triangulate(&corners);
    assert_eq!(triangles.len(), 8);
    assert!((total_area(&corners, &triangles) - 12.0).abs() < 1e-12);
}

#[test]
fn a_circle_is_cut_without_a_fan_of_slivers() {
    let circle = around(256, |_| 1.0);
    check_planar(&circle);
    let mut valence = vec![0; circle.len()];
    for triangle in triangulate(&circle) {
        for corner in triangle {
            valence[corner] += 1;
        }
    }
    assert!(valence.iter().all(|&v| v < 20), "a corner with {} triangles", valence.iter().max().unwrap());
}

#[test]
fn random_star_shaped_polygons_keep_their_area() {
    let mut state = 1u64;
    let mut random = move || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    for n in 4..300 {
        let corners: Vec<DVec3> = (0..n)
            .map(|i| {
                let angle = (f64::from(i) + 0.8 * random()) * std::f64::consts::TAU / f64::from(n);
                let radius = 0.05 + random();
                DVec3::new(radius * angle.cos(), 2.0, -radius * angle.sin())
            })
            .collect();
        check_planar(&corners);
    }
}

#[test]
fn polygons_on_a_coarse_grid_never_lose_a_triangle() {
    // Repeated, collinear, crossing: anything may happen, but there are always n - 2 triangles in range.
    let mut state = 7u64;
    let mut random = move |range: u64| {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        ((state >> 33) % range) as usize
    };
    for _ in 0..3000 {
        let n = 3 + random(20);
        let corners: Vec<DVec3> =
            (0..n).map(|_| DVec3::new(random(4) as f64, random(4) as f64, random(2) as f64)).collect();
        let triangles = triangulate(&corners);
        assert_eq!(triangles.len(), n - 2);
        assert!(triangles.iter().flatten().all(|&corner| corner < n));
        assert_eq!(triangles, triangulate(&corners));
    }
}

#[test]
fn polygons_without_area_become_a_fan() {
    let line = flat(&[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [3.0, 0.0], [1.5, 0.0]]);
    assert_eq!(triangulate(&line), fan(5));
    assert_eq!(triangulate(&[DVec3::ONE; 6]), fan(6));
    assert_eq!(triangulate(&[DVec3::ZERO; 4]), fan(4));
    assert_eq!(triangulate(&[DVec3::NAN; 5]), fan(5));
    let eight = flat(&[[0.0, 0.0], [1.0, 1.0], [2.0, 1.0], [2.0, 0.0], [1.0, 0.0], [0.0, 1.0]]);
    assert_eq!(triangulate(&eight).len(), 4);
}

#[test]
fn non_planar_polygons_keep_their_outline() {
    let octagon: Vec<DVec3> = [[0, 1, 1], [0, 2, 2], [1, 3, 4], [2, 3, 5], [3, 2, 5], [3, 1, 4], [2, 0, 2], [1, 0, 1]]
        .iter()
        .map(|&[x, y, z]| DVec3::new(f64::from(x), f64::from(y), f64::from(z)))
        .collect();
    let triangles = triangulate(&octagon);
    let normal = newell(&octagon);
    let projected: f64 = triangles
        .iter()
        .map(|&[a, b, c]| (octagon[b] - octagon[a]).cross(octagon[c] - octagon[a]).dot(normal.normalize()))
        .inspect(|&area| assert!(area > 0.0))
        .sum();
    assert!((projected - normal.length()).abs() < 1e-12 * normal.length());
}

#[test]
fn orientation_signs_are_exact() {
    // Shewchuk's classic: a grid of neighbours of (0.5, 0.5) against the line y = x.
    let (b, c) = (DVec2::splat(12.0), DVec2::splat(24.0));
    for i in 0..64 {
        for j in 0..64 {
            let step = f64::EPSILON / 2.0;
            let a = DVec2::new(0.5 + f64::from(i) * step, 0.5 + f64::from(j) * step);
            let sign = orient(a, b, c);
            // Twelve times (y - x), by hand.
            let expected = (a.x - a.y) * -12.0;
            assert_eq!(sign.partial_cmp(&0.0), expected.partial_cmp(&0.0), "{i} {j}");
        }
    }
}

#[test]
fn the_largest_polygons_take_bounded_time() {
    // Half of the corners reflex, and every ear test walks through all of them.
    let n = MAX_POLYGON_CORNERS;
    let start = std::time::Instant::now();
    for inner in [0.999, 0.1] {
        let corners = around(n, |i| if i % 2 == 0 { 1.0 } else { inner });
        let triangles = triangulate(&corners);
        let area = newell(&corners).length() / 2.0;
        assert!((total_area(&corners, &triangles) - area).abs() < 1e-10 * area);
    }
    println!("two stars of {n} corners: {:?}", start.elapsed());
    // Random radii, random points (crossing everywhere) and points on a coarse grid (repeated and collinear).
    let mut state = 3u64;
    let mut random = move || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    for kind in 0..3 {
        let corners: Vec<DVec3> = (0..n)
            .map(|i| {
                let angle = i as f64 * std::f64::consts::TAU / n as f64;
                match kind {
                    0 => (0.1 + random()) * DVec3::new(angle.cos(), angle.sin(), 0.0),
                    1 => DVec3::new(random(), random(), random()),
                    _ => DVec3::new((random() * 9.0).floor(), (random() * 9.0).floor(), 0.0),
                }
            })
            .collect();
        let start = std::time::Instant::now();
        assert_eq!(triangulate(&corners).len(), n - 2);
        println!("kind {kind}: {:?}", start.elapsed());
    }
    assert!(start.elapsed().as_secs() < 20);
}
