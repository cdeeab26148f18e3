use std::f64::consts::{FRAC_1_PI, PI};

use super::*;
use crate::geometry::shapes;
use crate::geometry::source::SourceModel;
use crate::math::quadrature::integrate;
use crate::math::random::uniform;
use crate::medium::fresnel::diffuse_transmittance;
use crate::medium::material::OpticalProperties;
use crate::progress::Silent;
use crate::transport::test_scene::{Fixture, named};

fn of_eta(eta: f64) -> OpticalProperties {
    OpticalProperties { eta_inside_over_outside: eta, ..named("marble") }
}

fn matrix(fixture: &Fixture, rays: u32) -> InterReflection {
    let etas: Vec<f64> = fixture.scene.media.iter().map(|m| m.properties.eta_inside_over_outside).collect();
    InterReflection::new(&fixture.surface(), &etas, rays, &Silent)
}

/// A value for each vertex by its place relative to the origin of the mesh.
fn field(fixture: &Fixture, of: impl Fn(DVec3) -> f64) -> Vec<DVec3> {
    fixture.scene.mesh.local_mm.iter().map(|p| DVec3::splat(of(p.as_dvec3()))).collect()
}

/// `Int B dA` of values that are linear on triangles.
fn power(fixture: &Fixture, radiosity: &[DVec3]) -> DVec3 {
    fixture.scene.domain().vertex_areas_mm2().iter().zip(radiosity).map(|(area, b)| *area * *b).sum()
}

fn mean(fixture: &Fixture, irradiance: &[DVec3]) -> f64 {
    let area: f64 = fixture.patches.iter().map(|p| p.area_mm2).sum();
    fixture.flux(irradiance).x / area
}

/// Irradiance for a radiosity of 1 inside a hollow sphere, where both ends of every ray have one cosine.
fn hollow_sphere(eta: f64) -> f64 {
    let twice = |mu: f64| 2.0 * transmittance(eta, mu).powi(2) * mu;
    (0..8).map(|i| integrate(twice, f64::from(i) / 8.0, f64::from(i + 1) / 8.0, 1e-12)).sum::<f64>()
        / diffuse_transmittance(eta)
}

#[test]
fn in_a_closed_cavity_all_light_comes_back() {
    for eta in [1.0, 1.3, 1.5, 0.8] {
        let cavity = shapes::inside_out(shapes::icosphere(10.0, 4));
        let shell = shapes::compose(&[(cavity, DVec3::ZERO), (shapes::icosphere(14.0, 2), DVec3::ZERO)]);
        let fixture = Fixture::new(shell, of_eta(eta), 8000);
        let matrix = matrix(&fixture, 64);
        let back = matrix.apply(&field(&fixture, |_| 1.0), Rays::All);
        let expected = hollow_sphere(eta);
        let (mut worst, mut sum, mut count) = (0.0_f64, 0.0, 0);
        for (patch, e) in fixture.patches.iter().zip(&back) {
            if patch.centre_mm.length() > 11.0 {
                assert_eq!(*e, DVec3::ZERO, "the outer side is convex");
                continue;
            }
            (worst, sum, count) = (worst.max((e.x / expected - 1.0).abs()), sum + e.x, count + 1);
        }
        let mean = sum / f64::from(count);
        println!("eta {eta}: {mean:.6} expected {expected:.6} worst {worst:.1e}, {} arrivals", matrix.arrivals.len());
        // Facets are tilted a little, which counts where F_t is steep: at the critical angle of eta < 1.
        let (most, most_of_one) = if eta < 1.0 { (1e-2, 0.08) } else { (1e-3, 0.03) };
        assert!(count > 2000 && (mean / expected - 1.0).abs() < most, "{mean} {expected}");
        assert!(worst < most_of_one, "{worst}");
        if eta == 1.0 {
            // Every ray arrives, whatever its direction, and they all weigh the same.
            assert!(expected == 1.0 && worst < 1e-12 && matrix.arrivals.len() == 64 * count as usize, "{worst}");
        }
    }
}

