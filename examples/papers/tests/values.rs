//! The paper's encodings: radiosity against that of `two_pass`, sizes, the vector integral, odd meshes, the
//! same bytes on any number of threads, damaged files.
#![allow(clippy::unwrap_used, missing_docs)]

use std::sync::Arc;

use crate::hao::{Encoding, METHOD, VertexValues, registry};
use crate::in_memory::{lit, open, pairs, scene, scene_of, vertex_areas};
use glam::DVec3;
use translux::asset::{Asset, Provenance};
use translux::error::{ExitCode, Result};
use translux::evaluate::{AnyForm, BakeSettings, Evaluator};
use translux::geometry::mesh::Scale;
use translux::geometry::shapes;
use translux::geometry::source::SourceModel;
use translux::light::quantised::directions::DirectionSet;
use translux::light::{Light, LightKind, sky};
use translux::math::cube_map::{direction, texel_of};
use translux::math::statistics::{VertexError, vertex_error};
use translux::measure::probes::{self, Half};
use translux::progress::Silent;
use translux::scene::Scene;
use translux_format::metadata::tags;

const SAMPLES: usize = 5_000;

const ENCODINGS: [&str; 5] = ["raw", "uniform8", "lloyd8", "sh", "reference-points"];

const PARALLEL: [LightKind; 3] = [LightKind::Directional, LightKind::Environment, LightKind::Constant];

/// How an asset is baked.
struct Bake<'a> {
    scene: &'a Scene,
    kinds: &'a [LightKind],
    samples: Option<usize>,
    max_rms: f64,
}

impl<'a> Bake<'a> {
    fn new(scene: &'a Scene) -> Self {
        Self { scene, kinds: &PARALLEL, samples: Some(SAMPLES), max_rms: 0.03 }
    }

    fn run(&self, set: &[(&str, &str)]) -> Result<Asset> {
        let settings = BakeSettings {
            samples: self.samples,
            for_lights: self.kinds.iter().copied().collect(),
            probes: probes::for_bake(self.scene),
            ..BakeSettings::new(self.max_rms)
        };
        let recipe = registry().method(METHOD).unwrap().recipe(&pairs(set), settings)?;
        assert!(recipe.bake_memory(self.scene) > 0);
        recipe.bake(self.scene.clone(), Provenance::default(), &Silent)
    }
}

fn reopened(asset: &Asset) -> Box<dyn Evaluator> {
    let asset = Asset::from_bytes(&asset.to_bytes().unwrap()).unwrap();
    registry().open(Arc::new(asset)).unwrap()
}

fn head(subdivisions: u32) -> Scene {
    scene(shapes::bumpy_head(1.0, subdivisions), Scale::DiagonalMm(20.0), "marble")
}

fn sky_light() -> Light {
    Light::environment(Arc::new(sky::sky()), 40.0, DVec3::new(1.0, 0.8, 0.5)).unwrap()
}

/// Bytes of the method's sections as they lie in a file.
fn stored_bytes(asset: &Asset) -> usize {
    let mut without = asset.clone();
    without.sections.clear();
    asset.to_bytes().unwrap().len() - without.to_bytes().unwrap().len()
}

fn signal_to_noise_db(asset: &Asset) -> f64 {
    let note = &asset.ledger.entries.iter().find(|e| e.note.contains(" dB")).unwrap().note;
    let before = note.split(" dB").next().unwrap();
    before.rsplit(' ').next().unwrap().parse().unwrap()
}

