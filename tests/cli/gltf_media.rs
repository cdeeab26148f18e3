//! glTF files that say what they are made of: one command without options, and what the user types before it.
#![allow(clippy::unwrap_used, missing_docs)]

use serde_json::{Value, json};

use crate::common::{Folder, glb};
use translux::geometry::shapes;
use translux::io::png::decode_png;

/// A GLB with spheres of 4 cm in a row, one for each material.
fn spheres(materials: &Value) -> Vec<u8> {
    let sphere = shapes::icosphere(0.02, 3);
    let positions: Vec<[f32; 3]> = sphere.positions.iter().map(|p| p.as_vec3().to_array()).collect();
    let mut binary: Vec<u8> = positions.as_flattened().iter().flat_map(|v| v.to_le_bytes()).collect();
    let indices = binary.len();
    binary.extend(sphere.triangles.as_flattened().iter().flat_map(|v| v.to_le_bytes()));
    let count = materials.as_array().unwrap().len();
    let nodes: Vec<Value> =
        (0..count).map(|i| json!({"mesh": i, "translation": [0.06 * i as f64, 0.0, 0.0]})).collect();
    let meshes: Vec<Value> = (0..count)
        .map(|i| json!({"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": i}]}))
        .collect();
    let document = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": (0..count).collect::<Vec<_>>()}],
        "nodes": nodes, "meshes": meshes, "materials": materials,
        "buffers": [{"byteLength": binary.len()}],
        "bufferViews": [
            {"buffer": 0, "byteLength": indices},
            {"buffer": 0, "byteOffset": indices, "byteLength": binary.len() - indices},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": positions.len()},
            {"bufferView": 1, "componentType": 5125, "type": "SCALAR", "count": 3 * sphere.triangles.len()},
        ],
    });
    glb(&document, &binary)
}

/// What is left of light after 2 mm is a third, and most of the rest comes back.
fn wax() -> Value {
    json!({"name": "wax", "normalTexture": {"index": 0}, "extensions": {
        "KHR_materials_transmission": {"transmissionFactor": 1},
        "KHR_materials_volume": {"thicknessFactor": 1, "attenuationDistance": 0.002,
            "attenuationColor": [0.367_879_44, 0.367_879_44, 0.367_879_44]},
        "KHR_materials_volume_scatter": {"multiscatterColor": [0.9, 0.7, 0.5]},
        "KHR_materials_ior": {"ior": 1.44},
    }})
}

const BAKE: &str = "--method two_pass --samples 500";

#[test]
fn a_file_that_says_it_already_needs_no_option() {
    let folder = Folder::new();
    folder.write("two.glb", spheres(&json!([wax(), {"name": "wood"}])));
    let baked = folder.run(&format!("bake two.glb {BAKE} -o two.tlux")).ok();
    for line in [
        "MATERIAL wax: KHR_materials_volume_scatter of the file, g 0, eta 1.44 | asked multi-scatter albedo 0.900 0.700 0.500",
        "MATERIAL wood: opaque",
        "wax: mean free path 2.00 2.00 2.00 mm",
        "of the materials these are not used: normalTexture",
    ] {
        assert_eq!(baked.stderr.matches(line).count(), 1, "{line}: {}", baked.stderr);
    }
    folder.run("render two.tlux --light constant:radiance=1 --resolution 64x64 -o two.png -q").ok();
    // The asset keeps the medium of the file.
    let report = folder.run("inspect two.tlux --json").ok().json();
    let media = report["media"].as_array().unwrap();
    assert_eq!((media.len(), media[0]["name"].as_str()), (1, Some("wax")));
    assert!((media[0]["mean_free_path_mm"][2].as_f64().unwrap() - 2.0).abs() < 1e-6);
    // Whoever names them wins.
    let named = folder.run(&format!("bake two.glb {BAKE} --material marble -o marble.tlux")).ok();
    assert!(!named.stderr.contains("MATERIAL") && named.stderr.contains("marble: mean free path"), "{}", named.stderr);
    let scaled = folder.run(&format!("bake two.glb {BAKE} --unit cm --skip wood -o small.tlux")).ok();
    assert!(scaled.stderr.contains("wax: mean free path 0.0200 0.0200 0.0200 mm"), "{}", scaled.stderr);
}

#[test]
fn what_a_file_cannot_say_is_asked_for() {
    let folder = Folder::new();
    let glass = json!({"name": "glass", "extensions": {"KHR_materials_transmission": {"transmissionFactor": 1}}});
    let mut thin = wax();
    thin["extensions"].as_object_mut().unwrap().remove("KHR_materials_volume");
    let mut bad = wax();
    bad["extensions"]["KHR_materials_volume"]["attenuationDistance"] = json!(-1);
    for (materials, code, fragments) in [
        (json!([wax(), glass]), 1, ["a.glb: material 'glass' lets light through", "--skip 'glass'"]),
        (json!([thin]), 1, ["material 'wax' scatters light inside", "--color '#f3dabc' --radius-mm 1"]),
        (json!([bad]), 3, ["material 'wax'", "attenuationDistance: -1 is no distance above 0"]),
        (json!([{"name": "wood"}]), 1, ["what is it made of?", "--material marble"]),
    ] {
        folder.write("a.glb", spheres(&materials));
        folder.run(&format!("bake a.glb {BAKE} -o a.tlux")).fails(code, &fragments);
        folder.run(&format!("bake a.glb {BAKE} --material wax -o a.tlux -q")).ok();
    }
}

