//! What light does: it adds up, stays within its part, is stopped by what is opaque, and knows sizes.
#![allow(clippy::unwrap_used, missing_docs)]

mod common;

use common::{Folder, called, relative_difference};
use glam::DVec3;
use serde_json::Value;
use translux::geometry::shapes;

const LIGHTS: [&str; 5] = [
    "directional:from=1,2,3:irradiance=3,2,1",
    "point:at=0,10,30:intensity=900",
    "area:at=0,40,0:normal=0,-1,0:size=20,20:radiance=5",
    "constant:radiance=0.4",
    "sky:rotate=40",
];

#[test]
fn lights_add_up() {
    let folder = Folder::new();
    folder.obj("head.obj", &shapes::bumpy_head(12.0, 2));
    folder
        .run("bake head.obj --unit mm --material skin1 --samples 800 --method reference --set directions=128 -o a.tlux")
        .ok();
    let lit = |lights: &[&str]| {
        let flags: Vec<String> = lights.iter().map(|l| format!("--light {l}")).collect();
        folder.run(&format!("evaluate a.tlux {} -o b.ply", flags.join(" "))).ok();
        folder.radiosity("b.ply")
    };
    let alone: Vec<Vec<DVec3>> = LIGHTS.iter().map(|l| lit(&[l])).collect();
    let sum = |indices: &[usize]| -> Vec<DVec3> {
        (0..alone[0].len()).map(|v| indices.iter().map(|&i| alone[i][v]).sum()).collect()
    };
    for pair in [[0, 1], [1, 2], [2, 3], [3, 4], [4, 0]] {
        let error = relative_difference(&lit(&pair.map(|i| LIGHTS[i])), &sum(&pair));
        assert!(error < 1e-6, "{pair:?}: {error:.1e}");
    }
    assert!(relative_difference(&lit(&LIGHTS), &sum(&[0, 1, 2, 3, 4])) < 1e-6);
    assert_eq!(lit(&[LIGHTS[2], LIGHTS[0]]), lit(&[LIGHTS[0], LIGHTS[2]]), "the order of the lights matters");
    // Twice the same light is twice the light.
    let twice: Vec<DVec3> = alone[1].iter().map(|b| *b * 2.0).collect();
    assert!(relative_difference(&lit(&[LIGHTS[1], LIGHTS[1]]), &twice) < 1e-6);
}

#[test]
fn values_scale_with_the_light_channel_by_channel() {
    let folder = Folder::new();
    folder.obj("head.obj", &shapes::bumpy_head(12.0, 2));
    for method in ["reference", "two_pass"] {
        folder.run(&format!("bake head.obj --unit mm --material skin1 --samples 800 --method {method} -o a.tlux")).ok();
        let lit = |light: &str| {
            folder.run(&format!("evaluate a.tlux --light {light} -o b.ply")).ok();
            folder.radiosity("b.ply")
        };
        for (one, scaled) in [
            ("directional:from=1,2,3:irradiance=1", "directional:from=2,4,6:irradiance=8,0.5,0"),
            ("point:at=0,10,30:intensity=1", "point:at=0,10,30:intensity=8,0.5,0"),
            (
                "area:at=0,40,0:normal=0,-1,0:size=9,9:radiance=1",
                "area:at=0,40,0:normal=0,-1,0:size=9,9:radiance=8,0.5,0",
            ),
            ("constant:radiance=1", "constant:radiance=8,0.5,0"),
            ("sky", "sky:scale=8,0.5,0"),
        ] {
            let expected: Vec<DVec3> = lit(one).iter().map(|b| *b * DVec3::new(8.0, 0.5, 0.0)).collect();
            let error = relative_difference(&lit(scaled), &expected);
            // The hierarchy is tuned to its light, up to the asked 0.5 %.
            assert!(error < if method == "reference" { 1e-6 } else { 0.02 }, "{method}, {one}: {error:.1e}");
        }
    }
}