#[test]
fn every_encoding_keeps_its_promise_and_its_size() {
    let scene = head(4);
    let mut truth = open("two_pass", scene.clone(), Some(4 * SAMPLES));
    let mut lights = probes::directional(Half::Figures);
    lights.truncate(2);
    lights.push(Light::directional(DVec3::new(1.0, 2.0, 3.0), DVec3::new(3.0, 2.0, 1.0)).unwrap());
    lights.extend([Light::constant(DVec3::new(0.5, 0.6, 0.7)).unwrap(), sky_light()]);
    let expected: Vec<Vec<DVec3>> = lights.iter().map(|l| lit(truth.as_mut(), vec![l.clone()])).collect();
    let areas = vertex_areas(&scene);
    let mut sizes = Vec::new();
    for encoding in ENCODINGS {
        let asset = Bake::new(&scene).run(&[("encoding", encoding)]).unwrap();
        let mut evaluator = reopened(&asset);
        let mut worst = 0.0f64;
        for (light, expected) in lights.iter().zip(&expected) {
            let values = lit(evaluator.as_mut(), vec![light.clone()]);
            assert!(values.iter().all(|v| v.cmpge(DVec3::ZERO).all()));
            let found = vertex_error(&values, expected, &areas).rms;
            let promised = evaluator.measured_error(&[], &Silent).unwrap().total_rms();
            assert!(found < 0.05 && found < 1.25 * promised + 4e-3, "{encoding}, {light}: {found} {promised}");
            worst = worst.max(found);
        }
        let vertices = scene.mesh.local_mm.len() as f64;
        let (disk, held) = (stored_bytes(&asset) as f64 / vertices, evaluator.cost().resident_bytes as f64 / vertices);
        println!("{encoding}: {disk:.1} bytes/vertex, {held:.1} resident, worst {:.2} %", 100.0 * worst);
        for entry in &asset.ledger.entries {
            println!("    {}: {:.2} % ({})", entry.stage, 100.0 * entry.error.rms, entry.note);
        }
        sizes.push((disk, held));
        if encoding.ends_with('8') {
            assert!(signal_to_noise_db(&asset) >= 50.0);
        }
    }
    let [raw, uniform, lloyd, sh, references] = sizes[..] else { unreachable!() };
    let near = |bytes: f64, expected: f64| (bytes - expected).abs() < 6.0;
    assert!(near(raw.1, 2400.0) && near(uniform.1, 600.0) && near(lloyd.1, 600.0), "{sizes:?}");
    assert!(raw.0 > 2.0 * lloyd.0 && lloyd.0 < 0.7 * lloyd.1 && sh.0 < lloyd.0 && references.0 < lloyd.0, "{sizes:?}");
    assert!(sh.1 < 0.6 * lloyd.1 && references.1 < 0.6 * lloyd.1, "{sizes:?}");
}

/// The directions of a set, as its specification has them.
fn entries(count: usize) -> Vec<DVec3> {
    let centre = |d: &DVec3| {
        let texel = texel_of(64, *d);
        direction(64, texel / 4096, texel % 64, texel % 4096 / 64)
    };
    DirectionSet::fibonacci(count).unwrap().directions().iter().map(centre).collect()
}

#[test]
fn vectors_give_the_scalars_at_the_lights_of_the_set_and_are_better_between() {
    let scene = head(2);
    // An error so small that there is no hierarchy, whose clusters differ between the two.
    let exact = Bake { max_rms: 1e-5, samples: Some(1500), ..Bake::new(&scene) };
    for interpolation in ["nearest4", "rbf"] {
        let [q, vector] = ["scalar", "vector"].map(|integral| {
            let set = [("encoding", "raw"), ("lights", "40"), ("interpolation", interpolation), ("integral", integral)];
            exact.run(&set).unwrap()
        });
        assert_eq!(reopened(&vector).cost().resident_bytes / reopened(&q).cost().resident_bytes, 2);
        let (mut q, mut vector) = (reopened(&q), reopened(&vector));
        for from in entries(40).into_iter().step_by(3) {
            let light = Light::directional(from, DVec3::new(1.0, 2.0, 0.5)).unwrap();
            let [a, b] = [&mut q, &mut vector].map(|e| lit(e.as_mut(), vec![light.clone()]));
            let largest = a.iter().fold(0.0f64, |m, v| m.max(v.max_element()));
            let difference = a.iter().zip(&b).fold(0.0f64, |m, (a, b)| m.max((*a - *b).abs().max_element()));
            assert!(difference < 2e-5 * largest, "{interpolation}: {difference} of {largest}");
        }
        // Two lights and an environment add up.
        let sun = Light::directional(DVec3::new(1.0, 1.0, 2.0), DVec3::ONE).unwrap();
        let [both, one, other] =
            [vec![sun.clone(), sky_light()], vec![sun], vec![sky_light()]].map(|lights| lit(vector.as_mut(), lights));
        for ((both, one), other) in both.iter().zip(&one).zip(&other) {
            assert!((*both - *one - *other).abs().max_element() < 0.02 * both.max_element().max(0.05));
        }
    }
    let mut truth = open("two_pass", scene.clone(), Some(4 * SAMPLES));
    let areas = vertex_areas(&scene);
    let [q, vector] = ["scalar", "vector"].map(|integral| {
        let set = [("encoding", "lloyd8"), ("lights", "60"), ("interpolation", "nearest4"), ("integral", integral)];
        let mut evaluator = reopened(&Bake::new(&scene).run(&set).unwrap());
        let error = |light: Light| {
            let values = lit(evaluator.as_mut(), vec![light.clone()]);
            vertex_error(&values, &lit(truth.as_mut(), vec![light]), &areas).rms
        };
        let errors: Vec<f64> = probes::directional(Half::Figures).into_iter().map(error).collect();
        errors.iter().sum::<f64>() / errors.len() as f64
    });
    println!("nearest4 between 60 lights: scalar {q:.4}, vector {vector:.4}");
    assert!(vector < 0.8 * q, "{vector} {q}");
}

