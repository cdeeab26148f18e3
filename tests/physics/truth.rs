//! The methods against radiosities that another program computed, in the shared data beside the repository (or
//! `TRANSLUX_SHARED`). `TRANSLUX_LONG=1` runs all of them, otherwise only what takes seconds.
#![allow(clippy::unwrap_used, missing_docs, dead_code)]

use std::time::Instant;

use crate::in_memory::{error, long, open, radiosity, scene};
use crate::oracle::truth_files::{self, shared};
use crate::oracle::vector::V3;
use glam::DVec3;
use translux::geometry::mesh::Scale;
use translux::io::environment::load_environment;
use translux::io::obj::read_obj;
use translux::light::Light;

/// A truth file: what its header says, and the errors that are allowed `reference` and `two_pass`.
struct Case {
    file: &'static str,
    mesh: &'static str,
    size_mm: f64,
    material: &'static str,
    light: Light,
    limits: [f64; 2],
}

const SHARP: [f64; 2] = [3e-3, 6e-3];
const ENVIRONMENT: [f64; 2] = [1.5e-2, 1.6e-2];

fn check(case: Case) {
    let Some(path) = shared(&format!("truth/{}.csv", case.file)) else { return };
    let Some(mesh) = shared(&format!("data/meshes/{}.obj", case.mesh)) else { return };
    let text = std::fs::read_to_string(path).unwrap();
    let truth: Vec<(usize, V3)> = truth_files::rows_of(&text);
    assert!(truth.len() >= 50, "{} has {} rows", case.file, truth.len());
    let scene = scene(read_obj(&mesh).unwrap(), Scale::DiagonalMm(case.size_mm), case.material);
    for (method, limit) in ["reference", "two_pass"].into_iter().zip(case.limits) {
        let start = Instant::now();
        let mut evaluator = open(method, scene.clone(), None);
        let (rms, bias) = error(&radiosity(evaluator.as_mut(), case.light.clone()), &truth);
        println!(
            "{}: {method} {:.3} % RMS, bias {:+.3} % ({} samples, {:.1} s)",
            case.file,
            100.0 * rms,
            100.0 * bias,
            evaluator.cost().samples,
            start.elapsed().as_secs_f64()
        );
        assert!(rms < limit, "{}: {method} {rms:.2e} against {limit:.1e}", case.file);
    }
}

fn sun(from: [f64; 3], irradiance: [f64; 3]) -> Light {
    Light::directional(DVec3::from(from), DVec3::from(irradiance)).unwrap()
}

fn lamp() -> Light {
    Light::point(DVec3::new(-18.0, 22.0, 25.0), DVec3::splat(900.0)).unwrap()
}

fn bunny(file: &'static str, material: &'static str, light: Light, limits: [f64; 2]) -> Case {
    let mesh = if file.starts_with("bunny_closed") { "bunny_closed" } else { "bunny_3k" };
    Case { file, mesh, size_mm: 30.0, material, light, limits }
}

#[test]
fn bunny_of_marble_under_a_directional_light() {
    check(bunny("bunny_3k_30mm_marble_directional", "marble", sun([0.4, 0.7, 0.6], [3.0; 3]), SHARP));
}

#[test]
fn bunny_of_skin_under_a_point_light() {
    check(bunny("bunny_3k_30mm_skin1_point", "skin1", lamp(), SHARP));
}

#[test]
fn igea_of_skin_under_a_directional_light() {
    check(Case {
        file: "igea_8k_10mm_skin1_directional",
        mesh: "igea_8k",
        size_mm: 10.0,
        material: "skin1",
        light: sun([0.0, 0.2, 1.0], [3.0; 3]),
        limits: SHARP,
    });
}

#[test]
fn bunny_of_marble_under_even_light() {
    if long() {
        let light = Light::constant(DVec3::ONE).unwrap();
        check(bunny("bunny_3k_30mm_marble_constant", "marble", light, SHARP));
    }
}

fn environment(file: &str, rotate_degrees: f64) -> Option<Light> {
    let map = load_environment(&shared(&format!("data/env/{file}"))?).unwrap().value;
    Some(Light::environment(std::sync::Arc::new(map), rotate_degrees, DVec3::ONE).unwrap())
}

#[test]
fn bunnies_under_environments() {
    if long() {
        let Some(uffizi) = environment("debevec_uffizi_256.hdr", 0.0) else { return };
        check(bunny("bunny_3k_30mm_marble_env_debevec_uffizi_256", "marble", uffizi, ENVIRONMENT));
        let Some(grass) = environment("noon_grass_1k.hdr", 90.0) else { return };
        check(bunny("bunny_3k_30mm_skin1_env_noon_grass_1k", "skin1", grass, ENVIRONMENT));
    }
}

#[test]
fn large_meshes() {
    if long() {
        let sunny = sun([0.4, 0.7, 0.6], [3.0; 3]);
        check(bunny("bunny_closed_30mm_marble_directional", "marble", sunny.clone(), SHARP));
        check(bunny("bunny_closed_30mm_spectralon_directional", "spectralon", sunny, SHARP));
        check(bunny("bunny_closed_30mm_ketchup_point", "ketchup", lamp(), SHARP));
        check(Case {
            file: "horse_100mm_cream_directional",
            mesh: "horse",
            size_mm: 100.0,
            material: "cream",
            light: sun([-0.5, 0.3, 0.8], [1.0, 2.0, 3.0]),
            limits: SHARP,
        });
    }
}
