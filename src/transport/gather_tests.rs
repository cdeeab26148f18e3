use super::*;
use crate::geometry::mesh::Mesh;
use crate::geometry::shapes;
use crate::geometry::source::SourceModel;
use crate::medium::dipole::Dipole;
use crate::medium::fresnel::BoundaryFit;
use crate::medium::material::OpticalProperties;
use crate::medium::profile::Profile;
use crate::progress::Silent;
use crate::transport::test_scene::{Fixture, medium, named, on_threads, worst_rms};

/// sigma_t' = 1 per mm with the albedos 0.9, 0.99 and 0.999.
fn unit_medium() -> OpticalProperties {
    medium(DVec3::new(0.9, 0.99, 0.999), DVec3::new(0.1, 0.01, 0.001), 1.3)
}

fn radiosity(fixture: &Fixture, e: &[DVec3], receivers: &Receivers, near: NearField, scheme: Scheme) -> Vec<DVec3> {
    let surface = fixture.surface();
    let gather = Gather::new(&surface, &fixture.tree, &fixture.scene.media, near);
    gather.radiosity(receivers, &gather.light(e), scheme, &Silent)
}

fn total(fixture: &Fixture) -> DVec3 {
    MediumKernel::new(&fixture.scene.media[0]).total()
}

/// Int R_d over every triangle of the mesh, in double precision.
fn closed_form(mesh: &Mesh, properties: &OpticalProperties, x: DVec3) -> DVec3 {
    let dipoles = properties.dipoles(BoundaryFit::Published);
    let sum = |d: &Dipole| (0..mesh.triangles.len() as u32).map(|t| d.triangle(x, mesh.corners_local_mm(t))).sum();
    DVec3::from_array(dipoles.map(|d| sum(&d)))
}

/// Worst error over receivers and channels, relative to the total reflectance.
fn worst(values: &[DVec3], exact: &[DVec3], total: DVec3) -> f64 {
    values.iter().zip(exact).map(|(a, b)| ((*a - *b) / total).abs().max_element()).fold(0.0, f64::max)
}

#[test]
fn a_plane_of_samples_of_any_spacing_reflects_what_the_plane_does() {
    for spacing in [0.1, 0.3, 1.0, 3.0, 10.0, 100.0] {
        // 1600 samples and 441 vertices: some receivers on samples' corners, most inside a sample.
        let size = 40.0 * spacing;
        let fixture = Fixture::new(shapes::plane(size, size, 20), unit_medium(), 1600);
        let outline = Fixture::new(shapes::plane(size, size, 1), unit_medium(), 1);
        let receivers = fixture.receivers(16);
        let exact: Vec<DVec3> =
            receivers.positions.iter().map(|&x| closed_form(&outline.scene.mesh, &unit_medium(), x)).collect();
        let error = |near| {
            let values = radiosity(&fixture, &vec![DVec3::ONE; 1600], &receivers, near, Scheme::AllPairs);
            worst(&values, &exact, total(&fixture))
        };
        let (reference, fast) = (error(NearField::REFERENCE), error(NearField::FAST));
        println!("spacing {spacing} mean free paths: reference {reference:.1e}, fast {fast:.1e}");
        assert!(reference < 5e-5, "{spacing}: {reference}");
        assert!(fast < 2.5e-3, "{spacing}: {fast}");
    }
}

#[test]
fn a_marble_floor_sampled_far_too_coarsely_keeps_its_reflectance() {
    let fixture = Fixture::new(shapes::plane(1800.0, 1800.0, 30), named("marble"), 4000);
    let receivers = fixture.receivers(16);
    for near in [NearField::REFERENCE, NearField::FAST] {
        let values = radiosity(&fixture, &vec![DVec3::ONE; 4000], &receivers, near, Scheme::AllPairs);
        let inner: Vec<DVec3> = receivers
            .positions
            .iter()
            .zip(&values)
            .filter(|(p, _)| p.abs().max_element() < 800.0)
            .map(|(_, v)| *v)
            .collect();
        let error = worst(&inner, &vec![total(&fixture); inner.len()], total(&fixture));
        println!("1.8 m of marble, samples of 28 mm: {error:.1e}");
        assert!(inner.len() > 500 && error < 1e-3, "{error}");
    }
}

