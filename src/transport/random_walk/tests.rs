use std::f64::consts::{PI, TAU};

use glam::DVec3;

use super::boundary::{Boundary, Crossing, HalfSpace, MeshBoundary, Sphere};
use super::exitance::{Effort, Exitance, budget, exitance};
use super::model_error::{compare, points_of_a_triangle, project, project_points};
use super::tally::{Budget, Hats};
use super::walk::{Start, Stream, WalkMedium};
use crate::geometry::bvh::Bvh;
use crate::geometry::shapes;
use crate::light::Light;
use crate::medium::fresnel::{CosineTransmittance, refracted_cosine};
use crate::medium::material::OpticalProperties;
use crate::progress::Silent;
use crate::transport::random_walk::entry::Entries;
use crate::transport::test_scene::{self, Fixture, TestScene, named};

fn medium(scattering: f64, absorption: f64, g: f64, eta: f64) -> OpticalProperties {
    OpticalProperties { g, ..test_scene::medium(DVec3::splat(scattering), DVec3::splat(absorption), eta) }
}

fn scene_of(source: crate::geometry::source::SourceModel, properties: OpticalProperties) -> TestScene {
    Fixture::new(source, properties, 1).scene
}

/// Light straight into a half space of the albedo.
fn half_space(albedo: f64, g: f64, eta: f64, photons: u64, seed: u64) -> Budget {
    let one = WalkMedium::new(&medium(albedo, 1.0 - albedo, g, eta), 0);
    budget(&HalfSpace, &one, photons, seed, |_| Start { at_mm: DVec3::ZERO, direction: -DVec3::Z })
}

/// Constant light into a sphere, by the point where its normal is +z.
fn into_sphere(radius: f64, eta: f64) -> impl Fn(&mut Stream) -> Start + Sync {
    let table = CosineTransmittance::new(eta);
    move |stream| {
        let outside = table.sample_entrance_cosine(stream.uniform());
        let inside = refracted_cosine(eta, outside).unwrap();
        let (sin, cos) = (TAU * stream.uniform()).sin_cos();
        let radial = ((1.0 - inside) * (1.0 + inside)).sqrt();
        Start { at_mm: DVec3::Z * radius * (1.0 - 1e-12), direction: DVec3::new(radial * cos, radial * sin, -inside) }
    }
}

/// Exitance over entering flux of a half space, isotropic scattering, normal incidence.
#[rustfmt::skip]
const HALF_SPACE: [(f64, [f64; 4]); 3] = [
    (1.0, [0.1152, 0.4150, 0.7527, 0.9128]),
    (1.3, [0.0638, 0.2904, 0.6560, 0.8715]),
    (1.5, [0.0463, 0.2293, 0.5852, 0.8348]),
];

#[test]
fn a_half_space_reflects_what_theory_says() {
    for (eta, expected) in HALF_SPACE {
        for (albedo, expected) in [0.5, 0.9, 0.99, 0.999].into_iter().zip(expected) {
            let tolerance: f64 = if albedo < 0.8 { 0.01 } else { 0.003 };
            // Three standard deviations within the tolerance, were each photon to leave whole or not at all.
            let photons = 9.0 * (1.0 - expected) / expected / (tolerance * tolerance);
            let got = half_space(albedo, 0.0, eta, photons as u64, 1).reflectance();
            println!("eta {eta}, albedo {albedo}: {got:.4}, expected {expected}");
            assert!((got / expected - 1.0).abs() < tolerance, "eta {eta}, albedo {albedo}: {got} {expected}");
        }
    }
}

#[test]
fn similarity_holds_deep_inside_and_order_one_has_its_closed_form() {
    // Half space, matched indices, order 1 at normal incidence: albedo / 2 (1 - ln 2).
    let got = half_space(0.8, 0.0, 1.0, 1_000_000, 2);
    let expected = 0.4 * (1.0 - 2.0f64.ln());
    assert!((got.share(got.left_once) / expected - 1.0).abs() < 0.01, "{got:?} {expected}");
    // Reduced coefficients make a forward medium nearly the isotropic one, not exactly.
    let (isotropic, forward) = (half_space(0.99, 0.0, 1.5, 200_000, 3), half_space(0.99, 0.8, 1.5, 100_000, 3));
    let ratio = forward.reflectance() / isotropic.reflectance();
    assert!((ratio - 1.0).abs() < 0.05 && (ratio - 1.0).abs() > 1e-4, "{ratio}");
}

