//! The oracle against closed forms, and against radiosities that another program computed.
//!
//! The second kind needs the shared data beside the repository (or `TRANSLUX_SHARED`); `TRANSLUX_LONG=1` runs all of
//! it, otherwise only what takes seconds.
#![allow(clippy::unwrap_used, missing_docs, dead_code)]

use crate::oracle;
use crate::oracle::medium::{Channel, fresnel_transmittance};
use crate::oracle::patch::Patch;
use crate::oracle::rays::{Blockers, Ray};
use crate::oracle::truth_files::{Case, compare, environment, material};
use crate::oracle::vector::{V3, gauss_legendre, hash, unit};
use crate::oracle::{Oracle, OracleLight, OracleMesh, OracleSettings};
use std::f64::consts::PI;

const GREY: V3 = [1.0; 3];

fn worst_relative(found: V3, expected: V3) -> f64 {
    (0..3).map(|c| (found[c] / expected[c] - 1.0).abs()).fold(0.0, f64::max)
}

fn below(what: &str, error: f64, limit: f64) {
    eprintln!("{what}: {error:.2e} (limit {limit:.1e})");
    assert!(error < limit, "{what}: {error:.3e} is not below {limit:.1e}");
}

/// The radiosity of the closed forms: the kernel over a rectangle in the plane y = 0, under a constant irradiance.
fn rectangle(channels: &[Channel; 3], x: [f64; 2], z: [f64; 2], receiver: V3) -> V3 {
    let corner = |i: usize, j: usize| [x[i], 0.0, z[j]];
    channels.map(|c| {
        c.triangle([corner(0, 0), corner(0, 1), corner(1, 1)], receiver)
            + c.triangle([corner(0, 0), corner(1, 1), corner(1, 0)], receiver)
    })
}

#[test]
fn dipole_integrals_agree_with_each_other() {
    let channel = material("marble").channels()[1];
    let radial = |r: f64| {
        let (n, mut sum) = (4000, 0.0);
        for i in 0..n {
            let rho = r * (f64::from(i) + 0.5) / f64::from(n);
            sum += 2.0 * PI * rho * channel.r_d(rho * rho) * r / f64::from(n);
        }
        sum
    };
    below("disc of 5 mm", (channel.disc(5.0) / radial(5.0) - 1.0).abs(), 1e-5);
    below("plane", (channel.disc(400.0) / channel.total() - 1.0).abs(), 1e-9);
    // Published reflectance of marble, two digits.
    assert!((channel.total() - 0.79).abs() < 0.01);
}

#[test]
fn closed_form_of_a_triangle_agrees_with_brute_subdivision() {
    fn brute(c: &Channel, p: &Patch, x: V3, depth: u32) -> f64 {
        if depth == 0 {
            let d = oracle::vector::sub(x, p.centroid);
            return p.area * c.r_d(oracle::vector::dot(d, d));
        }
        p.bisected().iter().map(|half| brute(c, half, x, depth - 1)).sum()
    }
    let corners = [[0.0, 0.0, 0.0], [0.9, 0.1, 0.2], [0.2, 0.8, -0.1]];
    let patch = Patch::new(corners);
    let channel = material("marble").channels()[0];
    for x in [corners[0], corners[2], patch.centroid, patch.point([-0.5, 0.7, 0.8]), [0.3, 0.3, 0.9], [3.0, 1.0, -2.0]]
    {
        let (closed, summed) = (channel.triangle(corners, x), brute(&channel, &patch, x, 18));
        below(&format!("triangle seen from {x:?}"), (closed / summed - 1.0).abs(), 2e-5);
    }
}