/// A small ball `a` in the shadow of a large ball `b`, which the light from +X hits; vertices of `a` come first.
fn balls(distance: f64) -> (Folder, usize) {
    let folder = Folder::new();
    let (a, b) = (called(shapes::icosphere(4.0, 3), "a"), called(shapes::icosphere(5.0, 3), "b"));
    let vertices = a.positions.len();
    folder.obj("balls.obj", &shapes::compose(&[(a, DVec3::ZERO), (b, DVec3::X * distance)]));
    (folder, vertices)
}

/// Brightest vertex of `a` and of `b`.
fn brightest(folder: &Folder, vertices: usize, flags: &str) -> [f64; 2] {
    let light = "--light directional:from=1,0,0:irradiance=3";
    folder.run(&format!("reference balls.obj --unit mm --samples 3000 {flags} {light} -o b.ply")).ok();
    let values = folder.radiosity("b.ply");
    let brightest = |b: &[DVec3]| b.iter().fold(0.0_f64, |m, v| m.max(v.max_element()));
    [brightest(&values[..vertices]), brightest(&values[vertices..])]
}

#[test]
fn light_reaches_another_part_only_through_a_common_medium() {
    let (apart, a) = balls(10.0);
    for rule in ["auto", "separate"] {
        let [dark, lit] = brightest(&apart, a, &format!("--material skin1 --parts {rule}"));
        assert!(dark == 0.0 && lit > 0.1, "{rule}: {dark} {lit}");
    }
    let [reached, lit] = brightest(&apart, a, "--material skin1 --parts joined");
    assert!(reached > 0.0 && reached < lit, "{reached} {lit}");
    // Of unlike media, nothing joins them.
    for rule in ["auto", "separate", "joined"] {
        let [dark, lit] = brightest(&apart, a, &format!("--material a=marble --material b=skin1 --parts {rule}"));
        assert!(dark == 0.0 && lit > 0.1, "{rule}: {dark} {lit}");
    }
}

#[test]
fn balls_that_touch_are_one_part() {
    let (touching, a) = balls(8.9);
    let auto = touching.run("bake balls.obj --unit mm --material skin1 --samples 300 -o a.tlux").ok();
    assert!(auto.stderr.contains("2 components -> 1 part (auto: touching or nested)"), "{}", auto.stderr);
    let [reached, _] = brightest(&touching, a, "--material skin1");
    assert!(reached > 1e-3, "{reached}");
    let [dark, _] = brightest(&touching, a, "--material skin1 --parts separate");
    assert_eq!(dark, 0.0);
    let [dark, _] = brightest(&touching, a, "--material a=skin1 --material b=marble");
    assert_eq!(dark, 0.0, "media differ, so touching joins nothing");
}

#[test]
fn opaque_parts_only_cast_shadows_and_skipped_ones_do_nothing() {
    let (folder, a) = balls(10.0);
    for material in ["--material skin1", "--material a=skin1"] {
        assert_eq!(brightest(&folder, a, &format!("{material} --opaque b")), [0.0, 0.0]);
        let [lit, gone] = brightest(&folder, a, &format!("{material} --skip b"));
        assert!(lit > 0.1 && gone == 0.0, "{lit} {gone}");
    }
    folder.run("bake balls.obj --unit mm --material a=skin1 --samples 64 -o a.tlux").fails(1, &["no material for b"]);
    // From the other side the light reaches `a` past the opaque ball behind it, and neither changes the other.
    let light = "--light directional:from=-1,0,0:irradiance=3 --samples 3000 -o b.ply";
    folder.run(&format!("reference balls.obj --unit mm --material skin1 --opaque b {light}")).ok();
    let with = folder.radiosity("b.ply");
    assert!(with[a..].iter().all(|b| *b == DVec3::ZERO));
    assert!(with[..a].iter().all(|b| b.min_element() > 0.0));
    let report = folder.run(&format!("reference balls.obj --unit mm --material skin1 --opaque b {light} --json")).ok();
    assert_eq!(report.json()["vertices_without_area"], with.len() - a);
    folder.run("bake balls.obj --unit mm --material skin1 --opaque b --samples 64 -o a.tlux").ok();
    let parts = folder.run("inspect a.tlux --json").ok().json()["parts"].clone();
    assert_eq!((&parts[1]["name"], &parts[1]["medium"], &parts[1]["samples"]), (&"b".into(), &Value::Null, &0.into()));
}