#[test]
fn a_marble_sphere_in_constant_light_has_the_known_exitance() {
    let (radius, eta) = (15.0, 1.5);
    let one = WalkMedium::new(&medium(2.19, 0.0021, 0.0, eta), 0);
    let got = budget(&Sphere { radius_mm: radius }, &one, 150_000, 1, into_sphere(radius, eta));
    let b = CosineTransmittance::new(eta).diffuse_transmittance() * got.reflectance();
    println!("B / pi = {b:.4}, {} collisions", got.collisions);
    assert!((b / 0.8331 - 1.0).abs() < 0.002, "{b}");
    assert_eq!((got.lost, got.trapped), (0.0, 0.0));
}

#[test]
fn what_enters_a_medium_without_absorption_leaves() {
    for (g, eta) in [(0.0, 1.0), (0.0, 1.5), (0.7, 1.3), (-0.5, 0.8)] {
        let one = WalkMedium::new(&medium(2.0, 0.0, g, eta), 0);
        let got = budget(&Sphere { radius_mm: 2.0 }, &one, 20_000, 5, into_sphere(2.0, eta));
        let left = got.left_unscattered + got.left_once + got.left_more;
        assert_eq!((left, got.lost), (got.entered, 0.0), "{got:?}");
    }
    // The same through a mesh, which loses next to nothing.
    let scene = scene_of(shapes::bumpy_head(4.0, 3), medium(2.0, 0.0, 0.3, 1.4));
    let light = [Light::constant(DVec3::ONE).unwrap()];
    let got = exitance(scene.domain(), &light, Effort::Photons(100_000), 1, &Silent).unwrap();
    for b in got.budget {
        let left = b.left_unscattered + b.left_once + b.left_more;
        assert!((b.share(left) - 1.0).abs() < 1e-5 && b.share(b.lost) < 1e-5, "{b:?}");
    }
}

#[test]
fn roulette_is_unbiased_and_weights_stay_bounded_at_every_albedo() {
    for albedo in [0.05, 0.3, 0.49, 0.51, 0.9] {
        // What a photon scatters in an infinite medium before it is absorbed is albedo / (1 - albedo) on average, weighted.
        let one = WalkMedium::new(&medium(albedo, 1.0 - albedo, 0.0, 1.0), 0);
        let n = 200_000;
        let got = budget(&Sphere { radius_mm: 1e9 }, &one, n, 7, |_| Start { at_mm: DVec3::ZERO, direction: DVec3::Z });
        assert_eq!(got.reflectance(), 0.0);
        // The analogue of the same: live or die by albedo. Both must agree on the reflectance of a half space.
        let analogue = (0..400_000u64).map(|i| analogue(albedo, i)).sum::<f64>() / 400_000.0;
        let walked = half_space(albedo, 0.0, 1.0, 400_000, 8).reflectance();
        let deviation = (2.0 * analogue * (1.0 - analogue) / 400_000.0).sqrt();
        assert!((walked - analogue).abs() < 4.0 * deviation, "{albedo}: {walked} {analogue} {deviation}");
    }
}

/// A photon straight into a half space with matched indices that lives or dies as a whole; 1 where it leaves.
fn analogue(albedo: f64, index: u64) -> f64 {
    let mut stream = Stream::new(99, index);
    let (mut z, mut mu) = (0.0f64, 1.0f64);
    loop {
        z += -stream.uniform().ln() * mu;
        if z <= 0.0 {
            return 1.0;
        }
        if stream.uniform() >= albedo {
            return 0.0;
        }
        mu = 2.0 * stream.uniform() - 1.0;
    }
}