#[test]
fn box_tree_misses_nothing_that_a_loop_over_triangles_finds() {
    let mesh = OracleMesh::torus(6.0, 2.0, 24, 12).joined(&OracleMesh::icosphere(2, 3.0));
    let tree = Blockers::new(&mesh);
    let (mut free, mut blocked, mut some) = (0, 0, 0);
    for i in 0..20_000u64 {
        let random = |k: u64| unit(hash(i, k));
        let own = (random(0) * mesh.triangles.len() as f64) as usize;
        let origin = Patch::new(mesh.corners(own)).point([0.2, 0.3, 0.5]);
        // Every third along an axis, where a slab test divides by zero; every second of finite reach.
        let mut direction = [random(1) - 0.5, random(2) - 0.5, random(3) - 0.5];
        if i % 3 == 0 {
            direction = [0.0, 0.0, 0.0];
            direction[(i / 3 % 3) as usize] = if i % 2 == 0 { 1.0 } else { -1.0 };
        }
        let reach = if i % 2 == 0 { f64::INFINITY } else { 8.0 };
        let ray = Ray { origin, direction, reach };
        let sees = tree.sees(own as u32, ray);
        assert_eq!(sees, tree.sees_by_loop(own as u32, ray), "ray {i}");
        if sees {
            free += 1;
        } else {
            blocked += 1;
        }
        // With others from elsewhere on its triangle, which go another way or to a place that all share.
        if i % 16 == 0 {
            let at = [random(4) * 20.0 - 10.0, random(5) * 20.0 - 10.0, random(6) * 20.0 - 10.0];
            let rays: [Ray; 16] = std::array::from_fn(|k| {
                let (a, b) = (0.9 * random(10 + k as u64), 0.1 * random(30 + k as u64));
                let origin = Patch::new(mesh.corners(own)).point([a, b, 1.0 - a - b]);
                let direction = if i % 32 == 0 { oracle::vector::sub(at, origin) } else { direction };
                Ray { origin, direction, reach: if i % 32 == 0 { 1.0 } else { reach } }
            });
            let one_by_one = rays.iter().filter(|ray| tree.sees_by_loop(own as u32, **ray)).count();
            assert_eq!(tree.count_free(own as u32, rays), one_by_one, "rays beside ray {i}");
            some += usize::from((1..16).contains(&one_by_one));
        }
    }
    assert!(free > 2000 && blocked > 2000 && some > 20, "{free} free, {blocked} blocked, {some} in part");
}

#[test]
fn readers_take_what_the_data_holds() {
    let text = "# a comment\nv 0 0 0\nv 1 0 0 0.5\nvn 0 0 1\nv 1 1 0\nv 0 1 0\nf 1/2/1 2//1 3 4\nf -4 -3 -2\n";
    let mesh = OracleMesh::parse_obj(text, "text");
    assert_eq!(mesh.positions.len(), 4);
    assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3], [0, 1, 2]]);
    let scaled = mesh.scaled(10.0);
    assert!((scaled.positions[2][0] - 10.0 / 2.0_f64.sqrt()).abs() < 1e-12);
    // Eight pixels: one row by runs and literals, one flat.
    let mut bytes = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 8\n".to_vec();
    bytes.extend([2, 2, 0, 8, 136, 64, 4, 1, 2, 3, 4, 132, 9, 136, 0, 136, 129]);
    for k in 0..8 {
        bytes.extend([k * 10, 0, 200, 136]);
    }
    let (width, height, pixels) = oracle::hdr::parse_hdr(&bytes);
    assert_eq!((width, height), (8, 2));
    assert_eq!((pixels[0], pixels[5]), ([0.5, 1.0 / 128.0, 0.0], [0.5, 9.0 / 128.0, 0.0]));
    assert_eq!(pixels[11], [30.0, 0.0, 200.0]);
}

#[test]
fn fresnel_has_its_known_values() {
    assert!((fresnel_transmittance(1.5, 1.0) - 0.96).abs() < 1e-15);
    assert!((fresnel_transmittance(1.0, 0.3) - 1.0).abs() < 1e-15);
    assert_eq!(fresnel_transmittance(1.5, 0.0), 0.0);
    // Beyond the critical angle of the thinner medium nothing enters.
    assert_eq!(fresnel_transmittance(0.5, 0.8), 0.0);
    // Brewster's angle: only the s wave is reflected, by ((eta^2 - 1) / (eta^2 + 1))^2.
    let eta: f64 = 1.5;
    let s = ((eta * eta - 1.0) / (eta * eta + 1.0)).powi(2);
    assert!((fresnel_transmittance(eta, 1.0 / (1.0 + eta * eta).sqrt()) - (1.0 - 0.5 * s)).abs() < 1e-14);
    // Diffuse reflection at the outside of glass, 9.2 %.
    assert!((material("marble").diffuse_transmittance() - 0.908).abs() < 1e-3);
}