/// An open sheet, a ball with a fin on an edge (three triangles there), a vertex without area, a loose triangle, and a
/// stone that only casts shadows; two media.
fn odd_scene() -> Scene {
    let named = |mut model: SourceModel, name: &str| {
        model.materials = vec![name.to_owned()];
        model
    };
    let mut ball = shapes::icosphere(3.0, 2);
    let edge = ball.triangles[0];
    let first = ball.positions.len() as u32;
    ball.positions.extend([DVec3::new(5.0, 5.0, 0.0), DVec3::new(-6.0, 0.0, 0.0)]);
    ball.triangles.extend([[edge[0], edge[1], first], [edge[0], edge[0], first + 1]]);
    ball.triangle_material.extend([0, 0]);
    let sheet = shapes::plane(12.0, 9.0, 7);
    let loose = SourceModel {
        materials: vec!["marble".into()],
        ..SourceModel::new(vec![DVec3::ZERO, DVec3::X, DVec3::Y], vec![[0, 1, 2]])
    };
    let parts = [
        (named(ball, "marble"), DVec3::ZERO),
        (named(sheet, "skin1"), DVec3::new(0.0, -4.0, 0.0)),
        (loose, DVec3::new(9.0, 2.0, 0.0)),
        (named(shapes::cuboid(DVec3::splat(2.0), 1), "stone"), DVec3::new(0.0, 6.0, 1.0)),
    ];
    let media = [("marble", "marble"), ("skin1", "skin1")];
    scene_of(shapes::compose(&parts), Scale::MillimetresPerUnit(1.0), &media)
}

/// Error against the values as they are.
fn against_raw(scene: &Scene, asset: &Asset, raw: &Asset, lights: &[Light]) -> VertexError {
    let (mut found, mut expected) = (reopened(asset), reopened(raw));
    let of_light = |light: &Light| {
        let [a, b] = [&mut found, &mut expected].map(|e| lit(e.as_mut(), vec![light.clone()]));
        vertex_error(&a, &b, &vertex_areas(scene))
    };
    lights.iter().map(of_light).fold(VertexError::default(), VertexError::max)
}

