//! `hao_varshney` with `encoding=bleeding`: the paper's two passes at run time over lists of neighbouring vertices.
#![allow(clippy::unwrap_used, missing_docs)]

use crate::in_memory;
use std::f64::consts::PI;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use crate::hao::{METHOD, registry};
use crate::in_memory::{lit, open, scene, scene_of, try_bake, vertex_areas};
use glam::DVec3;
use translux::asset::Asset;
use translux::error::{ExitCode, Result};
use translux::evaluate::{Evaluator, MaterialEdit};
use translux::geometry::mesh::Scale;
use translux::geometry::shapes;
use translux::geometry::source::SourceModel;
use translux::light::{Light, sky};
use translux::math::statistics::vertex_error;
use translux::measure::probes::{self, Half};
use translux::progress::Silent;
use translux::scene::Scene;
use translux_format::Kind;

fn bake(scene: &Scene, samples: usize, set: &[(&str, &str)]) -> Result<Asset> {
    let mut given: Vec<(String, String)> = set.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect();
    given.push(("encoding".to_owned(), "bleeding".to_owned()));
    try_bake(registry().method(METHOD).unwrap(), scene.clone(), Some(samples), &given)
}

fn reopened(asset: &Asset) -> Box<dyn Evaluator> {
    let asset = Asset::from_bytes(&asset.to_bytes().unwrap()).unwrap();
    registry().open(Arc::new(asset)).unwrap()
}

fn lights(scene: &Scene) -> Vec<Light> {
    let mut lights = probes::directional(Half::Figures);
    lights.truncate(2);
    lights.push(Light::directional(DVec3::new(1.0, 2.0, 3.0), DVec3::new(3.0, 2.0, 1.0)).unwrap());
    lights.push(Light::constant(DVec3::new(0.5, 0.6, 0.7)).unwrap());
    lights.push(Light::environment(Arc::new(sky::sky()), 40.0, DVec3::new(1.0, 0.8, 0.5)).unwrap());
    let (diagonal, centre) = (scene.mesh.diagonal_mm(), scene.mesh.origin_mm);
    lights.push(Light::point(centre + diagonal * DVec3::new(0.5, 0.6, 0.2), DVec3::splat(400.0)).unwrap());
    lights
}

/// Relative error under the worst of some lights.
fn worst(evaluator: &mut dyn Evaluator, truth: &mut dyn Evaluator, lights: &[Light]) -> f64 {
    let areas = vertex_areas(evaluator.scene());
    let error = |light: &Light| {
        let found = lit(evaluator, vec![light.clone()]);
        assert!(found.iter().all(|v| v.is_finite() && v.cmpge(DVec3::ZERO).all()));
        vertex_error(&found, &lit(truth, vec![light.clone()]), &areas).rms
    };
    lights.iter().map(error).fold(0.0, f64::max)
}

#[test]
fn a_fine_mesh_gives_the_radiosity_of_two_pass() {
    let scene = scene(shapes::bumpy_head(1.0, 4), Scale::DiagonalMm(20.0), "marble");
    let asset = bake(&scene, 6_000, &[]).unwrap();
    let mut evaluator = reopened(&asset);
    let mut truth = open("two_pass", scene.clone(), Some(16_000));
    for light in lights(&scene) {
        let found = worst(evaluator.as_mut(), truth.as_mut(), std::slice::from_ref(&light));
        let promised = evaluator.measured_error(&[], &Silent).unwrap().total_rms();
        println!("{light}: {:.2} % RMS, promised {:.2} %", 100.0 * found, 100.0 * promised);
        assert!(found < 0.03 && found < 1.25 * promised + 2.5e-3, "{light}: {found} {promised}");
    }
    let stages: Vec<&str> = asset.ledger.entries.iter().map(|e| e.stage.as_str()).collect();
    assert_eq!(stages, ["range", "vertices as samples"]);
    println!("{:?}", asset.ledger.entries);
    // Beside the names of the form and its settings.
    let own = asset.sections.iter().filter(|s| s.kind == Kind::Method);
    let bytes: usize = own.map(|s| s.bytes.len()).sum();
    assert!(bytes < 64, "{bytes} bytes of a range and a number");
    assert_eq!(evaluator.capabilities().material, MaterialEdit::None);
    let cost = evaluator.cost();
    let per_vertex = cost.resident_bytes as f64 / cost.receivers as f64;
    println!("{per_vertex:.0} bytes/vertex in memory");
    assert!(per_vertex > 16.0 * 500.0, "{per_vertex}");
}