#[test]
fn plane_under_directional_light_at_every_place_of_a_triangle() {
    let mesh = OracleMesh::plane(60.0, 12);
    for name in ["marble", "spectralon", "ketchup"] {
        let m = material(name);
        let lights = [OracleLight::Directional { from: [0.0, 2.0, 1.0], irradiance: [1.0, 2.0, 3.0] }];
        let oracle = Oracle::new(&mesh, &m, &lights, OracleSettings::default());
        let mu = 2.0 / 5.0_f64.sqrt();
        let e = mu * fresnel_transmittance(m.eta, mu);
        // A vertex, the middle of an edge, an interior point, a corner of the sheet.
        for x in [[0.0; 3], [2.5, 0.0, 0.0], [1.1, 0.0, 1.7], [30.0, 0.0, 30.0]] {
            let expected = rectangle(&m.channels(), [-30.0, 30.0], [-30.0, 30.0], x);
            let expected = [expected[0] * e, expected[1] * 2.0 * e, expected[2] * 3.0 * e];
            let (found, _) = oracle.at_point(x, &OracleSettings::default());
            below(&format!("{name} plane at {x:?}"), worst_relative(found, expected), 3e-4);
        }
    }
}

#[test]
fn plane_under_constant_light() {
    let mesh = OracleMesh::plane(60.0, 40);
    let m = material("marble");
    let lights = [OracleLight::Constant { radiance: [1.0, 2.0, 0.5] }];
    let oracle = Oracle::new(&mesh, &m, &lights, OracleSettings::default());
    let e = PI * m.diffuse_transmittance();
    let vertex = 20 * 41 + 20;
    let r = rectangle(&m.channels(), [-30.0, 30.0], [-30.0, 30.0], [0.0; 3]);
    let expected = [r[0] * e, r[1] * 2.0 * e, r[2] * 0.5 * e];
    let (found, error) = oracle.radiosity_with_error(vertex);
    below("plane under constant light", worst_relative(found, expected), 1e-3);
    below("and the error it states", (0..3).map(|c| error[c] / found[c]).fold(0.0, f64::max), 3e-3);
}

#[test]
fn plane_below_a_point_light() {
    let mesh = OracleMesh::plane(80.0, 16);
    let m = material("marble");
    let height = 1.5;
    let lights = [OracleLight::Point { at: [0.0, height, 0.0], intensity: GREY }];
    let oracle = Oracle::new(&mesh, &m, &lights, OracleSettings::default());
    let expected = m.channels().map(|c| {
        // Radial quadrature in t with rho = t / (1 - t).
        gauss_legendre(200)
            .iter()
            .map(|(x, w)| {
                let t = 0.5 * (1.0 + x);
                let rho = t / (1.0 - t);
                let d2 = rho * rho + height * height;
                let mu = height / d2.sqrt();
                let e = mu * fresnel_transmittance(m.eta, mu) / d2;
                0.5 * w * 2.0 * PI * rho * c.r_d(rho * rho) * e / (1.0 - t).powi(2)
            })
            .sum()
    });
    let (found, _) = oracle.radiosity_with_error(8 * 17 + 8);
    below("plane below a point light", worst_relative(found, expected), 5e-4);
}

#[test]
fn edge_of_a_shadow_agrees_with_the_lit_rest() {
    // A lid above the plane, lit straight from above: its shadow is the rectangle below it.
    let lid = OracleMesh {
        positions: vec![[0.13, 3.0, -9.0], [0.13, 3.0, 7.0], [11.0, 3.0, 7.0], [11.0, 3.0, -9.0]],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
    };
    let plane = OracleMesh::plane(40.0, 16);
    let lights = [OracleLight::Directional { from: [0.0, 1.0, 0.0], irradiance: GREY }];
    for name in ["marble", "spectralon"] {
        let m = material(name);
        let channels = m.channels();
        // The lid receives light as well; its share is known in closed form.
        let lid_corners = [lid.corners(0), lid.corners(1)];
        let own: Vec<usize> = (0..plane.triangles.len()).collect();
        let oracle = Oracle::new(&plane.joined(&lid), &m, &lights, OracleSettings::default());
        let e = fresnel_transmittance(m.eta, 1.0);
        for x in [[0.0, 0.0, 0.0], [0.13, 0.0, 1.0], [-0.5, 0.0, 0.3], [0.4, 0.0, -2.2], [5.0, 0.0, 0.0]] {
            let all = rectangle(&channels, [-20.0, 20.0], [-20.0, 20.0], x);
            let shadow = rectangle(&channels, [0.13, 11.0], [-9.0, 7.0], x);
            let from_lid = channels.map(|c| lid_corners.iter().map(|&t| c.triangle(t, x)).sum::<f64>());
            let expected: V3 = std::array::from_fn(|c| e * (all[c] - shadow[c] + from_lid[c]));
            let (found, _) = oracle.at_point(x, &OracleSettings::default());
            // Against what the fully lit plane would give: the error measure has no use for a share of darkness.
            let error = (0..3).map(|c| (found[c] - expected[c]).abs() / (e * all[c])).fold(0.0, f64::max);
            below(&format!("{name} beside the shadow at {x:?}"), error, 5e-4);
            if x == [0.0; 3] {
                let (vertex, expected) = (8 * 17 + 8, e * (all[0] - shadow[0]));
                let found = oracle.radiosity_through(vertex, &own)[0];
                below(&format!("{name}, the plane alone"), (found - expected).abs() / (e * all[0]), 5e-4);
            }
        }
    }
}

