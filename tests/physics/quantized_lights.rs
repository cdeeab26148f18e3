//! `quantized_lights`, which is in work and not yet among all methods: its radiosity against that of `two_pass`, its promise, its
//! size, the same bytes on any number of threads, and a light that turns.
#![allow(clippy::unwrap_used, missing_docs)]

use crate::{baked, in_memory};
use std::sync::Arc;

use crate::in_memory::{lit, method, pairs, registry, scene, vertex_areas};
use glam::DVec3;
use translux::asset::{Asset, Provenance};
use translux::error::ExitCode;
use translux::evaluate::{BakeSettings, Evaluator};
use translux::geometry::mesh::Scale;
use translux::geometry::shapes;
use translux::light::{Light, LightKind, sky};
use translux::math::statistics::vertex_error;
use translux::measure::probes::{self, Half};
use translux::progress::Silent;
use translux::scene::Scene;

const SAMPLES: usize = 4000;

fn head() -> Scene {
    scene(shapes::bumpy_head(1.0, 3), Scale::DiagonalMm(20.0), "marble")
}

fn bake(scene: &Scene, kinds: &[LightKind], set: &[(&str, &str)]) -> Asset {
    let settings = BakeSettings {
        samples: Some(SAMPLES),
        for_lights: kinds.iter().copied().collect(),
        probes: in_memory::probes(scene),
        ..BakeSettings::new(0.02)
    };
    let recipe = method("quantized_lights").recipe(&pairs(set), settings).unwrap();
    recipe.bake(scene.clone(), Provenance::default(), &Silent).unwrap()
}

fn reopened(asset: &Asset) -> Box<dyn Evaluator> {
    let asset = Asset::from_bytes(&asset.to_bytes().unwrap()).unwrap();
    registry().open(Arc::new(asset)).unwrap()
}

fn truth(scene: &Scene, light: &Light) -> Arc<Vec<DVec3>> {
    baked::radiosity("two_pass", scene, 4 * SAMPLES, &[], std::slice::from_ref(light))
}

fn sky_light() -> Light {
    Light::environment(Arc::new(sky::sky()), 40.0, DVec3::new(1.0, 0.8, 0.5)).unwrap()
}

const PARALLEL: [LightKind; 3] = [LightKind::Directional, LightKind::Environment, LightKind::Constant];

#[test]
fn radiosity_is_that_of_two_pass_within_the_promise() {
    let scene = head();
    let asset = bake(&scene, &PARALLEL, &[]);
    let mut evaluator = reopened(&asset);
    let mut lights = probes::directional(Half::Figures);
    lights.truncate(3);
    lights.push(Light::directional(DVec3::new(1.0, 2.0, 3.0), DVec3::new(3.0, 2.0, 1.0)).unwrap());
    lights.extend([Light::constant(DVec3::new(0.5, 0.6, 0.7)).unwrap(), sky_light()]);
    for light in lights {
        let values = lit(evaluator.as_mut(), vec![light.clone()]);
        let found = vertex_error(&values, &truth(&scene, &light), &vertex_areas(&scene)).rms;
        let promised = evaluator.measured_error(&[], &Silent).unwrap().total_rms();
        println!("{light}: {:.2} % RMS, promised {:.2} %", 100.0 * found, 100.0 * promised);
        assert!(found < 0.04 && found < 1.25 * promised + 2.5e-3, "{light}: {found} {promised}");
        assert!(values.iter().all(|v| v.cmpge(DVec3::ZERO).all()));
    }
    let stages: Vec<&str> = asset.ledger.entries.iter().map(|e| e.stage.as_str()).collect();
    assert_eq!(stages, ["sampling", "hierarchy", "lights", "reference points", "coding"]);
    let bytes: usize = asset.sections.iter().map(|s| s.bytes.len()).sum();
    let per_vertex = bytes as f64 / scene.mesh.local_mm.len() as f64;
    println!("{per_vertex:.1} bytes/vertex");
    assert!(per_vertex < 60.0, "{per_vertex} bytes/vertex of a mesh of 2,562 vertices");
}

#[test]
fn lights_add_up_and_threads_do_not_change_a_bit() {
    let scene = scene(shapes::bumpy_head(1.0, 3), Scale::DiagonalMm(20.0), "skin1");
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let asset = bake(&scene, &PARALLEL, &[("lights", "100")]);
            let values = lit(reopened(&asset).as_mut(), vec![sky_light()]);
            (asset.to_bytes().unwrap(), values)
        })
    };
    let first = run(1);
    assert!(run(8) == first, "8 threads");
    let mut evaluator = reopened(&Asset::from_bytes(&first.0).unwrap());
    let sun = Light::directional(DVec3::new(1.0, 1.0, 2.0), DVec3::ONE).unwrap();
    let alone = lit(evaluator.as_mut(), vec![sun.clone()]);
    let both = lit(evaluator.as_mut(), vec![sun, sky_light()]);
    for ((both, sky), sun) in both.iter().zip(&first.1).zip(&alone) {
        // Undershoots are cut at 0 one by one.
        assert!((*both - *sky - *sun).abs().max_element() < 0.02 * both.max_element().max(0.1), "{both} {sky} {sun}");
    }
}