#[test]
fn a_mesh_boundary_answers_as_the_sphere_it_stands_for() {
    let radius = 5.0;
    let mesh = test_scene::mesh_of(shapes::icosphere(radius, 5));
    let boundary = MeshBoundary::new(&mesh, (0..mesh.triangles.len() as u32).collect(), 0.5);
    let sphere = Sphere { radius_mm: radius };
    for i in 0..20_000 {
        let mut stream = Stream::new(4, i);
        let mut ball = || loop {
            let p = DVec3::from_array([0; 3].map(|_| 2.0 * stream.uniform() - 1.0));
            if p.length_squared() < 1.0 {
                return p;
            }
        };
        let (from, direction) = (0.995 * radius * ball(), ball().normalize());
        let reach = 10.0 * stream.uniform();
        let mut depth = 1;
        match (
            boundary.crossing(from, direction, reach, &mut depth),
            sphere.crossing(from, direction, reach, &mut depth),
        ) {
            (Crossing::Surface { inside_mm: a, normal, .. }, Crossing::Surface { inside_mm: b, normal: exact, .. }) => {
                assert!(normal.dot(exact) > 0.99 && a.distance(b) < 0.2, "{a} {b}");
            }
            (Crossing::Inside, Crossing::Inside) => {}
            (got, expected) => {
                // Only within the faceting of the end of the sphere.
                assert!(((from + reach * direction).length() - radius).abs() < 0.02, "{got:?} {expected:?}");
            }
        }
        assert_eq!(depth, 1);
    }
}

#[test]
fn surfaces_inside_each_other_are_one_body_and_bubbles_are_holes() {
    let (big, small) = (shapes::icosphere(5.0, 2), shapes::icosphere(3.0, 2));
    let overlapping = shapes::compose(&[(big.clone(), DVec3::ZERO), (small.clone(), DVec3::X * 4.0)]);
    let bubble = shapes::compose(&[(big, DVec3::ZERO), (shapes::inside_out(small), DVec3::ZERO)]);
    let reaches = |model, from: DVec3| {
        let mesh = test_scene::mesh_of(model);
        let boundary = MeshBoundary::new(&mesh, (0..mesh.triangles.len() as u32).collect(), 0.5);
        let from = from - mesh.origin_mm;
        match boundary.crossing(from, DVec3::new(1.0, 1e-3, 2e-3).normalize(), 100.0, &mut 1) {
            Crossing::Surface { inside_mm, .. } => inside_mm.x + mesh.origin_mm.x,
            other => panic!("{other:?}"),
        }
    };
    assert!((reaches(overlapping, DVec3::X * -4.0) - 7.0).abs() < 0.1);
    assert!((reaches(bubble, DVec3::X * -4.5) + 3.0).abs() < 0.1);
}

#[test]
fn candidates_bring_the_irradiance_of_each_light() {
    let scene = scene_of(shapes::icosphere(6.0, 4), named("marble"));
    let eta = 1.5;
    let bvh = Bvh::new(&scene.mesh);
    let area = 4.0 * PI * 36.0;
    let c = CosineTransmittance::new(eta).diffuse_transmittance();
    // A sphere gathers parallel light over its cross-section, with C of diffuse light by symmetry.
    let cases = [
        (Light::constant(DVec3::new(1.0, 2.0, 0.0)).unwrap(), DVec3::new(1.0, 2.0, 0.0) * (PI * c * area)),
        (Light::directional(DVec3::ONE, DVec3::splat(3.0)).unwrap(), DVec3::splat(3.0 * PI * 36.0 * c)),
    ];
    for (light, expected) in cases {
        let lights = [light];
        let entries = Entries::new(scene.domain(), &bvh, &lights).unwrap();
        let n = 200_000;
        let flux = (0..n).fold(DVec3::ZERO, |sum, i| {
            let mut stream = Stream::new(1, i);
            let lit = entries.candidate((i as f64 + 0.5) / n as f64, &mut stream).filter(|c| entries.is_lit(c));
            sum + lit.map_or(DVec3::ZERO, |c| c.irradiance) * entries.area_mm2() / n as f64
        });
        assert!((flux - expected).abs().max_element() < 0.01 * expected.max_element(), "{lights:?}: {flux} {expected}");
    }
}