/// Each way to say the size of a box of 3 x 4 x 12 units, and the diagonal that it must give.
#[test]
fn sizes_are_millimetres() {
    let folder = Folder::new();
    let model = shapes::cuboid(DVec3::new(3.0, 4.0, 12.0), 1);
    // Away from its own origin, about which it is scaled.
    let moved = shapes::compose(&[(model, DVec3::new(20.0, -5.0, 1.0))]);
    folder.obj("box.obj", &moved);
    for (flags, diagonal) in [
        ("--unit mm", 13.0),
        ("--unit cm", 130.0),
        ("--unit m", 13000.0),
        ("--size-mm 26", 26.0),
        ("--height-mm 8", 26.0),
        ("--height-mm 8 --up y", 26.0),
        ("--height-mm 6 --up z", 6.5),
    ] {
        let baked = folder.run(&format!("bake box.obj {flags} --material marble --samples 64 -o a.tlux --json")).ok();
        assert!(baked.stderr.contains("SIZE "), "{flags}: {}", baked.stderr);
        let report = folder.run("inspect a.tlux --json").ok().json();
        for found in [&baked.json()["diagonal_mm"], &report["diagonal_mm"]] {
            let found = found.as_f64().unwrap();
            assert!((found / diagonal - 1.0).abs() < 1e-6, "{flags}: {found} mm instead of {diagonal}");
        }
        let scale = report["provenance"]["mm_per_source_unit"].as_f64().unwrap();
        assert!((scale / (diagonal / 13.0) - 1.0).abs() < 1e-12, "{flags}: {scale}");
        folder.run("evaluate a.tlux --light constant:radiance=1 -o b.ply").ok();
        for (found, source) in folder.positions("b.ply").iter().zip(&moved.positions) {
            assert!(found.distance(*source * scale) < 1e-6 * 30.0 * scale, "{flags}: {found} from {source}");
        }
    }
}

/// A box of 30 x 40 x 120 mm as glTF, which is in metres.
#[test]
fn gltf_is_in_metres() {
    let folder = Folder::new();
    let model = shapes::cuboid(DVec3::new(0.03, 0.04, 0.12), 1);
    let mut bytes: Vec<u8> =
        model.positions.iter().flat_map(|p| p.as_vec3().to_array()).flat_map(f32::to_le_bytes).collect();
    let (vertices, indices) = (model.positions.len(), 3 * model.triangles.len());
    bytes.extend(model.triangles.iter().flatten().flat_map(|v| v.to_le_bytes()));
    folder.write("box.bin", &bytes);
    let gltf = serde_json::json!({
        "asset": {"version": "2.0"},
        "buffers": [{"uri": "box.bin", "byteLength": bytes.len()}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 12 * vertices},
            {"buffer": 0, "byteOffset": 12 * vertices, "byteLength": 4 * indices},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": vertices, "type": "VEC3",
             "min": [-0.015, -0.02, -0.06], "max": [0.015, 0.02, 0.06]},
            {"bufferView": 1, "componentType": 5125, "count": indices, "type": "SCALAR"},
        ],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
    });
    folder.write("box.gltf", gltf.to_string());
    for (flags, diagonal) in [("", 130.0), ("--unit cm", 1.3), ("--size-mm 26", 26.0)] {
        let report = folder.run(&format!("bake box.gltf {flags} --material marble --samples 64 -o a.tlux --json")).ok();
        let found = report.json()["diagonal_mm"].as_f64().unwrap();
        assert!((found / diagonal - 1.0).abs() < 1e-6, "{flags}: {found} mm");
    }
    folder.run("reference box.gltf --material marble --samples 64 --light constant:radiance=1 -o b.ply").ok();
    for (found, source) in folder.positions("b.ply").iter().zip(&model.positions) {
        assert!(found.distance(*source * 1000.0) < 1e-4, "{found} mm from {source} m");
    }
}
