//! Single scattering of `all_frequency`: stored values against rays, terms of the phase function, g at run time, keys.
#![allow(clippy::unwrap_used, missing_docs)]

use crate::{baked, in_memory};
use std::sync::Arc;

use crate::in_memory::{registry, try_bake, vertex_areas};
use glam::DVec3;
use translux::asset::Asset;
use translux::error::ExitCode;
use translux::evaluate::single_scattering::SeenPoint;
use translux::evaluate::summed::Summed;
use translux::evaluate::{Evaluator, SingleScattering};
use translux::geometry::mesh::Scale;
use translux::geometry::shapes;
use translux::light::{Light, sky};
use translux::math::statistics::vertex_error;
use translux::progress::Silent;
use translux::render::background::Background;
use translux::render::camera::{Camera, Resolution};
use translux::render::frame::{RenderSettings, Specular, render};
use translux::render::single::{Scattered, Single};
use translux::scene::Scene;
use translux::transport::single_scattering::radiance::Share;
use translux::transport::single_scattering::vertex_points;

/// A head of 20 mm, a few mean free paths of skin1 thick in its ears.
fn head(g: f64) -> Scene {
    head_of(2, g)
}

/// The same with so many subdivisions.
fn head_of(subdivisions: u32, g: f64) -> Scene {
    let model = shapes::bumpy_head(10.0, subdivisions);
    let mut scene = in_memory::scene(model, Scale::MillimetresPerUnit(1.0), "skin1");
    scene.media[0].properties.g = g;
    scene
}

fn pairs(set: &[&str]) -> Vec<(String, String)> {
    set.iter().map(|pair| pair.split_once('=').unwrap()).map(|(k, v)| (k.to_owned(), v.to_owned())).collect()
}

fn bake(method: &str, scene: &Scene, set: &[&str]) -> Arc<Asset> {
    baked::asset(method, scene, 500, set)
}

fn open(asset: Arc<Asset>) -> Box<dyn Evaluator> {
    registry().open(asset).unwrap()
}

fn environment() -> Light {
    Light::environment(Arc::new(sky::sky()), 20.0, DVec3::new(1.0, 0.8, 0.6)).unwrap()
}

fn sun() -> Light {
    Light::directional(DVec3::new(0.5, 0.7, 0.4), DVec3::ONE).unwrap()
}

/// Values of vertices under some lights.
fn per_vertex(evaluator: &mut dyn Evaluator, lights: &[Light]) -> Vec<DVec3> {
    evaluator.set_lights(lights.to_vec(), &Silent).unwrap();
    evaluator.single_scattering(&Silent).unwrap().unwrap()
}

/// Radiance of every vertex towards eyes aslant.
fn seen(evaluator: &mut dyn Evaluator, lights: &[Light]) -> Vec<DVec3> {
    evaluator.set_lights(lights.to_vec(), &Silent).unwrap();
    let evaluator = &*evaluator;
    let scene = evaluator.scene();
    let eye = evaluator.towards_eye().unwrap().unwrap();
    let points = vertex_points(scene.domain());
    let mut values = vec![DVec3::ZERO; points.len()];
    for (index, triangle) in scene.mesh.triangles.iter().enumerate() {
        for (corner, &v) in triangle.iter().enumerate() {
            let exit = points[v as usize];
            let mut weights = [0.0; 3];
            weights[corner] = 1.0;
            let to_eye = (exit.normal + 0.7 * exit.normal.any_orthonormal_vector()).normalize();
            let key = u64::from(v);
            let seen = SeenPoint { exit, triangle: index as u32, weights, to_eye, key, share: Share::WHOLE };
            if values[v as usize] == DVec3::ZERO {
                values[v as usize] = eye.radiance(&seen);
            }
        }
    }
    values
}

fn ledger_rms(asset: &Asset) -> f64 {
    asset.ledger.entries.iter().find(|e| e.stage == "single scattering").unwrap().error.rms
}