fn small_walk(photons: u64, seed: u64) -> Exitance {
    let scene = scene_of(shapes::bumpy_head(3.0, 2), medium(1.0, 0.3, 0.4, 1.3));
    let lights = [
        Light::directional(DVec3::new(0.3, 0.5, 1.0), DVec3::new(3.0, 2.0, 1.0)).unwrap(),
        Light::point(DVec3::new(0.0, 9.0, 0.0), DVec3::splat(50.0)).unwrap(),
    ];
    exitance(scene.domain(), &lights, Effort::Photons(photons), seed, &Silent).unwrap()
}

#[test]
fn standard_errors_are_those_of_the_spread_over_seeds() {
    let runs: Vec<Exitance> = (0..16).map(|seed| small_walk(30_000, seed)).collect();
    let n = runs.len() as f64;
    let slots = runs[0].total.len();
    let mean = |slot: usize| runs.iter().map(|r| r.total[slot]).sum::<DVec3>() / n;
    let (mut spread, mut claimed) = (0.0, 0.0);
    for slot in 0..slots {
        let mean = mean(slot);
        spread += runs.iter().map(|r| (r.total[slot] - mean).length_squared()).sum::<f64>() / (n - 1.0);
        claimed += runs.iter().map(|r| r.standard_error[slot].length_squared()).sum::<f64>() / n;
    }
    let ratio = spread / claimed;
    println!("variance over seeds / claimed: {ratio:.3} over {slots} slots");
    assert!((0.9..1.1).contains(&ratio), "{ratio}");
    // The fluxes agree as well: what leaves through the hats is what the budget says.
    for run in &runs[..2] {
        let flux: DVec3 = run.total.iter().zip(&run.hats.mass_mm2).map(|(b, m)| *b * *m).sum();
        for (flux, b) in flux.to_array().into_iter().zip(run.budget) {
            assert!((flux / (b.left_once + b.left_more) - 1.0).abs() < 1e-6, "{flux} {b:?}");
        }
    }
}

#[test]
fn noise_falls_to_what_was_asked_for() {
    let scene = scene_of(shapes::icosphere(3.0, 2), medium(1.0, 0.3, 0.0, 1.3));
    let light = [Light::constant(DVec3::ONE).unwrap()];
    let got = exitance(scene.domain(), &light, Effort::Noise(0.03), 1, &Silent).unwrap();
    assert!(got.noise() < 0.033 && got.noise() > 0.02, "{}", got.noise());
}

#[test]
fn comparison_takes_the_noise_out_and_leaves_the_difference() {
    let scene = scene_of(shapes::icosphere(3.0, 3), medium(1.0, 0.3, 0.0, 1.3));
    let light = [Light::constant(DVec3::ONE).unwrap()];
    let [noisy, fine] =
        [60_000, 600_000].map(|n| exitance(scene.domain(), &light, Effort::Photons(n), n, &Silent).unwrap());
    // On a sphere in constant light the truth is a constant.
    let constant = fine.total.iter().zip(&fine.hats.mass_mm2).map(|(b, m)| *b * *m).sum::<DVec3>()
        / fine.hats.mass_mm2.iter().sum::<f64>();
    let vertices = fine.hats.of_vertex.len();
    let right = compare(&noisy, &vec![constant; vertices]).unwrap();
    let wrong = compare(&noisy, &vec![1.1 * constant; vertices]).unwrap();
    println!("{right:?} {wrong:?}");
    assert!(right.noise.iter().all(|&n| n > 0.05), "{right:?}");
    assert!(right.worst()[0] < 0.04 && right.bias.iter().all(|b| b.abs() < 0.02), "{right:?}");
    assert!(
        wrong.rms.iter().zip(wrong.bias).all(|(r, b)| (r - 0.1).abs() < 0.03 && (b - 0.1).abs() < 0.02),
        "{wrong:?}"
    );
    assert!(compare(&noisy, &[constant]).is_err());
}