#[test]
fn power_is_kept_in_a_closed_cavity_and_never_gained() {
    let of = |p: DVec3| (1.0 + 0.07 * p.x - 0.02 * p.y).max(0.0) + if p.z > 8.0 { 5.0 } else { 0.0 };
    let rows = [
        (shapes::inside_out(shapes::icosphere(10.0, 4)), 1.0, 1.0),
        (shapes::inside_out(shapes::cuboid(DVec3::new(16.0, 12.0, 18.0), 12)), 1.0, 1.0),
        (shapes::inside_out(shapes::cuboid(DVec3::new(16.0, 12.0, 18.0), 12)), 1.5, 0.96),
        (shapes::bumpy_head(10.0, 4), 1.3, 0.2),
        (shapes::torus(10.0, 5.0, 64, 32), 1.5, 0.3),
    ];
    for (model, eta, most) in rows {
        let fixture = Fixture::new(model, of_eta(eta), 12_000);
        let radiosity = field(&fixture, of);
        let (sent, back) =
            (power(&fixture, &radiosity), fixture.flux(&matrix(&fixture, 64).apply(&radiosity, Rays::All)));
        let share = back.x / sent.x;
        println!("eta {eta}: {share:.6} of the power comes back");
        assert!(share > 0.0 && share < most + 2e-3, "{share}");
        if most == 1.0 {
            assert!((share - 1.0).abs() < 2e-3, "{share}");
        }
    }
}

#[test]
fn nothing_falls_on_a_convex_body() {
    let models = [
        shapes::icosphere(10.0, 4),
        shapes::icosphere(1e-3, 3),
        shapes::icosphere(1e5, 3),
        shapes::cuboid(DVec3::new(3.0, 5.0, 7.0), 6),
        shapes::plane(10.0, 10.0, 20),
        shapes::uv_sphere(4.0, 64, 200),
    ];
    for model in models {
        let fixture = Fixture::new(model, named("marble"), 3000);
        let matrix = matrix(&fixture, 64);
        assert!(matrix.is_empty() && matrix.samples() == fixture.samples.len());
        assert!(matrix.apply(&field(&fixture, |_| 1.0), Rays::All).iter().all(|e| *e == DVec3::ZERO));
    }
}

/// Two squares of side 10 that face each other, as the form factor of equal parallel squares has it.
fn plates(distance: f64, divisions: u32) -> (SourceModel, f64) {
    let low = shapes::plane(10.0, 10.0, divisions);
    let high = shapes::inside_out(low.clone());
    let x = 10.0 / distance;
    let (x2, root) = (x * x, (1.0 + x * x).sqrt());
    let sum =
        0.5 * ((1.0 + x2).powi(2) / (1.0 + 2.0 * x2)).ln() + 2.0 * x * root * (x / root).atan() - 2.0 * x * x.atan();
    let factor = 2.0 * FRAC_1_PI / x2 * sum;
    (shapes::compose(&[(low, DVec3::ZERO), (high, DVec3::Y * distance)]), factor)
}

#[test]
fn two_plates_have_the_form_factor_of_parallel_squares() {
    // Far apart a fiftieth of the rays meets anything.
    let rows = [(10.0, 0.1998, 2e-3), (1.0, 0.8270, 1e-3), (40.0, f64::NAN, 1e-2), (0.05, f64::NAN, 2e-3)];
    for (distance, known, most) in rows {
        let (model, factor) = plates(distance, 6);
        assert!(known.is_nan() || (factor - known).abs() < 1e-3, "{factor} {known}");
        let fixture = Fixture::new(model.clone(), of_eta(1.0), 4000);
        let found = mean(&fixture, &matrix(&fixture, 64).apply(&field(&fixture, |_| 1.0), Rays::All));
        println!("{distance}: {found:.6} closed {factor:.6}");
        assert!((found / factor - 1.0).abs() < most, "{distance}: {found} {factor}");
        // From behind there is nothing to see.
        let away = Fixture::new(shapes::inside_out(model), of_eta(1.0), 500);
        assert!(matrix(&away, 64).is_empty());
    }
}

#[test]
fn opaque_parts_and_inner_sides_send_nothing_and_hide_what_is_behind() {
    let (model, _) = plates(5.0, 2);
    let first_of_high = model.triangles.len() / 2;
    let fixture = Fixture::with_opaque(model.clone(), first_of_high, of_eta(1.3), 500);
    assert!(matrix(&fixture, 64).is_empty());
    // A screen between them, either way round.
    for screen in [shapes::plane(100.0, 100.0, 1), shapes::inside_out(shapes::plane(100.0, 100.0, 1))] {
        let both = shapes::compose(&[(model.clone(), DVec3::ZERO), (screen, DVec3::Y * 2.0)]);
        let fixture = Fixture::with_opaque(both, model.triangles.len(), of_eta(1.3), 500);
        assert!(matrix(&fixture, 64).is_empty());
    }
}