#[test]
fn a_model_is_shown_in_one_command_without_options() {
    let folder = Folder::new();
    let clay = json!({"name": "clay", "pbrMetallicRoughness": {"baseColorFactor": [0.9, 0.2, 0.1, 1]}});
    folder.write("one.glb", spheres(&json!([clay])));
    let view = "--resolution 32x32 --samples-per-pixel 4 --light constant:radiance=1 --background none --no-specular";
    let centre = |picture: &str| {
        let image = decode_png(&folder.read(picture)).unwrap();
        image.rgb[16 * image.width + 16].map(f64::from)
    };
    let shown = folder.run(&format!("render one.glb {view}")).ok();
    for line in ["MATERIAL clay: guessed", "LOOK guessed", "one.glb: baked in memory", "one.render.png"] {
        assert_eq!(shown.stderr.matches(line).count(), 1, "{line}: {}", shown.stderr);
    }
    // The base colour lies over what was guessed.
    let clay = centre("one.render.png");
    assert!(clay[0] > 3.0 * clay[1] && clay[1] > 1.5 * clay[2], "{clay:?}");
    folder.run(&format!("render one.glb {view} --profile better-dipole --texture none -o white.png -q")).ok();
    let white = centre("white.png");
    assert!(white.iter().all(|c| (c - white[0]).abs() < 0.02 * white[0]), "{white:?}");
    // Who names a material is believed, and what is shown is what a bake of the same has.
    let lit = "--profile better-dipole --light directional:from=1,1,0:irradiance=3";
    let named = folder.run(&format!("evaluate one.glb --unit cm --material skin1 {lit} -o own.ply")).ok();
    assert!(!named.stderr.contains("guessed") && named.stderr.contains("skin1: mean free path"), "{}", named.stderr);
    folder.run("bake one.glb --unit cm --material skin1 --method two_pass -o one.tlux -q").ok();
    folder.run(&format!("evaluate one.tlux {lit} -o baked.ply -q")).ok();
    folder.run("compare own.ply baked.ply --fail-above 0.0001%").ok();
    // Frames come from sums that are prepared.
    folder.run("relight one.glb --profile better-dipole --device cpu --headless --frames 1 --resolution 32x32 --out turn -q").ok();
    let timings: Value = serde_json::from_slice(&folder.read("turn/timings.json")).unwrap();
    assert_eq!(timings["method"], "editable");
}

#[test]
fn a_colour_of_the_file_is_part_of_its_medium_and_does_not_lie_over_it_too() {
    let folder = Folder::new();
    let leaf = json!({"name": "leaf", "pbrMetallicRoughness": {"baseColorFactor": [0.3, 0.8, 0.4, 1]}, "extensions": {
        "KHR_materials_diffuse_transmission": {"diffuseTransmissionFactor": 1, "diffuseTransmissionColorFactor": [0.3, 0.8, 0.4]},
    }});
    folder.write("leaf.glb", spheres(&json!([leaf])));
    let view = "--resolution 16x16 --samples-per-pixel 1 --light constant:radiance=1 --profile better-dipole";
    let shown = folder.run(&format!("render leaf.glb {view} -o once.png")).ok();
    for line in ["MATERIAL leaf: guessed", "LOOK leaf: asked #95e7aa"] {
        assert!(shown.stderr.contains(line), "{line}: {}", shown.stderr);
    }
    folder.run(&format!("render leaf.glb {view} --texture none -o without.png -q")).ok();
    assert_eq!(folder.read("once.png"), folder.read("without.png"));
}

#[test]
fn what_is_missing_of_a_model_in_the_place_of_an_asset_is_asked_for() {
    let folder = Folder::new();
    folder.write("one.glb", spheres(&json!([wax()])));
    let obj = shapes::icosphere(1.0, 1);
    let line = |letter: &str, three: [String; 3]| format!("{letter} {}\n", three.join(" "));
    let mut text: String = obj.positions.iter().map(|p| line("v", p.to_array().map(|x| x.to_string()))).collect();
    text.extend(obj.triangles.iter().map(|t| line("f", t.map(|v| (v + 1).to_string()))));
    folder.write("ball.obj", text);
    folder.run("render ball.obj").fails(1, &["--unit mm|cm|m"]);
    assert!(!folder.path("ball.render.png").exists());
    // A picture that cannot be read does not stand in the way.
    let unread = json!({"name": "clay", "pbrMetallicRoughness": {"baseColorTexture": {"index": 7}}});
    folder.write("unread.glb", spheres(&json!([unread])));
    let shown =
        folder.run("render unread.glb --profile better-dipole --resolution 16x16 --light constant:radiance=1").ok();
    assert!(shown.stderr.contains("its base colours are left out"), "{}", shown.stderr);
    folder.run("bake one.glb --method two_pass --samples 500 -o one.tlux -q").ok();
    folder.run("render one.tlux --unit cm").fails(1, &["--unit is of models"]);
    folder.run("render gone.glb").fails(2, &["gone.glb"]);
}