#[test]
fn projection_keeps_constants_and_flux() {
    let scene = scene_of(shapes::bumpy_head(3.0, 2), named("marble"));
    let hats = Hats::new(&scene.mesh, &scene.parts);
    let vertices = scene.mesh.local_mm.len();
    let constant = project(&hats, &vec![DVec3::new(1.0, 2.0, 3.0); vertices]).unwrap();
    assert!(constant.iter().all(|b| (*b - DVec3::new(1.0, 2.0, 3.0)).length() < 1e-12));
    let varying: Vec<DVec3> = scene.mesh.local_mm.iter().map(|p| p.as_dvec3()).collect();
    let flux = |values: &[DVec3]| values.iter().zip(&hats.mass_mm2).map(|(b, m)| *b * *m).sum::<DVec3>();
    let nodal: Vec<DVec3> = hats.vertex.iter().map(|&v| varying[v as usize]).collect();
    assert!((flux(&project(&hats, &varying).unwrap()) - flux(&nodal)).length() < 1e-9);
    assert!((hats.mass_mm2.iter().sum::<f64>() / scene.mesh.total_area_mm2() - 1.0).abs() < 1e-12);
}

#[test]
fn odd_media_and_open_surfaces_end_well() {
    let light = [Light::constant(DVec3::ONE).unwrap(), Light::directional(DVec3::Y, DVec3::ONE).unwrap()];
    for (s, a, g, eta) in [
        (0.0, 0.0, 0.0, 1.5),
        (0.0, 1.0, 0.0, 1.3),
        (1e6, 0.0, 0.0, 1.0),
        (1e6, 1e6, 0.99, 3.0),
        (1e-9, 1e-9, 0.0, 0.4),
    ] {
        let mut properties = medium(s, a, g, eta);
        if s > 1e3 && a == 0.0 {
            // A billion events for each photon would be the truth; a small body shows the same.
            properties = medium(s * 1e-3, a, g, eta);
        }
        let scene = scene_of(shapes::cuboid(DVec3::splat(1e-2), 1), properties);
        let got = exitance(scene.domain(), &light, Effort::Photons(2000), 1, &Silent).unwrap();
        assert!(got.total.iter().chain(&got.standard_error).all(|b| b.is_finite() && b.min_element() >= 0.0));
        for b in got.budget {
            let out = b.left_unscattered + b.left_once + b.left_more + b.trapped + b.lost;
            assert!(out <= 1.1 * b.entered, "{s} {a} {b:?}");
        }
    }
    let open = scene_of(shapes::plane(5.0, 5.0, 4), named("marble"));
    let failed = exitance(open.domain(), &light, Effort::Photons(2000), 1, &Silent).unwrap_err();
    assert!(failed.message().contains("not closed"), "{failed}");
    let dark = scene_of(shapes::icosphere(1.0, 1), named("marble"));
    let got = exitance(dark.domain(), &[], Effort::Noise(0.01), 1, &Silent).unwrap();
    assert!(got.total.iter().all(|b| *b == DVec3::ZERO) && got.noise() == 0.0);
}

#[test]
fn points_of_triangles_have_the_projection_of_what_is_linear_between_corners() {
    for cuts in [1u32, 2, 5] {
        let points: Vec<[f64; 3]> = points_of_a_triangle(cuts).collect();
        assert_eq!(points.len(), (cuts * cuts) as usize);
        for k in 0..3 {
            let mean = points.iter().map(|at| at[k]).sum::<f64>() / points.len() as f64;
            assert!((mean - 1.0 / 3.0).abs() < 1e-14 && points.iter().all(|at| at[k] > 0.0));
        }
    }
    let scene = Fixture::new(shapes::cuboid(DVec3::new(3.0, 4.0, 12.0), 1), named("marble"), 64).scene;
    let hats = Hats::new(&scene.mesh, &scene.parts);
    let linear: Vec<DVec3> = scene.mesh.local_mm.iter().map(|at| 20.0 + at.as_dvec3()).collect();
    let expected = project(&hats, &linear).unwrap();
    let cuts = 24;
    let at_points: Vec<DVec3> = scene
        .mesh
        .triangles
        .iter()
        .flat_map(|corners| {
            let values = corners.map(|v| linear[v as usize]);
            points_of_a_triangle(cuts).map(move |[u, v, w]| u * values[0] + v * values[1] + w * values[2])
        })
        .collect();
    for (found, expected) in project_points(&hats, cuts, &at_points).iter().zip(&expected) {
        assert!((*found - *expected).abs().max_element() < 1e-3 * expected.max_element(), "{found} {expected}");
    }
}