#[test]
fn a_sphere_under_even_light_is_even_and_the_sum_over_its_facets() {
    for name in ["marble", "skin1", "spectralon"] {
        let fixture = Fixture::new(shapes::icosphere(10.0, 4), named(name), 20_000);
        let receivers = fixture.receivers(64);
        let e = vec![DVec3::ONE; 20_000];
        let values = radiosity(&fixture, &e, &receivers, NearField::REFERENCE, Scheme::AllPairs);
        let mean = values.iter().sum::<DVec3>() / values.len() as f64;
        let spread = worst(&values, &vec![mean; values.len()], mean);
        let few: Vec<usize> = (0..values.len()).step_by(200).collect();
        let exact: Vec<DVec3> =
            few.iter().map(|&i| closed_form(&fixture.scene.mesh, &named(name), receivers.positions[i])).collect();
        let picked: Vec<DVec3> = few.iter().map(|&i| values[i]).collect();
        let error = worst(&picked, &exact, total(&fixture));
        println!("{name} sphere: spread {spread:.1e}, against facets {error:.1e}");
        assert!(spread < 3e-3 && error < 5e-5, "{name}: {spread} {error}");
    }
}

/// A head of 5120 triangles, lit from one side.
fn head(properties: OpticalProperties, samples: usize) -> (Fixture, Vec<DVec3>) {
    let fixture = Fixture::new(shapes::bumpy_head(10.0, 4), properties, samples);
    let lit = |p: DVec3| DVec3::new(1.0, 0.8, 0.5) * (p.normalize().dot(DVec3::new(0.6, 0.0, 0.8)) + 0.2).max(0.0);
    let e = fixture.patches.iter().map(|p| lit(p.centre_mm)).collect();
    (fixture, e)
}

#[test]
fn the_hierarchy_converges_to_all_pairs() {
    for name in ["marble", "skin1", "spectralon"] {
        let (fixture, e) = head(named(name), 10_000);
        let receivers = fixture.receivers(16);
        let (subset, _) = receivers.subset(300, 0);
        let of = |scheme| radiosity(&fixture, &e, &subset, NearField::FAST, scheme);
        let exact = of(Scheme::AllPairs);
        let sweep = |limits: [f64; 5], criterion: fn(f64) -> Criterion| {
            limits.map(|limit| worst_rms(&of(Scheme::Hierarchical { criterion: criterion(limit) }), &exact))
        };
        let angles = sweep([1.0, 0.3, 0.1, 0.03, 0.01], Criterion::SolidAngle);
        let bounds = sweep([1e-2, 1e-3, 1e-4, 1e-5, 1e-6], Criterion::KernelBound);
        let show = |errors: [f64; 5]| errors.map(|e| format!("{e:.1e}")).join(" ");
        println!("{name}: solid angle {}, kernel bound {}", show(angles), show(bounds));
        for errors in [angles, bounds] {
            assert!(errors.windows(2).all(|w| w[1] < w[0]), "{name}: {errors:?}");
            assert!(errors[4] < 1e-3, "{name}: {errors:?}");
        }
        for criterion in [Criterion::SolidAngle(0.0), Criterion::KernelBound(0.0)] {
            assert!(worst_rms(&of(Scheme::Hierarchical { criterion }), &exact) < 1e-6);
        }
    }
}

#[test]
fn results_depend_on_threads_and_instructions_not_at_all_and_on_groups_by_rounding_only() {
    let (fixture, e) = head(named("skin1"), 6000);
    let surface = fixture.surface();
    let at_16 = fixture.receivers(16);
    for scheme in [Scheme::AllPairs, Scheme::Hierarchical { criterion: Criterion::SolidAngle(0.05) }] {
        let on = |threads: usize, level: InstructionSet| {
            let gather = Gather::new(&surface, &fixture.tree, &fixture.scene.media, NearField::FAST);
            let gather = Gather { level, ..gather };
            on_threads(threads, || gather.radiosity(&at_16, &gather.light(&e), scheme, &Silent))
        };
        let one = on(1, InstructionSet::detect());
        for level in InstructionSet::available() {
            assert_eq!(on(3, level), one, "{level:?} {scheme:?}");
        }
    }
    let by_vertex = |capacity| {
        let receivers = fixture.receivers(capacity);
        receivers.expand(&radiosity(&fixture, &e, &receivers, NearField::REFERENCE, Scheme::AllPairs))
    };
    let reference = by_vertex(16);
    for capacity in [1, 7, 64, 5000] {
        let difference = worst(&by_vertex(capacity), &reference, total(&fixture));
        println!("groups of {capacity} against 16: {difference:.1e}");
        assert!(difference < 2e-5, "{capacity}: {difference}");
    }
}

#[test]
fn radiosity_is_linear_in_the_irradiance_and_black_without_it() {
    let (fixture, e) = head(named("marble"), 3000);
    let receivers = fixture.receivers(16);
    let of = |e: &[DVec3]| radiosity(&fixture, e, &receivers, NearField::FAST, Scheme::AllPairs);
    let (once, black) = (of(&e), of(&vec![DVec3::ZERO; 3000]));
    assert!(black.iter().all(|b| *b == DVec3::ZERO));
    let thrice = of(&e.iter().map(|v| 3.0 * *v).collect::<Vec<_>>());
    for (a, b) in once.iter().zip(&thrice) {
        assert!((3.0 * *a - *b).abs().max_element() < 1e-6, "{a} {b}");
    }
}

