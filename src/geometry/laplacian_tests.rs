#![allow(clippy::unwrap_used)]

use std::f64::consts::PI;

use super::*;
use crate::geometry::shapes;
use crate::geometry::source::SourceModel;
use crate::math::sparse::bands::for_each_band;
use crate::progress::Silent;

fn of(model: &SourceModel) -> Laplacian {
    let corners = |t: &[u32; 3]| (*t, t.map(|v| model.positions[v as usize]));
    Laplacian::new(model.positions.len(), model.triangles.iter().map(corners))
}

fn eigenvalues(laplacian: &Laplacian, below: f64) -> Vec<f64> {
    let matrix = laplacian.symmetrised();
    let mut all = Vec::new();
    for component in matrix.components() {
        let found = for_each_band(&matrix.block(&component), below, &Silent, |band| {
            all.extend(&band.values);
            Ok(())
        });
        let found = found.unwrap();
        assert!(found.residual < 1e-9 && found.orthogonality < 1e-8, "{found:?}");
    }
    all.sort_by(f64::total_cmp);
    all
}

#[test]
fn a_sphere_has_its_eigenvalues() {
    let radius = 3.0;
    let laplacian = of(&shapes::icosphere(radius, 4));
    let bands = 12;
    let exact = |l: usize| (l * (l + 1)) as f64 / (radius * radius);
    let found = eigenvalues(&laplacian, 0.5 * (exact(bands) + exact(bands + 1)));
    assert_eq!(found.len(), (bands + 1) * (bands + 1));
    assert!(found[0].abs() < 1e-9);
    for (k, value) in found.iter().enumerate().skip(1) {
        let l = k.isqrt();
        // The error of linear elements grows with the eigenvalue times the square of an edge.
        let error = (value / exact(l) - 1.0).abs();
        assert!(error < 0.1 * exact(l) * laplacian.mean_edge_mm.powi(2), "{k}: {value} for {}", exact(l));
    }
}

/// Triangles of a square torus without curvature: corners are laid out triangle by triangle.
fn flat_torus(side: u32, size: f64, shear: f64) -> Laplacian {
    let step = size / f64::from(side);
    let name = |x: u32, y: u32| (x % side) + (y % side) * side;
    // Points move inside the plane, so that some triangles are obtuse; the torus stays flat.
    let at = |x: u32, y: u32| {
        let wave = |i: u32| shear * step * (2.0 * PI * f64::from(i % side) * 5.0 / f64::from(side)).sin();
        DVec3::new(f64::from(x) * step + wave(y), f64::from(y) * step + wave(x), 0.0)
    };
    let mut triangles = Vec::new();
    for y in 0..side {
        for x in 0..side {
            let corners = [(x, y), (x + 1, y), (x + 1, y + 1), (x, y + 1)];
            for t in [[0, 1, 2], [0, 2, 3]] {
                triangles
                    .push((t.map(|i| name(corners[i].0, corners[i].1)), t.map(|i| at(corners[i].0, corners[i].1))));
            }
        }
    }
    Laplacian::new((side * side) as usize, triangles.into_iter())
}

#[test]
fn a_flat_torus_has_its_eigenvalues_obtuse_triangles_or_not() {
    let size = 10.0;
    let unit = (2.0 * PI / size).powi(2);
    let mut expected: Vec<f64> =
        (-9i32..=9).flat_map(|a| (-9..=9).map(move |b| unit * f64::from(a * a + b * b))).collect();
    expected.sort_by(f64::total_cmp);
    for shear in [0.0, 0.45] {
        let laplacian = flat_torus(48, size, shear);
        let negative = (0..laplacian.len()).any(|row| laplacian.stiffness.row(row).any(|(_, value)| value > 1e-9));
        assert_eq!(negative, shear > 0.0, "obtuse triangles");
        let area: f64 = laplacian.mass_mm2.iter().sum();
        assert!((area / (size * size) - 1.0).abs() < 1e-12);
        let found = eigenvalues(&laplacian, 20.5 * unit);
        let count = expected.iter().filter(|v| **v < 20.5 * unit).count();
        assert_eq!(found.len(), count, "{shear}");
        for (value, exact) in found.iter().zip(&expected).skip(1) {
            assert!((value / exact - 1.0).abs() < 0.05, "{shear}: {value} for {exact}");
        }
    }
}