#[test]
fn samples_receive_what_a_sum_over_all_patches_says() {
    let fixture = Fixture::new(shapes::torus(10.0, 5.5, 64, 40), of_eta(1.4), 16_000);
    let of = |p: DVec3| 1.0 + 0.05 * p.x + 0.03 * p.y;
    let found = matrix(&fixture, 256).apply(&field(&fixture, of), Rays::All);
    let mesh = &fixture.scene.mesh;
    let normal = |i: usize| mesh.normal(fixture.samples.patch(i)[0].triangle);
    let (mut sum, mut expected_sum) = (0.0, 0.0);
    for i in (0..fixture.patches.len()).step_by(161) {
        let (x, n) = (fixture.patches[i].centre_mm, normal(i));
        let eye = offset_origin(x.as_vec3(), n.as_vec3());
        let mut expected = 0.0;
        for (j, patch) in fixture.patches.iter().enumerate() {
            let (to, m) = (patch.centre_mm - x, normal(j));
            let (distance, direction) = (to.length(), to.normalize_or_zero());
            let (mu, nu) = (n.dot(direction), -m.dot(direction));
            if mu <= 0.0 || nu <= 0.0 {
                continue;
            }
            let ray = Ray { t_max: (distance * 0.999) as f32, ..Ray::new(eye, direction.as_vec3()) };
            if !fixture.bvh.occluded(&ray, fixture.samples.patch(j)[0].triangle) {
                let both = transmittance(1.4, mu) * mu * transmittance(1.4, nu) * nu;
                let per_area = both / (PI * diffuse_transmittance(1.4) * distance * distance);
                expected += per_area * patch.area_mm2 * of(patch.centre_mm);
            }
        }
        (sum, expected_sum) = (sum + found[i].x, expected_sum + expected);
        assert!((found[i].x - expected).abs() < 0.02, "{i}: {} {expected}", found[i].x);
    }
    println!("mean ratio {:.5}", sum / expected_sum);
    assert!(expected_sum > 1.0 && (sum / expected_sum - 1.0).abs() < 0.01, "{sum} {expected_sum}");
}

#[test]
fn what_one_place_sends_another_the_other_sends_back() {
    let fixture = Fixture::new(shapes::torus(10.0, 6.0, 96, 48), of_eta(1.3), 20_000);
    let matrix = matrix(&fixture, 64);
    let (one, other) = (|p: DVec3| (1.0 + 0.09 * p.x).max(0.0), |p: DVec3| (1.0 - 0.05 * p.x + 0.08 * p.z).max(0.0));
    let seen_by = |of: &dyn Fn(DVec3) -> f64, irradiance: &[DVec3]| -> f64 {
        fixture.patches.iter().zip(irradiance).map(|(p, e)| p.area_mm2 * of(p.centre_mm) * e.x).sum()
    };
    let there = seen_by(&one, &matrix.apply(&field(&fixture, other), Rays::All));
    let back = seen_by(&other, &matrix.apply(&field(&fixture, one), Rays::All));
    println!("{there:.4} {back:.4}");
    assert!(there > 1.0 && (there / back - 1.0).abs() < 2e-3, "{there} {back}");
}

#[test]
fn the_error_falls_faster_than_the_root_of_the_number_of_rays() {
    let fixture = Fixture::new(shapes::bumpy_head(10.0, 3), of_eta(1.3), 2000);
    let radiosity = field(&fixture, |p| 1.0 + 0.05 * p.z);
    let exact = matrix(&fixture, 1024).apply(&radiosity, Rays::All);
    let rms = |values: &[DVec3], of: usize| {
        // Of means of so many successive samples, which is what scattering makes of them.
        let mean = |v: &[DVec3]| v.iter().map(|e| e.x).sum::<f64>() / v.len() as f64;
        let squares = values.chunks(of).zip(exact.chunks(of)).map(|(a, b)| (mean(a) - mean(b)).powi(2));
        (squares.sum::<f64>() / values.len().div_ceil(of) as f64).sqrt()
    };
    let errors = [8, 32, 128].map(|rays| {
        let matrix = matrix(&fixture, rays);
        let values = matrix.apply(&radiosity, Rays::All);
        // Half of the difference of both halves.
        let half = matrix.apply(&radiosity, Rays::FirstHalf);
        let stated: Vec<DVec3> = half.iter().zip(&values).map(|(a, all)| *a - *all).collect();
        let stated = (stated.iter().map(|e| e.x * e.x).sum::<f64>() / stated.len() as f64).sqrt();
        println!("{rays} rays: {:.2e} each, {:.2e} of 16, stated {stated:.2e}", rms(&values, 1), rms(&values, 16));
        [rms(&values, 1), rms(&values, 16), stated]
    });
    for [coarse, fine] in [[errors[0], errors[1]], [errors[1], errors[2]]] {
        // Four times as many rays; the root would be a half.
        assert!(fine[0] < 0.45 * coarse[0], "{fine:?} {coarse:?}");
    }
    for [each, of_16, stated] in errors {
        assert!(of_16 < 0.4 * each, "neighbours err alike: {of_16} {each}");
        assert!(stated > each, "{stated} {each}");
    }
}