#[test]
fn sphere_under_constant_light_is_the_disc_of_twice_its_radius() {
    let mesh = OracleMesh::icosphere(4, 10.0);
    let m = material("skin1");
    let oracle = Oracle::new(&mesh, &m, &[OracleLight::Constant { radiance: GREY }], OracleSettings::default());
    let e = PI * m.diffuse_transmittance();
    let vertices: Vec<usize> = (0..mesh.positions.len()).step_by(193).collect();
    let all = oracle.radiosities(&vertices);
    // The polyhedron itself is convex, so every facet receives the same and the kernel's integral is closed.
    let green = m.channels()[1];
    let facets = |x: V3| e * (0..mesh.triangles.len()).map(|t| green.triangle(mesh.corners(t), x)).sum::<f64>();
    let exact: Vec<f64> = vertices.iter().zip(&all).map(|(&v, &b)| b[1] / facets(mesh.positions[v]) - 1.0).collect();
    let worst = exact.iter().fold(0.0_f64, |a, e| a.max(e.abs()));
    below("sphere against the sum over its facets", worst, 8e-4);
    below("and the mean of that", (exact.iter().sum::<f64>() / exact.len() as f64).abs(), 2e-4);
    // Equal areas of a sphere lie between equal steps of the squared chord, so its integral is that of a disc.
    let expected = m.channels().map(|c| e * c.disc(20.0));
    let worst = all.iter().map(|&b| worst_relative(b, expected)).fold(0.0, f64::max);
    below("sphere against its closed form (faceting included)", worst, 3e-3);
    let spread = all.iter().map(|&b| worst_relative(b, all[0])).fold(0.0, f64::max);
    below("sphere, vertex against vertex", spread, 1e-3);
}

#[test]
fn torus_follows_its_symmetry_and_dims_inside() {
    let mesh = OracleMesh::torus(6.0, 2.0, 48, 24);
    let oracle =
        Oracle::new(&mesh, &material("marble"), &[OracleLight::Constant { radiance: GREY }], OracleSettings::default());
    let outer = oracle.radiosities(&[0, 12 * 24, 24 * 24, 36 * 24]);
    let spread = outer.iter().map(|&b| worst_relative(b, outer[0])).fold(0.0, f64::max);
    below("torus, quarter turns", spread, 2e-3);
    let inner = oracle.radiosity(12);
    assert!(inner[2] < 0.95 * outer[0][2], "the hole must be darker: {inner:?} against {:?}", outer[0]);
}