/// Constants are in the null space of each part, and nothing is negative.
#[test]
fn each_part_has_one_null_vector() {
    let ball = shapes::icosphere(1.0, 2);
    let open = shapes::plane(2.0, 3.0, 6);
    let three = shapes::compose(&[(ball.clone(), DVec3::ZERO), (open, DVec3::X * 5.0), (ball, DVec3::Y * 7.0)]);
    let found = eigenvalues(&of(&three), 1.5);
    assert_eq!(found.iter().filter(|v| v.abs() < 1e-9).count(), 3, "{found:?}");
    // The plane of 2 by 3 whose edges let nothing out: (pi / 3)^2.
    assert!((found[3] / (PI / 3.0).powi(2) - 1.0).abs() < 0.05, "{found:?}");
    assert!(found.iter().all(|v| *v > -1e-9));
}

#[test]
fn odd_triangles_leave_no_trace() {
    let mut model = shapes::icosphere(1.0, 2);
    let plain = of(&model);
    let first = model.positions.len() as u32;
    // A vertex that nothing uses, one on an edge of a triangle without area, and one very near another.
    let edge = model.triangles[0];
    let [a, b] = [model.positions[edge[0] as usize], model.positions[edge[1] as usize]];
    model.positions.extend([DVec3::splat(f64::NAN), 0.5 * (a + b), a + 1e-9 * b]);
    model.triangles.extend([[edge[0], first + 1, edge[1]], [edge[0], edge[0], edge[1]], [edge[0], first + 2, edge[1]]]);
    let odd = of(&model);
    assert_eq!((odd.flat_triangles, odd.len()), (3, plain.len()));
    assert_eq!((&odd.stiffness, &odd.mass_mm2), (&plain.stiffness, &plain.mass_mm2));
    assert_eq!(odd.at_vertices(&odd.at_nodes(&vec![1; model.positions.len()]), 7)[first as usize..], [7, 7, 7]);
    // A fin makes an edge of three triangles.
    model.positions.push(1.5 * (a + b));
    model.triangles.push([edge[0], edge[1], first + 3]);
    let found = eigenvalues(&of(&model), 10.0);
    assert!(found[0].abs() < 1e-9 && found[1] > 0.01 && found.iter().all(|v| v.is_finite()));
    assert!(Laplacian::new(0, std::iter::empty()).is_empty());
}

#[test]
fn diffusion_damps_harmonics_of_a_sphere() {
    let radius = 2.0;
    let model = shapes::icosphere(radius, 5);
    let laplacian = of(&model);
    let t = 1.3;
    let harmonics = |p: &DVec3| [1.0, p.x / radius, (3.0 * p.y * p.y - radius * radius) / (radius * radius)];
    let before: Vec<[f64; 3]> = laplacian.at_nodes(&model.positions.iter().map(harmonics).collect::<Vec<_>>());
    let mut after = vec![[0.0; 3]; before.len()];
    let solved = laplacian.diffused(t, &before, &mut after, 1e-9);
    assert!(solved.residual <= 1e-9, "{solved:?}");
    let response = |l: f64| 1.0 / (1.0 + t * l * (l + 1.0) / (radius * radius));
    for (before, after) in before.iter().zip(&after) {
        assert!((after[0] - 1.0).abs() < 1e-6);
        assert!(
            (after[1] - before[1] * response(1.0)).abs() < 2e-3 && (after[2] - before[2] * response(2.0)).abs() < 1e-2
        );
    }
}