/// Figures of the documentation: error, lists, bytes, times.
#[test]
fn print_figures() {
    if !in_memory::long() {
        return;
    }
    for name in ["bunny_3k", "horse", "bunny_closed"] {
        let Some(model) = shared(&format!("meshes/{name}.obj")) else { return };
        let model = translux::io::obj::read_obj(&model).unwrap();
        for material in ["marble", "skin1"] {
            let scene = scene(model.clone(), Scale::DiagonalMm(30.0), material);
            let mut truth = open("two_pass", scene.clone(), None);
            for share in ["5%", "20%", "50%"] {
                let now = Instant::now();
                let asset = match bake(&scene, 131_072, &[("range-share", share)]) {
                    Ok(asset) => asset,
                    Err(error) => {
                        println!("{name} {material} {share}: {}", error.message());
                        continue;
                    }
                };
                let baked = now.elapsed();
                let now = Instant::now();
                let mut evaluator = reopened(&asset);
                let opened = now.elapsed();
                let light = probes::directional(Half::Figures).remove(0);
                evaluator.bvh();
                let now = Instant::now();
                evaluator.set_lights(vec![light.clone()], &Silent).unwrap();
                let first = now.elapsed();
                let now = Instant::now();
                evaluator.radiosity(&Silent).unwrap();
                let second = now.elapsed();
                let mut some = probes::directional(Half::Figures);
                some.truncate(4);
                let error = worst(evaluator.as_mut(), truth.as_mut(), &some);
                let cost = evaluator.cost();
                let ledger: Vec<String> =
                    asset.ledger.entries.iter().map(|e| format!("{} {:.2e}", e.stage, e.error.rms)).collect();
                println!(
                    "{name} {material} {share}: {} vertices, {:.0} entries each ({:.1} %), {:.1} MB, bake {baked:.1?}, open {opened:.1?}, \
                     relight {first:.1?} + {second:.1?}, RMS {error:.4}; {}",
                    cost.receivers,
                    cost.resident_bytes as f64 / 16.0 / cost.receivers as f64,
                    100.0 * cost.resident_bytes as f64 / 16.0 / (cost.receivers as f64).powi(2),
                    cost.resident_bytes as f64 * 1e-6,
                    ledger.join(", ")
                );
            }
        }
    }
}

fn shared(path: &str) -> Option<PathBuf> {
    let root = std::env::var_os("TRANSLUX_SHARED")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared"), PathBuf::from);
    let file = root.join("data").join(path);
    if !file.exists() {
        println!("WITHOUT ../shared: {} is not there", file.display());
        return None;
    }
    Some(file)
}

/// A sphere whose parallels crowd around one pole, the more the larger the exponent.
fn graded_sphere(exponent: f64) -> SourceModel {
    let mut model = shapes::uv_sphere(1.0, 24, 24);
    for p in &mut model.positions {
        let polar = p.y.clamp(-1.0, 1.0).acos();
        let moved = PI * (polar / PI).powf(exponent);
        let around = p.x.hypot(p.z);
        let scale = if around > 1e-12 { moved.sin() / around } else { 0.0 };
        *p = DVec3::new(p.x * scale, moved.cos(), p.z * scale);
    }
    model
}

/// Where triangles are wider than the light spreads and their neighbours are not, a third of the triangles around a vertex is not what
/// it stands for: the crude quadrature fails, and says so.
#[test]
fn uneven_meshes_fail_and_the_ledger_says_so() {
    let error = |exponent: f64| {
        let scene = scene(graded_sphere(exponent), Scale::DiagonalMm(30.0), "marble");
        let asset = bake(&scene, 5_000, &[]).unwrap();
        let mut truth = open("two_pass", scene.clone(), Some(12_000));
        let found = worst(reopened(&asset).as_mut(), truth.as_mut(), &lights(&scene));
        let promised = asset.ledger.entries[1].error.rms;
        println!("exponent {exponent}: {:.2} %, in the ledger {:.2} %", 100.0 * found, 100.0 * promised);
        assert!(promised > 0.3 * found, "{promised} {found}");
        found
    };
    let [even, graded, strongly] = [1.0, 4.0, 8.0].map(error);
    assert!(
        even < 0.04 && graded > 1.2 * even && strongly > 3.0 * even && strongly > 0.08,
        "{even} {graded} {strongly}"
    );
}