#[test]
fn parts_boundaries_and_edges_of_three_triangles_work() {
    let scene = odd_scene();
    let bake = Bake { samples: Some(800), ..Bake::new(&scene) };
    let raw = bake.run(&[("encoding", "raw"), ("lights", "100")]).unwrap();
    // From below the sheet shades the rest: hardly any light to be relative to.
    let mut lights = probes::directional(Half::Figures);
    lights.retain(|l| matches!(l, Light::Directional { from, .. } if from.y > 0.1));
    lights.push(sky_light());
    let error = |set: &[(&str, &str)]| {
        let asset = bake.run(&[set, &[("lights", "100")]].concat()).unwrap();
        against_raw(&scene, &asset, &raw, &lights).rms
    };
    let (bytes, harmonics) = (error(&[("encoding", "lloyd8")]), error(&[("encoding", "sh"), ("order", "7")]));
    println!("lloyd8 {bytes}, sh {harmonics}");
    assert!(bytes < 0.01 && harmonics < 0.15, "{bytes} {harmonics}");
    let ways = [("barycentric", "geometry"), ("least-squares", "geometry"), ("best", "illumination")];
    for (weights, choice) in ways {
        let of = |references: &str| {
            let keys = [("references", references), ("order", "3"), ("weights", weights), ("choice", choice)];
            error(&[&[("encoding", "reference-points")][..], &keys].concat())
        };
        // More than there are: every vertex is one.
        let errors = ["20", "80", "100000"].map(of);
        println!("{weights}, {choice}: {errors:?}");
        assert!(errors[1] < 0.12 && errors[1] < 0.9 * errors[0] && errors[2] < 0.01, "{errors:?}");
    }
}

#[test]
fn hardly_any_mesh_and_nothing_translucent_are_no_failures() {
    let corners = [DVec3::ZERO, DVec3::X, DVec3::new(0.2, 0.9, 0.3)].map(|p| p * 5.0).to_vec();
    let triangle = SourceModel::new(corners, vec![[0, 1, 2]]);
    let opaque = scene_of(shapes::icosphere(5.0, 1), Scale::MillimetresPerUnit(1.0), &[]);
    let triangle = scene(triangle, Scale::MillimetresPerUnit(1.0), "marble");
    for encoding in ENCODINGS {
        let set = [("encoding", encoding), ("lights", "50")];
        let mut evaluator = reopened(&Bake { samples: Some(50), ..Bake::new(&triangle) }.run(&set).unwrap());
        for light in [sky_light(), probes::constant(), Light::directional(DVec3::Z, DVec3::ONE).unwrap()] {
            let values = lit(evaluator.as_mut(), vec![light]);
            assert!(values.iter().all(|v| v.is_finite() && v.max_element() > 0.0), "{encoding}: {values:?}");
        }
        let bright = Light::directional(DVec3::Z, DVec3::splat(1e300)).unwrap();
        match evaluator.set_lights(vec![bright], &Silent) {
            Ok(()) => assert!(evaluator.radiosity(&Silent).unwrap().iter().all(|v| !v.is_nan())),
            Err(error) => assert_eq!(error.code(), ExitCode::Runtime),
        }
        let error = Bake { samples: Some(50), ..Bake::new(&opaque) }.run(&set).unwrap_err();
        assert_eq!(error.code(), ExitCode::InvalidInput);
    }
}

#[test]
fn point_lights_have_shells() {
    let scene = head(3);
    let at = |distance: f64| {
        let at = scene.mesh.origin_mm + distance * DVec3::new(0.36, 0.48, 0.8);
        Light::point(at, DVec3::splat(distance * distance)).unwrap()
    };
    let mut truth = open("two_pass", scene.clone(), Some(4 * SAMPLES));
    for encoding in ["lloyd8", "sh", "reference-points"] {
        let bake = Bake { kinds: &[LightKind::Point], samples: Some(3000), ..Bake::new(&scene) };
        let mut evaluator = reopened(&bake.run(&[("encoding", encoding), ("lights", "100"), ("shells", "2")]).unwrap());
        for distance in [17.0, 40.0, 1e4] {
            let values = lit(evaluator.as_mut(), vec![at(distance)]);
            let found = vertex_error(&values, &lit(truth.as_mut(), vec![at(distance)]), &vertex_areas(&scene)).rms;
            assert!(found < 0.08, "{encoding}, {distance} mm: {found}");
        }
        let error = evaluator.set_lights(vec![at(8.0)], &Silent).unwrap_err();
        assert_eq!(error.code(), ExitCode::Unsupported, "{}", error.message());
    }
}