#[test]
fn stored_values_are_those_of_rays() {
    let scene = head_of(1, 0.0);
    let areas = vertex_areas(&scene);
    let mut truth = open(bake("reference", &scene, &["single-scattering=isotropic"]));
    let lights = [vec![environment()], vec![sun()], vec![environment(), sun()]];
    let expected: Vec<Vec<DVec3>> = lights.iter().map(|l| per_vertex(truth.as_mut(), l)).collect();
    for (set, most) in [
        (&["single-scattering=isotropic"][..], [0.02, 0.07, 0.05]),
        (&["single-scattering=phase"], [0.02, 0.07, 0.05]),
        (&["single-scattering=isotropic", "basis=haar"], [0.03, 0.15, 0.1]),
        (&["single-scattering=isotropic", "single-basis=haar"], [0.03, 0.15, 0.1]),
    ] {
        let asset = bake("all_frequency", &scene, set);
        let of_ledger = ledger_rms(&asset);
        let mut evaluator = open(asset);
        let found = lights
            .iter()
            .zip(&expected)
            .map(|(lights, expected)| vertex_error(&per_vertex(evaluator.as_mut(), lights), expected, &areas).rms);
        let found: Vec<f64> = found.collect();
        println!("{set:?}: {found:.4?}, ledger {of_ledger:.4}");
        assert!(found.iter().zip(most).all(|(error, most)| *error < most), "{set:?}: {found:?}");
        assert!(of_ledger > 1e-4 && of_ledger < 0.03, "{of_ledger}");
        assert!(evaluator.towards_eye().unwrap().is_none(), "what an eye does not change is there for vertices");
        let measured = evaluator.measured_error(&[], &Silent).unwrap();
        assert!(measured.entries.iter().any(|e| e.stage == "single scattering" && e.error.rms < 0.15));
    }
}

/// The printed form is brighter; what further folds let through is more light; both as `reference` has it.
#[test]
fn integrands_are_those_of_the_reference() {
    // The folds of a finer head: what they let through is a small share.
    for (integrand, subdivisions, brighter) in
        [("single-form=printed", 1, 1.5), ("single-crossings=attenuated", 3, 1.0005)]
    {
        let scene = head_of(subdivisions, 0.0);
        let areas = vertex_areas(&scene);
        let of = |method: &str, integrand: &str| {
            let set = ["single-scattering=isotropic", integrand, "coefficients=225"];
            let set = &set[..if method == "all_frequency" { 3 } else { 2 }];
            let asset = baked::asset(method, &scene, 500, set);
            per_vertex(open(asset).as_mut(), &[environment()])
        };
        let plain: DVec3 = of("reference", "single-form=physical").iter().sum();
        let (found, expected) = (of("all_frequency", integrand), of("reference", integrand));
        let error = vertex_error(&found, &expected, &areas).rms;
        let ratio = expected.iter().sum::<DVec3>().y / plain.y;
        println!("{integrand}: {error:.4}, {ratio:.4} times as bright");
        assert!(error < 0.03 && ratio > brighter, "{integrand}: {error} {ratio}");
    }
}

#[test]
fn nothing_beside_the_radiosity_unless_it_is_asked_for() {
    let scene = head(0.0);
    let plain = bake("all_frequency", &scene, &[]);
    let with = bake("all_frequency", &scene, &["single-scattering=isotropic"]);
    assert!(with.sections.len() > plain.sections.len());
    let [mut plain, mut with] = [plain, with].map(open);
    for evaluator in [&mut plain, &mut with] {
        evaluator.set_lights(vec![environment()], &Silent).unwrap();
    }
    assert!(plain.single_scattering(&Silent).unwrap().is_none());
    // Every photon once: what is beside the radiosity is not in it.
    let mean = |values: &[DVec3]| values.iter().sum::<DVec3>() / values.len() as f64;
    let [all, later] = [&mut plain, &mut with].map(|evaluator| mean(&evaluator.radiosity(&Silent).unwrap()));
    let first = mean(&with.single_scattering(&Silent).unwrap().unwrap());
    println!("the later orders over all {}, with the first {}", later / all, (later + first) / all);
    assert!((later / all).max_element() < 0.85, "{}", later / all);
    assert!(((later + first) / all - 1.0).abs().max_element() < 0.25, "{}", (later + first) / all);
    assert!(with.cost().resident_bytes > plain.cost().resident_bytes);
}