#[test]
fn point_lights_are_served_from_their_shells_and_refused_elsewhere() {
    let scene = head();
    let at = |distance: f64| {
        let at = scene.mesh.origin_mm + distance * DVec3::new(0.36, 0.48, 0.8);
        Light::point(at, DVec3::splat(distance * distance)).unwrap()
    };
    let mut parallel = reopened(&bake(&scene, &PARALLEL, &[("lights", "100")]));
    let error = parallel.set_lights(vec![at(30.0)], &Silent).unwrap_err();
    assert_eq!(error.code(), ExitCode::Unsupported, "{}", error.message());
    let mut evaluator = reopened(&bake(&scene, &[LightKind::Point], &[("lights", "150")]));
    for distance in [17.0, 25.0, 60.0, 1e4] {
        let values = lit(evaluator.as_mut(), vec![at(distance)]);
        let found = vertex_error(&values, &truth(&scene, &at(distance)), &vertex_areas(&scene)).rms;
        println!("{distance} mm: {:.2} %", 100.0 * found);
        assert!(found < 0.06, "{distance}: {found}");
    }
    let error = evaluator.set_lights(vec![at(8.0)], &Silent).unwrap_err();
    assert_eq!(error.code(), ExitCode::Unsupported, "{}", error.message());
    assert!(error.message().contains("mm"), "{}", error.message());
}

/// Largest motion of a vertex while the light turns by 0.1 degrees, in 99.5th percentiles of all radiosities.
fn largest_step(evaluator: &mut dyn Evaluator) -> f64 {
    let light = |step: usize| {
        let (sin, cos) = (0.1 * step as f64).to_radians().sin_cos();
        Light::directional(DVec3::new(cos, 0.35, sin), DVec3::ONE).unwrap()
    };
    let mut before = lit(evaluator, vec![light(0)]);
    let mut all: Vec<f64> = before.iter().map(|v| v.max_element()).collect();
    all.sort_unstable_by(f64::total_cmp);
    let scale = all[all.len() * 995 / 1000];
    let mut largest = 0.0f64;
    // 25 degrees: directions of 200 lie 14 apart.
    for step in 1..250 {
        let now = lit(evaluator, vec![light(step)]);
        let moved = now.iter().zip(&before).map(|(a, b)| (*a - *b).abs().max_element()).fold(0.0, f64::max);
        largest = largest.max(moved / scale);
        before = now;
    }
    largest
}

#[test]
fn nothing_pops_when_the_light_turns_but_for_the_nearest_four() {
    let scene = head();
    let step = |interpolation: &str| {
        largest_step(
            reopened(&bake(&scene, &PARALLEL, &[("lights", "200"), ("interpolation", interpolation)])).as_mut(),
        )
    };
    let [smooth, linear, nearest] = ["rbf", "barycentric", "nearest4"].map(step);
    println!("rbf {smooth:.4}, barycentric {linear:.4}, nearest4 {nearest:.4}");
    assert!(smooth < 5e-3 && linear < 8e-3 && nearest > 2e-2, "{smooth} {linear} {nearest}");
}

#[test]
fn keys_are_judged_and_materials_stay() {
    let scene = scene(shapes::bumpy_head(1.0, 2), Scale::DiagonalMm(20.0), "marble");
    for key in method("quantized_lights").keys() {
        for value in ["", "?", "-1", "1e99", "nan"] {
            let given = [(key.name().to_owned(), value.to_owned())];
            let error = in_memory::try_bake(method("quantized_lights"), scene.clone(), Some(500), &given).unwrap_err();
            assert_eq!(error.code(), ExitCode::CommandLine, "{}={value}", key.name());
            assert!(error.message().contains(key.name()), "{}", error.message());
        }
    }
    let mut evaluator = reopened(&bake(&scene, &PARALLEL, &[("lights", "50")]));
    evaluator.set_media(scene.media.clone()).unwrap();
    let error = evaluator.set_media(vec![in_memory::medium("skin1")]).unwrap_err();
    assert_eq!(error.code(), ExitCode::Unsupported);
}

/// Bytes that were changed give an error or an evaluator, never a panic.
#[test]
fn damaged_sections_are_refused_or_harmless() {
    let scene = scene(shapes::bumpy_head(1.0, 2), Scale::DiagonalMm(20.0), "marble");
    let asset = bake(&scene, &PARALLEL, &[("lights", "50")]);
    for index in 0..asset.sections.len() {
        let mut without = asset.clone();
        let tag = without.sections.remove(index).tag;
        assert_eq!(registry().open(Arc::new(without)).err().unwrap().code(), ExitCode::InvalidInput, "{tag}");
        let length = asset.sections[index].bytes.len();
        for at in (0..length).step_by((length / 20).max(1)) {
            let mut changed = asset.clone();
            changed.sections[index].bytes[at] ^= 0x55;
            if let Ok(mut evaluator) = registry().open(Arc::new(changed))
                && evaluator.set_lights(vec![sky_light()], &Silent).is_ok()
            {
                let _ = evaluator.radiosity(&Silent);
            }
        }
    }
}