#[test]
fn area_light_is_the_sum_of_its_points() {
    let mesh = OracleMesh::plane(30.0, 30);
    let m = material("marble");
    let (width, depth) = (6.0, 2.0);
    let shine = |normal: V3| OracleLight::Area {
        at: [1.0, 4.0, 0.5],
        normal,
        first_edge: Some([0.0, 0.0, 1.0]),
        size: [width, depth],
        radiance: [1.0, 2.0, 3.0],
    };
    let vertex = 15 * 31 + 15;
    let down = Oracle::new(&mesh, &m, &[shine([0.0, -1.0, 0.0])], OracleSettings::default()).radiosity(vertex);
    let up = Oracle::new(&mesh, &m, &[shine([0.0, 1.0, 0.0])], OracleSettings::default()).radiosity(vertex);
    assert_eq!(up, [0.0; 3], "the back of an area light is dark");
    // Midpoints of a fine lattice over plane and lamp; R_d by closed form within each cell of the plane.
    let mut expected = [0.0; 3];
    let channels = m.channels();
    let (cells, n) = (120, 12);
    for i in 0..cells {
        for j in 0..cells {
            let edge = 30.0 / f64::from(cells);
            let lo = [f64::from(i) * edge - 15.0, f64::from(j) * edge - 15.0];
            let p = [lo[0] + 0.5 * edge, 0.0, lo[1] + 0.5 * edge];
            let mut e = 0.0;
            for k in 0..n * n {
                let s = [(f64::from(k % n) + 0.5) / f64::from(n) - 0.5, (f64::from(k / n) + 0.5) / f64::from(n) - 0.5];
                let to = [1.0 + depth * s[0] - p[0], 4.0, 0.5 + width * s[1] - p[2]];
                let d2 = oracle::vector::dot(to, to);
                let mu = 4.0 / d2.sqrt();
                e += fresnel_transmittance(m.eta, mu) * mu * mu / d2 * width * depth / f64::from(n * n);
            }
            for c in 0..3 {
                let r2 = p[0] * p[0] + p[2] * p[2];
                let kernel = if r2 > 9.0 {
                    channels[c].r_d(r2) * edge * edge
                } else {
                    rectangle(&channels, [lo[0], lo[0] + edge], [lo[1], lo[1] + edge], [0.0; 3])[c]
                };
                expected[c] += [1.0, 2.0, 3.0][c] * e * kernel;
            }
        }
    }
    below("area light", worst_relative(down, expected), 2e-3);
}

#[test]
fn environment_keeps_its_orientation_and_energy() {
    let mesh = OracleMesh::icosphere(2, 10.0);
    let m = material("marble");
    let (width, height) = (256, 128);
    let vertices = [0, 5, 30, 100];
    let settings = OracleSettings::default();
    let environment = |pixels: Vec<[f32; 3]>, rotate_degrees: f64| OracleLight::Environment {
        width,
        height,
        pixels,
        rotate_degrees,
        scale: [2.0; 3],
    };
    let flat = Oracle::new(&mesh, &m, &[environment(vec![[1.0; 3]; width * height], 30.0)], settings);
    let constant = Oracle::new(&mesh, &m, &[OracleLight::Constant { radiance: [2.0; 3] }], settings);
    for v in vertices {
        below("flat environment", worst_relative(flat.radiosity(v), constant.radiosity(v)), 3e-3);
    }
    // A few pixels about an axis, resolved as directions or sampled as a part of the sky, must come from where the
    // words put them.
    let block = |column: usize| vec![(column - 1, 63), (column, 63), (column - 1, 64), (column, 64)];
    let places = [
        (block(128), 0.0, [0.0, 0.0, 1.0]),
        (block(64), 0.0, [1.0, 0.0, 0.0]),
        (block(128), 90.0, [1.0, 0.0, 0.0]),
        (block(64), 90.0, [0.0, 0.0, -1.0]),
        (block(192), 45.0, [-1.0, 0.0, 1.0]),
        ((0..width).map(|column| (column, 0)).collect(), 10.0, [0.0, 1.0, 0.0]),
    ];
    for (block, rotate, from) in places {
        let mut pixels = vec![[0.0; 3]; width * height];
        let step = PI / height as f64;
        let mut irradiance = 0.0;
        for &(column, row) in &block {
            pixels[row * width + column] = [50.0; 3];
            irradiance += 100.0 * step * ((row as f64 * step).cos() - ((row + 1) as f64 * step).cos());
        }
        let light = OracleLight::Directional { from, irradiance: [irradiance; 3] };
        let expected = Oracle::new(&mesh, &m, &[light], settings).radiosities(&vertices);
        let mean = expected.iter().map(|b| b[0]).sum::<f64>() / expected.len() as f64;
        for sharp_pixel_share in [5e-3, 2.0] {
            let settings = OracleSettings { sharp_pixel_share, ..settings };
            let found = Oracle::new(&mesh, &m, &[environment(pixels.clone(), rotate)], settings).radiosities(&vertices);
            let error = (0..4).map(|i| (found[i][0] - expected[i][0]).abs() / mean).fold(0.0, f64::max);
            below(&format!("pixels from {from:?}, turned by {rotate}"), error, 1e-2);
        }
    }
}

