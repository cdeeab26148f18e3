//! `all_frequency`: its bases against `reference`, what more coefficients buy, suns between texels, keys and lights that are refused,
//! the same on a device.
#![allow(clippy::unwrap_used, missing_docs)]

#[cfg(feature = "gpu")]
use crate::on_device;
use crate::{baked, in_memory};
use std::sync::Arc;

use crate::in_memory::{lit, registry, scene, try_bake, vertex_areas};
use glam::DVec3;
use translux::asset::Asset;
use translux::error::ExitCode;
use translux::evaluate::Evaluator;
use translux::geometry::mesh::Scale;
use translux::geometry::shapes;
use translux::light::{Light, sky};
use translux::math::statistics::vertex_error;
use translux::progress::Silent;
use translux::scene::Scene;

const SAMPLES: usize = 2000;
const TRUTH_SAMPLES: usize = 5000;

fn knot() -> Scene {
    scene(shapes::torus_knot(2, 3, 10.0, 4.0, 1.5, 36, 7), Scale::DiagonalMm(30.0), "marble")
}

fn pairs(set: &[&str]) -> Vec<(String, String)> {
    set.iter().map(|pair| pair.split_once('=').unwrap()).map(|(k, v)| (k.to_owned(), v.to_owned())).collect()
}

fn bake(scene: &Scene, set: &[&str]) -> Arc<Asset> {
    baked::asset("all_frequency", scene, SAMPLES, set)
}

fn open(asset: Arc<Asset>) -> Box<dyn Evaluator> {
    registry().open(asset).unwrap()
}

fn environment(degrees: f64) -> Light {
    Light::environment(Arc::new(sky::sky()), degrees, DVec3::new(1.0, 0.8, 0.6)).unwrap()
}

fn sun(from: DVec3) -> Light {
    Light::directional(from, DVec3::ONE).unwrap()
}

/// The brute-force truth on samples of its own.
fn truth(scene: &Scene, set: &[&str], lights: &[Light]) -> Arc<Vec<DVec3>> {
    baked::radiosity("reference", scene, TRUTH_SAMPLES, set, lights)
}

#[test]
fn both_bases_give_the_reference_and_more_coefficients_less_error() {
    let scene = knot();
    let areas = vertex_areas(&scene);
    let lights = [vec![environment(20.0)], vec![environment(20.0), sun(DVec3::new(0.5, 0.7, 0.2))]];
    let truths: Vec<_> = lights.iter().map(|l| truth(&scene, &[], l)).collect();
    let errors = |set: &[&str]| {
        let mut evaluator = open(bake(&scene, set));
        let of = |(lights, truth): (&Vec<Light>, &Arc<Vec<DVec3>>)| {
            vertex_error(&lit(evaluator.as_mut(), lights.clone()), truth, &areas).rms
        };
        let found: Vec<f64> = lights.iter().zip(&truths).map(of).collect();
        println!("{set:?}: {found:.4?}");
        found
    };
    let few = errors(&["basis=haar", "coefficients=32"]);
    let paper = errors(&["basis=haar", "selection=magnitude", "transform=texels"]);
    let haar = errors(&["basis=haar"]);
    let rate = errors(&["basis=haar", "selection=rate"]);
    let many = errors(&["basis=haar", "coefficients=512"]);
    let low = errors(&["coefficients=9"]);
    let auto = errors(&[]);
    assert!(few[0] > haar[0] && many[1] < haar[1] && haar[0] < paper[0] && haar[1] < paper[1]);
    assert!(rate[0] < 1.2 * haar[0] && rate[1] < 1.2 * haar[1]);
    assert!(low[1] > 2.0 * auto[1] && auto[0] < 0.01 && auto[1] < 0.02, "{auto:?}");
    assert!(auto[1] < many[1], "512 wavelets are no match under a sun");
}

/// A knot sees itself: what leaves it falls on it again.
#[test]
fn light_that_comes_back_is_that_of_the_reference() {
    let scene = knot();
    let areas = vertex_areas(&scene);
    let lights = vec![environment(20.0), sun(DVec3::new(0.5, 0.7, 0.2))];
    let reference = |set: &[&str]| truth(&scene, set, &lights);
    let without = reference(&[]);
    for times in ["once", "3"] {
        let key = format!("inter-reflection={times}");
        let expected = reference(&[&key]);
        let mut evaluator = open(bake(&scene, &[&key, "coefficients=400"]));
        let found = lit(evaluator.as_mut(), lights.clone());
        let (error, change) =
            (vertex_error(&found, &expected, &areas).rms, vertex_error(&without, &expected, &areas).rms);
        println!("{times}: {error:.4}, what comes back {change:.4}");
        assert!(error < 0.015 && change > 3.0 * error, "{times}: {error} {change}");
        let measured = evaluator.measured_error(&[], &Silent).unwrap();
        assert!(measured.total_rms() < 0.05, "{measured:?}");
    }
}

/// Harmonics do not know texels; a sun between the centres of two is no worse than one at a centre.
#[test]
fn a_sun_moves_smoothly_past_texels() {
    let scene = knot();
    let areas = vertex_areas(&scene);
    let mut evaluator = open(bake(&scene, &[]));
    let mut worst = 0.0f64;
    let mut before: Option<Vec<DVec3>> = None;
    let full = {
        let values = lit(evaluator.as_mut(), vec![sun(DVec3::Y)]);
        values.iter().fold(0.0f64, |a, v| a.max(v.max_element()))
    };
    // 4 degrees, of which a texel fills 3 at most.
    for step in 0..40 {
        let angle = (30.0 + 0.1 * f64::from(step)).to_radians();
        let values = lit(evaluator.as_mut(), vec![sun(DVec3::new(angle.sin(), angle.cos(), 0.1))]);
        if let Some(before) = &before {
            let jump = values.iter().zip(before).map(|(a, b)| (*a - *b).abs().max_element()).fold(0.0, f64::max);
            worst = worst.max(jump / full);
        }
        before = Some(values);
    }
    println!("largest change in 0.1 degrees: {:.3} % of full scale", 100.0 * worst);
    assert!(worst < 0.01, "{worst}");
    assert!(areas.iter().all(|a| *a > 0.0));
}