#[test]
fn any_brightness_that_a_light_can_have_stays_in_range() {
    let (fixture, e) = head(named("marble"), 1000);
    let receivers = fixture.receivers(16);
    let of = |factor: f64| {
        let e: Vec<DVec3> = e.iter().map(|v| factor * *v).collect();
        radiosity(&fixture, &e, &receivers, NearField::FAST, Scheme::AllPairs)
    };
    let once = of(1.0);
    for power in [-900, -200, -40, 40, 200, 900] {
        let factor = 2f64.powi(power);
        assert!(of(factor).iter().zip(&once).all(|(a, b)| *a == *b * factor), "2^{power}");
    }
}

#[test]
fn models_of_one_triangle_of_twin_sheets_and_of_a_micron_are_exact() {
    let corner = [DVec3::ZERO, DVec3::X, DVec3::new(0.2, 0.9, 0.3)];
    let sheets = |scale: f64, triangles: Vec<[u32; 3]>| SourceModel::new(corner.map(|p| p * scale).to_vec(), triangles);
    let cases = [
        ("triangle", sheets(5.0, vec![[0, 1, 2]])),
        ("twin sheets", sheets(5.0, vec![[0, 1, 2], [0, 2, 1]])),
        ("micron", sheets(1e-3, vec![[0, 1, 2]])),
        ("two metres", sheets(2e3, vec![[0, 1, 2]])),
        ("micron head", shapes::bumpy_head(5e-4, 2)),
    ];
    for (name, source) in cases {
        for samples in [1, 50] {
            let fixture = Fixture::new(source.clone(), named("marble"), samples);
            let receivers = fixture.receivers(16);
            let e = vec![DVec3::ONE; fixture.samples.len()];
            for near in [NearField::REFERENCE, NearField::FAST] {
                let values = radiosity(&fixture, &e, &receivers, near, Scheme::AllPairs);
                let exact: Vec<DVec3> = receivers
                    .positions
                    .iter()
                    .map(|&x| closed_form(&fixture.scene.mesh, &named("marble"), x))
                    .collect();
                assert!(!values.is_empty());
                let error = worst(&values, &exact, total(&fixture));
                // Single precision within a block: 2^-25 of its extent against the depth of the sources.
                assert!(error < 2e-4, "{name} with {samples} samples: {error:.1e}");
            }
        }
    }
}

#[test]
fn receivers_that_are_far_apart_are_summed_together_as_alone() {
    // Patches are smaller than the depth of the sources, some times as large (all but where points may stand for them), and far larger.
    for density in [1.0, 10.0, 100.0] {
        far_apart_as_alone(density);
    }
}

fn far_apart_as_alone(density: f64) {
    let OpticalProperties { sigma_s_reduced_per_mm, sigma_a_per_mm, .. } = unit_medium();
    let dense = medium(density * sigma_s_reduced_per_mm, density * sigma_a_per_mm, 1.3);
    let fixture = Fixture::new(shapes::bumpy_head(10.0, 4), dense, 3000);
    let receivers = fixture.receivers(16);
    let e: Vec<DVec3> = (0..3000).map(|i| DVec3::new(1.0, f64::from(i % 3), f64::from(i % 7))).collect();
    let apart: Vec<u32> = (0..receivers.len() as u32).step_by(29).collect();
    let surface = fixture.surface();
    let sums = |near: NearField, capacity: usize| {
        let some = receivers.only(&apart, capacity);
        let widest = some.groups.iter().map(|group| some.sphere(*group).radius_mm).fold(0.0, f64::max);
        assert_eq!(widest > 3.0, capacity > 1);
        let gather = Gather::new(&surface, &fixture.tree, &fixture.scene.media, near);
        gather.radiosity(&some, &gather.light(&e), Scheme::AllPairs, &Silent)
    };
    let truth = sums(NearField::REFERENCE, 1);
    let error = |near: NearField, capacity: usize| worst(&sums(near, capacity), &truth, total(&fixture));
    // Some of what is near one of a group is finer for the others than it has to be.
    assert!(
        truth.len() == apart.len() && error(NearField::REFERENCE, 16) < 1e-4,
        "{}",
        error(NearField::REFERENCE, 16)
    );
    let [together, alone] = [16, 1].map(|capacity| error(NearField::FAST, capacity));
    // Single precision within a block, as above: 2^-25 of its extent against the depth of the sources.
    let rounding = 1e-6 * density;
    assert!(together < 1.1 * alone + rounding && alone < 0.01, "{density}: {together} {alone}");
}