#[test]
fn keys_that_say_nothing_are_refused() {
    let scene = head(1);
    let refused: [&[(&str, &str)]; 8] = [
        &[("encoding", "raw"), ("integral", "vector"), ("shells", "2")],
        &[("encoding", "sh"), ("integral", "vector")],
        &[("encoding", "bleeding"), ("integral", "vector")],
        &[("encoding", "raw"), ("order", "7")],
        &[("encoding", "sh"), ("interpolation", "barycentric")],
        &[("encoding", "sh"), ("order", "20"), ("lights", "100")],
        &[("encoding", "lloyd8"), ("references", "9")],
        &[("encoding", "bleeding"), ("lights", "50")],
    ];
    for set in refused {
        let error = Bake { samples: Some(100), ..Bake::new(&scene) }.run(set).unwrap_err();
        assert_eq!(error.code(), ExitCode::CommandLine, "{set:?}: {}", error.message());
        assert!(set.iter().any(|(key, _)| error.message().contains(&format!("--set {key}"))), "{}", error.message());
    }
    let points = Bake { kinds: &[LightKind::Point], samples: Some(100), ..Bake::new(&scene) };
    let error = points.run(&[("encoding", "raw"), ("integral", "vector")]).unwrap_err();
    assert!(error.code() == ExitCode::CommandLine && error.message().contains("shells=0"), "{}", error.message());
}

/// Settings that go through every kind of section.
const ALL: [&[(&str, &str)]; 6] = [
    &[("encoding", "raw"), ("lights", "30")],
    &[("encoding", "uniform8"), ("lights", "30")],
    &[("encoding", "lloyd8"), ("integral", "vector"), ("lights", "30"), ("interpolation", "nearest4")],
    &[("encoding", "sh"), ("lights", "50"), ("window", "lanczos")],
    &[("encoding", "reference-points"), ("lights", "50"), ("choice", "geometry")],
    &[("encoding", "reference-points"), ("lights", "50"), ("references", "20"), ("weights", "barycentric")],
];

#[test]
fn threads_do_not_change_a_bit() {
    let scene = head(2);
    for set in ALL {
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let asset = Bake { samples: Some(800), ..Bake::new(&scene) }.run(set).unwrap();
                let sun = Light::directional(DVec3::new(1.0, 1.0, 2.0), DVec3::ONE).unwrap();
                let values = lit(reopened(&asset).as_mut(), vec![sky_light(), sun]);
                (asset.to_bytes().unwrap(), values)
            })
        };
        assert!(run(1) == run(8), "{set:?}");
    }
}

/// Bytes that were changed give an error or an evaluator, never a panic.
#[test]
fn damaged_sections_are_refused_or_harmless() {
    let scene = odd_scene();
    for set in ALL {
        let asset = Bake { samples: Some(500), ..Bake::new(&scene) }.run(set).unwrap();
        for index in 0..asset.sections.len() {
            let mut without = asset.clone();
            let tag = without.sections.remove(index).tag;
            assert_eq!(registry().open(Arc::new(without)).err().unwrap().code(), ExitCode::InvalidInput, "{tag}");
            let length = asset.sections[index].bytes.len();
            for at in (0..length).step_by((length / 12).max(1)) {
                let mut changed = asset.clone();
                changed.sections[index].bytes[at] ^= 0x55;
                if let Ok(mut evaluator) = registry().open(Arc::new(changed))
                    && evaluator.set_lights(vec![sky_light()], &Silent).is_ok()
                {
                    match evaluator.radiosity(&Silent) {
                        Ok(values) => assert!(values.iter().all(|v| !v.is_nan())),
                        // More than the light could have brought in.
                        Err(refused) => assert_eq!(refused.code(), ExitCode::InvalidInput, "{refused}"),
                    }
                }
            }
        }
        // Sections of one encoding under the settings of another.
        let mut other = asset.clone();
        let settings = other.sections.iter_mut().find(|section| section.tag == tags::SETTINGS).unwrap();
        let mut form: VertexValues = settings.record().unwrap();
        form.encoding = if set[0].1 == "sh" { Encoding::Raw } else { Encoding::Harmonics };
        [_, *settings] = AnyForm::record(&form).unwrap();
        assert_eq!(registry().open(Arc::new(other)).err().unwrap().code(), ExitCode::InvalidInput);
    }
}