#[test]
fn a_turned_environment_is_the_turned_body() {
    // A quarter turn of the light about +Y is the opposite turn of what it falls on.
    let scene = scene(shapes::icosphere(8.0, 3), Scale::MillimetresPerUnit(1.0), "marble");
    let mut evaluator = open(bake(&scene, &[]));
    let [first, second] = [0.0, 90.0].map(|degrees| lit(evaluator.as_mut(), vec![environment(degrees)]));
    let at = |v: usize| scene.mesh.local_mm[v].as_dvec3();
    let mut worst = 0.0f64;
    for v in 0..first.len() {
        let p = at(v);
        let turned = DVec3::new(p.z, p.y, -p.x);
        let image =
            (0..first.len()).min_by(|a, b| at(*a).distance(turned).total_cmp(&at(*b).distance(turned))).unwrap();
        if at(image).distance(turned) < 1e-3 {
            worst = worst.max((second[image] - first[v]).abs().max_element());
        }
    }
    let full = first.iter().fold(0.0f64, |a, v| a.max(v.max_element()));
    println!("{:.2} % of full scale", 100.0 * worst / full);
    // The body's triangles do not turn along.
    assert!(worst > 0.0 && worst < 0.02 * full, "{}", worst / full);
}

#[test]
fn transport_takes_few_bytes() {
    let scene = scene(shapes::bumpy_head(1.0, 5), Scale::DiagonalMm(30.0), "marble");
    let vertices = scene.mesh.local_mm.len();
    let size = |asset: &Asset| asset.sections.iter().map(|s| s.bytes.len()).sum::<usize>() / vertices;
    let asset = bake(&scene, &[]);
    assert!(size(&asset) <= 100, "{} bytes a vertex", size(&asset));
    let resident = open(asset).cost().resident_bytes / vertices;
    println!("{resident} bytes a vertex in memory");
    assert!(resident <= 250, "{resident} bytes a vertex in memory");
}

#[test]
fn keys_and_lights_that_do_not_fit_are_refused() {
    let scene = scene(shapes::icosphere(5.0, 2), Scale::MillimetresPerUnit(1.0), "marble");
    let method = in_memory::method("all_frequency");
    for (set, word) in [
        (vec!["coefficients=50"], "49 or 64"),
        (vec!["coefficients=1089"], "1024"),
        (vec!["transform=texels"], "basis=haar"),
        (vec!["basis=haar", "spacing=1"], "basis=sh"),
        (vec!["basis=haar", "coefficients=5"], "6 to 6144"),
        (vec!["basis=fourier"], "auto, sh, haar"),
        (vec!["cube=48"], "32, 64"),
        (vec!["inter-reflection=twice"], "off, once"),
        (vec!["basis=haar", "inter-reflection=once"], "basis=sh"),
    ] {
        let error = try_bake(method, scene.clone(), Some(500), &pairs(&set)).unwrap_err();
        assert_eq!(error.code(), ExitCode::CommandLine, "{set:?}");
        assert!(error.message().contains(word), "{set:?}: {}", error.message());
    }
    for set in [&[][..], &["basis=haar"]] {
        let mut evaluator = open(baked::asset("all_frequency", &scene, 500, set));
        let before = lit(evaluator.as_mut(), vec![environment(0.0)]);
        let lamp = Light::point(DVec3::new(0.0, 30.0, 0.0), DVec3::ONE).unwrap();
        assert_eq!(evaluator.set_lights(vec![lamp], &Silent).unwrap_err().code(), ExitCode::Unsupported);
        assert_eq!(evaluator.radiosity(&Silent).unwrap(), before, "a refusal leaves no trace");
    }
}

#[test]
fn finer_cube_maps_do_not_lose() {
    let scene = knot();
    let areas = vertex_areas(&scene);
    let light = vec![environment(20.0)];
    let expected = truth(&scene, &[], &light);
    let [coarse, fine] = ["cube=32", "cube=64"].map(|cube| {
        let mut evaluator = open(bake(&scene, &[cube, "coefficients=400", "spacing=0.2"]));
        vertex_error(&lit(evaluator.as_mut(), light.clone()), &expected, &areas).rms
    });
    println!("32: {coarse:.2e}, 64: {fine:.2e}");
    assert!(fine < 1.1 * coarse && coarse < 0.01);
}

#[cfg(feature = "gpu")]
#[test]
fn a_device_gives_the_same() {
    let Some(device) = on_device::device(u64::MAX) else { return };
    let scene = knot();
    let lights = vec![environment(33.0), sun(DVec3::new(0.3, 0.8, -0.2))];
    let asset = bake(&scene, &[]);
    let mut cpu = open(Arc::clone(&asset));
    let mut gpu = open(asset).on_device(&device).unwrap();
    let (expected, found) = (lit(cpu.as_mut(), lights.clone()), lit(gpu.as_mut(), lights));
    let error = vertex_error(&found, &expected, &vertex_areas(&scene)).worst;
    println!("device: {error:.1e}");
    assert!(error < 1e-4, "{error}");
    let rows = open(bake(&scene, &["basis=haar"]));
    assert_eq!(rows.on_device(&device).map(|_| ()).unwrap_err().code(), ExitCode::Unsupported);
}
