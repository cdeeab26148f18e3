//! Scenes that nobody wants and somebody has: no method may fail on them.

use super::*;

fn triangle(size_mm: f64) -> SourceModel {
    SourceModel::new([DVec3::ZERO, DVec3::X, DVec3::new(0.2, 0.9, 0.3)].map(|p| p * size_mm).to_vec(), vec![[0, 1, 2]])
}

/// Keys that shorten a bake: nothing is compared with a truth here. One body has as many lights as are found to be needed.
fn shortest(method: &dyn Method, scene: &Scene) -> Vec<(String, String)> {
    let keys = if scene.parts.parts.len() == 1 { short(method) } else { few_lights(method, 100) };
    // A quarter of the texels of others.
    keys.into_iter()
        .map(|(key, value)| if key == "resolution" { (key, "64".to_owned()) } else { (key, value) })
        .collect()
}

/// Bakes and evaluates a scene with every method under every light, alone and all at once. A flat or convex surface
/// under constant light returns at most what arrives, `most` times pi.
fn survives(name: &str, scene: &Scene, samples: &[usize], most: f64) {
    let lights = every_light_but(&[LightKind::Point], scene);
    for method in every() {
        for &samples in samples {
            let what = format!("{name}, {}, {samples} samples", method.name());
            let mut evaluator = reopened(&asset(method, scene, samples, &shortest(method, scene)));
            for light in &served(method, &lights) {
                let values = lit(evaluator.as_mut(), vec![light.clone()]);
                assert_eq!(values.len(), scene.mesh.local_mm.len(), "{what}");
                assert_not_negative(&format!("{what}, {}", light.kind().name()), &values);
            }
            let under: Vec<Light> = std::iter::once(probes::constant()).chain(served(method, &lights[1..2])).collect();
            let largest =
                lit(evaluator.as_mut(), vec![probes::constant()]).iter().fold(0.0f64, |a, v| a.max(v.max_element()));
            let translucent = scene.parts.parts.iter().any(|p| p.transfers());
            assert_eq!(largest > 0.0, translucent, "{what}");
            assert!(largest <= most * std::f64::consts::PI, "{what}: {largest} under constant light");
            let plain = lit(evaluator.as_mut(), under.clone());
            // A direction and a point.
            let measured = evaluator.measured_error(&probes::unseen(&scene.mesh)[1..], &Silent).unwrap();
            assert!(measured.total_rms().is_finite(), "{what}: {measured:?}");
            evaluator.prepare_for_edits(&Silent);
            let prepared = lit(evaluator.as_mut(), under);
            let largest = plain.iter().fold(0.0f64, |a, v| a.max(v.max_element()));
            let near = |(a, b): (&DVec3, &DVec3)| (*a - *b).abs().max_element() <= 0.03 * largest;
            assert!(prepared.iter().zip(&plain).all(near), "{what}: prepared for edits");
        }
    }
}

#[test]
fn a_single_triangle() {
    survives("triangle", &scene(triangle(5.0), Scale::MillimetresPerUnit(1.0), "marble"), &[1, 200], 1.02);
}

#[test]
fn an_open_plane() {
    survives("plane", &scene(shapes::plane(20.0, 20.0, 8), Scale::MillimetresPerUnit(1.0), "skin1"), &[300], 1.02);
}

#[test]
fn nothing_translucent() {
    let model = called(shapes::icosphere(5.0, 2), "stone");
    let opaque = scene_of(model.clone(), Scale::MillimetresPerUnit(1.0), &[]);
    assert!(opaque.media.is_empty() && opaque.parts.parts.iter().all(|p| !p.transfers()));
    survives("opaque", &opaque, &[1, 100], 0.0);
    // A medium that no part has.
    let mut unused = opaque;
    unused.media = vec![medium("marble")];
    survives("unused medium", &unused, &[1, 100], 0.0);
}

#[test]
fn few_samples() {
    survives("head", &head(1, "marble"), &[1, 80], 2.0);
    // Fewer samples than parts.
    survives("group", &group(1), &[1], 2.0);
}

#[test]
fn a_huge_object_and_tiny_ones() {
    for (size_mm, material) in [(1e-4, "ketchup"), (1e6, "cream")] {
        let scene = scene(shapes::bumpy_head(1.0, 1), Scale::DiagonalMm(size_mm), material);
        survives(&format!("{size_mm} mm of {material}"), &scene, &[500], 2.0);
    }
}