/// What is seen is the sum, whether it is stored as one or beside each other.
#[test]
fn folded_into_the_radiosity_it_is_the_same_light() {
    let scene = head_of(1, 0.0);
    let areas = vertex_areas(&scene);
    let folded = bake("all_frequency", &scene, &["single-scattering=folded"]);
    let beside = bake("all_frequency", &scene, &["single-scattering=isotropic"]);
    assert!(folded.sections.len() < beside.sections.len());
    let [mut folded, mut beside] = [folded, beside].map(open);
    assert_eq!(
        [folded.single_scattering_is(), beside.single_scattering_is()],
        [SingleScattering::Included, SingleScattering::PerVertex]
    );
    assert!(folded.single_scattering(&Silent).unwrap().is_none());
    for lights in [vec![environment()], vec![sun()]] {
        let single = per_vertex(beside.as_mut(), &lights);
        let apart = beside.radiosity(&Silent).unwrap();
        let sum: Vec<DVec3> = apart.iter().zip(&single).map(|(b, s)| *b + *s).collect();
        folded.set_lights(lights, &Silent).unwrap();
        let found = folded.radiosity(&Silent).unwrap();
        let (error, without) = (vertex_error(&found, &sum, &areas).rms, vertex_error(&found, &apart, &areas).rms);
        println!("folded against the sum {error:.4}, against the radiosity alone {without:.4}");
        assert!(error < 0.02 && without > 3.0 * error, "{error} {without}");
    }
    let measured = folded.measured_error(&[], &Silent).unwrap();
    assert!(measured.total_rms() < 0.05, "{measured:?}");
    // What a window draws of the other.
    let single = per_vertex(beside.as_mut(), &[sun()]);
    let apart = beside.radiosity(&Silent).unwrap();
    let mut drawn = Summed::of(beside);
    assert_eq!(drawn.single_scattering_is(), SingleScattering::Included);
    let sum: Vec<DVec3> = apart.iter().zip(&single).map(|(b, s)| *b + *s).collect();
    assert_eq!(drawn.radiosity(&Silent).unwrap(), sum);
    let nothing = Summed::of(open(bake("all_frequency", &scene, &["coefficients=9"])));
    assert_eq!(nothing.single_scattering_is(), SingleScattering::None);
}

#[test]
fn for_a_fixed_eye_it_is_a_part_of_the_radiosity() {
    let scene = head(0.4);
    let asset = bake("all_frequency", &scene, &["single-scattering=phase", "coefficients=25"]);
    let open = || registry().open(Arc::clone(&asset)).unwrap();
    let (mut beside, mut summed) = (open(), Summed::of(open()));
    let camera = Camera::new(DVec3::new(20.0, 15.0, 40.0), DVec3::ZERO, DVec3::Y, 30.0).unwrap();
    let mut settings = RenderSettings::new(camera, Resolution { width: 64, height: 64 });
    settings.specular = Specular::Off;
    settings.background = Background::None;
    settings.samples_per_pixel = 16;
    let lights = [environment(), sun()];
    let pixels = |evaluator: &dyn Evaluator, scattered: Scattered| -> Vec<DVec3> {
        let frame = render(evaluator, scattered, &lights, &settings, &Silent).unwrap();
        frame.pixels.iter().map(|p| glam::Vec3::from(p.beauty).as_dvec3()).collect()
    };
    for evaluator in [&mut beside, &mut summed] {
        evaluator.set_lights(lights.to_vec(), &Silent).unwrap();
    }
    let plain = beside.radiosity(&Silent).unwrap();
    assert_eq!(plain, summed.radiosity(&Silent).unwrap(), "without an eye nothing is added");
    assert_eq!([beside.set_eye(camera.at_mm()), summed.set_eye(camera.at_mm())], [false, true]);
    let difference = |a: &[DVec3], b: &[DVec3]| -> f64 {
        let sum = |values: &mut dyn Iterator<Item = DVec3>| values.map(|v| v.length_squared()).sum::<f64>();
        (sum(&mut a.iter().zip(b).map(|(a, b)| *a - *b)) / sum(&mut b.iter().copied())).sqrt()
    };
    let mut shown = Vec::new();
    for g in [0.4, -0.2] {
        let media = || {
            let mut media = scene.media.clone();
            media[0].properties.g = g;
            media
        };
        beside.set_media(media()).unwrap();
        summed.set_media(media()).unwrap();
        let radiosity = beside.radiosity(&Silent).unwrap();
        let eye = beside.towards_eye().unwrap().unwrap();
        let with = Scattered { single: Single::TowardsEye(eye.as_ref()), ..Scattered::from(&radiosity) };
        let truth = pixels(beside.as_ref(), with);
        let without = pixels(beside.as_ref(), Scattered::from(&radiosity));
        let found = summed.radiosity(&Silent).unwrap();
        let found = pixels(summed.as_ref(), Scattered::from(&found));
        let [error, share] = [difference(&found, &truth), difference(&without, &truth)];
        assert!(error < 0.1 * share && share > 0.01, "{g}: {error} of {share}");
        shown.push(found);
    }
    assert!(difference(&shown[0], &shown[1]) > 0.002);
    // Rays are not followed for every place of the eye.
    let asset = bake("all_frequency", &head(0.4), &["single-scattering=phase", "phase-terms=rays", "coefficients=25"]);
    let summed = Summed::of(registry().open(asset).unwrap());
    assert_eq!(summed.single_scattering_is(), SingleScattering::TracedTowardsEye);
}