#[test]
fn same_numbers_on_any_thread_count() {
    let mesh = OracleMesh::torus(6.0, 2.0, 16, 8);
    let lights =
        [OracleLight::Constant { radiance: GREY }, OracleLight::Point { at: [0.0, 9.0, 4.0], intensity: [30.0; 3] }];
    let with = |threads| {
        let settings = OracleSettings { threads, ..OracleSettings::default() };
        Oracle::new(&mesh, &material("marble"), &lights, settings).radiosities(&[0, 3, 17])
    };
    assert_eq!(with(1), with(3));
}

fn sun(from: V3, irradiance: V3) -> Option<OracleLight> {
    Some(OracleLight::Directional { from, irradiance })
}

fn lamp() -> Option<OracleLight> {
    Some(OracleLight::Point { at: [-18.0, 22.0, 25.0], intensity: [900.0; 3] })
}

fn check(case: &Case) {
    if let Some(error) = compare(case) {
        below(case.file, error, case.limit);
    }
}

fn long() -> bool {
    let long = std::env::var("TRANSLUX_LONG").is_ok_and(|v| v == "1");
    if !long {
        eprintln!("SKIPPED: set TRANSLUX_LONG=1");
    }
    long
}

#[test]
fn truth_bunny_marble_directional() {
    check(&Case {
        file: "bunny_3k_30mm_marble_directional",
        mesh: "bunny_3k",
        size_mm: 30.0,
        medium: "marble",
        light: || sun([0.4, 0.7, 0.6], [3.0; 3]),
        limit: 3e-3,
    });
}

#[test]
fn truth_bunny_skin_point() {
    check(&Case {
        file: "bunny_3k_30mm_skin1_point",
        mesh: "bunny_3k",
        size_mm: 30.0,
        medium: "skin1",
        light: lamp,
        limit: 3e-3,
    });
}

#[test]
fn truth_igea_skin_directional() {
    check(&Case {
        file: "igea_8k_10mm_skin1_directional",
        mesh: "igea_8k",
        size_mm: 10.0,
        medium: "skin1",
        light: || sun([0.0, 0.2, 1.0], [3.0; 3]),
        limit: 3e-3,
    });
}

#[test]
fn truth_bunny_marble_constant() {
    if long() {
        check(&Case {
            file: "bunny_3k_30mm_marble_constant",
            mesh: "bunny_3k",
            size_mm: 30.0,
            medium: "marble",
            light: || Some(OracleLight::Constant { radiance: GREY }),
            limit: 3e-3,
        });
    }
}

#[test]
fn truth_environments() {
    if long() {
        check(&Case {
            file: "bunny_3k_30mm_marble_env_debevec_uffizi_256",
            mesh: "bunny_3k",
            size_mm: 30.0,
            medium: "marble",
            light: || environment("debevec_uffizi_256.hdr", 0.0),
            limit: 1.5e-2,
        });
        check(&Case {
            file: "bunny_3k_30mm_skin1_env_noon_grass_1k",
            mesh: "bunny_3k",
            size_mm: 30.0,
            medium: "skin1",
            light: || environment("noon_grass_1k.hdr", 90.0),
            limit: 1.5e-2,
        });
    }
}

#[test]
fn truth_large_meshes() {
    if long() {
        let bunny =
            |file, medium, light| Case { file, mesh: "bunny_closed", size_mm: 30.0, medium, light, limit: 3e-3 };
        check(&bunny("bunny_closed_30mm_marble_directional", "marble", || sun([0.4, 0.7, 0.6], [3.0; 3])));
        check(&bunny("bunny_closed_30mm_spectralon_directional", "spectralon", || sun([0.4, 0.7, 0.6], [3.0; 3])));
        check(&bunny("bunny_closed_30mm_ketchup_point", "ketchup", lamp));
        check(&Case {
            file: "horse_100mm_cream_directional",
            mesh: "horse",
            size_mm: 100.0,
            medium: "cream",
            light: || sun([-0.5, 0.3, 0.8], [1.0, 2.0, 3.0]),
            limit: 3e-3,
        });
    }
}