#[test]
fn rows_of_any_width_have_the_sums_of_single_columns_on_every_level() {
    let fixture = Fixture::new(shapes::bumpy_head(10.0, 3), of_eta(1.3), 3000);
    let receivers = fixture.receivers(16);
    let matrix = matrix(&fixture, 32).of_receivers(&receivers.of_vertex);
    assert!(matrix.arrivals.len() > 200);
    for columns in [1, 3, 16, 49] {
        let value = |row: usize, column: usize| uniform(11, row as u64, column as u64) - 0.3;
        let rows: Vec<f32> = (0..receivers.len() * columns).map(|i| value(i / columns, i % columns) as f32).collect();
        let found = matrix.apply_rows(&rows, columns);
        assert_eq!(found.len(), matrix.samples() * columns);
        for column in [0, columns - 1] {
            let radiosity: Vec<DVec3> = (0..receivers.len()).map(|row| DVec3::splat(value(row, column))).collect();
            for (sample, expected) in matrix.apply(&radiosity, Rays::All).iter().enumerate() {
                assert!((f64::from(found[sample * columns + column]) - expected.x).abs() < 2e-6, "{sample} {column}");
            }
        }
        for level in InstructionSet::available() {
            let mut same = vec![1.0; found.len()];
            sums(level, &matrix, 0, &rows, columns, &mut same);
            assert_eq!(same, found);
        }
        // What is missing is dark, and nothing is out of bounds.
        assert!(matrix.apply_rows(&rows[..rows.len() / 2], columns).iter().all(|v| v.is_finite()));
        assert!(matrix.apply_rows(&[], columns).iter().all(|v| *v == 0.0));
    }
    assert!(matrix.apply_rows(&[], 0).is_empty() && matrix.apply(&[], Rays::All).iter().all(|e| *e == DVec3::ZERO));
}

#[test]
fn odd_scenes_have_answers() {
    let empty = Fixture::new(shapes::plane(1.0, 1.0, 1), named("marble"), 0);
    assert!(matrix(&empty, 64).is_empty());
    // Clusters of triangles, as many as there are for each sample; an index of refraction that lets nothing out.
    let cavity = shapes::inside_out(shapes::icosphere(10.0, 4));
    let few = Fixture::new(cavity.clone(), of_eta(1.0), 7);
    let values = matrix(&few, 8).apply(&field(&few, |_| 3.0), Rays::All);
    assert!(values.len() == 7 && values.iter().all(|e| (e.x - 3.0).abs() < 1e-12), "{values:?}");
    for eta in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-300, 1e300] {
        let dark = Fixture::new(cavity.clone(), of_eta(eta), 50);
        let values = matrix(&dark, 4).apply(&field(&dark, |_| 1.0), Rays::All);
        assert!(values.iter().all(|e| e.is_finite() && e.min_element() >= 0.0), "{eta}: {values:?}");
    }
    assert!(InterReflection::default().is_empty());
    assert!(InterReflection::default().apply(&[DVec3::ONE], Rays::All).is_empty());
    let many = matrix(&few, 5000);
    assert_eq!((many.rays, matrix(&few, 0).rays, matrix(&few, 48).rays), (MOST_RAYS, LEAST_RAYS, 64));
    let most = InterReflection::most_bytes(7, many.rays, few.scene.mesh.triangles.len());
    assert_eq!(many.bytes() as u64, most, "all rays arrive here");
}