#[test]
fn more_terms_come_nearer_to_the_phase_function() {
    let scene = head_of(1, 0.4);
    let areas = vertex_areas(&scene);
    let mut truth = open(bake("reference", &scene, &["single-scattering=phase"]));
    // Along the refracted way, which the inverse normal stands for.
    let expected = seen(truth.as_mut(), &[environment()]);
    let errors = ["1", "4", "16", "rays"].map(|terms| {
        let set = format!("phase-terms={terms}");
        let mut evaluator = open(bake("all_frequency", &scene, &["single-scattering=phase", "coefficients=100", &set]));
        assert!(evaluator.single_scattering(&Silent).unwrap().is_none());
        vertex_error(&seen(evaluator.as_mut(), &[environment()]), &expected, &areas).rms
    });
    println!("1, 4, 16 terms and rays: {errors:.4?}");
    assert!(errors[0] > 1.5 * errors[1] && errors[1] > errors[2] && errors[2] > errors[3]);
    assert!(errors[2] < 0.25 && errors[3] < 0.02, "{errors:?}");
}

#[test]
fn the_number_of_terms_follows_g() {
    let stored = |g: f64| {
        let mut ball = in_memory::scene(shapes::icosphere(10.0, 0), Scale::MillimetresPerUnit(1.0), "skin1");
        ball.media[0].properties.g = g;
        let asset = bake("all_frequency", &ball, &["single-scattering=phase", "coefficients=9"]);
        let file = translux_format::distant_transport::DistantTransport::from_sections(
            &asset.sections,
            asset.scene.mesh.local_mm.len(),
        );
        file.unwrap().unwrap().single.map(|single| single.terms)
    };
    assert_eq!([0.0, 0.25, -0.25, 0.4, 0.5, 0.9].map(stored), [Some(1), Some(4), Some(4), Some(9), Some(16), None]);
}

/// With g = 0 what is seen depends on the surface alone, with baked extinction; other properties stay.
#[test]
fn g_is_free_at_run_time() {
    let scene = head_of(1, 0.25);
    let mut evaluator = open(bake("all_frequency", &scene, &["single-scattering=phase", "coefficients=100"]));
    let before = seen(evaluator.as_mut(), &[sun()]);
    let radiosity = evaluator.radiosity(&Silent).unwrap();
    let mut media = evaluator.scene().media.clone();
    media[0].properties.g = -0.25;
    evaluator.set_media(media.clone()).unwrap();
    let after = seen(evaluator.as_mut(), &[sun()]);
    let brighter = before.iter().zip(&after).filter(|(a, b)| b.y > 1.1 * a.y).count();
    assert!(brighter > before.len() / 4, "light from outside that is scattered back: {brighter} of {}", before.len());
    assert_eq!(evaluator.radiosity(&Silent).unwrap(), radiosity);
    media[0].properties.eta_inside_over_outside = 1.4;
    assert_eq!(evaluator.set_media(media).unwrap_err().code(), ExitCode::Unsupported);
    let mut isotropic = open(bake("all_frequency", &scene, &["single-scattering=isotropic", "coefficients=100"]));
    let mut media = isotropic.scene().media.clone();
    media[0].properties.g = 0.0;
    assert_eq!(isotropic.set_media(media).unwrap_err().code(), ExitCode::Unsupported);
}

#[test]
fn keys_that_do_not_fit_are_refused() {
    let scene = in_memory::scene(shapes::icosphere(5.0, 1), Scale::MillimetresPerUnit(1.0), "marble");
    let method = in_memory::method("all_frequency");
    for (set, word) in [
        (vec!["single-scattering=on"], "off, isotropic, folded, phase"),
        (vec!["phase-terms=4"], "single-scattering=phase"),
        (vec!["single-scattering=phase", "phase-terms=8"], "auto, 1, 4, 9, 16, rays"),
        (vec!["single-scattering=phase", "single-basis=haar"], "isotropic"),
        (vec!["single-basis=haar"], "single-scattering=isotropic"),
        (vec!["single-form=printed"], "single-scattering=isotropic"),
        (vec!["single-scattering=isotropic", "single-form=real"], "physical, printed"),
        (vec!["single-scattering=isotropic", "single-crossings=none"], "occluded, attenuated"),
        (vec!["single-scattering=folded", "basis=haar"], "basis=sh"),
    ] {
        let error = try_bake(method, scene.clone(), Some(500), &pairs(&set)).unwrap_err();
        assert_eq!(error.code(), ExitCode::CommandLine, "{set:?}");
        assert!(error.message().contains(word), "{set:?}: {}", error.message());
    }
}