#[test]
fn parts_do_not_exchange_light_and_opaque_ones_only_cast_shadows() {
    let named = |name: &str, mut model: SourceModel| {
        model.materials = vec![name.to_owned()];
        model
    };
    let two = shapes::compose(&[
        (named("left", shapes::icosphere(5.0, 3)), DVec3::ZERO),
        (named("right", shapes::icosphere(5.0, 3)), DVec3::new(10.5, 0.0, 0.0)),
        (named("plate", shapes::cuboid(DVec3::new(60.0, 0.5, 60.0), 2)), DVec3::new(0.0, -8.0, 0.0)),
    ]);
    let scene = scene_of(two, Scale::MillimetresPerUnit(1.0), &[("left", "marble"), ("right", "skin1")]);
    let mut evaluator = reopened(&bake(&scene, 8_000, &[("range-share", "2%")]).unwrap());
    let mut truth = open("two_pass", scene.clone(), Some(30_000));
    let brightest = |values: &[DVec3], right: bool| {
        let of_side = values
            .iter()
            .zip(&scene.mesh.local_mm)
            .filter(|(_, p)| (f64::from(p.x) + scene.mesh.origin_mm.x > 5.25) == right);
        of_side.map(|(v, _)| v.max_element()).fold(0.0, f64::max)
    };
    for from in [DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y] {
        let light = Light::directional(from, DVec3::ONE).unwrap();
        let values = lit(evaluator.as_mut(), vec![light.clone()]);
        if from == DVec3::NEG_X {
            // The left sphere hides the right one, and does not glow into it.
            assert!(brightest(&values, false) > 0.5 && brightest(&values, true) < 0.01);
        } else if from == DVec3::NEG_Y {
            assert_eq!(brightest(&values, false), 0.0, "the plate hides both");
        }
        let expected = lit(truth.as_mut(), vec![light.clone()]);
        let found = vertex_error(&values, &expected, &vertex_areas(&scene)).rms;
        println!("{light}: {found:.4}");
        assert!(found < 0.03, "{light}: {found}");
        for (triangle, vertices) in scene.mesh.triangles.iter().enumerate() {
            if !scene.parts.parts[scene.parts.triangle_part[triangle] as usize].transfers() {
                assert!(vertices.iter().all(|&v| values[v as usize] == DVec3::ZERO));
            }
        }
    }
}

#[test]
fn the_same_bytes_and_values_on_any_number_of_threads() {
    let scene = scene(shapes::bumpy_head(1.0, 3), Scale::DiagonalMm(20.0), "skin1");
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let asset = bake(&scene, 4_000, &[]).unwrap();
            let values = lit(reopened(&asset).as_mut(), lights(&scene));
            (asset.to_bytes().unwrap(), values)
        })
    };
    let first = run(1);
    assert!(run(8) == first);
}

#[test]
fn lists_beyond_reason_are_refused_before_the_work() {
    // 40,962 vertices, each with nearly all others.
    let scene = scene(shapes::icosphere(1.0, 6), Scale::DiagonalMm(5.0), "skimmilk");
    let now = Instant::now();
    let error = bake(&scene, 1000, &[]).unwrap_err();
    println!("{} ({:.1?})", error.message(), now.elapsed());
    assert_eq!(error.code(), ExitCode::Unsupported);
    assert!(error.message().contains("40962 vertices") && error.message().contains("--set range-share"));
    // What an asset asks for is judged as well.
    let coarse = in_memory::scene(shapes::icosphere(1.0, 2), Scale::DiagonalMm(5.0), "skimmilk");
    // Baked of few vertices, and of all of them as a file would have it: judged before the two are compared.
    let mut asset = Asset { scene: scene.clone(), ..bake(&coarse, 1000, &[("range-share", "99%")]).unwrap() };
    let mut lists =
        translux_format::scattering_lists::ScatteringLists::from_sections(&asset.sections).unwrap().unwrap();
    lists.ranges_mm = vec![1e6];
    asset.sections.retain(|section| section.kind == Kind::Metadata);
    asset.sections.extend(lists.to_sections().unwrap());
    let error = registry().open(Arc::new(asset)).err().unwrap();
    assert_eq!(error.code(), ExitCode::Unsupported, "{}", error.message());
    assert!(error.message().contains("40962 vertices"), "{}", error.message());
}

#[test]
fn damaged_sections_are_refused_or_harmless() {
    let scene = scene(shapes::bumpy_head(1.0, 2), Scale::DiagonalMm(20.0), "marble");
    let asset = bake(&scene, 500, &[]).unwrap();
    let mut without = asset.clone();
    without.sections.clear();
    assert_eq!(registry().open(Arc::new(without)).err().unwrap().code(), ExitCode::InvalidInput);
    for at in 0..asset.sections[0].bytes.len() {
        for bit in [0x01, 0x55, 0x80] {
            let mut changed = asset.clone();
            changed.sections[0].bytes[at] ^= bit;
            if let Ok(mut evaluator) = registry().open(Arc::new(changed)) {
                let values = lit(evaluator.as_mut(), vec![Light::constant(DVec3::ONE).unwrap()]);
                assert!(values.iter().all(|v| v.is_finite()));
            }
        }
    }
    let mut evaluator = reopened(&asset);
    evaluator.set_media(scene.media.clone()).unwrap();
    let error = evaluator.set_media(vec![in_memory::medium("skin1")]).unwrap_err();
    assert_eq!(error.code(), ExitCode::Unsupported);
    assert_eq!(evaluator.set_media(Vec::new()).unwrap_err().code(), ExitCode::CommandLine);
}
